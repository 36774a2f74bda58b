"""A* from pose to pose over stretches that the outline sweeps freely, and what a stretch costs.

States share a cell of position and heading but keep their own continuous pose (hybrid A*: Dolgov
et al. 2010). Some poses, the anchors, are reached exactly: the goal, and those in line with narrow
places. To a given pose lead pivot, straight and pivot, or two arcs that meet in one direction
(Bolton 1975, Biarc curves).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from planners.collision.footprint import Sweeps, stretch_gap, sweep
from planners.collision.nearby import Nearby, segments_in_view
from planners.graphs.heap import pop, push
from planners.lattice.heuristic import Guide, cost_to_go, heading_error
from wheelchair_gym.compiled.kernel import borrowing_kernel, kernel
from wheelchair_gym.geometry import wrap
from wheelchair_gym.kinematics import arc_step

Array = NDArray[np.float64]

PIECE = 0.3  # m: longer stretches are looked at in pieces, each from its own beginning
STILL = 1e-9  # m, rad: less is no motion


class MotionCost(NamedTuple):
    """How the chair drives, and what its motion costs."""

    outline: Array  # (3,) m: front, rear, half width
    margin: float  # m: least gap
    desired_clearance: float  # m: a larger gap costs no less
    obstacle_weight: float  # extra cost factor of a move at no gap
    forward: float  # m/s
    backward: float  # m/s, speed that reverse motion is rated with
    turn: float  # rad/s
    pivot_speed: float  # rad/s of a pivot
    lateral_acceleration: float  # m/s2
    switch_time: float  # s: to stop and start in another direction
    curvature_weight: float  # s per 1/m of a change of curvature


@borrowing_kernel
def duration(motion: MotionCost, way: float, turn: float) -> float:
    """Time [s] that a stretch takes at the speed it allows."""
    if abs(way) < STILL:
        return abs(turn) / motion.pivot_speed
    bend = abs(turn / way)
    speed = motion.forward if way > 0.0 else motion.backward
    if bend > 0.0:
        speed = min(speed, min(motion.turn / bend, math.sqrt(motion.lateral_acceleration / bend)))
    return abs(way) / speed


@borrowing_kernel
def kind_of(way: float, turn: float) -> int:
    """1: ahead, -1: back, 2: a pivot, 0: none."""
    if abs(way) < STILL:
        return 2 if abs(turn) > STILL else 0
    return 1 if way > 0.0 else -1


@borrowing_kernel
def stretch_cost(motion: MotionCost, way: float, turn: float, gap: float) -> float:
    """Cost [s] of a stretch: its duration, increased near obstacles."""
    short = (motion.desired_clearance - gap) / motion.desired_clearance
    return duration(motion, way, turn) * (1.0 + motion.obstacle_weight * short * short)


@borrowing_kernel
def free_gap(
    near: Nearby, motion: MotionCost, x: float, y: float, yaw: float, way: float, turn: float,
    workspace: Sweeps, seen: Array,
) -> float:  # fmt: skip
    """Least gap [m] of a stretch, at most the desired clearance; exact only above the margin."""
    pieces = max(1, math.ceil(abs(way) / PIECE))
    gap = motion.desired_clearance
    part, bend = way / pieces, turn / pieces
    sweep(workspace, 0, part, bend, motion.outline)
    for k in range(pieces):
        ax, ay, ayaw = arc_step(x, y, yaw, way, turn, k / pieces)
        if not (near.box[0] <= ax <= near.box[2] and near.box[1] <= ay <= near.box[3]):
            return 0.0
        count = segments_in_view(near, ax, ay, ayaw, workspace.box[0], gap, seen)
        gap = stretch_gap(workspace, 0, motion.outline, seen, count, gap, motion.margin)
        if gap < motion.margin:
            break
    return gap


@borrowing_kernel
def connect(
    near: Nearby, motion: MotionCost, x: float, y: float, yaw: float, kind: int,
    tx: float, ty: float, tyaw: float, budget: float, workspace: Sweeps, seen: Array, out: Array,
) -> float:  # fmt: skip
    """The cheapest of four connections to a target pose, whose heading is free if it is NaN.

    Writes distances and turns (3, 2) to `out`.

    Returns:
        The cost [s], infinite where no connection is free and below the budget.
    """
    dx, dy = tx - x, ty - y
    far, towards = math.hypot(dx, dy), wrap(math.atan2(dy, dx) - yaw)
    best = budget
    found = False
    for option in range(4):
        back = option % 2 == 1
        sign = -1.0 if back else 1.0
        a, b = 0.0, 0.0  # ways
        s, t, u = 0.0, 0.0, 0.0  # turns
        aim = wrap(towards + math.pi) if back else towards
        if option < 2:
            if far <= STILL:
                continue
            if math.isnan(tyaw):  # one arc
                if abs(aim) > 0.5 * math.pi:
                    continue
                half = aim
                a = sign * far * (half / math.sin(half) if abs(half) > STILL else 1.0)
                s = 2.0 * half
            else:  # two arcs
                c0, s0 = math.cos(yaw), math.sin(yaw)
                c1, s1 = math.cos(tyaw), math.sin(tyaw)
                vt = dx * (c0 + c1) + dy * (s0 + s1)
                less = 2.0 - 2.0 * (c0 * c1 + s0 * s1)  # 4 - |t0 + t1|^2
                square = dx * dx + dy * dy
                if less > 1e-9:
                    root = math.sqrt(vt * vt + less * square)
                    d = (-vt + sign * root) / less
                elif sign * vt > 1e-9:
                    d = 0.5 * square / vt
                else:
                    continue
                if sign * d < STILL:
                    continue
                mx, my = 0.5 * (dx + d * (c0 - c1)), 0.5 * (dy + d * (s0 - s1))
                first = math.hypot(mx, my)
                half = wrap(math.atan2(my, mx) - yaw + (math.pi if back else 0.0))
                middle = yaw + 2.0 * half
                last = math.hypot(dx - mx, dy - my)
                other = wrap(math.atan2(dy - my, dx - mx) - middle + (math.pi if back else 0.0))
                if abs(half) > 0.5 * math.pi or abs(other) > 0.5 * math.pi:
                    continue
                a = sign * first * (half / math.sin(half) if abs(half) > STILL else 1.0)
                b = sign * last * (other / math.sin(other) if abs(other) > STILL else 1.0)
                s, t = 2.0 * half, 2.0 * other
        else:  # pivot, straight, pivot
            if far > STILL:
                s, b = aim, sign * far
            u = 0.0 if math.isnan(tyaw) else wrap(tyaw - yaw - s)
        cost = 0.0
        before = kind
        for part in range(3):
            way, turn = (a, b, 0.0)[part], (s, t, u)[part]
            now = kind_of(way, turn)
            if now != 0:
                cost += duration(motion, way, turn)
                if before != 0 and before != now:
                    cost += motion.switch_time
                before = now
        if cost >= best:
            continue
        px, py, pyaw = x, y, yaw
        for part in range(3):
            way, turn = (a, b, 0.0)[part], (s, t, u)[part]
            if kind_of(way, turn) == 0:
                continue
            gap = free_gap(near, motion, px, py, pyaw, way, turn, workspace, seen)
            if gap < motion.margin:
                cost = math.inf
                break
            cost += stretch_cost(motion, way, turn, gap) - duration(motion, way, turn)
            if cost >= best:
                break
            px, py, pyaw = arc_step(px, py, pyaw, way, turn, 1.0)
        if cost < best:
            best, found = cost, True
            out[0, 0], out[1, 0], out[2, 0] = a, b, 0.0
            out[0, 1], out[1, 1], out[2, 1] = s, t, u
    return best if found else math.inf


Whole = NDArray[np.int64]

AT_GOAL = -2  # the anchor of a node at the goal
FREE_HEADING_ERROR = 0.4  # rad: smaller errors cost nothing
COUNT, SIZE, EXPANDED, GOAL = range(4)  # of `Tree.state`


class Lines(NamedTuple):
    """Poses to reach exactly; those of one line are one straight move apart."""

    poses: Array  # (n, 3)
    ahead: Whole  # (n,) the anchor one straight move ahead, or -1
    behind: Whole  # (n,)
    reach: Array  # (n,) m: from how far it is tried
    turn: Array  # (n,) rad: by how much the heading may differ for that
    goals: int  # so many, the first ones, are at the goal
    headed: bool  # whether the goal has a heading; else any will do


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


class Tree(NamedTuple):
    """Nodes: poses reached, how, and at what cost; and the open list."""

    pose: Array  # (n, 3)
    cost: Array  # (n,) s
    parent: Whole  # (n,)
    way: Array  # (n,) m of the stretch from the parent
    turn: Array  # (n,) rad
    anchor: Whole  # (n,) the anchor it is at, -1: none
    keys: Array  # (n,) of the heap
    items: Whole  # (n,)
    best: NDArray[np.float32]  # (slots,) s: least cost of each state, 0: none
    left_anchor: Array  # (anchors,) s left from each, -1: not known yet
    best_anchor: Array  # (anchors + 1,) s; the last one is that of the goal
    state: Whole  # (4,): how many nodes, how many open, how many expanded, the node at the goal


@borrowing_kernel
def _add(tree: Tree, node: int, way: float, turn: float, cost: float, anchor: int) -> int:
    """Make a node at the end of a stretch."""
    new = tree.state[COUNT]
    x, y, yaw = arc_step(tree.pose[node, 0], tree.pose[node, 1], tree.pose[node, 2], way, turn, 1.0)
    tree.pose[new, 0], tree.pose[new, 1], tree.pose[new, 2] = x, y, yaw
    tree.way[new], tree.turn[new], tree.cost[new] = way, turn, cost
    tree.parent[new], tree.anchor[new] = node, anchor
    tree.state[COUNT] = new + 1
    return int(new)


@borrowing_kernel
def _open(tree: Tree, node: int, key: float) -> None:
    push(tree.keys, tree.items, tree.state[SIZE], key, node)
    tree.state[SIZE] += 1


@borrowing_kernel
def _estimate(guide: Guide, grid: Grid, x: float, y: float, yaw: float) -> float:
    """Estimated cost to the goal [s]: the heuristic."""
    left = cost_to_go(guide, x, y)
    if not left < math.inf:
        return left
    error = max(0.0, heading_error(guide, x, y, yaw) - FREE_HEADING_ERROR)
    return grid.heuristic_weight * (left + grid.heading_weight * error)


@borrowing_kernel
def _connect_anchors(
    near: Nearby, motion: MotionCost, guide: Guide, lines: Lines, grid: Grid, goal: Array,
    tree: Tree, node: int, workspace: Sweeps, seen: Array, out: Array,
) -> None:  # fmt: skip
    """Connect a node to every anchor in range that it reaches at least cost."""
    x, y, yaw = tree.pose[node, 0], tree.pose[node, 1], tree.pose[node, 2]
    kind = kind_of(tree.way[node], tree.turn[node])
    many, here = lines.poses.shape[0], _estimate(guide, grid, x, y, yaw)
    for a in range(many + 1):
        free_heading = a == many
        if free_heading:
            if lines.headed:
                continue
            tx, ty, tyaw = goal[0], goal[1], math.nan
            dx, dy = tx - x, ty - y
            far = math.hypot(dx, dy)
            if far > goal[2]:
                continue
            least = far / motion.forward
        else:
            tx, ty, tyaw = lines.poses[a, 0], lines.poses[a, 1], lines.poses[a, 2]
            dx, dy = tx - x, ty - y
            reach = lines.reach[a]
            if abs(dx) > reach or abs(dy) > reach or a == tree.anchor[node]:
                continue
            far = math.hypot(dx, dy)
            turn = abs(wrap(tyaw - yaw))
            if far > reach or turn > lines.turn[a]:
                continue
            least = max(far / motion.forward, turn / motion.turn)
        at_goal = free_heading or a < lines.goals
        entry = many if at_goal else a
        budget = tree.best_anchor[entry] - tree.cost[node]
        if least >= budget:
            continue
        left = 0.0
        if not at_goal:
            if tree.left_anchor[a] < 0.0:
                tree.left_anchor[a] = _estimate(guide, grid, tx, ty, tyaw)
            left = tree.left_anchor[a]
            if not left < here:
                continue
        more = connect(near, motion, x, y, yaw, kind, tx, ty, tyaw, budget, workspace, seen, out)
        if not more < budget:
            continue
        cost = tree.cost[node] + more
        tree.best_anchor[entry] = cost
        last = node
        for part in range(3):
            if kind_of(out[part, 0], out[part, 1]) != 0:
                last = _add(tree, last, out[part, 0], out[part, 1], cost, -1)
        if last == node:  # it stands there
            last = _add(tree, node, 0.0, 0.0, cost, -1)
        tree.anchor[last] = AT_GOAL if at_goal else a
        # To the bit: what follows along the line is where its anchors are.
        tree.pose[last, 0], tree.pose[last, 1] = tx, ty
        if not free_heading:
            tree.pose[last, 2] = tyaw
        if at_goal:
            tree.state[GOAL] = last
            _open(tree, last, cost * grid.stop_ratio)
        else:
            _open(tree, last, cost + left)


@borrowing_kernel
def expand(
    near: Nearby, motion: MotionCost, guide: Guide, lines: Lines, grid: Grid, goal: Array,
    tree: Tree, most: int, workspace: Sweeps, seen: Array, out: Array,
) -> bool:  # fmt: skip
    """Expand nodes until the goal is taken from the open list or the list is empty: True.

    False when `most` nodes are expanded in all, or when the tree may be too small for another.
    """
    slots = tree.best.shape[0]
    capacity = tree.cost.shape[0] - grid.moves.way.shape[0] - 3 * (lines.poses.shape[0] + 1)
    while tree.state[SIZE] > 0:
        if tree.state[EXPANDED] >= most or tree.state[COUNT] > capacity:
            return False
        node = pop(tree.keys, tree.items, tree.state[SIZE])
        tree.state[SIZE] -= 1
        anchor = tree.anchor[node]
        if anchor == AT_GOAL:
            if node == tree.state[GOAL]:
                return True
            continue
        x, y, yaw = tree.pose[node, 0], tree.pose[node, 1], tree.pose[node, 2]
        if anchor >= 0:
            if tree.cost[node] > tree.best_anchor[anchor]:
                continue
        else:
            slot = _slot(grid, x, y, yaw)
            if slot < slots and tree.cost[node] > tree.best[slot] * (1.0 + 1e-6):
                continue
        tree.state[EXPANDED] += 1
        _connect_anchors(near, motion, guide, lines, grid, goal, tree, node, workspace, seen, out)
        kind = kind_of(tree.way[node], tree.turn[node])
        bend = tree.turn[node] / tree.way[node] if abs(kind) == 1 else 0.0
        count = segments_in_view(near, x, y, yaw, grid.hull, motion.desired_clearance, seen)
        for m in range(grid.moves.way.shape[0]):
            way, turn = grid.moves.way[m], grid.moves.turn[m]
            now = kind_of(way, turn)
            cost = tree.cost[node] + duration(motion, way, turn)
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
            if onto >= 0:
                if cost >= tree.best_anchor[entry]:
                    continue
            elif tree.best[slot] > 0.0 and cost >= tree.best[slot]:
                continue
            left = _estimate(guide, grid, ax, ay, ayaw)
            if not left < math.inf:
                continue
            gap = stretch_gap(
                grid.moves,
                m,
                motion.outline,
                seen,
                count,
                motion.desired_clearance,
                motion.margin,
            )
            if gap < motion.margin:
                continue
            cost += stretch_cost(motion, way, turn, gap) - duration(motion, way, turn)
            if onto >= 0:
                if cost >= tree.best_anchor[entry]:
                    continue
                tree.best_anchor[entry] = cost
            else:
                if tree.best[slot] > 0.0 and cost >= tree.best[slot]:
                    continue
                tree.best[slot] = cost
            new = _add(tree, node, way, turn, cost, onto)
            if onto >= 0:
                for axis in range(3):
                    tree.pose[new, axis] = lines.poses[onto, axis]
                if onto < lines.goals:
                    tree.anchor[new] = AT_GOAL
                    tree.state[GOAL] = new
                    left = (grid.stop_ratio - 1.0) * cost
            _open(tree, new, cost + left)
    return True


@borrowing_kernel
def _slot(grid: Grid, x: float, y: float, yaw: float) -> int:
    i, j = int((y - grid.origin[1]) / grid.cell_size), int((x - grid.origin[0]) / grid.cell_size)
    sector = math.floor(yaw / (2.0 * math.pi) * grid.headings + 0.5) % grid.headings
    return (i * grid.columns + j) * grid.headings + int(sector)


@kernel
def trace_path(tree: Tree, node: int, spacing: float) -> Array:
    """The poses (n, 3) from the root to a node, at most `spacing` [m, rad / 2] apart."""
    count, last = 1, node
    while tree.parent[last] >= 0:
        count += _part_count(tree.way[last], tree.turn[last], spacing)
        last = tree.parent[last]
    path = np.empty((count, 3))
    path[count - 1] = tree.pose[node]
    k = count - 1
    while tree.parent[node] >= 0:
        way, turn = tree.way[node], tree.turn[node]
        node = tree.parent[node]
        x, y, yaw = tree.pose[node, 0], tree.pose[node, 1], tree.pose[node, 2]
        parts = _part_count(way, turn, spacing)
        for part in range(parts - 1, -1, -1):
            k -= 1
            path[k, 0], path[k, 1], path[k, 2] = arc_step(x, y, yaw, way, turn, part / parts)
    for k in range(1, count):
        path[k, 2] = path[k - 1, 2] + wrap(path[k, 2] - path[k - 1, 2])
    return path


@borrowing_kernel
def _part_count(way: float, turn: float, spacing: float) -> int:
    return int(max(1, math.ceil(max(abs(way), 0.5 * abs(turn)) / spacing)))
