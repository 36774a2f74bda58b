"""The clearance of a chair's outline, exact: walls are ranked as vectors of float32 first."""

from __future__ import annotations

import math

import numpy as np

from wheelchair_gym.arrays import Array, Floats
from wheelchair_gym.compiled.kernel import borrowing_kernel, inlined
from wheelchair_gym.geometry import (
    offsets_from_rectangle,
    outline_segment_gap,
    rectangle_point_gap,
    world_to_body,
)
from wheelchair_gym.sensors.echoes import relative_endpoints

_F = np.float32
_ZERO, _TINY = _F(0.0), _F(1e-3)
_ERROR = _F(4e-6)  # share of its coordinates by which float32 errs about a segment


@borrowing_kernel
def _rank(n: int, ends: Floats, c: np.float32, s: np.float32, box: Array, out: Floats) -> None:
    """Distances of n segments, for `rank_walls`, in vectors."""
    front, back, half = _F(box[0]), _F(-box[1]), _F(box[2])
    middle, long = _F(0.5 * (box[0] - box[1])), _F(0.5 * (box[0] + box[1]))
    for k in range(np.uint64(n)):
        x0, y0, x1, y1 = ends[4 * k], ends[4 * k + 1], ends[4 * k + 2], ends[4 * k + 3]
        ax, ay, bx, by = c * x0 + s * y0, c * y0 - s * x0, c * x1 + s * y1, c * y1 - s * x1
        low_x, high_x = ax if ax < bx else bx, bx if ax < bx else ax
        low_y, high_y = ay if ay < by else by, by if ay < by else ay
        ahead, behind = low_x - front, back - high_x
        left, right = low_y - half, -half - high_y
        dx = ahead if ahead > behind else behind
        dy = left if left > right else right
        dx, dy = dx if dx > _ZERO else _ZERO, dy if dy > _ZERO else _ZERO
        of_box = np.sqrt(dx * dx + dy * dy)
        ex, ey = bx - ax, by - ay
        length = np.sqrt(ex * ex + ey * ey)
        off = abs((ax - middle) * ey - ay * ex) - long * abs(ey) - half * abs(ex)
        of_line = off / (length if length > _TINY else _TINY)
        size = abs(x0) + abs(y0) + abs(x1) + abs(y1)
        out[k] = (of_box if of_box > of_line else of_line) - _ERROR * size


@inlined
def distances_in(workspace: Floats) -> Floats:
    """The row of a workspace to which `rank_walls` and `rank_discs` write."""
    width = workspace.shape[1]
    return workspace.reshape(workspace.size)[4 * width : 5 * width]


@borrowing_kernel
def rank_walls(
    x: float, y: float, yaw: float, outline: Array, walls: Array, workspace: Floats
) -> None:
    """Write of each wall a distance [m] that it has at least from an outline (3,) at a pose.

    It is that of its bounding box in the outline's frame, or of its line. `workspace` has at least
    five rows, and a column for each wall and disc.
    """
    ends = workspace.reshape(workspace.size)[: 4 * workspace.shape[1]]
    relative_endpoints(walls, x, y, ends)
    near = distances_in(workspace)
    _rank(walls.shape[0], ends, _F(math.cos(yaw)), _F(math.sin(yaw)), outline, near)


@borrowing_kernel
def rank_discs(
    x: float, y: float, yaw: float, outline: Array, discs: Array, workspace: Floats
) -> None:
    """`rank_walls`, of discs (n, 3) [m]: x, y, radius."""
    near = distances_in(workspace)
    front, back, half = outline[0], -outline[1], outline[2]
    c, s = math.cos(yaw), math.sin(yaw)
    for k in range(np.uint64(discs.shape[0])):
        dx, dy = discs[k, 0] - x, discs[k, 1] - y
        px, py = world_to_body(c, s, dx, dy)
        ex, ey = offsets_from_rectangle(px, py, front, back, half)
        size = abs(dx) + abs(dy) + discs[k, 2]
        near[k] = _F(math.sqrt(ex * ex + ey * ey) - discs[k, 2]) - _ERROR * _F(size)


@borrowing_kernel
def outline_clearance(
    pose: Array, outline: Array, walls: Array, discs: Array, reach: float, workspace: Floats
) -> float:
    """`geometry.footprint_clearance` of a pose (3,) [m, m, rad], to the bit, and faster.

    `workspace` is that of `rank_walls`.
    """
    n, x, y = walls.shape[0], pose[0], pose[1]
    c, s = math.cos(pose[2]), math.sin(pose[2])
    rank_walls(x, y, pose[2], outline, walls, workspace)
    near = distances_in(workspace)
    gap, first, least = reach, 0, _F(reach)
    for k in range(n):
        if near[k] < least:
            least, first = near[k], k
    for j in range(-1 if n > 0 else 0, n):  # the most promising one first
        k = first if j < 0 else j
        if near[k] > gap:
            continue
        px, py = world_to_body(c, s, walls[k, 0] - x, walls[k, 1] - y)
        qx, qy = world_to_body(c, s, walls[k, 2] - x, walls[k, 3] - y)
        gap = min(gap, outline_segment_gap(outline, px, py, qx, qy))
    rank_discs(x, y, pose[2], outline, discs, workspace)
    for k in range(discs.shape[0]):
        if near[k] > gap:
            continue
        px, py = world_to_body(c, s, discs[k, 0] - x, discs[k, 1] - y)
        gap = min(gap, max(0.0, rectangle_point_gap(px, py, outline) - discs[k, 2]))
    return gap
