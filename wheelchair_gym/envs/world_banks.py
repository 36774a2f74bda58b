"""Sources of the worlds of episodes: each its own, or one of a bank that slowly turns over.

A bank is a window of `size` worlds that moves on with the episodes an environment has driven: world
j is a pure function of the bank's seed and j; episode k of seed s draws from the window that begins
at k x turnover, by a hash of s and k. So what is driven depends neither on time, nor on threads,
nor on other environments. A world is made when first drawn; a folder may keep it for later runs.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np

from wheelchair_gym.base.files import atomic_write
from wheelchair_gym.base.settings import InputError, dump
from wheelchair_gym.compiled.random import WORLDS, Split, bits, episode_key, world_seed
from wheelchair_gym.envs.settings import EnvSettings
from wheelchair_gym.scenes import make_scene
from wheelchair_gym.scenes.poses import check_passable, check_start
from wheelchair_gym.task.prepared_episode import PreparedEpisode
from wheelchair_gym.task.task import Task

_BANK = 0x62616E6B  # apart from the worlds of single seeds
_MIN_TIME = 1.0  # s: minimum plan time from the start to the goal, where starts are drawn
_SLACK = 1 / 32  # share of a bank that is kept beyond its size, for rows that fall behind


class WorldBank:
    """Prepared episodes by seed and number.

    Args:
        settings: scene and bank.
        task: makes episodes ready to be driven.
        split: the stream that worlds are drawn from.

    Raises:
        InputError: the scene is unknown, or what a folder is to keep has no name.
    """

    def __init__(self, settings: EnvSettings, task: Task, split: Split) -> None:
        self._split: Split = split
        self._scene, self._task, self._bank = make_scene(settings.scene), task, settings.bank
        if settings.starts_within > 0.0 and not task.has_poses:
            raise InputError("starts_within needs the guidance 'poses', which knows the time")
        self.max_time = settings.starts_within  # s; a curriculum may set it
        self._made: dict[int, PreparedEpisode] = {}  # of the bank, by number; last drawn last
        self._lowest = 0
        self._folder: Path | None = None
        if settings.bank.cache is not None:
            self._folder = Path(settings.bank.cache) / _identity(settings, split)

    def __len__(self) -> int:
        return len(self._made)

    def episode(self, seed: int, episode: int, key: int | None = None) -> PreparedEpisode:
        """The prepared episode of a seed and a number, at its start; its key, where it is known."""
        key = episode_key(seed, episode, self._split) if key is None else key
        if self._bank.size > 0:
            draw = int(bits(np.uint64(key), 0, WORLDS, 0))  # a world of its window
            number = self._begin(episode) + draw % self._bank.size
            self._made[number] = prepared = self._made.pop(number, None) or self._of_bank(number)
        else:
            prepared = self._make((seed, episode))
        if self.max_time > 0.0 and prepared.cost_to_go is not None:
            start = prepared.cost_to_go.sample(key, _MIN_TIME, self.max_time)
            if start is not None:
                return prepared.starting_at(start)
        return prepared

    def missing(self) -> list[int]:
        """The first episodes' worlds that neither this bank holds nor its folder keeps."""
        numbers = (n for n in range(self._bank.size) if n not in self._made)
        return [n for n in numbers if self._folder is None or not self._path(n).exists()]

    def keep(self, numbers: Iterable[int]) -> None:
        """Make worlds for the folder, if it does not keep them."""
        for number in numbers:
            if self._folder is not None and not self._path(number).exists():
                self._of_bank(number)

    def fill(self, report: Callable[[int, int], None] | None = None) -> None:
        """Make every world that the first episodes draw from, and report how many are ready."""
        # In no order: runs side by side that keep worlds in one folder then share the work.
        for ready, number in enumerate(np.random.default_rng().permutation(self._bank.size)):
            if number not in self._made:
                self._made[int(number)] = self._of_bank(int(number))
            if report is not None:
                report(ready + 1, self._bank.size)

    def drop_before(self, episode: int) -> None:
        """Drop worlds that no episode from this one on can draw, and limit the number of others.

        Rows that fall behind still draw old worlds, so the number of worlds between the slowest
        and the fastest row would grow without end. Beyond the bank's size and `_SLACK` of it, the
        least recently drawn worlds are dropped; they are made again when they are drawn again.
        """
        begin = self._begin(episode)
        for number in range(self._lowest, begin):
            self._made.pop(number, None)
        self._lowest = begin
        while len(self._made) > self._bank.size + math.ceil(_SLACK * self._bank.size):
            del self._made[next(iter(self._made))]

    def _begin(self, episode: int) -> int:
        return math.floor(episode * self._bank.turnover)

    def _path(self, number: int) -> Path:
        return (self._folder or Path()) / f"{number}.joblib"

    def _of_bank(self, number: int) -> PreparedEpisode:
        path = self._path(number)
        if self._folder is None:
            return self._make((_BANK, self._bank.seed, number))
        import joblib  # only here, since it is slow to import

        if path.exists():
            try:
                return self._task.make_prepared(*joblib.load(path))
            except Exception:  # whatever pickles make of damaged bytes: the world is made again
                path.unlink(missing_ok=True)
        prepared = self._make((_BANK, self._bank.seed, number))
        with atomic_write(path) as part:
            guide = prepared.path if prepared.cost_to_go is None else prepared.cost_to_go
            joblib.dump((prepared.episode, prepared.geodesic, guide), part, compress=1)
        return prepared

    def _make(self, entropy: tuple[int, ...]) -> PreparedEpisode:
        rng = np.random.default_rng(world_seed(self._split, *entropy))
        footprint = self._task.footprint
        episode = self._scene.sample(rng, footprint)
        check_start(episode, footprint)
        prepared = self._task.prepare(episode)
        if np.isfinite(prepared.geodesic.at(episode.start[:2])):
            return prepared
        return self._task.prepare(episode, check_passable(episode, footprint))


# Settings of the task that leave worlds as they are: what is observed there, and rewarded.
_SEEN = (
    "beams", "look_ahead", "look_ahead_time", "last_action", "shield_state", "side_clearance",
    "trail", "tracks", "hide_guidance", "privileged", "reward",
)  # fmt: skip


def _identity(settings: EnvSettings, split: Split) -> str:
    """A name for all that a bank's worlds depend on, this code included."""
    task = dump(settings.task)
    named = {
        "scene": dump(settings.scene),
        "guidance": dump(settings.guidance),
        "split": split,
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
