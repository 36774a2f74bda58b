"""Where a tree grows to next: samplers, and the whale swarm that moves a sample (thesis)."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from planners.collision.polygon_tests import SpaceArrays, blocking_segment, blocks, point_free
from planners.swarm.woa import WhaleParameters, move_whales
from planners.trees.tree import NONE, Growth, Tree, Workspace, write_ancestors
from wheelchair_gym.compiled.kernel import borrowing_kernel
from wheelchair_gym.random import Stream, next_in_disc, next_uniform

Array = NDArray[np.float64]


# Most draws of a sample; the last one is taken even if it is occupied or cannot help.
_MAX_DRAWS = 100
# The same near a beacon, where about half of the draws can help.
_MAX_BEACON_DRAWS = 10


@borrowing_kernel
def sample_ellipse(start: Array, goal: Array, length: float, state: Stream) -> tuple[float, float]:
    """A point uniform in the ellipse of all points on paths from start to goal up to a length [m].

    The length exceeds the distance from start to goal.
    """
    ux, uy = goal[0] - start[0], goal[1] - start[1]
    apart = math.hypot(ux, uy)
    across = 0.5 * math.sqrt(max(length * length - apart * apart, 0.0))
    u, v = next_in_disc(state)
    u, v = 0.5 * length * u / apart, across * v / apart
    x, y = 0.5 * (start[0] + goal[0]), 0.5 * (start[1] + goal[1])
    return x + u * ux - v * uy, y + u * uy + v * ux


@borrowing_kernel
def sample_beacon(
    tree: Tree, growth: Growth, workspace: Workspace, run: Any, state: Stream
) -> tuple[float, float]:
    """A point near a random vertex of the best path, a beacon (Nasir et al. 2013).

    The run records the vertex. Informed trees redraw points that do not shorten the path between
    the two neighbours of the vertex. The log-uniform radius finds gains at every scale.
    """
    nodes = tree.nodes
    n = write_ancestors(tree, run.goal, workspace.chain)
    if n < 3:
        run.beacon = NONE
        return nodes[run.goal].x, nodes[run.goal].y
    k = 1 + int(next_uniform(state) * (n - 2))
    run.beacon = k
    bx, by = nodes[workspace.chain[k]].x, nodes[workspace.chain[k]].y
    ax, ay = nodes[workspace.chain[k + 1]].x, nodes[workspace.chain[k + 1]].y
    cx, cy = nodes[workspace.chain[k - 1]].x, nodes[workspace.chain[k - 1]].y
    before = math.hypot(ax - bx, ay - by) + math.hypot(cx - bx, cy - by)
    radius = growth.beacon_radius
    if growth.beacon_min_scale < 1.0:
        radius *= growth.beacon_min_scale ** next_uniform(state)
    x, y = bx, by
    for _ in range(_MAX_BEACON_DRAWS):
        u, v = next_in_disc(state)
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
    workspace: Workspace,
    state: Stream,
) -> tuple[float, float]:
    """The next sample [m], as the options of the search say.

    It is uniform in the map, in the strip between start and goal, or, once there is a path, in the
    ellipse of points that can shorten it (Gammell et al. 2014); or it is near an obstacle's corner,
    where narrow passages lie and paths bend (Amato et al. 1998), or near a beacon.
    """
    run, bounds = workspace.run[0], space.bounds
    run.beacon = NONE
    found, length = run.first_path != NONE, math.inf
    low, high, radius = bounds[0], bounds[2], 0.0
    if growth.informed and found:
        length = tree.nodes[run.goal].cost
    if growth.corner_share > 0.0 and next_uniform(state) < growth.corner_share:
        radius = growth.corner_radius
        if found:
            radius *= growth.beacon_min_scale ** next_uniform(state)
    elif found:
        if growth.beacon_share > 0.0 and next_uniform(state) < growth.beacon_share:
            x, y = sample_beacon(tree, growth, workspace, run, state)
            if run.beacon != NONE:
                return x, y
    else:
        if growth.goal_bias > 0.0 and next_uniform(state) < growth.goal_bias:
            return goal[0], goal[1]
        if growth.in_strip:
            low = max(low, min(start[0], goal[0]) - run.strip_margin)
            high = min(high, max(start[0], goal[0]) + run.strip_margin)
    # In an ellipse larger than the map, rejection sampling draws points of the map.
    small = run.sample_area < (bounds[2] - bounds[0]) * (bounds[3] - bounds[1])
    x, y = goal[0], goal[1]
    for _ in range(_MAX_DRAWS):
        if radius > 0.0:
            k = int(next_uniform(state) * len(space.segments))
            u, v = next_in_disc(state)
            x, y = space.segments[k, 0] + radius * u, space.segments[k, 1] + radius * v
        elif small and length < math.inf:
            x, y = sample_ellipse(start, goal, length, state)
        else:
            x = low + next_uniform(state) * (high - low)
            y = bounds[1] + next_uniform(state) * (bounds[3] - bounds[1])
        by_way = math.hypot(x - start[0], y - start[1]) + math.hypot(x - goal[0], y - goal[1])
        if by_way < length and point_free(space, x, y):
            break
    return x, y


class SwarmBuffers(NamedTuple):
    """Arrays of the steering swarm."""

    positions: Array  # (k, 2) m, relative to the sample
    best: Array  # (2,)
    lower: Array  # (2,) bounds of the positions
    upper: Array  # (2,)
    span: Array  # (2,) of the factor C


class SteeringCost(NamedTuple):
    """Cost of a candidate point: weighted distances, and penalties for blocked lines of sight."""

    width: float  # m, half the width of the search box around the sample
    height: float  # m, half its height
    sample_weight: float  # cost per metre from the sample
    goal_weight: float  # cost per metre from the goal
    node_hidden: float  # cost if an obstacle hides the node to extend
    goal_hidden: float  # cost if an obstacle hides the goal


def new_buffers(swarm: WhaleParameters, steering: SteeringCost) -> SwarmBuffers:
    """Arrays for a swarm of whales, with its bounds."""
    upper = np.array([steering.width, steering.height])
    positions = np.empty((swarm.population, 2))
    return SwarmBuffers(positions, np.zeros(2), -upper, upper, np.full(2, 2.0))


@borrowing_kernel
def find_blocker(space: SpaceArrays, ax: float, ay: float, bx: float, by: float, last: int) -> int:
    """The segment that hides b from a (`blocking_segment`); the last one found is tested first."""
    if last >= 0 and blocks(space.segments, space.before, last, ax, ay, bx, by):
        return last
    return blocking_segment(space, ax, ay, bx, by)


@borrowing_kernel
def steering_target(
    space: SpaceArrays,
    near_x: float,
    near_y: float,
    x: float,
    y: float,
    goal_x: float,
    goal_y: float,
    swarm: WhaleParameters,
    steering: SteeringCost,
    buffers: SwarmBuffers,
    state: Stream,
) -> tuple[float, float]:
    """The point of least cost that a swarm finds around a random sample (thesis, algorithm 4).

    Positions are relative to the sample (x, y) [m], so that the map's origin has no influence.
    """
    population, best = buffers.positions, buffers.best
    best[0], best[1] = 0.0, 0.0
    least, from_near, from_goal = np.inf, -1, -1  # the segments that hid a whale last
    for i in range(swarm.population):
        u, v = next_in_disc(state)
        population[i, 0] = u * steering.width
        population[i, 1] = v * steering.height
    for t in range(swarm.iterations + 1):
        for i in range(swarm.population):
            u, v = population[i, 0], population[i, 1]
            to_goal = math.sqrt((goal_x - x - u) ** 2 + (goal_y - y - v) ** 2)
            cost = (
                steering.sample_weight * math.sqrt(u * u + v * v) + steering.goal_weight * to_goal
            )
            # Lines of sight are tested only while the whale can still be the best. The segment that
            # hid the goal from one whale hides it from most, so the goal is tested first.
            if cost < least:
                hidden = find_blocker(space, goal_x, goal_y, x + u, y + v, from_goal)
                if hidden != -1:
                    cost, from_goal = cost + steering.goal_hidden, hidden
            if cost < least:
                hidden = find_blocker(space, near_x, near_y, x + u, y + v, from_near)
                if hidden != -1:
                    cost, from_near = cost + steering.node_hidden, hidden
            if cost < least:
                least = cost
                best[0], best[1] = u, v
        if t < swarm.iterations:
            a = swarm.a * (1.0 - t / swarm.iterations)
            move_whales(
                population,
                best,
                a,
                swarm.b,
                swarm.mu,
                swarm.lam,
                buffers.span,
                buffers.lower,
                buffers.upper,
                state,
            )
    return x + best[0], y + best[1]
