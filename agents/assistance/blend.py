"""Policy blending: the stick and the robot's twist towards the likely goal, mixed by confidence.

Source: Dragan and Srinivasa 2013: u = (1 - a) u_h + a u_r(g*), where the share a grows with the
confidence in the likeliest goal g*. Two safe twists may blend into an unsafe one: the shield
filters afterwards.
"""

from __future__ import annotations

import numpy as np

from agents.assistance.assistant import AssistInput, Freedom, SharedAssistant, Twist
from agents.assistance.fan import cheapest, fan, nearest
from agents.assistance.targets import Belief, Goals
from wheelchair_gym.config import InputError, setting, settings


@settings
class Blend:
    """Mixes the stick with a safe twist towards the likeliest goal."""

    timid: float = setting(default=0.3, low=0.0, high=1.0, source="design choice")
    """Belief up to which the stick alone counts."""
    sure: float = setting(default=0.8, low=0.0, high=1.0, source="design choice")
    """Belief from which on the robot's share is largest."""
    most: float = setting(default=0.6, low=0.0, high=1.0, source="Dragan 2013: timid to aggressive")
    """Largest share of the robot."""
    belief: Belief = Belief()
    freedom: Freedom = Freedom()

    def __post_init__(self) -> None:
        if self.sure <= self.timid:
            raise InputError("Blend.sure must lie above Blend.timid")

    def make(self) -> SharedAssistant:
        """A fresh assistant."""
        return SharedAssistant(_Method(self), self.freedom)


class _Method(Goals):
    def twist(self, now: AssistInput) -> Twist:
        config = self.config
        twists = fan(self._mission, now)
        costs = self.update(now, twists)
        if now.asked[0] < 0.0:  # whoever backs is manoeuvring, not driving to a goal
            return nearest(twists, now.asked, self._mission)
        likely = int(np.argmax(self.belief))
        ramp = (float(self.belief[likely]) - config.timid) / (config.sure - config.timid)
        share = config.most * min(1.0, max(0.0, ramp))
        if share == 0.0 or not len(twists):
            return now.asked
        best = twists[cheapest(costs[:, likely])]
        v, w = (1.0 - share) * np.array(now.asked) + share * best[:2]
        return float(v), float(w)
