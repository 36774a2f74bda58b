"""Samplers: where the next point of a growing tree is drawn."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from planners.collision.polygon_tests import SpaceArrays, point_free
from planners.random_stream import Stream, in_disc, uniform
from planners.trees.tree import NONE, Tree, chain
from planners.trees.values import Growth, Room
from wheelchair_gym.compiled.kernel import borrowing_kernel

Array = NDArray[np.float64]

# Redraws of a sample that falls on something solid or cannot help, before it is taken as it is.
_REDRAWS = 100
# The same for samples near a beacon, of which about half can help.
_BEACON_REDRAWS = 10


@borrowing_kernel
def in_ellipse(start: Array, goal: Array, length: float, state: Stream) -> tuple[float, float]:
    """The next point of a stream, uniform in the ellipse with foci start and goal [m].

    A way over its rim is as long as the length [m], which is more than they are apart.
    """
    ux, uy = goal[0] - start[0], goal[1] - start[1]
    apart = math.hypot(ux, uy)
    across = 0.5 * math.sqrt(max(length * length - apart * apart, 0.0))
    u, v = in_disc(state)
    u, v = 0.5 * length * u / apart, across * v / apart
    x, y = 0.5 * (start[0] + goal[0]), 0.5 * (start[1] + goal[1])
    return x + u * ux - v * uy, y + u * uy + v * ux


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
    """The next point [m] towards which a tree grows, as its values say.

    It is uniform in the map, in the strip between start and goal, or, once there is a path, in the
    ellipse of what can shorten it (Gammell et al. 2014); or it is near a corner of what is solid,
    where narrow passages lie and paths bend (Amato et al. 1998), or near a beacon. It is free and
    can help, or the last of many vain draws.
    """
    run, bounds = room.run[0], space.bounds
    run.beacon = NONE
    found, length = run.first != NONE, math.inf
    low, high, radius = bounds[0], bounds[2], 0.0
    if growth.informed and found:
        length = tree.nodes[run.goal].cost
    if growth.corner_share > 0.0 and uniform(state) < growth.corner_share:
        radius = growth.corner_radius
        if found:
            radius *= growth.beacon_finest ** uniform(state)
    elif found:
        if growth.beacon_share > 0.0 and uniform(state) < growth.beacon_share:
            x, y = sample_beacon(tree, growth, room, run, state)
            if run.beacon != NONE:
                return x, y
    else:
        if growth.goal_bias > 0.0 and uniform(state) < growth.goal_bias:
            return goal[0], goal[1]
        if growth.in_strip:
            low = max(low, min(start[0], goal[0]) - run.margin)
            high = min(high, max(start[0], goal[0]) + run.margin)
    # Where the ellipse is larger than the map, points of the map are drawn until one lies in it.
    small = run.area < (bounds[2] - bounds[0]) * (bounds[3] - bounds[1])
    x, y = goal[0], goal[1]
    for _ in range(_REDRAWS):
        if radius > 0.0:
            k = int(uniform(state) * len(space.segments))
            u, v = in_disc(state)
            x, y = space.segments[k, 0] + radius * u, space.segments[k, 1] + radius * v
        elif small and length < math.inf:
            x, y = in_ellipse(start, goal, length, state)
        else:
            x = low + uniform(state) * (high - low)
            y = bounds[1] + uniform(state) * (bounds[3] - bounds[1])
        by_way = math.hypot(x - start[0], y - start[1]) + math.hypot(x - goal[0], y - goal[1])
        if by_way < length and point_free(space, x, y):
            break
    return x, y
