"""The outline on a raster of distances: discs that cover it, and the gap that they leave."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.geometry import Footprint
from wheelchair_gym.kernel import borrowing_kernel

Array = NDArray[np.float64]
Field = NDArray[np.float32]

PROBES = 2.0  # discs along the outline's middle, per half width of its length
CORNERS = (0.55, 0.3, 0.15, 0.06)  # radii of discs in each corner, of the half width


def outline_discs(footprint: Footprint, less: float = 0.0) -> Array:
    """Discs (n, 3) that cover the outline, made smaller on all sides; the first is round it all.

    A row of discs along the middle, and in each corner ever smaller ones.
    """
    front, rear, half = (side - less for side in footprint.array.tolist())
    middle = 0.5 * (front - rear)
    rows = [(middle, 0.0, math.hypot(front - middle, half))]
    along = max(2, math.ceil(PROBES * (front + rear - 2.0 * half) / half) + 1)
    rows += [(x, 0.0, half) for x in np.linspace(half - rear, front - half, along)]
    for share in CORNERS:
        r = share * half
        rows += [(x, y, r) for x in (front - r, r - rear) for y in (half - r, r - half)]
    return np.array(rows)


@borrowing_kernel
def _distance(field: Field, scale: float, x: float, y: float) -> float:
    """Distance [m] from a point [m] to what is solid, between cell centres bilinear."""
    rows, cols = field.shape
    u, v = x * scale - 0.5, y * scale - 0.5
    if not (-0.5 <= u <= cols - 0.5 and -0.5 <= v <= rows - 0.5):
        return 0.0
    u, v = min(max(u, 0.0), cols - 1.001), min(max(v, 0.0), rows - 1.001)
    c, r = int(u), int(v)
    u, v = u - c, v - r
    low = field[r, c] * (1.0 - u) + field[r, c + 1] * u
    return float(low * (1.0 - v) + (field[r + 1, c] * (1.0 - u) + field[r + 1, c + 1] * u) * v)


@borrowing_kernel
def outline_gap(
    field: Field,
    scale: float,
    discs: Array,
    x: float,
    y: float,
    cos: float,
    sin: float,
    wish: float,
) -> float:
    """Gap [m] round the outline, at most `wish`; discs (n, 3), the first of all round the chair."""
    gap = _distance(field, scale, x + cos * discs[0, 0], y + sin * discs[0, 0]) - discs[0, 2]
    if gap >= wish:
        return wish
    gap = wish
    for i in range(1, discs.shape[0]):
        px = x + cos * discs[i, 0] - sin * discs[i, 1]
        py = y + sin * discs[i, 0] + cos * discs[i, 1]
        gap = min(gap, _distance(field, scale, px, py) - discs[i, 2])
        if gap < 0.0:
            break
    return float(gap)
