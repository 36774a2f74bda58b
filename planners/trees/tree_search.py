"""The search of all tree planners; each planner is a set of its options (`TreeOptions`).

From top to bottom: best parent and rewiring; the connection to the goal; one iteration; and the
search itself, in chunks of iterations between which the clock is read. `sampling` has its state.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from planners.collision.polygon_tests import point_free
from planners.problem import Plan, Problem, Status, chunks
from planners.trees.sampling import (
    MIN_GAIN,
    TreeOptions,
    TreeSearch,
    edge_is_free,
    new_search,
    sample,
)
from planners.trees.tree import (
    NONE,
    Tree,
    change_parent,
    edges,
    insert,
    nearest,
    nodes_within,
    path_from_root,
    place_node,
    remove_node,
    write_ancestors,
)
from wheelchair_gym.compiled.kernel import absorbed_kernel, as_int, borrowing_kernel
from wheelchair_gym.random import Stream, next_uniform, stream

# Draws of a random leaf before the search for one is given up.
_LEAF_DRAWS = 100


@absorbed_kernel
def choose_parent(
    search: TreeSearch, tree: Tree, x: float, y: float, n: int, parent: int, edge: float
) -> tuple[int, float]:
    """Return the cheapest parent of a point among n neighbours, and the edge's length.

    Neighbours are tried in order of cost, so that few edges are tested. `parent` sees the point.
    """
    nodes, found, through = tree.nodes, search.found, search.through
    for k in range(n):
        through[k] = nodes[found[k]].cost + search.distances[k]
    while True:
        least, choice = nodes[parent].cost + edge, NONE
        for k in range(n):
            if through[k] < least:
                least, choice = through[k], k
        if choice == NONE:
            return parent, edge
        through[choice] = np.inf
        j = found[choice]
        if edge_is_free(search, nodes[j].x, nodes[j].y, x, y):
            return as_int(j), search.distances[choice]


@absorbed_kernel
def best_ancestor(
    search: TreeSearch, tree: Tree, x: float, y: float, parent: int, edge: float
) -> tuple[int, float]:
    """Return the farthest ancestor before one that does not see a point, and the edge's length.

    By the triangle inequality each ancestor is a better parent than its child (Jeong et al. 2019).
    """
    nodes = tree.nodes
    while nodes[parent].parent != NONE:
        above = as_int(nodes[parent].parent)
        if not edge_is_free(search, nodes[above].x, nodes[above].y, x, y):
            break
        parent = above
        edge = math.hypot(x - nodes[parent].x, y - nodes[parent].y)
    return parent, edge


@absorbed_kernel
def connect_goal(search: TreeSearch, node: int) -> None:
    """Connect a node to the goal, if the goal is within reach and visible and its cost falls."""
    tree, goal, run = search.start_tree, search.goal, search.run[0]
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
        change_parent(tree, run.goal, as_int(node), gap, search.stack)
        return
    run.first_path = run.iteration
    run.goal = node if gap == 0.0 else insert(tree, goal[0], goal[1], node, gap)


@borrowing_kernel
def reconnect_goal(search: TreeSearch) -> None:
    """Connect a reached goal to its best node: costs may have fallen after nodes were connected."""
    for i in range(search.start_tree.grid[0].count):
        if i != search.run[0].goal:
            connect_goal(search, i)


@borrowing_kernel
def shortcut_path(search: TreeSearch) -> None:
    """Join vertices of the best path where that shortens it; edges are tested exactly."""
    tree, chain, found = search.start_tree, search.chain, search.found
    nodes = tree.nodes
    n = write_ancestors(nodes, search.run[0].goal, chain)
    for k in range(n - 3, -1, -1):
        i = chain[k]
        x, y = nodes[i].x, nodes[i].y
        count = min(n - k - 2, len(found))
        for m in range(count):  # ancestors of the parent, as many as fit
            j = chain[k + 2 + m]
            found[m] = j
            search.distances[m] = math.hypot(nodes[j].x - x, nodes[j].y - y)
        before = as_int(nodes[i].parent)
        parent, edge = choose_parent(search, tree, x, y, count, before, nodes[i].edge)
        parent, edge = best_ancestor(search, tree, x, y, parent, edge)  # drops collinear points
        if parent != before:
            change_parent(tree, as_int(i), as_int(parent), edge, search.stack)


@borrowing_kernel
def random_leaf(tree: Tree, one: int, other: int, third: int, state: Stream) -> int:
    """Draw a leaf, neither the root nor one of three nodes; NONE if no draw finds one."""
    for _ in range(_LEAF_DRAWS):
        i = 1 + int(next_uniform(state) * (tree.grid[0].count - 1))
        if tree.nodes[i].child == NONE and i != one and i != other and i != third:
            return i
    return NONE


# Iterations between two shortcuts of an improving best path.
_SHORTCUT_PERIOD = 64
# A path up to this factor longer than the straight line is straight within rounding.
_STRAIGHT = 1.0 + 1e-12


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
def add_node(
    search: TreeSearch, tree: Tree, x: float, y: float, near: int, edge: float, state: Stream
) -> int:
    """Add a visible point [m] below its best parent and rewire; NONE if it cannot help.

    At `nodes` the point replaces a random leaf, if the options say so.
    """
    goal, options, nodes, grid = search.goal, search.options, tree.nodes, tree.grid[0]
    run, found, distances = search.run[0], search.found, search.distances
    parent, n = near, 0
    rewiring = options.rewiring and (run.first_path != NONE or not options.bidirectional)
    if rewiring:
        radius = options.search_radius
        if radius == 0.0:
            count = grid.count + 1
            radius = options.gamma * math.sqrt(run.sample_area * math.log(count) / count)
        n = nodes_within(tree, x, y, radius, found, distances)
        if run.beacon != NONE and n < len(found):  # the path continues to the next vertex
            found[n] = search.chain[run.beacon - 1]
            distances[n] = math.hypot(nodes[found[n]].x - x, nodes[found[n]].y - y)
            n += 1
        parent, edge = choose_parent(search, tree, x, y, n, near, edge)
        if options.informed:
            parent, edge = best_ancestor(search, tree, x, y, parent, edge)
            least = nodes[parent].cost + edge + math.hypot(goal[0] - x, goal[1] - y)
            if least >= nodes[run.goal].cost - MIN_GAIN:
                return NONE
    if grid.count < options.nodes:
        new = insert(tree, x, y, parent, edge)
    else:
        new = random_leaf(tree, parent, near, run.goal, state) if options.replace_leaves else NONE
        if new == NONE:
            return NONE
        remove_node(tree, new)
        place_node(tree, new, x, y, parent, edge)
    cost = nodes[new].cost
    for k in range(n):
        j = found[k]
        if cost + distances[k] < nodes[j].cost - MIN_GAIN and edge_is_free(
            search, x, y, nodes[j].x, nodes[j].y
        ):
            change_parent(tree, as_int(j), as_int(new), distances[k], search.stack)
    return int(new)


@absorbed_kernel
def extend(search: TreeSearch, tree: Tree, state: Stream) -> int:
    """Draw a sample and extend a tree to it; NONE if that is blocked or cannot help."""
    x, y = sample(search, tree, state)
    beacon = search.run[0].beacon
    near = nearest(tree, x, y) if beacon == NONE else as_int(search.chain[beacon + 1])
    return extend_towards(search, tree, near, x, y, state)


@absorbed_kernel
def extend_towards(
    search: TreeSearch, tree: Tree, near: int, x: float, y: float, state: Stream
) -> int:
    """Add a node at a point [m], or a step from the node `near` to it; NONE as in `extend`."""
    options, run = search.options, search.run[0]
    near_x, near_y = tree.nodes[near].x, tree.nodes[near].y
    edge = math.hypot(x - near_x, y - near_y)
    if edge <= MIN_GAIN:
        return NONE
    if run.beacon == NONE and edge > options.step:
        x = near_x + (x - near_x) * options.step / edge
        y = near_y + (y - near_y) * options.step / edge
        edge = math.hypot(x - near_x, y - near_y)
    if edge_is_free(search, near_x, near_y, x, y):
        return add_node(search, tree, x, y, near, edge, state)
    if options.in_strip:
        run.blocked += 1
        run.walls_cut += point_free(search.space, x, y)
        run.strip_margin += options.widening
    return NONE


@borrowing_kernel
def update_best_path(search: TreeSearch) -> None:
    """Shortcut the best path if its cost fell, and update the area of the informed ellipse."""
    start, goal, run = search.start, search.goal, search.run[0]
    nodes = search.start_tree.nodes
    if nodes[run.goal].cost >= run.path_length - MIN_GAIN:
        return
    shortcut_path(search)
    run.path_length = nodes[run.goal].cost
    apart = math.hypot(goal[0] - start[0], goal[1] - start[1])
    if search.options.informed:
        across = math.sqrt(max(run.path_length * run.path_length - apart * apart, 0.0))
        run.sample_area = min(run.sample_area, 0.25 * math.pi * run.path_length * across)
    run.done |= run.path_length <= apart * _STRAIGHT


@borrowing_kernel
def begin(search: TreeSearch) -> None:
    """Plant the trees of a new search; the straight edge is the shortest path."""
    start, goal, run = search.start, search.goal, search.run[0]
    if run.iteration == 0:
        insert(search.start_tree, start[0], start[1], NONE, 0.0)
        insert(search.goal_tree, goal[0], goal[1], NONE, 0.0)
        connect_goal(search, 0)
        run.done = run.goal != NONE


@absorbed_kernel
def is_over(search: TreeSearch) -> bool:
    """Return whether more iterations change nothing: the search is done, or a tree is full."""
    options, nodes = search.options, search.options.nodes
    full = max(search.start_tree.grid[0].count, search.goal_tree.grid[0].count) >= nodes
    return search.run[0].done or (full and not options.replace_leaves)


@borrowing_kernel
def grow(search: TreeSearch, until: int, state: Stream) -> None:
    """Grow trees to iteration `until`, or to an earlier end.

    All state is in the search, so that chunks of iterations do not change the result.
    """
    start_tree, goal_tree, options = search.start_tree, search.goal_tree, search.options
    run = search.run[0]
    begin(search)
    while run.iteration < until and not is_over(search):
        tree, other = (goal_tree, start_tree) if run.from_goal else (start_tree, goal_tree)
        run.iteration += 1
        new = extend(search, tree, state)
        if options.bidirectional and run.first_path == NONE:
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
            run.done = options.return_on_first_path
        due = run.first_path == run.iteration or (
            run.first_path != NONE and run.iteration % _SHORTCUT_PERIOD == 0
        )
        if options.shortcut_path and due:
            update_best_path(search)


# Grows the trees of a search to an iteration: `grow`, or a variant of it.
Grow = Callable[[TreeSearch, int, Stream], None]


def grow_until(trees: TreeSearch, end: float, state: Stream, grow: Grow) -> None:
    """Grow trees for all iterations, or until the time `end` [s], or until the search is over."""
    for until in chunks(trees.options.iterations, end):
        grow(trees, until, state)
        if trees.run["iteration"][0] < until:
            break


def to_plan(trees: TreeSearch) -> Plan:
    """Return the plan of a finished search."""
    run, start_tree = trees.run[0], trees.start_tree
    # Informed searches have tried each edge to the goal already.
    options = trees.options
    open_end = options.rewiring and not (options.return_on_first_path or options.informed)
    if run["goal"] != NONE and open_end:
        reconnect_goal(trees)
    goal, first = int(run["goal"]), int(run["first_path"])
    path, tree = np.empty((0, 2)), edges(start_tree)
    nodes = len(tree) + 1
    if options.bidirectional:
        tree = np.concatenate([tree, edges(trees.goal_tree)])
        nodes += int(trees.goal_tree.grid["count"][0])
    counters = {"nodes": nodes, "iterations": int(run["iteration"])}
    counters["edges_tested"] = int(run["edges_tested"])
    if options.in_strip:
        counters["blocked"], counters["walls_cut"] = int(run["blocked"]), int(run["walls_cut"])
    if goal != NONE:
        path = path_from_root(start_tree, goal)
        counters["first_path_iterations"] = first
    return Plan(Status.EXHAUSTED if goal == NONE else Status.SOLVED, path, tree, counters)


def search(
    problem: Problem, rng: np.random.Generator, end: float, options: TreeOptions, grow: Grow = grow
) -> Plan:
    """Return the plan found in all iterations of the options, or at the time `end` [s]."""
    trees = new_search(problem, options)
    grow_until(trees, end, stream(rng), grow)
    return to_plan(trees)
