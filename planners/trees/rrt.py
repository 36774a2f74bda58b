"""RRT (LaValle 1998, GENERATE_RRT) and RRT-Connect (Kuffner and LaValle 2000, figure 5).

From top to bottom: the state of a tree search; samples; a step towards a point, and the connection
to the goal; the search itself, in chunks of iterations between which the clock is read; and the
planners. Each planner has its own loop. The planners of `rrt_star` take the same steps.
"""

import math
from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from planners.collision.polygon_tests import SpaceArrays, point_free, way_free
from planners.problem import Plan, PlannerBase, Problem, Status, chunks, with_settings
from planners.trees.tree import (
    NONE,
    Tree,
    add_slot,
    change_parent,
    edges,
    insert,
    nearest,
    new_tree,
    path_from_root,
    place_node,
    remove_node,
)
from wheelchair_gym.base.arrays import Array
from wheelchair_gym.base.settings import setting, settings
from wheelchair_gym.compiled.kernel import absorbed_kernel, as_int, borrowing_kernel
from wheelchair_gym.compiled.random import Stream, next_in_disc, next_uniform, stream

# Largest number of neighbours of a new node; the shrinking radius keeps it near 3 log n.
_NEIGHBOURS = 256
# m: a smaller gain rewires nothing, so that rounding cannot form a loop.
MIN_GAIN = 1e-9
GOAL_REACH = 2.0  # m from which a node of `rrt` is connected to the goal: as its step
# Largest number of draws of a useful sample, whose last one is taken anyway, or of a leaf.
MAX_DRAWS = 100


class TreeOptions(NamedTuple):
    """The numbers of a search; one named as a planner's setting has the value of that setting."""

    iterations: int = 0  # largest number of samples
    step: float = 0.0  # m, longest edge towards a sample
    goal_reach: float = math.inf  # m, distance from which a node is connected to the goal
    nodes: int = 20_000  # largest number of nodes of a tree
    goal_bias: float = 0.0  # share of the samples that are the goal until it is reached
    return_on_first_path: bool = True
    search_radius: float = 0.0  # m, of the neighbourhood; 0 for the shrinking radius
    gamma: float = 0.0  # of the shrinking radius gamma sqrt(area log n / n)
    corner_share: float = 0.0  # share of the samples near the corners of obstacles
    replaces_leaves: bool = False  # a full tree replaces leaves by new nodes


RUN = np.dtype(
    [
        ("iteration", np.int64),  # samples drawn
        ("first_path", np.int64),  # iteration that reached the goal; NONE if none did
        ("edges_tested", np.int64),  # edges tested
        ("goal", np.int64),  # the goal's node; NONE before it is reached
        ("path_length", np.float64),  # m, of the best path after its last shortcut
        ("sample_area", np.float64),  # m2, of the sampled region
        ("done", np.bool_),  # the search cannot improve any more
    ]
)


class TreeSearch(NamedTuple):
    """All state of a search: the problem, the options, the tree, and scratch arrays."""

    space: SpaceArrays
    tree: Tree  # from the start
    start: Array  # (2,) m
    goal: Array  # (2,) m
    options: TreeOptions
    run: NDArray[Any]  # (1,) RUN
    found: NDArray[np.int32]  # neighbours of the new node
    distances: Array  # m, to these neighbours
    through: Array  # m, cost of the new node through each neighbour
    chain: NDArray[np.int32]  # nodes of the best path, the goal first
    below: NDArray[np.int32]  # nodes whose costs are updated


def new_search(problem: Problem, options: TreeOptions, capacity: int) -> TreeSearch:
    """Return a search with an empty tree for a number of nodes."""
    arrays = problem.free.arrays
    bounds = arrays.bounds.tolist()
    run = np.zeros(1, RUN)
    run["first_path"] = run["goal"] = NONE
    run["path_length"] = np.inf
    run["sample_area"] = (bounds[2] - bounds[0]) * (bounds[3] - bounds[1])
    return TreeSearch(
        arrays,
        new_tree(bounds, capacity),
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
def is_useful(search: TreeSearch, x: float, y: float, longest: float) -> bool:
    """Return whether a point [m] is free and lies on a path shorter than `longest` [m]."""
    start, goal = search.start, search.goal
    detour = math.hypot(x - start[0], y - start[1]) + math.hypot(x - goal[0], y - goal[1])
    return detour < longest and point_free(search.space, x, y)


@borrowing_kernel
def sample_between(
    search: TreeSearch, low: float, high: float, longest: float, state: Stream
) -> tuple[float, float]:
    """Draw a useful point uniform in the map between two x [m]."""
    bounds = search.space.bounds
    x, y = search.goal[0], search.goal[1]
    for _ in range(MAX_DRAWS):
        x = low + next_uniform(state) * (high - low)
        y = bounds[1] + next_uniform(state) * (bounds[3] - bounds[1])
        if is_useful(search, x, y, longest):
            break
    return x, y


@absorbed_kernel
def is_goal_drawn(search: TreeSearch, state: Stream) -> bool:
    """Return whether the next sample is the goal, which is drawn until it is reached."""
    bias = search.options.goal_bias
    return search.run[0].first_path == NONE and bias > 0.0 and next_uniform(state) < bias


@borrowing_kernel
def sample(search: TreeSearch, state: Stream) -> tuple[float, float]:
    """Draw the goal or a point uniform in the map [m]."""
    if is_goal_drawn(search, state):
        return search.goal[0], search.goal[1]
    bounds = search.space.bounds
    return sample_between(search, bounds[0], bounds[2], math.inf, state)


@absorbed_kernel
def edge_is_free(search: TreeSearch, ax: float, ay: float, bx: float, by: float) -> bool:
    """Count a test, and return whether the edge from a free point a to b [m] is free."""
    search.run[0].edges_tested += 1
    return way_free(search.space, ax, ay, bx, by)


@absorbed_kernel
def extend(
    search: TreeSearch, tree: Tree, near: int, x: float, y: float, step: float
) -> tuple[float, float, float, bool]:
    """Return the point at most a step [m] from a node towards a point, and their distance [m].

    The last value says whether the edge between them is free, and worth a node.
    """
    near_x, near_y = tree.nodes[near].x, tree.nodes[near].y
    edge = math.hypot(x - near_x, y - near_y)
    if edge <= MIN_GAIN:
        return x, y, edge, False
    if edge > step:
        x = near_x + (x - near_x) * step / edge
        y = near_y + (y - near_y) * step / edge
        edge = math.hypot(x - near_x, y - near_y)
    return x, y, edge, edge_is_free(search, near_x, near_y, x, y)


@absorbed_kernel
def free_slot(search: TreeSearch, tree: Tree, one: int, other: int, state: Stream) -> int:
    """Return the index of a new node: in a full tree it replaces a random leaf, or is NONE.

    The leaf is not the goal, nor one of two other nodes.
    """
    if tree.grid[0].count < search.options.nodes:
        return add_slot(tree)
    for _ in range(MAX_DRAWS):
        i = 1 + int(next_uniform(state) * (tree.grid[0].count - 1))
        if tree.nodes[i].child == NONE and i not in (one, other, search.run[0].goal):
            remove_node(tree, i)
            return i
    return NONE


@absorbed_kernel
def connect_goal(search: TreeSearch, node: int) -> None:
    """Connect a node to the goal, if the goal is within reach and visible and its cost falls."""
    tree, goal, run = search.tree, search.goal, search.run[0]
    nodes = tree.nodes
    x, y = nodes[node].x, nodes[node].y
    gap = math.hypot(goal[0] - x, goal[1] - y)
    reached = run.goal != NONE
    if gap > search.options.goal_reach or (
        reached and nodes[node].cost + gap >= nodes[run.goal].cost - MIN_GAIN
    ):
        return
    if gap > 0.0 and not edge_is_free(search, x, y, goal[0], goal[1]):
        return
    if reached:
        change_parent(tree, run.goal, as_int(node), gap, search.below)
        return
    run.first_path, run.done = run.iteration, search.options.return_on_first_path
    run.goal = node if gap == 0.0 else insert(tree, goal[0], goal[1], node, gap)


@borrowing_kernel
def reconnect_goal(search: TreeSearch) -> None:
    """Connect a reached goal to its best node: costs may have fallen after nodes were connected."""
    for i in range(search.tree.grid[0].count):
        if i != search.run[0].goal:
            connect_goal(search, i)


@borrowing_kernel
def plant(search: TreeSearch) -> None:
    """Add the start to a new tree; the straight edge to the goal is the shortest path."""
    insert(search.tree, search.start[0], search.start[1], NONE, 0.0)
    connect_goal(search, 0)
    search.run[0].done = search.run[0].goal != NONE


@absorbed_kernel
def next_iteration(search: TreeSearch, until: int) -> bool:
    """Count an iteration up to `until`; false if it can change nothing, as in a full tree."""
    run, options, count = search.run[0], search.options, search.tree.grid[0].count
    if count == 0:
        plant(search)
    full = count >= options.nodes and not options.replaces_leaves
    if run.iteration >= until or run.done or full:
        return False
    run.iteration += 1
    return True


def to_plan(search: TreeSearch, other: Tree | None = None) -> Plan:
    """Return the plan of a finished search, with the edges of the goal's tree if there is one."""
    run, path, tree = search.run[0], np.empty((0, 2)), edges(search.tree)
    nodes, goal = len(tree) + 1, int(run["goal"])
    if other is not None:
        tree = np.concatenate([tree, edges(other)])
        nodes += int(other.grid["count"][0])
    counters = {
        "nodes": nodes,
        "iterations": int(run["iteration"]),
        "edges_tested": int(run["edges_tested"]),
    }
    if goal != NONE:
        path = path_from_root(search.tree, goal)
        counters["first_path_iterations"] = int(run["first_path"])
    return Plan(Status.EXHAUSTED if goal == NONE else Status.SOLVED, path, tree, counters)


def solve(
    problem: Problem, rng: np.random.Generator, end: float, options: TreeOptions,
    grow: Callable[..., None], both: bool = False,
) -> Plan:  # fmt: skip
    """Return the path that a loop finds in all iterations of the options, or until `end` [s].

    With `both` it grows a tree from the goal, too, whose branches may join in the first one.
    """
    capacity = 2 * options.nodes if both else min(options.nodes, options.iterations + 1)
    search, state, goal_tree = new_search(problem, options, capacity + 1), stream(rng), None
    if both:
        goal_tree = new_tree(search.space.bounds.tolist(), options.nodes)
        insert(goal_tree, search.goal[0], search.goal[1], NONE, 0.0)
        grow = partial(grow, goal_tree=goal_tree)
    for until in chunks(options.iterations, end):
        grow(search, until, state)
        if search.run["iteration"][0] < until:
            break
    if search.run["goal"][0] != NONE and not (both or options.return_on_first_path):
        reconnect_goal(search)
    return to_plan(search, goal_tree)


CORNER_RADIUS = 1.0  # m: largest distance of a sample from its corner, about the width of a door
ROOMS = "design choice: rooms and doors of buildings"


@borrowing_kernel
def grow(search: TreeSearch, until: int, state: Stream) -> None:
    """Grow a tree to iteration `until`, or to the first path.

    All state is in the search, so that chunks of iterations do not change the result.
    """
    tree = search.tree
    while next_iteration(search, until):
        x, y = sample(search, state)  # RANDOM_STATE
        near = nearest(tree, x, y)  # NEAREST_NEIGHBOR
        x, y, edge, free = extend(search, tree, near, x, y, search.options.step)  # NEW_STATE
        if free:
            connect_goal(search, insert(tree, x, y, near, edge))  # add_vertex, add_edge


@settings
class GoalBias:
    """Samples at the goal (LaValle and Kuffner 2001)."""

    goal_bias: float = setting(default=0.05, low=0.0, high=1.0, source="LaValle and Kuffner 2001")
    """Share of the samples that are the goal."""


@settings
class Rrt(GoalBias, PlannerBase):
    """A rapidly exploring random tree (LaValle 1998); it ends with its first path."""

    iterations: int = setting(
        default=20_000, low=1, source="enough for doors of 1 m on maps of 50 m"
    )
    """Largest number of samples."""
    step: float = setting(default=2.0, unit="m", low=1e-3, source=ROOMS)
    """Longest edge towards a sample."""

    def solve(self, problem: Problem, rng: np.random.Generator, end: float) -> Plan:
        """Return the first path."""
        options = with_settings(TreeOptions(goal_reach=GOAL_REACH), self)
        return solve(problem, rng, end, options, grow)


@borrowing_kernel
def sample_near_corner(
    search: TreeSearch, radius: float, longest: float, state: Stream
) -> tuple[float, float]:
    """Draw a useful point within a radius [m] of an obstacle's corner (Amato et al. 1998).

    Narrow passages lie there, and paths bend there.
    """
    segments = search.space.segments
    x, y = search.goal[0], search.goal[1]
    for _ in range(MAX_DRAWS):
        k = int(next_uniform(state) * len(segments))
        u, v = next_in_disc(state)
        x, y = segments[k, 0] + radius * u, segments[k, 1] + radius * v
        if is_useful(search, x, y, longest):
            break
    return x, y


@absorbed_kernel
def connect(search: TreeSearch, tree: Tree, x: float, y: float) -> tuple[int, bool]:
    """Extend a tree from its nearest node to a point step by step until blocked: CONNECT.

    Return the last node added, and whether it lies on the point.
    """
    options, nodes = search.options, tree.nodes
    i = nearest(tree, x, y)
    while True:
        from_x, from_y = nodes[i].x, nodes[i].y
        gap = math.hypot(x - from_x, y - from_y)
        if gap == 0.0:
            return i, True
        if tree.grid[0].count >= options.nodes:
            return i, False
        part = min(1.0, options.step / gap)
        to_x, to_y = x, y
        if part < 1.0:
            to_x, to_y = from_x + part * (x - from_x), from_y + part * (y - from_y)
        if not edge_is_free(search, from_x, from_y, to_x, to_y):
            return i, False
        i = insert(tree, to_x, to_y, i, part * gap)


@borrowing_kernel
def join_trees(start_tree: Tree, goal_tree: Tree, node: int, twin: int) -> int:
    """Copy the branch above `twin` in the goal tree to the start tree; return the goal."""
    nodes = goal_tree.nodes
    i = nodes[twin].parent
    edge = nodes[twin].edge
    while i != NONE:
        node = insert(start_tree, nodes[i].x, nodes[i].y, node, edge)
        edge = nodes[i].edge
        i = nodes[i].parent
    return node


@absorbed_kernel
def extend_both(search: TreeSearch, goal_tree: Tree, state: Stream) -> None:
    """Extend one tree to a sample and connect the other one to it, in turn: lines 3 to 7."""
    start_tree, run, corner_share = search.tree, search.run[0], search.options.corner_share
    forward = run.iteration % 2 == 1
    tree, other = (start_tree, goal_tree) if forward else (goal_tree, start_tree)
    if corner_share > 0.0 and next_uniform(state) < corner_share:  # line 3: RANDOM_CONFIG
        x, y = sample_near_corner(search, CORNER_RADIUS, math.inf, state)
    else:
        x, y = sample(search, state)
    near = nearest(tree, x, y)
    x, y, edge, free = extend(search, tree, near, x, y, search.options.step)  # line 4: EXTEND
    if not free:
        return
    new = free_slot(search, tree, near, near, state)
    if new == NONE:
        return
    place_node(tree, new, x, y, near, edge)
    met, there = connect(search, other, x, y)  # line 5: CONNECT
    if there:  # line 6: PATH
        node, twin = (new, met) if forward else (met, new)
        run.goal = join_trees(start_tree, goal_tree, node, twin)
        run.first_path, run.done = run.iteration, search.options.return_on_first_path


@borrowing_kernel
def grow_both(search: TreeSearch, until: int, state: Stream, goal_tree: Tree) -> None:
    """Grow two trees to iteration `until`, or until they meet or one is full."""
    while goal_tree.grid[0].count < search.options.nodes and next_iteration(search, until):
        extend_both(search, goal_tree, state)


@settings
class LongEdges:
    """Edges of trees that reach for each other, or that are rewired."""

    step: float = setting(default=4.0, unit="m", low=1e-3, source=ROOMS)
    """Longest edge towards a sample."""


@settings
class CornerSampling:
    """Samples near the corners of obstacles, where doors are (Amato et al. 1998)."""

    corner_share: float = setting(
        default=0.5, low=0.0, high=1.0, source="measured with the planner benchmark"
    )
    """Share of the samples near the corners of obstacles."""


@settings
class RrtConnect(CornerSampling, LongEdges, PlannerBase):
    """Two trees that reach for each other (Kuffner and LaValle 2000): quick, not short.

    It tries the straight line first.
    """

    iterations: int = setting(default=100_000, low=1, source="mazes take some thousands")
    """Largest number of samples."""

    def solve(self, problem: Problem, rng: np.random.Generator, end: float) -> Plan:
        """Return the first path."""
        return solve(problem, rng, end, with_settings(TreeOptions(), self), grow_both, both=True)
