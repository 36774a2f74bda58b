"""Wheels, track, mount, offset and delay of a scanner, all at once, from the walls that it saw.

As in Censi, Franchi, Marchionni and Oriolo (2013), Simultaneous Calibration of Odometry and Sensor
Parameters for Mobile Robots, IEEE Transactions on Robotics 29(2), the unknowns of the wheels and of
the mount are found together from wheels and scans alone, without a map or a tape. They match scans
in pairs; here all scans are matched to the same straight walls, whose places are unknowns, too: so
a range offset shows as well, since walls then look bent.

The drive is cut into blocks, each with a free first pose. Blocks share nothing but the unknowns
that are sought and the walls, so that drift between blocks does no harm, and so that intervals
come from drawing blocks again (block bootstrap).
"""

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.base.arrays import Array
from wheelchair_gym.geometry.kinematics import DriveGeometry
from wheelchair_gym.geometry.planar import compose, relative_pose, wrap_angle
from wheelchair_gym.identification.logs import DriveLog
from wheelchair_gym.identification.walls import (
    MIN_COSINE,
    Hits,
    Walls,
    find_hits,
    find_walls,
    merge_walls,
    place_points,
)
from wheelchair_gym.sensors.settings import LaserSettings

# The unknowns and their prior deviations: what a chair built with a rule may be off by.
UNKNOWNS: Final = {
    "scale": 0.1,  # of the wheels' mean radius, over that of the config
    "wheel_ratio": 0.05,  # diameter of the right wheel over that of the left one
    "track": 0.1,  # m
    "x": 0.3,  # m, of the scanner
    "y": 0.3,  # m
    "yaw": 0.3,  # rad
    "offset": 0.1,  # m
    "delay": 0.3,  # s, of the scans' stamps behind those of the wheels
}
# Places of these in an array of values.
WHEELS, MOUNT, OFFSET, DELAY = slice(0, 3), slice(3, 6), 6, 7
# Deviations that drawing blocks again does not show, as of the walls' shape and of the reports'
# times: of errors on simulated and on emulated chairs (tests.benchmarks.identification).
_BEYOND: Final = np.array([3e-4, 1e-4, 1.5e-4, 3e-4, 3e-4, 3e-4, 1.5e-3, 5e-4])
_TAPE = 1e-3  # m: deviation of a distance by tape
_KNOWN = 1e-6  # deviation of what is known
_STEPS: Final = np.array([1e-4, 1e-4, 1e-4, 1e-4, 1e-4, 1e-4, 1e-4, 5e-3])  # of differences
_BLOCK = 6.0  # s
_GATES = (0.25, 0.20, 0.15, 0.12)  # m: of hits, by iteration
_HUBER = 2.0  # deviations
_DRAWS = 400  # of the bootstrap
_FREE = 1e-6  # 1/m2, 1/rad2: keeps the frame of the walls, which is free
SPACING = 0.3  # s between two scans that are used


class Kinematics(NamedTuple):
    """Values of UNKNOWNS, and how certain they are."""

    values: Array  # (8,)
    conditional: Array  # (8,) where all other unknowns were known
    covariance: Array  # (8, 8) by drawing blocks again
    sigma: float  # m, of a range


def wheel_path(log: DriveLog, values: Array) -> Array:
    """Poses (n, 3) [m, m, rad] at the reports of the wheels, from the origin."""
    scale, ratio, track = values[WHEELS]
    steps = np.diff(log.travel, axis=0) * scale
    left, right = steps[:, 0] * 2.0 / (1.0 + ratio), steps[:, 1] * 2.0 * ratio / (1.0 + ratio)
    distance, turn = 0.5 * (left + right), (right - left) / track
    yaw = np.concatenate([[0.0], np.cumsum(turn)])
    middle = yaw[:-1] + 0.5 * turn
    x, y = (np.concatenate([[0.0], np.cumsum(distance * f(middle))]) for f in (np.cos, np.sin))
    return np.stack([x, y, yaw], axis=1)


def poses_at(log: DriveLog, path: Array, times: Array) -> Array:
    """Poses (m, 3) at times (m,) [s] of a path (n, 3) at the reports of the wheels."""
    return np.stack([np.interp(times, log.stamps, path[:, i]) for i in range(3)], axis=1)


class _Problem:
    """Scans that are used, blocks, and the poses of scans for given unknowns."""

    def __init__(self, log: DriveLog, laser: LaserSettings, scans: NDArray[np.int64]) -> None:
        self.log, self.laser, self.scans = log, laser, scans
        self.stamps = log.scan_stamps[scans]
        self.ranges = log.ranges[scans]
        self.block = ((self.stamps - self.stamps[0]) / _BLOCK).astype(np.int64)
        self.block = np.unique(self.block, return_inverse=True)[1]
        self.first = np.unique(self.block, return_index=True)[1]

    def motion(self, values: Array) -> Array:
        """Poses (n, 3) of the chair at the scans, from those at the first scans of their blocks."""
        path = wheel_path(self.log, values)
        poses = poses_at(self.log, path, self.stamps - values[DELAY])
        return relative_pose(poses[self.first][self.block], poses)

    def sensor(self, values: Array, starts: Array) -> Array:
        """Poses (n, 3) of the scanner; `starts` are those of the chair at each block's first."""
        return compose(compose(starts[self.block], self.motion(values)), values[MOUNT])


def _linearise(
    problem: _Problem, values: Array, starts: Array, walls: Walls, hits: Hits
) -> tuple[Array, Array, Array]:
    """Errors of ranges (n,) [m]; their slopes for unknowns and walls, and for starts.

    A range errs alike at all angles of incidence; the distance of its point from a wall does not.
    """
    sensor = problem.sensor(values, starts)
    points = place_points(sensor, hits.scan, hits.angle, hits.range - values[OFFSET])
    angle, d = walls.lines[hits.wall].T
    c, s = np.cos(angle), np.sin(angle)
    off = c * points[:, 0] + s * points[:, 1] - d
    arm = points - sensor[hits.scan, :2]
    of_pose = np.stack([c, s, s * arm[:, 0] - c * arm[:, 1]], axis=1)
    n, unknowns = len(off), len(values)
    slopes = np.zeros((n, unknowns + 2 * len(walls.lines)))
    for k in (*range(OFFSET), DELAY):
        moved = values.copy()
        moved[k] += _STEPS[k]
        change = problem.sensor(moved, starts) - sensor
        change[:, 2] = wrap_angle(change[:, 2])
        change /= _STEPS[k]
        slopes[:, k] = (of_pose * change[hits.scan]).sum(axis=1)
    beam = sensor[hits.scan, 2] + hits.angle
    slopes[:, OFFSET] = -(c * np.cos(beam) + s * np.sin(beam))
    rows = np.arange(n)
    slopes[rows, unknowns + 2 * hits.wall] = c * points[:, 1] - s * points[:, 0]
    slopes[rows, unknowns + 2 * hits.wall + 1] = -1.0
    # The chair's start moves the scanner as a rigid body does.
    start = starts[problem.block[hits.scan]]
    lever = points - start[:, :2]
    of_start = np.stack([c, s, s * lever[:, 0] - c * lever[:, 1]], axis=1)
    scale = 1.0 / np.maximum(np.abs(slopes[:, OFFSET]), MIN_COSINE)
    return off * scale, slopes * scale[:, None], of_start * scale[:, None]


def _reduced(
    problem: _Problem, values: Array, starts: Array, walls: Walls, hits: Hits
) -> tuple[float, Array, Array, list[tuple[Array, Array]]]:
    """Deviation of a range [m], and robust normal equations (blocks, m, m) and (blocks, m).

    These are without the starts; the last part solves for them.
    """
    off, slopes, of_start = _linearise(problem, values, starts, walls, hits)
    sigma = max(1e-4, 1.4826 * float(np.median(np.abs(off))))
    weights = np.minimum(1.0, _HUBER * sigma / np.maximum(np.abs(off), 1e-12)) / sigma**2
    blocks, m = len(problem.first), slopes.shape[1]
    matrices, vectors = np.zeros((blocks, m, m)), np.zeros((blocks, m))
    rests: list[tuple[Array, Array]] = []
    of_block = problem.block[hits.scan]
    for b in range(blocks):
        rows = np.flatnonzero(of_block == b)
        a, j, w = of_start[rows], slopes[rows], weights[rows, None]
        haa = (w * a).T @ a + 1e-9 * np.eye(3)
        haj, ga = (w * a).T @ j, (w * a).T @ off[rows]
        inner = np.asarray(np.linalg.solve(haa, np.column_stack([haj, ga])), np.float64)
        matrices[b] = (w * j).T @ j - haj.T @ inner[:, :-1]
        vectors[b] = (w * j).T @ off[rows] - haj.T @ inner[:, -1]
        rests.append((inner[:, :-1], inner[:, -1]))
    return sigma, matrices, vectors, rests


def identify(
    log: DriveLog, drive: DriveGeometry, laser: LaserSettings, sensor_poses: Array,
    rng: np.random.Generator, offset: float | None = None, known: Array | None = None,
) -> Kinematics:  # fmt: skip
    """Find wheels, track, mount, offset and delay.

    Args:
        log: of a drive among walls.
        drive: the wheels as the config has them.
        laser: the scanner likewise.
        sensor_poses: (m, 3) rough poses of the scanner at all scans, by SLAM.
        rng: of the bootstrap.
        offset: of the ranges [m], as a tape says.
        known: values of UNKNOWNS, whose scale, ratio and track are taken as they are.

    Raises:
        ValueError: the scans show fewer than two walls.
    """
    since = (log.scan_stamps - log.scan_stamps[0] + 1e-6) / SPACING
    scans = np.unique(np.floor(since), return_index=True)[1]  # the first of each interval
    problem = _Problem(log, laser, scans)
    values = np.array(
        [1.0, drive.wheel_ratio, drive.track, laser.x, laser.y, laser.yaw, laser.offset, 0.0]
    )
    deviations, beyond = np.array(list(UNKNOWNS.values())), _BEYOND.copy()
    if offset is not None:
        values[OFFSET], deviations[OFFSET], beyond[OFFSET] = offset, _TAPE, _TAPE
    if known is not None:
        values[WHEELS], deviations[WHEELS] = known[WHEELS], _KNOWN
    prior, weight = values.copy(), 1.0 / deviations**2
    rough = sensor_poses[scans]
    walls = find_walls(laser, problem.ranges, rough)
    if len(walls.lines) < 2:
        raise ValueError("the scans show fewer than two straight walls; drive in a room with walls")
    inverse = relative_pose(values[MOUNT], np.zeros(3))
    starts = compose(rough[problem.first], inverse)
    hits = None
    for gate in _GATES:
        poses = rough if hits is None else problem.sensor(values, starts)
        if hits is not None:  # better poses show a wall once that rough ones showed twice
            walls = find_walls(laser, problem.ranges - np.float32(values[OFFSET]), poses)
        walls = merge_walls(walls)
        hits = find_hits(laser, problem.ranges, poses, walls, gate, values[OFFSET])
        for _ in range(2):
            _, matrices, vectors, rests = _reduced(problem, values, starts, walls, hits)
            step = _solve(matrices.sum(axis=0), vectors.sum(axis=0), values - prior, weight)
            values = values + step[: len(values)]
            lines = walls.lines + step[len(values) :].reshape(-1, 2)
            walls = walls._replace(lines=lines)
            for b, (by_step, alone) in enumerate(rests):
                starts[b] = starts[b] - alone - by_step @ step
            if np.abs(step[: len(values)] / _STEPS).max() < 0.05:
                break
    assert hits is not None
    sigma, matrices, vectors, _ = _reduced(problem, values, starts, walls, hits)
    draws = np.empty((_DRAWS, len(values)))
    for k in range(_DRAWS):
        counts = np.bincount(rng.integers(0, len(matrices), len(matrices)), minlength=len(matrices))
        summed = np.tensordot(counts, matrices, 1), np.tensordot(counts, vectors, 1)
        draws[k] = _solve(*summed, values - prior, weight)[: len(values)]
    total = matrices.sum(axis=0)[: len(values), : len(values)]
    conditional = 1.0 / np.sqrt(np.diag(total) + weight)
    covariance = np.cov(draws.T) + np.diag(beyond**2)
    return Kinematics(values, conditional, covariance, sigma)


def _solve(matrix: Array, vector: Array, away: Array, weight: Array) -> Array:
    """The Gauss-Newton step of unknowns and walls; `away` is the distance from the prior."""
    n = len(away)
    full = matrix + _FREE * np.eye(len(matrix))
    full[np.arange(n), np.arange(n)] += weight
    right = vector.copy()
    right[:n] += weight * away
    return -np.asarray(np.linalg.solve(full, right), np.float64)
