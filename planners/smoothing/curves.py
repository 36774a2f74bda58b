"""Curves through points: polyline, PCHIP, cubic splines; cut into pieces for exact edge tests.

Every curve is a cubic Hermite interpolant of x and of y over knots; only its slopes differ. The
slopes of `hermite_path` are shortened until its curve is free.
"""

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from planners.collision.polygon_tests import SpaceArrays, blocked_edges
from wheelchair_gym.base.arrays import Array
from wheelchair_gym.compiled.kernel import borrowing_kernel, inlined, kernel

POLYLINE, PCHIP, SPLINE = range(3)
# `spline` is not-a-knot, as MATLAB's spline and scipy's CubicSpline are.
CURVES: Final = {"polyline": POLYLINE, "pchip": PCHIP, "spline": SPLINE}
# Knots nearer than this are drawn apart: points may coincide [m, or knots].
_APART = 1e-9
HALVINGS = 8  # of a blocked curve's tangents before it is straight: those of 1/256 bend invisibly


class CurveWorkspace(NamedTuple):
    """Arrays for a curve through at most n points."""

    knots: Array  # (n,)
    slopes: Array  # (n, 2) of x and y over the knots
    band: Array  # (n,) of the elimination


def new_curve_workspace(n: int) -> CurveWorkspace:
    """Return arrays for curves through n points."""
    return CurveWorkspace(np.empty(n), np.empty((n, 2)), np.empty(n))


@inlined
def _end_slope(h: float, g: float, near: float, far: float) -> float:
    """Return PCHIP's slope at an end, from three points (Moler 2004, section 3.6)."""
    slope = ((2.0 * h + g) * near - h * far) / (h + g)
    if slope * near <= 0.0:
        slope = 0.0
    elif near * far <= 0.0 and abs(slope) > 3.0 * abs(near):
        slope = 3.0 * near
    return slope


@borrowing_kernel
def pchip_slopes(knots: Array, points: Array, slopes: Array) -> None:
    """Write shape-preserving slopes: weighted harmonic means (Fritsch and Butland 1984).

    There are at least 3 points, at rising knots.
    """
    n = points.shape[0]
    for c in range(2):
        h = knots[1] - knots[0]
        before = (points[1, c] - points[0, c]) / h
        for k in range(1, n - 1):
            g = knots[k + 1] - knots[k]
            after = (points[k + 1, c] - points[k, c]) / g
            if k == 1:
                slopes[0, c] = _end_slope(h, g, before, after)
            if before * after <= 0.0:
                slopes[k, c] = 0.0
            else:
                u, v = 2.0 * g + h, g + 2.0 * h
                slopes[k, c] = (u + v) / (u / before + v / after)
            if k == n - 2:
                slopes[n - 1, c] = _end_slope(g, h, after, before)
            h, before = g, after


@borrowing_kernel
def spline_slopes(knots: Array, points: Array, band: Array, slopes: Array) -> None:
    """Write slopes that make the second derivative continuous (de Boor 1978, chapter IV).

    There are at least 3 points, at rising knots. The first two pieces are one cubic, and so are
    the last two.
    """
    n = points.shape[0]
    for c in range(2):
        first = (points[1, c] - points[0, c]) / (knots[1] - knots[0])
        h, g = knots[1] - knots[0], knots[2] - knots[1]
        second = (points[2, c] - points[1, c]) / g
        if n == 3:  # one parabola
            bend = (second - first) / (h + g)
            slopes[0, c] = first - bend * h
            slopes[1, c] = first + bend * h
            slopes[2, c] = second + bend * g
            continue
        # Tridiagonal: band[k] is the upper diagonal after elimination, slopes the right side.
        d = h + g
        band[0] = d / g
        slopes[0, c] = ((h + 2.0 * d) * g * first + h * h * second) / (d * g)
        for k in range(1, n - 1):
            h, g = knots[k] - knots[k - 1], knots[k + 1] - knots[k]
            first = (points[k, c] - points[k - 1, c]) / h
            second = (points[k + 1, c] - points[k, c]) / g
            pivot = 2.0 * (h + g) - g * band[k - 1]
            band[k] = h / pivot
            right = 3.0 * (g * first + h * second)
            slopes[k, c] = (right - g * slopes[k - 1, c]) / pivot
        d = h + g
        right = (g * g * first + (2.0 * d + g) * h * second) / d
        slopes[n - 1, c] = (right - d * slopes[n - 2, c]) / (h - d * band[n - 2])
        for k in range(n - 2, -1, -1):
            slopes[k, c] -= band[k] * slopes[k + 1, c]


@borrowing_kernel
def sample_curve(
    kind: int, chordal: bool, points: Array, pieces: int, work: CurveWorkspace, line: Array
) -> None:
    """Cut a curve through points (n, 2) [m] into straight pieces.

    Knots are as far apart as the points (chordal), or 0, 1, 2 ... Each leg between two points gets
    `pieces`; the line ((n - 1) * pieces + 1, 2) holds the points themselves.
    """
    n, knots, slopes = points.shape[0], work.knots, work.slopes
    kind = kind if n > 2 else POLYLINE
    if kind != POLYLINE and pieces > 1:
        knots[0] = 0.0
        for k in range(1, n):
            gap = 1.0
            if chordal:
                dx, dy = points[k, 0] - points[k - 1, 0], points[k, 1] - points[k - 1, 1]
                gap = max(_APART, math.hypot(dx, dy))
            knots[k] = knots[k - 1] + gap
        if kind == PCHIP:
            pchip_slopes(knots, points, slopes)
        else:
            spline_slopes(knots, points, work.band, slopes)
    count = 0
    for k in range(n - 1):
        if pieces == 1:
            line[k, 0], line[k, 1] = points[k, 0], points[k, 1]
            count += 1
            continue
        for m in range(pieces):
            s = m / pieces
            for c in range(2):
                y, z = points[k, c], points[k + 1, c]
                if kind == POLYLINE:
                    line[count, c] = y + s * (z - y)
                elif m == 0:
                    line[count, c] = y
                else:
                    h = knots[k + 1] - knots[k]
                    rise = z - y
                    p, q = slopes[k, c] * h - rise, slopes[k + 1, c] * h - rise
                    line[count, c] = y + s * (rise + (1.0 - s) * (p * (1.0 - s) - q * s))
            count += 1
    line[count, 0], line[count, 1] = points[n - 1, 0], points[n - 1, 1]


def curve(points: ArrayLike, name: str = "pchip", pieces: int = 20, chordal: bool = True) -> Array:
    """Return a curve through points, as a polyline that holds the points.

    Args:
        points: (n, 2) m, n at least 2.
        name: one of `CURVES`.
        pieces: straight pieces between two points, at least 1.
        chordal: knots as far apart as the points are; otherwise 0, 1, 2 ...

    Returns:
        ((n - 1) * pieces + 1, 2) m. It may meet obstacles: test its edges.
    """
    through = np.ascontiguousarray(points, dtype=np.float64)
    n = len(through)
    line = np.empty(((n - 1) * pieces + 1, 2))
    sample_curve(CURVES[name], chordal, through, pieces, new_curve_workspace(n), line)
    return line


@kernel
def _hermite_edge(start: Array, end: Array, u: Array, v: Array, tolerance: float) -> Array:
    """Return points (n + 1, 2) [m] of a cubic Hermite curve over an edge, with tangents u and v.

    A polyline of n equal pieces errs by at most |p''| / (8 n^2); p'' is linear, so that its ends
    bound it.
    """
    step = end - start
    first, last = 6.0 * step - 4.0 * u - 2.0 * v, 6.0 * step - 2.0 * u - 4.0 * v
    bend = max(math.hypot(first[0], first[1]), math.hypot(last[0], last[1]))
    n = max(math.ceil(math.sqrt(bend / (8.0 * tolerance))), 1)
    points = np.empty((n + 1, 2))
    points[0], points[n] = start, end
    for k in range(1, n):
        t = k / n
        s = 1.0 - t
        a, b, c = t * s * s, t * t * s, t * t * (3.0 - 2.0 * t)
        for axis in range(2):
            points[k, axis] = start[axis] + a * u[axis] - b * v[axis] + c * step[axis]
    return points


def hermite_path(arrays: SpaceArrays, path: Array, tolerance: float) -> tuple[Array, int]:
    """Return a free polyline (k, 2) [m] along Hermite curves, and the number of straight edges.

    The tangents of a curve that is not free are shortened, so that it approaches the path.

    Args:
        arrays: the free space.
        path: points (n, 2) [m], each edge free, no two successive points the same.
        tolerance: largest distance of the polyline from the curve [m].
    """
    steps = np.diff(path, axis=0)
    lengths = np.hypot(*steps.T)
    units = np.vstack([np.zeros(2), steps / lengths[:, None], np.zeros(2)])
    bisectors = units[:-1] + units[1:]
    sizes = np.hypot(*bisectors.T)[:, None]
    # A path that turns straight back has no tangent there.
    directions = np.divide(bisectors, sizes, out=np.zeros_like(path), where=sizes > 0.0)
    pieces, straight = [path[:1]], 0
    for i, length in enumerate(lengths):
        piece, size = path[i : i + 2], length  # as Catmull and Rom 1974
        for _ in range(HALVINGS if size > 0.0 else 0):
            u, v = size * directions[i : i + 2]
            curve = _hermite_edge(path[i], path[i + 1], u, v, tolerance)
            if not blocked_edges(arrays, curve).any():
                piece = curve
                break
            size *= 0.5
        else:
            straight += size > 0.0
        pieces.append(piece[1:])
    return np.concatenate(pieces), straight
