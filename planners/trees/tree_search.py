"""The one loop that grows trees towards a goal; each planner here is a set of its values.

From top to bottom: the best parent, rewiring and the link to the goal; one iteration; and the
search itself, in chunks of iterations between which the clock is read.
"""

from __future__ import annotations

import math
from time import perf_counter
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from planners.collision.polygon_tests import SpaceArrays, point_free
from planners.problem import Plan, Problem, Status, begin, trivial
from planners.random_stream import Stream, stream, uniform
from planners.swarm.woa import Whales
from planners.trees.sampling import sample
from planners.trees.steering import Pull, School, new_school, whale_target
from planners.trees.tree import (
    NONE,
    Tree,
    branch,
    chain,
    edges,
    enlarged,
    insert,
    nearest,
    new_tree,
    put,
    remove,
    rewire,
    within,
)
from planners.trees.values import GAIN, Growth, Room, new_room, new_run, passes
from wheelchair_gym.compiled.kernel import borrowing_kernel, whole

Array = NDArray[np.float64]

# Vain draws of a node before none is taken as childless and removable.
_LEAF_DRAWS = 100


@borrowing_kernel
def choose_parent(
    space: SpaceArrays,
    tree: Tree,
    x: float,
    y: float,
    room: Room,
    n: int,
    parent: int,
    edge: float,
) -> tuple[int, float]:
    """The neighbour through which a point is reached at least cost, and the edge's length.

    Neighbours are tried in order of cost, so that few edges are tested; `parent` is known to do.
    """
    nodes, through, run = tree.nodes, room.through, room.run[0]
    for k in range(n):
        through[k] = nodes[room.found[k]].cost + room.distances[k]
    while True:
        least, choice = nodes[parent].cost + edge, NONE
        for k in range(n):
            if through[k] < least:
                least, choice = through[k], k
        if choice == NONE:
            return parent, edge
        through[choice] = np.inf
        j = room.found[choice]
        if passes(space, run, nodes[j].x, nodes[j].y, x, y):
            return whole(j), room.distances[choice]


@borrowing_kernel
def climb(
    space: SpaceArrays, tree: Tree, x: float, y: float, parent: int, edge: float, run: Any
) -> tuple[int, float]:
    """The highest ancestor of a parent, and the edge's length, that still sees the point.

    By the triangle inequality each is a better parent than the one before (Jeong et al. 2019).
    """
    nodes = tree.nodes
    while nodes[parent].parent != NONE:
        above = whole(nodes[parent].parent)
        if not passes(space, run, nodes[above].x, nodes[above].y, x, y):
            break
        parent = above
        edge = math.hypot(x - nodes[parent].x, y - nodes[parent].y)
    return parent, edge


@borrowing_kernel
def link_goal(
    space: SpaceArrays, tree: Tree, node: int, goal: Array, reach: float, room: Room
) -> None:
    """Reach the goal from a node, if it is within reach, seen and thus nearer than before."""
    nodes, run = tree.nodes, room.run[0]
    x, y = nodes[node].x, nodes[node].y
    gap = math.hypot(goal[0] - x, goal[1] - y)
    known = run.goal != NONE
    if gap > reach or (known and nodes[node].cost + gap >= nodes[run.goal].cost - GAIN):
        return
    if gap > 0.0 and not passes(space, run, x, y, goal[0], goal[1]):
        return
    if known:
        rewire(tree, run.goal, whole(node), gap, room.stack)
        return
    run.first = run.iteration
    run.goal = node if gap == 0.0 else insert(tree, goal[0], goal[1], node, gap)


@borrowing_kernel
def relink_goal(space: SpaceArrays, tree: Tree, goal: Array, reach: float, room: Room) -> None:
    """Reach a goal that was reached from the best of all nodes: costs fell after they linked."""
    for i in range(tree.grid[0].count):
        if i != room.run[0].goal:
            link_goal(space, tree, i, goal, reach, room)


@borrowing_kernel
def shorten(space: SpaceArrays, tree: Tree, room: Room) -> None:
    """Join the vertices of the best path where that shortens it, edges tested exactly."""
    nodes, run = tree.nodes, room.run[0]
    n = chain(tree, run.goal, room.chain)
    for k in range(n - 3, -1, -1):
        i = room.chain[k]
        x, y = nodes[i].x, nodes[i].y
        count = min(n - k - 2, len(room.found))
        for m in range(count):  # the parent's own ancestors, as far as there is room
            j = room.chain[k + 2 + m]
            room.found[m] = j
            room.distances[m] = math.hypot(nodes[j].x - x, nodes[j].y - y)
        before = whole(nodes[i].parent)
        parent, edge = choose_parent(space, tree, x, y, room, count, before, nodes[i].edge)
        parent, edge = climb(space, tree, x, y, parent, edge, run)  # drops points on one line
        if parent != before:
            rewire(tree, whole(i), whole(parent), edge, room.stack)


@borrowing_kernel
def childless(tree: Tree, one: int, other: int, third: int, state: Stream) -> int:
    """A childless node drawn at random, neither the root nor one of three; NONE if vain."""
    for _ in range(_LEAF_DRAWS):
        i = 1 + int(uniform(state) * (tree.grid[0].count - 1))
        if tree.nodes[i].child == NONE and i != one and i != other and i != third:
            return i
    return NONE


# Iterations after which a best path that improved is shortened again.
_PERIOD = 64
# A path this near the straight line is the straight line, by rounding.
_STRAIGHT = 1.0 + 1e-12


@borrowing_kernel
def reach_for(
    space: SpaceArrays, tree: Tree, x: float, y: float, growth: Growth, room: Room
) -> tuple[int, bool]:
    """Extend a tree from its node nearest to a point step by step until blocked.

    Returns:
        The last node of the way, and whether it lies on the point.
    """
    nodes = tree.nodes
    i = nearest(tree, x, y)
    while True:
        from_x, from_y = nodes[i].x, nodes[i].y
        gap = math.hypot(x - from_x, y - from_y)
        if gap == 0.0:
            return i, True
        if tree.grid[0].count >= growth.limit:
            return i, False
        part = min(1.0, growth.step / gap)
        to_x, to_y = x, y
        if part < 1.0:
            to_x, to_y = from_x + part * (x - from_x), from_y + part * (y - from_y)
        if not passes(space, room.run[0], from_x, from_y, to_x, to_y):
            return i, False
        i = insert(tree, to_x, to_y, i, part * gap)


@borrowing_kernel
def graft(ahead: Tree, back: Tree, node: int, twin: int) -> int:
    """Add the way from a node of the goal's tree, met by its twin, to the goal; returns that."""
    nodes = back.nodes
    i = nodes[twin].parent
    edge = nodes[twin].edge
    while i != NONE:
        node = insert(ahead, nodes[i].x, nodes[i].y, node, edge)
        edge = nodes[i].edge
        i = nodes[i].parent
    return node


@borrowing_kernel
def add_node(
    space: SpaceArrays,
    tree: Tree,
    x: float,
    y: float,
    near: int,
    edge: float,
    goal: Array,
    growth: Growth,
    room: Room,
    state: Stream,
) -> int:
    """Add a point [m] seen from a node by an edge [m], at its best place; NONE if it is no use.

    At the limit of nodes a childless one makes room, where the values say so.
    """
    nodes, grid, run = tree.nodes, tree.grid[0], room.run[0]
    found, distances = room.found, room.distances
    parent, n = near, 0
    rewiring = growth.rewiring and (run.first != NONE or not growth.both_ways)
    if rewiring:
        radius = growth.radius
        if radius == 0.0:
            count = grid.count + 1
            radius = growth.gamma * math.sqrt(run.area * math.log(count) / count)
        n = within(tree, x, y, radius, found, distances)
        if run.beacon != NONE and n < len(found):  # the way goes on to the vertex after
            found[n] = room.chain[run.beacon - 1]
            distances[n] = math.hypot(nodes[found[n]].x - x, nodes[found[n]].y - y)
            n += 1
        parent, edge = choose_parent(space, tree, x, y, room, n, near, edge)
        if growth.climbing:
            parent, edge = climb(space, tree, x, y, parent, edge, run)
        if growth.informed:
            least = nodes[parent].cost + edge + math.hypot(goal[0] - x, goal[1] - y)
            if least >= nodes[run.goal].cost - GAIN:
                return NONE
    if grid.count < growth.limit:
        new = insert(tree, x, y, parent, edge)
    else:
        new = childless(tree, parent, near, run.goal, state) if growth.recycling else NONE
        if new == NONE:
            return NONE
        remove(tree, new)
        put(tree, new, x, y, parent, edge)
    cost = nodes[new].cost
    for k in range(n):
        j = found[k]
        if cost + distances[k] < nodes[j].cost - GAIN and passes(
            space, run, x, y, nodes[j].x, nodes[j].y
        ):
            rewire(tree, whole(j), whole(new), distances[k], room.stack)
    return int(new)


@borrowing_kernel
def extend(
    space: SpaceArrays,
    tree: Tree,
    start: Array,
    goal: Array,
    growth: Growth,
    swarm: Whales,
    pull: Pull,
    school: School,
    room: Room,
    state: Stream,
) -> int:
    """Draw a sample, steer towards it and add a node; NONE if that was blocked or no use."""
    run = room.run[0]
    x, y = sample(space, tree, start, goal, growth, room, state)
    far = run.beacon == NONE
    near = nearest(tree, x, y) if far else whole(room.chain[run.beacon + 1])
    near_x, near_y = tree.nodes[near].x, tree.nodes[near].y
    if growth.whales:
        x, y = whale_target(
            space, near_x, near_y, x, y, goal[0], goal[1], swarm, pull, school, state
        )
    edge = math.hypot(x - near_x, y - near_y)
    if edge <= GAIN:
        return NONE
    if far and edge > growth.step:
        x = near_x + (x - near_x) * growth.step / edge
        y = near_y + (y - near_y) * growth.step / edge
        edge = math.hypot(x - near_x, y - near_y)
    if passes(space, run, near_x, near_y, x, y):
        return add_node(space, tree, x, y, near, edge, goal, growth, room, state)
    if growth.in_strip:
        run.blocked += 1
        run.cuts += point_free(space, x, y)
        run.margin += growth.widening
    return NONE


@borrowing_kernel
def improve(
    space: SpaceArrays, tree: Tree, start: Array, goal: Array, growth: Growth, room: Room
) -> None:
    """Shorten the best path if it fell, and say how large the ellipse of what may help is."""
    nodes, run = tree.nodes, room.run[0]
    if nodes[run.goal].cost >= run.length - GAIN:
        return
    shorten(space, tree, room)
    run.length = nodes[run.goal].cost
    apart = math.hypot(goal[0] - start[0], goal[1] - start[1])
    if growth.informed:
        across = math.sqrt(max(run.length * run.length - apart * apart, 0.0))
        run.area = min(run.area, 0.25 * math.pi * run.length * across)
    run.done |= run.length <= apart * _STRAIGHT


@borrowing_kernel
def lacks_room(ahead: Tree, back: Tree, growth: Growth) -> bool:
    """Whether the arrays may be too small for another iteration that the limit allows."""
    # The start's tree may have to take up the way from the goal's.
    both = ahead.grid[0].count + back.grid[0].count + growth.reserve
    return both > len(ahead.nodes) or (growth.both_ways and both > len(back.nodes))


@borrowing_kernel
def grow(
    space: SpaceArrays,
    ahead: Tree,
    back: Tree,
    start: Array,
    goal: Array,
    growth: Growth,
    swarm: Whales,
    pull: Pull,
    school: School,
    room: Room,
    until: int,
    state: Stream,
) -> None:
    """Grow trees until the goal is reached as the values ask, or samples or nodes run out.

    It returns early where the arrays have no room for another iteration, too. All state is in the
    arguments, so that any chunks of iterations and any room make the very same run.

    Args:
        space: what is free.
        ahead: the tree of the start; both are planted here if it is empty.
        back: the tree of the goal; it grows where trees grow both ways.
        start: root of the one (2,) [m].
        goal: where the path shall end (2,) [m].
        growth: what kind of tree.
        swarm: the whales that steer, where they do.
        pull: what draws these whales.
        school: room for them.
        room: the state of the run, and room for the rest.
        until: the iteration to stop at.
        state: stream of random numbers.
    """
    run = room.run[0]
    if run.iteration == 0:  # nothing is shorter than the straight edge
        if ahead.grid[0].count == 0:
            insert(ahead, start[0], start[1], NONE, 0.0)
            insert(back, goal[0], goal[1], NONE, 0.0)
        link_goal(space, ahead, 0, goal, growth.reach, room)
        if run.goal != NONE:
            run.done = ahead.nodes[run.goal].parent == 0
            if growth.shortening:
                improve(space, ahead, start, goal, growth, room)
    while run.iteration < until and not run.done:
        tree, other = (back, ahead) if run.backward else (ahead, back)
        if not growth.recycling and max(ahead.grid[0].count, back.grid[0].count) >= growth.limit:
            run.done = True
            break
        if lacks_room(ahead, back, growth):
            break
        run.iteration += 1
        new = extend(space, tree, start, goal, growth, swarm, pull, school, room, state)
        if growth.both_ways and run.first == NONE:
            if new != NONE:
                x, y = tree.nodes[new].x, tree.nodes[new].y
                met, there = reach_for(space, other, x, y, growth, room)
                if there:
                    node, twin = (met, new) if run.backward else (new, met)
                    run.goal = graft(ahead, back, node, twin)
                    run.first = run.iteration
            run.backward = run.first == NONE and not run.backward
        elif new != NONE:
            link_goal(space, ahead, new, goal, growth.reach, room)
        if run.first == run.iteration:
            run.done = growth.stop_at_first
        due = run.first == run.iteration or (run.first != NONE and run.iteration % _PERIOD == 0)
        if growth.shortening and due:
            improve(space, ahead, start, goal, growth, room)


# Nodes that there is room for at first, and how much more room is made each time.
_FIRST_NODES, _MORE = 256, 4
# Iterations of the first chunk under a deadline, and the most of any.
_CHUNK, _MOST_CHUNK = 16, 4096
# What a chunk should take: this part of the deadline, at most so many seconds.
_PART, _PART_S = 0.02, 2e-3
_NO_PULL = Pull(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
_NO_WHALES = Whales(1, 0, 0.0, 0.0, 0.0, 0.0)


class Grove(NamedTuple):
    """Everything of a run: what is asked, how it grows, and what has grown."""

    space: SpaceArrays
    ahead: Tree
    back: Tree
    start: Array  # (2,) m
    goal: Array  # (2,) m
    growth: Growth
    swarm: Whales
    pull: Pull
    school: School
    room: Room


def new_grove(
    problem: Problem, growth: Growth, swarm: Whales = _NO_WHALES, pull: Pull = _NO_PULL
) -> Grove:
    """Small empty trees for a problem; they are given more room when they need it."""
    arrays = problem.free.arrays
    bounds = arrays.bounds.tolist()
    across = math.hypot(bounds[2] - bounds[0], bounds[3] - bounds[1])
    # A tree that reaches for another crosses the map at most.
    growth = growth._replace(reserve=int(across / growth.step) + 4 if growth.both_ways else 2)
    return Grove(
        arrays,
        new_tree(bounds, growth.reserve + _FIRST_NODES),
        new_tree(bounds, growth.reserve + _FIRST_NODES if growth.both_ways else 1),
        np.array(problem.start[:2], dtype=np.float64),
        np.array(problem.goal[:2], dtype=np.float64),
        growth,
        swarm,
        pull,
        new_school(swarm, pull),
        new_room(new_run(bounds), growth.reserve + _FIRST_NODES),
    )


def roomy(grove: Grove, capacity: int) -> Grove:
    """The same run with arrays for so many nodes of each tree."""
    both = grove.growth.both_ways
    return grove._replace(
        ahead=enlarged(grove.ahead, capacity),
        back=enlarged(grove.back, capacity) if both else grove.back,
        room=new_room(grove.room.run, capacity),
    )


def grow_until(grove: Grove, iterations: int, ends: float, state: Stream) -> Grove:
    """Grow for so many iterations, or until the clock shows `ends` [s], or nothing is to be gained.

    The first chunk is grown whatever the clock shows. Returns the run with the room it needed.
    """
    run = grove.room.run
    chunk, before = iterations if ends == math.inf else _CHUNK, perf_counter()
    aim = min(_PART * max(ends - before, 0.0), _PART_S)
    while True:
        made = int(run["iteration"][0])
        grow(*grove, min(iterations, made + chunk), state)
        new = int(run["iteration"][0])
        if run["done"][0] or new >= iterations:
            return grove
        if new < made + chunk:
            grove = roomy(grove, _MORE * len(grove.ahead.nodes))
        if ends < math.inf:
            now = perf_counter()
            if now >= ends:
                return grove
            if new > made:
                chunk = int(min(aim, ends - now) * (new - made) / max(now - before, 1e-9))
                chunk = min(max(chunk, 1), _MOST_CHUNK)
            before = now


def answer(grove: Grove, began: float) -> Plan:
    """The plan that has grown."""
    run, ahead = grove.room.run[0], grove.ahead
    # Informed trees have tried each edge to the goal, and go on trying where it counts.
    open_end = grove.growth.rewiring and not (grove.growth.stop_at_first or grove.growth.informed)
    if run["goal"] != NONE and open_end:
        relink_goal(grove.space, ahead, grove.goal, grove.growth.reach, grove.room)
    goal, first = int(run["goal"]), int(run["first"])
    path, tree = np.empty((0, 2)), edges(ahead)
    nodes = len(tree) + 1
    if grove.growth.both_ways:
        tree = np.concatenate([tree, edges(grove.back)])
        nodes += int(grove.back.grid["count"][0])
    counters = {"nodes": nodes, "iterations": int(run["iteration"])}
    counters["edges_tested"] = int(run["tests"])
    if grove.growth.in_strip:
        counters["blocked"], counters["walls_cut"] = int(run["blocked"]), int(run["cuts"])
    if goal != NONE:
        path = branch(ahead, goal)
        counters["first_path_iterations"] = first
    return Plan(
        Status.EXHAUSTED if goal == NONE else Status.SOLVED,
        path,
        tree,
        counters,
        {"time_s": perf_counter() - began},
    )


def search(
    problem: Problem,
    rng: np.random.Generator,
    deadline: float | None,
    growth: Growth,
    iterations: int,
    swarm: Whales = _NO_WHALES,
    pull: Pull = _NO_PULL,
) -> Plan:
    """The plan that trees of these values make in so many iterations, or before a deadline [s]."""
    began, ends = begin(deadline)
    plan = trivial(problem)
    if plan is not None:
        return plan
    grove = new_grove(problem, growth, swarm, pull)
    return answer(grow_until(grove, iterations, ends, stream(rng)), began)
