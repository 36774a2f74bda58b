"""The grid around the chair: when each cell was last seen, and when it was last found empty."""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.base.arrays import Array, Floats
from wheelchair_gym.compiled.address import on_stack, rows_of
from wheelchair_gym.compiled.kernel import borrowing_kernel, inlined
from wheelchair_gym.geometry.planar import point_to_world, world_to_body
from wheelchair_gym.safety.state import BESIDE, CELL, CELLS, MARKS, Frame
from wheelchair_gym.sensors.echoes import atan2_f32
from wheelchair_gym.sensors.laser import LaserArrays

Numbers = NDArray[np.int32]

# Workspace of a column: the beam that covers each cell, how far it sees and how far the cell is.
_COLUMN = np.dtype([("beam", "i4", (CELLS,)), ("minimum", "f4", (CELLS,)), ("far", "f4", (CELLS,))])
_column_at, _SIZE = rows_of(_COLUMN), _COLUMN.itemsize

_F = np.float32
_NEVER = _F(-1e9)  # s
_REACHED = _F(-0.07)  # m: a ray that ends so near a cell's centre has seen the cell
_BEYOND = _F(0.20)  # m: a ray that ends so far beyond it has found the cell empty
_CLEARED = 1.0  # s: what stands where a cell was empty so recently has moved there
_INSET = _F(0.02)  # m: only cells well below the outline count as seen
_NONE = _F(-np.inf)
_HALF, _MASK = CELLS // 2, np.uint32(CELLS - 1)


class Scan(NamedTuple):
    """A scan where it was taken (dead-reckoned): the laser's place, cosine and sine of its yaw."""

    x: float
    y: float
    c: float
    s: float
    first: float  # rad: of beam 0
    per_angle: float  # beams per rad
    minimum: Floats  # (beams,) m: of a beam and the two beside it; -inf where one is invalid


@borrowing_kernel
def scanner_frame(mount: Array, pose: Array) -> Frame:
    """The frame of a scanner with a mount (3,) at a pose (3,) of the chair."""
    c, s = math.cos(pose[2]), math.sin(pose[2])
    x, y = point_to_world(c, s, pose[0], pose[1], mount[0], mount[1])
    yaw = pose[2] + mount[2]
    return Frame(x, y, math.cos(yaw), math.sin(yaw))


@borrowing_kernel
def scan_of(one: LaserArrays, pose: Array, minimum: Floats) -> Scan:
    """A scan of a scanner at a pose (3,) of the chair; `minimum` (beams,) is of `find_minimum`."""
    at = scanner_frame(one.mount, pose)
    return Scan(at.x, at.y, at.c, at.s, one.first, one.per_angle, minimum)


@borrowing_kernel
def find_minimum(laser: Floats, reach: float, minimum: Floats) -> None:
    """Store how far each beam and the two beside it see; -inf where one is invalid."""
    last, maximum = np.uint64(laser.shape[0] - 1), _F(reach)
    minimum[0] = minimum[last] = _NONE
    for b in range(np.uint64(1), last):
        r0, r, r1 = laser[b - np.uint64(1)], laser[b], laser[b + np.uint64(1)]
        low = r0 if r0 < r else r
        low = r1 if r1 < low else low
        low = maximum if maximum < low else low  # without an echo
        valid = (r0 == r0) & (r == r) & (r1 == r1)
        minimum[b] = low if valid else _NONE


@inlined
def beam_towards(scan: Scan, x: float, y: float) -> np.int64:
    """The beam whose direction is nearest to that of a vector (dead-reckoned) from the laser."""
    ahead, left = world_to_body(scan.c, scan.s, x, y)
    at = (atan2_f32(_F(left), _F(ahead)) - scan.first) * scan.per_angle
    return np.int64((at if at > 0.0 else 0.0) + 0.5)


@inlined
def sees_beyond(scan: Scan, x: float, y: float, near: float, edge: int) -> bool:
    """Whether the beams towards a vector from the laser reach so far; not near the view's edge."""
    b, beams = beam_towards(scan, x, y), scan.minimum.shape[0]
    within = (b > edge) & (b < beams - 1 - edge)
    return bool(within & (scan.minimum[np.uint64(b if within else 0)] >= near))


@inlined
def is_in_view(scan: Scan, x: float, y: float, edge: int) -> bool:
    """Whether a vector from the laser lies in its view, more than `edge` beams from its edge."""
    b, beams = beam_towards(scan, x, y), scan.minimum.shape[0]
    return bool((b > edge) & (b < beams - 1 - edge))


@inlined
def place_of_cell(i: int, j: int) -> np.uint64:
    """Return the index where cell (i, j) is stored: columns that one reading updates are together.

    A cell keeps its place while the grid moves with the chair.
    """
    column = (i & 1) * _HALF + ((i >> 1) & (_HALF - 1))
    return np.uint64(column * CELLS + (j & (CELLS - 1)))


@borrowing_kernel
def recenter_grid(s: Any) -> None:
    """Move the grid with the chair; cells that come in have never been seen."""
    for axis in range(2):
        corner = math.floor(s.pose[axis] / CELL) - CELLS // 2
        shift = corner - s.corner[axis]
        s.corner[axis] = corner
        many = min(abs(shift), CELLS)
        first = corner + CELLS - many if shift > 0 else corner
        for k in range(first, first + many):
            for i in range(CELLS):
                place = place_of_cell(k, i) if axis == 0 else place_of_cell(i, k)
                s.seen[place] = s.clear[place] = _NEVER


@borrowing_kernel
def _find_beams(
    beam: Numbers, far: Floats, low: np.uint32, ex: np.float32, ey: np.float32, c: np.float32,
    s: np.float32, first: np.float32, per: np.float32, last: np.int32,
) -> None:  # fmt: skip
    """Store which beam covers each cell of a column, 0: none, and how far its centre is [m]."""
    step = _F(CELL)
    for k in range(np.uint64(CELLS)):
        y = ey + _F(np.int32((np.uint32(k) - low) & _MASK)) * step
        b = np.int32((atan2_f32(c * y - s * ex, c * ex + s * y) - first) * per + _F(1.5))
        beam[k] = b - 1 if (b > 1) & (b <= last) else 0
        far[k] = np.sqrt(ex * ex + y * y)


@borrowing_kernel
def _look_up(work: Any, minimum: Floats) -> None:
    """Store how far the beams of a column's cells see, and those beside them [m]."""
    for k in range(np.uint64(CELLS)):
        work.minimum[k] = minimum[np.uint64(work.beam[k])]


@borrowing_kernel
def _update_column(
    seen: Floats, clear: Floats, now: np.float32, minimum: Floats, far: Floats
) -> None:
    """Store when the scan has seen the cells of a column, and when it has found them empty."""
    for k in range(np.uint64(CELLS)):
        r, d = minimum[k], far[k]
        seen[k] = now if r >= d + _REACHED else seen[k]
        clear[k] = now if r >= d + _BEYOND else clear[k]


@borrowing_kernel
def _vacate_column(
    seen: Floats, then: np.float32, low: np.uint32, bx: float, by: float, c: np.float32,
    s: np.float32, front: np.float32, rear: np.float32, half: np.float32,
) -> None:  # fmt: skip
    """Cells wholly under the chair count as seen, and for a while after it has left them."""
    x = _F(bx)
    for k in range(np.uint64(CELLS)):
        y = _F(by + np.int32((np.uint32(k) - low) & _MASK) * CELL)
        px, py = c * x + s * y, c * y - s * x
        under = (rear <= px) & (px <= front) & (abs(py) <= half)
        seen[k] = then if under & (then > seen[k]) else seen[k]


@borrowing_kernel
def update_grid(g: Any, s: Any, scan: Scan, is_first: bool) -> None:
    """Store which cells the scan has seen, and which it has found empty.

    Each reading updates every other column, since this is half of the work: those that its first
    scanner chooses.
    """
    now, corner = _F(s.stamp), s.corner[1]
    c, sn = _F(math.cos(s.pose[2])), _F(math.sin(s.pose[2]))
    vacated = _F(s.stamp - max(0.0, g.memory_time - g.vacated_time))
    front, rear = _F(g.outline[0]) + _REACHED, _F(-g.outline[1]) - _REACHED
    half = _F(g.outline[2]) - _INSET
    ey, by = (corner + 0.5) * CELL - scan.y, (corner + 0.5) * CELL - s.pose[1]
    reach = math.hypot(max(g.outline[0], g.outline[1]), g.outline[2])
    work, low = _column_at(on_stack(_SIZE), 1)[0], np.uint32(corner & (CELLS - 1))
    first, per, last = _F(scan.first), _F(scan.per_angle), np.int32(scan.minimum.shape[0] - 1)
    if is_first:
        s.columns = 1 - s.columns
    begin = s.corner[0] + (s.corner[0] + s.columns) % 2
    for i in range(begin, s.corner[0] + CELLS, 2):
        at = np.int64(place_of_cell(i, 0))
        seen, clear = s.seen[at : at + CELLS], s.clear[at : at + CELLS]
        ex, bx = (i + 0.5) * CELL - scan.x, (i + 0.5) * CELL - s.pose[0]
        _find_beams(
            work.beam[:], work.far[:], low, _F(ex), _F(ey), _F(scan.c), _F(scan.s), first, per, last
        )
        _look_up(work, scan.minimum)
        _update_column(seen, clear, now, work.minimum[:], work.far[:])
        if is_first and abs(bx) <= reach:
            _vacate_column(seen, vacated, low, bx, by, c, sn, front, rear, half)


@inlined
def _is_inside(s: Any, i: int, j: int, edge: int) -> bool:
    """Whether a cell is in the grid, at least `edge` cells from the grid's edge."""
    i, j = i - s.corner[0], j - s.corner[1]
    return (i >= edge) & (j >= edge) & (i < CELLS - edge) & (j < CELLS - edge)


@borrowing_kernel
def was_empty(s: Any, x: float, y: float) -> bool:
    """Whether all cells around a point (dead-reckoned) were empty a moment ago."""
    i, j, since = math.floor(x / CELL), math.floor(y / CELL), s.stamp - _CLEARED
    if not _is_inside(s, i, j, 1) or s.clear[place_of_cell(i, j)] < since:
        return False
    for a in range(i - 1, i + 2):
        for b in range(j - 1, j + 2):
            if s.clear[place_of_cell(a, b)] < since:
                return False
    return True


@borrowing_kernel
def mark_motion(g: Any, s: Any, x: float, y: float, marks: Any, n: int) -> bool:
    """Mark a point (dead-reckoned) that moves; whether it does.

    It moves if its place was empty a moment ago, or if one of n marks beside it moved of late.
    """
    last = s.stamp if was_empty(s, x, y) else -math.inf
    for i in range(n):
        old = marks[i]
        dx, dy = old.x - x, old.y - y
        if old.stamp > last and dx * dx + dy * dy < BESIDE * BESIDE:
            last = old.stamp
    if s.stamp - last > g.moving_memory_time:
        return False
    if s.n_marks < MARKS:
        mark = s.marks[s.n_marks]
        mark.x, mark.y, mark.stamp, mark.seen = x, y, last, s.stamp
        s.n_marks += 1
    return True


@borrowing_kernel
def was_seen(s: Any, x: float, y: float, since: float) -> bool:
    """Whether the cell of a point (dead-reckoned) has been seen since a stamp [s]."""
    i, j = math.floor(x / CELL), math.floor(y / CELL)
    return bool(_is_inside(s, i, j, 0) and s.seen[place_of_cell(i, j)] >= since)
