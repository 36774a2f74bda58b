"""Smooth free curves through the points of a path, as polylines whose edges are tested exactly.

`smooth_curve` adds knots where its curve is not free; `hermite_path` shortens tangents there. So
both approach the path, which is free.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicHermiteSpline

from planners.collision.polygon_tests import SpaceArrays, edge_free
from planners.smoothing.curves import pchip_slopes, spline_slopes
from wheelchair_gym.compiled.kernel import kernel
from wheelchair_gym.geometry import arc_lengths, without_repeats

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

# Fractions at which a knot is tried between two: along a slanted wall, rounding may exclude some.
PARTS = (0.5, 0.45, 0.55, 0.4, 0.6, 0.35, 0.65, 0.3, 0.7)
_TURN = math.sqrt(0.5) * np.array([(1.0, -1.0), (1.0, 1.0)])


@kernel
def blocked_edges(arrays: SpaceArrays, path: Array) -> Flags:
    """Which edges (n - 1,) of a path (n, 2) [m] are not free."""
    blocked = np.empty(path.shape[0] - 1, dtype=np.bool_)
    for k in range(path.shape[0] - 1):
        free = edge_free(arrays, path[k, 0], path[k, 1], path[k + 1, 0], path[k + 1, 1])
        blocked[k] = not free
    return blocked


def pchip(way: Array, knots: Array) -> Any:
    """PCHIP, a piecewise cubic without overshoot, in a frame turned by 45 deg.

    Where a coordinate stops rising its slope is zero: in a frame along the walls, a right angle
    would stay as sharp as it is.
    """
    slopes = np.empty_like(knots)
    pchip_slopes(way, knots @ _TURN, len(knots), slopes)
    return CubicHermiteSpline(way, knots, slopes @ _TURN.T)


def spline(way: Array, knots: Array) -> Any:
    """A natural cubic spline: its second derivative is continuous."""
    slopes = np.empty_like(knots)
    spline_slopes(way, knots, len(knots), True, np.empty(len(knots)), slopes)
    return CubicHermiteSpline(way, knots, slopes)


class Sampled(NamedTuple):
    """A curve as a polyline."""

    points: Array  # (n, 2) m
    interval: NDArray[np.int64]  # (n - 1,) between which knots each edge lies


def sampled(curve: Any, knots: Array, tolerance: float) -> Sampled:
    """A polyline that no point of a cubic curve lies farther from than the tolerance [m].

    It passes through the knots (n, 2) themselves, to the last digit.
    """
    way, (cubic, square) = curve.x, curve.c[:2]
    h = np.diff(way)
    bend = np.maximum(  # the second derivative is linear in between: its greatest is at an end
        np.hypot(*(2.0 * square).T), np.hypot(*(6.0 * cubic * h[:, None] + 2.0 * square).T)
    )
    parts = np.maximum(1, np.ceil(h * np.sqrt(bend / (8.0 * tolerance)))).astype(np.int64)
    interval = np.repeat(np.arange(len(h)), parts)
    step = np.arange(len(interval)) - np.repeat(np.cumsum(parts) - parts, parts)
    at = way[interval] + h[interval] * step / parts[interval]
    points = np.vstack([np.where((step == 0)[:, None], knots[interval], curve(at)), knots[-1:]])
    return Sampled(points, interval)


def _more_knots(arrays: SpaceArrays, knots: Array, where: Flags) -> Array:
    """Knots (n, 2) with one more in each marked interval (n - 1,), on the way itself."""
    found = [knots[0]]
    for k, wanted in enumerate(where):
        a, b = knots[k], knots[k + 1]
        for part in PARTS if wanted else ():
            knot = a + part * (b - a)
            apart = (knot != a).any() and (knot != b).any()
            if apart and edge_free(arrays, *a, *knot) and edge_free(arrays, *knot, *b):
                found.append(knot)
                break
        found.append(b)
    return np.array(found)


def smooth_curve(
    arrays: SpaceArrays,
    path: Array,
    through: Callable[[Array, Array], Any],
    tolerance: float,
    spacing: float,
    rounds: int,
) -> Array | str:
    """A free polyline (k, 2) [m] along a smooth curve through a free path, or why there is none.

    `through` makes the curve of the arc length [m] at each knot, and of the knots. The curve lies
    within the tolerance [m] of its polyline; knots are at most `spacing` [m] apart at first; they
    are added up to `rounds` times.
    """
    knots = without_repeats(path)
    if len(knots) < 3:
        return "a straight path is smooth already"
    for _ in range(64):  # halving any way that doubles hold
        long = np.hypot(*np.diff(knots, axis=0).T) > spacing
        count = len(knots)
        knots = _more_knots(arrays, knots, long) if long.any() else knots
        if len(knots) == count:
            break
    trial, blocked = Sampled(knots, np.arange(len(knots) - 1)), np.zeros(0, dtype=np.bool_)
    for _ in range(rounds + 1):
        way = arc_lengths(knots)
        if not (np.diff(way) > 0.0).all():
            break
        trial = sampled(through(way, knots), knots, tolerance)
        blocked = blocked_edges(arrays, trial.points)
        if not blocked.any():
            return trial.points
        where = np.zeros(len(knots) - 1, dtype=np.bool_)
        where[trial.interval[blocked]] = True
        knots = _more_knots(arrays, knots, where)
    x, y = trial.points[int(np.flatnonzero(blocked)[0])] if blocked.any() else (math.nan, math.nan)
    return f"no smooth curve is free: {int(blocked.sum())} edges are not, near ({x:.2f}, {y:.2f})"


@kernel
def _hermite_edge(start: Array, end: Array, u: Array, v: Array, tolerance: float) -> Array:
    """Points (n + 1, 2) [m] of a cubic Hermite curve over an edge, with tangents u and v.

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


def hermite_path(
    arrays: SpaceArrays, path: Array, tangent_scale: float, halvings: int, tolerance: float
) -> tuple[Array, int]:
    """A free polyline (k, 2) [m] along cubic Hermite curves, and how many edges stay straight.

    Args:
        arrays: what is free.
        path: points (n, 2) [m], each edge free, no two successive points the same.
        tangent_scale: length of the tangents, in lengths of the edge; 1 is Catmull and Rom's.
        halvings: how often a blocked curve halves its tangents before it is straight.
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
        piece, size = path[i : i + 2], tangent_scale * length
        for _ in range(halvings if size > 0.0 else 0):
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
