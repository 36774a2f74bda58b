"""Swarms that search for food or for light: artificial bees and fireflies."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from planners.random_stream import Stream, uniform
from planners.swarm.state import WORST, Swarm, spread
from wheelchair_gym.compiled.kernel import borrowing_kernel

Array = NDArray[np.float64]


class Bees(NamedTuple):
    """How bees forage, as kernels take it."""

    reach: float  # a step goes at most this far along the difference of two sources
    patience: float  # vain trials of a source, per coordinate and bee, before it is left


class Fireflies(NamedTuple):
    """How fireflies fly, as kernels take it."""

    attraction: float  # beta at distance 0
    absorption: float  # gamma, per square of the distance, as a part of the bounds' diagonal
    randomness: float  # alpha
    damping: float  # factor of alpha per move
    step: float  # of the random part, as a part of the bounds' width


@borrowing_kernel
def other(i: int, k: int, state: Stream) -> int:
    """A number below k, uniform, that is not i."""
    j = int(uniform(state) * (k - 1))
    return j + 1 if j >= i else j


@borrowing_kernel
def spun(sums: Array, state: Stream) -> int:
    """A number drawn by roulette, from the running sums (k,) of the weights."""
    k = sums.shape[0]
    at = uniform(state) * sums[k - 1]
    i = 0
    while i < k - 1 and sums[i] < at:
        i += 1
    return i


@borrowing_kernel
def forage(swarm: Swarm, bees: Bees, state: Stream) -> None:
    """Send the bees out once, in place: employed bees and onlookers in turn (Karaboga 2005).

    Sources that were tried in vain too often are left for random ones, scouts, on the turn of the
    employed bees. Two moves are one cycle of the original.
    """
    k, d = swarm.positions.shape
    onlookers = swarm.now[0].moves % 2 == 1
    bounded = True
    for c in range(d):
        bounded &= swarm.upper[c] - swarm.lower[c] < math.inf
    if onlookers:
        mean, total = 0.0, 0.0
        for i in range(k):
            mean += swarm.own_costs[i] / k
        for i in range(k):  # fitness exp(-cost / mean), as a running sum
            total += math.exp(-swarm.own_costs[i] / mean) if mean > 0.0 else 1.0
            swarm.costs[i] = total
    for i in range(k):
        source = spun(swarm.costs, state) if onlookers else i
        swarm.targets[i] = source
        if not onlookers and bounded and swarm.trials[i] >= bees.patience * k * d:
            swarm.own_costs[i] = math.inf
            for c in range(d):
                width = swarm.upper[c] - swarm.lower[c]
                swarm.positions[i, c] = swarm.lower[c] + uniform(state) * width
            continue
        j = other(source, k, state)
        for c in range(d):
            phi = bees.reach * (2.0 * uniform(state) - 1.0)
            x = swarm.own[source, c]
            swarm.positions[i, c] = x + phi * (x - swarm.own[j, c])


@borrowing_kernel
def glow(swarm: Swarm, fireflies: Fireflies, state: Stream) -> None:
    """Move every firefly towards all brighter ones, in place (Yang 2009); the best k live on."""
    X, own, costs = swarm.positions, swarm.own, swarm.own_costs
    k, d = X.shape
    alpha = fireflies.randomness * fireflies.damping ** swarm.now[0].moves
    diagonal = 0.0
    for c in range(d):
        diagonal += spread(swarm, c) ** 2
    for i in range(k):
        swarm.targets[i] = WORST
        for c in range(d):
            X[i, c] = own[i, c]
        for j in range(k):
            if costs[j] < costs[i]:
                square = 0.0
                for c in range(d):
                    square += (own[j, c] - X[i, c]) ** 2
                beta = fireflies.attraction * math.exp(-fireflies.absorption * square / diagonal)
                for c in range(d):
                    X[i, c] += beta * uniform(state) * (own[j, c] - X[i, c])
        for c in range(d):
            step = fireflies.step * spread(swarm, c)
            X[i, c] += alpha * step * (2.0 * uniform(state) - 1.0)
