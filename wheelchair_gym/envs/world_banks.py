"""Sources of the worlds of episodes: each its own, or one of a bank that slowly turns over.

A bank is a window of `size` worlds that moves on with the episodes an environment has driven: world
j is a pure function of the bank's seed and j; episode k of seed s draws from the window that begins
at k x turnover, by a hash of s and k. So what is driven depends neither on time, nor on threads,
nor on other environments. A world is made when first drawn; a folder may keep it for later runs.
"""

import hashlib
import json
import math
from collections.abc import Callable, Iterable, Mapping
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.base.arrays import Array
from wheelchair_gym.base.errors import shorten
from wheelchair_gym.base.files import atomic_write, file_digest, sources
from wheelchair_gym.base.registry import places_in, source_of
from wheelchair_gym.base.settings import InputError, dump
from wheelchair_gym.compiled.random import WORLDS, Split, bits, episode_key, uniform, world_seed
from wheelchair_gym.envs.settings import EnvSettings
from wheelchair_gym.maps import geodesic, map_files
from wheelchair_gym.scenes import make_scene
from wheelchair_gym.scenes.arena import check_passable, check_start
from wheelchair_gym.task.prepared_episode import PreparedEpisode
from wheelchair_gym.task.task import Task
from wheelchair_gym.types import Episode

NO_LEVEL = -1  # number of an episode's world that is of no bank
_BANK = 0x62616E6B  # apart from the worlds of single seeds
_MIN_TIME = 1.0  # s: minimum plan time from the start to the goal, where starts are drawn
_SLACK = 1 / 32  # share of a bank that is kept beyond its size, for rows that fall behind


class WorldBank:
    """Prepared episodes by seed and number.

    The number of a bank's world is its level: `info["level"]` tells it, and `set_next` of vector
    environments chooses it, or how often each is drawn.

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
        self.limit = settings.bank.size  # of worlds that are drawn; fewer while others are made
        self._made: dict[int, PreparedEpisode] = {}  # of the bank, by number; last drawn last
        self._lowest = 0
        self._folder: Path | None = None
        if settings.bank.cache is not None:
            self._folder = Path(settings.bank.cache) / _identity(settings, split)

    def __len__(self) -> int:
        return len(self._made)

    @cached_property
    def scenes(self) -> NDArray[np.int64]:
        """The number (size,) of the mixture's scene that each of the first worlds is of; or 0."""
        which = getattr(self._scene, "which", lambda _: 0)
        return np.array([which(self._rng(self._entropy(j))) for j in range(self._bank.size)])

    def draw(self, seed: int, episode: int, weights: Array | None = None) -> int:
        """Number of the bank's world that an episode of a seed is in; NO_LEVEL without a bank.

        `weights` tell how often each world is drawn, by `cumulative`; None: all alike.
        """
        if self._bank.size == 0:
            return NO_LEVEL
        key = np.uint64(episode_key(seed, episode, self._split))
        place = int(bits(key, 0, WORLDS, 0)) % self.limit
        if weights is not None:
            total = weights[-1]
            drawn = min(uniform(key, 0, WORLDS, 0) * total, np.nextafter(total, 0.0))
            place = int(np.searchsorted(weights, drawn, "right"))
        return self._begin(episode) + place

    def cumulative(self, weights: Any) -> Array:
        """The cumulative sum (size,) of how often each world is drawn.

        Raises:
            InputError: the weights are not one of 0 or more for each world, or all are 0; or the
                bank has a turnover, with which worlds change.
        """
        given, bank = np.asarray(weights), self._bank
        if given.dtype.kind in "fiu" and given.shape == (bank.size,) and bank.turnover == 0.0:
            sums = np.cumsum(given, dtype=np.float64)
            if (given >= 0.0).all() and 0.0 < sums[-1] < math.inf:
                return sums
        expected = f"expected one of 0 or more for each of {bank.size} worlds, not all 0"
        raise InputError(f"weights is {shorten(weights)}; {expected}; and bank.turnover 0")

    def episode(
        self, seed: int, episode: int, level: int | None = None, max_time: float = math.nan
    ) -> PreparedEpisode:
        """The prepared episode of a seed and a number, at its start.

        `level` is the number of the bank's world (None: the one that is drawn), `max_time` the
        largest plan time from the start to the goal [s] (NaN: the attribute).
        """
        level = self.draw(seed, episode) if level is None else level
        if level == NO_LEVEL:
            prepared = self._make((seed, episode))
        else:
            kept = self._made.pop(level, None)
            self._made[level] = prepared = kept or self._of_bank(level)
        within = self.max_time if math.isnan(max_time) else max_time
        if within > 0.0 and prepared.cost_to_go is not None:
            key = episode_key(seed, episode, self._split)
            start = prepared.cost_to_go.sample(key, _MIN_TIME, within)
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
        """Make every world that the next episodes draw from, and report how many are ready."""
        # In no order: runs side by side that keep worlds in one folder then share the work.
        for ready, number in enumerate(np.random.default_rng().permutation(self.limit)):
            if number not in self._made:
                self._made[int(number)] = self._of_bank(int(number))
            if report is not None:
                report(ready + 1, self.limit)

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
            return self._make(self._entropy(number))
        import joblib  # only here, since it is slow to import

        if path.exists():
            try:
                return self._task.make_prepared(*joblib.load(path))
            except Exception:  # whatever pickles make of damaged bytes: the world is made again
                path.unlink(missing_ok=True)
        prepared = self._make(self._entropy(number))
        with atomic_write(path) as part:
            guide = prepared.path if prepared.cost_to_go is None else prepared.cost_to_go
            joblib.dump((prepared.episode, prepared.geodesic, guide), part, compress=1)
        return prepared

    def _entropy(self, number: int) -> tuple[int, ...]:
        return _BANK, self._bank.seed, number

    def _rng(self, entropy: tuple[int, ...]) -> np.random.Generator:
        return np.random.default_rng(world_seed(self._split, *entropy))

    def _make(self, entropy: tuple[int, ...]) -> PreparedEpisode:
        episode = self._scene.sample(self._rng(entropy), self._task.footprint)
        check_start(episode, self._task.footprint)
        return prepare_world(self._task, episode, must_pass=True)


def prepare_world(task: Task, episode: Episode, *, must_pass: bool = False) -> PreparedEpisode:
    """Prepare a world, for routes of the widest radius that passes where the task's does not.

    Raises:
        InputError: the chair does not pass from start to goal, and must.
    """
    radius = task.route_radius
    if not np.isfinite(geodesic(episode.map, episode.goal[:2], radius).at(episode.start[:2])):
        try:
            radius = check_passable(episode, task.footprint)
        except InputError:
            if must_pass:
                raise
    return task.prepare(episode, radius)


# Settings of the task that leave worlds as they are: what is observed there, and rewarded.
_SEEN = (
    "beams", "look_ahead", "look_ahead_time", "last_action", "shield_state", "side_clearance",
    "trail", "tracks", "hide_guidance", "privileged", "reward",
)  # fmt: skip


def _identity(settings: EnvSettings, split: Split) -> str:
    """A name for all that a bank's worlds depend on, the package's code and data included."""
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
        for of in (settings.scene, settings.guidance):
            name = of.get("name", of.get("call")) if isinstance(of, Mapping) else of
            if not isinstance(name, str | None):  # settings, which do not tell their class
                raise TypeError
        named["files"] = [file_digest(file, "image") for file in map_files(named)]
        code = sorted({source_of(place) or "" for place in places_in(named)} - {""})
        named["code"] = list(map(file_digest, code))
        text = json.dumps(named, sort_keys=True)
    except TypeError:
        raise InputError("bank.cache needs a scene and a guidance that are given by name") from None
    digest = hashlib.sha256(text.encode())
    for path in sources(Path(__file__).resolve().parents[1]):
        digest.update(path.read_bytes())
    return digest.hexdigest()[:16]
