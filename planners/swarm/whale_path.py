"""Whales whose particles are whole paths: the global variant (thesis, algorithm 5)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from planners.collision.polygon_tests import SpaceArrays
from planners.random_stream import Stream
from planners.smoothing.curves import POLYLINE
from planners.swarm.moves import WHALES, Moves
from planners.swarm.objectives import length_free
from planners.swarm.path_cost import Task
from planners.swarm.search import in_discs, run
from planners.swarm.state import begin
from planners.swarm.woa import Whales

Array = NDArray[np.float64]


def shorten(
    space: SpaceArrays,
    path: Array,
    swarm: Whales,
    shortness: float,
    collision_free: float,
    width: float,
    height: float,
    state: Stream,
) -> Array:
    """The shortest free path that a swarm finds near a free path; never a longer one.

    A particle is the shifts of the inner points; the first is the path itself. The cost is
    shortness x length + collision_free x edges that are not free. Where the weights let a path
    through a wall lead the swarm, the best free path is still the one returned.

    Args:
        space: what is free.
        path: points (n, 2) [m], all edges free.
        swarm: how many whales, how long, how they move.
        shortness: cost per metre of length.
        collision_free: cost of an edge that is not free.
        width: the points move at most this far in x [m], and start in the disc within.
        height: at most this far in y [m].
        state: stream of random numbers.
    """
    n = len(path) - 2
    if n < 1:
        return path
    box = np.tile([width, height], n)
    anchors = np.ascontiguousarray(path[1:-1])
    task = Task(space, np.empty((0, 3)), path[0], path[-1], anchors, POLYLINE, False, 1)
    found = run(
        task,
        length_free(shortness, collision_free),
        Moves(WHALES, a=swarm.a, b=swarm.b, mu=swarm.mu, lam=swarm.lam),
        begin(in_discs(swarm.population, n, width, height, state), -box, box),
        swarm.iterations,
        max(1, swarm.iterations),
        state,
    )
    return found.line if len(found.line) else path
