"""RRT-Connect: two trees that reach for each other (Kuffner and LaValle 2000)."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from planners.draws import Stream
from planners.exact import SpaceArrays, edge_free
from planners.trees.growth import sample_free
from planners.trees.tree import NONE, Tree, insert, nearest
from wheelchair_gym.kernel import borrowing_kernel

Array = NDArray[np.float64]


@borrowing_kernel
def reach_for(
    space: SpaceArrays, tree: Tree, x: float, y: float, step: float, greedy: bool
) -> tuple[int, bool]:
    """Extend a tree from its node nearest to a point by one step, or greedily until blocked.

    Returns:
        The last node made (NONE if none was), and whether it lies on the point.
    """
    nodes, grid = tree.nodes, tree.grid[0]
    i = nearest(tree, x, y)
    last = NONE
    while grid.count < len(nodes):
        from_x, from_y = nodes[i].x, nodes[i].y
        gap = math.hypot(x - from_x, y - from_y)
        if gap == 0.0:
            return i, True
        part = min(1.0, step / gap)
        to_x, to_y = x, y
        if part < 1.0:
            to_x, to_y = from_x + part * (x - from_x), from_y + part * (y - from_y)
        if not edge_free(space, from_x, from_y, to_x, to_y):
            return last, False
        i = insert(tree, to_x, to_y, i, part * gap)
        last = i
        if part == 1.0:
            return i, True
        if not greedy:
            return i, False
    return last, False


@borrowing_kernel
def connect(
    space: SpaceArrays,
    ahead: Tree,
    back: Tree,
    start: Array,
    goal: Array,
    iterations: int,
    step: float,
    state: Stream,
) -> tuple[int, int, int]:
    """Grow a tree from the start and one from the goal until they meet.

    Args:
        space: what is free.
        ahead: an empty tree, for the start.
        back: an empty tree, for the goal.
        start: root of the one (2,) [m].
        goal: root of the other (2,) [m].
        iterations: most samples.
        step: longest edge [m].
        state: stream of random numbers.

    Returns:
        The nodes of both trees at which they met (NONE if they did not), and the iterations made.
    """
    insert(ahead, start[0], start[1], NONE, 0.0)
    insert(back, goal[0], goal[1], NONE, 0.0)
    capacity = len(ahead.nodes)
    swapped = False
    for iteration in range(iterations):
        if ahead.grid[0].count >= capacity or back.grid[0].count >= capacity:
            return NONE, NONE, iteration
        tree, other = (back, ahead) if swapped else (ahead, back)
        if iteration == 0:  # the straight line first
            x, y = goal[0], goal[1]
        else:
            x, y = sample_free(space, state)
        new, _ = reach_for(space, tree, x, y, step, False)
        if new != NONE:
            met, there = reach_for(space, other, tree.nodes[new].x, tree.nodes[new].y, step, True)
            if there:
                if swapped:
                    return met, new, iteration + 1
                return new, met, iteration + 1
        swapped = not swapped
    return NONE, NONE, iterations
