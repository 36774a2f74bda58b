"""An assistant's freedom: its changes of the stick, and its distance from obstacles.

An assistant slows a chair or turns it, and no more: the speed lies between rest and that of the
stick, and the turn rate lies between rest and the stick's, or beyond either by at most a freedom
that shrinks with the stick's deflection. So a centred stick asks for rest, at once, whatever the
assistant. A stick that is pulled back asks for a slow speed at most, whatever its deflection.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from wheelchair_gym.base.settings import setting, settings
from wheelchair_gym.compiled.kernel import borrowing_kernel
from wheelchair_gym.geometry.kinematics import Limits
from wheelchair_gym.sensors.settings import SensorSettings
from wheelchair_gym.sim.settings import ChairSettings

Twist = tuple[float, float]

STEADY = 0.1  # maximum change of deflection of a steady stick
DOCKING_MARGIN = 0.01  # m, kept once the stick has been low and steady, to reach a desk: assumed
# Largest deflection forward of a low stick, and s for which it must be low and steady: assumed.
_DOCKING_STICK, _DOCKING_TIME = 0.35, 1.0


@settings
class Freedom:
    """An assistant's freedom, and its distance from obstacles."""

    turn: float = setting(default=0.5, unit="rad/s", low=0.0, high=4.0)
    """Largest turn rate beyond rest's and the stick's, at full deflection."""
    backward: float = setting(
        default=0.045, unit="m/s", low=0.0, high=2.0,
        source="nothing looks back, and a contact below 0.05 m/s does no harm: docs, decisions",
    )  # fmt: skip
    """Largest speed backward that a stick asks for. The shield alone lets people back into what
    nothing has seen at 0.1 m/s; with a scanner that looks back, set the chair's limit."""
    margin: float = setting(
        default=0.03, unit="m", low=0.0, high=1.0, source="more shuts doors of 0.80 m: derived"
    )
    """Distance to obstacles that it keeps."""


@settings
class Sharing:
    """Settings of an assistant that shares control with a person."""

    freedom: Freedom = Freedom()


@dataclass(frozen=True)
class AssistMission:
    """Information for an assistant before a person drives: the chair, and nothing of the person."""

    chair: ChairSettings
    sensors: SensorSettings
    period: float  # s, of control

    @property
    def limits(self) -> Limits:
        """The chair's limits of speed and acceleration."""
        return self.chair.limits


@borrowing_kernel
def margin_of(p: Any, a: Any, forward: float, left: float) -> float:
    """The margin [m] that a row keeps, which a low and steady stick lowers.

    A person who drives up to a thing turns to it, too: only the deflection forward counts.
    """
    f, moved = p.freedom, abs(forward - a.held[0]) > STEADY
    if moved:
        a.held[0], a.held[1] = forward, left
    low = 0.0 < forward <= _DOCKING_STICK
    a.steady = a.steady + p.period if low and not moved else 0.0
    docks = a.steady >= _DOCKING_TIME
    return float(min(f.margin, DOCKING_MARGIN) if docks else f.margin)


@borrowing_kernel
def within_freedom(twist: Twist, asked: Twist, turn: float, maximum: float) -> Twist:
    """A twist, clipped to what may be made of the stick's [m/s, rad/s].

    Args:
        twist: that a method gives.
        asked: the stick's; at rest, the answer is rest.
        turn: how far the turn rate may lie beyond those between rest and the stick's.
        maximum: the chair's limit of turn rates.
    """
    (v, w), (to_v, to_w) = twist, asked
    if to_v == 0.0 and to_w == 0.0:
        return 0.0, 0.0
    v = min(max(v, min(0.0, to_v)), max(0.0, to_v))
    w = min(max(w, min(0.0, to_w) - turn), max(0.0, to_w) + turn)
    return v, min(maximum, max(-maximum, w))
