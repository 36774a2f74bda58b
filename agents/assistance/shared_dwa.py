"""Shared dynamic window: of the twists that can be ended in time, the one nearest to the stick's.

The objective is that of the public shared dynamic window of a powered wheelchair
(scwheelchair-simulation): J = 1 - c + c (0.7 heading difference + 0.3 relative speed difference),
with the clearance c in [0, 1]. Its second part, which follows a path to a goal, is left out: an
assistant here knows no goal.
"""

from __future__ import annotations

import math

import numpy as np

from agents.assistance.assistant import (
    AssistInput,
    AssistMission,
    Freedom,
    Plain,
    SharedAssistant,
    Twist,
)
from agents.assistance.fan import CLEAR, STEP, STEPS, fan
from wheelchair_gym.config import setting, settings


@settings
class SharedDwa:
    """Weighs clearance against nearness to the stick's heading and speed."""

    heading: float = setting(default=0.7, low=0.0, high=10.0, source="scwheelchair-simulation")
    """Weight of the difference of headings at the arcs' ends, as a share of a half turn."""
    speed: float = setting(default=0.3, low=0.0, high=10.0, source="scwheelchair-simulation")
    """Weight of the difference of speeds, as a share of the stick's."""
    enough: float = setting(
        default=0.10, unit="m", low=0.01, high=CLEAR, source="doors leave 0.09 m: design choice"
    )
    """Clearance that counts as full."""
    freedom: Freedom = Freedom()

    def make(self) -> SharedAssistant:
        """A fresh assistant."""
        return SharedAssistant(Plain(self._twist), self.freedom)

    def _twist(self, mission: AssistMission, now: AssistInput) -> Twist:
        twists = fan(mission, now)
        if not len(twists):
            return 0.0, 0.0
        v, w = now.asked
        clear = np.minimum(1.0, twists[:, 2] / self.enough)
        headings = np.abs(twists[:, 1] - w) * STEP * STEPS / math.pi
        speeds = np.abs(twists[:, 0] - v) / max(abs(v), 1e-6)
        costs = 1.0 - clear + clear * (self.heading * headings + self.speed * speeds)
        best = twists[int(np.argmin(np.round(costs, 12)))]
        return float(best[0]), float(best[1])
