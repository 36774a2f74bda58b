"""Where episodes get their worlds: each its own, or one of a bank that slowly turns over.

A bank is a window of `size` worlds that moves on with the episodes an environment has driven: world
j is a pure function of the bank's seed and j; episode k of seed s draws from the window that begins
at k x turnover, by a hash of s and k. So what is driven depends neither on time, nor on threads,
nor on other environments. A world is made when first drawn; a folder may keep it for later runs.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Callable
from pathlib import Path

import numpy as np

from wheelchair_gym.config import InputError, dump
from wheelchair_gym.envs.settings import EnvSettings
from wheelchair_gym.files import whole
from wheelchair_gym.random import WORLDS, bits, episode_key
from wheelchair_gym.scenes import make_scene
from wheelchair_gym.scenes.poses import check_passable, check_start
from wheelchair_gym.task.prepared_episode import Course
from wheelchair_gym.task.task import Task
from wheelchair_gym.types import Episode

_BANK = 0x62616E6B  # apart from the worlds of single seeds, on which policies are tested


class Worlds:
    """Courses by seed and episode.

    Args:
        settings: scene and bank.
        task: makes episodes ready to be driven.

    Raises:
        InputError: the scene is unknown, or what a folder shall keep has no name.
    """

    def __init__(self, settings: EnvSettings, task: Task) -> None:
        self._scene, self._task, self._bank = make_scene(settings.scene), task, settings.bank
        if settings.starts.within > 0.0 and not task.posed:
            raise InputError("starts.within needs the guidance 'poses', which knows the time")
        self.within = settings.starts.within  # s; a curriculum may set it
        self._least = settings.starts.least
        self._made: dict[int, Course] = {}  # of the bank, by number
        self._lowest = 0
        self._folder: Path | None = None
        if settings.bank.cache is not None:
            self._folder = Path(settings.bank.cache) / _identity(settings)

    def __len__(self) -> int:
        return len(self._made)

    def course(self, seed: int, episode: int) -> Course:
        """The course of an episode of a seed, from where that is to begin."""
        course = self._course(seed, episode)
        if self.within > 0.0 and course.ways is not None:
            start = course.ways.sample(episode_key(seed, episode), self._least, self.within)
            if start is not None:
                return course.begun_at(start)
        return course

    def _course(self, seed: int, episode: int) -> Course:
        if self._bank.size == 0:
            return self._make((seed, episode))
        number = self._begin(episode) + self.pick(seed, episode)
        course = self._made.get(number)
        if course is None:
            course = self._made[number] = self._of_bank(number)
        return course

    def fill(self, told: Callable[[int, int], None] | None = None) -> None:
        """Make every world that the first episodes draw from, and tell how many are ready."""
        # In no order: runs side by side that keep worlds in one folder then share the work.
        for ready, number in enumerate(np.random.default_rng().permutation(self._bank.size)):
            if number not in self._made:
                self._made[int(number)] = self._of_bank(int(number))
            if told is not None:
                told(ready + 1, self._bank.size)

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

    def _of_bank(self, number: int) -> Course:
        path = None if self._folder is None else self._folder / f"{number}.joblib"
        if path is None:
            return self._make((_BANK, self._bank.seed, number))
        import joblib  # only here, since it is slow to import

        if path.exists():
            try:
                return self._task.lay_out(*joblib.load(path))
            except Exception:  # whatever pickles make of damaged bytes: the world is made again
                path.unlink(missing_ok=True)
        course = self._make((_BANK, self._bank.seed, number))
        with whole(path) as part:
            guide = course.path if course.ways is None else course.ways
            joblib.dump((course.episode, course.geodesic, guide), part, compress=1)
        return course

    def _make(self, entropy: tuple[int, ...]) -> Course:
        rng, footprint = np.random.default_rng(entropy), self._task.footprint
        episode = self._scene.sample(rng, footprint)
        check_start(episode, footprint)
        course = self._task.prepare(episode)
        if np.isfinite(course.geodesic.at(episode.start[:2])):
            return course
        return self._task.prepare(episode, check_passable(episode, footprint))


# Settings of the task that leave worlds as they are: what is observed there, and rewarded.
_SEEN = (
    "beams", "look_ahead", "look_ahead_time", "last_action", "shield_state", "gaps",
    "trail", "unguided", "privileged", "reward",
)  # fmt: skip


def _identity(settings: EnvSettings) -> str:
    """A name for all that a bank's worlds depend on, this code included."""
    task = dump(settings.task)
    named = {
        "scene": dump(settings.scene),
        "guidance": dump(settings.guidance),
        "seed": settings.bank.seed,
        "task": {key: value for key, value in task.items() if key not in _SEEN},
        "footprint": dump(settings.chair.footprint),
        "limits": dump(settings.chair.limits),
    }
    try:
        text = json.dumps(named, sort_keys=True)
    except TypeError:
        raise InputError("bank.cache needs a scene and a guidance that are given by name") from None
    digest = hashlib.sha256(text.encode())
    for path in sorted(Path(__file__).resolve().parents[1].rglob("*.py")):
        digest.update(path.read_bytes())
    return digest.hexdigest()[:16]
