"""The cost of a path near obstacles, and shortcuts that lower it."""

import math

import numpy as np
from numpy.typing import ArrayLike

from planners.collision.polygon_tests import SpaceArrays, clearance, edge_free
from planners.collision.space import Space
from planners.graphs.heap import nodes_to
from wheelchair_gym.base.arrays import Array
from wheelchair_gym.compiled.kernel import borrowing_kernel, kernel

WINDOW = 250  # corners that one shortcut may skip at most: bounds the work on very long paths


@borrowing_kernel
def edge_cost(
    arrays: SpaceArrays, ax: float, ay: float, bx: float, by: float, weight: float, comfort: float
) -> float:
    """Return the length [m] of the edge from a to b times 1 + weight max(0, 1 - clearance/comfort).

    The factor is averaged over points at most a quarter of the comfort apart.
    """
    length = math.hypot(bx - ax, by - ay)
    if weight == 0.0:
        return length
    parts = max(1, math.ceil(4.0 * length / comfort))
    crowding = 0.0
    for k in range(parts + 1):
        t = k / parts
        near = 1.0 - clearance(arrays, ax + t * (bx - ax), ay + t * (by - ay)) / comfort
        crowding += max(0.0, near) * (0.5 if k in (0, parts) else 1.0)
    return length * (1.0 + weight * crowding / parts)


@kernel
def _straightened(arrays: SpaceArrays, path: Array) -> Array:
    """Return the path (n, 2) without points between two that lie on one line with them."""
    kept = np.empty_like(path)
    kept[0] = path[0]
    count = 1
    for k in range(1, path.shape[0] - 1):
        ax, ay = kept[count - 1, 0], kept[count - 1, 1]
        ux, uy = path[k, 0] - ax, path[k, 1] - ay
        vx, vy = path[k + 1, 0] - path[k, 0], path[k + 1, 1] - path[k, 1]
        bend = abs(ux * vy - uy * vx) > 1e-9 * math.hypot(ux, uy) * math.hypot(vx, vy)
        if (
            bend
            or ux * vx + uy * vy < 0.0
            or not edge_free(arrays, ax, ay, path[k + 1, 0], path[k + 1, 1])
        ):
            kept[count] = path[k]
            count += 1
    kept[count] = path[path.shape[0] - 1]
    return kept[: count + 1]


@kernel
def _cheapest(arrays: SpaceArrays, path: Array, weight: float, comfort: float) -> Array:
    """Return the cheapest path from the first point to the last over some of the points."""
    n = path.shape[0]
    cost = np.full(n, math.inf)
    parent = np.zeros(n, dtype=np.int64)
    cost[0] = 0.0
    for k in range(1, n):
        for m in range(k - 1, max(-1, k - 1 - WINDOW), -1):
            ax, ay, bx, by = path[m, 0], path[m, 1], path[k, 0], path[k, 1]
            if cost[m] + math.hypot(bx - ax, by - ay) >= cost[k]:
                continue
            if m < k - 1 and not edge_free(arrays, ax, ay, bx, by):
                continue
            through = cost[m] + edge_cost(arrays, ax, ay, bx, by, weight, comfort)
            if through < cost[k]:
                cost[k], parent[k] = through, m
    return path[nodes_to(parent, n - 1)]


def shortcut(path: ArrayLike, space: Space, weight: float = 0.0, comfort: float = 1.0) -> Array:
    """Return the cheapest path over some of a path's points, with exact edge tests.

    Args:
        path: points (n, 2 or 3) of a path that is free; a heading (third column) is dropped.
        space: the free space of a point.
        weight: additional cost of a metre at an obstacle; 0: length alone.
        comfort: clearance [m] from which on there is no additional cost.

    Returns:
        (k, 2), k <= n, from the same start to the same goal; never costlier than the path.
    """
    points = np.ascontiguousarray(np.asarray(path, dtype=np.float64)[:, :2])
    if len(points) < 3:
        return points
    arrays = space.arrays
    return _cheapest(arrays, _straightened(arrays, points), weight, comfort)


def subdivided(segments: Array, spacing: float, min_parts: int = 1) -> Array:
    """Cut segments (k, 4) [m] into parts of at most a spacing; return their beginnings (n, 2)."""
    steps = segments[:, 2:] - segments[:, :2]
    parts = np.maximum(min_parts, np.ceil(np.hypot(*steps.T) / spacing)).astype(np.int64)
    first = np.cumsum(parts) - parts
    t = (np.arange(parts.sum()) - np.repeat(first, parts)) / np.repeat(parts, parts)
    starts, ways = np.repeat(segments[:, :2], parts, axis=0), np.repeat(steps, parts, axis=0)
    points: Array = starts + t[:, None] * ways
    return points


def resample(path: Array, spacing: float) -> Array:
    """Return the same path with points at most a spacing [m] apart."""
    return np.vstack([subdivided(np.hstack([path[:-1], path[1:]]), spacing), path[-1:]])
