"""Echoes of round things, and what hides a surface from a ranger."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.kernel import borrowing_kernel, inlined

Array = NDArray[np.float64]


@inlined
def hides(
    qx: float, qy: float, ax: float, ay: float, bx: float, by: float, x: float, y: float
) -> bool:
    """Whether the segment a-b stands between (x, y) and the point (x + qx, y + qy)."""
    ex, ey = bx - ax, by - ay
    cross = qx * ey - qy * ex
    if cross == 0.0:
        return False
    t = ((ax - x) * ey - (ay - y) * ex) / cross
    u = ((ax - x) * qy - (ay - y) * qx) / cross
    return 0.0 < t < 1.0 - 1e-9 and 0.0 <= u <= 1.0


@borrowing_kernel
def hidden_by_discs(qx: float, qy: float, discs: Array, x: float, y: float) -> bool:
    """Whether a disc stands between (x, y) and the point (x + qx, y + qy)."""
    for k in range(discs.shape[0]):
        x0, y0, radius = discs[k, 0] - x, discs[k, 1] - y, discs[k, 2]
        square = qx * qx + qy * qy
        along = x0 * qx + y0 * qy
        inside = along * along - square * (x0 * x0 + y0 * y0 - radius * radius)
        if inside > 0.0:
            t = (along - math.sqrt(inside)) / square
            if 0.0 < t < 1.0 - 1e-9:
                return True
    return False


@inlined
def lost(incidence: float, start: float, end: float, draw: float) -> bool:
    """Whether an echo at this incidence is lost: never below start, always above end."""
    return draw < (incidence - start) / (end - start)


@borrowing_kernel
def echo_of_discs(
    x: float,
    y: float,
    c: float,
    s: float,
    slope: float,
    reach: float,
    loss_from: float,
    loss_at: float,
    draw: float,
    walls: Array,
    discs: Array,
) -> float:
    """Distance [m] of the first echo of a disc, walls in between regarded; +inf if none."""
    best = math.inf
    half = math.atan(slope)
    for k in range(discs.shape[0]):
        x0, y0, radius = discs[k, 0] - x, discs[k, 1] - y, discs[k, 2]
        far = math.sqrt(x0 * x0 + y0 * y0)
        if far - radius >= min(best, reach):
            continue
        if far <= radius:
            return 0.0
        bearing = math.atan2(c * y0 - s * x0, c * x0 + s * y0)
        direction = min(half, max(-half, bearing))
        aside = abs(bearing - direction)
        off = far * math.sin(aside)
        if aside >= 0.5 * math.pi or off > radius:
            continue
        distance = far * math.cos(aside) - math.sqrt(radius * radius - off * off)
        silent = lost(math.asin(off / radius), loss_from, loss_at, draw)
        if silent or distance >= min(best, reach):
            continue
        ahead, left = distance * math.cos(direction), distance * math.sin(direction)
        qx, qy = c * ahead - s * left, s * ahead + c * left
        hidden = hidden_by_discs(qx, qy, discs, x, y)
        for j in range(walls.shape[0]):
            if hidden:
                break
            hidden = hides(qx, qy, walls[j, 0], walls[j, 1], walls[j, 2], walls[j, 3], x, y)
        if not hidden:
            best = distance
    return best
