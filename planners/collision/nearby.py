"""The parts of a map's boundary near a position, and in the frame of a pose there."""

import math
from typing import NamedTuple

import numpy as np

from planners.collision.polygon_tests import Index, Members
from planners.collision.space import Space
from wheelchair_gym.base.arrays import Array
from wheelchair_gym.compiled.kernel import borrowing_kernel, kernel
from wheelchair_gym.geometry.planar import point_segment_distance, wrap

CELL = 0.25  # m: squares of positions that share one list of runs
RUN = 0.2  # m: a run of segments is at most this wide and high
OPPOSITE = -0.5  # cosine: the other side lies at least 120 deg from the nearest point


class Nearby(NamedTuple):
    """The parts of a map's boundary near each cell of a coarse grid.

    Successive short segments form runs: discs have many.
    """

    segments: Array  # (n, 4) m
    runs: Members  # (k + 1,): the first segment of each run
    spines: Array  # (k, 5) m: a line and the largest distance of a run from it
    box: Array  # (4,) m: xmin, ymin, xmax, ymax of the map
    origin: Array  # (2,) m: lower left corner of the cells
    columns: int
    first: Index  # (cells + 1,): begin of each cell's members
    members: Members  # indices of runs, cell by cell


@borrowing_kernel
def _gather(segments: Array, runs: Members, spines: Array) -> int:
    """Write runs and their spines; return their number."""
    count = 0
    low_x, low_y, high_x, high_y = 0.0, 0.0, 0.0, 0.0
    for k in range(segments.shape[0]):
        ax, ay, bx, by = segments[k, 0], segments[k, 1], segments[k, 2], segments[k, 3]
        left, low = min(min(ax, bx), low_x), min(min(ay, by), low_y)
        right, high = max(max(ax, bx), high_x), max(max(ay, by), high_y)
        if k > runs[max(0, count - 1)] and count > 0 and max(right - left, high - low) <= RUN:
            low_x, low_y, high_x, high_y = left, low, right, high
            spine = spines[count - 1]
            spine[0] = spine[2] = 0.5 * (left + right)
            spine[1] = spine[3] = 0.5 * (low + high)
            spine[4] = 0.5 * math.hypot(right - left, high - low)
            continue
        low_x, low_y, high_x, high_y = min(ax, bx), min(ay, by), max(ax, bx), max(ay, by)
        runs[count] = k
        for axis in range(4):
            spines[count, axis] = segments[k, axis]
        spines[count, 4] = 0.0
        count += 1
    runs[count] = segments.shape[0]
    return count


@borrowing_kernel
def _list_near(
    spines: Array, origin: Array, rows: int, columns: int, reach: float, first: Index,
    members: Members,
) -> None:  # fmt: skip
    """Count each cell's runs in `first`, or, if `members` is not empty, write them there."""
    for k in range(spines.shape[0]):
        ax, ay, bx, by = spines[k, 0], spines[k, 1], spines[k, 2], spines[k, 3]
        far = reach + spines[k, 4] + CELL / math.sqrt(2.0)  # from the cell's centre
        low_i = max(0, int((min(ay, by) - far - origin[1]) / CELL))
        high_i = min(rows - 1, int((max(ay, by) + far - origin[1]) / CELL))
        low_j = max(0, int((min(ax, bx) - far - origin[0]) / CELL))
        high_j = min(columns - 1, int((max(ax, bx) + far - origin[0]) / CELL))
        for i in range(low_i, high_i + 1):
            for j in range(low_j, high_j + 1):
                x, y = origin[0] + (j + 0.5) * CELL, origin[1] + (i + 0.5) * CELL
                if point_segment_distance(x, y, ax, ay, bx, by) <= far:
                    if members.shape[0]:
                        members[first[i * columns + j]] = k
                    first[i * columns + j] += 1


def nearby(space: Space, reach: float) -> Nearby:
    """Return the parts of a space's boundary within a reach [m] of each cell of its map."""
    arrays = space.arrays
    low, high = arrays.bounds[:2].copy(), arrays.bounds[2:]
    runs, spines = np.empty(len(arrays.segments) + 1, np.int32), np.empty((len(arrays.segments), 5))
    count = _gather(arrays.segments, runs, spines)
    runs, spines = runs[: count + 1].copy(), spines[:count].copy()
    columns, rows = (int(n) for n in np.maximum((high - low) / CELL, 0.0).astype(np.int64) + 1)
    counts = np.zeros(rows * columns, dtype=np.int64)
    _list_near(spines, low, rows, columns, reach, counts, np.empty(0, dtype=np.int32))
    first = np.concatenate([[0], np.cumsum(counts)])
    members = np.empty(first[-1], dtype=np.int32)
    _list_near(spines, low, rows, columns, reach, first[:-1].copy(), members)
    return Nearby(arrays.segments, runs, spines, arrays.bounds, low, columns, first, members)


@borrowing_kernel
def segments_in_view(
    near: Nearby, x: float, y: float, yaw: float, box: Array, enough: float, seen: Array
) -> int:
    """Write the segments within `enough` [m] of a box at a pose [m, m, rad] on the map.

    The box (xmin, ymin, xmax, ymax) and the segments (k, 4), written to `seen`, are in the chair's
    frame. Returns their number.
    """
    cell = int((y - near.origin[1]) / CELL) * near.columns + int((x - near.origin[0]) / CELL)
    c, s = math.cos(yaw), math.sin(yaw)
    count = 0
    low_x, low_y, high_x, high_y = (
        box[0] - enough, box[1] - enough, box[2] + enough, box[3] + enough,
    )  # fmt: skip
    for m in range(near.first[cell], near.first[cell + 1]):
        run = near.members[m]
        ax, ay = near.spines[run, 0] - x, near.spines[run, 1] - y
        bx, by, wide = near.spines[run, 2] - x, near.spines[run, 3] - y, near.spines[run, 4]
        px, qx = c * ax + s * ay, c * bx + s * by
        if max(px, qx) + wide < low_x or min(px, qx) - wide > high_x:
            continue
        py, qy = c * ay - s * ax, c * by - s * bx
        if max(py, qy) + wide < low_y or min(py, qy) - wide > high_y:
            continue
        for k in range(near.runs[run], near.runs[run + 1]):
            ax, ay = near.segments[k, 0] - x, near.segments[k, 1] - y
            bx, by = near.segments[k, 2] - x, near.segments[k, 3] - y
            px, qx = c * ax + s * ay, c * bx + s * by
            if max(px, qx) < low_x or min(px, qx) > high_x:
                continue
            py, qy = c * ay - s * ax, c * by - s * bx
            if max(py, qy) < low_y or min(py, qy) > high_y:
                continue
            seen[count, 0], seen[count, 1], seen[count, 2], seen[count, 3] = px, py, qx, qy
            count += 1
    return count


@borrowing_kernel
def nearest_side(
    near: Nearby, x: float, y: float, ux: float, uy: float, maximum: float
) -> tuple[float, float, float]:
    """Return the nearest boundary point (x, y) in a direction of a cosine to u below `OPPOSITE`.

    With u = 0 any direction counts. The third value is its distance, `maximum` if none is nearer.
    """
    cell = int((y - near.origin[1]) / CELL) * near.columns + int((x - near.origin[0]) / CELL)
    best, bx, by = maximum, x, y
    for m in range(near.first[cell], near.first[cell + 1]):
        run = near.members[m]
        spine = near.spines[run]
        far = point_segment_distance(x, y, spine[0], spine[1], spine[2], spine[3])
        if far - spine[4] >= best:
            continue
        for k in range(near.runs[run], near.runs[run + 1]):
            px, py = near.segments[k, 0] - x, near.segments[k, 1] - y
            ex, ey = near.segments[k, 2] - x - px, near.segments[k, 3] - y - py
            square = ex * ex + ey * ey
            t = min(1.0, max(0.0, -(px * ex + py * ey) / square)) if square > 0.0 else 0.0
            dx, dy = px + t * ex, py + t * ey
            far = math.hypot(dx, dy)
            if far < best and dx * ux + dy * uy <= OPPOSITE * far * math.hypot(ux, uy):
                best, bx, by = far, x + dx, y + dy
    return bx, by, best


_STEPS = 6  # to the middle of a passage at most
_ASTRAY = 0.5  # m: a middle that is farther from the guide belongs to another passage


@borrowing_kernel
def passage_middle(
    near: Nearby, x: float, y: float, widest: float, settled: float
) -> tuple[float, tuple[float, float, float]]:
    """Return half the width [m] of the passage at a point, and the pose in its middle [m, m, rad].

    The heading is at right angles to the gap. The width is below 0 where the last step to the
    middle is longer than `settled` [m], or the passage at least twice `widest` [m] wide.
    """
    for _ in range(_STEPS):
        ax, ay, first = nearest_side(near, x, y, 0.0, 0.0, 2.0 * widest)
        bx, by, second = nearest_side(near, x, y, ax - x, ay - y, 2.0 * widest)
        if first <= 0.0 or second >= 2.0 * widest:
            break
        mx, my = 0.5 * (ax + bx), 0.5 * (ay + by)
        moved = math.hypot(mx - x, my - y)
        x, y = mx, my
        if moved < settled:
            return 0.5 * math.hypot(bx - ax, by - ay), (x, y, math.atan2(bx - ax, ay - by))
    return -1.0, (x, y, 0.0)


@kernel
def passage_poses(near: Nearby, guide: Array, widest: float) -> Array:
    """Return poses (k, 3) in the middle of the passages of a guide (n, 3), at right angles to them.

    The passage is less than twice `widest` [m] wide.
    """
    poses = np.empty_like(guide)
    n = 0
    for k in range(guide.shape[0]):
        half, (x, y, yaw) = passage_middle(near, guide[k, 0], guide[k, 1], widest, 1e-3)
        if half < 0.0 or math.hypot(x - guide[k, 0], y - guide[k, 1]) > _ASTRAY:
            continue
        if math.cos(yaw - guide[k, 2]) < 0.0:
            yaw += math.pi
        if n == 0 or math.hypot(poses[n - 1, 0] - x, poses[n - 1, 1] - y) > 0.05:
            poses[n, 0], poses[n, 1], poses[n, 2] = x, y, wrap(yaw)
            n += 1
    return poses[:n].copy()
