"""Smooth free curves through the points of a path, as polylines whose edges are tested exactly.

`hermite_path` shortens tangents where its curve is not free, so that it approaches the path.
"""

from __future__ import annotations

import math

import numpy as np

from planners.collision.polygon_tests import SpaceArrays, edge_free
from wheelchair_gym.arrays import Array, Mask
from wheelchair_gym.compiled.kernel import kernel

HALVINGS = 8  # of a blocked curve's tangents before it is straight: those of 1/256 bend invisibly


@kernel
def blocked_edges(arrays: SpaceArrays, path: Array) -> Mask:
    """Which edges (n - 1,) of a path (n, 2) [m] are not free."""
    blocked = np.empty(path.shape[0] - 1, dtype=np.bool_)
    for k in range(path.shape[0] - 1):
        free = edge_free(arrays, path[k, 0], path[k, 1], path[k + 1, 0], path[k + 1, 1])
        blocked[k] = not free
    return blocked


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


def hermite_path(arrays: SpaceArrays, path: Array, tolerance: float) -> tuple[Array, int]:
    """A free polyline (k, 2) [m] along cubic Hermite curves, and how many edges stay straight.

    Args:
        arrays: what is free.
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
