"""Which cells about the chair lasers have looked at, and which they have found empty."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.compiled.kernel import borrowing_kernel
from wheelchair_gym.safety.state import CELL, CELLS
from wheelchair_gym.sensors.echoes import bearing

Floats = NDArray[np.float32]
Numbers = NDArray[np.int32]

_F = np.float32
_LOOKED = _F(-0.07)  # m: a ray that came so near a cell's centre has looked at the cell
_BEYOND = _F(0.20)  # m: one that went so far beyond has found it empty
_CLEARED = 1.0  # s: where nothing was so lately, what is there now has moved


@borrowing_kernel
def laser_frame(g: Any, s: Any) -> tuple[float, float, float, float]:
    """Where the laser is (dead-reckoned): x, y, cosine and sine of its yaw."""
    c, sn = math.cos(s.pose[2]), math.sin(s.pose[2])
    x = s.pose[0] + c * g.mount[0] - sn * g.mount[1]
    y = s.pose[1] + sn * g.mount[0] + c * g.mount[1]
    yaw = s.pose[2] + g.mount[2]
    return x, y, math.cos(yaw), math.sin(yaw)


@borrowing_kernel
def recenter_grid(s: Any) -> None:
    """Let the grid follow the chair; what comes in was never looked at."""
    for axis in range(2):
        want = math.floor(s.pose[axis] / CELL) - CELLS // 2
        shift = want - s.corner[axis]
        if shift == 0:
            continue
        s.corner[axis] = want
        step = 1 if shift > 0 else -1
        first = 0 if shift > 0 else CELLS - 1
        for k in range(CELLS):
            to = first + step * k
            source = to + shift
            inside = 0 <= source < CELLS
            for i in range(CELLS):
                if axis == 0:
                    s.seen[to, i] = s.seen[source, i] if inside else _F(-1e9)
                    s.clear[to, i] = s.clear[source, i] if inside else _F(-1e9)
                else:
                    s.seen[i, to] = s.seen[i, source] if inside else _F(-1e9)
                    s.clear[i, to] = s.clear[i, source] if inside else _F(-1e9)


@borrowing_kernel
def _find_beams(
    ex: np.float32, ey: np.float32, step: np.float32, c: np.float32, s: np.float32,
    first: np.float32, per: np.float32, beam: Numbers, far: Floats,
) -> None:  # fmt: skip
    """Which beam looks at each cell of a column, and how far its centre is [m]; it vectorises."""
    for j in range(np.uint64(CELLS)):
        y = ey + _F(np.int32(j)) * step
        beam[j] = np.int32((bearing(c * y - s * ex, c * ex + s * y) - first) * per + _F(1.5)) - 1
        far[j] = np.sqrt(ex * ex + y * y)


@borrowing_kernel
def update_grid(g: Any, s: Any, laser: Floats) -> None:
    """Note which cells the scan has looked at, and which it has found empty.

    Every other column at a time, since it is half of a reading's work.
    """
    beams, now, step = laser.shape[0], _F(s.stamp), _F(CELL)
    lx, ly, cl, sl = laser_frame(g, s)
    c, sn = _F(math.cos(s.pose[2])), _F(math.sin(s.pose[2]))
    vacated = _F(s.stamp - max(0.0, g.memory_time - g.vacated_time))
    front, rear = _F(g.outline[0]) + _LOOKED, _F(-g.outline[1]) - _LOOKED
    half = _F(g.outline[2]) - _F(0.02)
    ey, by = (s.corner[1] + 0.5) * CELL - ly, (s.corner[1] + 0.5) * CELL - s.pose[1]
    first, per = _F(g.first), _F(g.per_angle)
    beam, far = s.beam[:], s.range[:]
    reach = math.hypot(max(g.outline[0], g.outline[1]), g.outline[2])
    s.columns = 1 - s.columns
    for i in range((s.corner[0] + s.columns) % 2, CELLS, 2):
        ex = (s.corner[0] + i + 0.5) * CELL - lx
        _find_beams(_F(ex), _F(ey), step, _F(cl), _F(sl), first, per, beam, far)
        for j in range(CELLS):
            b = beam[j]
            if b < 1 or b > beams - 2:
                continue
            d = far[j] + _LOOKED
            if laser[b] >= d and laser[b - 1] >= d and laser[b + 1] >= d:
                s.seen[i, j] = now
                d = far[j] + _BEYOND
                if laser[b] >= d and laser[b - 1] >= d and laser[b + 1] >= d:
                    s.clear[i, j] = now
        # What is wholly under the chair is as good as seen, and for a while after.
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
    """Whether nothing at all stood about a point (dead-reckoned) a moment ago."""
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
    """Whether the cell of a point (dead-reckoned) was looked at since a stamp [s]."""
    i, j = math.floor(x / CELL) - s.corner[0], math.floor(y / CELL) - s.corner[1]
    if i < 0 or j < 0 or i >= CELLS or j >= CELLS:
        return False
    return bool(s.seen[i, j] >= since)
