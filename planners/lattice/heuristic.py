"""The heuristic of the search over poses: the time to the goal for the axle alone.

The disc about the axle that fits into the outline must pass wherever the outline passes. Over a
grid of its places, Dijkstra's algorithm from the goal counts the duration, increased near walls, no
farther than it is asked to.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from planners.collision.space import Space
from planners.graphs.heap import Heap, new_heap, pop, push
from wheelchair_gym.base.arrays import Array
from wheelchair_gym.compiled.kernel import borrowing_kernel
from wheelchair_gym.geometry.planar import point_segment_distance, wrap
from wheelchair_gym.maps.driving_cost import MotionCost

Field = NDArray[np.float32]
Ints = NDArray[np.int64]

SPACING = 0.05  # m: of the grid of places
ROUNDING = SPACING / math.sqrt(2.0)  # m: a place is at most this far from its grid point
LOOKAHEAD = 12  # grid points ahead on the path: they give the direction
MIN_AIM = 0.2  # m: a nearer point gives no direction
SEED_RADIUS = 0.15  # m: grid points this near to the ends of paths are free in any case


class Guide(NamedTuple):
    """Durations to the goal for the axle, as far as they have been computed."""

    gaps: Field  # (rows, columns) m: distance to obstacles, at most what matters
    origin: Array  # (2,) m
    left: Field  # (rows, columns) s; inf where not computed, or no path
    settled: NDArray[np.bool_]  # (rows, columns)
    onward: NDArray[np.int32]  # (rows, columns): the next grid point, itself at the goal
    heap: Heap  # of grid points, by their duration left
    radius: float  # m: of the disc about the axle
    motion: MotionCost


@borrowing_kernel
def _rasterize_segments(
    segments: Array, origin: Array, spacing: float, gaps: Field, nearest: NDArray[np.int32]
) -> None:
    """Write the nearest segment, and its distance, where it passes within two grid points."""
    rows, columns = gaps.shape
    maximum = 2.0 * spacing
    for k in range(segments.shape[0]):
        ax, ay, bx, by = segments[k]
        low_i = max(0, math.ceil((min(ay, by) - maximum - origin[1]) / spacing))
        high_i = min(rows - 1, int((max(ay, by) + maximum - origin[1]) / spacing))
        low_j = max(0, math.ceil((min(ax, bx) - maximum - origin[0]) / spacing))
        high_j = min(columns - 1, int((max(ax, bx) + maximum - origin[0]) / spacing))
        for i in range(low_i, high_i + 1):
            for j in range(low_j, high_j + 1):
                x, y = origin[0] + j * spacing, origin[1] + i * spacing
                gap = np.float32(point_segment_distance(x, y, ax, ay, bx, by))
                if gap < gaps[i, j]:
                    gaps[i, j], nearest[i, j] = gap, k


@borrowing_kernel
def _propagate_nearest(
    segments: Array, origin: Array, spacing: float, gaps: Field, nearest: NDArray[np.int32]
) -> None:
    """Hand the nearest segments on from point to point, there and back (Danielsson 1980)."""
    rows, columns = gaps.shape
    for turn in range(2):
        sign = 1 - 2 * turn
        for m in range(rows):
            i = m if turn == 0 else rows - 1 - m
            for again in range(2):
                for n in range(columns):
                    j = n if again == 0 else columns - 1 - n
                    x, y = origin[0] + j * spacing, origin[1] + i * spacing
                    last = -1
                    for part in range(4):  # beside it, and the three of the row before
                        r = i if part == 0 else i - sign
                        c = (j - 1 if again == 0 else j + 1) if part == 0 else j + part - 2
                        if r < 0 or r >= rows or c < 0 or c >= columns or (again and part > 0):
                            continue
                        k = nearest[r, c]
                        if k < 0 or k == last or k == nearest[i, j]:
                            continue
                        last = k
                        ax, ay, bx, by = segments[k]
                        gap = np.float32(point_segment_distance(x, y, ax, ay, bx, by))
                        if gap < gaps[i, j]:
                            gaps[i, j], nearest[i, j] = gap, k


def distance_field(space: Space, maximum: float, spacing: float = SPACING) -> Field:
    """Return distances (rows, columns) [m] from grid points to obstacles, at most `maximum`.

    If three segments have about the same distance, the one found may be slightly farther.
    """
    arrays = space.arrays
    low, high = arrays.bounds[:2].copy(), arrays.bounds[2:]
    columns, rows = (int(n) for n in np.ceil(np.maximum(high - low, 0.0) / spacing) + 1)
    gaps = np.full((rows, columns), maximum, dtype=np.float32)
    nearest = np.full((rows, columns), -1, dtype=np.int32)
    _rasterize_segments(arrays.segments, low, spacing, gaps, nearest)
    _propagate_nearest(arrays.segments, low, spacing, gaps, nearest)
    return gaps


def new_guide(seeds: Array, gaps: Field, origin: Array, motion: MotionCost) -> Guide:
    """Return a guide to seeds (k, 3): x, y [m], and the duration left from there [s]."""
    more = len(seeds) * (2 * int(SEED_RADIUS / SPACING) + 3) ** 2
    guide = Guide(
        gaps, origin, np.full(gaps.shape, np.inf, np.float32), np.zeros(gaps.shape, np.bool_),
        np.empty(gaps.shape, np.int32), new_heap(8 * gaps.size + more),
        float(motion.outline.min()), motion,
    )  # fmt: skip
    _seed(guide, seeds)
    return guide


@borrowing_kernel
def _grid_point(guide: Guide, x: float, y: float) -> tuple[int, int]:
    row = int((y - guide.origin[1]) / SPACING + 0.5)
    return row, int((x - guide.origin[0]) / SPACING + 0.5)


@borrowing_kernel
def _seed(guide: Guide, seeds: Array) -> None:
    rows, columns = guide.gaps.shape
    reach = int(SEED_RADIUS / SPACING) + 1
    for k in range(seeds.shape[0]):
        row, column = _grid_point(guide, seeds[k, 0], seeds[k, 1])
        for i in range(max(0, row - reach), min(rows, row + reach + 1)):
            for j in range(max(0, column - reach), min(columns, column + reach + 1)):
                dx = guide.origin[0] + j * SPACING - seeds[k, 0]
                dy = guide.origin[1] + i * SPACING - seeds[k, 1]
                far = math.hypot(dx, dy)
                key = np.float32(seeds[k, 2] + far / guide.motion.forward)
                if far <= SEED_RADIUS and key < guide.left[i, j]:
                    guide.left[i, j] = key
                    guide.onward[i, j] = i * columns + j
                    push(guide.heap, float(key), i * columns + j)


@borrowing_kernel
def cost_to_go(guide: Guide, x: float, y: float) -> float:
    """Return the duration [s] from a place to the goal; infinite if the disc does not pass."""
    rows, columns = guide.gaps.shape
    row, column = _grid_point(guide, x, y)
    if row < 0 or column < 0 or row >= rows or column >= columns:
        return math.inf
    if guide.settled[row, column]:
        return float(guide.left[row, column])
    minimum = guide.radius + guide.motion.margin - ROUNDING
    if guide.gaps[row, column] < minimum and guide.left[row, column] == math.inf:
        return math.inf
    heap, left, settled, motion = guide.heap, guide.left, guide.settled, guide.motion
    while heap.size[0] > 0 and not settled[row, column]:
        item = pop(heap)
        i, j = item // columns, item % columns
        if settled[i, j]:
            continue
        settled[i, j] = True
        here = float(left[i, j])
        for di in range(-1, 2):
            for dj in range(-1, 2):
                r, c = i + di, j + dj
                if r < 0 or c < 0 or r >= rows or c >= columns or settled[r, c]:
                    continue
                gap = float(guide.gaps[r, c])
                if gap < minimum:
                    continue
                short = min(1.0, max(0.0, 1.0 - (gap - guide.radius) / motion.desired_clearance))
                way = SPACING * (math.sqrt(2.0) if di != 0 and dj != 0 else 1.0)
                factor = 1.0 + motion.obstacle_weight * short * short
                key = np.float32(here + way / motion.forward * factor)
                if key < left[r, c]:
                    left[r, c] = key
                    guide.onward[r, c] = item
                    push(heap, float(key), r * columns + c)
    return float(left[row, column]) if settled[row, column] else math.inf


@borrowing_kernel
def heading_error(guide: Guide, x: float, y: float, yaw: float) -> float:
    """Return the difference [rad] of a heading from the direction of the path ahead of a place.

    The duration left from there must be known. Near the goal it is 0.
    """
    columns = guide.gaps.shape[1]
    row, column = _grid_point(guide, x, y)
    for _ in range(LOOKAHEAD):
        item = guide.onward[row, column]
        row, column = item // columns, item % columns
    dx = guide.origin[0] + column * SPACING - x
    dy = guide.origin[1] + row * SPACING - y
    if dx * dx + dy * dy < MIN_AIM * MIN_AIM:
        return 0.0
    return abs(wrap(math.atan2(dy, dx) - yaw))
