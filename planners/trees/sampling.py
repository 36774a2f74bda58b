"""Samplers: where the next point of a growing tree is drawn."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from planners.draws import Stream, in_disc, uniform
from planners.exact import SpaceArrays, point_free
from planners.trees.tree import NONE, Tree, chain
from planners.trees.values import Growth, Room
from wheelchair_gym.kernel import borrowing_kernel

Array = NDArray[np.float64]

# Redraws of a sample that falls on something solid or cannot help, before it is taken as it is.
_REDRAWS = 100
# The same for samples near a beacon, of which about half can help.
_BEACON_REDRAWS = 10


@borrowing_kernel
def sample_free(
    space: SpaceArrays, xmin: float, xmax: float, ymin: float, ymax: float, state: Stream
) -> tuple[float, float]:
    """A free point of a box, uniform; after many vain draws the last one, free or not."""
    x, y = xmin, ymin
    for _ in range(_REDRAWS):
        x = xmin + uniform(state) * (xmax - xmin)
        y = ymin + uniform(state) * (ymax - ymin)
        if point_free(space, x, y):
            break
    return x, y


@borrowing_kernel
def sample_informed(
    space: SpaceArrays, start: Array, goal: Array, length: float, state: Stream
) -> tuple[float, float]:
    """A free point through which a path may be shorter than a length [m] (Gammell et al. 2014).

    Uniform in the ellipse whose foci are the start and the goal, or, where that is larger than the
    map, uniform in the map until the ellipse is hit.
    """
    bounds = space.bounds
    ux, uy = goal[0] - start[0], goal[1] - start[1]
    apart = math.hypot(ux, uy)
    across = 0.5 * math.sqrt(max(length * length - apart * apart, 0.0))
    cx, cy = 0.5 * (start[0] + goal[0]), 0.5 * (start[1] + goal[1])
    box = (bounds[2] - bounds[0]) * (bounds[3] - bounds[1])
    in_ellipse = math.pi * 0.5 * length * across < box
    x, y = cx, cy
    for _ in range(_REDRAWS):
        if in_ellipse:
            u, v = in_disc(state)
            u, v = 0.5 * length * u / apart, across * v / apart
            x, y = cx + u * ux - v * uy, cy + u * uy + v * ux
        else:
            x = bounds[0] + uniform(state) * (bounds[2] - bounds[0])
            y = bounds[1] + uniform(state) * (bounds[3] - bounds[1])
            by_way = math.hypot(x - start[0], y - start[1]) + math.hypot(x - goal[0], y - goal[1])
            if by_way >= length:
                continue
        if point_free(space, x, y):
            break
    return x, y


@borrowing_kernel
def sample_corner(
    space: SpaceArrays, start: Array, goal: Array, length: float, radius: float, state: Stream
) -> tuple[float, float]:
    """A free point near a corner of what is solid, where narrow passages lie and paths bend.

    Obstacle-based sampling (Amato et al. 1998), of points by which the way is shorter than a
    length [m] as far as there are any.
    """
    x, y = goal[0], goal[1]
    for _ in range(_REDRAWS):
        k = int(uniform(state) * len(space.segments))
        u, v = in_disc(state)
        x, y = space.segments[k, 0] + radius * u, space.segments[k, 1] + radius * v
        by_way = math.hypot(x - start[0], y - start[1]) + math.hypot(x - goal[0], y - goal[1])
        if by_way < length and point_free(space, x, y):
            break
    return x, y


@borrowing_kernel
def sample_beacon(
    tree: Tree, growth: Growth, room: Room, run: Any, state: Stream
) -> tuple[float, float]:
    """A point near a vertex of the best path, a beacon (Nasir et al. 2013); the run says of which.

    Informed trees redraw points that do not shorten the way from the vertex before to the one
    after. A radius drawn by its logarithm finds what is to be gained at every scale.
    """
    nodes = tree.nodes
    n = chain(tree, run.goal, room.chain)
    if n < 3:
        run.beacon = NONE
        return nodes[run.goal].x, nodes[run.goal].y
    k = 1 + int(uniform(state) * (n - 2))
    run.beacon = k
    bx, by = nodes[room.chain[k]].x, nodes[room.chain[k]].y
    ax, ay = nodes[room.chain[k + 1]].x, nodes[room.chain[k + 1]].y
    cx, cy = nodes[room.chain[k - 1]].x, nodes[room.chain[k - 1]].y
    before = math.hypot(ax - bx, ay - by) + math.hypot(cx - bx, cy - by)
    radius = growth.beacon_radius
    if growth.beacon_finest < 1.0:
        radius *= growth.beacon_finest ** uniform(state)
    x, y = bx, by
    for _ in range(_BEACON_REDRAWS):
        u, v = in_disc(state)
        x, y = bx + radius * u, by + radius * v
        after = math.hypot(ax - x, ay - y) + math.hypot(cx - x, cy - y)
        if not growth.informed or after < before:
            break
    return x, y


@borrowing_kernel
def sample(
    space: SpaceArrays,
    tree: Tree,
    start: Array,
    goal: Array,
    growth: Growth,
    room: Room,
    state: Stream,
) -> tuple[float, float]:
    """The next point [m] towards which a tree grows, as its values say."""
    run, bounds = room.run[0], space.bounds
    run.beacon = NONE
    low, high, length = bounds[0], bounds[2], math.inf
    if growth.informed and run.first != NONE:
        length = tree.nodes[run.goal].cost
    if growth.corner_share > 0.0 and uniform(state) < growth.corner_share:
        radius = growth.corner_radius
        if run.first != NONE:
            radius *= growth.beacon_finest ** uniform(state)
        return sample_corner(space, start, goal, length, radius, state)
    if run.first == NONE:
        if growth.goal_bias > 0.0 and uniform(state) < growth.goal_bias:
            return goal[0], goal[1]
        if growth.in_strip:
            low = max(low, min(start[0], goal[0]) - run.margin)
            high = min(high, max(start[0], goal[0]) + run.margin)
    else:
        if growth.beacon_share > 0.0 and uniform(state) < growth.beacon_share:
            x, y = sample_beacon(tree, growth, room, run, state)
            if run.beacon != NONE:
                return x, y
        if growth.informed:
            return sample_informed(space, start, goal, length, state)
    return sample_free(space, low, high, bounds[1], bounds[3], state)
