"""Collaborative control: help only who is about to miss the likely target (Carlson, Demiris 2012).

Local targets carry a confidence that each reading updates. While the stick leads to the likeliest
one, it is the twist. When it is predicted to miss that target, or to collide, a safe twist towards
the target is taken instead.
"""

from __future__ import annotations

import numpy as np

from agents.assistance.assistant import AssistInput, Freedom, SharedAssistant, Twist
from agents.assistance.fan import cheapest, fan, free_share, scaled_distance
from agents.assistance.targets import Belief, Goals
from wheelchair_gym.config import setting, settings


@settings
class Hypotheses:
    """Takes over towards the likely target when the stick is predicted to miss it."""

    confidence: float = setting(default=0.4, low=0.0, high=1.0, source="design choice")
    """Belief in a target from which on it helps."""
    miss: float = setting(default=0.4, unit="s", low=0.0, high=10.0, source="design choice")
    """Seconds that the stick may cost more than the best twist before it counts as missing."""
    look_ahead: float = setting(default=1.5, unit="s", low=0.1, high=5.0, source="design choice")
    """Time for which a collision is predicted."""
    belief: Belief = Belief()
    freedom: Freedom = Freedom()

    def make(self) -> SharedAssistant:
        """A fresh assistant."""
        return SharedAssistant(_Method(self), self.freedom)


class _Method(Goals):
    def twist(self, now: AssistInput) -> Twist:
        config, mission = self.config, self._mission
        twists = fan(mission, now)
        costs = self.update(now, twists)
        hits = free_share(mission, now, now.asked, config.look_ahead) < 1.0
        if not len(twists):
            return 0.0, 0.0
        likely = int(np.argmax(self.belief))
        off = scaled_distance(twists, now.asked, mission)
        best = cheapest(costs[:, likely] + 0.1 * off)
        same = cheapest(off)  # the stick's, or the nearest that is safe
        misses = costs[same, likely] - costs[best, likely] > config.miss
        sure = float(self.belief[likely]) >= config.confidence
        if not (hits or (misses and sure)):
            return now.asked
        chosen = twists[best if sure else same]
        return float(chosen[0]), float(chosen[1])
