"""The grid around the chair: when each cell was last seen, and when it was last found empty."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.compiled.kernel import borrowing_kernel
from wheelchair_gym.geometry import point_to_world
from wheelchair_gym.safety.state import CELL, CELLS
from wheelchair_gym.sensors.echoes import atan2_f32

Array = NDArray[np.float64]
Floats = NDArray[np.float32]
Numbers = NDArray[np.int32]

_F = np.float32
_NEVER = _F(-1e9)  # s
_REACHED = _F(-0.07)  # m: a ray that ends so near a cell's centre has seen the cell
_BEYOND = _F(0.20)  # m: a ray that ends so far beyond it has found the cell empty
_CLEARED = 1.0  # s: what stands where a cell was empty so recently has moved there
_INSET = _F(0.02)  # m: only cells well below the outline count as seen


class Frame(NamedTuple):
    """A frame in another: its origin, and cosine and sine of its yaw."""

    x: float
    y: float
    c: float
    s: float


@borrowing_kernel
def laser_frame(g: Any, pose: Array) -> Frame:
    """The laser's frame at a pose (3,) of the chair (dead-reckoned)."""
    c, s = math.cos(pose[2]), math.sin(pose[2])
    x, y = point_to_world(c, s, pose[0], pose[1], g.mount[0], g.mount[1])
    yaw = pose[2] + g.mount[2]
    return Frame(x, y, math.cos(yaw), math.sin(yaw))


@borrowing_kernel
def recenter_grid(s: Any) -> None:
    """Move the grid with the chair; cells that come in have never been seen."""
    for axis in range(2):
        corner = math.floor(s.pose[axis] / CELL) - CELLS // 2
        shift = corner - s.corner[axis]
        if shift == 0:
            continue
        s.corner[axis] = corner
        step = 1 if shift > 0 else -1
        first = 0 if shift > 0 else CELLS - 1
        for k in range(CELLS):
            to = first + step * k
            source = to + shift
            inside = 0 <= source < CELLS
            for i in range(CELLS):
                if axis == 0:
                    s.seen[to, i] = s.seen[source, i] if inside else _NEVER
                    s.clear[to, i] = s.clear[source, i] if inside else _NEVER
                else:
                    s.seen[i, to] = s.seen[i, source] if inside else _NEVER
                    s.clear[i, to] = s.clear[i, source] if inside else _NEVER


@borrowing_kernel
def _find_beams(
    ex: np.float32, ey: np.float32, step: np.float32, c: np.float32, s: np.float32,
    first: np.float32, per: np.float32, beam: Numbers, far: Floats,
) -> None:  # fmt: skip
    """Store which beam covers each cell of a column, and how far its centre is [m]."""
    for j in range(np.uint64(CELLS)):
        y = ey + _F(np.int32(j)) * step
        beam[j] = np.int32((atan2_f32(c * y - s * ex, c * ex + s * y) - first) * per + _F(1.5)) - 1
        far[j] = np.sqrt(ex * ex + y * y)


@borrowing_kernel
def update_grid(g: Any, s: Any, laser: Floats) -> None:
    """Store which cells the scan has seen, and which it has found empty.

    Each call updates every other column, since this is half of a reading's work.
    """
    beams, now, step = laser.shape[0], _F(s.stamp), _F(CELL)
    frame = laser_frame(g, s.pose)
    c, sn = _F(math.cos(s.pose[2])), _F(math.sin(s.pose[2]))
    vacated = _F(s.stamp - max(0.0, g.memory_time - g.vacated_time))
    front, rear = _F(g.outline[0]) + _REACHED, _F(-g.outline[1]) - _REACHED
    half = _F(g.outline[2]) - _INSET
    ey, by = (s.corner[1] + 0.5) * CELL - frame.y, (s.corner[1] + 0.5) * CELL - s.pose[1]
    first, per = _F(g.first), _F(g.per_angle)
    beam, far = s.beam[:], s.range[:]
    reach = math.hypot(max(g.outline[0], g.outline[1]), g.outline[2])
    s.columns = 1 - s.columns
    for i in range((s.corner[0] + s.columns) % 2, CELLS, 2):
        ex = (s.corner[0] + i + 0.5) * CELL - frame.x
        _find_beams(_F(ex), _F(ey), step, _F(frame.c), _F(frame.s), first, per, beam, far)
        for j in range(CELLS):
            b = beam[j]
            if b < 1 or b > beams - 2:
                continue
            d = far[j] + _REACHED
            if laser[b] >= d and laser[b - 1] >= d and laser[b + 1] >= d:
                s.seen[i, j] = now
                d = far[j] + _BEYOND
                if laser[b] >= d and laser[b - 1] >= d and laser[b + 1] >= d:
                    s.clear[i, j] = now
        # Cells wholly under the chair count as seen, and for a while after it has left them.
        bx = (s.corner[0] + i + 0.5) * CELL - s.pose[0]
        if abs(bx) > reach:
            continue
        low, high = int((-reach - by) / CELL), int((reach - by) / CELL) + 2
        for j in range(max(low, 0), min(high, CELLS)):
            y = _F(by + j * CELL)
            px, py = c * _F(bx) + sn * y, c * y - sn * _F(bx)
            if rear <= px <= front and abs(py) <= half:
                s.seen[i, j] = max(s.seen[i, j], vacated)


@borrowing_kernel
def was_empty(s: Any, x: float, y: float) -> bool:
    """Whether all cells around a point (dead-reckoned) were empty a moment ago."""
    i, j = math.floor(x / CELL) - s.corner[0], math.floor(y / CELL) - s.corner[1]
    if i < 1 or j < 1 or i >= CELLS - 1 or j >= CELLS - 1:
        return False
    since = s.stamp - _CLEARED
    for a in range(-1, 2):
        for b in range(-1, 2):
            if s.clear[i + a, j + b] < since:
                return False
    return True


@borrowing_kernel
def was_seen(s: Any, x: float, y: float, since: float) -> bool:
    """Whether the cell of a point (dead-reckoned) has been seen since a stamp [s]."""
    i, j = math.floor(x / CELL) - s.corner[0], math.floor(y / CELL) - s.corner[1]
    if i < 0 or j < 0 or i >= CELLS or j >= CELLS:
        return False
    return bool(s.seen[i, j] >= since)
