"""Scan matching: where a scan lies best on a map's field.

First a correlative search of a window of poses, whose blocks are ranked by what they could score at
most (Olson 2009, Real-time correlative scan matching): the best pose of its lattice, never a local
one. Then Gauss-Newton on the interpolated field (Kohlbrecher et al. 2011, equations 5 to 14).

Both use one measurement model: a point where the field is M costs (1 - M)^2 / (2 spread^2); and
both accept a Gaussian prior about the guess. Kernels work in cells; a symmetric matrix is its six
numbers xx, xy, xt, yy, yt, tt.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from wheelchair_gym.base.arrays import Array, Floats
from wheelchair_gym.compiled.kernel import borrowing_kernel, inlined, kernel
from wheelchair_gym.perception.occupancy import Scan

Six = tuple[float, float, float, float, float, float]

SEARCH_WINDOW = 0.20  # m searched on each side of the guess
_SEARCH_ANGLE, _ANGLE_STEP = 0.12, 0.015  # rad on each side, and its steps: a cell at 3.3 m
POINT_SPACING = 0.03  # m between points across the beams: nearer ones carry the same information
MAX_POINTS = 300  # evenly thinned
_RESIDUAL_SIGMA = 0.25  # of 1 - M at one point: wide, as neighbours have correlated errors
_SEARCH_THRESHOLD = 0.5  # mean (1 - M)^2 above which a match by descent is followed by a search
_ITERATIONS = 10  # of Gauss-Newton at most
_RIDGE = 1e-6  # 1/cells2, 1/rad2: keeps the matrix regular where points say nothing
_STILL = 1e-4  # cells, rad: a step of Gauss-Newton that is shorter ends it
_STRIDE = 2.0  # cells: the longest step of Gauss-Newton; the field reaches no farther
_TURN = 0.1  # rad: its largest turn


class Matcher(NamedTuple):
    """Settings, in cells, of the matching of scans to maps."""

    spread: float
    iterations: int
    window: int
    turns: int
    step: float  # rad
    threshold: float


@borrowing_kernel
def misfit(field: Floats, points: Array, x: float, y: float, yaw: float) -> float:
    """Sum of (1 - M)^2 over points (n, 2) [cells] seen from a pose; off the map M is 0."""
    rows, cols = field.shape
    c, s = math.cos(yaw), math.sin(yaw)
    total = 0.0
    for k in range(len(points)):
        u = x + c * points[k, 0] - s * points[k, 1] - 0.5
        v = y + s * points[k, 0] + c * points[k, 1] - 0.5
        gap = 1.0
        if 0.0 <= u < cols - 1 and 0.0 <= v < rows - 1:
            i, j = int(v), int(u)
            a, b = u - j, v - i
            low = (1.0 - a) * field[i, j] + a * field[i, j + 1]
            high = (1.0 - a) * field[i + 1, j] + a * field[i + 1, j + 1]
            gap = 1.0 - (1.0 - b) * low - b * high
        total += gap * gap
    return total


@borrowing_kernel
def _slope(
    field: Floats, points: Array, x: float, y: float, yaw: float
) -> tuple[float, float, float, float, Six]:
    """The misfit, minus half its gradient, and its Gauss-Newton matrix (Kohlbrecher: 12, 13)."""
    rows, cols = field.shape
    c, s = math.cos(yaw), math.sin(yaw)
    total, bx, by, bt = 0.0, 0.0, 0.0, 0.0
    xx, xy, xt, yy, yt, tt = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(len(points)):
        rx, ry = c * points[k, 0] - s * points[k, 1], s * points[k, 0] + c * points[k, 1]
        u, v = x + rx - 0.5, y + ry - 0.5
        if not (0.0 <= u < cols - 1 and 0.0 <= v < rows - 1):
            total += 1.0
            continue
        i, j = int(v), int(u)
        a, b = u - j, v - i
        f00, f01, f10, f11 = field[i, j], field[i, j + 1], field[i + 1, j], field[i + 1, j + 1]
        gx = (1.0 - b) * (f01 - f00) + b * (f11 - f10)
        gy = (1.0 - a) * (f10 - f00) + a * (f11 - f01)
        gap = 1.0 - (1.0 - b) * ((1.0 - a) * f00 + a * f01) - b * ((1.0 - a) * f10 + a * f11)
        gt = gy * rx - gx * ry
        total += gap * gap
        bx += gx * gap
        by += gy * gap
        bt += gt * gap
        xx += gx * gx
        xy += gx * gy
        xt += gx * gt
        yy += gy * gy
        yt += gy * gt
        tt += gt * gt
    return total, bx, by, bt, (xx, xy, xt, yy, yt, tt)


@inlined
def quadratic(m: Six, x: float, y: float, t: float) -> float:
    """The form of a symmetric matrix at a vector."""
    return (
        m[0] * x * x + m[3] * y * y + m[5] * t * t
        + 2.0 * (m[1] * x * y + m[2] * x * t + m[4] * y * t)
    )  # fmt: skip


@borrowing_kernel
def cholesky(m: Six) -> Six:
    """The lower triangle C of m = C C^T, row by row: c00, c10, c11, c20, c21, c22."""
    c00 = math.sqrt(max(m[0], 1e-300))
    c10, c20 = m[1] / c00, m[2] / c00
    c11 = math.sqrt(max(m[3] - c10 * c10, 1e-300))
    c21 = (m[4] - c20 * c10) / c11
    c22 = math.sqrt(max(m[5] - c20 * c20 - c21 * c21, 1e-300))
    return c00, c10, c11, c20, c21, c22


@borrowing_kernel
def forward(c: Six, x: float, y: float, t: float) -> tuple[float, float, float]:
    """Solve C z = (x, y, t)."""
    z0 = x / c[0]
    z1 = (y - c[1] * z0) / c[2]
    return z0, z1, (t - c[3] * z0 - c[4] * z1) / c[5]


@borrowing_kernel
def backward(c: Six, x: float, y: float, t: float) -> tuple[float, float, float]:
    """Solve C^T z = (x, y, t)."""
    z2 = t / c[5]
    z1 = (y - c[4] * z2) / c[2]
    return (x - c[1] * z1 - c[3] * z2) / c[0], z1, z2


@borrowing_kernel
def refine(
    field: Floats, points: Array, guess: Array, prior: Array, info: Six, how: Matcher, out: Array
) -> tuple[float, Six]:
    """Gauss-Newton from a guess to the pose of least cost.

    The prior has a mean and an information matrix. Returns the cost, and the information of the
    posterior there (Laplace).
    """
    x, y, yaw = guess[0], guess[1], guess[2]
    per = 1.0 / (how.spread * how.spread)
    minimum = math.inf
    found = info
    for _ in range(how.iterations + 1):
        total, bx, by, bt, h = _slope(field, points, x, y, yaw)
        dx, dy, dt = prior[0] - x, prior[1] - y, prior[2] - yaw
        cost = 0.5 * (per * total + quadratic(info, dx, dy, dt))
        m = (
            per * h[0] + info[0] + _RIDGE, per * h[1] + info[1], per * h[2] + info[2],
            per * h[3] + info[3] + _RIDGE, per * h[4] + info[4], per * h[5] + info[5] + _RIDGE,
        )  # fmt: skip
        if cost < minimum:
            minimum, found = cost, m
            out[0], out[1], out[2] = x, y, yaw
        c = cholesky(m)
        z0, z1, z2 = forward(
            c,
            per * bx + info[0] * dx + info[1] * dy + info[2] * dt,
            per * by + info[1] * dx + info[3] * dy + info[4] * dt,
            per * bt + info[2] * dx + info[4] * dy + info[5] * dt,
        )
        sx, sy, st = backward(c, z0, z1, z2)
        shrink = min(1.0, _STRIDE / (math.hypot(sx, sy) + 1e-9), _TURN / (abs(st) + 1e-9))
        x, y, yaw = x + shrink * sx, y + shrink * sy, yaw + shrink * st
        if abs(sx) < _STILL and abs(sy) < _STILL and abs(st) < _STILL:
            break
    return minimum, found


_BLOCK = 3  # cells: side of the blocks of the coarse search


@borrowing_kernel
def _raise(line: Floats, over: Floats) -> None:
    """Element-wise maximum of two rows; numba's `max` handles NaN and does not vectorize."""
    for k in range(min(len(line), len(over))):
        over[k] = line[k] if line[k] > over[k] else over[k]


@borrowing_kernel
def _pool(field: Floats, wide: Floats, box: tuple[int, int, int, int]) -> None:
    """The largest value of each block of cells that begins at a cell, within a box."""
    for r in range(box[0], box[1]):
        line, over = field[r, box[2] : box[3]], wide[r, box[2] : box[3]]
        for k in range(len(over)):
            over[k] = line[k]
        for k in range(1, _BLOCK):
            _raise(field[r, box[2] + k : box[3] + k], over)
    for r in range(box[0], box[1]):
        for k in range(1, _BLOCK):
            if r + k < box[1]:
                _raise(wide[r + k, box[2] : box[3]], wide[r, box[2] : box[3]])


@kernel
def search(
    field: Floats, points: Array, guess: Array, info: Six, how: Matcher, wide: Floats, out: Array
) -> float:
    """The pose of least cost on the lattice of cells and angle steps about a guess.

    Returns its cost, with the field of whole cells.
    """
    window, turns, step = how.window, how.turns, how.step
    rows, cols = field.shape
    n = len(points)
    blocks = (2 * window + _BLOCK) // _BLOCK
    size = blocks * _BLOCK  # cells from -window on; those beyond it are searched as well
    yaws = 2 * turns + 1
    place = np.empty((yaws, n, 2), np.int32)
    bound = np.empty(yaws * blocks * blocks)
    bottom, top, left, right = rows, 0, cols, 0
    per = 0.5 / (how.spread * how.spread)
    for a in range(yaws):
        yaw = guess[2] + (a - turns) * step
        c, s = math.cos(yaw), math.sin(yaw)
        for k in range(n):
            place[a, k, 0] = math.floor(guess[1] + s * points[k, 0] + c * points[k, 1]) - window
            place[a, k, 1] = math.floor(guess[0] + c * points[k, 0] - s * points[k, 1]) - window
            bottom, top = min(bottom, place[a, k, 0]), max(top, place[a, k, 0])
            left, right = min(left, place[a, k, 1]), max(right, place[a, k, 1])
    box = (min(max(bottom, 0), rows), max(min(top + size, rows), 0),
           min(max(left, 0), cols), max(min(right + size, cols), 0))  # fmt: skip
    _pool(field, wide, box)
    for a in range(yaws):
        for b in range(blocks * blocks):
            up, aside = (b // blocks) * _BLOCK, (b % blocks) * _BLOCK
            gain = 0.0
            for k in range(n):
                r, q = place[a, k, 0] + up, place[a, k, 1] + aside
                if box[0] <= r < box[1] and box[2] <= q < box[3]:
                    value = wide[r, q]
                    gain += value * (2.0 - value)
                elif -_BLOCK < r < rows and -_BLOCK < q < cols:
                    gain += 1.0  # it may reach into the map from outside
            bound[a * blocks * blocks + b] = per * (n - gain)
    minimum = math.inf
    while True:
        first = int(np.argmin(bound))
        if bound[first] >= minimum:
            break
        bound[first] = math.inf
        a, b = first // (blocks * blocks), first % (blocks * blocks)
        for up in range((b // blocks) * _BLOCK, (b // blocks) * _BLOCK + _BLOCK):
            for aside in range((b % blocks) * _BLOCK, (b % blocks) * _BLOCK + _BLOCK):
                dx, dy, dt = aside - window, up - window, (a - turns) * step
                cost = 0.5 * quadratic(info, dx, dy, dt) + per * n
                for k in range(n):
                    r, q = place[a, k, 0] + up, place[a, k, 1] + aside
                    if 0 <= r < rows and 0 <= q < cols:
                        value = field[r, q]
                        cost -= per * value * (2.0 - value)
                if cost < minimum:
                    minimum = cost
                    out[0], out[1], out[2] = guess[0] + dx, guess[1] + dy, guess[2] + dt
    return minimum


def matcher(resolution: float) -> Matcher:
    """The constants of matching as kernels take them, for cells of a side [m]."""
    window, turns = round(SEARCH_WINDOW / resolution), round(_SEARCH_ANGLE / _ANGLE_STEP)
    return Matcher(_RESIDUAL_SIGMA, _ITERATIONS, window, turns, _ANGLE_STEP, _SEARCH_THRESHOLD)


def thin_scan(scan: Scan, spacing: float, maximum: int) -> Array:
    """Echoes (n, 2), one for each `spacing` [m] across the beams, at most `maximum`.

    The distance between echoes would be no measure: their noise would choose, always towards the
    end of the sweep, and turn the chair.
    """
    points = scan.echoes
    ranges = np.hypot(*(points - scan.origin).T)
    across = np.cumsum(ranges * scan.angle_step)
    kept = points[np.diff(np.floor(across / spacing), prepend=-1.0) > 0.0]
    if len(kept) > maximum:
        kept = kept[np.linspace(0, len(kept) - 1, maximum).astype(np.int64)]
    return np.ascontiguousarray(kept)
