"""Roadmaps: points and the straight ways that may join them, each tested only when its turn comes.

Whoever draws a map (random samples, a Voronoi diagram, cells) searches it here (lazy A*: Bohlin and
Kavraki 2000): an edge that no short way needs is never tested.
"""

from __future__ import annotations

import math
from time import perf_counter
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from planners.exact import SpaceArrays, edge_free
from planners.graphs.heap import pop, push
from wheelchair_gym.kernel import borrowing_kernel

Array = NDArray[np.float64]
Pairs = NDArray[np.int64]

CHUNK = 20_000  # edges tested between two looks at the clock: some 10 ms
START, GOAL = 0, 1  # the first two nodes


class Roadmap(NamedTuple):
    """Nodes and their neighbours, as kernels take them."""

    nodes: Array  # (n, 2) m: start, goal, the others
    first: Pairs  # (n + 1,): where each node's neighbours begin
    neighbours: Pairs  # indices of nodes


class Search(NamedTuple):
    """A search under way; arrays only, so that it may stop and go on."""

    cost: Array  # (n,) m
    parent: Pairs  # (n,), -1: not reached
    keys: Array  # the heap; its items are edges, source * n + end
    items: Pairs
    counts: Pairs  # (3,): items in the heap, nodes reached, edges tested


@borrowing_kernel
def search_roadmap(arrays: SpaceArrays, roadmap: Roadmap, search: Search, budget: int) -> bool:
    """Test at most so many edges; whether the goal is reached or nothing is left to test."""
    nodes, first, neighbours = roadmap
    cost, parent, keys, items, counts = search
    n = nodes.shape[0]
    for _ in range(budget):
        if counts[0] == 0:
            return True
        item = pop(keys, items, counts[0])
        counts[0] -= 1
        t, u = item // n, item % n
        if parent[u] >= 0:
            continue
        tx, ty, ux, uy = nodes[t, 0], nodes[t, 1], nodes[u, 0], nodes[u, 1]
        counts[2] += 1
        if not edge_free(arrays, tx, ty, ux, uy):
            continue
        counts[1] += 1
        parent[u] = t
        cost[u] = cost[t] + math.hypot(ux - tx, uy - ty)
        if u == GOAL:
            return True
        for k in range(first[u], first[u + 1]):
            v = neighbours[k]
            if parent[v] < 0:
                far = math.hypot(nodes[v, 0] - ux, nodes[v, 1] - uy)
                left = math.hypot(nodes[v, 0] - nodes[GOAL, 0], nodes[v, 1] - nodes[GOAL, 1])
                push(keys, items, counts[0], cost[u] + far + left, u * n + v)
                counts[0] += 1
    return False


class Way(NamedTuple):
    """What a roadmap answers."""

    path: Array  # (k, 2) m; empty where there is none
    tested: int  # edges
    in_time: bool


def shortest(arrays: SpaceArrays, nodes: Array, pairs: Pairs, end: float) -> Way:
    """The shortest free way over a roadmap from its first node to its second.

    Args:
        arrays: what is free.
        nodes: (n, 2) m: start, goal, the others.
        pairs: (m, 2) indices of nodes that a straight way may join, either way.
        end: when to give up, by `perf_counter` [s].
    """
    n = len(nodes)
    both = np.concatenate([pairs, pairs[:, ::-1]])
    order = np.argsort(both[:, 0], kind="stable")
    first = np.concatenate([[0], np.cumsum(np.bincount(both[:, 0], minlength=n))])
    roadmap = Roadmap(np.ascontiguousarray(nodes), first, both[order, 1].copy())
    search = Search(
        np.zeros(n),
        np.full(n, -1, dtype=np.int64),
        np.empty(len(both) + 1),
        np.empty(len(both) + 1, dtype=np.int64),
        np.array([1, 0, 0]),
    )
    search.keys[0], search.items[0] = 0.0, START  # from the start to itself
    over, in_time = False, True
    while not over and in_time:
        over = search_roadmap(arrays, roadmap, search, CHUNK)
        in_time = over or perf_counter() < end
    chosen = [GOAL] if search.parent[GOAL] >= 0 else []
    while chosen and chosen[-1] != START:
        chosen.append(int(search.parent[chosen[-1]]))
    path = nodes[chosen[::-1]]
    moved = np.ones(len(path), dtype=np.bool_)
    moved[1:] = (np.diff(path, axis=0) != 0.0).any(axis=1)
    return Way(path[moved], int(search.counts[2]), in_time)
