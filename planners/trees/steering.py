"""Steering by whales: the local variant's search for the point to extend towards."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from planners.collision.polygon_tests import SpaceArrays, blocker, stops
from planners.random_stream import Stream, in_disc
from planners.swarm.woa import Whales, move
from wheelchair_gym.compiled.kernel import borrowing_kernel

Array = NDArray[np.float64]


class School(NamedTuple):
    """Room for the whales that steer."""

    positions: Array  # (k, 2) m, relative to the sample
    best: Array  # (2,)
    lower: Array  # (2,) bounds of the positions
    upper: Array  # (2,)
    span: Array  # (2,) of the factor C


class Pull(NamedTuple):
    """What draws a whale that looks for a point: lengths weigh, hidden views cost."""

    width: float  # m, half the width of the box round the sample in which whales swim
    height: float  # m, half its height
    to_sample: float  # cost per metre from the random sample
    to_goal: float  # cost per metre from the goal
    hidden_near: float  # cost of not seeing the node to extend
    hidden_goal: float  # cost of not seeing the goal


def new_school(swarm: Whales, pull: Pull) -> School:
    """Room for the whales of a swarm, and the box in which they swim."""
    upper = np.array([pull.width, pull.height])
    positions = np.empty((swarm.population, 2))
    return School(positions, np.zeros(2), -upper, upper, np.full(2, 2.0))


@borrowing_kernel
def hider(space: SpaceArrays, ax: float, ay: float, bx: float, by: float, last: int) -> int:
    """What hides b from a, as `blocker` says; what hid a whale last is looked at first."""
    if last >= 0 and stops(space.segments, space.before, last, ax, ay, bx, by):
        return last
    return blocker(space, ax, ay, bx, by)


@borrowing_kernel
def whale_target(
    space: SpaceArrays,
    near_x: float,
    near_y: float,
    x: float,
    y: float,
    goal_x: float,
    goal_y: float,
    swarm: Whales,
    pull: Pull,
    school: School,
    state: Stream,
) -> tuple[float, float]:
    """The point that a swarm round a random sample finds best (thesis, algorithm 4).

    Positions are relative to the sample, so that the map's origin means nothing to the swarm.

    Args:
        space: what is free.
        near_x: the node to extend [m].
        near_y: see near_x.
        x: the random sample [m].
        y: see x.
        goal_x: the goal [m].
        goal_y: see goal_x.
        swarm: how many whales, how long, how they move.
        pull: what draws them.
        school: room for them.
        state: stream of random numbers.
    """
    population, best = school.positions, school.best
    best[0], best[1] = 0.0, 0.0
    least, from_near, from_goal = np.inf, -1, -1  # what hid a whale last
    for i in range(swarm.population):
        u, v = in_disc(state)
        population[i, 0] = u * pull.width
        population[i, 1] = v * pull.height
    for t in range(swarm.iterations + 1):
        for i in range(swarm.population):
            u, v = population[i, 0], population[i, 1]
            to_goal = math.sqrt((goal_x - x - u) ** 2 + (goal_y - y - v) ** 2)
            cost = pull.to_sample * math.sqrt(u * u + v * v) + pull.to_goal * to_goal
            # Views are looked at only while the whale may still be the best. What hid the goal from
            # one whale hides it from most: that costs least to tell.
            if cost < least:
                hidden = hider(space, goal_x, goal_y, x + u, y + v, from_goal)
                if hidden != -1:
                    cost, from_goal = cost + pull.hidden_goal, hidden
            if cost < least:
                hidden = hider(space, near_x, near_y, x + u, y + v, from_near)
                if hidden != -1:
                    cost, from_near = cost + pull.hidden_near, hidden
            if cost < least:
                least = cost
                best[0], best[1] = u, v
        if t < swarm.iterations:
            a = swarm.a * (1.0 - t / swarm.iterations)
            move(
                population,
                best,
                a,
                swarm.b,
                swarm.mu,
                swarm.lam,
                school.span,
                school.lower,
                school.upper,
                state,
            )
    return x + best[0], y + best[1]
