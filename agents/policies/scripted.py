"""Policies without planning or learning: random and straight."""

from __future__ import annotations

import math

import numpy as np

from wheelchair_gym.base.settings import setting, settings
from wheelchair_gym.types import Command, Mission, Reading


def episode_rng(mission: Mission, seed: int) -> np.random.Generator:
    """Random draws of an episode: the same for the same episode and seed."""
    return np.random.default_rng([seed, mission.key])


HOLD = 0.5  # s for which each random action is held; inertia averages out shorter ones


@settings
class RandomPolicy:
    """Twists drawn evenly, each held for a while."""

    seed: int = setting(default=0, low=0)
    """Seed of the actions, with the episode's key."""

    def make(self) -> RandomDriver:
        """A fresh policy."""
        return RandomDriver(self)


class RandomDriver:
    """Holds one random action after another."""

    def __init__(self, config: RandomPolicy) -> None:
        self.config = config

    def reset(self, mission: Mission) -> None:
        """See `Policy.reset`."""
        self._limits, self._rng = mission.limits, episode_rng(mission, self.config.seed)
        self._held = max(1, round(HOLD / mission.period))
        self._count = 0

    def act(self, reading: Reading) -> Command:
        """See `Policy.act`."""
        if self._count % self._held == 0:
            self._command = Command.from_action(self._rng.uniform(-1.0, 1.0, 2), self._limits)
        self._count += 1
        return self._command


_GAIN = 1.5  # 1/s: turn rate per heading error
_PIVOT = 0.5  # rad: heading error above which the chair turns in place


@settings
class StraightPolicy:
    """Turns to the goal and drives there, whatever stands between."""

    def make(self) -> StraightDriver:
        """A fresh policy."""
        return StraightDriver()


class StraightDriver:
    """Steers for the goal."""

    def reset(self, mission: Mission) -> None:
        """See `Policy.reset`."""
        self._goal, self._limits = mission.goal, mission.limits

    def act(self, reading: Reading) -> Command:
        """See `Policy.act`."""
        (x, y, yaw), goal = reading.pose, self._goal
        error = math.remainder(math.atan2(goal[1] - y, goal[0] - x) - yaw, 2 * math.pi)
        v = self._limits.forward * max(0.0, 1.0 - abs(error) / _PIVOT)
        return Command(np.array([v, _GAIN * error]))
