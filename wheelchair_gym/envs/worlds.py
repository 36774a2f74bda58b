"""Where episodes get their worlds: each its own, or one of a bank that slowly turns over.

A bank is a window of `size` worlds that moves on with the episodes an environment has driven: world
j is a pure function of the bank's seed and j; episode k of seed s draws from the window that begins
at k x turnover, by a hash of s and k. So what is driven depends neither on time, nor on threads,
nor on other environments. A world is made when it is first drawn.
"""

from __future__ import annotations

import math

import numpy as np

from wheelchair_gym.config import setting, settings
from wheelchair_gym.scenes import Scene
from wheelchair_gym.sensing.noise import WORLDS, bits, episode_key
from wheelchair_gym.task.course import Course
from wheelchair_gym.task.task import Task
from wheelchair_gym.types import Episode

_BANK = 0x62616E6B  # apart from the worlds of single seeds, on which policies are tested


@settings
class BankSettings:
    """A bank of worlds; off by default."""

    size: int = setting(
        default=0, source="worlds an episode draws from; 0: each its own", low=0, high=10_000_000
    )
    turnover: float = setting(
        default=0.1, source="worlds exchanged per episode of an environment", low=0.0, high=1000.0
    )
    seed: int = setting(default=0, source="of the worlds", low=0)


class Worlds:
    """Courses by seed and episode.

    Args:
        scene: draws episodes.
        task: makes them ready to be driven.
        bank: how they are shared.
    """

    def __init__(self, scene: Scene, task: Task, bank: BankSettings) -> None:
        self._scene, self._task, self._bank = scene, task, bank
        self._made: dict[int, Course] = {}  # of the bank, by number
        self._lowest = 0

    def __len__(self) -> int:
        return len(self._made)

    def course(self, seed: int, episode: int) -> Course:
        """The course of an episode of a seed."""
        if self._bank.size == 0:
            return self._make((seed, episode))
        number = self._begin(episode) + self.pick(seed, episode)
        course = self._made.get(number)
        if course is None:
            course = self._made[number] = self._make((_BANK, self._bank.seed, number))
        return course

    def pick(self, seed: int, episode: int) -> int:
        """Which world of its window an episode of a seed draws."""
        key = np.uint64(episode_key(seed, episode))
        return int(bits(key, 0, WORLDS, 0) % np.uint64(self._bank.size))

    def forget(self, episode: int) -> None:
        """Let go of worlds that no episode from this one on can draw."""
        begin = self._begin(episode)
        for number in range(self._lowest, begin):
            self._made.pop(number, None)
        self._lowest = begin

    def prepare(self, episode: Episode) -> Course:
        """The course of a given episode."""
        return self._task.prepare(episode)

    def _begin(self, episode: int) -> int:
        return math.floor(episode * self._bank.turnover)

    def _make(self, entropy: tuple[int, ...]) -> Course:
        return self._task.prepare(self._scene.sample(np.random.default_rng(entropy)))
