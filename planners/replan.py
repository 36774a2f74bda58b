"""Replanning: a new plan from where the chair is, which keeps what still holds of the old one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from planners.collision.polygon_tests import edge_free
from planners.problem import Plan, Problem, begin, trivial
from planners.random_stream import stream
from planners.trees.reuse_tree import keep_path, keep_tree
from planners.trees.tree import NONE
from planners.trees.tree_search import Grove, answer, grow_until, new_grove, roomy
from planners.trees.variants import InformedRrtStar

Array = NDArray[np.float64]


def remainder(problem: Problem, path: Array) -> Array:
    """What is left of a path (n, 2) for a chair at the problem's start: points (k, 2) [m].

    From the start straight to the end of the path's edge that is nearest to it, and on along the
    path; where that end is hidden, to the edge's beginning. Whether the rest is free is not asked.
    """
    start = np.asarray(problem.start, dtype=np.float64)[:2]
    begins, legs = path[:-1], np.diff(path, axis=0)
    squares = np.maximum((legs**2).sum(axis=1), np.finfo(np.float64).tiny)
    along = np.clip(((start - begins) * legs).sum(axis=1) / squares, 0.0, 1.0)
    gaps = np.hypot(*(begins + along[:, None] * legs - start).T)
    k = int(np.flatnonzero(gaps == gaps.min())[-1]) + 1
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
    """Plan from the present pose in a changed space, reusing a plan made before.

    What is left of the old path and is still free is the first path, or hangs from the start and
    the goal; what the old tree still offers is hung from there; then sampling goes on. So the plan
    is never longer than the old remainder, where that still holds. The thesis plans wholly anew at
    each temporary obstacle (its section 3.2.2); a plan from nothing is what is made here where
    nothing holds, or where the goal has moved.

    Args:
        problem: the space as it is now, the pose now as the start, the goal.
        previous: a plan to the same goal, of any planner.
        rng: draws the numbers.
        deadline: seconds of wall time from the call, as for a planner.
        planner: the settings with which sampling goes on; null: its defaults.

    Returns:
        A plan; `counters["kept"]` are the nodes taken over from the old one.

    Raises:
        InputError: as a planner's.
    """
    planner = planner or InformedRrtStar()
    began, ends = begin(deadline)
    plan = trivial(problem)
    if plan is not None:
        return plan
    old = np.asarray(previous.path, dtype=np.float64)[:, :2]
    goal = np.asarray(problem.goal, dtype=np.float64)[:2]
    grove = new_grove(problem, planner.growth)
    kept = 0
    if len(old) >= 2 and (old[-1] == goal).all():
        rest = remainder(problem, old)
        grove = roomy(grove, 2 * (len(rest) + len(previous.tree)) + len(grove.ahead.nodes))
        free, free_back = keep_path(grove.space, grove.ahead, grove.back, rest, grove.room)
        _keep_trees(grove, previous.tree, rest, free, free_back)
        kept = int(grove.ahead.grid["count"][0] + grove.back.grid["count"][0]) - 2
    plan = answer(grow_until(grove, planner.iterations, ends, stream(rng)), began)
    return replace(plan, counters={**plan.counters, "kept": kept})


def _keep_trees(grove: Grove, tree: Array, rest: Array, free: int, free_back: int) -> None:
    """Hang the old tree's edges (k, 4) from the free beginning of a way and from its free end."""
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
    soil = grove.growth, points, first, others
    keep_tree(grove.space, grove.ahead, grove.goal, *soil, node_of, grove.room)
    if grove.room.run["goal"][0] != NONE:
        return
    goal = on_rest[-1]
    if node_of[goal] != NONE:  # by another way than the old path
        grove.room.run["goal"], grove.room.run["first"] = node_of[goal], 0
        return
    node_of = np.full(len(points), NONE)
    node_of[on_rest[::-1][: free_back + 1]] = np.arange(free_back + 1)
    keep_tree(grove.space, grove.back, grove.start, *soil, node_of, grove.room)
