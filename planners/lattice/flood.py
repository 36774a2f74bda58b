"""Proof that no path leads an outline from its start to its goal: a flood through cells of poses.

A cell holds the poses nearest to a grid point and to one of some headings. It is shut if at each of
these poses an obstacle lies in one of the discs within the outline. What a flood from the start
does not reach through cells that are not shut, no path reaches. The headings of a grid point are
the bits of a word.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from planners.collision.space import Space
from planners.lattice.heuristic import Field, Ints, distance_field
from wheelchair_gym.base.arrays import Array
from wheelchair_gym.compiled.clock import clock
from wheelchair_gym.compiled.kernel import borrowing_kernel, kernel
from wheelchair_gym.maps.driving_cost import MotionCost

HEADINGS = 64
PROTRUSION = 0.05  # m: discs that protrude less from larger ones are left out
CHUNK = 500  # grid points between two readings of the clock
MAX_POINTS = 2_000_000  # of a grid: larger maps are not flooded
ROUNDING = 1e-6  # m: of distances
ONE, LAST, NONE = np.uint64(1), np.uint64(HEADINGS - 1), np.uint64(0)


class Flood(NamedTuple):
    """The cells reached, and the conditions of a shut cell."""

    gaps: Field  # (rows, columns) m: distance to obstacles
    places: Ints  # (discs, 2) rows and columns from the axle's grid point
    minimum: Array  # (discs,) m: a smaller distance shuts the cell
    first: Ints  # (HEADINGS + 1,): where the discs of each heading begin
    full: float  # m: at such a distance no cell of a grid point is shut
    free: NDArray[np.uint64]  # (rows, columns): cells that are not shut, where known
    known: NDArray[np.bool_]  # (rows, columns)
    reached: NDArray[np.uint64]  # (rows, columns)
    fresh: NDArray[np.uint64]  # (rows, columns): reached, but not spread from
    stack: Ints  # (rows * columns + 1,): grid points with fresh cells, after their number
    goal: Ints  # (3,) row, column, heading or -1


@kernel
def _discs(motion: MotionCost, spacing: float) -> tuple[Ints, Array, Ints]:
    """Return discs about grid points within the outline at each heading, the largest first."""
    front, rear, half = motion.outline
    reach = int(math.hypot(max(front, rear), half) / spacing) + 1
    side = 2 * reach + 1
    maximum = HEADINGS * side * side
    places, minimum = np.empty((maximum, 2), np.int64), np.empty(maximum)
    first, count = np.zeros(HEADINGS + 1, np.int64), 0
    radii = np.empty(side * side)
    for k in range(HEADINGS):
        c, s = math.cos(2.0 * math.pi * k / HEADINGS), math.sin(2.0 * math.pi * k / HEADINGS)
        for m in range(side * side):
            y, x = spacing * (m // side - reach), spacing * (m % side - reach)
            along, across = c * x + s * y, c * y - s * x
            inner = min(min(front - along, rear + along), half - abs(across))
            moved = spacing / math.sqrt(2.0) + math.pi / HEADINGS * math.hypot(x, y)
            radii[m] = inner + motion.margin - moved - ROUNDING if inner >= 0.0 else -1.0
        inside = np.flatnonzero(radii > 0.0)
        for m in inside[np.argsort(-radii[inside], kind="mergesort")]:
            i, j = m // side - reach, m % side - reach
            kept = True
            for n in range(first[k], count):
                apart = spacing * math.hypot(places[n, 0] - i, places[n, 1] - j)
                if apart + radii[m] <= minimum[n] + PROTRUSION:
                    kept = False
                    break
            if kept:
                places[count, 0], places[count, 1], minimum[count] = i, j, radii[m]
                count += 1
        first[k + 1] = count
    return places[:count].copy(), minimum[:count].copy(), first


@borrowing_kernel
def _look(flood: Flood, i: int, j: int) -> None:
    """Find the shut cells at a grid point."""
    gaps, places, minimum, first = flood.gaps, flood.places, flood.minimum, flood.first
    rows, columns = gaps.shape
    flood.known[i, j] = True
    if gaps[i, j] >= flood.full:
        flood.free[i, j] = ~NONE
        return
    for k in range(HEADINGS):
        free = True
        for m in range(first[k], first[k + 1]):
            r, c = i + places[m, 0], j + places[m, 1]
            if r < 0 or c < 0 or r >= rows or c >= columns or gaps[r, c] < minimum[m]:
                free = False
                break
        if free:
            flood.free[i, j] |= ONE << np.uint64(k)


@kernel
def _spread(flood: Flood, maximum: int) -> int:
    """Spread from up to `maximum` grid points; return 1 at the goal, 0 if none is left, else -1."""
    free, reached, fresh, goal = flood.free, flood.reached, flood.fresh, flood.goal
    rows, columns = free.shape
    for _ in range(maximum):
        size = flood.stack[0]
        if size == 0:
            return 0
        i, j = flood.stack[size] // columns, flood.stack[size] % columns
        flood.stack[0] = size - 1
        if not flood.known[i, j]:
            _look(flood, i, j)
        bits, before = reached[i, j] | fresh[i, j], NONE
        while bits != before:
            before = bits
            turned = (bits << ONE) | (bits >> LAST) | (bits >> ONE) | (bits << LAST)
            bits |= turned & free[i, j]
        reached[i, j], fresh[i, j] = bits, NONE
        if (
            i == goal[0]
            and j == goal[1]
            and (goal[2] < 0 or (bits >> np.uint64(goal[2])) & ONE == ONE)
        ):
            return 1
        for r in range(max(0, i - 1), min(rows, i + 2)):
            for c in range(max(0, j - 1), min(columns, j + 2)):
                if not flood.known[r, c]:
                    _look(flood, r, c)
                more = bits & free[r, c] & ~reached[r, c]
                if more != NONE:
                    if fresh[r, c] == NONE:
                        flood.stack[0] += 1
                        flood.stack[flood.stack[0]] = r * columns + c
                    fresh[r, c] |= more
    return -1


def is_cut_off(
    space: Space, motion: MotionCost, start: Array, goal: Array, spacing: float, end: float
) -> bool:
    """Return whether it is proven that no path leads from a start (3,) to a goal (2 or 3,).

    Args:
        space: the map.
        motion: the outline, and its least clearance.
        start: pose.
        goal: pose; without a heading any one counts.
        spacing: of the grid points [m]; a smaller one proves more, and takes longer.
        end: when `clock` shows it, nothing is proven.
    """
    width, height = space.bounds[2] - space.bounds[0], space.bounds[3] - space.bounds[1]
    if width * height > MAX_POINTS * spacing * spacing:
        return False
    places, minimum, first = _discs(motion, spacing)
    if clock() >= end:
        return False
    full = float((minimum + spacing * np.hypot(*places.T)).max(initial=0.0))
    gaps = distance_field(space, full + spacing, spacing)
    ends = np.full((2, 3), -1)
    for one, pose in zip(ends, (start, goal), strict=True):
        one[:2] = (pose[1::-1] - np.array(space.bounds[1::-1])) / spacing + 0.5
        if len(pose) == 3:
            one[2] = round(pose[2] * HEADINGS / (2.0 * math.pi)) % HEADINGS
    free, reached, fresh = (np.zeros(gaps.shape, np.uint64) for _ in range(3))
    stack, (i, j, k), answer = np.zeros(gaps.size + 1, np.int64), ends[0], -1
    fresh[i, j] = ONE << np.uint64(k)
    stack[:2] = 1, i * gaps.shape[1] + j
    known = np.zeros(gaps.shape, np.bool_)
    flood = Flood(gaps, places, minimum, first, full, free, known, reached, fresh, stack, ends[1])
    while answer < 0 and clock() < end:
        answer = _spread(flood, CHUNK)
    return answer == 0
