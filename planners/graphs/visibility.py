"""The exact optimum: A* over the corners of what is solid, edges tested only when they matter.

A shortest path bends only at convex corners, and only round them. So an edge is a candidate if it
is tangent to the solid at both its ends and continues the way there with a bend round the corner;
whether it is free is asked when its turn comes, which for most never happens.
"""

from __future__ import annotations

import math
import time

import numpy as np
from numpy.typing import NDArray

from planners.exact import SpaceArrays, edge_free, side
from planners.graphs.heap import pop, push
from planners.types import Plan, Problem, Status, trivial
from wheelchair_gym.config import settings
from wheelchair_gym.kernel import kernel

Array = NDArray[np.float64]


@kernel
def _bends(arrays: SpaceArrays, start: Array, goal: Array) -> tuple[Array, Array, Array]:
    """Nodes (n, 2): start, goal, convex corners; and the corners (n, 2) before and after each."""
    segments, before = arrays.segments, arrays.before
    nodes = np.empty((segments.shape[0] + 2, 2))
    sides = np.empty((segments.shape[0] + 2, 2))
    after = np.empty((segments.shape[0] + 2, 2))
    for m in range(2):
        end = start if m == 0 else goal
        for axis in range(2):
            # Neighbours that coincide with the node are on no side: an end is tangent to anything.
            nodes[m, axis] = sides[m, axis] = after[m, axis] = end[axis]
    count = 2
    for k in range(segments.shape[0]):
        px, py, cx, cy = before[k, 0], before[k, 1], segments[k, 0], segments[k, 1]
        if side(px, py, cx, cy, segments[k, 2], segments[k, 3]) > 0.0:
            sides[count, 0], sides[count, 1] = px, py
            nodes[count, 0], nodes[count, 1] = cx, cy
            after[count, 0], after[count, 1] = segments[k, 2], segments[k, 3]
            count += 1
    return nodes[:count], sides[:count], after[:count]


@kernel
def _search(
    arrays: SpaceArrays, nodes: Array, before: Array, after: Array
) -> tuple[NDArray[np.int64], int, int]:
    """Parents (n,) of the nodes reached, -1 elsewhere; nodes expanded, edges tested."""
    n = nodes.shape[0]
    parent = np.full(n, -1, dtype=np.int64)
    cost = np.full(n, math.inf)
    gx, gy = nodes[1, 0], nodes[1, 1]
    keys, items = np.empty(8 * n + 64), np.empty(8 * n + 64, dtype=np.int64)
    size, expanded, tested = 1, 0, 0
    keys[0], items[0] = 0.0, 0  # from the start to itself
    while size > 0:
        item = pop(keys, items, size)
        size -= 1
        t, u = item // n, item % n
        if parent[u] >= 0:
            continue
        tx, ty, ux, uy = nodes[t, 0], nodes[t, 1], nodes[u, 0], nodes[u, 1]
        tested += 1
        if not edge_free(arrays, tx, ty, ux, uy):
            continue
        parent[u] = t
        cost[u] = 0.0 if u == 0 else cost[t] + math.hypot(ux - tx, uy - ty)
        if u == 1:
            break
        expanded += 1
        px, py, dx, dy = before[u, 0], before[u, 1], after[u, 0], after[u, 1]
        hand = side(tx, ty, ux, uy, px, py) + side(tx, ty, ux, uy, dx, dy)
        if keys.shape[0] < size + n:
            more = max(2 * keys.shape[0], size + n)
            old_keys, old_items = keys, items
            keys, items = np.empty(more), np.empty(more, dtype=np.int64)
            for k in range(size):
                keys[k], items[k] = old_keys[k], old_items[k]
        for v in range(1, n):
            if parent[v] >= 0:
                continue
            vx, vy = nodes[v, 0], nodes[v, 1]
            if u >= 2:
                # What is solid at u lies to the left (hand > 0) or right of the way there: the
                # way on bends to that hand, and leaves both its sides there.
                turn = side(tx, ty, ux, uy, vx, vy)
                if (hand > 0.0 and turn < 0.0) or (hand < 0.0 and turn > 0.0):
                    continue
                p, d = side(ux, uy, vx, vy, px, py), side(ux, uy, vx, vy, dx, dy)
                if (p < 0.0 and d > 0.0) or (p > 0.0 and d < 0.0):
                    continue
            p = side(ux, uy, vx, vy, before[v, 0], before[v, 1])
            d = side(ux, uy, vx, vy, after[v, 0], after[v, 1])
            if (p < 0.0 and d > 0.0) or (p > 0.0 and d < 0.0):
                continue
            key = cost[u] + math.hypot(vx - ux, vy - uy) + math.hypot(gx - vx, gy - vy)
            push(keys, items, size, key, u * n + v)
            size += 1
    return parent, expanded, tested


@settings
class Visibility:
    """Shortest paths, exactly; it proves it where there is none."""

    def plan(self, problem: Problem, rng: np.random.Generator) -> Plan:
        """Find the shortest path; the generator is not used."""
        began = time.perf_counter()
        plan = trivial(problem)
        if plan is not None:
            return plan
        arrays = problem.free.arrays
        start, goal = (np.array(p[:2], dtype=np.float64) for p in (problem.start, problem.goal))
        nodes, before, after = _bends(arrays, start, goal)
        parent, expanded, tested = _search(arrays, nodes, before, after)
        counters = {"nodes": len(nodes), "expanded": expanded, "edges_tested": tested}
        path: list[int] = []
        if parent[1] >= 0:
            path = [1]
            while path[-1] != 0:
                path.append(int(parent[path[-1]]))
        return Plan(
            Status.SOLVED if path else Status.NO_PATH,
            nodes[path[::-1]],
            counters=counters,
            timings={"time_s": time.perf_counter() - began},
        )
