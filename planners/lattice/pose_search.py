"""A* from pose to pose over stretches that the outline sweeps freely.

States share a cell of position and heading but keep their own continuous pose (hybrid A*: Dolgov
et al. 2010). Some poses, the anchors, are reached exactly: the goal, and those in line with narrow
places.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from planners.collision.footprint import Pose, Surroundings, Sweeps, free_gap, stretch_gap
from planners.collision.nearby import segments_in_view
from planners.graphs.heap import Heap, pop, push
from planners.lattice.heuristic import Guide, Ints, cost_to_go, heading_error
from planners.steering import CONNECTIONS, NO_PARTS, PIECE, Parts, connection, parts_time
from planners.trees.tree import write_ancestors
from wheelchair_gym.base.arrays import Array
from wheelchair_gym.compiled.kernel import borrowing_kernel, kernel
from wheelchair_gym.geometry.kinematics import arc_step
from wheelchair_gym.geometry.planar import wrap
from wheelchair_gym.maps.driving_cost import duration, kind_of, stretch_cost

AT_GOAL = -2  # the anchor of a node at the goal
FREE_HEADING_ERROR = 0.4  # rad: smaller errors cost nothing


class Lines(NamedTuple):
    """Poses to reach exactly; those of one line are one straight move apart."""

    poses: Array  # (n, 3); a goal without heading is the last one, of heading NaN
    ahead: Ints  # (n,) the anchor one straight move ahead, or -1
    behind: Ints  # (n,)
    reach: Array  # (n,) m: distance up to which a connection is tried
    turn: Array  # (n,) rad: difference of the headings up to which it is tried
    goals: int  # number of poses at the goal, the first ones


class Grid(NamedTuple):
    """The discretization of states into cells and headings, and the moves."""

    origin: Array  # (2,) m
    cell_size: float  # m
    columns: int
    headings: int
    moves: Sweeps
    hull: Array  # (4,) m: what bounds all
    heuristic_weight: float  # factor of the heuristic (weighted A*)
    stop_ratio: float  # stop when no path can cost less than this share of the best one
    heading_weight: float  # s/rad of the heading error, in the heuristic


NODE = np.dtype(
    [
        ("x", np.float64),  # m
        ("y", np.float64),
        ("yaw", np.float64),  # rad
        ("way", np.float64),  # m of the stretch from the parent
        ("turn", np.float64),  # rad
        ("cost", np.float64),  # s
        ("parent", np.int64),  # -1: none
        ("anchor", np.int64),  # the anchor it is at, -1: none
    ]
)
COUNTS = np.dtype([(name, np.int64) for name in ("nodes", "expanded", "goal")])


class Tree(NamedTuple):
    """Nodes: poses reached, with their stretch and cost; and the open list."""

    nodes: NDArray[Any]  # (n,) NODE
    heap: Heap  # the open list
    best: NDArray[np.float32]  # (slots,) s: least cost of each state, 0: none
    left_anchor: Array  # (anchors,) s left from each, -1: not computed yet
    best_anchor: Array  # (anchors + 1,) s; the last one is that of the goal
    counts: NDArray[Any]  # (1,) COUNTS: nodes, expanded ones; the node at the goal


class Search(NamedTuple):
    """All state of a search."""

    around: Surroundings
    guide: Guide
    lines: Lines
    grid: Grid
    tree: Tree


@borrowing_kernel
def connect(
    around: Surroundings, pose: Pose, kind: int, target: Pose, budget: float
) -> tuple[float, Parts]:
    """Return the cost [s] of the cheapest connection to a target pose, and its stretches.

    A NaN heading is free. The cost is infinite where none is free and below the budget.
    """
    motion = around.motion
    best, found, best_parts = budget, False, NO_PARTS
    for option in range(CONNECTIONS):
        possible, parts = connection(option, pose, target)
        cost = parts_time(motion, math.inf, parts, kind, 0, 1.0)
        if not possible or cost >= best:
            continue
        at = pose
        for way, turn in parts:
            if kind_of(way, turn) == 0:
                continue
            gap = free_gap(around, at, way, turn)
            if gap < motion.margin:
                cost = math.inf
                break
            cost += stretch_cost(motion, way, turn, gap) - duration(motion, way, turn)
            if cost >= best:
                break
            at = arc_step(at[0], at[1], at[2], way, turn, 1.0)
        if cost < best:
            best, found, best_parts = cost, True, parts
    return best if found else math.inf, best_parts


@borrowing_kernel
def _add(tree: Tree, parent: int, way: float, turn: float, cost: float, anchor: int) -> int:
    """Make a node at the end of a stretch, and return its index."""
    new, start, node = tree.counts[0].nodes, tree.nodes[parent], tree.nodes[tree.counts[0].nodes]
    x, y, yaw = arc_step(start.x, start.y, start.yaw, way, turn, 1.0)
    node.x, node.y, node.yaw = x, y, yaw
    node.way, node.turn, node.cost = way, turn, cost
    node.parent, node.anchor = parent, anchor
    tree.counts[0].nodes = new + 1
    return int(new)


@borrowing_kernel
def estimate(search: Search, x: float, y: float, yaw: float) -> float:
    """Return the estimated cost to the goal [s]: infinite where no inscribed disc passes."""
    left = cost_to_go(search.guide, x, y)
    if not left < math.inf:
        return left
    error = max(0.0, heading_error(search.guide, x, y, yaw) - FREE_HEADING_ERROR)
    return search.grid.heuristic_weight * (left + search.grid.heading_weight * error)


@borrowing_kernel
def _connect_anchors(search: Search, number: int) -> None:
    """Connect a node to every anchor in range that it reaches at least cost."""
    motion, lines, tree = search.around.motion, search.lines, search.tree
    node = tree.nodes[number]
    x, y, yaw, cost_here = node.x, node.y, node.yaw, node.cost
    kind = kind_of(node.way, node.turn)
    many, here = lines.poses.shape[0], estimate(search, x, y, yaw)
    for a in range(many):
        tx, ty, tyaw = lines.poses[a, 0], lines.poses[a, 1], lines.poses[a, 2]
        free_heading = math.isnan(tyaw)
        dx, dy = tx - x, ty - y
        reach = lines.reach[a]
        if abs(dx) > reach or abs(dy) > reach or a == node.anchor:
            continue
        far = math.hypot(dx, dy)
        turn = 0.0 if free_heading else abs(wrap(tyaw - yaw))
        if far > reach or turn > lines.turn[a]:
            continue
        minimum = max(far / motion.forward, turn / motion.turn)
        at_goal = free_heading or a < lines.goals
        entry = many if at_goal else a
        budget = tree.best_anchor[entry] - cost_here
        if minimum >= budget:
            continue
        left = 0.0
        if not at_goal:
            if tree.left_anchor[a] < 0.0:
                tree.left_anchor[a] = estimate(search, tx, ty, tyaw)
            left = tree.left_anchor[a]
            if not left < here:
                continue
        more, parts = connect(search.around, (x, y, yaw), kind, (tx, ty, tyaw), budget)
        if not more < budget:
            continue
        cost = cost_here + more
        tree.best_anchor[entry] = cost
        last = number
        for way, turned in parts:
            if kind_of(way, turned) != 0:
                last = _add(tree, last, way, turned, cost, -1)
        if last == number:  # it stands there
            last = _add(tree, number, 0.0, 0.0, cost, -1)
        end = tree.nodes[last]
        end.anchor = AT_GOAL if at_goal else a
        # To the bit: what follows along the line is where its anchors are.
        end.x, end.y = tx, ty
        if not free_heading:
            end.yaw = tyaw
        if at_goal:
            tree.counts[0].goal = last
            push(tree.heap, cost * search.grid.stop_ratio, last)
        else:
            push(tree.heap, cost + left, last)


@borrowing_kernel
def _outdated(search: Search, number: int) -> bool:
    """Return whether a cheaper node has been found for a node's state since it was opened."""
    tree, node = search.tree, search.tree.nodes[number]
    if node.anchor >= 0:
        return bool(node.cost > tree.best_anchor[node.anchor])
    slot = _slot(search.grid, node.x, node.y, node.yaw)
    return bool(slot < tree.best.shape[0] and node.cost > tree.best[slot] * (1.0 + 1e-6))


@borrowing_kernel
def _expand_moves(search: Search, number: int) -> None:
    """Open the ends of all moves from a node that are free and cheaper than earlier nodes there."""
    lines, grid, tree, seen = search.lines, search.grid, search.tree, search.around.seen
    near, motion = search.around.near, search.around.motion
    node = tree.nodes[number]
    x, y, yaw, anchor = node.x, node.y, node.yaw, node.anchor
    kind = kind_of(node.way, node.turn)
    bend = node.turn / node.way if abs(kind) == 1 else 0.0
    desired, margin = motion.desired_clearance, motion.margin
    count = segments_in_view(near, x, y, yaw, grid.hull, desired, seen)
    for m in range(grid.moves.way.shape[0]):
        way, turn = grid.moves.way[m], grid.moves.turn[m]
        now = kind_of(way, turn)
        cost = node.cost + duration(motion, way, turn)
        if kind != 0 and kind != now:
            cost += motion.switch_time
        if kind == now and now != 2:
            cost += motion.curvature_weight * abs(bend - turn / way)
        ax, ay, ayaw = arc_step(x, y, yaw, way, turn, 1.0)
        onto = -1
        if anchor >= 0 and turn == 0.0:
            onto = lines.ahead[anchor] if way > 0.0 else lines.behind[anchor]
        entry = lines.poses.shape[0] if 0 <= onto < lines.goals else onto
        if not (near.box[0] <= ax <= near.box[2] and near.box[1] <= ay <= near.box[3]):
            continue
        slot = _slot(grid, ax, ay, ayaw)
        if not _is_cheaper(tree, entry, slot, cost):
            continue
        left = estimate(search, ax, ay, ayaw)
        if not left < math.inf:
            continue
        gap = stretch_gap(grid.moves, m, motion.outline, seen, count, desired, margin)
        if gap < margin:
            continue
        cost += stretch_cost(motion, way, turn, gap) - duration(motion, way, turn)
        if not _is_cheaper(tree, entry, slot, cost):
            continue
        if onto >= 0:
            tree.best_anchor[entry] = cost
        else:
            tree.best[slot] = cost
        new = _add(tree, number, way, turn, cost, onto)
        if onto >= 0:
            end = tree.nodes[new]
            end.x, end.y, end.yaw = lines.poses[onto, 0], lines.poses[onto, 1], lines.poses[onto, 2]
            if onto < lines.goals:
                end.anchor = AT_GOAL
                tree.counts[0].goal = new
                left = (grid.stop_ratio - 1.0) * cost
        push(tree.heap, cost + left, new)


@borrowing_kernel
def _is_cheaper(tree: Tree, entry: int, slot: int, cost: float) -> bool:
    """Return whether a cost is below the minimum of an anchor, or where that is -1 of a state."""
    if entry >= 0:
        return bool(cost < tree.best_anchor[entry])
    return bool(not tree.best[slot] > 0.0 or cost < tree.best[slot])


@borrowing_kernel
def expand(search: Search, limit: int) -> bool:
    """Expand nodes; return True if the goal is taken from the open list or the list is empty.

    Return False when `limit` nodes are expanded in all, or when the tree may be too small for more.
    """
    tree, counts = search.tree, search.tree.counts[0]
    largest = search.grid.moves.way.shape[0] + 3 * search.lines.poses.shape[0]
    capacity = tree.nodes.shape[0] - largest
    while tree.heap.size[0] > 0:
        if counts.expanded >= limit or counts.nodes > capacity:
            return False
        number = pop(tree.heap)
        if tree.nodes[number].anchor == AT_GOAL:
            if number == counts.goal:
                return True
            continue
        if _outdated(search, number):
            continue
        counts.expanded += 1
        _connect_anchors(search, number)
        _expand_moves(search, number)
    return True


@kernel
def reopen(search: Search) -> None:
    """Order the open list anew, for another weight of the heuristic (ARA*: Likhachev 2003)."""
    tree, counts = search.tree, search.tree.counts[0]
    waiting, tree.heap.size[0] = tree.heap.size[0], 0
    tree.left_anchor[:] = -1.0
    for k in range(waiting):  # the list never grows beyond what has been read of it
        number = tree.heap.items[k]
        node = tree.nodes[number]
        if node.anchor != AT_GOAL and not _outdated(search, number):
            push(tree.heap, node.cost + estimate(search, node.x, node.y, node.yaw), number)
    if counts.goal >= 0:
        push(tree.heap, tree.nodes[counts.goal].cost * search.grid.stop_ratio, counts.goal)


@borrowing_kernel
def _slot(grid: Grid, x: float, y: float, yaw: float) -> int:
    i, j = int((y - grid.origin[1]) / grid.cell_size), int((x - grid.origin[0]) / grid.cell_size)
    sector = math.floor(yaw / (2.0 * math.pi) * grid.headings + 0.5) % grid.headings
    return (i * grid.columns + j) * grid.headings + int(sector)


@kernel
def trace_path(tree: Tree, number: int) -> NDArray[Any]:
    """Return the pieces (n,) PIECE from the root to a node, then one of no length there."""
    chain = np.empty(tree.counts[0].nodes, np.int64)
    count = write_ancestors(tree.nodes, number, chain)
    pieces = np.zeros(count, PIECE)
    for k in range(count):
        node, piece = tree.nodes[chain[count - 1 - k]], pieces[k]
        piece.x, piece.y, piece.yaw = node.x, node.y, node.yaw
        if k > 0:
            pieces[k - 1].way, pieces[k - 1].turn = node.way, node.turn
    return pieces
