"""How far the outline is from points, and how far it is to keep."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.compiled.kernel import borrowing_kernel, kernel

Array = NDArray[np.float64]


@kernel
def clearance_to_points(
    x: float, y: float, yaw: float, footprint: Array, points: Array, interest: float
) -> float:
    """Distance [m] from the outline at a pose to the nearest of points, at most `interest`.

    Points (k, 3) hold x, y and a lower bound of the distance from the origin, which rises.
    """
    c, s = math.cos(yaw), math.sin(yaw)
    middle = 0.5 * (footprint[0] - footprint[1])
    half_length, half_width = 0.5 * (footprint[0] + footprint[1]), footprint[2]
    mx, my = x + c * middle, y + s * middle
    reach = math.hypot(x, y) + interest
    reach += math.hypot(max(footprint[0], footprint[1]), half_width)
    best = interest * interest
    for k in range(points.shape[0]):
        if points[k, 2] > reach:
            break
        px, py = points[k, 0] - mx, points[k, 1] - my
        dx = max(abs(c * px + s * py) - half_length, 0.0)
        dy = max(abs(c * py - s * px) - half_width, 0.0)
        best = min(best, dx * dx + dy * dy)
    return math.sqrt(best)


@kernel
def required_clearance(
    least: float, headway: float, speed: float, turn: float, lever: float, crawl: float
) -> float:
    """Room [m] to be kept round the outline: `least`, and more the faster a part of it moves."""
    return least + headway * max(0.0, speed + 0.5 * lever * turn - crawl)


@borrowing_kernel
def signed_clearance(px: float, py: float, outline: Array) -> float:
    """Distance [m] of a point in the chair's frame to the outline; below 0 inside of it."""
    dx = max(px - outline[0], -outline[1] - px)
    dy = abs(py) - outline[2]
    if dx > 0.0 and dy > 0.0:
        return math.sqrt(dx * dx + dy * dy)
    return float(max(dx, dy))
