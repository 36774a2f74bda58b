"""Distances on a raster: exact to the squares of solid cells, and a bound to step by."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.kernel import kernel

Field = NDArray[np.float32]
Mask = NDArray[np.bool_]
Cells = NDArray[np.int8]


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
def _lay(line: Cells, over: Cells) -> None:
    for k in range(min(len(line), len(over))):
        over[k] |= line[k]


@kernel
def near(solid: Cells, least: float) -> Cells:
    """1 where a cell's centre is nearer [cells] than `least` to some solid cell's square, else 0.

    Each row of solid cells is widened step by step, and laid over the rows that lie near enough to
    be reached at that width: only whole rows are handled, which goes many cells at a time.
    """
    rows, cols = solid.shape
    out = np.zeros((rows, cols), np.int8)
    wide = np.empty(cols, np.int8)
    most = min(rows, int(least + 1.5))
    for row in range(rows):
        line = solid[row]
        for col in range(cols):
            wide[col] = line[col]
        width = 0
        for rise in range(most, -1, -1):
            aside = least * least - max(rise - 0.5, 0.0) ** 2
            if aside <= 0.0:
                continue
            while width < cols - 1 and (width + 0.5) ** 2 < aside:
                width += 1
                _lay(line[width:], wide)
                _lay(line, wide[width:])
            if row + rise < rows:
                _lay(wide, out[row + rise])
            if 0 < rise <= row:
                _lay(wide, out[row - rise])
    return out


@kernel
def _nearer(square: Field, step: float, best: Field, shift: Field) -> None:
    aside, more = np.float32(step), np.float32(step * step)
    for k in range(min(len(square), len(best))):
        here = square[k] + more
        shift[k] = aside if here < best[k] else shift[k]
        best[k] = here if here < best[k] else best[k]


@kernel
def carried_on(length: Field, band: float) -> Field:
    """A field carried on into cells within `band` [cells] of finite ones: plus the way there.

    First the nearest finite cell up or down each column; then, along each row, the nearest of all.
    Everything is float32, the one type whose sums numba does not widen: so it runs many cells at a
    time.
    """
    rows, cols = length.shape
    nil, one = np.float32(0.0), np.float32(1.0)
    far, limit = np.float32(band + 1.0), np.float32(band * band)
    rise = np.empty((rows, cols), np.float32)  # rows to the nearest finite cell of the column
    count = np.full(cols, far, np.float32)
    for row in range(rows):
        line, here = length[row], rise[row]
        for col in range(cols):
            count[col] = nil if line[col] < np.inf else count[col] + one
            here[col] = -count[col]
    count = np.full(cols, far, np.float32)
    for row in range(rows - 1, -1, -1):
        line, here = length[row], rise[row]
        for col in range(cols):
            count[col] = nil if line[col] < np.inf else count[col] + one
            here[col] = count[col] if count[col] < -here[col] else here[col]
    out = length.copy()
    square, best = np.empty(cols, np.float32), np.empty(cols, np.float32)
    shift = np.empty(cols, np.float32)
    for row in range(rows):
        line, here = out[row], rise[row]
        for col in range(cols):
            square[col] = here[col] * here[col]
            best[col] = square[col]
            shift[col] = nil
        for step in range(1, int(band) + 1):
            _nearer(square[step:], step, best, shift)
            _nearer(square, -step, best[step:], shift[step:])
        for col in range(cols):
            if nil < best[col] <= limit:
                source = col + int(shift[col])
                line[col] = length[row + int(here[source]), source] + math.sqrt(best[col])
    return out
