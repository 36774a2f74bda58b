"""Evolution: a real-coded genetic algorithm and differential evolution."""

from __future__ import annotations

import math
from typing import NamedTuple

from planners.random_stream import Stream, uniform
from planners.swarm.foragers import other, spun
from planners.swarm.state import WORST, Swarm, spread
from wheelchair_gym.compiled.kernel import borrowing_kernel


class Genes(NamedTuple):
    """How a population breeds, as kernels take it."""

    crossed: float  # part of the children that two parents have; the others are mutants
    extension: float  # gamma: a child may lie this far beyond its parents
    mutated: float  # part of a mutant's coordinates that change
    step: float  # standard deviation of a change, as a part of the bounds' width
    pressure: float  # beta of the roulette: weight exp(-beta cost / worst cost)


class Difference(NamedTuple):
    """How differences of positions make new ones, as kernels take it."""

    least: float  # bounds of the factor F
    most: float
    crossed: float  # CR, chance of a coordinate to come from the mutant


@borrowing_kernel
def breed(swarm: Swarm, genes: Genes, state: Stream) -> None:
    """Make as many children as there are parents, in place; the best of both live on."""
    X, own, costs = swarm.positions, swarm.own, swarm.own_costs
    k, d = X.shape
    worst = 0.0
    for i in range(k):
        worst = max(worst, costs[i])
    total = 0.0
    for i in range(k):
        total += math.exp(-genes.pressure * costs[i] / worst) if 0.0 < worst < math.inf else 1.0
        swarm.costs[i] = total
    for i in range(k):
        swarm.targets[i] = WORST
        if i < genes.crossed * k:
            p, q = spun(swarm.costs, state), spun(swarm.costs, state)
            for c in range(d):
                share = (1.0 + 2.0 * genes.extension) * uniform(state) - genes.extension
                X[i, c] = share * own[p, c] + (1.0 - share) * own[q, c]
        else:
            parent, sure = int(uniform(state) * k), int(uniform(state) * d)
            for c in range(d):
                X[i, c] = own[parent, c]
                if c == sure or uniform(state) < genes.mutated:
                    # Box and Muller 1958.
                    radius = math.sqrt(-2.0 * math.log(1.0 - uniform(state)))
                    normal = radius * math.cos(2.0 * math.pi * uniform(state))
                    X[i, c] += genes.step * spread(swarm, c) * normal


@borrowing_kernel
def differ(swarm: Swarm, difference: Difference, state: Stream) -> None:
    """Make a rival of each position from three others, in place: DE/rand/1/bin (Storn, Price 1997).

    F is drawn anew for each coordinate.
    """
    X, own = swarm.positions, swarm.own
    k, d = X.shape
    for i in range(k):
        p = other(i, k, state)
        q = other(i, k, state)
        while q == p:
            q = other(i, k, state)
        r = other(i, k, state)
        while r in (p, q):
            r = other(i, k, state)
        sure = int(uniform(state) * d)
        for c in range(d):
            X[i, c] = own[i, c]
            if c == sure or uniform(state) <= difference.crossed:
                F = difference.least + uniform(state) * (difference.most - difference.least)
                X[i, c] = own[p, c] + F * (own[q, c] - own[r, c])
