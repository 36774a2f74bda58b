"""Assisted teleop, after nav2's behaviour: the twist shrinks with the time to a collision.

Source: nav2_behaviors, AssistedTeleop (main, August 2026): the twist is projected in steps; a
collision at the first of them gives rest, one at time t scales all components by t over the whole
time, so that the arc is kept. It never steers.
"""

from __future__ import annotations

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
from wheelchair_gym.config import setting, settings

Array = NDArray[np.float64]


@settings
class Teleop:
    """Scales the stick's twist by the time to a collision; keeps its arc."""

    projection_time: float = setting(
        default=1.0, unit="s", low=0.1, high=10.0, source="nav2 AssistedTeleop"
    )
    """Time over which the twist is projected."""
    step: float = setting(default=0.1, unit="s", low=0.01, high=1.0, source="nav2 AssistedTeleop")
    """Time between two poses of the projection."""
    freedom: Freedom = Freedom(turn=0.0)

    def make(self) -> SharedAssistant:
        """A fresh assistant."""
        return SharedAssistant(Plain(self._twist), self.freedom)

    def _twist(self, mission: AssistMission, now: AssistInput) -> Twist:
        share = free_share(mission, now, now.asked, self.projection_time, self.step)
        return share * now.asked[0], share * now.asked[1]
