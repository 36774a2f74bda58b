"""Gauss-Newton on an interpolated field (Kohlbrecher et al. 2011, equations 5 to 14).

A point where the field is M costs (1 - M)^2 / (2 spread^2). Lengths are in cells; a symmetric
matrix is its six numbers xx, xy, xt, yy, yt, tt.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.kernel import borrowing_kernel, inlined

Array = NDArray[np.float64]
Floats = NDArray[np.float32]
Six = tuple[float, float, float, float, float, float]

_RIDGE = 1e-6  # 1/cells2, 1/rad2: what no point tells is still a number
_STILL = 1e-4  # cells, rad: a step of Gauss-Newton that is shorter ends it
_STRIDE = 2.0  # cells: the longest step of Gauss-Newton; the field tells no farther
_TURN = 0.1  # rad: its largest turn


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
    field: Floats, points: Array, guess: Array, prior: Array, told: Six, spread: float, most: int,
    out: Array,
) -> tuple[float, Six]:  # fmt: skip
    """Gauss-Newton from a guess to the pose of least cost.

    Args:
        field: (rows, cols).
        points: (n, 2) [cells] in the chair's frame.
        guess: (3,) x, y [cells], yaw [rad].
        prior: (3,) mean of the prior.
        told: information of the prior.
        spread: of one point.
        most: iterations.
        out: (3,) the pose found.

    Returns:
        Its cost, and the information of the posterior there (Laplace).
    """
    x, y, yaw = guess[0], guess[1], guess[2]
    per = 1.0 / (spread * spread)
    least = math.inf
    found = told
    for _ in range(most + 1):
        total, bx, by, bt, h = _slope(field, points, x, y, yaw)
        dx, dy, dt = prior[0] - x, prior[1] - y, prior[2] - yaw
        cost = 0.5 * (per * total + quadratic(told, dx, dy, dt))
        m = (
            per * h[0] + told[0] + _RIDGE, per * h[1] + told[1], per * h[2] + told[2],
            per * h[3] + told[3] + _RIDGE, per * h[4] + told[4], per * h[5] + told[5] + _RIDGE,
        )  # fmt: skip
        if cost < least:
            least, found = cost, m
            out[0], out[1], out[2] = x, y, yaw
        c = cholesky(m)
        z0, z1, z2 = forward(
            c,
            per * bx + told[0] * dx + told[1] * dy + told[2] * dt,
            per * by + told[1] * dx + told[3] * dy + told[4] * dt,
            per * bt + told[2] * dx + told[4] * dy + told[5] * dt,
        )
        sx, sy, st = backward(c, z0, z1, z2)
        shrink = min(1.0, _STRIDE / (math.hypot(sx, sy) + 1e-9), _TURN / (abs(st) + 1e-9))
        x, y, yaw = x + shrink * sx, y + shrink * sy, yaw + shrink * st
        if abs(sx) < _STILL and abs(sy) < _STILL and abs(st) < _STILL:
            break
    return least, found
