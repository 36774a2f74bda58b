"""Distances on a raster, and the clearance of the chair's outline from them.

Distances are exact, to the squares of solid cells. For its clearance the outline is covered by
discs.
"""

import math

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.base.arrays import Array, Mask
from wheelchair_gym.compiled.kernel import borrowing_kernel, inlined, kernel
from wheelchair_gym.geometry.outline import Footprint

Field = NDArray[np.float32]
Cells = NDArray[np.int8]
Steps = NDArray[np.int16]


@kernel
def distance_to_occupied(solid: Mask, reach: float) -> Field:
    """Distance (rows, cols) [cells] from cell centres to the nearest solid cell's square.

    Exact below `reach`; at least `reach` (or infinite) beyond. First the distance up and down each
    column; then, along each row, the smallest sum of squares.
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
            if shift - 0.5 >= reach or square >= worst:
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


@borrowing_kernel
def rows_equal(line: Cells, other: Cells) -> bool:
    """Whether two rows of cells are equal: most neighbours are, in buildings."""
    differ = np.int8(0)
    for k in range(min(len(line), len(other))):
        differ |= line[k] ^ other[k]
    return bool(differ == 0)


@borrowing_kernel
def _add_row(line: Cells, over: Cells) -> None:
    """Set the cells of a row that are set in another."""
    for k in range(min(len(line), len(over))):
        over[k] |= line[k]


@kernel
def within_distance(solid: Cells, minimum: float) -> Cells:
    """1 where a cell's centre is nearer [cells] than `minimum` to some solid cell's square, else 0.

    Each row of solid cells is widened step by step, and added to the rows within reach at that
    width: whole rows vectorize. Of equal rows the last reaches farthest up, the first farthest
    down.
    """
    rows, cols = solid.shape
    out = np.zeros((rows, cols), np.int8)
    wide = np.zeros(cols, np.int8)
    reach = min(rows, int(minimum + 1.5))
    up = False  # whether the row differs from the next
    for row in range(rows):
        down = row == 0 or up
        up = row == rows - 1 or not rows_equal(solid[row], solid[row + 1])
        if up or down:
            line = solid[row]
            for col in range(cols):
                wide[col] = line[col]
            width = 0
            for rise in range(reach, 0, -1):
                aside = minimum * minimum - (rise - 0.5) ** 2
                if aside <= 0.0:
                    continue
                width = _widen(line, width, aside, wide)
                if up and row + rise < rows:
                    _add_row(wide, out[row + rise])
                if down and rise <= row:
                    _add_row(wide, out[row - rise])
            _widen(line, width, minimum * minimum, wide)
        _add_row(wide, out[row])
    return out


@borrowing_kernel
def _widen(line: Cells, width: int, square: float, wide: Cells) -> int:
    """Widen the solid cells of a line up to a squared distance; returns the width."""
    while width < len(line) - 1 and (width + 0.5) ** 2 < square:
        width += 1
        _add_row(line[width:], wide)
        _add_row(line, wide[width:])
    return width


@borrowing_kernel
def _count_steps(line: Field, direction: int, far: int, count: Steps, rise: Steps) -> None:
    """Count steps since the last finite cell of each column; keep them, signed, where fewer."""
    sign = np.int16(direction)
    for k in range(min(len(line), len(count), len(rise))):
        steps = np.int16(count[k] + np.int16(1))
        steps = steps if steps < far else np.int16(far)
        steps = np.int16(0) if line[k] < np.float32(np.inf) else steps
        count[k] = steps
        rise[k] = np.int16(sign * steps) if steps < np.int16(abs(rise[k])) else rise[k]


@borrowing_kernel
def _keep_nearer(square: Steps, step: int, best: Steps, shift: Steps) -> None:
    """Keep the columns of `square`, a step aside, where they are nearer than the best so far."""
    aside, more = np.int16(step), np.int16(step * step)
    for k in range(min(len(square), len(best), len(shift))):
        here = np.int16(square[k] + more)
        shift[k] = aside if here < best[k] else shift[k]
        best[k] = here if here < best[k] else best[k]


@kernel
def extend_field(length: Field, band: float) -> Field:
    """A field extended into cells within `band` [cells] of finite ones: theirs plus the distance.

    First the nearest finite cell up or down each column; then, along each row, the nearest of all.
    Integers of 16 bits vectorize best: a band ends at 120.
    """
    rows, cols = length.shape
    far = int(min(band, 120.0)) + 1
    limit = np.int16(min(band, 120.0) ** 2)
    rise = np.full((rows, cols), far, np.int16)  # rows to the nearest finite cell of the column
    for direction in (1, -1):
        count = np.full(cols, far, np.int16)
        for k in range(rows):
            row = k if direction < 0 else rows - 1 - k
            _count_steps(length[row], direction, far, count, rise[row])
    out = length.copy()
    square, best = np.empty(cols, np.int16), np.empty(cols, np.int16)
    shift = np.empty(cols, np.int16)
    for row in range(rows):
        line, here = out[row], rise[row]
        for col in range(cols):
            square[col] = np.int16(here[col] * here[col])
            best[col] = square[col]
            shift[col] = 0
        for step in range(1, far):
            _keep_nearer(square[step:], step, best, shift)
            _keep_nearer(square, -step, best[step:], shift[step:])
        for col in range(cols):
            if 0 < best[col] <= limit:
                source = col + shift[col]
                line[col] = length[row + here[source], source] + math.sqrt(np.float32(best[col]))
    return out


PROBES = 2.0  # discs along the outline's middle, per half width of its length
CORNERS = (0.55, 0.3, 0.15, 0.06)  # radii of discs in each corner, of the half width


def footprint_discs(footprint: Footprint, less: float = 0.0) -> Array:
    """Discs (n, 3) that cover the outline less a margin; the first one encloses it.

    A row of discs along the middle, and ever smaller ones in each corner.
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


@inlined
def bilinear(field: Field, row: int, col: int, a: float, b: float) -> float:
    """A field between four cells, at the shares a of the way along columns and b along rows."""
    low = field[row, col] * (1.0 - a) + field[row, col + 1] * a
    high = field[row + 1, col] * (1.0 - a) + field[row + 1, col + 1] * a
    value: float = low * (1.0 - b) + high * b
    return value


@borrowing_kernel
def _distance(field: Field, scale: float, x: float, y: float) -> float:
    """Distance [m] from a point [m] to solid cells, bilinear between cell centres."""
    rows, cols = field.shape
    u, v = x * scale - 0.5, y * scale - 0.5
    if not (-0.5 <= u <= cols - 0.5 and -0.5 <= v <= rows - 0.5):
        return 0.0
    u, v = min(max(u, 0.0), cols - 1.001), min(max(v, 0.0), rows - 1.001)
    c, r = int(u), int(v)
    if min(rows, cols) < 2:  # no two cells to interpolate between
        return float(field[r, c])
    return bilinear(field, r, c, u - c, v - r)


@borrowing_kernel
def field_clearance(
    field: Field,
    scale: float,
    discs: Array,
    x: float,
    y: float,
    cos: float,
    sin: float,
    reach: float,
) -> float:
    """Clearance [m] of an outline at a pose, at most `reach`; discs as of `footprint_discs`."""
    gap = _distance(field, scale, x + cos * discs[0, 0], y + sin * discs[0, 0]) - discs[0, 2]
    if gap >= reach:
        return reach
    gap = reach
    for i in range(1, discs.shape[0]):
        px = x + cos * discs[i, 0] - sin * discs[i, 1]
        py = y + sin * discs[i, 0] + cos * discs[i, 1]
        gap = min(gap, _distance(field, scale, px, py) - discs[i, 2])
        if gap < 0.0:
            break
    return float(gap)
