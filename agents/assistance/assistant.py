"""What all assistants share: what they may know, what they see, and how far they may go.

An assistant slows a chair or turns it, and no more: the speed that is asked for lies between rest
and that of the stick, and the turn rate differs from the stick's by at most a freedom that shrinks
with the stick's deflection. So a centred stick asks for rest, at once, whatever the assistant.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import NDArray

from agents.assistance.surround import Surround
from wheelchair_gym.config import setting, settings
from wheelchair_gym.kinematics import Limits
from wheelchair_gym.maps import OccupancyGrid
from wheelchair_gym.types import Reading, Stick

if TYPE_CHECKING:
    from wheelchair_gym.physics.settings import ChairSettings
    from wheelchair_gym.sensors.settings import SensorSettings

Array = NDArray[np.float64]
Twist = tuple[float, float]

STEADY = 0.1  # deflection by which a steady stick may change
_CHOICE = "design choice"


@settings
class Freedom:
    """How far an assistant may go, and how near obstacles it lets the chair come."""

    turn: float = setting(default=0.5, unit="rad/s", low=0.0, high=4.0, source=_CHOICE)
    """Largest difference of the turn rate from the stick's, at full deflection."""
    margin: float = setting(
        default=0.03, unit="m", low=0.0, high=1.0, source="more shuts doors of 0.80 m: derived"
    )
    """Distance to obstacles that it keeps."""
    docking_margin: float = setting(
        default=0.01, unit="m", low=0.0, high=1.0, source="docking at a desk: assumed"
    )
    """Distance that it keeps once the stick has been low and steady."""
    docking_stick: float = setting(
        default=0.35, low=0.0, high=1.0, source="no published value found: assumed"
    )
    """Largest deflection of a low stick."""
    docking_time: float = setting(
        default=1.0, unit="s", low=0.0, high=60.0, source="no published value found: assumed"
    )
    """Time for which the stick must be low and steady."""


@dataclass(frozen=True)
class AssistMission:
    """What an assistant may know before a person drives: the chair, and nothing of the person."""

    chair: ChairSettings
    sensors: SensorSettings
    period: float  # s, of control

    @property
    def limits(self) -> Limits:
        """The chair's limits of speed and acceleration."""
        return self.chair.limits


@dataclass(frozen=True)
class AssistInput:
    """What an assistant decides by.

    Attributes:
        asked: the stick's twist [m/s, rad/s].
        reading: the latest.
        points: obstacles around (n, 2) [m] in the chair's frame, those lately seen among them.
        margin: distance to them that is to be kept [m].
        turn: by how much the turn rate may differ from the stick's now [rad/s].
        map: of the world, if it is known.
    """

    asked: Twist
    reading: Reading
    points: Array
    margin: float
    turn: float
    map: OccupancyGrid | None


class Method(Protocol):
    """How an assistant decides; `SharedAssistant` does the rest."""

    def reset(self, mission: AssistMission) -> None:
        """Begin an episode."""
        ...

    def twist(self, now: AssistInput) -> Twist:
        """The twist [m/s, rad/s] for a stick that is not centred."""
        ...


class Assistant(Protocol):
    """Turns a person's stick into a twist."""

    def reset(self, mission: AssistMission) -> None:
        """Begin an episode: forget the last one."""
        ...

    def assist(self, stick: Stick, reading: Reading, map: OccupancyGrid | None) -> Array:
        """The twist (2,) [m/s, rad/s] for the next control period.

        Args:
            stick: what the person's interface gives.
            reading: what the chair senses.
            map: of the world; None: it is unknown.
        """
        ...


class SharedAssistant:
    """An assistant of a method: it sees, keeps the freedom, and lets go with the stick.

    Args:
        method: decides.
        freedom: how far it may go.
    """

    def __init__(self, method: Method, freedom: Freedom) -> None:
        self.method, self.freedom = method, freedom

    def reset(self, mission: AssistMission) -> None:
        """See `Assistant.reset`."""
        self._limits, self._period = mission.limits, mission.period
        self._surround = Surround(mission.chair, mission.sensors, mission.period)
        self._steady, self._held = 0.0, (0.0, 0.0)
        self.method.reset(mission)

    def assist(self, stick: Stick, reading: Reading, map: OccupancyGrid | None) -> Array:
        """See `Assistant.assist`."""
        points = self._surround.update(reading)
        margin = self._margin(stick)
        v, w = asked = self._limits.twist_of(stick.forward, stick.left)
        if v == 0.0 and w == 0.0:
            return np.zeros(2)
        size = min(1.0, math.hypot(stick.forward, stick.left))
        now = AssistInput(asked, reading, points, margin, size * self.freedom.turn, map)
        return np.array(within_freedom(self.method.twist(now), asked, now.turn, self._limits.turn))

    def _margin(self, stick: Stick) -> float:
        """The margin [m], which a low and steady stick lowers."""
        f, held = self.freedom, self._held
        size = math.hypot(stick.forward, stick.left)
        moved = math.hypot(stick.forward - held[0], stick.left - held[1]) > STEADY
        if moved:
            self._held = stick.forward, stick.left
        low = 0.0 < size <= f.docking_stick and stick.forward > 0.0
        self._steady = self._steady + self._period if low and not moved else 0.0
        docks = self._steady >= f.docking_time
        return min(f.margin, f.docking_margin) if docks else f.margin


def within_freedom(twist: Twist, asked: Twist, turn: float, most: float) -> Twist:
    """A twist, clipped to what may be made of the stick's [m/s, rad/s].

    Args:
        twist: that a method gives.
        asked: the stick's.
        turn: largest difference of the turn rates.
        most: the chair's limit of turn rates.
    """
    (v, w), (to_v, to_w) = twist, asked
    v = min(max(v, min(0.0, to_v)), max(0.0, to_v))
    w = min(max(w, min(0.0, to_w) - turn), max(0.0, to_w) + turn)
    return v, min(most, max(-most, w))


class Plain:
    """A method without memory: a function of the chair's outline and limits and the situation."""

    def __init__(self, decide: Callable[[AssistMission, AssistInput], Twist]) -> None:
        self._decide = decide

    def reset(self, mission: AssistMission) -> None:
        """See `Method.reset`."""
        self._mission = mission

    def twist(self, now: AssistInput) -> Twist:
        """See `Method.twist`."""
        return self._decide(self._mission, now)
