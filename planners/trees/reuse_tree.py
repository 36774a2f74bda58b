"""Old trees in a new soil: what still holds of a plan, hung from where the chair is now."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from planners.collision.polygon_tests import SpaceArrays
from planners.trees.tree import NONE, Tree, insert
from planners.trees.values import Growth, Room, passes
from wheelchair_gym.compiled.kernel import borrowing_kernel

Array = NDArray[np.float64]


@borrowing_kernel
def keep_path(
    space: SpaceArrays, ahead: Tree, back: Tree, path: Array, room: Room
) -> tuple[int, int]:
    """Hang what is free of a way (n, 2) [m] to the goal from the start and from the goal.

    Where all of it is free the start's tree reaches the goal. Where it is blocked, its beginning
    hangs from the start, and its end from the goal, in the other tree.

    Returns:
        How many edges of its beginning are free, and how many of its end, as nodes of the trees.
    """
    run, n = room.run[0], path.shape[0]
    node, kept = insert(ahead, path[0, 0], path[0, 1], NONE, 0.0), 0
    insert(back, path[n - 1, 0], path[n - 1, 1], NONE, 0.0)
    while kept < n - 1:
        ax, ay, bx, by = path[kept, 0], path[kept, 1], path[kept + 1, 0], path[kept + 1, 1]
        if not passes(space, run, ax, ay, bx, by):
            break
        node = insert(ahead, bx, by, node, math.hypot(bx - ax, by - ay))
        kept += 1
    if kept == n - 1:
        run.goal, run.first = node, 0
        return kept, 0
    node, kept_back = 0, 0
    for k in range(n - 1, kept + 1, -1):
        ax, ay, bx, by = path[k, 0], path[k, 1], path[k - 1, 0], path[k - 1, 1]
        if not passes(space, run, ax, ay, bx, by):
            break
        node = insert(back, bx, by, node, math.hypot(bx - ax, by - ay))
        kept_back += 1
    return kept, kept_back


@borrowing_kernel
def keep_tree(
    space: SpaceArrays,
    tree: Tree,
    target: Array,
    growth: Growth,
    points: Array,
    first: NDArray[np.int64],
    others: NDArray[np.int64],
    node_of: NDArray[np.int64],
    room: Room,
) -> None:
    """Hang what an old tree still offers from those of its points that are in a new one.

    Args:
        space: what is free now.
        tree: the new tree.
        target: where it shall lead (2,) [m].
        growth: what kind of tree; no more nodes than it allows are kept.
        points: of the old tree (n, 2) [m].
        first: where each point's neighbours begin in `others` (n + 1,).
        others: neighbours, by point.
        node_of: nodes of the new tree by point (n,), NONE where there is none; written.
        room: the state of the run, and a stack.
    """
    nodes, run, stack = tree.nodes, room.run[0], room.stack
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
            if node_of[j] != NONE or tree.grid[0].count >= growth.limit:
                continue
            u, v = points[j, 0], points[j, 1]
            edge = math.hypot(u - x, v - y)
            # Costs along a branch plus the way left only rise: what is no use has no use behind it.
            cost = nodes[node_of[i]].cost + edge
            if cost + math.hypot(target[0] - u, target[1] - v) >= best:
                continue
            if passes(space, run, x, y, u, v):
                node_of[j] = insert(tree, u, v, node_of[i], edge)
                stack[height] = j
                height += 1
