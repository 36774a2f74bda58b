"""The boundary of what is free, as loops that one may walk along, and where a straight way ends."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from planners.exact import SpaceArrays, blocked_by, edge_free, into_solid, side
from wheelchair_gym.kernel import borrowing_kernel, kernel

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

HALVINGS = 64  # of a straight way: beyond the last digit


@kernel
def blockers(arrays: SpaceArrays, ax: float, ay: float, bx: float, by: float) -> Indices:
    """The segments that stop the straight way from a to b [m]."""
    one = np.empty(1, dtype=np.int32)
    found = np.empty(arrays.segments.shape[0], dtype=np.int64)
    count = 0
    for k in range(arrays.segments.shape[0]):
        one[0] = k
        if blocked_by(arrays.segments, arrays.before, one, ax, ay, bx, by):
            found[count] = k
            count += 1
    return found[:count].copy()


@borrowing_kernel
def farthest(
    arrays: SpaceArrays, ax: float, ay: float, bx: float, by: float
) -> tuple[float, float]:
    """How much of the way from a to b is free, and how much no more, as parts of it."""
    if edge_free(arrays, ax, ay, bx, by):
        return 1.0, 1.0
    free, blocked = 0.0, 1.0
    for _ in range(HALVINGS):
        middle = 0.5 * (free + blocked)
        if edge_free(arrays, ax, ay, ax + middle * (bx - ax), ay + middle * (by - ay)):
            free = middle
        else:
            blocked = middle
    return free, blocked


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
