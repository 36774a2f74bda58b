"""Clearance of paths: points are moved away from walls where that lowers the path's cost."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from planners.collision.polygon_tests import SpaceArrays, edge_free
from planners.smoothing.shortcut import edge_cost
from wheelchair_gym.compiled.kernel import kernel

Array = NDArray[np.float64]

HEADINGS = 8  # directions in which a point is moved


@kernel
def resample(path: Array, spacing: float) -> Array:
    """The same path with points at most a spacing [m] apart."""
    n = path.shape[0]
    count = 1
    for k in range(n - 1):
        length = math.hypot(path[k + 1, 0] - path[k, 0], path[k + 1, 1] - path[k, 1])
        count += max(1, math.ceil(length / spacing))
    points = np.empty((count, 2))
    points[0] = path[0]
    count = 1
    for k in range(n - 1):
        dx, dy = path[k + 1, 0] - path[k, 0], path[k + 1, 1] - path[k, 1]
        parts = max(1, math.ceil(math.hypot(dx, dy) / spacing))
        for m in range(1, parts):
            points[count, 0] = path[k, 0] + m / parts * dx
            points[count, 1] = path[k, 1] + m / parts * dy
            count += 1
        points[count] = path[k + 1]
        count += 1
    return points


@kernel
def path_cost(arrays: SpaceArrays, path: Array, weight: float, comfort: float) -> float:
    """The sum of `edge_cost` over a path (n, 2)."""
    total = 0.0
    for k in range(path.shape[0] - 1):
        ax, ay, bx, by = path[k, 0], path[k, 1], path[k + 1, 0], path[k + 1, 1]
        total += edge_cost(arrays, ax, ay, bx, by, weight, comfort)
    return total


@kernel
def push_off_walls(
    arrays: SpaceArrays, path: Array, weight: float, comfort: float, step: float, sweeps: int
) -> Array:
    """The path (n, 2) after coordinate descent of its inner points on `edge_cost`.

    Args:
        arrays: what is free.
        path: points [m], all edges free.
        weight: of `edge_cost`.
        comfort: of `edge_cost` [m].
        step: first distance by which a point is moved [m]; halved when no point moves any more.
        sweeps: how often all points are tried.
    """
    points = path.copy()
    settled = np.zeros(points.shape[0], dtype=np.bool_)  # since it or a neighbour moved
    for _ in range(sweeps):
        moves = 0
        for i in range(1, points.shape[0] - 1):
            if settled[i]:
                continue
            settled[i] = True
            ax, ay, bx, by = points[i - 1, 0], points[i - 1, 1], points[i + 1, 0], points[i + 1, 1]
            x, y = points[i, 0], points[i, 1]
            least = edge_cost(arrays, ax, ay, x, y, weight, comfort)
            least += edge_cost(arrays, x, y, bx, by, weight, comfort)
            least *= 1.0 - 1e-9  # rounding is no gain
            for k in range(HEADINGS):
                angle = 2.0 * math.pi * k / HEADINGS
                to_x, to_y = x + step * math.cos(angle), y + step * math.sin(angle)
                if not edge_free(arrays, ax, ay, to_x, to_y):
                    continue
                cost = edge_cost(arrays, ax, ay, to_x, to_y, weight, comfort)
                if cost >= least or not edge_free(arrays, to_x, to_y, bx, by):
                    continue
                cost += edge_cost(arrays, to_x, to_y, bx, by, weight, comfort)
                if cost < least:
                    least = cost
                    points[i, 0], points[i, 1] = to_x, to_y
                    settled[i - 1] = settled[i] = settled[i + 1] = False
                    moves += 1
        if moves == 0:
            step *= 0.5
            settled[:] = False
    return points
