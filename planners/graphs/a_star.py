"""A* on a square lattice whose every edge is tested exactly, then straightened.

Lattice edges are tested against the polygons themselves: a cell that no wall comes near needs no
test. Where a resolution finds nothing, the next is half as wide.
"""

from __future__ import annotations

import math
import time
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from planners.exact import SpaceArrays, clearance, edge_free, fill_buckets
from planners.graphs.heap import pop, push
from planners.refine import shortcut, way_cost
from planners.types import Plan, Problem, Status, trivial
from wheelchair_gym.config import setting, settings
from wheelchair_gym.kernel import borrowing_kernel, kernel

Array = NDArray[np.float64]

MOST_NODES = 8_000_000  # of one lattice: some 300 MB
NEAR = 2  # lattice steps within which the start and the goal are joined to the lattice
TIE = 1.0 + 1e-9  # on the way ahead: of paths that are equal but for rounding, the deepest first


@borrowing_kernel
def _lattice_way(dx: float, dy: float, diagonal: bool) -> float:
    """Length of the shortest way along lattice directions: octile, or Manhattan distance."""
    dx, dy = abs(dx), abs(dy)
    return max(dx, dy) + (math.sqrt(2.0) - 1.0 if diagonal else 1.0) * min(dx, dy)


@kernel
def _search(
    arrays: SpaceArrays,
    walls_near: NDArray[np.int64],
    lattice: Array,
    columns: int,
    ends: Array,
    diagonal: bool,
    weight: float,
    comfort: float,
) -> tuple[Array, int]:
    """The cheapest lattice path from the first to the second of the ends (2, 2), or none; expanded.

    Node i * columns + j lies at lattice[:2] + (j, i) * lattice[2]; the last two are the ends.
    """
    n = walls_near.shape[0]
    rows = n // columns
    left, low, step = lattice[0], lattice[1], lattice[2]
    gx, gy = ends[1, 0], ends[1, 1]
    cost, crowding = np.full(n + 2, math.inf), np.full(n if weight > 0.0 else 1, -1.0)
    parent = np.full(n + 2, -1, dtype=np.int64)
    done = np.zeros(n + 2, dtype=np.bool_)
    keys, items = np.empty(4096), np.empty(4096, dtype=np.int64)
    size, expanded = 1, 0
    keys[0], items[0], cost[n] = 0.0, n, 0.0
    while size > 0:
        u = pop(keys, items, size)
        size -= 1
        if done[u]:
            continue
        done[u] = True
        if u == n + 1:
            break
        expanded += 1
        if u == n:
            x, y = ends[0, 0], ends[0, 1]
            i, j = int((y - low) / step), int((x - left) / step)
        else:
            i, j = u // columns, u % columns
            x, y = left + j * step, low + i * step
        if keys.shape[0] < size + (2 * NEAR + 2) ** 2:
            old_keys, old_items = keys, items
            keys, items = np.empty(2 * size + 64), np.empty(2 * size + 64, dtype=np.int64)
            for k in range(size):
                keys[k], items[k] = old_keys[k], old_items[k]
        reach = NEAR if u == n else 1
        for di in range(-reach, reach + 1 + (u == n)):
            for dj in range(-reach, reach + 1 + (u == n)):
                vi, vj = i + di, j + dj
                if u != n and (not diagonal and di != 0 and dj != 0):
                    continue
                if vi < 0 or vi >= rows or vj < 0 or vj >= columns:
                    continue
                v = vi * columns + vj
                if done[v]:
                    continue
                vx, vy = left + vj * step, low + vi * step
                far = math.hypot(vx - x, vy - y)
                if cost[u] + far >= cost[v]:
                    continue
                if (u == n or walls_near[min(i, vi) * columns + min(j, vj)] > 0) and not edge_free(
                    arrays, x, y, vx, vy
                ):
                    continue
                if weight > 0.0:
                    if u == n:
                        far = way_cost(arrays, x, y, vx, vy, weight, comfort)
                    else:
                        for w in (u, v):
                            if crowding[w] < 0.0:
                                wx, wy = left + (w % columns) * step, low + (w // columns) * step
                                near = 1.0 - clearance(arrays, wx, wy) / comfort
                                crowding[w] = max(0.0, near)
                        far *= 1.0 + 0.5 * weight * (crowding[u] + crowding[v])
                if cost[u] + far < cost[v]:
                    cost[v], parent[v] = cost[u] + far, u
                    ahead = _lattice_way(gx - vx, gy - vy, diagonal) * TIE
                    push(keys, items, size, cost[v] + ahead, v)
                    size += 1
        if (abs(gx - x) <= NEAR * step and abs(gy - y) <= NEAR * step) or u == n:
            far = way_cost(arrays, x, y, gx, gy, weight, comfort)
            if u != n and far > 0.0:  # counted as by the lattice, or the estimate were no bound
                far *= _lattice_way(gx - x, gy - y, diagonal) / math.hypot(gx - x, gy - y)
            if cost[u] + far < cost[n + 1] and edge_free(arrays, x, y, gx, gy):
                cost[n + 1], parent[n + 1] = cost[u] + far, u
                push(keys, items, size, cost[n + 1], n + 1)
                size += 1
    count, u = 0, n + 1
    while u >= 0 and done[n + 1]:
        count += 1
        u = parent[u]
    path = np.empty((count, 2))
    u = n + 1
    for k in range(count - 1, -1, -1):
        if u >= n:
            path[k] = ends[u - n]
        else:
            path[k, 0], path[k, 1] = left + (u % columns) * step, low + (u // columns) * step
        u = parent[u]
    return path, expanded


@settings
class AStar:
    """A* over lattice points; with a weight it keeps a comfortable distance where there is room."""

    resolution: float = setting(
        default=0.1, unit="m", source="a tenth of a door's width", low=0.005, high=10.0
    )
    connectivity: Literal[4, 8] = setting(default=8, source="fewer turns than with 4")
    refinements: int = setting(
        default=2, source="times the resolution is halved where no path is found", low=0, high=6
    )
    shortcut: bool = setting(default=True, source="straighten the lattice path, at no higher cost")
    weight: float = setting(
        default=0.0,
        source="how much more a metre costs at an obstacle than in the open; 0: length alone",
        low=0.0,
        high=1000.0,
    )
    comfort: float = setting(
        default=0.5, unit="m", source="clearance that costs no more", low=0.01, high=100.0
    )

    def plan(self, problem: Problem, rng: np.random.Generator) -> Plan:
        """Find a path; a lattice proves nothing, so failure is `exhausted`. No use of `rng`."""
        began = time.perf_counter()
        plan = trivial(problem)
        if plan is not None:
            return plan
        arrays = problem.free.arrays
        ends = np.array([problem.start[:2], problem.goal[:2]], dtype=np.float64)
        xmin, ymin, xmax, ymax = problem.free.bounds
        path, total, halvings = np.empty((0, 2)), 0, 0
        for halvings in range(self.refinements + 1):
            step = self.resolution / 2**halvings
            columns, rows = int((xmax - xmin) / step) + 1, int((ymax - ymin) / step) + 1
            if rows * columns > MOST_NODES:
                break
            lattice = np.array([xmin, ymin, step])
            walls_near = np.zeros(rows * columns, dtype=np.int64)
            nothing = np.empty(0, dtype=np.int32)
            fill_buckets(arrays.segments, lattice, rows, columns, walls_near, nothing)
            path, expanded = _search(
                arrays,
                walls_near,
                lattice,
                columns,
                ends,
                self.connectivity == 8,
                self.weight,
                self.comfort,
            )
            total += expanded
            if len(path):
                break
        if len(path) and self.shortcut:
            path = shortcut(path, problem.free, self.weight, self.comfort)
        return Plan(
            Status.SOLVED if len(path) else Status.EXHAUSTED,
            path,
            counters={"nodes": total, "halvings": halvings},
            timings={"time_s": time.perf_counter() - began},
        )
