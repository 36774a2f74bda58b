"""Monte Carlo localization: where a chair is on a known map, from its odometry and its laser.

Thrun, Burgard and Fox (2005), chapter 8: a likelihood field; the number of particles by the bins
that they fill (Fox 2001); random particles while scans fit worse than before, so that
a chair that was carried away recovers (augmented MCL). In the likelihood field the gap to the
nearest surface is positive outside of occupied cells and negative inside, so that between the
centres of cells it falls to 0 on the surface itself, not half a cell before it (section 6.4, on a
signed distance).

Every draw is by counter (`wheelchair_gym.compiled.random`): an estimate depends on its key and on
what the chair measured, on nothing else.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.base.arrays import Array
from wheelchair_gym.base.settings import InputError, setting, settings
from wheelchair_gym.compiled.kernel import as_int, borrowing_kernel, inlined
from wheelchair_gym.compiled.random import LOCALIZATION, bits, normal, uniform
from wheelchair_gym.geometry.kinematics import odometric_step
from wheelchair_gym.geometry.planar import world_to_body, wrap
from wheelchair_gym.maps import FREE, OccupancyGrid
from wheelchair_gym.maps.distance import bilinear, distance_to_occupied
from wheelchair_gym.sensors.settings import LaserSettings
from wheelchair_gym.types import Episode

OUTLIER_SHARE = 0.1  # of beams that hit what the map does not show: design choice


class LikelihoodField(NamedTuple):
    """Gaps to the surfaces of a map, where its cells lie, and the model of a beam."""

    gap: NDArray[np.float32]  # (rows, cols) m from each cell's centre, negative where solid
    origin: Array  # (3,) m, m, rad: lower left corner of cell (0, 0)
    resolution: float  # m
    sigma: float  # m: standard deviation of the gap at a beam's end


def make_likelihood_field(grid: OccupancyGrid, sigma: float) -> LikelihoodField:
    """The field of a map; gaps beyond ten standard deviations [m] are cut off."""
    maximum = 10.0 * sigma
    solid, cells = grid.solid(), maximum / grid.resolution + 1.0
    outside, inside = distance_to_occupied(solid, cells), distance_to_occupied(~solid, cells)
    gap = np.clip((outside - inside) * np.float32(grid.resolution), -maximum, maximum)
    origin = np.array(grid.origin)
    return LikelihoodField(gap.astype(np.float32), origin, grid.resolution, sigma)


@inlined
def _gap(field: LikelihoodField, u: float, v: float) -> float:
    """Gap at a place [cells from the centre of cell (0, 0)], between those of four cells."""
    col, row = int(u), int(v)
    return bilinear(field.gap, row, col, u - col, v - row)


@inlined
def _in_cells(
    field: LikelihoodField, x: float, y: float, yaw: float
) -> tuple[float, float, float, float]:
    """Return a pose's place (u, v) [cells], cosine and sine of its yaw times cells per metre."""
    origin, scale = field.origin, 1.0 / field.resolution
    c, s = math.cos(origin[2]), math.sin(origin[2])
    u, v = world_to_body(c, s, x - origin[0], y - origin[1])
    turn = yaw - origin[2]
    return u * scale - 0.5, v * scale - 0.5, math.cos(turn) * scale, math.sin(turn) * scale


@borrowing_kernel
def log_likelihood(field: LikelihoodField, x: float, y: float, yaw: float, ends: Array) -> float:
    """Mean logarithm of the likelihood of beams whose ends (n, 2) [m] are seen from a pose.

    The likelihood of a gap g is 1 / (1 + g^2 / 4 sigma^2)^2: a bell like exp(-g^2 / 2 sigma^2),
    with longer tails, which attract from farther away, and faster to compute.
    """
    rows, cols = field.gap.shape
    u0, v0, c, s = _in_cells(field, x, y, yaw)
    sharp, share = 0.25 / (field.sigma * field.sigma), 1.0 - OUTLIER_SHARE
    max_u, max_v = cols - 1.0, rows - 1.0
    total, product = 0.0, 1.0  # of sixteen is well within a double, and a logarithm is slow
    for k in range(ends.shape[0]):
        u, v = u0 + c * ends[k, 0] - s * ends[k, 1], v0 + s * ends[k, 0] + c * ends[k, 1]
        value = OUTLIER_SHARE
        if 0.0 <= u < max_u and 0.0 <= v < max_v:
            gap = _gap(field, u, v)
            near = 1.0 / (1.0 + sharp * gap * gap)
            value += share * near * near
        product *= value
        if k % 16 == 15:
            total, product = total + math.log(product), 1.0
    mean: float = (total + math.log(product)) / max(1, ends.shape[0])
    return mean


@borrowing_kernel
def find_informative_beams(
    field: LikelihoodField,
    x: float,
    y: float,
    yaw: float,
    mount: Array,
    ends: Array,
    informative: NDArray[np.bool_],
) -> None:
    """Return the beams informative about a pose: those that end at a surface or behind one.

    A beam that ends in the open may have hit a person (Fox, Burgard and Thrun 1999, section 4:
    filters for what a map does not show).
    """
    rows, cols = field.gap.shape
    u0, v0, c, s = _in_cells(field, x, y, yaw)
    max_u, max_v = cols - 1.0, rows - 1.0
    u1, v1 = u0 + c * mount[0] - s * mount[1], v0 + s * mount[0] + c * mount[1]
    for k in range(ends.shape[0]):
        u, v = u0 + c * ends[k, 0] - s * ends[k, 1], v0 + s * ends[k, 0] + c * ends[k, 1]
        inside = 0.0 <= u < max_u and 0.0 <= v < max_v
        informative[k] = inside and _gap(field, u, v) < 3.0 * field.sigma
        length, step = math.hypot(u - u1, v - v1), 0.0  # cells
        while step < length and not informative[k]:
            a, b = u1 + (u - u1) * step / length, v1 + (v - v1) * step / length
            gap = field.resolution
            if 0.0 <= a < max_u and 0.0 <= b < max_v:
                gap = _gap(field, a, b)
            informative[k] = gap < 0.0
            step += max(0.5, gap / field.resolution)


GLOBAL = 7  # channel of a localizer's key


@borrowing_kernel
def _draw_pose(
    field: LikelihoodField, free: NDArray[np.int64], key: np.uint64, step: int, k: int, pose: Array
) -> None:
    """A pose (3,) in one of the free cells (m,), with any heading."""
    cols = field.gap.shape[1]
    c, s = math.cos(field.origin[2]), math.sin(field.origin[2])
    cell = free[int(uniform(key, step, GLOBAL, 4 * k) * len(free))]
    u = (cell % cols + uniform(key, step, GLOBAL, 4 * k + 1)) * field.resolution
    v = (cell // cols + uniform(key, step, GLOBAL, 4 * k + 2)) * field.resolution
    pose[0], pose[1] = field.origin[0] + c * u - s * v, field.origin[1] + s * u + c * v
    pose[2] = (2.0 * uniform(key, step, GLOBAL, 4 * k + 3) - 1.0) * math.pi


@borrowing_kernel
def hill_climb(field: LikelihoodField, ends: Array, turn: float, pose: Array) -> float:
    """Move a pose (3,) to the best fit of a scan nearby; returns its mean log-likelihood.

    One coordinate after the other, in steps of two standard deviations or `turn` [rad] that are
    halved where none helps (pattern search, Hooke and Jeeves 1961).
    """
    best, move = log_likelihood(field, pose[0], pose[1], pose[2], ends), 2.0 * field.sigma
    for _ in range(40):
        better = False
        for k in range(3):
            for sign in (-1.0, 1.0):
                before = pose[k]
                pose[k] = before + sign * (turn if k == 2 else move)
                value = log_likelihood(field, pose[0], pose[1], pose[2], ends)
                if value > best:
                    best, better = value, True
                    break
                pose[k] = before
        if not better:
            move, turn = 0.5 * move, 0.5 * turn
            if move < 0.01:
                break
    pose[2] = wrap(pose[2])
    return best


@borrowing_kernel
def global_localization(
    field: LikelihoodField,
    free: NDArray[np.int64],
    ends: Array,
    few: Array,
    tries: int,
    turn: float,
    key: np.uint64,
    step: int,
    found: Array,
    fits: Array,
) -> None:
    """The best of many random poses for a scan, each refined by hill climbing.

    `few` of the beams, with a wider bell, choose the poses. `found` and `fits` have one row more
    than there are results, for the pose that is tried.
    """
    sigma = 3.0 * field.sigma
    wide = LikelihoodField(field.gap, field.origin, field.resolution, sigma)
    fits[:] = -np.inf
    for k in range(tries):
        pose = found[0]
        _draw_pose(field, free, key, step, k, pose)
        fits[0] = log_likelihood(wide, pose[0], pose[1], pose[2], few)
        j = 0  # rows rise by fit: the new one goes to its place, the worst becomes row 0
        while j + 1 < len(fits) and fits[j] > fits[j + 1]:
            fits[j], fits[j + 1] = fits[j + 1], fits[j]
            for i in range(3):
                found[j, i], found[j + 1, i] = found[j + 1, i], found[j, i]
            j += 1
    for k in range(1, len(fits)):
        if fits[k] > -np.inf:
            fits[k] = hill_climb(field, ends, turn, found[k])


MOVES, DRAWS, PLACES = range(3)  # channels of a localizer's key
# How odometry errs, standard deviations over a step: of the way, the turn, and a slide sideways.
_WAY_BY_WAY, _WAY_BY_TURN = 0.03, 0.01  # m/m, m/rad
_TURN_BY_WAY, _TURN_BY_TURN = 0.04, 0.05  # rad/m, rad/rad
_SLIP = 0.03  # m/m
_INITIAL_SIGMA = np.array([0.05, 0.05, math.radians(2.0)])  # m, m, rad: of a known start
_MAX_BEAMS = 60  # of a scan, evenly chosen: neighbouring beams carry the same information
_INDEPENDENT_BEAMS = 12.0  # for which a scan counts, as beams with independent errors
_MIN_BEAMS = 8  # that are informative, for a scan to be judged
_BIN, _BIN_ANGLE = 0.25, math.radians(10.0)  # m, rad: bins in which particles are counted
_ERROR = 0.05  # of the particles' distribution, kept with probability 0.99 (Fox 2001)
_UPDATE = (0.01, 0.01)  # m, rad: a standing chair gains no information
_FAST, _SLOW = 0.2, 0.005  # rates of two averages of the fit (Thrun et al. 2005, table 8.3)
_INITIAL_FIT = 0.9  # both averages at the beginning
_LOST, _RECOVERED = 0.7, 0.9  # ratios of the averages at which a chair is lost, and found again
_GLOBAL_SAMPLES = 2000  # random poses per scan that a lost chair tries,
_GLOBAL_CANDIDATES = 10  # the best of which are refined
_ESTIMATE_RADIUS = 1.0  # m about the best particle within which poses are averaged


class Particles(NamedTuple):
    """Buffers for the greatest number of particles, and for counting them."""

    poses: Array  # (max_particles, 3) m, m, rad
    logs: Array  # (max_particles,) logarithm of each one's weight
    weights: Array  # (max_particles,) their sum is 1
    bins: NDArray[np.int64]  # (2 ** k,) keys of bins by hash, 0 for none
    loads: Array  # (2 ** k,) weight in each bin


@borrowing_kernel
def predict(poses: Array, n: int, way: float, turn: float, key: np.uint64, step: int) -> None:
    """Move n particles by the odometry, each with its own random error (motion model)."""
    way_sigma = math.hypot(_WAY_BY_WAY * way, _WAY_BY_TURN * turn)
    turn_sigma = math.hypot(_TURN_BY_WAY * way, _TURN_BY_TURN * turn)
    for i in range(n):
        forward = way + way_sigma * normal(key, step, MOVES, 3 * i)
        turned = turn + turn_sigma * normal(key, step, MOVES, 3 * i + 1)
        aside = _SLIP * abs(way) * normal(key, step, MOVES, 3 * i + 2)
        x, y, yaw = odometric_step(poses[i, 0], poses[i, 1], poses[i, 2], forward, turned)
        poses[i, 0] = x - aside * math.sin(yaw)
        poses[i, 1] = y + aside * math.cos(yaw)
        poses[i, 2] = wrap(yaw)


@borrowing_kernel
def weigh(particles: Particles, n: int, field: LikelihoodField, ends: Array, beams: float) -> float:
    """Multiply weights by the scan's likelihood, which counts as that of `beams` beams.

    Returns the effective number of particles, 1 / sum w^2.
    """
    logs, weights = particles.logs, particles.weights
    maximum = -np.inf
    for i in range(n):
        pose = particles.poses[i]
        logs[i] += beams * log_likelihood(field, pose[0], pose[1], pose[2], ends)
        maximum = max(maximum, logs[i])
    total, squares = 0.0, 0.0
    for i in range(n):
        logs[i] -= maximum
        weights[i] = math.exp(logs[i])
        total += weights[i]
    for i in range(n):
        weights[i] /= total
        squares += weights[i] ** 2
    return 1.0 / squares


@borrowing_kernel
def count_bins(particles: Particles, n: int, side: float, sector: float) -> tuple[int, int]:
    """Count bins of place and heading with particles; find a particle of the heaviest bin."""
    bins, loads, poses = particles.bins, particles.loads, particles.poses
    bins[:] = 0
    loads[:] = 0.0
    mask, count, best, heaviest = len(bins) - 1, 0, 0, -1.0
    for i in range(n):
        row, col = math.floor(poses[i, 0] / side), math.floor(poses[i, 1] / side)
        turn = math.floor(poses[i, 2] / sector)
        key = as_int(((row * 65536 + col) * 512 + turn) * 2 + 1)  # odd: never 0
        place = as_int((key * 0x9E3779B97F4A7C1 >> 20) & mask)
        while bins[place] != 0 and bins[place] != key:
            place = (place + 1) & mask
        if bins[place] == 0:
            bins[place] = key
            count += 1
        loads[place] += particles.weights[i]
        if loads[place] > heaviest:
            heaviest, best = loads[place], i
    return count, best


@borrowing_kernel
def scatter(poses: Array, begin: int, pose: Array, sigma: Array, key: np.uint64, step: int) -> None:
    """Place particles about a pose (3,), with standard deviations [m, m, rad].

    The first has index `begin`, on which its random numbers depend.
    """
    for i in range(len(poses)):
        for k in range(3):
            poses[i, k] = pose[k] + sigma[k] * normal(key, step, PLACES, 3 * (begin + i) + k)


@borrowing_kernel
def cluster_mean(
    particles: Particles, n: int, about: int, reach: float, sector: float, out: Array
) -> None:
    """The mean pose (3,) of the particles within a reach [m] and sector [rad] of one of them."""
    poses = particles.poses
    x, y, yaw = poses[about, 0], poses[about, 1], poses[about, 2]
    for _ in range(2):
        total, dx, dy, turn = 0.0, 0.0, 0.0, 0.0
        for i in range(n):
            off_x, off_y, off = poses[i, 0] - x, poses[i, 1] - y, wrap(poses[i, 2] - yaw)
            if off_x * off_x + off_y * off_y <= reach * reach and abs(off) <= sector:
                w = particles.weights[i]
                total, dx, dy, turn = total + w, dx + w * off_x, dy + w * off_y, turn + w * off
        if total > 0.0:
            x, y, yaw = x + dx / total, y + dy / total, yaw + turn / total
    out[0], out[1], out[2] = x, y, wrap(yaw)


_QUANTILE = 2.326  # of the normal distribution: the number of particles suffices in 99 of 100


@settings
class LocalizationSettings:
    """Settings of Monte Carlo localisation."""

    sigma: float = setting(
        default=0.06, unit="m", low=0.001, source="the laser's noise and a map of 5 cm cells"
    )
    """Standard deviation of the gap between a beam's end and the surface."""
    min_particles: int = setting(default=300, low=10, high=16_000)
    """Minimum number of particles."""
    max_particles: int = setting(default=5000, low=10, high=16_000)
    """Maximum number of particles."""

    def __post_init__(self) -> None:
        if self.max_particles < self.min_particles:
            raise InputError(
                f"max_particles is {self.max_particles}; expected {self.min_particles} or more"
            )


class MonteCarloLocalizer:
    """Estimates the pose of a chair on a map.

    Attributes:
        pose: the estimate (3,) [m, m, rad].
        count: number of particles at present.
        fit: likelihood of an informative beam at the estimate, 0 to 1.
        lost: scans fit worse than they used to, and not well again since; particles are placed
            anywhere.
        map: the map.
    """

    built_map = None

    def __init__(self, settings: LocalizationSettings, laser: LaserSettings) -> None:
        self.settings, s = settings, settings
        self.pose = np.zeros(3)
        self.count, self.fit, self.lost = 0, 0.0, False
        n, bins = s.max_particles, 2 ** math.ceil(math.log2(4 * s.max_particles))
        self._particles = Particles(
            np.zeros((n, 3)), np.zeros(n), np.zeros(n), np.zeros(bins, np.int64), np.zeros(bins)
        )
        self._mount = np.array([laser.x, laser.y])
        self._directions = laser.directions  # (beams, 2)
        self._reach = laser.reach
        self.map: OccupancyGrid | None = None

    @property
    def poses(self) -> Array:
        """The particles' poses (count, 3) [m, m, rad]."""
        return np.array(self._particles.poses[: self.count])

    def begin(self, episode: Episode, key: int) -> None:
        """Start on an episode's map, near the episode's start."""
        self.start(episode.map, episode.start, key)

    def start(self, map_: OccupancyGrid, pose: Array | None, key: int) -> Array:
        """Start on a map near a pose (3,), or anywhere for None; returns the pose.

        Raises:
            ValueError: nothing on the map is free.
        """
        s = self.settings
        if map_ is not self.map:
            self._field = make_likelihood_field(map_, s.sigma)
            self._free = np.flatnonzero(map_.cells.ravel() == FREE)
            self.map = map_
        if len(self._free) == 0:
            raise ValueError("the map has no free cell")
        self._key = np.uint64(bits(np.uint64(key % 2**64), 0, LOCALIZATION, 0))
        self._step = 0
        self._slow, self.fit = _INITIAL_FIT, 0.0
        self.lost = pose is None
        self._fast = 0.0 if self.lost else _INITIAL_FIT
        self._driven = np.array([np.inf, np.inf])  # so that the first scan counts
        if pose is None:  # any place: the first scan shows that it is wrong
            cell = self._free[len(self._free) // 2]
            pose = np.array([*map_.to_world(divmod(int(cell), map_.shape[1])), 0.0])
        self.count, self.pose = s.min_particles, np.array(pose, dtype=np.float64)
        self._scatter(0, self.count, self.pose)
        self._reset_weights()
        return self.pose

    def _scatter(self, begin: int, end: int, pose: Array) -> None:
        poses = self._particles.poses[begin:end]
        scatter(poses, begin, pose, _INITIAL_SIGMA, self._key, self._step)

    def _reset_weights(self) -> None:
        self._particles.logs[: self.count] = 0.0
        self._particles.weights[: self.count] = 1.0 / self.count

    def update(self, increment: Array, ranges: NDArray[np.float32]) -> Array:
        """The pose after an increment of odometry and a scan.

        Args:
            increment: (3,) [m, m, rad] odometry since the last update, in the chair's frame then.
            ranges: (beams,) [m] as in `Reading.laser`.

        Returns:
            The pose (3,) [m, m, rad].

        Raises:
            InputError: an increment that is not three finite numbers, or a scan of another length.
        """
        if increment.shape != (3,) or not np.isfinite(increment).all():
            raise InputError(f"increment is {increment!r}; expected three finite numbers")
        if ranges.shape != (beams := len(self._directions),):
            raise InputError(f"a scan has shape {ranges.shape}; expected ({beams},)")
        particles = self._particles
        x, y, turn = increment.tolist()
        way = x * math.cos(0.5 * turn) + y * math.sin(0.5 * turn)
        self._step += 1
        predict(particles.poses, self.count, way, turn, self._key, self._step)
        self._driven += abs(way), abs(turn)
        moved = (self._driven >= _UPDATE).any()
        ends = self._ends(ranges)
        if len(ends) and (moved or self.lost):
            self._driven[:] = 0.0
            self._weigh(ends)
        _, about = count_bins(particles, self.count, _BIN, _BIN_ANGLE)
        self.pose = np.empty(3)
        cluster_mean(particles, self.count, about, _ESTIMATE_RADIUS, 3.0 * _BIN_ANGLE, self.pose)
        if len(ends):
            self._judge(ends)
        return self.pose

    def _weigh(self, ends: Array) -> None:
        """Weigh particles by a scan; resample them when few are effective, or the chair is lost."""
        s, particles = self.settings, self._particles
        effective = weigh(particles, self.count, self._field, ends, _INDEPENDENT_BEAMS)
        if effective >= 0.5 * self.count and not self.lost:
            return
        bins, _ = count_bins(particles, self.count, _BIN, _BIN_ANGLE)
        count = min(s.max_particles, max(s.min_particles, _enough(bins)))
        # Systematic: one random number for all.
        shares = (uniform(self._key, self._step, DRAWS, 0) + np.arange(count)) / count
        chosen = np.searchsorted(np.cumsum(particles.weights[: self.count]), shares)
        particles.poses[:count] = particles.poses[chosen.clip(max=self.count - 1)]
        self.count = count
        if self.lost:
            self.count = min(s.max_particles, count + s.min_particles)
            self._place_anywhere(ends, count)
        self._reset_weights()

    def _place_anywhere(self, ends: Array, kept: int) -> None:
        """Give the particles after the first ones to places anywhere that the scan fits."""
        few = np.ascontiguousarray(ends[:: max(1, len(ends) // 20)])
        found, fits = np.empty((_GLOBAL_CANDIDATES + 1, 3)), np.empty(_GLOBAL_CANDIDATES + 1)
        turn, draw = _BIN_ANGLE / 2.0, (self._key, self._step)
        global_localization(
            self._field, self._free, ends, few, _GLOBAL_SAMPLES, turn, *draw, found, fits
        )
        shares = np.linspace(kept, self.count, _GLOBAL_CANDIDATES + 1).astype(int)
        for begin, end, pose in zip(shares[:-1], shares[1:], found[1:], strict=True):
            self._scatter(begin, end, pose)

    def _judge(self, ends: Array) -> None:
        """Update the fit of scans at the estimated pose, and whether the chair is lost.

        Beams that people may have blocked are left out: a crowd is no sign of being lost.
        """
        x, y, yaw = self.pose
        informative = np.empty(len(ends), dtype=np.bool_)
        find_informative_beams(self._field, x, y, yaw, self._mount, ends, informative)
        ends = ends[informative]
        if len(ends) < _MIN_BEAMS:
            return
        self.fit = math.exp(log_likelihood(self._field, x, y, yaw, ends))
        self._slow += _SLOW * (self.fit - self._slow)
        self._fast += _FAST * (self.fit - self._fast)
        self.lost = self._fast < (_RECOVERED if self.lost else _LOST) * self._slow

    def _ends(self, ranges: NDArray[np.float32]) -> Array:
        """Ends (k, 2) [m] in the chair's frame of beams with an echo, evenly chosen."""
        valid = np.flatnonzero((ranges > 0.0) & (ranges < self._reach))  # neither NaN nor infinite
        evenly = np.linspace(0, len(valid) - 1, min(len(valid), _MAX_BEAMS))
        chosen = valid[evenly.astype(int)]
        ends: Array = self._mount + ranges[chosen, None] * self._directions[chosen]
        return ends


def _enough(bins: int) -> int:
    """Number of particles that fills bins as it should (Fox 2001, eq. 7)."""
    if bins < 2:
        return 0
    k = bins - 1
    part = 2.0 / (9.0 * k)
    return math.ceil(k / (2.0 * _ERROR) * (1.0 - part + math.sqrt(part) * _QUANTILE) ** 3)
