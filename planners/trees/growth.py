"""The one loop that grows trees towards a goal: every planner of this folder is its values."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from planners.draws import Stream
from planners.exact import SpaceArrays, point_free
from planners.swarm.woa import Whales
from planners.trees.parents import (
    childless,
    choose_parent,
    climb,
    link_goal,
    shorten,
)
from planners.trees.sampling import sample
from planners.trees.steering import Pull, School, whale_target
from planners.trees.tree import NONE, Tree, insert, nearest, put, remove, rewire, within
from planners.trees.values import GAIN, Growth, Room, passes
from wheelchair_gym.kernel import borrowing_kernel, whole

Array = NDArray[np.float64]

# Iterations after which a best path that improved is shortened again.
_PERIOD = 64
# A path this near the straight line is the straight line, by rounding.
_STRAIGHT = 1.0 + 1e-12


@borrowing_kernel
def reach_for(
    space: SpaceArrays, tree: Tree, x: float, y: float, growth: Growth, room: Room
) -> tuple[int, bool]:
    """Extend a tree from its node nearest to a point step by step until blocked.

    Returns:
        The last node of the way, and whether it lies on the point.
    """
    nodes = tree.nodes
    i = nearest(tree, x, y)
    while True:
        from_x, from_y = nodes[i].x, nodes[i].y
        gap = math.hypot(x - from_x, y - from_y)
        if gap == 0.0:
            return i, True
        if tree.grid[0].count >= growth.limit:
            return i, False
        part = min(1.0, growth.step / gap)
        to_x, to_y = x, y
        if part < 1.0:
            to_x, to_y = from_x + part * (x - from_x), from_y + part * (y - from_y)
        if not passes(space, room.run[0], from_x, from_y, to_x, to_y):
            return i, False
        i = insert(tree, to_x, to_y, i, part * gap)


@borrowing_kernel
def graft(ahead: Tree, back: Tree, node: int, twin: int) -> int:
    """Add the way from a node of the goal's tree, met by its twin, to the goal; returns that."""
    nodes = back.nodes
    i = nodes[twin].parent
    edge = nodes[twin].edge
    while i != NONE:
        node = insert(ahead, nodes[i].x, nodes[i].y, node, edge)
        edge = nodes[i].edge
        i = nodes[i].parent
    return node


@borrowing_kernel
def add_node(
    space: SpaceArrays,
    tree: Tree,
    x: float,
    y: float,
    near: int,
    edge: float,
    goal: Array,
    growth: Growth,
    room: Room,
    state: Stream,
) -> int:
    """Add a point [m] seen from a node by an edge [m], at its best place; NONE if it is no use.

    At the limit of nodes a childless one makes room, where the values say so.
    """
    nodes, grid, run = tree.nodes, tree.grid[0], room.run[0]
    found, distances = room.found, room.distances
    parent, n = near, 0
    rewiring = growth.rewiring and (run.first != NONE or not growth.both_ways)
    if rewiring:
        radius = growth.radius
        if radius == 0.0:
            count = grid.count + 1
            radius = growth.gamma * math.sqrt(run.area * math.log(count) / count)
        n = within(tree, x, y, radius, found, distances)
        if run.beacon != NONE and n < len(found):  # the way goes on to the vertex after
            found[n] = room.chain[run.beacon - 1]
            distances[n] = math.hypot(nodes[found[n]].x - x, nodes[found[n]].y - y)
            n += 1
        parent, edge = choose_parent(space, tree, x, y, room, n, near, edge)
        if growth.climbing:
            parent, edge = climb(space, tree, x, y, parent, edge, run)
        if growth.informed:
            least = nodes[parent].cost + edge + math.hypot(goal[0] - x, goal[1] - y)
            if least >= nodes[run.goal].cost - GAIN:
                return NONE
    if grid.count < growth.limit:
        new = insert(tree, x, y, parent, edge)
    else:
        new = childless(tree, parent, near, run.goal, state) if growth.recycling else NONE
        if new == NONE:
            return NONE
        remove(tree, new)
        put(tree, new, x, y, parent, edge)
    cost = nodes[new].cost
    for k in range(n):
        j = found[k]
        if cost + distances[k] < nodes[j].cost - GAIN and passes(
            space, run, x, y, nodes[j].x, nodes[j].y
        ):
            rewire(tree, whole(j), whole(new), distances[k], room.stack)
    return int(new)


@borrowing_kernel
def extend(
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
) -> int:
    """Draw a sample, steer towards it and add a node; NONE if that was blocked or no use."""
    run = room.run[0]
    x, y = sample(space, tree, start, goal, growth, room, state)
    far = run.beacon == NONE
    near = nearest(tree, x, y) if far else whole(room.chain[run.beacon + 1])
    near_x, near_y = tree.nodes[near].x, tree.nodes[near].y
    if growth.whales:
        x, y = whale_target(
            space, near_x, near_y, x, y, goal[0], goal[1], swarm, pull, school, state
        )
    edge = math.hypot(x - near_x, y - near_y)
    if edge <= GAIN:
        return NONE
    if far and edge > growth.step:
        x = near_x + (x - near_x) * growth.step / edge
        y = near_y + (y - near_y) * growth.step / edge
        edge = math.hypot(x - near_x, y - near_y)
    if passes(space, run, near_x, near_y, x, y):
        return add_node(space, tree, x, y, near, edge, goal, growth, room, state)
    if growth.in_strip:
        run.blocked += 1
        run.cuts += point_free(space, x, y)
        run.margin += growth.widening
    return NONE


@borrowing_kernel
def improve(
    space: SpaceArrays, tree: Tree, start: Array, goal: Array, growth: Growth, room: Room
) -> None:
    """Shorten the best path if it fell, and say how large the ellipse of what may help is."""
    nodes, run = tree.nodes, room.run[0]
    if nodes[run.goal].cost >= run.length - GAIN:
        return
    shorten(space, tree, room)
    run.length = nodes[run.goal].cost
    apart = math.hypot(goal[0] - start[0], goal[1] - start[1])
    if growth.informed:
        across = math.sqrt(max(run.length * run.length - apart * apart, 0.0))
        run.area = min(run.area, 0.25 * math.pi * run.length * across)
    run.done |= run.length <= apart * _STRAIGHT


@borrowing_kernel
def lacks_room(ahead: Tree, back: Tree, growth: Growth) -> bool:
    """Whether the arrays may be too small for another iteration that the limit allows."""
    # The start's tree may have to take up the way from the goal's.
    both = ahead.grid[0].count + back.grid[0].count + growth.reserve
    return both > len(ahead.nodes) or (growth.both_ways and both > len(back.nodes))


@borrowing_kernel
def grow(
    space: SpaceArrays,
    ahead: Tree,
    back: Tree,
    start: Array,
    goal: Array,
    growth: Growth,
    swarm: Whales,
    pull: Pull,
    school: School,
    room: Room,
    until: int,
    state: Stream,
) -> None:
    """Grow trees until the goal is reached as the values ask, or samples or nodes run out.

    It returns early where the arrays have no room for another iteration, too. All state is in the
    arguments, so that any chunks of iterations and any room make the very same run.

    Args:
        space: what is free.
        ahead: the tree of the start; both are planted here if it is empty.
        back: the tree of the goal; it grows where trees grow both ways.
        start: root of the one (2,) [m].
        goal: where the path shall end (2,) [m].
        growth: what kind of tree.
        swarm: the whales that steer, where they do.
        pull: what draws these whales.
        school: room for them.
        room: the state of the run, and room for the rest.
        until: the iteration to stop at.
        state: stream of random numbers.
    """
    run = room.run[0]
    if run.iteration == 0:  # nothing is shorter than the straight edge
        if ahead.grid[0].count == 0:
            insert(ahead, start[0], start[1], NONE, 0.0)
            insert(back, goal[0], goal[1], NONE, 0.0)
        link_goal(space, ahead, 0, goal, growth.reach, room)
        if run.goal != NONE:
            run.done = ahead.nodes[run.goal].parent == 0
            if growth.shortening:
                improve(space, ahead, start, goal, growth, room)
    while run.iteration < until and not run.done:
        tree, other = (back, ahead) if run.backward else (ahead, back)
        if not growth.recycling and max(ahead.grid[0].count, back.grid[0].count) >= growth.limit:
            run.done = True
            break
        if lacks_room(ahead, back, growth):
            break
        run.iteration += 1
        new = extend(space, tree, start, goal, growth, swarm, pull, school, room, state)
        if growth.both_ways and run.first == NONE:
            if new != NONE:
                x, y = tree.nodes[new].x, tree.nodes[new].y
                met, there = reach_for(space, other, x, y, growth, room)
                if there:
                    node, twin = (met, new) if run.backward else (new, met)
                    run.goal = graft(ahead, back, node, twin)
                    run.first = run.iteration
            run.backward = run.first == NONE and not run.backward
        elif new != NONE:
            link_goal(space, ahead, new, goal, growth.reach, room)
        if run.first == run.iteration:
            run.done = growth.stop_at_first
        due = run.first == run.iteration or (run.first != NONE and run.iteration % _PERIOD == 0)
        if growth.shortening and due:
            improve(space, ahead, start, goal, growth, room)
