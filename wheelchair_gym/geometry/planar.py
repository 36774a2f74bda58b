"""Angles, frames, paths and segments: pure functions.

Frames follow REP-103: x forward, y left, angles counter-clockwise [rad]; lengths in metres.
Scalar kernels serve compiled loops; functions on arrays accept any batch axes.
"""

import math

import numpy as np
from numpy.typing import ArrayLike

from wheelchair_gym.base.arrays import Array
from wheelchair_gym.compiled.kernel import inlined, kernel


def wrap_angle(angle: ArrayLike) -> Array:
    """Angles [rad] brought into [-pi, pi)."""
    turned = (np.asarray(angle, dtype=np.float64) + math.pi) % (2 * math.pi) - math.pi
    wrapped: Array = turned - 2 * math.pi * (turned >= math.pi)  # just below -pi, it is rounded up
    return wrapped


@kernel
def wrap(angle: float) -> float:
    """One angle [rad] brought into [-pi, pi)."""
    if -math.pi <= angle < math.pi:  # most are; the remainder is a slow call
        return angle
    turned = (angle + math.pi) % (2 * math.pi) - math.pi
    return turned if turned < math.pi else turned - 2 * math.pi


@inlined
def world_to_body(c: float, s: float, dx: float, dy: float) -> tuple[float, float]:
    """A vector of the world in a frame whose yaw has cosine c and sine s."""
    return c * dx + s * dy, c * dy - s * dx


@inlined
def body_to_world(c: float, s: float, x: float, y: float) -> tuple[float, float]:
    """A vector of a frame whose yaw has cosine c and sine s, in the world."""
    return c * x - s * y, s * x + c * y


@inlined
def point_to_world(
    c: float, s: float, x: float, y: float, ahead: float, left: float
) -> tuple[float, float]:
    """A point of a frame at (x, y) whose yaw has cosine c and sine s, in the world."""
    return x + c * ahead - s * left, y + s * ahead + c * left


def to_frame(points: ArrayLike, pose: ArrayLike) -> Array:
    """Points (..., 2) [m] of the world, seen from a pose (3,) (x, y, yaw)."""
    x, y, yaw = np.asarray(pose, dtype=np.float64)
    c, s = math.cos(yaw), math.sin(yaw)
    seen: Array = (np.asarray(points, dtype=np.float64) - (x, y)) @ np.array([(c, -s), (s, c)])
    return seen


def to_world(points: ArrayLike, pose: ArrayLike) -> Array:
    """Points (..., 2) [m] of a frame at pose (3,) (x, y, yaw), in the world."""
    x, y, yaw = np.asarray(pose, dtype=np.float64)
    c, s = math.cos(yaw), math.sin(yaw)
    placed: Array = np.asarray(points, dtype=np.float64) @ np.array([(c, s), (-s, c)]) + (x, y)
    return placed


def compose(pose: ArrayLike, increment: ArrayLike) -> Array:
    """Poses (..., 3) moved by increments (..., 3), each in its pose's own frame."""
    a, b = np.asarray(pose, dtype=np.float64), np.asarray(increment, dtype=np.float64)
    c, s = np.cos(a[..., 2]), np.sin(a[..., 2])
    x = a[..., 0] + c * b[..., 0] - s * b[..., 1]
    y = a[..., 1] + s * b[..., 0] + c * b[..., 1]
    return np.stack([x, y, wrap_angle(a[..., 2] + b[..., 2])], axis=-1)


def relative_pose(before: ArrayLike, after: ArrayLike) -> Array:
    """The increments (..., 3) that `compose` adds to poses to reach others."""
    a, b = np.asarray(before, dtype=np.float64), np.asarray(after, dtype=np.float64)
    c, s = np.cos(a[..., 2]), np.sin(a[..., 2])
    dx, dy = b[..., 0] - a[..., 0], b[..., 1] - a[..., 1]
    return np.stack([c * dx + s * dy, c * dy - s * dx, wrap_angle(b[..., 2] - a[..., 2])], axis=-1)


def map_to_odom(pose: ArrayLike, odometry: ArrayLike) -> Array:
    """The transforms map -> odom (..., 3) that turn dead-reckoned poses into estimated ones.

    Source: REP-105; `compose(map_to_odom(pose, odometry), odometry)` is `pose`.
    """
    return compose(pose, relative_pose(odometry, np.zeros(3)))


def path_length(path: ArrayLike) -> float:
    """Euclidean length [m] of a polyline (n, 2 or 3); a third column (yaw) does not count."""
    points = np.asarray(path, dtype=np.float64)[:, :2]
    return float(np.hypot(*np.diff(points, axis=0).T).sum())


def arc_lengths(path: ArrayLike) -> Array:
    """The length (n,) [m] of a polyline (n, 2 or 3) from its start to each of its points."""
    points = np.asarray(path, dtype=np.float64)[:, :2]
    return np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])


def without_repeats(path: Array) -> Array:
    """The polyline (n, 2) without points that repeat the point before."""
    moved = np.append(True, (np.diff(path, axis=0) != 0.0).any(axis=1))
    kept: Array = path[moved[: len(path)]]
    return kept


def polygon_edges(polygon: ArrayLike) -> Array:
    """The closed outline of a polygon (k, 2) as segments (k, 4) [m]: x0, y0, x1, y1."""
    points = np.asarray(polygon, dtype=np.float64)
    return np.hstack([points, np.roll(points, -1, axis=0)])  # (k, 4)


def signed_area(polygon: Array) -> float:
    """Area [m2] of a polygon (k, 2), negative where its corners run clockwise."""
    x, y = polygon.T
    return 0.5 * float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)))


@kernel
def point_segment_distance(
    px: float, py: float, ax: float, ay: float, bx: float, by: float
) -> float:
    """Distance [m] from a point to the segment a-b."""
    ex, ey = bx - ax, by - ay
    square = ex * ex + ey * ey
    t = 0.0
    if square > 0.0:
        t = min(1.0, max(0.0, ((px - ax) * ex + (py - ay) * ey) / square))
    return math.hypot(px - ax - t * ex, py - ay - t * ey)


@kernel
def project(path: Array, x: float, y: float) -> tuple[int, float, float]:
    """The point of a path (n, 2) [m] nearest to (x, y): segment, share of it, and distance [m]."""
    best, where, share = math.inf, 0, 0.0
    for k in range(path.shape[0] - 1):
        ex, ey = path[k + 1, 0] - path[k, 0], path[k + 1, 1] - path[k, 1]
        square = ex * ex + ey * ey
        t = 0.0
        if square > 0.0:
            t = ((x - path[k, 0]) * ex + (y - path[k, 1]) * ey) / square
            t = min(1.0, max(0.0, t))
        gap = math.hypot(x - path[k, 0] - t * ex, y - path[k, 1] - t * ey)
        if gap < best:
            best, where, share = gap, k, t
    return where, share, best


@kernel
def segments_cross(
    ax: float, ay: float, bx: float, by: float, cx: float, cy: float, dx: float, dy: float
) -> bool:
    """Whether a-b and c-d cross at a point inside both: touching ends and overlaps do not count."""
    abc = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
    abd = (bx - ax) * (dy - ay) - (by - ay) * (dx - ax)
    cda = (dx - cx) * (ay - cy) - (dy - cy) * (ax - cx)
    cdb = (dx - cx) * (by - cy) - (dy - cy) * (bx - cx)
    return abc * abd < 0.0 and cda * cdb < 0.0
