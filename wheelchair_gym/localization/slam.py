"""Grid SLAM: Rao-Blackwellised particles, each with a pose and a map (Grisetti et al. 2007).

Each particle matches the scan with its own map; a Gaussian about the match, weighed by the
odometry's motion model, is its proposal, and how well that explains the scan is its weight. Where
the paper draws random samples to fit the Gaussian, the six nodes of a cubature rule serve
(Arasaratnam and Haykin 2009): nothing varies, and a Gaussian posterior is fitted exactly. One
particle is plain scan matching.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wheelchair_gym.compiled.kernel import borrowing_kernel, kernel
from wheelchair_gym.config import InputError, setting, settings
from wheelchair_gym.geometry import compose, wrap
from wheelchair_gym.localization.occupancy import (
    Bytes,
    LogOdds,
    MappingSettings,
    OccupancyMap,
    add_scan,
)
from wheelchair_gym.localization.scan import Scan, read_scan, scan_radius
from wheelchair_gym.localization.scan_matching import (
    MatchSettings,
    Six,
    backward,
    cholesky,
    misfit,
    quadratic,
    refine,
    search,
    thin_scan,
)
from wheelchair_gym.maps import UNKNOWN, OccupancyGrid
from wheelchair_gym.random import SLAM, normal, uniform
from wheelchair_gym.sensors.settings import LaserSettings
from wheelchair_gym.types import Episode

Array = NDArray[np.float64]
Floats = NDArray[np.float32]
Index = NDArray[np.uint32]
Marks = NDArray[np.int32]
Mask = NDArray[np.bool_]

_NODE = math.sqrt(3.0)  # nodes of the third-degree cubature in three dimensions, in deviations


class Moved(NamedTuple):
    """What the wheels say since the last scan used, and how they err [cells, rad]."""

    x: float
    y: float
    yaw: float
    along: float  # variance
    turn: float  # variance


class Matcher(NamedTuple):
    """What `MatchSettings` say, in cells."""

    spread: float
    iterations: int
    window: int
    turns: int
    step: float
    doubt: float


@borrowing_kernel
def _propose(
    field: Floats, points: Array, prior: Array, told: Six, spread: float, best: Array,
    information: Six, cost: float, key: np.uint64, step: int, particle: int, draw: bool,
) -> float:  # fmt: skip
    """Fit a Gaussian to the posterior about its mode, and draw the pose from it.

    `best` becomes the pose: drawn, or the mean. The result is the logarithm of the weight
    (Grisetti et al. 2007, equations 16 to 20).
    """
    c = cholesky(information)
    x, y, yaw = best[0], best[1], best[2]
    total = 0.0
    m0, m1, m2, xx, yy, tt = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(6):
        side = _NODE if k % 2 == 0 else -_NODE
        u, v, w = side * (k // 2 == 0), side * (k // 2 == 1), side * (k // 2 == 2)
        dx, dy, dt = backward(c, u, v, w)
        px, py, pt = x + dx, y + dy, yaw + dt
        here = 0.5 * misfit(field, points, px, py, pt) / (spread * spread)
        here += 0.5 * quadratic(told, px - prior[0], py - prior[1], pt - prior[2])
        share = math.exp(cost - here + 0.5 * _NODE * _NODE) / 6.0
        total += share
        m0 += share * u
        m1 += share * v
        m2 += share * w
        xx += share * u * u
        yy += share * v * v
        tt += share * w * w
    m0, m1, m2 = m0 / total, m1 / total, m2 / total
    if draw:
        g = cholesky((
            xx / total - m0 * m0 + 1e-9, -m0 * m1, -m0 * m2,
            yy / total - m1 * m1 + 1e-9, -m1 * m2, tt / total - m2 * m2 + 1e-9,
        ))  # fmt: skip
        a = normal(key, step, SLAM, 3 * particle)
        b = normal(key, step, SLAM, 3 * particle + 1)
        d = normal(key, step, SLAM, 3 * particle + 2)
        m0 += g[0] * a
        m1 += g[1] * a + g[2] * b
        m2 += g[3] * a + g[4] * b + g[5] * d
    dx, dy, dt = backward(c, m0, m1, m2)
    best[0], best[1], best[2] = x + dx, y + dy, wrap(yaw + dt)
    return math.log(total) - cost - math.log(c[0] * c[2] * c[5])


@kernel
def update_particles(
    odds: Floats, field: Floats, mean: Floats, tally: Bytes, struck: Marks, wide: Floats,
    path: Index, mark: int, poses: Array, weights: Array, moved: Moved, points: Array,
    ends: Array, hits: Mask, how: Matcher, law: LogOdds, smear: Floats, key: np.uint64, step: int,
    learn: bool,
) -> None:  # fmt: skip
    """Move, match, weigh and map every particle."""
    prior, best, other = np.empty(3), np.empty(3), np.empty(3)
    count = len(poses)
    for i in range(count):
        yaw = poses[i, 2]
        c, s = math.cos(yaw), math.sin(yaw)
        prior[0] = poses[i, 0] + c * moved.x - s * moved.y
        prior[1] = poses[i, 1] + s * moved.x + c * moved.y
        prior[2] = yaw + moved.yaw
        told = (1.0 / moved.along, 0.0, 0.0, 1.0 / moved.along, 0.0, 1.0 / moved.turn)
        if len(points) == 0:
            poses[i] = prior
        else:
            cost, found = refine(
                field[i], points, prior, prior, told, how.spread, how.iterations, best
            )
            apart = misfit(field[i], points, best[0], best[1], best[2])
            if apart > how.doubt * len(points):
                search(field[i], points, prior, told, how.spread, how.window, how.turns, how.step,
                       wide, other)  # fmt: skip
                else_, also = refine(
                    field[i], points, other, prior, told, how.spread, how.iterations, other
                )
                if else_ < cost:
                    cost, found = else_, also
                    best[:] = other
            weights[i] += _propose(field[i], points, prior, told, how.spread, best, found, cost,
                                   key, step, i, count > 1)  # fmt: skip
            poses[i] = best
        if learn:
            add_scan(odds[i], field[i], mean[i], tally[i], struck, mark + i, ends, hits, poses[i],
                     law, smear, path)  # fmt: skip


_LUCK = 60_000  # index of the draw that resampling takes; those below are the particles'


@settings
class SlamSettings:
    """Number of particles, update rule and odometry noise of SLAM."""

    particles: int = setting(
        default=8,
        low=1,
        high=10000,
        source="measured: gmapping's 30 are no better in 24 floor plans",
    )
    """Number of particles; 1 is plain scan matching."""
    update_distance: float = setting(
        default=0.4,
        unit="m",
        low=0.0,
        high=10.0,
        source="measured: half as far drifts a quarter more, twice as far localizes worse",
    )
    """Distance driven before the next scan is used."""
    update_angle: float = setting(default=0.5, unit="rad", low=0.0, high=7.0, source="gmapping")
    """Angle turned before the next scan is used."""
    resample_threshold: float = setting(
        default=0.5, low=0.0, high=1.0, source="Grisetti et al. 2007"
    )
    """Share of effective particles below which particles are resampled."""
    likelihood_smoothing: float = setting(
        default=3.0, low=0.01, high=1000.0, source="gmapping's ogain"
    )
    """Root of the likelihood taken per particle, since beams have correlated errors."""
    translation_error: float = setting(
        default=0.05, low=0.0, high=1.0, source="gmapping's srr is 0.1 for worse wheels"
    )
    """Standard deviation of translation per translation."""
    rotation_error: float = setting(default=0.05, low=0.0, high=1.0, source="gmapping's stt is 0.2")
    """Standard deviation of rotation per rotation."""
    rotation_per_translation: float = setting(
        default=0.05, unit="rad/m", low=0.0, high=10.0, source="gmapping's srt is 0.1"
    )
    """Standard deviation of rotation per translation."""
    translation_floor: float = setting(
        default=0.010,
        unit="m",
        low=1e-4,
        high=1.0,
        source="an encoder's quanta and the motion during a scan",
    )
    """Standard deviation of translation without motion."""
    rotation_floor: float = setting(
        default=0.010,
        unit="rad",
        low=1e-4,
        high=1.0,
        source="an encoder's quanta at 0.5 m of track",
    )
    """Standard deviation of rotation without motion."""
    mapping: MappingSettings = MappingSettings()
    matching: MatchSettings = MatchSettings()


class Slam:
    """Maps an unknown place and knows where the chair is in it.

    The same seed and the same scans give the same run, bit for bit.

    Args:
        laser: where it sits and what it sees.
        settings: particles, mapping, matching, odometry.
        seed: of the draws.
        pose: where it begins (3,) [m, m, rad].
    """

    def __init__(
        self,
        laser: LaserSettings,
        settings: SlamSettings | None = None,
        seed: int = 0,
        pose: ArrayLike = (0.0, 0.0, 0.0),
    ) -> None:
        self.laser, self.settings = laser, settings or SlamSettings()
        self._start(np.asarray(pose, dtype=np.float64), seed)

    def begin(self, episode: Episode, key: int) -> None:
        """Forget all, and begin where an episode does: its map is not looked at."""
        self._start(episode.start, key)

    def _start(self, pose: Array, seed: int) -> None:
        count = self.settings.particles
        self.maps = OccupancyMap(self.settings.mapping, count)
        self._drawn: tuple[int, OccupancyGrid] | None = None  # scans in it, and it
        self._key = np.uint64(seed % 2**64)
        self._poses = np.tile(pose, (count, 1))
        self._weights = np.zeros(count)  # logarithms, since the last resampling
        self._worth = np.zeros(count)  # since the beginning, along each particle's own past
        self._moved = np.zeros(3)  # since the last scan used
        self._ways = np.zeros(2)  # m, rad: driven and turned since then
        self._poses_then: list[Array] = []  # after each scan used, and ...
        self._parents: list[NDArray[np.int64]] = []  # ... whose copies those particles were
        self._steps: list[tuple[int, Array]] = []  # scans used so far, and the way since
        self.resampled = 0  # times

    def update(
        self,
        increment: ArrayLike,
        ranges: ArrayLike | None,
        learn: bool = True,
    ) -> Array:
        """Move on and look.

        Args:
            increment: (3,) [m, m, rad] what the odometry says was driven since the last update, in
                the chair's frame then.
            ranges: (beams,) [m] as in `Reading.laser`; None: nothing seen.
            learn: false: match the scan, but keep it out of the maps, to test them with.

        Returns:
            The pose (3,) [m, m, rad].

        Raises:
            InputError: an increment that is not three finite numbers, or a scan of another length.
        """
        way = np.asarray(increment, dtype=np.float64)
        if way.shape != (3,) or not np.isfinite(way).all():
            raise InputError(f"increment is {increment!r}; expected three finite numbers")
        own = self.settings
        if ranges is not None and np.shape(ranges) != (self.laser.beams,):
            raise InputError(f"a scan has shape {np.shape(ranges)}; expected ({self.laser.beams},)")
        self._moved = compose(self._moved, way)
        self._ways += math.hypot(way[0], way[1]), abs(way[2])
        due = (
            self._ways[0] >= own.update_distance
            or self._ways[1] >= own.update_angle
            or not self._poses_then
        )
        if ranges is not None and (due or not learn):
            scan = read_scan(self.laser, ranges, own.mapping.free_range)
            if len(scan.ends):
                self._look(scan, learn)
        self._steps.append((len(self._poses_then), self._moved))
        return self.pose

    def _look(self, scan: Scan, learn: bool) -> None:
        """Match a scan, weigh the particles, and perhaps add it to their maps."""
        own, maps = self.settings, self.maps
        expected = compose(self._poses, self._moved)
        unit = own.mapping.resolution
        # The search's blocks reach beyond the window.
        maps.grow_to(expected, scan_radius(scan) + 2.0 * own.matching.search_window + 5.0 * unit)
        points = thin_scan(scan, own.matching.point_spacing, own.matching.max_points) / unit
        points = points if self._poses_then else points[:0]  # the first finds no map
        way, turn = self._ways
        along = own.translation_floor + own.translation_error * way
        round_ = own.rotation_floor + own.rotation_error * turn + own.rotation_per_translation * way
        x, y, yaw = self._moved
        moved = Moved(x / unit, y / unit, yaw, (along / unit) ** 2, round_**2)
        matching = own.matching
        how = Matcher(
            matching.residual_sigma, matching.iterations, round(matching.search_window / unit),
            round(matching.search_angle / matching.angle_step), matching.angle_step,
            matching.search_threshold,
        )  # fmt: skip
        poses, gained = maps.lattice(self._poses), np.zeros(len(self._poses))
        update_particles(
            maps.odds, maps.field, maps.mean, maps.tally, maps.last_hit, maps.pooled, maps.path,
            maps.next_marks(len(poses)), poses, gained, moved, points, maps.points(scan),
            scan.hits, how, maps.log_odds, maps.weights, self._key, len(self._poses_then), learn,
        )  # fmt: skip
        self._poses = maps.world(poses)
        self._weights += gained / (own.likelihood_smoothing * len(gained))
        self._worth += gained
        self._moved, self._ways = np.zeros(3), np.zeros(2)
        self._poses_then.append(self._poses)
        self._parents.append(self._resample())

    def _resample(self) -> NDArray[np.int64]:
        """Resample systematically if too few particles are effective; returns the parents."""
        count = len(self._weights)
        share = np.exp(self._weights - self._weights.max())
        share /= share.sum()
        own = np.arange(count)
        if count == 1 or 1.0 / (share**2).sum() >= self.settings.resample_threshold * count:
            return own
        start = uniform(self._key, len(self._poses_then), SLAM, _LUCK)
        drawn = np.searchsorted(np.cumsum(share), (start + own) / count).clip(0, count - 1)
        # Those drawn stay where they are, and their copies take the places of the others.
        times = np.bincount(drawn, minlength=count)
        parents = own.copy()
        parents[times == 0] = np.repeat(own, np.maximum(times - 1, 0))
        self.maps.copy_layers(parents)
        self._poses, self._worth = self._poses[parents], self._worth[parents]
        self._weights = np.zeros(count)
        self.resampled += 1
        return parents

    @property
    def best(self) -> int:
        """The index of the particle with the greatest likelihood over its whole history."""
        return int(np.argmax(self._worth))

    @property
    def pose(self) -> Array:
        """Where the best particle is (3,) [m, m, rad]."""
        return compose(self._poses[self.best], self._moved)

    @property
    def poses(self) -> Array:
        """Where the particles are (particles, 3) [m, m, rad]."""
        return compose(self._poses, self._moved)

    @property
    def map(self) -> OccupancyGrid:
        """The best particle's map; a single unknown cell before anything was seen."""
        if self.maps.odds.size == 0:
            return OccupancyGrid(
                np.full((1, 1), UNKNOWN, np.int8), self.settings.mapping.resolution
            )
        seen = len(self._poses_then)
        if self._drawn is None or self._drawn[0] != seen:
            self._drawn = seen, self.maps.to_grid(self.best)
        return self._drawn[1]

    @property
    def built_map(self) -> Callable[[], OccupancyGrid]:
        """Gives the map as it is when asked."""
        return self._map_now

    def _map_now(self) -> OccupancyGrid:
        return self.map

    @property
    def trajectory(self) -> Array:
        """Poses (updates, 3) [m, m, rad] of the best particle, smoothed by its latest history."""
        line = np.empty((len(self._poses_then) + 1, 3))
        particle = self.best
        for k in range(len(self._poses_then) - 1, -1, -1):
            particle = self._parents[k][particle]
            line[k + 1] = self._poses_then[k][particle]
        return np.stack([compose(line[scans], moved) for scans, moved in self._steps])
