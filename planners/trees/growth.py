"""The one loop that grows a tree towards a goal: RRT, RRT* and the local variant are its values."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from planners.draws import Stream, uniform
from planners.exact import SpaceArrays, edge_free, point_free
from planners.swarm.woa import Whales
from planners.trees.steering import Pull, School, whale_target
from planners.trees.tree import NONE, Tree, insert, nearest, rewire, within
from wheelchair_gym.kernel import borrowing_kernel

Array = NDArray[np.float64]

# Neighbours looked at round one new node; the shrinking radius keeps their number near 3 log n.
_NEIGHBOURS = 256
# Redraws of a sample that falls on something solid, before the iteration is given up.
_REDRAWS = 100
# Costs must fall by more than this to rewire [m]: rounding alone may not make a loop.
_GAIN = 1e-9


class Growth(NamedTuple):
    """The values that make one planner of the loop."""

    iterations: int
    step: float  # m, longest edge towards a sample
    goal_bias: float  # part of the samples laid on the goal until it is reached
    reach: float  # m, from where the straight edge to the goal is tried
    rewiring: bool  # choose the best parent and rewire (RRT*)
    radius: float  # m, of the search for neighbours; 0 for the shrinking rule
    gamma: float  # m, of the shrinking rule gamma sqrt(log n / n)
    stop_at_first: bool  # end with the first path
    whales: bool  # steer by whales (the local variant)


class Room(NamedTuple):
    """Room that the loop works in."""

    found: NDArray[np.int32]  # neighbours of the new node,
    distances: Array  # m, their distances,
    through: Array  # m, and what the new node costs through each
    stack: NDArray[np.int32]  # nodes whose children's costs are still to follow


def new_room(capacity: int) -> Room:
    """Room to grow a tree of at most so many nodes."""
    return Room(
        np.empty(_NEIGHBOURS, np.int32),
        np.empty(_NEIGHBOURS),
        np.empty(_NEIGHBOURS),
        np.empty(capacity, np.int32),
    )


@borrowing_kernel
def sample_free(space: SpaceArrays, state: Stream) -> tuple[float, float]:
    """A point of the free space, uniform; after many vain draws the last one, free or not."""
    bounds = space.bounds
    x, y = bounds[0], bounds[1]
    for _ in range(_REDRAWS):
        x = bounds[0] + uniform(state) * (bounds[2] - bounds[0])
        y = bounds[1] + uniform(state) * (bounds[3] - bounds[1])
        if point_free(space, x, y):
            break
    return x, y


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
    nodes, through = tree.nodes, room.through
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
        if edge_free(space, nodes[j].x, nodes[j].y, x, y):
            return int(j), room.distances[choice]


@borrowing_kernel
def goal_parent(
    space: SpaceArrays, tree: Tree, gx: float, gy: float, reach: float
) -> tuple[int, float]:
    """The node that leads to the goal at least cost by a free edge within reach, and that cost."""
    nodes = tree.nodes
    best, parent = np.inf, NONE
    for i in range(tree.grid[0].count):
        if nodes[i].cost >= best or abs(nodes[i].x - gx) > reach:
            continue
        gap = math.hypot(nodes[i].x - gx, nodes[i].y - gy)
        cost = nodes[i].cost + gap
        if gap <= reach and cost < best and edge_free(space, nodes[i].x, nodes[i].y, gx, gy):
            best, parent = cost, i
    return parent, best


@borrowing_kernel
def grow(
    space: SpaceArrays,
    tree: Tree,
    start: Array,
    goal: Array,
    growth: Growth,
    swarm: Whales,
    pull: Pull,
    school: School,
    room: Room,
    state: Stream,
) -> tuple[int, int, int]:
    """Grow a tree from a start until the goal is reached, or samples or room run out.

    Args:
        space: what is free.
        tree: an empty tree; its capacity bounds the nodes.
        start: the root (2,) [m].
        goal: where the path shall end (2,) [m].
        growth: what kind of tree, and how long.
        swarm: the whales that steer, where they do.
        pull: what draws these whales.
        school: room for them.
        room: room for the rest; the capacity is the tree's.
        state: stream of random numbers.

    Returns:
        The node before the goal (NONE if it was not reached), the iterations made, and the
        iteration that reached the goal first (NONE likewise).
    """
    nodes, grid = tree.nodes, tree.grid[0]
    capacity = len(nodes)
    gx, gy = goal[0], goal[1]
    found, distances = room.found, room.distances
    insert(tree, start[0], start[1], NONE, 0.0)
    first = NONE
    iteration = 0
    if math.hypot(gx - start[0], gy - start[1]) <= growth.reach and edge_free(
        space, start[0], start[1], gx, gy
    ):
        return 0, 0, 0  # nothing is shorter than the straight edge
    while iteration < growth.iterations and grid.count < capacity:
        iteration += 1
        if first == NONE and uniform(state) < growth.goal_bias:
            x, y = gx, gy
        else:
            x, y = sample_free(space, state)
        near = nearest(tree, x, y)
        near_x, near_y = nodes[near].x, nodes[near].y
        if growth.whales:
            x, y = whale_target(space, near_x, near_y, x, y, gx, gy, swarm, pull, school, state)
        edge = math.hypot(x - near_x, y - near_y)
        if edge <= _GAIN:
            continue
        if edge > growth.step:
            x = near_x + (x - near_x) * growth.step / edge
            y = near_y + (y - near_y) * growth.step / edge
            edge = math.hypot(x - near_x, y - near_y)
        if not edge_free(space, near_x, near_y, x, y):
            continue
        if growth.rewiring:
            radius = growth.radius
            if radius == 0.0:
                radius = growth.gamma * math.sqrt(math.log(grid.count + 1) / (grid.count + 1))
            n = within(tree, x, y, radius, found, distances)
            parent, edge = choose_parent(space, tree, x, y, room, n, near, edge)
            new = insert(tree, x, y, parent, edge)
            cost = nodes[new].cost
            for k in range(n):
                j = found[k]
                if cost + distances[k] < nodes[j].cost - _GAIN and edge_free(
                    space, x, y, nodes[j].x, nodes[j].y
                ):
                    rewire(tree, j, new, distances[k], room.stack)
        else:
            new = insert(tree, x, y, near, edge)
        if first == NONE:
            gap = math.hypot(gx - x, gy - y)
            if gap <= growth.reach and edge_free(space, x, y, gx, gy):
                first = iteration
                if growth.stop_at_first:
                    return new, iteration, first
    parent, _ = goal_parent(space, tree, gx, gy, growth.reach)
    return parent, iteration, first
