"""Minimum vector field histogram: the free direction nearest to the stick's (Levine et al. 1999).

The density of obstacles in each direction plus a parabola around the stick's direction is a curve
whose minimum is the direction that the chair takes; how wide the parabola is says how freely the
chair may choose. The speed follows from the room in that direction.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from agents.assistance.assistant import (
    AssistInput,
    AssistMission,
    Freedom,
    Plain,
    SharedAssistant,
    Twist,
)
from agents.assistance.fan import free_share
from wheelchair_gym.compiled.kernel import borrowing_kernel
from wheelchair_gym.config import setting, settings

Array = NDArray[np.float64]

DIRECTIONS = 72  # of the histogram


@borrowing_kernel
def _direction(
    points: Array, outline: Array, wanted: float, reach: float, widen: float, parabola: float
) -> float:
    """The direction [rad] of the least of density and parabola, within a right angle of ahead."""
    best, least = wanted, math.inf
    half = outline[2] + widen
    for k in range(DIRECTIONS + 1):
        direction = wanted if k == DIRECTIONS else math.pi * ((k + 0.5) / DIRECTIONS - 0.5)
        c, s = math.cos(direction), math.sin(direction)
        density = 0.0
        for j in range(points.shape[0]):
            # A point stands in the way of the strip that the chair's width sweeps from its axle.
            along = c * points[j, 0] + s * points[j, 1]
            aside = abs(c * points[j, 1] - s * points[j, 0])
            room = along - outline[0]
            if along > 0.0 and aside < half and room < reach:
                share = 1.0 - max(0.0, room) / reach
                density = max(density, share * share)
        off = direction - wanted
        cost = density + parabola * off * off
        if cost < least - 1e-12:
            best, least = direction, cost
    return best


@settings
class Vfh:
    """Turns towards the free direction nearest to the stick's, and slows with the room there."""

    reach: float = setting(default=1.5, unit="m", low=0.1, high=10.0, source="design choice")
    """Distance within which obstacles count."""
    widen: float = setting(default=0.05, unit="m", low=0.0, high=1.0, source="design choice")
    """Added to each side of the chair's width."""
    parabola: float = setting(
        default=1.0,
        unit="1/rad2",
        low=0.0,
        high=1000.0,
        source="Levine 1999: its width; value assumed",
    )
    """Weight of the squared angle from the stick's direction: less gives the chair more freedom."""
    turn_per_angle: float = setting(
        default=1.0, unit="1/s", low=0.0, high=10.0, source="design choice"
    )
    """Turn rate for each radian between the stick's direction and the one taken."""
    look_ahead: float = setting(default=1.2, unit="s", low=0.1, high=10.0, source="design choice")
    """Time to a collision from which on it slows."""
    freedom: Freedom = Freedom()

    def make(self) -> SharedAssistant:
        """A fresh assistant."""
        return SharedAssistant(Plain(self._twist), self.freedom)

    def _twist(self, mission: AssistMission, now: AssistInput) -> Twist:
        (v, w), limits = now.asked, mission.limits
        outline = mission.chair.footprint.array
        if v > 0.0:
            wanted = math.atan2(w / limits.turn, v / limits.forward)
            taken = _direction(now.points, outline, wanted, self.reach, self.widen, self.parabola)
            change = self.turn_per_angle * (taken - wanted)
            w += min(now.turn, max(-now.turn, change))
        share = free_share(mission, now, (v, w), self.look_ahead)
        return share * v, share * w
