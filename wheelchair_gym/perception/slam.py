"""Grid SLAM: Rao-Blackwellised particles, each with a pose and a map (Grisetti et al. 2007).

Each particle matches the scan with its own map; a Gaussian about the match, weighed by the
odometry's motion model, is its proposal, and how well that explains the scan is its weight. Where
the paper draws random samples to fit the Gaussian, the six nodes of a cubature rule serve
(Arasaratnam and Haykin 2009): they are always the same, and fit a Gaussian posterior exactly. One
particle is plain scan matching.

A scan is matched on a map's field: first by a correlative search of a window of poses, whose blocks
are ranked by what they could score at most (Olson 2009, Real-time correlative scan matching): the
best pose of its lattice, never a local one. Then by Gauss-Newton on the interpolated field
(Kohlbrecher et al. 2011, equations 5 to 14). Both use one measurement model: a point where the
field is M costs (1 - M)^2 / (2 spread^2); and both accept a Gaussian prior about the guess. Kernels
work in cells; a symmetric matrix is its six numbers xx, xy, xt, yy, yt, tt.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wheelchair_gym.base.arrays import Array, Floats, Mask
from wheelchair_gym.base.settings import InputError, setting, settings
from wheelchair_gym.compiled.kernel import borrowing_kernel, inlined, kernel
from wheelchair_gym.compiled.random import SLAM, normal, uniform
from wheelchair_gym.geometry.planar import compose, wrap
from wheelchair_gym.maps import UNKNOWN, OccupancyGrid
from wheelchair_gym.perception.occupancy import (
    Layers,
    MappingSettings,
    OccupancyMap,
    Scan,
    SensorModel,
    Workspace,
    add_scan,
    read_scan,
)
from wheelchair_gym.sensors.settings import LaserSettings
from wheelchair_gym.types import Episode

Six = tuple[float, float, float, float, float, float]

SEARCH_WINDOW = 0.20  # m searched on each side of the guess
_SEARCH_ANGLE, _ANGLE_STEP = 0.12, 0.015  # rad on each side, and its steps: a cell at 3.3 m
POINT_SPACING = 0.03  # m between points across the beams: nearer ones carry the same information
MAX_POINTS = 300  # evenly thinned
_RESIDUAL_SIGMA = 0.25  # of 1 - M at one point: wide, as neighbours have correlated errors
_SEARCH_THRESHOLD = 0.5  # mean (1 - M)^2 above which a match by descent is followed by a search
_ITERATIONS = 10  # of Gauss-Newton at most
_RIDGE = 1e-6  # 1/cells2, 1/rad2: keeps the matrix regular where points say nothing
_STILL = 1e-4  # cells, rad: a step of Gauss-Newton that is shorter ends it
_STRIDE = 2.0  # cells: the longest step of Gauss-Newton; the field reaches no farther
_TURN = 0.1  # rad: its largest turn


class Matcher(NamedTuple):
    """Settings, in cells, of the matching of scans to maps."""

    spread: float
    iterations: int
    window: int
    turns: int
    step: float  # rad
    threshold: float


@borrowing_kernel
def misfit(field: Floats, points: Array, x: float, y: float, yaw: float) -> float:
    """Sum of (1 - M)^2 over points (n, 2) [cells] seen from a pose; off the map M is 0."""
    rows, cols = field.shape
    c, s = math.cos(yaw), math.sin(yaw)
    total = 0.0
    for k in range(len(points)):
        u = x + c * points[k, 0] - s * points[k, 1] - 0.5
        v = y + s * points[k, 0] + c * points[k, 1] - 0.5
        gap = 1.0
        if 0.0 <= u < cols - 1 and 0.0 <= v < rows - 1:
            i, j = int(v), int(u)
            a, b = u - j, v - i
            low = (1.0 - a) * field[i, j] + a * field[i, j + 1]
            high = (1.0 - a) * field[i + 1, j] + a * field[i + 1, j + 1]
            gap = 1.0 - (1.0 - b) * low - b * high
        total += gap * gap
    return total


@borrowing_kernel
def _slope(
    field: Floats, points: Array, x: float, y: float, yaw: float
) -> tuple[float, float, float, float, Six]:
    """The misfit, minus half its gradient, and its Gauss-Newton matrix (Kohlbrecher: 12, 13)."""
    rows, cols = field.shape
    c, s = math.cos(yaw), math.sin(yaw)
    total, bx, by, bt = 0.0, 0.0, 0.0, 0.0
    xx, xy, xt, yy, yt, tt = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(len(points)):
        rx, ry = c * points[k, 0] - s * points[k, 1], s * points[k, 0] + c * points[k, 1]
        u, v = x + rx - 0.5, y + ry - 0.5
        if not (0.0 <= u < cols - 1 and 0.0 <= v < rows - 1):
            total += 1.0
            continue
        i, j = int(v), int(u)
        a, b = u - j, v - i
        f00, f01, f10, f11 = field[i, j], field[i, j + 1], field[i + 1, j], field[i + 1, j + 1]
        gx = (1.0 - b) * (f01 - f00) + b * (f11 - f10)
        gy = (1.0 - a) * (f10 - f00) + a * (f11 - f01)
        gap = 1.0 - (1.0 - b) * ((1.0 - a) * f00 + a * f01) - b * ((1.0 - a) * f10 + a * f11)
        gt = gy * rx - gx * ry
        total += gap * gap
        bx += gx * gap
        by += gy * gap
        bt += gt * gap
        xx += gx * gx
        xy += gx * gy
        xt += gx * gt
        yy += gy * gy
        yt += gy * gt
        tt += gt * gt
    return total, bx, by, bt, (xx, xy, xt, yy, yt, tt)


@inlined
def quadratic(m: Six, x: float, y: float, t: float) -> float:
    """The form of a symmetric matrix at a vector."""
    return (
        m[0] * x * x + m[3] * y * y + m[5] * t * t
        + 2.0 * (m[1] * x * y + m[2] * x * t + m[4] * y * t)
    )  # fmt: skip


@borrowing_kernel
def cholesky(m: Six) -> Six:
    """The lower triangle C of m = C C^T, row by row: c00, c10, c11, c20, c21, c22."""
    c00 = math.sqrt(max(m[0], 1e-300))
    c10, c20 = m[1] / c00, m[2] / c00
    c11 = math.sqrt(max(m[3] - c10 * c10, 1e-300))
    c21 = (m[4] - c20 * c10) / c11
    c22 = math.sqrt(max(m[5] - c20 * c20 - c21 * c21, 1e-300))
    return c00, c10, c11, c20, c21, c22


@borrowing_kernel
def forward(c: Six, x: float, y: float, t: float) -> tuple[float, float, float]:
    """Solve C z = (x, y, t)."""
    z0 = x / c[0]
    z1 = (y - c[1] * z0) / c[2]
    return z0, z1, (t - c[3] * z0 - c[4] * z1) / c[5]


@borrowing_kernel
def backward(c: Six, x: float, y: float, t: float) -> tuple[float, float, float]:
    """Solve C^T z = (x, y, t)."""
    z2 = t / c[5]
    z1 = (y - c[4] * z2) / c[2]
    return (x - c[1] * z1 - c[3] * z2) / c[0], z1, z2


@borrowing_kernel
def refine(
    field: Floats, points: Array, guess: Array, prior: Array, info: Six, how: Matcher, out: Array
) -> tuple[float, Six]:
    """Gauss-Newton from a guess to the pose of least cost.

    The prior has a mean and an information matrix. Returns the cost, and the information of the
    posterior there (Laplace).
    """
    x, y, yaw = guess[0], guess[1], guess[2]
    per = 1.0 / (how.spread * how.spread)
    minimum = math.inf
    found = info
    for _ in range(how.iterations + 1):
        total, bx, by, bt, h = _slope(field, points, x, y, yaw)
        dx, dy, dt = prior[0] - x, prior[1] - y, prior[2] - yaw
        cost = 0.5 * (per * total + quadratic(info, dx, dy, dt))
        m = (
            per * h[0] + info[0] + _RIDGE, per * h[1] + info[1], per * h[2] + info[2],
            per * h[3] + info[3] + _RIDGE, per * h[4] + info[4], per * h[5] + info[5] + _RIDGE,
        )  # fmt: skip
        if cost < minimum:
            minimum, found = cost, m
            out[0], out[1], out[2] = x, y, yaw
        c = cholesky(m)
        z0, z1, z2 = forward(
            c,
            per * bx + info[0] * dx + info[1] * dy + info[2] * dt,
            per * by + info[1] * dx + info[3] * dy + info[4] * dt,
            per * bt + info[2] * dx + info[4] * dy + info[5] * dt,
        )
        sx, sy, st = backward(c, z0, z1, z2)
        shrink = min(1.0, _STRIDE / (math.hypot(sx, sy) + 1e-9), _TURN / (abs(st) + 1e-9))
        x, y, yaw = x + shrink * sx, y + shrink * sy, yaw + shrink * st
        if abs(sx) < _STILL and abs(sy) < _STILL and abs(st) < _STILL:
            break
    return minimum, found


_BLOCK = 3  # cells: side of the blocks of the coarse search


@borrowing_kernel
def _raise(line: Floats, over: Floats) -> None:
    """Element-wise maximum of two rows; numba's `max` handles NaN and does not vectorize."""
    for k in range(min(len(line), len(over))):
        over[k] = line[k] if line[k] > over[k] else over[k]


@borrowing_kernel
def _pool(field: Floats, wide: Floats, box: tuple[int, int, int, int]) -> None:
    """The largest value of each block of cells that begins at a cell, within a box."""
    for r in range(box[0], box[1]):
        line, over = field[r, box[2] : box[3]], wide[r, box[2] : box[3]]
        for k in range(len(over)):
            over[k] = line[k]
        for k in range(1, _BLOCK):
            _raise(field[r, box[2] + k : box[3] + k], over)
    for r in range(box[0], box[1]):
        for k in range(1, _BLOCK):
            if r + k < box[1]:
                _raise(wide[r + k, box[2] : box[3]], wide[r, box[2] : box[3]])


@kernel
def search(
    field: Floats, points: Array, guess: Array, info: Six, how: Matcher, wide: Floats, out: Array
) -> float:
    """The pose of least cost on the lattice of cells and angle steps about a guess.

    Returns its cost, with the field of whole cells.
    """
    window, turns, step = how.window, how.turns, how.step
    rows, cols = field.shape
    n = len(points)
    blocks = (2 * window + _BLOCK) // _BLOCK
    size = blocks * _BLOCK  # cells from -window on; those beyond it are searched as well
    yaws = 2 * turns + 1
    place = np.empty((yaws, n, 2), np.int32)
    bound = np.empty(yaws * blocks * blocks)
    bottom, top, left, right = rows, 0, cols, 0
    per = 0.5 / (how.spread * how.spread)
    for a in range(yaws):
        yaw = guess[2] + (a - turns) * step
        c, s = math.cos(yaw), math.sin(yaw)
        for k in range(n):
            place[a, k, 0] = math.floor(guess[1] + s * points[k, 0] + c * points[k, 1]) - window
            place[a, k, 1] = math.floor(guess[0] + c * points[k, 0] - s * points[k, 1]) - window
            bottom, top = min(bottom, place[a, k, 0]), max(top, place[a, k, 0])
            left, right = min(left, place[a, k, 1]), max(right, place[a, k, 1])
    box = (min(max(bottom, 0), rows), max(min(top + size, rows), 0),
           min(max(left, 0), cols), max(min(right + size, cols), 0))  # fmt: skip
    _pool(field, wide, box)
    for a in range(yaws):
        for b in range(blocks * blocks):
            up, aside = (b // blocks) * _BLOCK, (b % blocks) * _BLOCK
            gain = 0.0
            for k in range(n):
                r, q = place[a, k, 0] + up, place[a, k, 1] + aside
                if box[0] <= r < box[1] and box[2] <= q < box[3]:
                    value = wide[r, q]
                    gain += value * (2.0 - value)
                elif -_BLOCK < r < rows and -_BLOCK < q < cols:
                    gain += 1.0  # it may reach into the map from outside
            bound[a * blocks * blocks + b] = per * (n - gain)
    minimum = math.inf
    while True:
        first = int(np.argmin(bound))
        if bound[first] >= minimum:
            break
        bound[first] = math.inf
        a, b = first // (blocks * blocks), first % (blocks * blocks)
        for up in range((b // blocks) * _BLOCK, (b // blocks) * _BLOCK + _BLOCK):
            for aside in range((b % blocks) * _BLOCK, (b % blocks) * _BLOCK + _BLOCK):
                dx, dy, dt = aside - window, up - window, (a - turns) * step
                cost = 0.5 * quadratic(info, dx, dy, dt) + per * n
                for k in range(n):
                    r, q = place[a, k, 0] + up, place[a, k, 1] + aside
                    if 0 <= r < rows and 0 <= q < cols:
                        value = field[r, q]
                        cost -= per * value * (2.0 - value)
                if cost < minimum:
                    minimum = cost
                    out[0], out[1], out[2] = guess[0] + dx, guess[1] + dy, guess[2] + dt
    return minimum


def matcher(resolution: float) -> Matcher:
    """The constants of matching as kernels take them, for cells of a side [m]."""
    window, turns = round(SEARCH_WINDOW / resolution), round(_SEARCH_ANGLE / _ANGLE_STEP)
    return Matcher(_RESIDUAL_SIGMA, _ITERATIONS, window, turns, _ANGLE_STEP, _SEARCH_THRESHOLD)


def thin_scan(scan: Scan, spacing: float, maximum: int) -> Array:
    """Echoes (n, 2), one for each `spacing` [m] across the beams, at most `maximum`.

    The distance between echoes would be no measure: their noise would choose, always towards the
    end of the sweep, and turn the chair.
    """
    points = scan.echoes
    ranges = np.hypot(*(points - scan.origin).T)
    across = np.cumsum(ranges * scan.angle_step)
    kept = points[np.diff(np.floor(across / spacing), prepend=-1.0) > 0.0]
    if len(kept) > maximum:
        kept = kept[np.linspace(0, len(kept) - 1, maximum).astype(np.int64)]
    return np.ascontiguousarray(kept)


# How odometry errs, standard deviations; gmapping's srr is 0.1, its stt 0.2, its srt 0.1, for worse
# wheels. The floors are an encoder's quanta, and the motion during a scan.
_TRANSLATION_ERROR, _TRANSLATION_FLOOR = 0.05, 0.010  # m/m, m
_ROTATION_ERROR, _ROTATION_FLOOR = 0.05, 0.010  # rad/rad, rad
_ROTATION_PER_TRANSLATION = 0.05  # rad/m
_RESAMPLE_THRESHOLD = 0.5  # share of effective particles (Grisetti et al. 2007)
_SMOOTHING = 3.0  # root of the likelihood, since beams have correlated errors: gmapping's ogain
_NODE = math.sqrt(3.0)  # nodes of the third-degree cubature in three dimensions, in deviations


class Odometry(NamedTuple):
    """Motion since the last scan used, and the variance of its errors [cells, rad]."""

    x: float
    y: float
    yaw: float
    translation_variance: float
    rotation_variance: float


@borrowing_kernel
def _draw_pose(
    field: Floats, points: Array, prior: Array, prior_info: Six, spread: float, best: Array,
    info: Six, cost: float, key: np.uint64, step: int, particle: int, draw: bool,
) -> float:  # fmt: skip
    """Fit a Gaussian to the posterior about its mode, and draw the pose from it.

    `best` becomes the pose: drawn, or the mean. The result is the logarithm of the weight
    (Grisetti et al. 2007, equations 16 to 20).
    """
    c = cholesky(info)
    x, y, yaw = best[0], best[1], best[2]
    total = 0.0
    m0, m1, m2, xx, yy, tt = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(6):
        side = _NODE if k % 2 == 0 else -_NODE
        u, v, w = side * (k // 2 == 0), side * (k // 2 == 1), side * (k // 2 == 2)
        dx, dy, dt = backward(c, u, v, w)
        px, py, pt = x + dx, y + dy, yaw + dt
        here = 0.5 * misfit(field, points, px, py, pt) / (spread * spread)
        here += 0.5 * quadratic(prior_info, px - prior[0], py - prior[1], pt - prior[2])
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
    layers: Layers, workspace: Workspace, mark: int, poses: Array, weights: Array,
    odometry: Odometry, points: Array, ends: Array, hits: Mask, how: Matcher, model: SensorModel,
    key: np.uint64, step: int, learn: bool,
) -> None:  # fmt: skip
    """Move, match, weigh and map every particle."""
    prior, best, other = np.empty(3), np.empty(3), np.empty(3)
    along, around = 1.0 / odometry.translation_variance, 1.0 / odometry.rotation_variance
    prior_info = (along, 0.0, 0.0, along, 0.0, around)
    for i in range(len(poses)):
        field, yaw = layers.field[i], poses[i, 2]
        c, s = math.cos(yaw), math.sin(yaw)
        prior[0] = poses[i, 0] + c * odometry.x - s * odometry.y
        prior[1] = poses[i, 1] + s * odometry.x + c * odometry.y
        prior[2] = yaw + odometry.yaw
        if len(points) == 0:
            poses[i] = prior
        else:
            cost, info = refine(field, points, prior, prior, prior_info, how, best)
            apart = misfit(field, points, best[0], best[1], best[2])
            if apart > how.threshold * len(points):
                search(field, points, prior, prior_info, how, workspace.pooled, other)
                cost_2, info_2 = refine(field, points, other, prior, prior_info, how, other)
                if cost_2 < cost:
                    cost, info = cost_2, info_2
                    best[:] = other
            weights[i] += _draw_pose(
                field, points, prior, prior_info, how.spread, best, info, cost, key, step, i,
                len(poses) > 1,
            )  # fmt: skip
            poses[i] = best
        if learn:
            add_scan(layers, i, workspace, mark + i, ends, hits, poses[i], model)


_RESAMPLING = 60_000  # index of the draw of resampling; those below are the particles'
# m, rad: driven or turned before the next scan is used. Half as far drifts a quarter more, twice as
# far localizes worse: measured; the angle is gmapping's.
_UPDATE = 0.4, 0.5


@settings
class SlamSettings(MappingSettings):
    """Settings of SLAM and of its maps."""

    particles: int = setting(
        default=8, low=1, high=10000, source="measured: gmapping's 30 are no better in 24 plans"
    )
    """Number of particles; 1 is plain scan matching."""


class Slam:
    """Maps an unknown place and estimates the chair's pose in it.

    The same seed and the same scans give the same run, bit for bit.

    Args:
        laser: its mount and its beams.
        settings: particles and mapping.
        seed: of the draws.
        pose: initial pose (3,) [m, m, rad].
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
        """Forget everything, and begin where an episode does: its map is not used."""
        self._start(episode.start, key)

    def _start(self, pose: Array, seed: int) -> None:
        count, self._begun = self.settings.particles, np.array(pose)
        self.maps = OccupancyMap(self.settings, count)
        self.maps.reserve(pose)
        self._map: tuple[int, OccupancyGrid] | None = None  # scans in it, and it
        self._key = np.uint64(seed % 2**64)
        self._poses = np.tile(pose, (count, 1))
        self._weights = np.zeros(count)  # logarithms, since the last resampling
        self._total_weights = np.zeros(count)  # likewise since the beginning, by ancestry
        self._increment = np.zeros(3)  # motion since the last scan used
        self._driven = np.zeros(2)  # m, rad: driven and turned since then
        self._history: list[Array] = []  # poses after each scan used, and ...
        self._parents: list[NDArray[np.int64]] = []  # ... whose copies those particles were
        self._steps: list[tuple[int, Array]] = []  # by update: scans used so far, motion since

    def update(self, increment: ArrayLike, ranges: ArrayLike | None, learn: bool = True) -> Array:
        """The pose after an increment of odometry and a scan.

        Args:
            increment: (3,) [m, m, rad] odometry since the last update, in the chair's frame then.
            ranges: (beams,) [m] as in `Reading.laser`; None: no scan.
            learn: false: match the scan, but keep it out of the maps, to test them with.

        Returns:
            The pose (3,) [m, m, rad].

        Raises:
            InputError: an increment that is not three finite numbers, or a scan of another length.
        """
        motion = np.asarray(increment, dtype=np.float64)
        if motion.shape != (3,) or not np.isfinite(motion).all():
            raise InputError(f"increment is {increment!r}; expected three finite numbers")
        if ranges is not None and np.shape(ranges) != (self.laser.beams,):
            raise InputError(f"a scan has shape {np.shape(ranges)}; expected ({self.laser.beams},)")
        self._increment = compose(self._increment, motion)
        self._driven += math.hypot(motion[0], motion[1]), abs(motion[2])
        due = (self._driven >= _UPDATE).any()
        if ranges is not None and (due or not self._history or not learn):
            scan = read_scan(self.laser, ranges)
            if len(scan.ends):
                self._use_scan(scan, learn)
        self._steps.append((len(self._history), self._increment))
        return self.pose

    def _use_scan(self, scan: Scan, learn: bool) -> None:
        """Match a scan, weigh the particles, and perhaps add it to their maps."""
        config, maps = self.settings, self.maps
        expected = compose(self._poses, self._increment)
        unit = config.resolution
        # The search's blocks reach beyond the window.
        maps.grow_to(expected, scan.radius + 2.0 * SEARCH_WINDOW + 5.0 * unit)
        points = thin_scan(scan, POINT_SPACING, MAX_POINTS) / unit
        points = points if self._history else points[:0]  # the first finds no map
        way, turn = self._driven
        along = _TRANSLATION_FLOOR + _TRANSLATION_ERROR * way
        around = _ROTATION_FLOOR + _ROTATION_ERROR * turn
        around += _ROTATION_PER_TRANSLATION * way
        x, y, yaw = self._increment
        odometry = Odometry(x / unit, y / unit, yaw, (along / unit) ** 2, around**2)
        poses, gained = maps.to_lattice(self._poses), np.zeros(len(self._poses))
        update_particles(
            maps.layers, maps.workspace, maps.next_marks(len(poses)), poses, gained, odometry,
            points, scan.points / unit, scan.hits, matcher(unit), maps.model, self._key,
            len(self._history), learn,
        )  # fmt: skip
        self._poses = maps.from_lattice(poses)
        self._weights += gained / (_SMOOTHING * len(gained))
        self._total_weights += gained
        self._increment, self._driven = np.zeros(3), np.zeros(2)
        self._history.append(self._poses)
        self._parents.append(self._resample())

    def _resample(self) -> NDArray[np.int64]:
        """Resample systematically if too few particles are effective; returns the parents."""
        count = len(self._weights)
        share = np.exp(self._weights - self._weights.max())
        share /= share.sum()
        each = np.arange(count)
        if count == 1 or 1.0 / (share**2).sum() >= _RESAMPLE_THRESHOLD * count:
            return each
        start = uniform(self._key, len(self._history), SLAM, _RESAMPLING)
        drawn = np.searchsorted(np.cumsum(share), (start + each) / count).clip(0, count - 1)
        # Those drawn stay where they are, and their copies take the places of the others.
        times = np.bincount(drawn, minlength=count)
        parents = each.copy()
        parents[times == 0] = np.repeat(each, np.maximum(times - 1, 0))
        self.maps.copy_layers(parents)
        self._poses, self._total_weights = self._poses[parents], self._total_weights[parents]
        self._weights = np.zeros(count)
        return parents

    @property
    def best(self) -> int:
        """The index of the particle with the greatest likelihood over its whole history."""
        return int(np.argmax(self._total_weights))

    @property
    def pose(self) -> Array:
        """Pose (3,) [m, m, rad] of the best particle."""
        return compose(self._poses[self.best], self._increment)

    @property
    def poses(self) -> Array:
        """Poses (particles, 3) [m, m, rad]."""
        return compose(self._poses, self._increment)

    def built_map(self) -> OccupancyGrid:
        """The best particle's map; a single unknown cell before the first scan."""
        if not self._history:
            cells = np.full((1, 1), UNKNOWN, np.int8)
            return OccupancyGrid(cells, self.settings.resolution)
        if self._map is None or self._map[0] != len(self._history):
            self._map = len(self._history), self.maps.to_grid(self.best)
        return self._map[1]

    @property
    def trajectory(self) -> Array:
        """Poses (updates, 3) [m, m, rad] of the best particle, smoothed by its latest history."""
        line = np.empty((len(self._history) + 1, 3))
        line[0] = self._begun
        particle = self.best
        for k in range(len(self._history) - 1, -1, -1):
            particle = self._parents[k][particle]
            line[k + 1] = self._history[k][particle]
        return np.stack([compose(line[scans], motion) for scans, motion in self._steps])
