"""What a footprint sweeps, exactly: the least gap between a moving rectangle and a map's boundary.

A stretch is a way driven while turning at a constant rate: straight, an arc, or a pivot. In the
chair's frame at its beginning the rectangle turns about one point (or moves along x). Then the gap
to a segment is least where a corner's arc comes nearest to it, or where one of its ends comes
nearest to the rectangle; either happens at an end of the stretch or in one of a few directions.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from planners.space import Space
from wheelchair_gym.geometry import (
    Footprint,
    point_segment_distance,
    rectangle_point_gap,
    rectangle_segment_gap,
    wrap,
)
from wheelchair_gym.kernel import borrowing_kernel, kernel

Array = NDArray[np.float64]

STRAIGHT = 1e-9  # rad: a stretch that turns less is straight
TURN = 2.0 * math.pi


@borrowing_kernel
def _within(angle: float, start: float, turn: float) -> bool:
    """Whether a turn from a start angle passes an angle."""
    ahead = (angle - start) % TURN if turn > 0.0 else (start - angle) % TURN
    return ahead <= abs(turn)


@borrowing_kernel
def _enters(radius: float, angle: float, cy: float, turn: float, outline: Array) -> bool:
    """Whether a point that turns back about (0, cy) crosses a side of the rectangle."""
    for k in range(4):
        level = (outline[0], -outline[1], outline[2] - cy, -outline[2] - cy)[k]
        if abs(level) >= radius:
            continue
        aside = math.sqrt(radius * radius - level * level)
        for sign in (-1.0, 1.0):
            if k < 2:
                x, y = level, sign * aside
                inside = abs(y + cy) <= outline[2]
            else:
                x, y = sign * aside, level
                inside = -outline[1] <= x <= outline[0]
            if inside and _within(math.atan2(y, x), angle, -turn):
                return True
    return False


@borrowing_kernel
def _end_gap(px: float, py: float, cy: float, turn: float, outline: Array, enough: float) -> float:
    """Least gap between a rectangle that turns about (0, cy) and a point, if below `enough`."""
    front, rear, half = outline[0], outline[1], outline[2]
    gap = min(enough, rectangle_point_gap(px, py, outline))
    dx, dy = px, py - cy
    c, s = math.cos(turn), math.sin(turn)
    gap = min(gap, rectangle_point_gap(c * dx + s * dy, cy + c * dy - s * dx, outline))
    radius = math.hypot(dx, dy)
    angle = math.atan2(dy, dx)  # seen from the chair, the point turns back: angle to angle - turn
    for k in range(5):
        if k == 4:  # beside the rectangle, straight towards the side that faces the centre
            if abs(cy) <= half:
                continue
            x, y = 0.0, -cy
        else:
            x, y = (front if k < 2 else -rear), (half if k % 2 == 0 else -half) - cy
        far = math.hypot(x, y)
        near = far if k < 4 else abs(cy) - half
        if k < 4 and abs(radius - near) >= gap and (radius > near or gap <= 0.0):
            continue
        if far > 0.0 and _within(math.atan2(y, x), angle, -turn):
            ux, uy = radius * x / far, cy + radius * y / far
            gap = min(gap, rectangle_point_gap(ux, uy, outline))
    if gap > 0.0 and _enters(radius, angle, cy, turn, outline):
        return 0.0
    return gap


@borrowing_kernel
def _corner_gap(
    x: float, y: float, cy: float, turn: float,
    px: float, py: float, qx: float, qy: float, enough: float,
) -> float:  # fmt: skip
    """Least gap between the arc of a corner (x, y) about (0, cy) and a segment, below `enough`."""
    ux, uy, vx, vy = px, py - cy, qx, qy - cy
    dx, dy = x, y - cy
    radius = math.hypot(dx, dy)
    ex, ey = vx - ux, vy - uy
    length = math.hypot(ex, ey)
    if length == 0.0:
        return enough
    nx, ny = -ey / length, ex / length
    off = nx * ux + ny * uy
    if off < 0.0:
        nx, ny, off = -nx, -ny, -off
    if off - radius >= enough:
        return enough
    gap = min(enough, point_segment_distance(dx, dy, ux, uy, vx, vy))
    c, s = math.cos(turn), math.sin(turn)
    tx, ty = c * dx - s * dy, s * dx + c * dy
    gap = min(gap, point_segment_distance(tx, ty, ux, uy, vx, vy))
    start, towards = math.atan2(dy, dx), math.atan2(ny, nx)
    if radius <= off:
        along = (radius * nx - ux) * ex + (radius * ny - uy) * ey
        if 0.0 <= along <= length * length and _within(towards, start, turn):
            gap = min(gap, off - radius)
        return gap
    aside = math.sqrt(radius * radius - off * off)
    for sign in (-1.0, 1.0):  # where the circle crosses the segment's line
        hx, hy = off * nx - sign * aside * ny, off * ny + sign * aside * nx
        along = (hx - ux) * ex + (hy - uy) * ey
        if 0.0 <= along <= length * length and _within(math.atan2(hy, hx), start, turn):
            return 0.0
    return gap


@borrowing_kernel
def swept_box(way: float, turn: float, outline: Array, box: Array) -> None:
    """Write what bounds a stretch (7,), in its frame.

    A box xmin, ymin, xmax, ymax round all that it sweeps; then front, rear and half width of the
    longer rectangle that it sweeps if it is straight.
    """
    front, rear, half = outline[0], outline[1], outline[2]
    box[0], box[1], box[2], box[3] = -rear, -half, front, half
    if abs(turn) < STRAIGHT:
        box[0] += min(way, 0.0)
        box[2] += max(way, 0.0)
    box[4], box[5], box[6] = box[2], -box[0], half
    if abs(turn) < STRAIGHT:
        return
    cy = way / turn
    for k in range(4):
        x, y = (front if k < 2 else -rear), (half if k % 2 == 0 else -half) - cy
        radius, start = math.hypot(x, y), math.atan2(y, x)
        for m in range(5):
            angle = start + turn
            if m < 4:
                angle = 0.5 * math.pi * m
                if not _within(angle, start, turn):
                    continue
            ux, uy = radius * math.cos(angle), cy + radius * math.sin(angle)
            box[0], box[1] = min(box[0], ux), min(box[1], uy)
            box[2], box[3] = max(box[2], ux), max(box[3], uy)


@borrowing_kernel
def stretch_gap(
    way: float, turn: float, box: Array, outline: Array, segments: Array, count: int, enough: float
) -> float:
    """Least gap [m] while a stretch is driven, at most `enough`; 0 where something is touched.

    Args:
        way: how far [m], backwards below 0.
        turn: how far [rad], to the left above 0.
        box: what bounds the stretch (7,), by `swept_box`.
        outline: (3,) m: front, rear, half width.
        segments: (n, 4) m: the boundary in the chair's frame at the beginning; each end of a
            segment that matters is the first end of one of them, or of one farther than `enough`.
        count: how many of the segments count.
        enough: gaps beyond this are not looked for [m].
    """
    gap = enough
    straight = abs(turn) < STRAIGHT
    cy = 0.0 if straight else way / turn
    front, rear, half = outline[0], outline[1], outline[2]
    for k in range(count):
        px, py, qx, qy = segments[k, 0], segments[k, 1], segments[k, 2], segments[k, 3]
        if (
            min(px, qx) - box[2] >= gap
            or box[0] - max(px, qx) >= gap
            or min(py, qy) - box[3] >= gap
            or box[1] - max(py, qy) >= gap
        ):
            continue
        if straight:  # what is swept is a longer rectangle
            gap = min(gap, rectangle_segment_gap(0.0, 0.0, 0.0, box[4:7], px, py, qx, qy))
            continue
        gap = _end_gap(px, py, cy, turn, outline, gap)
        for m in range(4):
            x, y = (front if m < 2 else -rear), (half if m % 2 == 0 else -half)
            gap = _corner_gap(x, y, cy, turn, px, py, qx, qy, gap)
        if gap <= 0.0:
            return 0.0
    return gap


@borrowing_kernel
def stretch_between(
    x: float, y: float, yaw: float, ax: float, ay: float, ayaw: float
) -> tuple[float, float]:
    """Way [m] and turn [rad] of the stretch from a pose to another that it leads to."""
    turn = wrap(ayaw - yaw)
    half = 0.5 * turn
    chord = math.cos(yaw + half) * (ax - x) + math.sin(yaw + half) * (ay - y)
    return (chord * half / math.sin(half) if abs(half) > STRAIGHT else chord), turn


@kernel
def _path_gap(segments: Array, path: Array, outline: Array, enough: float) -> float:
    box, seen = np.empty(7), np.empty_like(segments)
    gap = enough
    for m in range(max(1, path.shape[0] - 1)):
        x, y, yaw = path[m, 0], path[m, 1], path[m, 2]
        after = min(m + 1, path.shape[0] - 1)
        way, turn = stretch_between(x, y, yaw, path[after, 0], path[after, 1], path[after, 2])
        c, s = math.cos(yaw), math.sin(yaw)
        for k in range(segments.shape[0]):
            for e in range(2):
                ax, ay = segments[k, 2 * e] - x, segments[k, 2 * e + 1] - y
                seen[k, 2 * e], seen[k, 2 * e + 1] = c * ax + s * ay, c * ay - s * ax
        swept_box(way, turn, outline, box)
        gap = stretch_gap(way, turn, box, outline, seen, segments.shape[0], gap)
    return gap


def path_gap(path: ArrayLike, space: Space, footprint: Footprint, enough: float = 1.0) -> float:
    """Least gap [m] between a footprint and what is not free, all along a path of poses (n, 3).

    Between two poses the chair turns and drives at constant rates. It must stand in what is free
    at the first pose; 0 where it touches anything later.
    """
    poses = np.ascontiguousarray(path, dtype=np.float64)
    return float(_path_gap(space.arrays.segments, poses, footprint.array, enough))
