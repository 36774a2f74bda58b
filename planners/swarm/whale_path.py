"""Whales whose particles are whole paths: the global variant (thesis, algorithm 5)."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from planners.draws import Stream, in_disc
from planners.exact import SpaceArrays, edge_free
from planners.swarm.woa import Whales, move
from wheelchair_gym.kernel import borrowing_kernel, kernel

Array = NDArray[np.float64]


@borrowing_kernel
def shifted_length(path: Array, shift: Array, out: Array) -> float:
    """Write a path (n, 2) whose inner points are shifted (2 (n - 2),); returns its length [m]."""
    n = path.shape[0]
    for i in range(n):
        out[i, 0], out[i, 1] = path[i, 0], path[i, 1]
    for i in range(1, n - 1):
        out[i, 0] += shift[2 * i - 2]
        out[i, 1] += shift[2 * i - 1]
    length = 0.0
    for i in range(n - 1):
        length += math.hypot(out[i + 1, 0] - out[i, 0], out[i + 1, 1] - out[i, 1])
    return length


@kernel
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
    n = path.shape[0]
    d = 2 * max(n - 2, 0)
    population = np.zeros((swarm.population, d))
    lower, upper, span, best = np.empty(d), np.empty(d), np.empty(d), np.zeros(d)
    for j in range(n - 2):
        upper[2 * j], upper[2 * j + 1] = width, height
        lower[2 * j], lower[2 * j + 1] = -width, -height
        span[2 * j], span[2 * j + 1] = 2.0, 2.0
        for i in range(1, swarm.population):
            u, v = in_disc(state)
            population[i, 2 * j] = u * width
            population[i, 2 * j + 1] = v * height
    trial, shortest = np.empty((n, 2)), np.empty((n, 2))
    least_length = shifted_length(path, best, shortest)
    least = shortness * least_length
    for t in range(swarm.iterations + 1):
        for i in range(swarm.population):
            length = shifted_length(path, population[i], trial)
            cost = shortness * length
            blocked = 0
            for j in range(n - 1):  # tested only while the particle may still be of use
                if cost >= least and (length >= least_length or blocked > 0):
                    break
                if not edge_free(space, trial[j, 0], trial[j, 1], trial[j + 1, 0], trial[j + 1, 1]):
                    blocked += 1
                    cost += collision_free
            else:
                if cost < least:
                    least = cost
                    for j in range(d):
                        best[j] = population[i, j]
                if blocked == 0 and length < least_length:
                    least_length = length
                    shifted_length(path, population[i], shortest)
        if t < swarm.iterations:
            a = swarm.a * (1.0 - t / swarm.iterations)
            move(population, best, a, swarm.b, swarm.mu, swarm.lam, span, lower, upper, state)
    return shortest
