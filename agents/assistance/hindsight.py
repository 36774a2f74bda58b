"""Hindsight optimisation: the twist that is best on average over all goals that are believed in.

Source: Javdani et al. 2015, 2018: the action of least expected cost, sum over goals g of
b(g) Q_g(x, a, u), as if the goal were known from the next step on; Q_g is the cost to go after the
twist and a price for leaving the stick. So it helps before any goal is certain.
"""

from __future__ import annotations

import numpy as np

from agents.assistance.assistant import AssistInput, Freedom, SharedAssistant, Twist
from agents.assistance.fan import cheapest, fan, nearest, scaled_distance
from agents.assistance.targets import Belief, Goals
from wheelchair_gym.config import setting, settings


@settings
class Hindsight:
    """Minimises the expected cost to go over the goals, and the distance from the stick."""

    stick: float = setting(default=4.0, unit="s", low=0.0, high=100.0, source="design choice")
    """Seconds that a twist off the stick's by full speed costs."""
    clearance: float = setting(default=0.3, unit="s", low=0.0, high=100.0, source="design choice")
    """Seconds that a twist costs on whose way the chair touches something."""
    enough: float = setting(default=0.10, unit="m", low=0.01, high=0.5, source="design choice")
    """Clearance that costs nothing; less in proportion to the margin while somebody docks."""
    belief: Belief = Belief()
    freedom: Freedom = Freedom()

    def make(self) -> SharedAssistant:
        """A fresh assistant."""
        return SharedAssistant(_Method(self), self.freedom)


class _Method(Goals):
    def twist(self, now: AssistInput) -> Twist:
        config = self.config
        twists = fan(self._mission, now)
        costs = self.update(now, twists)
        # Whoever backs is manoeuvring, not driving to a goal.
        if now.asked[0] < 0.0 or not len(twists):
            return nearest(twists, now.asked, self._mission)
        expected = costs @ self.belief
        expected += config.stick * scaled_distance(twists, now.asked, self._mission)
        enough = config.enough * min(1.0, now.margin / max(config.freedom.margin, 1e-6))
        expected += config.clearance * np.maximum(0.0, 1.0 - twists[:, 2] / max(enough, 1e-6))
        best = twists[cheapest(expected)]
        return float(best[0]), float(best[1])
