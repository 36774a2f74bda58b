"""From a problem to a plan: trees grow in chunks of iterations, between which the clock is read."""

from __future__ import annotations

import math
from time import perf_counter
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from planners.draws import Stream, stream
from planners.exact import SpaceArrays
from planners.swarm.woa import Whales
from planners.trees.growth import grow
from planners.trees.parents import relink_goal
from planners.trees.steering import Pull, School, new_school
from planners.trees.tree import NONE, Tree, branch, edges, enlarged, new_tree
from planners.trees.values import Growth, Room, new_room, new_run
from planners.types import Plan, Problem, Status, begin, trivial

Array = NDArray[np.float64]

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
