"""What of a map's boundary lies near a place, and how it looks from a pose there."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from planners.space import Space
from wheelchair_gym.geometry import point_segment_distance
from wheelchair_gym.kernel import borrowing_kernel

Array = NDArray[np.float64]

CELL = 0.25  # m: squares of position that share one list of what is near


class Nearby(NamedTuple):
    """Which segments of a map's boundary lie near each cell of a coarse grid."""

    segments: Array  # (n, 4) m
    box: Array  # (4,) m: xmin, ymin, xmax, ymax of the map
    origin: Array  # (2,) m: lower left corner of the cells
    columns: int
    first: NDArray[np.int64]  # (cells + 1,): where each cell's members begin
    members: NDArray[np.int32]  # indices of segments, cell by cell


@borrowing_kernel
def _list_near(
    segments: Array,
    origin: Array,
    rows: int,
    columns: int,
    reach: float,
    first: NDArray[np.int64],
    members: NDArray[np.int32],
) -> None:
    """Count each cell's segments in `first`, or, if `members` has room, put them there."""
    far = reach + CELL / math.sqrt(2.0)  # from the cell's centre
    for k in range(segments.shape[0]):
        ax, ay, bx, by = segments[k, 0], segments[k, 1], segments[k, 2], segments[k, 3]
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
    """What of a space's boundary lies within a reach [m] of each place on its map."""
    arrays = space.arrays
    low, high = arrays.bounds[:2].copy(), arrays.bounds[2:]
    columns, rows = (int(n) for n in np.maximum((high - low) / CELL, 0.0).astype(np.int64) + 1)
    counts = np.zeros(rows * columns, dtype=np.int64)
    _list_near(arrays.segments, low, rows, columns, reach, counts, np.empty(0, dtype=np.int32))
    first = np.concatenate([[0], np.cumsum(counts)])
    members = np.empty(first[-1], dtype=np.int32)
    _list_near(arrays.segments, low, rows, columns, reach, first[:-1].copy(), members)
    return Nearby(arrays.segments, arrays.bounds, low, columns, first, members)


@borrowing_kernel
def seen_from(
    near: Nearby, x: float, y: float, yaw: float, box: Array, enough: float, seen: Array
) -> int:
    """Write the segments within `enough` of a box (in the chair's frame) at a pose.

    Args:
        near: what lies where.
        x: the pose [m], on the map; then y [m] and yaw [rad].
        y: see x.
        yaw: see x.
        box: xmin, ymin, xmax, ymax [m] in the chair's frame.
        enough: how far beyond the box [m].
        seen: (k, 4) m, where they are written, in the chair's frame.

    Returns:
        How many there are.
    """
    cell = int((y - near.origin[1]) / CELL) * near.columns + int((x - near.origin[0]) / CELL)
    c, s = math.cos(yaw), math.sin(yaw)
    count = 0
    low_x, low_y, high_x, high_y = (
        box[0] - enough, box[1] - enough, box[2] + enough, box[3] + enough,
    )  # fmt: skip
    for m in range(near.first[cell], near.first[cell + 1]):
        k = near.members[m]
        ax, ay = near.segments[k, 0] - x, near.segments[k, 1] - y
        bx, by = near.segments[k, 2] - x, near.segments[k, 3] - y
        px, qx = c * ax + s * ay, c * bx + s * by
        if (px < low_x and qx < low_x) or (px > high_x and qx > high_x):
            continue
        py, qy = c * ay - s * ax, c * by - s * bx
        if (py < low_y and qy < low_y) or (py > high_y and qy > high_y):
            continue
        seen[count, 0], seen[count, 1], seen[count, 2], seen[count, 3] = px, py, qx, qy
        count += 1
    return count
