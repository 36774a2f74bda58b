"""Replanning: a new plan from the present pose that reuses what is still free of an old one."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from planners.collision.polygon_tests import edge_free
from planners.problem import Plan, Problem, begin, trivial
from planners.trees.sampling import TreeSearch, edge_is_free
from planners.trees.settings import InformedRrtStar
from planners.trees.tree import NONE, Tree, insert
from planners.trees.tree_search import grow_until, new_search, to_plan, with_capacity
from wheelchair_gym.compiled.clock import clock
from wheelchair_gym.compiled.kernel import borrowing_kernel
from wheelchair_gym.random import stream

Array = NDArray[np.float64]


def remainder(problem: Problem, path: Array) -> Array:
    """The rest of a path (n, 2) for a chair at the problem's start: points (k, 2) [m].

    It leads from the start straight to the end of the nearest edge of the path, or, if that end is
    hidden, to the edge's beginning, and then along the path. The rest may not be free.
    """
    start = np.asarray(problem.start, dtype=np.float64)[:2]
    begins, legs = path[:-1], np.diff(path, axis=0)
    squares = np.maximum((legs**2).sum(axis=1), np.finfo(np.float64).tiny)
    along = np.clip(((start - begins) * legs).sum(axis=1) / squares, 0.0, 1.0)
    distances = np.hypot(*(begins + along[:, None] * legs - start).T)
    k = int(np.flatnonzero(distances == distances.min())[-1]) + 1
    if not edge_free(problem.free.arrays, *start, *path[k]):
        k -= 1
    if (path[k] == start).all() and k < len(path) - 1:
        k += 1
    return np.vstack([start, path[k:]])


def replan(
    problem: Problem,
    previous: Plan,
    rng: np.random.Generator,
    deadline: float | None = None,
    planner: InformedRrtStar | None = None,
) -> Plan:
    """A plan from the present pose in a changed space, with the free parts of an old plan.

    The rest of the old path is the first path if it is free; otherwise its free ends join the start
    tree and the goal tree. The old tree's edges that are still free follow; then sampling goes on.
    So the plan is never longer than a free rest of the old path. It starts from nothing if the goal
    has moved. The thesis starts from nothing at each temporary obstacle (section 3.2.2).

    Args:
        problem: the space as it is now, the pose now as the start, the goal.
        previous: a plan to the same goal, from any planner.
        rng: draws the numbers.
        deadline: seconds of wall time from the call, as for a planner.
        planner: settings of the sampling; None for the defaults.

    Returns:
        A plan; `counters["kept"]` are the nodes reused from the old plan.

    Raises:
        InputError: as a planner's.
    """
    planner = planner or InformedRrtStar()
    began, end = begin(deadline)
    plan = trivial(problem)
    if plan is not None:
        return plan
    old = np.asarray(previous.path, dtype=np.float64)[:, :2]
    goal = np.asarray(problem.goal, dtype=np.float64)[:2]
    trees = new_search(problem, planner.growth)
    kept = 0
    if len(old) >= 2 and (old[-1] == goal).all():
        rest = remainder(problem, old)
        trees = with_capacity(
            trees, 2 * (len(rest) + len(previous.tree)) + len(trees.start_tree.nodes)
        )
        free, free_at_goal = reuse_path(trees, rest)
        _reuse_trees(trees, previous.tree, rest, free, free_at_goal)
        kept = int(trees.start_tree.grid["count"][0] + trees.goal_tree.grid["count"][0]) - 2
    plan = to_plan(grow_until(trees, planner.iterations, end, stream(rng)))
    timings = {"time_s": clock() - began}
    return replace(plan, counters={**plan.counters, "kept": kept}, timings=timings)


def _reuse_trees(trees: TreeSearch, tree: Array, rest: Array, free: int, free_at_goal: int) -> None:
    """Reuse the old tree's edges (k, 4) below the free beginning and the free end of a path."""
    ends = np.concatenate([tree.reshape(-1, 2), rest])
    _, where, index = np.unique(
        ends[:, 0] + 1j * ends[:, 1], return_index=True, return_inverse=True
    )
    points, pairs = ends[where], index[: 2 * len(tree)].reshape(-1, 2)
    left = np.concatenate([pairs[:, 0], pairs[:, 1]])
    right = np.concatenate([pairs[:, 1], pairs[:, 0]])
    first = np.concatenate([[0], np.cumsum(np.bincount(left, minlength=len(points)))])
    others = right[np.argsort(left, kind="stable")]
    on_rest = index[2 * len(tree) :]
    node_of = np.full(len(points), NONE)
    node_of[on_rest[: free + 1]] = np.arange(free + 1)
    old_tree = points, first, others
    reuse_tree(trees, trees.start_tree, trees.goal, *old_tree, node_of)
    if trees.workspace.run["goal"][0] != NONE:
        return
    goal = on_rest[-1]
    if node_of[goal] != NONE:  # by another path than the old one
        trees.workspace.run["goal"], trees.workspace.run["first_path"] = node_of[goal], 0
        return
    node_of = np.full(len(points), NONE)
    node_of[on_rest[::-1][: free_at_goal + 1]] = np.arange(free_at_goal + 1)
    reuse_tree(trees, trees.goal_tree, trees.start, *old_tree, node_of)


@borrowing_kernel
def reuse_path(search: TreeSearch, path: Array) -> tuple[int, int]:
    """Insert the free parts of a path (n, 2) [m] from start to goal into two empty trees.

    A free path connects the start tree to the goal. Otherwise the free beginning enters the start
    tree and the free end the goal tree. Returns how many edges are free at the beginning and at the
    end.
    """
    space, start_tree, goal_tree = search.space, search.start_tree, search.goal_tree
    run, n = search.workspace.run[0], path.shape[0]
    node, kept = insert(start_tree, path[0, 0], path[0, 1], NONE, 0.0), 0
    insert(goal_tree, path[n - 1, 0], path[n - 1, 1], NONE, 0.0)
    while kept < n - 1:
        ax, ay, bx, by = path[kept, 0], path[kept, 1], path[kept + 1, 0], path[kept + 1, 1]
        if not edge_is_free(space, run, ax, ay, bx, by):
            break
        node = insert(start_tree, bx, by, node, math.hypot(bx - ax, by - ay))
        kept += 1
    if kept == n - 1:
        run.goal, run.first_path = node, 0
        return kept, 0
    node, kept_at_goal = 0, 0
    for k in range(n - 1, kept + 1, -1):
        ax, ay, bx, by = path[k, 0], path[k, 1], path[k - 1, 0], path[k - 1, 1]
        if not edge_is_free(space, run, ax, ay, bx, by):
            break
        node = insert(goal_tree, bx, by, node, math.hypot(bx - ax, by - ay))
        kept_at_goal += 1
    return kept, kept_at_goal


@borrowing_kernel
def reuse_tree(
    search: TreeSearch,
    tree: Tree,
    target: Array,
    points: Array,
    first: NDArray[np.int64],
    others: NDArray[np.int64],
    node_of: NDArray[np.int64],
) -> None:
    """Insert the edges of an old tree that are still free, starting at points in the new tree.

    The old tree is its points (n, 2) [m] and their neighbours: point i has
    `others[first[i] : first[i + 1]]`. `node_of` (n,) maps points to nodes of the new tree.
    """
    nodes, run, stack = tree.nodes, search.workspace.run[0], search.workspace.stack
    best = nodes[run.goal].cost if run.goal != NONE else np.inf
    height = 0
    for i in range(len(points)):
        if node_of[i] != NONE:
            stack[height] = i
            height += 1
    while height > 0:
        height -= 1
        i = stack[height]
        x, y = points[i, 0], points[i, 1]
        for k in range(first[i], first[i + 1]):
            j = others[k]
            if node_of[j] != NONE or tree.grid[0].count >= search.growth.max_nodes:
                continue
            u, v = points[j, 0], points[j, 1]
            edge = math.hypot(u - x, v - y)
            # Cost plus distance to the target rises along a branch: descendants cannot help either.
            cost = nodes[node_of[i]].cost + edge
            if cost + math.hypot(target[0] - u, target[1] - v) >= best:
                continue
            if edge_is_free(search.space, run, x, y, u, v):
                node_of[j] = insert(tree, u, v, node_of[i], edge)
                stack[height] = j
                height += 1
