"""Exact tests of points and edges against polygons, and the distance to them, as kernels.

Exact for the numbers given: signs of areas are computed in double, and once more with twice the
digits where rounding could decide. A uniform grid of buckets holds the segments near each cell,
and whether the cell's lower left corner is free, so a test looks at a few segments.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.geometry import point_segment_distance
from wheelchair_gym.kernel import kernel

Array = NDArray[np.float64]


class SpaceArrays(NamedTuple):
    """A space as kernels take it."""

    bounds: Array  # (4,) xmin, ymin, xmax, ymax [m] of what is free
    segments: Array  # (n, 4) x0, y0, x1, y1 [m]: the boundary, what is solid on its left
    before: Array  # (n, 2) m: the corner before (x0, y0)
    grid: Array  # (3,) m: lower left corner of the buckets, their side
    first: NDArray[np.int64]  # (rows * columns + 1,): where each bucket's members begin
    members: NDArray[np.int32]  # indices of segments, bucket by bucket
    corner_free: NDArray[np.bool_]  # (rows, columns): is each bucket's lower left corner free


@kernel
def _product(a: float, b: float) -> tuple[float, float]:
    """Product of a and b as the sum of two doubles, exactly (Dekker 1971)."""
    p = a * b
    t = 134217729.0 * a
    ah = t - (t - a)
    t = 134217729.0 * b
    bh = t - (t - b)
    al, bl = a - ah, b - bh
    return p, ((ah * bh - p) + ah * bl + al * bh) + al * bl


@kernel
def _difference(a: float, b: float) -> tuple[float, float]:
    """Difference a - b as the sum of two doubles, exactly (Knuth)."""
    d = a - b
    t = d - a
    return d, (a - (d - t)) - (b + t)


@kernel
def _side_of_doubt(ax: float, ay: float, bx: float, by: float, cx: float, cy: float) -> float:
    """`side` with twice the digits."""
    ux, ux_low = _difference(bx, ax)
    uy, uy_low = _difference(by, ay)
    vx, vx_low = _difference(cx, ax)
    vy, vy_low = _difference(cy, ay)
    p, p_low = _product(ux, vy)
    q, q_low = _product(uy, vx)
    low = (p_low - q_low) + ((ux * vy_low + ux_low * vy) - (uy * vx_low + uy_low * vx))
    return (p - q) + low


@kernel
def side(ax: float, ay: float, bx: float, by: float, cx: float, cy: float) -> float:
    """Positive if c lies left of the line from a to b, negative if right, 0 if exactly on it."""
    p, q = (bx - ax) * (cy - ay), (by - ay) * (cx - ax)
    area = p - q
    if abs(area) > 4e-16 * (abs(p) + abs(q)) or (p == 0.0 and q == 0.0):
        return area
    return _side_of_doubt(ax, ay, bx, by, cx, cy)


@kernel
def into_solid(
    px: float, py: float, cx: float, cy: float, dx: float, dy: float, tx: float, ty: float
) -> bool:
    """Whether the way from a corner c (after p, before d) towards t enters what is solid."""
    left = side(cx, cy, dx, dy, tx, ty)
    if left > 0.0 and side(cx, cy, px, py, tx, ty) < 0.0:
        return True
    turn = side(px, py, cx, cy, dx, dy)
    if turn == 0.0:
        return left > 0.0
    return turn < 0.0 and (left > 0.0 or side(cx, cy, px, py, tx, ty) < 0.0)


@kernel
def _left_of(segments: Array, k: int, x: float, y: float) -> bool:
    """Whether (x, y) lies left of a segment, moved right and, by far less, up: never on it."""
    ax, ay, bx, by = segments[k, 0], segments[k, 1], segments[k, 2], segments[k, 3]
    area = side(ax, ay, bx, by, x, y)
    return area > 0.0 or (area == 0.0 and (by < ay or (by == ay and bx > ax)))


@kernel
def _free_inside(arrays: SpaceArrays, bucket: int, x: float, y: float, free: bool) -> bool:
    """Whether (x, y) of a bucket is free, from its lower left corner: up first, then right.

    All points are moved right and, by far less, up, so that none lies on a boundary or in line
    with a corner; then the answer changes exactly where a leg crosses a segment.
    """
    segments = arrays.segments
    columns = arrays.corner_free.shape[1]
    x0 = arrays.grid[0] + (bucket % columns) * arrays.grid[2]
    y0 = arrays.grid[1] + (bucket // columns) * arrays.grid[2]
    for m in range(arrays.first[bucket], arrays.first[bucket + 1]):
        k = arrays.members[m]
        if (segments[k, 0] <= x0) != (segments[k, 2] <= x0) and (
            _left_of(segments, k, x0, y0) != _left_of(segments, k, x0, y)
        ):
            free = not free
        if (segments[k, 1] <= y) != (segments[k, 3] <= y) and (
            _left_of(segments, k, x0, y) != _left_of(segments, k, x, y)
        ):
            free = not free
    return free


@kernel
def _on_boundary(arrays: SpaceArrays, bucket: int, x: float, y: float) -> bool:
    segments = arrays.segments
    for m in range(arrays.first[bucket], arrays.first[bucket + 1]):
        k = arrays.members[m]
        ax, ay, bx, by = segments[k, 0], segments[k, 1], segments[k, 2], segments[k, 3]
        if (
            min(ax, bx) <= x <= max(ax, bx)
            and min(ay, by) <= y <= max(ay, by)
            and side(ax, ay, bx, by, x, y) == 0.0
        ):
            return True
    return False


@kernel
def point_free(arrays: SpaceArrays, x: float, y: float) -> bool:
    """Whether a point [m] is free; on a boundary it is. NaN is not."""
    bounds, grid = arrays.bounds, arrays.grid
    if not (bounds[0] <= x <= bounds[2] and bounds[1] <= y <= bounds[3]):
        return False
    rows, columns = arrays.corner_free.shape
    i = min(rows - 1, int((y - grid[1]) / grid[2]))
    j = min(columns - 1, int((x - grid[0]) / grid[2]))
    bucket = i * columns + j
    return _free_inside(arrays, bucket, x, y, arrays.corner_free[i, j]) or _on_boundary(
        arrays, bucket, x, y
    )


@kernel
def _blocked_in(
    arrays: SpaceArrays, bucket: int, ax: float, ay: float, bx: float, by: float
) -> bool:
    """Whether a segment of a bucket stops the edge from a to b."""
    segments, before = arrays.segments, arrays.before
    low_x, high_x, low_y, high_y = min(ax, bx), max(ax, bx), min(ay, by), max(ay, by)
    for m in range(arrays.first[bucket], arrays.first[bucket + 1]):
        k = arrays.members[m]
        cx, cy, dx, dy = segments[k, 0], segments[k, 1], segments[k, 2], segments[k, 3]
        if max(cx, dx) < low_x or min(cx, dx) > high_x:
            continue
        if max(cy, dy) < low_y or min(cy, dy) > high_y:
            continue
        c, d = side(ax, ay, bx, by, cx, cy), side(ax, ay, bx, by, dx, dy)
        if (c > 0.0 and d > 0.0) or (c < 0.0 and d < 0.0):
            continue
        a, b = side(cx, cy, dx, dy, ax, ay), side(cx, cy, dx, dy, bx, by)
        if (a > 0.0 and b > 0.0) or (a < 0.0 and b < 0.0):
            continue
        if c != 0.0 and d != 0.0:  # they meet between c and d: from or to the solid side?
            if a > 0.0 or b > 0.0:
                return True
        elif c == 0.0 and low_x <= cx <= high_x and low_y <= cy <= high_y:
            px, py = before[k, 0], before[k, 1]
            if (cx != ax or cy != ay) and into_solid(px, py, cx, cy, dx, dy, ax, ay):
                return True
            if (cx != bx or cy != by) and into_solid(px, py, cx, cy, dx, dy, bx, by):
                return True
    return False


@kernel
def edge_free(arrays: SpaceArrays, ax: float, ay: float, bx: float, by: float) -> bool:
    """Whether the straight way from a to b [m] stays in what is free; touching is allowed."""
    bounds, grid = arrays.bounds, arrays.grid
    if not (bounds[0] <= bx <= bounds[2] and bounds[1] <= by <= bounds[3]):
        return False
    if not point_free(arrays, ax, ay):
        return False
    rows, columns = arrays.corner_free.shape
    size = grid[2]
    i = min(rows - 1, int((ay - grid[1]) / size))
    j = min(columns - 1, int((ax - grid[0]) / size))
    last_i = min(rows - 1, int((by - grid[1]) / size))
    last_j = min(columns - 1, int((bx - grid[0]) / size))
    if _blocked_in(arrays, i * columns + j, ax, ay, bx, by):
        return False
    if i == last_i and j == last_j:
        return True
    # From bucket to bucket (Amanatides and Woo 1987). Buckets hold what comes near them, so that
    # rounding may choose either way round a corner.
    step_i, step_j = (1 if last_i > i else -1), (1 if last_j > j else -1)
    per_x = size / abs(bx - ax) if bx != ax else math.inf
    per_y = size / abs(by - ay) if by != ay else math.inf
    next_x, next_y = math.inf, math.inf
    if j != last_j:
        next_x = (grid[0] + (j + (step_j > 0)) * size - ax) / (bx - ax)
    if i != last_i:
        next_y = (grid[1] + (i + (step_i > 0)) * size - ay) / (by - ay)
    while i != last_i or j != last_j:
        if i == last_i or (j != last_j and next_x < next_y):
            j += step_j
            next_x += per_x
        else:
            i += step_i
            next_y += per_y
        if _blocked_in(arrays, i * columns + j, ax, ay, bx, by):
            return False
    return True


@kernel
def clearance(arrays: SpaceArrays, x: float, y: float) -> float:
    """Distance [m] from a point to the nearest boundary, the map's border too; 0 if not free."""
    if not point_free(arrays, x, y):
        return 0.0
    segments, grid = arrays.segments, arrays.grid
    rows, columns = arrays.corner_free.shape
    size = grid[2]
    i = min(rows - 1, int((y - grid[1]) / size))
    j = min(columns - 1, int((x - grid[0]) / size))
    dx, dy = x - grid[0] - j * size, y - grid[1] - i * size
    margin = min(min(dx, size - dx), min(dy, size - dy))
    best = math.inf
    ring = 0
    while ring <= max(rows, columns) and best > margin + (ring - 1) * size:
        for r in range(max(0, i - ring), min(rows, i + ring + 1)):
            step = 1 if abs(r - i) == ring else max(1, 2 * ring)
            for c in range(j - ring, j + ring + 1, step):
                if c < 0 or c >= columns:
                    continue
                bucket = r * columns + c
                for m in range(arrays.first[bucket], arrays.first[bucket + 1]):
                    k = arrays.members[m]
                    ax, ay, bx, by = segments[k, 0], segments[k, 1], segments[k, 2], segments[k, 3]
                    best = min(best, point_segment_distance(x, y, ax, ay, bx, by))
        ring += 1
    return best


@kernel
def fill_buckets(
    segments: Array,
    grid: Array,
    rows: int,
    columns: int,
    first: NDArray[np.int64],
    members: NDArray[np.int32],
) -> None:
    """Count each bucket's segments in `first`, or, if `members` has room, put them there."""
    size, slack = grid[2], 1e-6 * grid[2]
    for k in range(segments.shape[0]):
        ax, ay = segments[k, 0] - grid[0], segments[k, 1] - grid[1]
        bx, by = segments[k, 2] - grid[0], segments[k, 3] - grid[1]
        length = math.hypot(bx - ax, by - ay)
        nx, ny = (ay - by) / length, (bx - ax) / length
        reach = 0.5 * size * (abs(nx) + abs(ny)) + slack
        for i in range(
            max(0, int((min(ay, by) - slack) / size)),
            min(rows - 1, int((max(ay, by) + slack) / size)) + 1,
        ):
            for j in range(
                max(0, int((min(ax, bx) - slack) / size)),
                min(columns - 1, int((max(ax, bx) + slack) / size)) + 1,
            ):
                gap = nx * ((j + 0.5) * size - ax) + ny * ((i + 0.5) * size - ay)
                if abs(gap) <= reach:
                    bucket = i * columns + j
                    if members.shape[0]:
                        members[first[bucket]] = k
                    first[bucket] += 1


@kernel
def mark_corners(arrays: SpaceArrays) -> None:
    """Set `corner_free`: the first corner lies outside the map, each other follows from one."""
    free, grid = arrays.corner_free, arrays.grid
    rows, columns = free.shape
    size = grid[2]
    for i in range(rows):
        if i > 0:
            below = (i - 1) * columns
            free[i, 0] = _free_inside(arrays, below, grid[0], grid[1] + i * size, free[i - 1, 0])
        for j in range(1, columns):
            x, y = grid[0] + j * size, grid[1] + i * size
            free[i, j] = _free_inside(arrays, i * columns + j - 1, x, y, free[i, j - 1])
