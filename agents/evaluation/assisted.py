"""Measures of an episode in which a person drives: agreement, intervention, movements and effort.

`docs/concepts/assisted_driving.md` defines each of them. Twists are compared in full speeds: the
speed by the limit forward, the turn rate by the limit of turn rates.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from wheelchair_gym.base.arrays import Array
from wheelchair_gym.geometry.kinematics import Limits
from wheelchair_gym.geometry.planar import wrap_angle
from wheelchair_gym.types import Stick

ACTIVE = 0.05  # full speeds: a smaller twist has no direction, a smaller change is none
CENTRE = 0.10  # deflection within which a stick is centred, for counting movements
DIRECTION = math.radians(30.0)  # a larger change of direction that is held is another movement
HELD = 0.1  # s
COASTING = 1.5  # s after the stick was let go in which the chair may still come to rest


def angles_between(twists: Array, others: Array) -> Array:
    """Return the angles (n,) [rad] between twists (n, 2), both in full speeds."""
    return np.abs(wrap_angle(np.arctan2(*others.T[::-1]) - np.arctan2(*twists.T[::-1])))


class StickTrace:
    """Deflections of the stick and twists after assistant and shield: one entry a step."""

    def __init__(self, limits: Limits, period: float) -> None:
        self._limits, self._period = limits, period
        self._full = np.array([limits.forward, limits.turn])
        self._sticks: list[Stick] = []
        self._given: list[Array] = []

    def add(self, stick: Stick, given: Array) -> None:
        """Add a step: the stick before it, and the twist (2,) after assistant and shield."""
        self._sticks.append(stick)
        self._given.append(given)

    def figures(self, twists: Array, length: float) -> dict[str, float]:
        """The measures; the chair's true twists (n + 1, 2) and the driven length [m] are known.

        What does not exist is infinite.
        """
        if not self._sticks:
            return {}
        sticks = np.array([stick[:2] for stick in self._sticks])
        asked = np.array([self._limits.twist_of(*stick[:2]) for stick in self._sticks]) / self._full
        given = np.array(self._given) / self._full
        size, off = np.hypot(*asked.T), np.hypot(*(given - asked).T)
        active = size > ACTIVE
        both = active & (np.hypot(*given.T) > ACTIVE)
        angles = angles_between(asked, given)
        driven = float(size.sum() + off.sum())
        travel = float(np.hypot(*np.diff(sticks, axis=0, prepend=np.zeros((1, 2))).T).sum())
        minutes = len(sticks) * self._period / 60.0
        return {
            "agreement_angle": float(angles[both].mean()) if both.any() else math.inf,
            "intervention_share": float((off > ACTIVE).mean()),
            "intervention_size": float(off[active].mean()) if active.any() else math.inf,
            "authority": float(off.sum()) / driven if driven > 0.0 else math.inf,
            "unwanted_motion": self._unwanted(np.asarray(twists)[1:] / self._full, size),
            "stick_movements": self._movements(sticks) / minutes,
            "stick_effort": float(np.hypot(*sticks.T).sum()) * self._period / max(length, 0.1),
            "stick_travel": travel / max(length, 0.1),
        }

    def _unwanted(self, twists: Array, size: Array) -> float:
        """Time [s] in motion while the stick is centred, not latched, and was let go before."""
        since, found = math.inf, 0.0
        for twist, deflection, stick in zip(twists, size, self._sticks, strict=False):
            since = 0.0 if deflection > 0.0 or stick.latched else since + self._period
            if COASTING < since < math.inf and math.hypot(*twist) > ACTIVE:
                found += self._period
        return found

    def _movements(self, sticks: Array) -> int:
        """Number of times that the stick left the centre, or changed its direction for good."""
        count, direction, held = 0, math.nan, 0.0
        for forward, left in sticks.tolist():
            if math.hypot(forward, left) <= CENTRE:
                direction, held = math.nan, 0.0
                continue
            now = math.atan2(left, forward)
            if math.isnan(direction):
                count, direction, held = count + 1, now, 0.0
            elif abs(math.remainder(now - direction, 2 * math.pi)) > DIRECTION:
                held += self._period
                if held >= HELD - 1e-9:
                    count, direction, held = count + 1, now, 0.0
            else:
                held = 0.0
        return count


MEASURES: Any = (
    "agreement_angle", "intervention_share", "intervention_size", "authority", "unwanted_motion",
    "stick_movements", "stick_effort", "stick_travel",
)  # fmt: skip
