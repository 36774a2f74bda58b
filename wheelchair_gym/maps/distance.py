"""Distances on a raster: exact to the squares of solid cells, and a bound to step by."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.kernel import kernel

Field = NDArray[np.float32]
Mask = NDArray[np.bool_]


@kernel
def distance_to_squares(solid: Mask, most: float) -> Field:
    """Distance (rows, cols) [cells] from cell centres to the nearest solid cell's square.

    Exact below `most`; not less than `most` (or infinite) beyond. First the gap up and down each
    column; then, along each row, the least of all sums of squares.
    """
    rows, cols = solid.shape
    far = np.float32(1e18)
    upright = np.full((rows, cols), far, np.float32)  # squared gap within the column
    for turn in range(2):
        count = np.full(cols, far, np.float32)
        for k in range(rows):
            row = k if turn == 0 else rows - 1 - k
            for col in range(cols):
                steps = np.float32(0.0) if solid[row, col] else count[col] + np.float32(1.0)
                count[col] = steps
                gap = max(steps - np.float32(0.5), np.float32(0.0))
                upright[row, col] = min(upright[row, col], gap * gap)
    out = np.empty((rows, cols), np.float32)
    for row in range(rows):
        line, best = upright[row], out[row]
        worst = np.float32(0.0)
        for col in range(cols):
            best[col] = line[col]
            worst = max(worst, best[col])
        for shift in range(1, cols):
            gap = np.float32(shift - 0.5)
            square = gap * gap
            if shift - 0.5 >= most or square >= worst:
                break
            for col in range(cols - shift):
                best[col] = min(best[col], line[col + shift] + square)
            for col in range(shift, cols):
                best[col] = min(best[col], line[col - shift] + square)
            if shift % 8 == 0:
                worst = np.float32(0.0)
                for col in range(cols):
                    worst = max(worst, best[col])
        for col in range(cols):
            best[col] = math.sqrt(best[col]) if best[col] < 1e17 else np.inf
    return out


@kernel
def chessboard(free: Mask) -> NDArray[np.int16]:
    """Steps of a chess king (rows, cols) to the nearest cell that is not free, or off the grid."""
    rows, cols = free.shape
    out = np.zeros((rows, cols), np.int16)
    for row in range(rows):
        for col in range(cols):
            if free[row, col]:
                least = np.int16(0)
                if row > 0 and 0 < col < cols - 1:
                    above = min(out[row - 1, col - 1], out[row - 1, col], out[row - 1, col + 1])
                    least = min(above, out[row, col - 1])
                out[row, col] = least + 1
    for row in range(rows - 2, -1, -1):
        for col in range(cols - 2, 0, -1):
            below = min(out[row + 1, col - 1], out[row + 1, col], out[row + 1, col + 1])
            out[row, col] = min(out[row, col], min(below, out[row, col + 1]) + 1)
    out[rows - 1] = np.minimum(out[rows - 1], 1)
    return out
