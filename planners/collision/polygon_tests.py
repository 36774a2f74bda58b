"""Exact tests of points and edges against polygons, and the distance to them, as kernels.

They are exact for the given numbers, since the orientation predicate `orient2d` is. A uniform grid
of buckets holds the segments near each cell, and whether its lower left corner is free, so a test
reads few segments.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.base.arrays import Array, Mask
from wheelchair_gym.compiled.kernel import as_int, borrowing_kernel, kernel
from wheelchair_gym.geometry.planar import point_segment_distance

Index = NDArray[np.int64]
Members = NDArray[np.int32]


class SpaceArrays(NamedTuple):
    """A space as kernels take it."""

    bounds: Array  # (4,) xmin, ymin, xmax, ymax [m] of free space
    segments: Array  # (n, 4) x0, y0, x1, y1 [m]: the boundary, the solid on its left
    before: Array  # (n, 2) m: the corner before (x0, y0)
    grid: Array  # (3,) m: lower left corner of the buckets, their side
    first: Index  # (rows * columns + 1,): begin of each bucket's members
    members: Members  # indices of segments, bucket by bucket
    corner_free: NDArray[np.bool_]  # (rows, columns): whether a bucket's lower left corner is free


@borrowing_kernel
def _two_product(a: float, b: float) -> tuple[float, float]:
    """Return the product of a and b as the exact sum of two doubles (Dekker 1971)."""
    p = a * b
    t = 134217729.0 * a
    ah = t - (t - a)
    t = 134217729.0 * b
    bh = t - (t - b)
    al, bl = a - ah, b - bh
    return p, ((ah * bh - p) + ah * bl + al * bh) + al * bl


@borrowing_kernel
def _two_diff(a: float, b: float) -> tuple[float, float]:
    """Return the difference a - b as the exact sum of two doubles (Knuth)."""
    d = a - b
    t = d - a
    return d, (a - (d - t)) - (b + t)


@borrowing_kernel
def _orient2d_extended(ax: float, ay: float, bx: float, by: float, cx: float, cy: float) -> float:
    """Return `orient2d` in double-double arithmetic."""
    ux, ux_low = _two_diff(bx, ax)
    uy, uy_low = _two_diff(by, ay)
    vx, vx_low = _two_diff(cx, ax)
    vy, vy_low = _two_diff(cy, ay)
    p, p_low = _two_product(ux, vy)
    q, q_low = _two_product(uy, vx)
    low = (p_low - q_low) + ((ux * vy_low + ux_low * vy) - (uy * vx_low + uy_low * vx))
    return (p - q) + low


@borrowing_kernel
def orient2d(ax: float, ay: float, bx: float, by: float, cx: float, cy: float) -> float:
    """Return a positive number if c is left of the line from a to b, a negative one if right, or 0.

    Double precision decides, or double-double where rounding could decide the sign.
    """
    p, q = (bx - ax) * (cy - ay), (by - ay) * (cx - ax)
    area = p - q
    if abs(area) > 4e-16 * (abs(p) + abs(q)) or (p == 0.0 and q == 0.0):
        return area
    return _orient2d_extended(ax, ay, bx, by, cx, cy)


@borrowing_kernel
def enters_solid(
    px: float, py: float, cx: float, cy: float, dx: float, dy: float, tx: float, ty: float
) -> bool:
    """Return whether the line from a corner c (after p, before d) towards t enters the solid."""
    left = orient2d(cx, cy, dx, dy, tx, ty)
    if left > 0.0 and orient2d(cx, cy, px, py, tx, ty) < 0.0:
        return True
    turn = orient2d(px, py, cx, cy, dx, dy)
    if turn == 0.0:
        return left > 0.0
    return turn < 0.0 and (left > 0.0 or orient2d(cx, cy, px, py, tx, ty) < 0.0)


@borrowing_kernel
def _left_of(segments: Array, k: int, x: float, y: float) -> bool:
    """Return whether (x, y), moved right and, by far less, up, is left of a segment."""
    ax, ay, bx, by = segments[k, 0], segments[k, 1], segments[k, 2], segments[k, 3]
    area = orient2d(ax, ay, bx, by, x, y)
    return area > 0.0 or (area == 0.0 and (by < ay or (by == ay and bx > ax)))


@borrowing_kernel
def _free_inside(
    segments: Array, near: Members, x0: float, y0: float, x: float, y: float, free: bool
) -> bool:
    """Return whether (x, y) of a bucket is free, from its lower left corner: first up, then right.

    All points are moved right and, by far less, up, so that none lies on a boundary or in line
    with a corner; then the answer changes exactly where a leg crosses a segment.
    """
    for k in near:
        if (segments[k, 0] <= x0) != (segments[k, 2] <= x0):
            free ^= _left_of(segments, k, x0, y0) != _left_of(segments, k, x0, y)
        if (segments[k, 1] <= y) != (segments[k, 3] <= y):
            free ^= _left_of(segments, k, x0, y) != _left_of(segments, k, x, y)
    return free


@borrowing_kernel
def _on_boundary(segments: Array, near: Members, x: float, y: float) -> bool:
    for k in near:
        ax, ay, bx, by = segments[k, 0], segments[k, 1], segments[k, 2], segments[k, 3]
        if (
            min(ax, bx) <= x <= max(ax, bx)
            and min(ay, by) <= y <= max(ay, by)
            and orient2d(ax, ay, bx, by, x, y) == 0.0
        ):
            return True
    return False


@borrowing_kernel
def point_free(arrays: SpaceArrays, x: float, y: float) -> bool:
    """Return whether a point [m] is free; on a boundary it is. NaN is not."""
    bounds, grid = arrays.bounds, arrays.grid
    if not (bounds[0] <= x <= bounds[2] and bounds[1] <= y <= bounds[3]):
        return False
    left, low, size = grid[0], grid[1], grid[2]
    rows, columns = arrays.corner_free.shape
    i, j = min(rows - 1, int((y - low) / size)), min(columns - 1, int((x - left) / size))
    bucket = i * columns + j
    near = arrays.members[arrays.first[bucket] : arrays.first[bucket + 1]]
    x0, y0 = left + j * size, low + i * size
    if _free_inside(arrays.segments, near, x0, y0, x, y, arrays.corner_free[i, j]):
        return True
    return _on_boundary(arrays.segments, near, x, y)


@borrowing_kernel
def blocks(
    segments: Array, before: Array, k: int, ax: float, ay: float, bx: float, by: float
) -> bool:
    """Return whether segment k blocks the edge from a to b."""
    low_x, high_x, low_y, high_y = min(ax, bx), max(ax, bx), min(ay, by), max(ay, by)
    cx, cy, dx, dy = segments[k, 0], segments[k, 1], segments[k, 2], segments[k, 3]
    if max(cx, dx) < low_x or min(cx, dx) > high_x:
        return False
    if max(cy, dy) < low_y or min(cy, dy) > high_y:
        return False
    c, d = orient2d(ax, ay, bx, by, cx, cy), orient2d(ax, ay, bx, by, dx, dy)
    if (c > 0.0 and d > 0.0) or (c < 0.0 and d < 0.0):
        return False
    if c != 0.0 and d != 0.0:  # a and b on one side, or do they meet, from or to the solid?
        a, b = orient2d(cx, cy, dx, dy, ax, ay), orient2d(cx, cy, dx, dy, bx, by)
        return (a > 0.0 and b <= 0.0) or (b > 0.0 and a <= 0.0)
    if c == 0.0 and low_x <= cx <= high_x and low_y <= cy <= high_y:
        px, py = before[k, 0], before[k, 1]
        if (cx != ax or cy != ay) and enters_solid(px, py, cx, cy, dx, dy, ax, ay):
            return True
        return (cx != bx or cy != by) and enters_solid(px, py, cx, cy, dx, dy, bx, by)
    return False


@borrowing_kernel
def blocking_segment(arrays: SpaceArrays, ax: float, ay: float, bx: float, by: float) -> int:
    """Return a segment that blocks the edge from a free point a to b [m].

    It is -1 if the edge is free, -2 if b lies outside the map.
    """
    bounds, grid = arrays.bounds, arrays.grid
    if not (bounds[0] <= bx <= bounds[2] and bounds[1] <= by <= bounds[3]):
        return -2
    segments, before, first, members = arrays.segments, arrays.before, arrays.first, arrays.members
    rows, columns = arrays.corner_free.shape
    left, low, size = grid[0], grid[1], grid[2]
    i, j = min(rows - 1, int((ay - low) / size)), min(columns - 1, int((ax - left) / size))
    last_i = min(rows - 1, int((by - low) / size))
    last_j = min(columns - 1, int((bx - left) / size))
    # From bucket to bucket (Amanatides and Woo 1987). Buckets hold what comes near them, so that
    # rounding may choose either way round a corner.
    step_i, step_j = (1 if last_i > i else -1), (1 if last_j > j else -1)
    per_x = size / abs(bx - ax) if j != last_j else math.inf
    per_y = size / abs(by - ay) if i != last_i else math.inf
    next_x = (left + (j + (step_j > 0)) * size - ax) / (bx - ax) if j != last_j else math.inf
    next_y = (low + (i + (step_i > 0)) * size - ay) / (by - ay) if i != last_i else math.inf
    while True:
        for place in range(first[i * columns + j], first[i * columns + j + 1]):
            k: int = as_int(members[place])
            if blocks(segments, before, k, ax, ay, bx, by):
                return k
        if i == last_i and j == last_j:
            return -1
        if i == last_i or (j != last_j and next_x < next_y):
            j += step_j
            next_x += per_x
        else:
            i += step_i
            next_y += per_y


@borrowing_kernel
def way_free(arrays: SpaceArrays, ax: float, ay: float, bx: float, by: float) -> bool:
    """Return whether the edge from a free point a to b [m] is free."""
    return blocking_segment(arrays, ax, ay, bx, by) == -1


@borrowing_kernel
def edge_free(arrays: SpaceArrays, ax: float, ay: float, bx: float, by: float) -> bool:
    """Return whether the edge from a to b [m] is free; it may touch obstacles."""
    return point_free(arrays, ax, ay) and way_free(arrays, ax, ay, bx, by)


@kernel
def blocked_edges(arrays: SpaceArrays, path: Array) -> Mask:
    """Return which edges (n - 1,) of a path (n, 2) [m] are not free."""
    blocked = np.empty(path.shape[0] - 1, dtype=np.bool_)
    for k in range(path.shape[0] - 1):
        free = edge_free(arrays, path[k, 0], path[k, 1], path[k + 1, 0], path[k + 1, 1])
        blocked[k] = not free
    return blocked


@borrowing_kernel
def clearance(arrays: SpaceArrays, x: float, y: float) -> float:
    """Return the distance [m] from a point to the boundary or the map's border; 0 if not free."""
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


@borrowing_kernel
def fill_buckets(
    segments: Array, grid: Array, rows: int, columns: int, first: Index, members: Members
) -> None:
    """Count each bucket's segments in `first`, or, if `members` is not empty, write them there."""
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


@borrowing_kernel
def mark_free_corners(arrays: SpaceArrays) -> None:
    """Set `corner_free`: the first corner lies outside the map, each other follows from one."""
    free, (left, low, size) = arrays.corner_free, arrays.grid
    rows, columns = free.shape
    for k in range(1, rows * columns):
        i, j = k // columns, k % columns
        r, c = (i, j - 1) if j > 0 else (i - 1, 0)  # from the left, or from below
        bucket = r * columns + c
        near = arrays.members[arrays.first[bucket] : arrays.first[bucket + 1]]
        x0, y0, x, y = left + c * size, low + r * size, left + j * size, low + i * size
        free[i, j] = _free_inside(arrays.segments, near, x0, y0, x, y, free[r, c])
