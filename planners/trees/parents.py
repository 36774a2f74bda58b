"""Who hangs from whom: the best parent, rewiring, the goal's link, the best path's shortcuts."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from planners.draws import Stream, uniform
from planners.exact import SpaceArrays
from planners.trees.tree import NONE, Tree, chain, insert, rewire
from planners.trees.values import GAIN, Room, passes
from wheelchair_gym.kernel import borrowing_kernel, whole

Array = NDArray[np.float64]

# Vain draws of a node before none is taken as childless and removable.
_LEAF_DRAWS = 100


@borrowing_kernel
def choose_parent(
    space: SpaceArrays,
    tree: Tree,
    x: float,
    y: float,
    room: Room,
    n: int,
    parent: int,
    edge: float,
) -> tuple[int, float]:
    """The neighbour through which a point is reached at least cost, and the edge's length.

    Neighbours are tried in order of cost, so that few edges are tested; `parent` is known to do.
    """
    nodes, through, run = tree.nodes, room.through, room.run[0]
    for k in range(n):
        through[k] = nodes[room.found[k]].cost + room.distances[k]
    while True:
        least, choice = nodes[parent].cost + edge, NONE
        for k in range(n):
            if through[k] < least:
                least, choice = through[k], k
        if choice == NONE:
            return parent, edge
        through[choice] = np.inf
        j = room.found[choice]
        if passes(space, run, nodes[j].x, nodes[j].y, x, y):
            return whole(j), room.distances[choice]


@borrowing_kernel
def climb(
    space: SpaceArrays, tree: Tree, x: float, y: float, parent: int, edge: float, run: Any
) -> tuple[int, float]:
    """The highest ancestor of a parent, and the edge's length, that still sees the point.

    By the triangle inequality each is a better parent than the one before (Jeong et al. 2019).
    """
    nodes = tree.nodes
    while nodes[parent].parent != NONE:
        above = whole(nodes[parent].parent)
        if not passes(space, run, nodes[above].x, nodes[above].y, x, y):
            break
        parent = above
        edge = math.hypot(x - nodes[parent].x, y - nodes[parent].y)
    return parent, edge


@borrowing_kernel
def link_goal(
    space: SpaceArrays, tree: Tree, node: int, goal: Array, reach: float, room: Room
) -> None:
    """Reach the goal from a node, if it is within reach, seen and thus nearer than before."""
    nodes, run = tree.nodes, room.run[0]
    x, y = nodes[node].x, nodes[node].y
    gap = math.hypot(goal[0] - x, goal[1] - y)
    known = run.goal != NONE
    if gap > reach or (known and nodes[node].cost + gap >= nodes[run.goal].cost - GAIN):
        return
    if gap > 0.0 and not passes(space, run, x, y, goal[0], goal[1]):
        return
    if known:
        rewire(tree, run.goal, whole(node), gap, room.stack)
        return
    run.first = run.iteration
    run.goal = node if gap == 0.0 else insert(tree, goal[0], goal[1], node, gap)


@borrowing_kernel
def relink_goal(space: SpaceArrays, tree: Tree, goal: Array, reach: float, room: Room) -> None:
    """Reach a goal that was reached from the best of all nodes: costs fell after they linked."""
    for i in range(tree.grid[0].count):
        if i != room.run[0].goal:
            link_goal(space, tree, i, goal, reach, room)


@borrowing_kernel
def shorten(space: SpaceArrays, tree: Tree, room: Room) -> None:
    """Join the vertices of the best path where that shortens it, edges tested exactly."""
    nodes, run = tree.nodes, room.run[0]
    n = chain(tree, run.goal, room.chain)
    for k in range(n - 3, -1, -1):
        i = room.chain[k]
        x, y = nodes[i].x, nodes[i].y
        count = min(n - k - 2, len(room.found))
        for m in range(count):  # the parent's own ancestors, as far as there is room
            j = room.chain[k + 2 + m]
            room.found[m] = j
            room.distances[m] = math.hypot(nodes[j].x - x, nodes[j].y - y)
        before = whole(nodes[i].parent)
        parent, edge = choose_parent(space, tree, x, y, room, count, before, nodes[i].edge)
        parent, edge = climb(space, tree, x, y, parent, edge, run)  # drops points on one line
        if parent != before:
            rewire(tree, whole(i), whole(parent), edge, room.stack)


@borrowing_kernel
def childless(tree: Tree, one: int, other: int, third: int, state: Stream) -> int:
    """A childless node drawn at random, neither the root nor one of three; NONE if vain."""
    for _ in range(_LEAF_DRAWS):
        i = 1 + int(uniform(state) * (tree.grid[0].count - 1))
        if tree.nodes[i].child == NONE and i != one and i != other and i != third:
            return i
    return NONE
