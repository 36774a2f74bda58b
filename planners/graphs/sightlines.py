"""Cones of sight: on which side of them a point lies, and how far it is through one to the goal."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from planners.edges import side_of
from wheelchair_gym.kernel import absorbed_kernel

Array = NDArray[np.float64]

SLACK = 1e-12  # of an edge: how much more of it a cone is thought to see, for rounding


@absorbed_kernel
def beside(points: Array, root: int, bound: int, x: int) -> float:
    """Side of a cone's bound on which a point lies: the line from the root through a point.

    A bound below 0 goes on from point -1 - bound through the root.
    """
    if bound < 0:
        return side_of(points, -1 - bound, root, x)
    return side_of(points, root, bound, x)


@absorbed_kernel
def _cross(points: Array, root: int, bound: int, x: int) -> float:
    """The same in plain double."""
    ux, uy = points[root, 0], points[root, 1]
    if bound < 0:
        bx, by = ux - points[-1 - bound, 0], uy - points[-1 - bound, 1]
    else:
        bx, by = points[bound, 0] - ux, points[bound, 1] - uy
    return float(bx * (points[x, 1] - uy) - by * (points[x, 0] - ux))


@absorbed_kernel
def way_through(points: Array, root: int, a: int, b: int, right: int, left: int) -> float:
    """Shortest way [m] from a root to the goal through what a cone sees of an edge, at least.

    Seen from the root, a is the edge's right end.
    """
    ux, uy, ax, ay = points[root, 0], points[root, 1], points[a, 0], points[a, 1]
    ex, ey = points[b, 0] - ax, points[b, 1] - ay
    gx, gy = points[-1, 0], points[-1, 1]
    low, high = 0.0, 1.0
    if right != a:
        c, d = _cross(points, root, right, a), _cross(points, root, right, b)
        if c < 0.0 and d > c:
            low = min(max(-c / (d - c) - SLACK, 0.0), 1.0)
    if left != b:
        c, d = _cross(points, root, left, a), _cross(points, root, left, b)
        if d > 0.0 and d > c:
            high = min(max(-c / (d - c) + SLACK, 0.0), 1.0)
    if high < low:
        low, high = 0.0, 1.0
    # A goal on the root's side of the edge is mirrored: beyond it, just as far from each point.
    over_root, over_goal = ex * (uy - ay) - ey * (ux - ax), ex * (gy - ay) - ey * (gx - ax)
    if over_root * over_goal > 0.0:
        shift = 2.0 * over_goal / (ex * ex + ey * ey)
        gx, gy, over_goal = gx + shift * ey, gy - shift * ex, -over_goal
    gap = over_root - over_goal
    t = 0.5 * (low + high)
    if gap != 0.0:  # where the straight way meets the edge's line
        px = ux + over_root / gap * (gx - ux) - ax
        py = uy + over_root / gap * (gy - uy) - ay
        t = (px * ex + py * ey) / (ex * ex + ey * ey)
    if low <= t <= high:
        return math.hypot(gx - ux, gy - uy)
    t = low if t < low else high
    x, y = ax + t * ex, ay + t * ey
    return math.hypot(x - ux, y - uy) + math.hypot(gx - x, gy - y)


@absorbed_kernel
def passes(points: Array, u: int, v: int, before: int, after: int) -> bool:
    """Whether the line through u and v leaves both sides of a corner at u or v on one side."""
    p, d = side_of(points, u, v, before), side_of(points, u, v, after)
    return not ((p < 0.0 and d > 0.0) or (p > 0.0 and d < 0.0))
