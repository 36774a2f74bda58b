"""Trees of poses of the footprint: RRT-Connect finds the first path, and RRT* makes it cheaper.

The best path is a list of pieces of arcs, part of which can be replaced by cheaper ones. Steering
turns in place, drives arcs and backs; what the footprint sweeps is tested exactly; cost is
time, increased near obstacles.
"""

import math
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from planners.collision.footprint import Pose, free_gap
from planners.steering import (
    CAPACITY,
    CONNECTIONS,
    PIECE,
    SteeringContext,
    connect,
    connection,
    drive_parts,
    first_pieces,
    quickest,
    switch,
    write_times,
)
from planners.trees.tree import NONE, append_child, remove_child, write_ancestors, write_descendants
from wheelchair_gym.base.arrays import Array
from wheelchair_gym.compiled.kernel import borrowing_kernel, inlined
from wheelchair_gym.compiled.random import Stream, next_uniform
from wheelchair_gym.geometry.kinematics import arc_step
from wheelchair_gym.geometry.planar import wrap
from wheelchair_gym.maps.driving_cost import MotionCost

MIN_GAIN = 1e-6  # s: smaller gains are rounding
TURN_LENGTH = 0.5  # m per rad: distance of poses
_BACK: Final = 1e6  # s: backward connections are tried last
_MAX_BACK: Final = 0.6  # m: longer backward connections are tried in every third attempt only
_RENEW_AFTER: Final = 1000  # iterations after which new trees are grown
ATTEMPTS: Final = 3  # trees that are grown after those of the first path
MIN_ADVANCE = 0.05  # m: a blocked extension that comes less near to its target makes no node
# Design choices:
NODES = 10_000  # largest number of nodes of a tree
NEIGHBOURS: Final = 10  # nearest nodes that may become parents, or be rewired
GUIDE_SHARE = 0.7  # of the samples, near the guide or near the path; the rest are anywhere
SPREAD = 0.3  # m: deviation of their distance from it
TURN_SPREAD = 0.6  # rad: deviation of their heading
REVERSED_SHARE = 0.05  # of the samples at the guide, which look back


class Path(NamedTuple):
    """The best path so far: its pieces, then a piece of no length and of kind 0 at its end."""

    pieces: NDArray[Any]  # (CAPACITY,) PIECE
    size: NDArray[np.int64]  # (1,): without the one at the end; 0: there is no path
    cost: Array  # (1,) s
    goal: Array  # (3,) x, y [m], yaw [rad], NaN if it is free


def new_path(goal: Array) -> Path:
    """Return an empty path to a goal (2,) or (3,)."""
    end = np.full(3, math.nan)
    end[: len(goal)] = goal
    return Path(np.zeros(CAPACITY, PIECE), np.zeros(1, np.int64), np.full(1, np.inf), end)


@borrowing_kernel
def kind_before(path: Path, i: int) -> int:
    """Return the kind of motion before piece i; 0 at the start."""
    return int(path.pieces[i - 1].kind) if i > 0 else 0


@borrowing_kernel
def pieces_cost(motion: MotionCost, pieces: NDArray[Any], i: int, j: int, before: int) -> float:
    """Return the cost [s] of the pieces from i to j, with the changes from a kind and between."""
    cost = 0.0
    for k in range(i, j):
        cost += pieces[k].cost + switch(motion, before, pieces[k].kind)
        before = int(pieces[k].kind)
    return cost


@borrowing_kernel
def window_cost(motion: MotionCost, path: Path, i: int, j: int) -> float:
    """Return the cost [s] of the pieces from i to j, with the changes of kind at both ends."""
    before, last = kind_before(path, i), kind_before(path, j)
    cost = pieces_cost(motion, path.pieces, i, j, before)
    return cost + switch(motion, last, path.pieces[j].kind)


@borrowing_kernel
def splice(path: Path, motion: MotionCost, i: int, j: int, new: NDArray[Any], count: int) -> bool:
    """Replace the pieces from i to j by `count` new ones; return false if there is no space."""
    pieces, n = path.pieces, path.size[0]
    more = count - (j - i)
    if n + more + 1 >= pieces.shape[0]:
        return False
    if more > 0:
        for k in range(n, j - 1, -1):
            pieces[k + more] = pieces[k]
    elif more < 0:
        for k in range(j, n + 1):
            pieces[k + more] = pieces[k]
    for k in range(count):
        pieces[i + k] = new[k]
    path.size[0] = n + more
    end = pieces[n + more]
    if math.isnan(path.goal[2]) and n + more > 0:
        last = pieces[n + more - 1]
        end.yaw = last.yaw + last.turn
    path.cost[0] = window_cost(motion, path, 0, n + more)
    return True


NODE = np.dtype(
    [
        ("x", np.float64),  # m
        ("y", np.float64),
        ("yaw", np.float64),  # rad
        ("cost", np.float64),  # s from the root
        ("edge", np.float64),  # s from the parent, without the change of kind there
        ("a", np.float64),  # m: the connection from the parent, or in the goal's tree the way
        ("s", np.float64),  # rad  from it; see `connection`
        ("b", np.float64),
        ("t", np.float64),
        ("u", np.float64),
        ("first", np.int64),  # kind of motion that the connection begins with
        ("last", np.int64),  # ... and ends with
        ("parent", np.int64),
        ("child", np.int64),  # the first of the children
        ("sibling", np.int64),  # the next child of the same parent
        ("at_goal", np.bool_),
    ]
)


class Tree(NamedTuple):
    """Poses, each with a connection from its parent."""

    nodes: NDArray[Any]  # (capacity,) NODE
    size: NDArray[np.int64]  # (1,)
    sign: float  # 1; -1 in the goal's tree, whose connections are driven towards the parent


@borrowing_kernel
def add_pose(tree: Tree, pose: Pose, parent: int) -> int:
    """Add a pose without its connection, and return its index."""
    new = int(tree.size[0])
    node = tree.nodes[new]
    node.x, node.y, node.yaw = pose
    node.cost, node.edge = 0.0, 0.0
    node.a, node.s, node.b, node.t, node.u = 0.0, 0.0, 0.0, 0.0, 0.0
    node.first, node.last, node.at_goal = 0, 0, False
    node.parent, node.child, node.sibling = NONE, NONE, NONE
    if parent != NONE:
        append_child(tree.nodes, new, parent)
    tree.size[0] = new + 1
    return new


@inlined
def pose_of(record: Any) -> Pose:
    """Return the pose of a node or a piece."""
    return record.x, record.y, record.yaw


@borrowing_kernel
def pose_distance(one: Pose, other: Pose) -> float:
    """Return the distance [m] of two poses, their turn included."""
    dx, dy, turn = one[0] - other[0], one[1] - other[1], TURN_LENGTH * wrap(one[2] - other[2])
    return math.sqrt(dx * dx + dy * dy + turn * turn)


@borrowing_kernel
def nearest(tree: Tree, pose: Pose) -> int:
    """Return the node nearest to a pose."""
    best, found = math.inf, NONE
    for i in range(tree.size[0]):
        distance = pose_distance(pose_of(tree.nodes[i]), pose)
        if distance < best:
            best, found = distance, i
    return found


@borrowing_kernel
def extend(
    context: SteeringContext, tree: Tree, i: int, target: Pose, max_back: float
) -> tuple[int, bool]:
    """Extend a tree towards a pose until blocked; return the new node and whether it is there.

    The quickest free connection is taken, a forward one if possible; if none is free, the one that
    comes nearest. No connection leads farther back than `max_back` [m].
    """
    if tree.size[0] >= tree.nodes.shape[0]:
        return NONE, False
    pose = pose_of(tree.nodes[i])
    write_times(context, pose, 0, target, 0, tree.sign)
    for kind in range(1 if tree.sign > 0.0 else 0, CONNECTIONS, 2):
        context.times[kind] += _BACK
    best, chosen, share = pose_distance(pose, target) - MIN_ADVANCE, NONE, 0
    while chosen == NONE or share >= 0:
        kind = quickest(context.times)
        if kind < 0:
            break
        context.times[kind] = math.inf
        _, parts = connection(kind, pose, target)
        if tree.sign * (parts[0][0] + parts[1][0]) < -max_back:
            continue
        total, _, free, reached = drive_parts(
            context.around, pose, 0, parts, context.trial, 0, math.inf
        )
        if free:
            chosen, share = kind, -1
        elif total > 0 and pose_distance(reached, target) < best:
            best, chosen, share = pose_distance(reached, target), kind, total
    if chosen == NONE:
        return NONE, False
    _, parts = connection(chosen, pose, target)
    if share >= 0:
        parts, target = first_pieces(parts, share), pose
        for way, turn in parts:
            target = arc_step(target[0], target[1], target[2], way, turn, 1.0)
    new = add_pose(tree, target, i)
    node = tree.nodes[new]
    (node.a, node.s), (node.b, node.t), (_, node.u) = parts
    return new, share < 0


RUN = np.dtype(
    [
        ("iteration", np.int64),
        ("first_path", np.int64),  # iteration of it, 0: there is none
        ("refining", np.int64),  # iteration since when the path is refined, 0: trees are grown
        ("attempt", np.int64),  # number of the trees
        ("attempt_began", np.int64),  # iteration
        ("last_attempt", np.int64),
        ("goals", np.int64),  # roots of the goal's tree
        ("local_evaluations", np.int64),
        ("synced", np.float64),  # s: cost of the path that was last added to the tree
    ]
)


class Search(NamedTuple):
    """All state of a search."""

    context: SteeringContext
    start_tree: Tree
    goal_tree: Tree
    path: Path
    guide: Array  # (n, 3) poses along the path of a point; none: (0, 3)
    run: NDArray[Any]  # (1,) RUN
    found: NDArray[np.int64]  # (neighbours,)
    bounds: Array  # (neighbours,) s
    chain: NDArray[np.int64]  # (capacity,)


def new_tree(roots: Array, sign: float) -> Tree:
    """Return a tree of roots (n, 3)."""
    tree = Tree(np.zeros(NODES, NODE), np.zeros(1, np.int64), sign)
    for x, y, yaw in roots:
        add_pose(tree, (x, y, yaw), NONE)
    return tree


def new_search(
    context: SteeringContext, start: Array, goal: Array, goals: Array, guide: Array
) -> Search:
    """Return a search that has not begun, from a start (3,) to a goal (2,) or (3,).

    The goal's tree has the roots `goals` (n, 3), the poses there.
    """
    run = np.zeros(1, RUN)
    run["synced"], run["goals"] = math.inf, len(goals)
    return Search(
        context, new_tree(start[None], 1.0), new_tree(goals, -1.0), new_path(goal), guide, run,
        np.zeros(NEIGHBOURS, np.int64), np.zeros(NEIGHBOURS), np.zeros(NODES + 1, np.int64),
    )  # fmt: skip


@borrowing_kernel
def next_normal(state: Stream) -> float:
    """Draw a nearly normal number of mean 0 and deviation 1 (Irwin-Hall, n = 4)."""
    total = next_uniform(state) + next_uniform(state) + next_uniform(state) + next_uniform(state)
    return (total - 2.0) * math.sqrt(3.0)


_TRIES: Final = 20  # poses drawn for a sample at most


@borrowing_kernel
def sample(search: Search, state: Stream) -> tuple[bool, Pose]:
    """Draw a pose at which the outline is free; the first value is false if none was drawn.

    It is near the guide, later near the path, or anywhere.
    """
    around, path, guide = search.context.around, search.path, search.guide
    x, y, yaw = 0.0, 0.0, 0.0
    for _ in range(_TRIES):
        near = next_uniform(state) < GUIDE_SHARE
        if near and path.size[0] > 0:
            x, y, yaw = pose_of(path.pieces[int(next_uniform(state) * path.size[0])])
            scale = math.exp(-3.0 * next_uniform(state))
        elif near and guide.shape[0] > 0:
            on = guide[int(next_uniform(state) * guide.shape[0])]
            scale = math.exp(-4.0 * next_uniform(state))
            x, y, yaw = on[0], on[1], on[2]
            if next_uniform(state) < REVERSED_SHARE:
                yaw += math.pi
        else:
            scale, box = 0.0, around.near.box
            x = box[0] + (box[2] - box[0]) * next_uniform(state)
            y = box[1] + (box[3] - box[1]) * next_uniform(state)
            yaw = 2.0 * math.pi * next_uniform(state)
        if scale > 0.0:
            x += scale * SPREAD * next_normal(state)
            y += scale * SPREAD * next_normal(state)
            yaw = wrap(yaw + scale * TURN_SPREAD * next_normal(state))
        if free_gap(around, (x, y, yaw), 0.0, 0.0) >= around.motion.margin:
            return True, (x, y, yaw)
    return False, (x, y, yaw)


@borrowing_kernel
def write_edge(search: Search, node: Any, backward: bool, pose: Pose, count: int) -> int:
    """Append a node's connection from a pose to `context.candidate`; return the count or -1."""
    parts = (node.a, node.s), (node.b, node.t), (0.0, node.u)
    if backward:
        parts = (0.0, -node.u), (-node.b, -node.t), (-node.a, -node.s)
    context = search.context
    made, _, free, _ = drive_parts(
        context.around, pose, 0, parts, context.candidate, count, math.inf
    )
    return count + made if free else -1


@borrowing_kernel
def write_path(search: Search, node: int, twin: int) -> bool:
    """Write the path to a node, and on from its twin in the goal's tree if there is one.

    Return false, and change nothing, if rounding finds it blocked or it costs more than the path.
    """
    tree, path, chain = search.start_tree, search.path, search.chain
    n, count = write_ancestors(tree.nodes, node, chain), 0
    for k in range(n - 2, -1, -1):
        at = pose_of(tree.nodes[chain[k + 1]])
        count = write_edge(search, tree.nodes[chain[k]], False, at, count)
        if count < 0:
            return False
    end = tree.nodes[node]
    i = twin
    while i != NONE:
        at = search.goal_tree.nodes[i]
        end = at
        if at.parent != NONE:
            count = write_edge(search, at, True, pose_of(at), count)
            if count < 0:
                return False
        i = int(at.parent)
    pieces, motion = search.context.candidate, search.context.around.motion
    cost = pieces_cost(motion, pieces, 0, count, 0)
    if not cost < path.cost[0] - MIN_GAIN or count == 0:
        return False
    if path.size[0] == 0:
        last = path.pieces[0]
        last.x, last.y, last.yaw = path.goal[0], path.goal[1], end.yaw
        last.way, last.turn, last.cost, last.kind = 0.0, 0.0, 0.0, 0
    return splice(path, motion, 0, int(path.size[0]), pieces, count)


@borrowing_kernel
def grow(search: Search, state: Stream) -> None:
    """Extend one tree towards a sample, and the other to the new node: RRT-Connect.

    Trees that do not meet soon are grown anew. Of the paths of some trees, the cheapest is refined.
    """
    context, run = search.context, search.run[0]
    if run.iteration - run.attempt_began >= _RENEW_AFTER:
        run.attempt, run.attempt_began = run.attempt + 1, run.iteration
        search.start_tree.size[0], search.goal_tree.size[0] = 1, run.goals  # the roots alone
        search.start_tree.nodes[0].child = NONE
        for i in range(run.goals):
            search.goal_tree.nodes[i].child = NONE
        if run.first_path > 0 and run.attempt > run.last_attempt:
            run.refining = run.iteration
            return
    forward = run.iteration % 2 == 0
    one, other = search.start_tree, search.goal_tree
    if not forward:
        one, other = other, one
    drawn, pose = True, pose_of(other.nodes[0])
    if run.iteration > 0:
        drawn, pose = sample(search, state)
    if not drawn:
        return
    max_back = math.inf if run.attempt % 3 == 2 else _MAX_BACK
    new, _ = extend(context, one, nearest(one, pose), pose, max_back)
    if new == NONE:
        return
    pose = pose_of(one.nodes[new])
    twin = nearest(other, pose)
    while True:
        reached, there = extend(context, other, twin, pose, max_back)
        if there:
            if not forward:
                new, reached = reached, new
            write_path(search, new, reached)
            if run.first_path == 0 and search.path.size[0] > 0:
                run.first_path, run.last_attempt = run.iteration + 1, run.attempt + ATTEMPTS
            run.attempt_began = run.iteration - _RENEW_AFTER  # so that new trees are grown
            return
        if reached == NONE:
            return
        twin = reached


@borrowing_kernel
def update_costs(search: Search, i: int) -> None:
    """Compute the costs of a node and of all below it from its parent's."""
    nodes, motion, below = search.start_tree.nodes, search.context.around.motion, search.chain
    for k in range(write_descendants(nodes, i, below)):
        node = nodes[below[k]]
        above = nodes[node.parent]
        node.cost = above.cost + node.edge + switch(motion, above.last, node.first)


@borrowing_kernel
def write_connection(search: Search, i: int, kind: int, count: int, cost: float) -> None:
    """Write a node's connection from its parent, whose pieces are in `context.candidate`."""
    tree, pieces, motion = search.start_tree, search.context.candidate, search.context.around.motion
    node = tree.nodes[i]
    above = tree.nodes[node.parent]
    _, parts = connection(kind, pose_of(above), pose_of(node))
    (node.a, node.s), (node.b, node.t), (_, node.u) = parts
    node.first = pieces[0].kind if count > 0 else above.last
    node.last = pieces[count - 1].kind if count > 0 else above.last
    node.edge = cost - switch(motion, above.last, node.first)


@borrowing_kernel
def add_path(search: Search) -> None:
    """Add the path to the tree, a node where its curvature changes, so that it can be rewired."""
    tree, path, run = search.start_tree, search.path, search.run[0]
    run.synced = path.cost[0]
    pieces, motion = path.pieces, search.context.around.motion
    at, k, n = 0, 0, int(path.size[0])
    while k < n and tree.size[0] < tree.nodes.shape[0]:
        way, turn, edge, kind = 0.0, 0.0, 0.0, int(pieces[k].kind)
        bend = pieces[k].turn / pieces[k].way if kind != 2 else 0.0
        while (
            k < n and pieces[k].kind == kind and abs(way) < 1.0
            and (kind == 2 or abs(pieces[k].turn - bend * pieces[k].way) < 1e-9)
        ):  # fmt: skip
            way, turn, edge = way + pieces[k].way, turn + pieces[k].turn, edge + pieces[k].cost
            k += 1
        new = add_pose(tree, pose_of(pieces[k]), at)
        node, above = tree.nodes[new], tree.nodes[at]
        node.a, node.s, node.edge, node.first, node.last = way, turn, edge, kind, kind
        node.cost = above.cost + edge + switch(motion, above.last, kind)
        at = new
    if k == n:
        tree.nodes[at].at_goal = True


@borrowing_kernel
def find_neighbours(search: Search, pose: Pose) -> int:
    """Write the nearest nodes to `found`, and bounds of a pose's cost through them; Near."""
    nodes, found, bounds, n = search.start_tree.nodes, search.found, search.bounds, 0
    for i in range(search.start_tree.size[0]):  # the farthest of them last
        distance = pose_distance(pose_of(nodes[i]), pose)
        if n == found.shape[0] and distance >= bounds[n - 1]:
            continue
        k = n if n < found.shape[0] else n - 1
        n = max(n, k + 1)
        while k > 0 and bounds[k - 1] > distance:
            found[k], bounds[k] = found[k - 1], bounds[k - 1]
            k -= 1
        found[k], bounds[k] = i, distance
    for k in range(n):
        near = nodes[found[k]]
        bounds[k] = near.cost + write_times(search.context, pose_of(near), near.last, pose, 0, 1.0)
    return n


@borrowing_kernel
def choose_parent(search: Search, new: int, n: int, budget: float) -> bool:
    """Connect a node to its cheapest parent among n neighbours; false if none costs below `budget`.

    Neighbours are tried in order of their bounds.
    """
    nodes, found, bounds = search.start_tree.nodes, search.found, search.bounds
    here, best = nodes[new], budget
    while True:
        k = 0
        for m in range(1, n):
            if bounds[m] < bounds[k]:
                k = m
        if bounds[k] >= best:
            break
        bounds[k] = math.inf
        near = nodes[found[k]]
        kind, count, cost = connect(
            search.context, pose_of(near), near.last, pose_of(here), 0, best - near.cost
        )
        if kind >= 0:
            best, here.parent = near.cost + cost, found[k]
            write_connection(search, new, kind, count, cost)
    if here.parent == NONE:
        return False
    append_child(nodes, new, here.parent)
    update_costs(search, new)
    return True


@borrowing_kernel
def connect_goal(search: Search, new: int) -> None:
    """Add the goal below a node if that makes a cheaper path."""
    tree, goal, pieces = search.start_tree, search.path.goal, search.context.candidate
    here, target = tree.nodes[new], (goal[0], goal[1], goal[2])
    budget = search.path.cost[0] - here.cost - MIN_GAIN
    kind, count, cost = connect(search.context, pose_of(here), here.last, target, 0, budget)
    if kind < 0:
        return
    yaw = here.yaw if count == 0 else pieces[count - 1].yaw + pieces[count - 1].turn
    there = add_pose(tree, (goal[0], goal[1], yaw if math.isnan(goal[2]) else goal[2]), new)
    write_connection(search, there, kind, count, cost)
    update_costs(search, there)
    tree.nodes[there].at_goal = True


@borrowing_kernel
def rewire(search: Search, state: Stream) -> None:
    """Add a sample to the tree below its best parent, and rewire its neighbours: RRT*."""
    tree, path, found, run = search.start_tree, search.path, search.found, search.run[0]
    nodes, forward = tree.nodes, search.context.around.motion.forward
    if path.cost[0] < run.synced - MIN_GAIN:
        add_path(search)
    if tree.size[0] + 2 >= nodes.shape[0]:
        return
    drawn, pose = sample(search, state)
    if not drawn:
        return
    left = math.hypot(path.goal[0] - pose[0], path.goal[1] - pose[1]) / forward
    if math.hypot(nodes[0].x - pose[0], nodes[0].y - pose[1]) / forward + left >= path.cost[0]:
        return
    n = find_neighbours(search, pose)
    new = add_pose(tree, pose, NONE)
    if not choose_parent(search, new, n, path.cost[0] - left):
        tree.size[0] = new
        return
    here = nodes[new]
    for k in range(n):
        near = nodes[found[k]]
        budget = near.cost - here.cost - MIN_GAIN
        if found[k] != here.parent and found[k] != 0 and budget > 0.0:
            kind, count, cost = connect(search.context, pose, here.last, pose_of(near), 0, budget)
            if kind >= 0:
                i = int(found[k])
                remove_child(nodes, i)
                append_child(nodes, i, new)
                write_connection(search, i, kind, count, cost)
                update_costs(search, i)
    connect_goal(search, new)
    cheapest, end = path.cost[0] - MIN_GAIN, NONE
    for i in range(tree.size[0]):
        if nodes[i].at_goal and nodes[i].cost < cheapest:
            cheapest, end = nodes[i].cost, i
    if end != NONE and write_path(search, end, NONE):
        run.synced = path.cost[0]
