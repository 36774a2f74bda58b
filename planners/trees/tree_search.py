"""The loop of all tree planners; each planner is a set of its options (`Growth`).

From top to bottom: best parent and rewiring; the connection to the goal; one iteration; and the
search itself, in chunks of iterations between which the clock is read. `sampling` has its state.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from planners.collision.polygon_tests import SpaceArrays, point_free
from planners.problem import Plan, Problem, Status
from planners.trees.sampling import (
    MIN_GAIN,
    Growth,
    TreeSearch,
    Workspace,
    edge_is_free,
    new_run,
    new_workspace,
    sample,
)
from planners.trees.tree import (
    NONE,
    Tree,
    change_parent,
    edges,
    insert,
    nearest,
    new_tree,
    nodes_within,
    path_from_root,
    place_node,
    remove_node,
    tree_with_capacity,
    write_ancestors,
)
from wheelchair_gym.compiled.clock import clock
from wheelchair_gym.compiled.kernel import absorbed_kernel, as_int, borrowing_kernel
from wheelchair_gym.random import Stream, next_uniform, stream

# Draws of a random leaf before the search for one is given up.
_LEAF_DRAWS = 100


@borrowing_kernel
def choose_parent(
    space: SpaceArrays,
    tree: Tree,
    x: float,
    y: float,
    workspace: Workspace,
    n: int,
    parent: int,
    edge: float,
) -> tuple[int, float]:
    """The neighbour through which a point is reached at least cost, and the edge's length.

    Neighbours are tried in order of cost, so that few edges are tested. `parent` sees the point.
    """
    nodes, through, run = tree.nodes, workspace.through, workspace.run[0]
    for k in range(n):
        through[k] = nodes[workspace.found[k]].cost + workspace.distances[k]
    while True:
        least, choice = nodes[parent].cost + edge, NONE
        for k in range(n):
            if through[k] < least:
                least, choice = through[k], k
        if choice == NONE:
            return parent, edge
        through[choice] = np.inf
        j = workspace.found[choice]
        if edge_is_free(space, run, nodes[j].x, nodes[j].y, x, y):
            return as_int(j), workspace.distances[choice]


@borrowing_kernel
def best_ancestor(
    space: SpaceArrays, tree: Tree, x: float, y: float, parent: int, edge: float, run: Any
) -> tuple[int, float]:
    """The farthest ancestor reached before one is hidden from a point, and the edge's length.

    By the triangle inequality each ancestor is a better parent than its child (Jeong et al. 2019).
    """
    nodes = tree.nodes
    while nodes[parent].parent != NONE:
        above = as_int(nodes[parent].parent)
        if not edge_is_free(space, run, nodes[above].x, nodes[above].y, x, y):
            break
        parent = above
        edge = math.hypot(x - nodes[parent].x, y - nodes[parent].y)
    return parent, edge


@absorbed_kernel
def connect_goal(search: TreeSearch, node: int) -> None:
    """Connect a node to the goal, if the goal is within reach and visible and its cost falls."""
    tree, goal, run = search.start_tree, search.goal, search.workspace.run[0]
    nodes = tree.nodes
    x, y = nodes[node].x, nodes[node].y
    gap = math.hypot(goal[0] - x, goal[1] - y)
    reached = run.goal != NONE
    if gap > search.growth.goal_reach or (
        reached and nodes[node].cost + gap >= nodes[run.goal].cost - MIN_GAIN
    ):
        return
    if gap > 0.0 and not edge_is_free(search.space, run, x, y, goal[0], goal[1]):
        return
    if reached:
        change_parent(tree, run.goal, as_int(node), gap, search.workspace.stack)
        return
    run.first_path = run.iteration
    run.goal = node if gap == 0.0 else insert(tree, goal[0], goal[1], node, gap)


@borrowing_kernel
def reconnect_goal(search: TreeSearch) -> None:
    """Connect a reached goal to its best node: costs may have fallen after nodes were connected."""
    for i in range(search.start_tree.grid[0].count):
        if i != search.workspace.run[0].goal:
            connect_goal(search, i)


@borrowing_kernel
def shortcut_path(search: TreeSearch) -> None:
    """Join vertices of the best path where that shortens it; edges are tested exactly."""
    space, tree, workspace = search.space, search.start_tree, search.workspace
    nodes, run = tree.nodes, workspace.run[0]
    n = write_ancestors(nodes, run.goal, workspace.chain)
    for k in range(n - 3, -1, -1):
        i = workspace.chain[k]
        x, y = nodes[i].x, nodes[i].y
        count = min(n - k - 2, len(workspace.found))
        for m in range(count):  # ancestors of the parent, as many as fit
            j = workspace.chain[k + 2 + m]
            workspace.found[m] = j
            workspace.distances[m] = math.hypot(nodes[j].x - x, nodes[j].y - y)
        before = as_int(nodes[i].parent)
        parent, edge = choose_parent(space, tree, x, y, workspace, count, before, nodes[i].edge)
        parent, edge = best_ancestor(space, tree, x, y, parent, edge, run)  # drops collinear points
        if parent != before:
            change_parent(tree, as_int(i), as_int(parent), edge, workspace.stack)


@borrowing_kernel
def random_leaf(tree: Tree, one: int, other: int, third: int, state: Stream) -> int:
    """A random leaf, neither the root nor one of three nodes; NONE if no draw finds one."""
    for _ in range(_LEAF_DRAWS):
        i = 1 + int(next_uniform(state) * (tree.grid[0].count - 1))
        if tree.nodes[i].child == NONE and i != one and i != other and i != third:
            return i
    return NONE


# Iterations between two shortcuts of an improving best path.
_SHORTCUT_PERIOD = 64
# A path up to this factor longer than the straight line is straight but for rounding.
_STRAIGHT = 1.0 + 1e-12


@absorbed_kernel
def connect(search: TreeSearch, tree: Tree, x: float, y: float) -> tuple[int, bool]:
    """Extend a tree from its nearest node to a point step by step until blocked: CONNECT.

    Returns the last node added, and whether it lies on the point.
    """
    growth, nodes = search.growth, tree.nodes
    i = nearest(tree, x, y)
    while True:
        from_x, from_y = nodes[i].x, nodes[i].y
        gap = math.hypot(x - from_x, y - from_y)
        if gap == 0.0:
            return i, True
        if tree.grid[0].count >= growth.max_nodes:
            return i, False
        part = min(1.0, growth.step / gap)
        to_x, to_y = x, y
        if part < 1.0:
            to_x, to_y = from_x + part * (x - from_x), from_y + part * (y - from_y)
        if not edge_is_free(search.space, search.workspace.run[0], from_x, from_y, to_x, to_y):
            return i, False
        i = insert(tree, to_x, to_y, i, part * gap)


@borrowing_kernel
def join_trees(start_tree: Tree, goal_tree: Tree, node: int, twin: int) -> int:
    """Copy the branch above `twin` in the goal tree to the start tree; returns the goal."""
    nodes = goal_tree.nodes
    i = nodes[twin].parent
    edge = nodes[twin].edge
    while i != NONE:
        node = insert(start_tree, nodes[i].x, nodes[i].y, node, edge)
        edge = nodes[i].edge
        i = nodes[i].parent
    return node


@absorbed_kernel
def add_node(
    search: TreeSearch, tree: Tree, x: float, y: float, near: int, edge: float, state: Stream
) -> int:
    """Add a visible point [m] below its best parent and rewire; NONE if it cannot help.

    At `max_nodes` the point replaces a random leaf, if the options say so.
    """
    space, goal, growth, workspace = search.space, search.goal, search.growth, search.workspace
    nodes, grid, run = tree.nodes, tree.grid[0], workspace.run[0]
    found, distances = workspace.found, workspace.distances
    parent, n = near, 0
    rewiring = growth.rewiring and (run.first_path != NONE or not growth.bidirectional)
    if rewiring:
        radius = growth.radius
        if radius == 0.0:
            count = grid.count + 1
            radius = growth.gamma * math.sqrt(run.sample_area * math.log(count) / count)
        n = nodes_within(tree, x, y, radius, found, distances)
        if run.beacon != NONE and n < len(found):  # the path continues to the next vertex
            found[n] = workspace.chain[run.beacon - 1]
            distances[n] = math.hypot(nodes[found[n]].x - x, nodes[found[n]].y - y)
            n += 1
        parent, edge = choose_parent(space, tree, x, y, workspace, n, near, edge)
        if growth.informed:
            parent, edge = best_ancestor(space, tree, x, y, parent, edge, run)
            least = nodes[parent].cost + edge + math.hypot(goal[0] - x, goal[1] - y)
            if least >= nodes[run.goal].cost - MIN_GAIN:
                return NONE
    if grid.count < growth.max_nodes:
        new = insert(tree, x, y, parent, edge)
    else:
        new = random_leaf(tree, parent, near, run.goal, state) if growth.replace_leaves else NONE
        if new == NONE:
            return NONE
        remove_node(tree, new)
        place_node(tree, new, x, y, parent, edge)
    cost = nodes[new].cost
    for k in range(n):
        j = found[k]
        if cost + distances[k] < nodes[j].cost - MIN_GAIN and edge_is_free(
            space, run, x, y, nodes[j].x, nodes[j].y
        ):
            change_parent(tree, as_int(j), as_int(new), distances[k], workspace.stack)
    return int(new)


@absorbed_kernel
def extend(search: TreeSearch, tree: Tree, state: Stream) -> int:
    """Draw a sample and extend a tree to it; NONE if that is blocked or cannot help."""
    workspace = search.workspace
    x, y = sample(search, tree, state)
    beacon = workspace.run[0].beacon
    near = nearest(tree, x, y) if beacon == NONE else as_int(workspace.chain[beacon + 1])
    return extend_towards(search, tree, near, x, y, state)


@absorbed_kernel
def extend_towards(
    search: TreeSearch, tree: Tree, near: int, x: float, y: float, state: Stream
) -> int:
    """Add a node at a point [m], or a step from the node `near` to it; NONE as in `extend`."""
    growth, run = search.growth, search.workspace.run[0]
    near_x, near_y = tree.nodes[near].x, tree.nodes[near].y
    edge = math.hypot(x - near_x, y - near_y)
    if edge <= MIN_GAIN:
        return NONE
    if run.beacon == NONE and edge > growth.step:
        x = near_x + (x - near_x) * growth.step / edge
        y = near_y + (y - near_y) * growth.step / edge
        edge = math.hypot(x - near_x, y - near_y)
    if edge_is_free(search.space, run, near_x, near_y, x, y):
        return add_node(search, tree, x, y, near, edge, state)
    if growth.in_strip:
        run.blocked += 1
        run.walls_cut += point_free(search.space, x, y)
        run.strip_margin += growth.widening
    return NONE


@borrowing_kernel
def update_best_path(search: TreeSearch) -> None:
    """Shortcut the best path if its cost fell, and update the area of the informed ellipse."""
    start, goal, run = search.start, search.goal, search.workspace.run[0]
    nodes = search.start_tree.nodes
    if nodes[run.goal].cost >= run.path_length - MIN_GAIN:
        return
    shortcut_path(search)
    run.path_length = nodes[run.goal].cost
    apart = math.hypot(goal[0] - start[0], goal[1] - start[1])
    if search.growth.informed:
        across = math.sqrt(max(run.path_length * run.path_length - apart * apart, 0.0))
        run.sample_area = min(run.sample_area, 0.25 * math.pi * run.path_length * across)
    run.done |= run.path_length <= apart * _STRAIGHT


@borrowing_kernel
def begin(search: TreeSearch) -> None:
    """Plant the trees of a new search; the straight edge is the shortest path."""
    start, goal, run = search.start, search.goal, search.workspace.run[0]
    if run.iteration == 0:
        insert(search.start_tree, start[0], start[1], NONE, 0.0)
        insert(search.goal_tree, goal[0], goal[1], NONE, 0.0)
        connect_goal(search, 0)
        run.done = run.goal != NONE


@absorbed_kernel
def has_room(search: TreeSearch) -> bool:
    """Return whether another iteration fits into the arrays; a search of full trees is done."""
    start_tree, goal_tree, growth = search.start_tree, search.goal_tree, search.growth
    one, other = start_tree.grid[0].count, goal_tree.grid[0].count
    if not growth.replace_leaves and max(one, other) >= growth.max_nodes:
        search.workspace.run[0].done = True
        return False
    # A branch of the goal tree may join the start tree.
    both = one + other + growth.reserve
    return both <= len(start_tree.nodes) and (
        not growth.bidirectional or both <= len(goal_tree.nodes)
    )


@borrowing_kernel
def grow(search: TreeSearch, until: int, state: Stream) -> None:
    """Grow trees to iteration `until`, or to an earlier end.

    It also returns early where the arrays are too small for another iteration. All state is in the
    search, so that chunks of iterations and capacities do not change the result.
    """
    start_tree, goal_tree, growth = search.start_tree, search.goal_tree, search.growth
    run = search.workspace.run[0]
    begin(search)
    while run.iteration < until and not run.done and has_room(search):
        tree, other = (goal_tree, start_tree) if run.from_goal else (start_tree, goal_tree)
        run.iteration += 1
        new = extend(search, tree, state)
        if growth.bidirectional and run.first_path == NONE:
            if new != NONE:
                x, y = tree.nodes[new].x, tree.nodes[new].y
                met, there = connect(search, other, x, y)
                if there:
                    node, twin = (met, new) if run.from_goal else (new, met)
                    run.goal = join_trees(start_tree, goal_tree, node, twin)
                    run.first_path = run.iteration
            run.from_goal = run.first_path == NONE and not run.from_goal
        elif new != NONE:
            connect_goal(search, new)
        if run.first_path == run.iteration:
            run.done = growth.stop_at_first
        due = run.first_path == run.iteration or (
            run.first_path != NONE and run.iteration % _SHORTCUT_PERIOD == 0
        )
        if growth.shortcut_path and due:
            update_best_path(search)


# Grows the trees of a search to an iteration: `grow`, or a variant of it.
Grow = Callable[[TreeSearch, int, Stream], None]
# Capacity at first, and the factor by which it grows.
_INITIAL_NODES, _CAPACITY_FACTOR = 256, 4
# Iterations of the first chunk under a deadline, and the most of any.
_FIRST_CHUNK, _MAX_CHUNK = 16, 4096
# Target duration of a chunk: a share of the deadline, and at most so many seconds.
_CHUNK_SHARE, _CHUNK_SECONDS = 0.02, 2e-3


def new_search(problem: Problem, growth: Growth) -> TreeSearch:
    """A search with small empty trees, which are enlarged when needed."""
    arrays = problem.free.arrays
    bounds = arrays.bounds.tolist()
    across = math.hypot(bounds[2] - bounds[0], bounds[3] - bounds[1])
    # The edges that connect one tree to another cross the map at most.
    growth = growth._replace(reserve=int(across / growth.step) + 4 if growth.bidirectional else 2)
    return TreeSearch(
        arrays,
        new_tree(bounds, growth.reserve + _INITIAL_NODES),
        new_tree(bounds, growth.reserve + _INITIAL_NODES if growth.bidirectional else 1),
        np.array(problem.start[:2], dtype=np.float64),
        np.array(problem.goal[:2], dtype=np.float64),
        growth,
        new_workspace(new_run(bounds), growth.reserve + _INITIAL_NODES),
    )


def with_capacity(trees: TreeSearch, capacity: int) -> TreeSearch:
    """The same search with arrays for so many nodes of each tree."""
    both = trees.growth.bidirectional
    return trees._replace(
        start_tree=tree_with_capacity(trees.start_tree, capacity),
        goal_tree=tree_with_capacity(trees.goal_tree, capacity) if both else trees.goal_tree,
        workspace=new_workspace(trees.workspace.run, capacity),
    )


def grow_until(trees: TreeSearch, end: float, state: Stream, grow: Grow) -> TreeSearch:
    """The search after all iterations, or at the time `end` [s], or when it is done.

    At least one chunk of iterations runs.
    """
    run, iterations = trees.workspace.run, trees.growth.iterations
    chunk, before = iterations if end == math.inf else _FIRST_CHUNK, clock()
    aim = min(_CHUNK_SHARE * max(end - before, 0.0), _CHUNK_SECONDS)
    while True:
        made = int(run["iteration"][0])
        grow(trees, min(iterations, made + chunk), state)
        new = int(run["iteration"][0])
        if run["done"][0] or new >= iterations:
            return trees
        if new < made + chunk:
            trees = with_capacity(trees, _CAPACITY_FACTOR * len(trees.start_tree.nodes))
        if end < math.inf:
            now = clock()
            if now >= end:
                return trees
            if new > made:
                chunk = int(min(aim, end - now) * (new - made) / max(now - before, 1e-9))
                chunk = min(max(chunk, 1), _MAX_CHUNK)
            before = now


def to_plan(trees: TreeSearch) -> Plan:
    """The plan of a finished search."""
    run, start_tree = trees.workspace.run[0], trees.start_tree
    # Informed searches have tried each edge to the goal already.
    open_end = trees.growth.rewiring and not (trees.growth.stop_at_first or trees.growth.informed)
    if run["goal"] != NONE and open_end:
        reconnect_goal(trees)
    goal, first = int(run["goal"]), int(run["first_path"])
    path, tree = np.empty((0, 2)), edges(start_tree)
    nodes = len(tree) + 1
    if trees.growth.bidirectional:
        tree = np.concatenate([tree, edges(trees.goal_tree)])
        nodes += int(trees.goal_tree.grid["count"][0])
    counters = {"nodes": nodes, "iterations": int(run["iteration"])}
    counters["edges_tested"] = int(run["edges_tested"])
    if trees.growth.in_strip:
        counters["blocked"], counters["walls_cut"] = int(run["blocked"]), int(run["walls_cut"])
    if goal != NONE:
        path = path_from_root(start_tree, goal)
        counters["first_path_iterations"] = first
    return Plan(Status.EXHAUSTED if goal == NONE else Status.SOLVED, path, tree, counters)


def search(
    problem: Problem, rng: np.random.Generator, end: float, growth: Growth, grow: Grow = grow
) -> Plan:
    """The plan found in all iterations of the options, or at the time `end` [s]."""
    return to_plan(grow_until(new_search(problem, growth), end, stream(rng), grow))
