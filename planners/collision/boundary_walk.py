"""The boundary of what is free, as loops that one may walk along, and where a straight way ends."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from planners.collision.orient2d import side
from planners.collision.polygon_tests import SpaceArrays, into_solid, stops
from wheelchair_gym.compiled.kernel import borrowing_kernel, kernel

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


@borrowing_kernel
def part_of(ax: float, ay: float, bx: float, by: float, x: float, y: float) -> float:
    """Which part of the way from a to b [m] lies before a point beside it."""
    ux, uy = bx - ax, by - ay
    return ((x - ax) * ux + (y - ay) * uy) / (ux * ux + uy * uy)


@borrowing_kernel
def crossing(
    segments: Array, k: int, ax: float, ay: float, bx: float, by: float
) -> tuple[float, float]:
    """Where a segment meets the line from a to b [m]: exactly, if it begins or ends there."""
    cx, cy, dx, dy = segments[k, 0], segments[k, 1], segments[k, 2], segments[k, 3]
    c, d = side(ax, ay, bx, by, cx, cy), side(ax, ay, bx, by, dx, dy)
    if c == 0.0:
        return cx, cy
    if d == 0.0:
        return dx, dy
    return cx + c / (c - d) * (dx - cx), cy + c / (c - d) * (dy - cy)


@kernel
def blockers(
    arrays: SpaceArrays, ax: float, ay: float, bx: float, by: float
) -> tuple[Indices, Array]:
    """The segments (n,) that stop the way from a to b [m], and the part of it before each."""
    found = np.empty(arrays.segments.shape[0], dtype=np.int64)
    parts = np.empty(arrays.segments.shape[0])
    count = 0
    for k in range(arrays.segments.shape[0]):
        if stops(arrays.segments, arrays.before, k, ax, ay, bx, by):
            x, y = crossing(arrays.segments, k, ax, ay, bx, by)
            found[count], parts[count] = k, part_of(ax, ay, bx, by, x, y)
            count += 1
    return found[:count].copy(), parts[:count].copy()


@borrowing_kernel
def last_corner(
    arrays: SpaceArrays, ax: float, ay: float, bx: float, by: float, part: float
) -> int:
    """The segment whose beginning is the last one exactly on a part of the way, or -1."""
    last, found = 0.0, -1
    for k in range(arrays.segments.shape[0]):
        x, y = arrays.segments[k, 0], arrays.segments[k, 1]
        if side(ax, ay, bx, by, x, y) == 0.0 and last < part_of(ax, ay, bx, by, x, y) <= part:
            last, found = part_of(ax, ay, bx, by, x, y), k
    return found


@kernel
def leads_into(arrays: SpaceArrays, k: int, corner: bool, x: float, y: float) -> bool:
    """Whether the way from a segment, or from the corner where it begins, to a point is solid."""
    ax, ay, bx, by = (
        arrays.segments[k, 0],
        arrays.segments[k, 1],
        arrays.segments[k, 2],
        arrays.segments[k, 3],
    )
    if corner:
        return into_solid(arrays.before[k, 0], arrays.before[k, 1], ax, ay, bx, by, x, y)
    return side(ax, ay, bx, by, x, y) > 0.0


def pairing(arrays: SpaceArrays) -> tuple[Indices, Indices]:
    """The segment (n,) that begins where each ends, and the one that ends where each begins.

    They go round one solid thing: where two things meet in a point, a way leads between them.
    """
    segments = arrays.segments
    here = np.lexsort(segments.T)
    there = np.lexsort(np.hstack([arrays.before, segments[:, :2]]).T)
    preceding, following = np.empty_like(here), np.empty_like(here)
    preceding[there] = here
    following[preceding] = np.arange(len(segments))
    return following, preceding


def loop_from(k: int, step: Indices) -> Indices:
    """The segments of a loop (m,), from one of them on."""
    found = [k]
    while step[found[-1]] != k:
        found.append(int(step[found[-1]]))
    return np.array(found, dtype=np.int64)
