"""The state of a tree search, and its samples."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from planners.collision.polygon_tests import SpaceArrays, point_free, way_free
from planners.problem import Problem
from planners.trees.tree import NONE, Tree, new_tree, write_ancestors
from wheelchair_gym.arrays import Array
from wheelchair_gym.compiled.kernel import absorbed_kernel, borrowing_kernel
from wheelchair_gym.random import Stream, next_in_disc, next_uniform

# Largest number of neighbours of a new node; the shrinking radius keeps it near 3 log n.
_NEIGHBOURS = 256
# m: a smaller gain rewires nothing, so that rounding cannot form a loop.
MIN_GAIN = 1e-9
CORNER_RADIUS = 1.0  # m: largest distance of a sample from its corner, about the width of a door


class TreeOptions(NamedTuple):
    """The options that make the search one of the tree planners; by default a plain RRT.

    An option named as one of a planner's settings has the value of that setting.
    """

    iterations: int = 0  # largest number of samples
    step: float = 0.0  # m, longest edge towards a sample
    # m, a node this near to the goal is connected to it, if the edge is free
    goal_reach: float = math.inf
    nodes: int = 20_000  # largest number of nodes of a tree
    goal_bias: float = 0.0  # share of the samples that are the goal until it is reached
    return_on_first_path: bool = True
    bidirectional: bool = False  # a second tree grows from the goal until they meet (RRT-Connect)
    rewiring: bool = False  # choose the best parent and rewire neighbours (RRT*)
    search_radius: float = 0.0  # m, of the neighbourhood; 0 for the shrinking radius
    gamma: float = 0.0  # of the shrinking radius gamma sqrt(area log n / n)
    replace_leaves: bool = False  # at the limit a new node replaces a leaf (RRT*FN)
    shortcut_path: bool = False  # join vertices of the best path that see each other
    # Sample and keep only what can shorten the best path, and prefer ancestors of the parent that
    # see the new node (Q-RRT*).
    informed: bool = False
    beacon_share: float = 0.0  # share of the samples near the best path's vertices (RRT*-Smart)
    beacon_radius: float = 0.0  # m
    beacon_min_scale: float = 1.0  # that radius is scaled by a log-uniform draw in [this, 1]
    corner_share: float = 0.0  # share of the samples near corners of obstacles
    in_strip: bool = False  # sample between the x of start and goal, wider as edges are blocked
    widening: float = 0.0  # m, by which each blocked edge widens the strip on each side


RUN = np.dtype(
    [
        ("iteration", np.int64),  # samples drawn
        ("first_path", np.int64),  # iteration that reached the goal; NONE if none did
        ("edges_tested", np.int64),  # edges tested
        ("blocked", np.int64),  # blocked extensions
        ("walls_cut", np.int64),  # blocked extensions that end in a free point
        ("goal", np.int64),  # the goal's node in the start tree; NONE before it is reached
        ("beacon", np.int64),  # index in the chain of the vertex sampled around; NONE if none
        ("path_length", np.float64),  # m, of the best path after its last shortcut
        ("sample_area", np.float64),  # m2, of the sampled region
        ("strip_margin", np.float64),  # m, on each side of the strip
        ("from_goal", np.bool_),  # the next sample extends the goal tree
        ("done", np.bool_),  # the search cannot improve any more
    ]
)


class TreeSearch(NamedTuple):
    """All state of a search: the problem, the options, the trees, and scratch arrays."""

    space: SpaceArrays
    start_tree: Tree
    goal_tree: Tree
    start: Array  # (2,) m
    goal: Array  # (2,) m
    options: TreeOptions
    run: NDArray[Any]  # (1,) RUN
    found: NDArray[np.int32]  # neighbours of the new node
    distances: Array  # m, to these neighbours
    through: Array  # m, cost of the new node through each neighbour
    chain: NDArray[np.int32]  # nodes of the best path, the goal first
    stack: NDArray[np.int32]  # nodes whose children's costs are not updated yet


def new_search(problem: Problem, options: TreeOptions) -> TreeSearch:
    """Return a search with empty trees.

    A tree may have its nodes and the goal; the branches of both trees may join in the first one.
    """
    arrays = problem.free.arrays
    bounds = arrays.bounds.tolist()
    capacity = min(options.nodes, options.iterations + 1) + 1
    if options.bidirectional:
        capacity = 2 * options.nodes + 1
    run = np.zeros(1, RUN)
    run["first_path"] = run["goal"] = run["beacon"] = NONE
    run["path_length"] = np.inf
    run["sample_area"] = (bounds[2] - bounds[0]) * (bounds[3] - bounds[1])
    return TreeSearch(
        arrays,
        new_tree(bounds, capacity),
        new_tree(bounds, options.nodes if options.bidirectional else 1),
        np.array(problem.start[:2], dtype=np.float64),
        np.array(problem.goal[:2], dtype=np.float64),
        options,
        run,
        np.empty(_NEIGHBOURS, np.int32),
        np.empty(_NEIGHBOURS),
        np.empty(_NEIGHBOURS),
        np.empty(capacity, np.int32),
        np.empty(capacity, np.int32),
    )


@absorbed_kernel
def edge_is_free(search: TreeSearch, ax: float, ay: float, bx: float, by: float) -> bool:
    """Count a test, and return whether the edge from a free point a to b [m] is free."""
    search.run[0].edges_tested += 1
    return way_free(search.space, ax, ay, bx, by)


# Largest number of draws of a sample; the last one is taken even if it is occupied or useless.
_MAX_DRAWS = 100
# The same near a beacon, where about half of the draws are useful.
_MAX_BEACON_DRAWS = 10


@borrowing_kernel
def sample_ellipse(start: Array, goal: Array, length: float, state: Stream) -> tuple[float, float]:
    """Draw a point uniform in the ellipse of the paths from start to goal up to a length [m].

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
def sample_beacon(search: TreeSearch, tree: Tree, state: Stream) -> tuple[float, float]:
    """Draw a point near a random vertex of the best path, a beacon (Nasir et al. 2013).

    The run records the vertex. Informed trees redraw points that do not shorten the path between
    the two neighbours of the vertex. The log-uniform radius finds gains at every scale.
    """
    options, nodes, chain, run = search.options, tree.nodes, search.chain, search.run[0]
    n = write_ancestors(nodes, run.goal, chain)
    if n < 3:
        run.beacon = NONE
        return nodes[run.goal].x, nodes[run.goal].y
    k = 1 + int(next_uniform(state) * (n - 2))
    run.beacon = k
    bx, by = nodes[chain[k]].x, nodes[chain[k]].y
    ax, ay = nodes[chain[k + 1]].x, nodes[chain[k + 1]].y
    cx, cy = nodes[chain[k - 1]].x, nodes[chain[k - 1]].y
    before = math.hypot(ax - bx, ay - by) + math.hypot(cx - bx, cy - by)
    radius = options.beacon_radius
    if options.beacon_min_scale < 1.0:
        radius *= options.beacon_min_scale ** next_uniform(state)
    x, y = bx, by
    for _ in range(_MAX_BEACON_DRAWS):
        u, v = next_in_disc(state)
        x, y = bx + radius * u, by + radius * v
        after = math.hypot(ax - x, ay - y) + math.hypot(cx - x, cy - y)
        if not options.informed or after < before:
            break
    return x, y


@absorbed_kernel
def sample(search: TreeSearch, tree: Tree, state: Stream) -> tuple[float, float]:
    """Draw the next sample [m], by the options of the search.

    It is uniform in the map, in the strip between start and goal, or, once there is a path, in the
    ellipse of points that can shorten it (Gammell et al. 2014). Or it is near an obstacle's corner,
    where narrow passages lie and paths bend (Amato et al. 1998), or near a beacon.
    """
    space, start, goal, options = search.space, search.start, search.goal, search.options
    run, bounds = search.run[0], space.bounds
    run.beacon = NONE
    found, length = run.first_path != NONE, math.inf
    low, high, radius = bounds[0], bounds[2], 0.0
    if options.informed and found:
        length = tree.nodes[run.goal].cost
    if options.corner_share > 0.0 and next_uniform(state) < options.corner_share:
        radius = CORNER_RADIUS
        if found:
            radius *= options.beacon_min_scale ** next_uniform(state)
    elif found:
        if options.beacon_share > 0.0 and next_uniform(state) < options.beacon_share:
            x, y = sample_beacon(search, tree, state)
            if run.beacon != NONE:
                return x, y
    else:
        if options.goal_bias > 0.0 and next_uniform(state) < options.goal_bias:
            return goal[0], goal[1]
        if options.in_strip:
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
        detour = math.hypot(x - start[0], y - start[1]) + math.hypot(x - goal[0], y - goal[1])
        if detour < length and point_free(space, x, y):
            break
    return x, y
