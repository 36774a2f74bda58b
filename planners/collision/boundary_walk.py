"""Walks along the boundary of free space, and where a straight line meets it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from planners.collision.orient2d import orient2d
from planners.collision.polygon_tests import SpaceArrays, blocks, enters_solid
from wheelchair_gym.compiled.kernel import borrowing_kernel, kernel

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


@borrowing_kernel
def fraction_along(ax: float, ay: float, bx: float, by: float, x: float, y: float) -> float:
    """The fraction of the segment from a to b [m] at the projection of a point."""
    ux, uy = bx - ax, by - ay
    return ((x - ax) * ux + (y - ay) * uy) / (ux * ux + uy * uy)


@borrowing_kernel
def line_intersection(
    segments: Array, k: int, ax: float, ay: float, bx: float, by: float
) -> tuple[float, float]:
    """Where a segment meets the line from a to b [m]; exact at the ends of the segment."""
    cx, cy, dx, dy = segments[k, 0], segments[k, 1], segments[k, 2], segments[k, 3]
    c, d = orient2d(ax, ay, bx, by, cx, cy), orient2d(ax, ay, bx, by, dx, dy)
    if c == 0.0:
        return cx, cy
    if d == 0.0:
        return dx, dy
    return cx + c / (c - d) * (dx - cx), cy + c / (c - d) * (dy - cy)


@kernel
def blocking_segments(
    arrays: SpaceArrays, ax: float, ay: float, bx: float, by: float
) -> tuple[Indices, Array]:
    """The segments (n,) that block the edge from a to b [m], and the fraction of it before each."""
    found = np.empty(arrays.segments.shape[0], dtype=np.int64)
    parts = np.empty(arrays.segments.shape[0])
    count = 0
    for k in range(arrays.segments.shape[0]):
        if blocks(arrays.segments, arrays.before, k, ax, ay, bx, by):
            x, y = line_intersection(arrays.segments, k, ax, ay, bx, by)
            found[count], parts[count] = k, fraction_along(ax, ay, bx, by, x, y)
            count += 1
    return found[:count].copy(), parts[:count].copy()


@borrowing_kernel
def last_corner_on_line(
    arrays: SpaceArrays, ax: float, ay: float, bx: float, by: float, part: float
) -> int:
    """The segment that begins at the last corner exactly on the first part of an edge, or -1."""
    last, found = 0.0, -1
    for k in range(arrays.segments.shape[0]):
        x, y = arrays.segments[k, 0], arrays.segments[k, 1]
        if (
            orient2d(ax, ay, bx, by, x, y) == 0.0
            and last < fraction_along(ax, ay, bx, by, x, y) <= part
        ):
            last, found = fraction_along(ax, ay, bx, by, x, y), k
    return found


@kernel
def leads_into_solid(arrays: SpaceArrays, k: int, corner: bool, x: float, y: float) -> bool:
    """Whether the line from a segment, or from its first corner, to a point enters the solid."""
    ax, ay, bx, by = (
        arrays.segments[k, 0],
        arrays.segments[k, 1],
        arrays.segments[k, 2],
        arrays.segments[k, 3],
    )
    if corner:
        return enters_solid(arrays.before[k, 0], arrays.before[k, 1], ax, ay, bx, by, x, y)
    return orient2d(ax, ay, bx, by, x, y) > 0.0


def segment_links(arrays: SpaceArrays) -> tuple[Indices, Indices]:
    """The next segment (n,) of each along its obstacle, and the previous one.

    Where two obstacles meet in a point, a path may pass between them.
    """
    segments = arrays.segments
    here = np.lexsort(segments.T)
    there = np.lexsort(np.hstack([arrays.before, segments[:, :2]]).T)
    preceding, following = np.empty_like(here), np.empty_like(here)
    preceding[there] = here
    following[preceding] = np.arange(len(segments))
    return following, preceding


def boundary_loop(k: int, step: Indices) -> Indices:
    """The segments of a loop (m,), beginning with one of them."""
    found = [k]
    while step[found[-1]] != k:
        found.append(int(step[found[-1]]))
    return np.array(found, dtype=np.int64)
