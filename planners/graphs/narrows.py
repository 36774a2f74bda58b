"""Narrow places of a map, and the lines along which an outline passes them.

In the middle of a narrow place the distance to what is solid has a saddle: the two nearest points
lie opposite each other. A chair that fits through with little play stands in line there: on the
line through the middle, at right angles to the gap.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from planners.graphs.guide import SPACING, Field
from planners.nearby import CELL, Nearby
from wheelchair_gym.geometry import point_segment_distance
from wheelchair_gym.kernel import borrowing_kernel, kernel

Array = NDArray[np.float64]

OPPOSITE = -0.5  # cosine: the other side lies at least 120 deg from the nearest point
STEPS = 6  # from a grid point to the saddle at most
SETTLED = 1e-4  # m
APART = 0.15  # m: narrow places in line that are nearer to each other are one
ALIGNED = math.radians(3.0)  # of places that are in line


@borrowing_kernel
def _nearest_side(
    near: Nearby, x: float, y: float, ux: float, uy: float, most: float
) -> tuple[float, float, float]:
    """The nearest boundary point (x, y) whose direction has a cosine to u below `OPPOSITE`.

    With u = 0 any will do. Third its distance, `most` where there is none nearer.
    """
    cell = int((y - near.origin[1]) / CELL) * near.columns + int((x - near.origin[0]) / CELL)
    best, bx, by = most, x, y
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


@borrowing_kernel
def _known(places: Array, count: int, x: float, y: float, yaw: float) -> bool:
    """Whether a place is in line with one of the first places, and near to it."""
    for k in range(count):
        dx, dy = places[k, 0] - x, places[k, 1] - y
        aside = abs(math.cos(yaw) * dy - math.sin(yaw) * dx)
        askew = abs(math.sin(places[k, 2] - yaw))
        if aside < 0.2 * SPACING and askew < ALIGNED and math.hypot(dx, dy) < APART:
            return True
    return False


@kernel
def narrow_places(near: Nearby, gaps: Field, least: float, most: float) -> Array:
    """Middles and directions through them (n, 3) [m, m, rad] of narrow places.

    Args:
        near: what lies where, up to twice `most`.
        gaps: distances at the points of a grid.
        least: half widths [m] of a gap, from...
        most: ... to.
    """
    rows, columns = gaps.shape
    found = np.empty((gaps.size, 3))
    n = 0
    for i in range(1, rows - 1):
        for j in range(1, columns - 1):
            here = gaps[i, j]
            if not least - SPACING <= here <= most:
                continue
            saddle = False
            for di, dj in ((0, 1), (1, 0), (1, 1), (1, -1)):
                across = max(gaps[i + di, j + dj], gaps[i - di, j - dj]) <= here
                along = min(gaps[i + dj, j - di], gaps[i - dj, j + di]) >= here - 0.2 * SPACING
                saddle |= across and along
            if not saddle:
                continue
            x, y = near.box[0] + j * SPACING, near.box[1] + i * SPACING
            for _ in range(STEPS):
                ax, ay, first = _nearest_side(near, x, y, 0.0, 0.0, 2.0 * most)
                bx, by, second = _nearest_side(near, x, y, ax - x, ay - y, 2.0 * most)
                if second >= 2.0 * most:
                    break
                mx, my = 0.5 * (ax + bx), 0.5 * (ay + by)
                moved = math.hypot(mx - x, my - y)
                x, y = mx, my
                half = 0.5 * math.hypot(bx - ax, by - ay)
                if moved < SETTLED or first <= 0.0:
                    yaw = math.atan2(bx - ax, ay - by) % math.pi
                    if least <= half <= most and not _known(found, n, x, y, yaw):
                        found[n, 0], found[n, 1], found[n, 2] = x, y, yaw
                        n += 1
                    break
    return found[:n].copy()
