"""Assistants in Python: the input of a method, and the part that all assistants share.

What they see of the obstacles, the margin they keep and their freedom are those of the compiled
assistants (`wheelchair_gym.people.assistance`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from wheelchair_gym.base.arrays import Array
from wheelchair_gym.maps import OccupancyGrid
from wheelchair_gym.people.assistance.methods import STEP, Shielded, free_share
from wheelchair_gym.people.assistance.state import AssistMission, Freedom, Twist
from wheelchair_gym.people.assistance.step import Assistants
from wheelchair_gym.types import Reading, Stick

__all__ = [
    "AssistInput", "AssistMission", "Assistant", "Freedom", "Method", "SharedAssistant", "Twist",
]  # fmt: skip


@dataclass(frozen=True)
class AssistInput:
    """Input of an assistant's decision.

    Attributes:
        asked: the stick's twist [m/s, rad/s], slowed backward as the freedom says.
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

    def free_share(self, mission: AssistMission, twist: Twist, time: float) -> float:
        """Share of a time [s] for which the chair could follow a twist."""
        outline = mission.chair.footprint.array
        return float(free_share(self.points, outline, *twist, time, STEP, self.margin))


class Method(Protocol):
    """The decisions of an assistant; `SharedAssistant` does the rest."""

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
        self._row = Assistants(
            Shielded(), mission.chair, mission.sensors, mission.period, freedom=self.freedom
        )
        self._row.begin()
        self.method.reset(mission)

    def assist(self, stick: Stick, reading: Reading, map: OccupancyGrid | None) -> Array:
        """See `Assistant.assist`."""
        row = self._row
        row.update(stick, reading)
        v, w = row.states["asked"][0].tolist()
        if v == 0.0 and w == 0.0:
            return np.zeros(2)
        points = row.states["points"][0, : row.states["n_points"][0]].copy()
        margin, turn = float(row.states["margin"][0]), float(row.states["turn"][0])
        now = AssistInput((v, w), reading, points, margin, turn, map)
        row.states["twist"][0] = self.method.twist(now)
        return row.twist()
