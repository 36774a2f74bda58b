"""How swarms other than whales move: particles, wolves, bees, fireflies and evolution."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from planners.swarm.state import WORST, Swarm, bound_width
from wheelchair_gym.compiled.kernel import borrowing_kernel
from wheelchair_gym.random import Stream, next_uniform

Array = NDArray[np.float64]

DAMPED, CHAOTIC, VARIABLE, ADAPTIVE = range(4)


class ParticleParameters(NamedTuple):
    """How particles fly, as kernels take it."""

    rule: int  # of the inertia: DAMPED, CHAOTIC, VARIABLE or ADAPTIVE
    inertia: float  # at the beginning
    min_inertia: float  # at the end, where the rule lets it fall
    damping: float  # factor of the inertia per move
    c1: float  # c1, pull of the personal best
    c2: float  # c2, pull of the swarm's best
    max_step: float  # longest step of a coordinate, as a part of its bounds' width
    chaos: float  # start of the logistic map
    mu: float  # its parameter
    neighbours: int  # neighbours on each side that a particle hears of; 0: the whole swarm
    inertia_ramp: bool  # the inertia of way point j counts min(1, sqrt(j) / 4)


@borrowing_kernel
def next_inertia(swarm: Swarm, particles: ParticleParameters, progress: float) -> float:
    """The inertia of the next move."""
    record = swarm.record[0]
    high, low = particles.inertia, particles.min_inertia
    if particles.rule == CHAOTIC:
        if record.move_count == 0:
            record.chaos = particles.chaos
        record.chaos = particles.mu * record.chaos * (1.0 - record.chaos)  # P2 (13)
        return (high - (high - low) * progress) * float(record.chaos)  # P2 (14), (15)
    if particles.rule == VARIABLE:  # R1 (2.1), (2.2)
        return math.exp(-(progress * (math.log(high) - math.log(low)) - math.log(high)))
    if particles.rule == ADAPTIVE:  # R1 (2.5), (2.6)
        gain = (
            record.best_cost / record.previous_best_cost
            if record.previous_best_cost < math.inf and record.previous_best_cost > 0.0
            else 1.0
        )
        record.previous_best_cost = record.best_cost
        return (high + low) * gain - high * progress
    return high * float(particles.damping**record.move_count)


@borrowing_kernel
def move_particles(
    swarm: Swarm, particles: ParticleParameters, inertia: float, state: Stream
) -> None:
    """Move every particle once, in place, but for coordinates that are held: P2 (9)-(12)."""
    X, V = swarm.positions, swarm.velocities
    own, best = particles.c1, particles.c2
    if particles.rule == VARIABLE:
        own, best = math.cos(inertia), math.sin(inertia)  # R1 (2.3), (2.4)
    k, d = X.shape
    for i in range(k):
        guide = swarm.best
        if particles.neighbours > 0:
            nearest = i
            for step in range(-particles.neighbours, particles.neighbours + 1):
                j = (i + step) % k
                if swarm.personal_best_costs[j] < swarm.personal_best_costs[nearest]:
                    nearest = j
            guide = swarm.personal_best[nearest]
        for c in range(d):
            if swarm.fixed[i, c]:
                continue
            limit = particles.max_step * bound_width(swarm, c)
            w = inertia * min(1.0, math.sqrt(c // 2) / 4.0) if particles.inertia_ramp else inertia
            v = (
                w * V[i, c]
                + own * next_uniform(state) * (swarm.personal_best[i, c] - X[i, c])
                + best * next_uniform(state) * (guide[c] - X[i, c])
            )
            V[i, c] = min(max(v, -limit), limit)
            X[i, c] += V[i, c]


@borrowing_kernel
def move_wolves(swarm: Swarm, a: float, state: Stream) -> None:
    """Move every wolf once, in place: R1 (4.3)-(4.11), with the D of the original in (4.6)-(4.8).

    The leaders alpha, beta and delta are the three best remembered positions.
    """
    X, costs = swarm.positions, swarm.personal_best_costs
    k, d = X.shape
    alpha, beta, delta = -1, -1, -1
    for i in range(k):
        if alpha < 0 or costs[i] < costs[alpha]:
            alpha, beta, delta = i, alpha, beta
        elif beta < 0 or costs[i] < costs[beta]:
            beta, delta = i, beta
        elif delta < 0 or costs[i] < costs[delta]:
            delta = i
    for i in range(k):
        for c in range(d):
            total = 0.0
            for leader in (alpha, beta, delta):
                A = 2.0 * a * next_uniform(state) - a  # (4.10)
                C = 2.0 * next_uniform(state)  # (4.11)
                prey = swarm.personal_best[leader, c]
                total += prey - A * abs(C * prey - X[i, c])  # (4.3)-(4.8)
            X[i, c] = total / 3.0  # (4.9)


class BeeParameters(NamedTuple):
    """How bees forage, as kernels take it."""

    acceleration: float  # a step goes at most this far along the difference of two sources
    trial_limit: float  # vain trials of a source, per coordinate and bee, before it is left


class FireflyParameters(NamedTuple):
    """How fireflies fly, as kernels take it."""

    attraction: float  # beta at distance 0
    absorption: float  # gamma, per square of the distance, as a part of the bounds' diagonal
    randomness: float  # alpha
    damping: float  # factor of alpha per move
    step: float  # of the random part, as a part of the bounds' width


@borrowing_kernel
def other_index(i: int, k: int, state: Stream) -> int:
    """A number below k, uniform, that is not i."""
    j = int(next_uniform(state) * (k - 1))
    return j + 1 if j >= i else j


@borrowing_kernel
def roulette(sums: Array, state: Stream) -> int:
    """A number drawn by roulette, from the running sums (k,) of the weights."""
    k = sums.shape[0]
    at = next_uniform(state) * sums[k - 1]
    i = 0
    while i < k - 1 and sums[i] < at:
        i += 1
    return i


@borrowing_kernel
def move_bees(swarm: Swarm, bees: BeeParameters, state: Stream) -> None:
    """Send the bees out once, in place: employed bees and onlookers in turn (Karaboga 2005).

    Sources that were tried in vain too often are left for random ones, scouts, on the turn of the
    employed bees. Two moves are one cycle of the original.
    """
    k, d = swarm.positions.shape
    onlookers = swarm.record[0].move_count % 2 == 1
    bounded = True
    for c in range(d):
        bounded &= swarm.upper[c] - swarm.lower[c] < math.inf
    if onlookers:
        mean, total = 0.0, 0.0
        for i in range(k):
            mean += swarm.personal_best_costs[i] / k
        for i in range(k):  # fitness exp(-cost / mean), as a running sum
            total += math.exp(-swarm.personal_best_costs[i] / mean) if mean > 0.0 else 1.0
            swarm.costs[i] = total
    for i in range(k):
        source = roulette(swarm.costs, state) if onlookers else i
        swarm.targets[i] = source
        if not onlookers and bounded and swarm.trials[i] >= bees.trial_limit * k * d:
            swarm.personal_best_costs[i] = math.inf
            for c in range(d):
                width = swarm.upper[c] - swarm.lower[c]
                swarm.positions[i, c] = swarm.lower[c] + next_uniform(state) * width
            continue
        j = other_index(source, k, state)
        for c in range(d):
            phi = bees.acceleration * (2.0 * next_uniform(state) - 1.0)
            x = swarm.personal_best[source, c]
            swarm.positions[i, c] = x + phi * (x - swarm.personal_best[j, c])


@borrowing_kernel
def move_fireflies(swarm: Swarm, fireflies: FireflyParameters, state: Stream) -> None:
    """Move every firefly towards all brighter ones, in place (Yang 2009); the best k live on."""
    X, own, costs = swarm.positions, swarm.personal_best, swarm.personal_best_costs
    k, d = X.shape
    alpha = fireflies.randomness * fireflies.damping ** swarm.record[0].move_count
    diagonal = 0.0
    for c in range(d):
        diagonal += bound_width(swarm, c) ** 2
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
                    X[i, c] += beta * next_uniform(state) * (own[j, c] - X[i, c])
        for c in range(d):
            step = fireflies.step * bound_width(swarm, c)
            X[i, c] += alpha * step * (2.0 * next_uniform(state) - 1.0)


class GeneticParameters(NamedTuple):
    """How a population breeds, as kernels take it."""

    crossover_share: float  # part of the children that two parents have; the others are mutants
    extension: float  # gamma: a child may lie this far beyond its parents
    mutation_rate: float  # part of a mutant's coordinates that change
    mutation_step: float  # standard deviation of a change, as a part of the bounds' width
    selection_pressure: float  # beta of the roulette: weight exp(-beta cost / worst cost)


class DifferenceParameters(NamedTuple):
    """How differences of positions make new ones, as kernels take it."""

    min_factor: float  # bounds of the factor F
    max_factor: float
    crossover_rate: float  # CR, chance of a coordinate to come from the mutant


@borrowing_kernel
def move_genetic(swarm: Swarm, genes: GeneticParameters, state: Stream) -> None:
    """Make as many children as there are parents, in place; the best of both live on."""
    X, own, costs = swarm.positions, swarm.personal_best, swarm.personal_best_costs
    k, d = X.shape
    worst = 0.0
    for i in range(k):
        worst = max(worst, costs[i])
    total = 0.0
    for i in range(k):
        total += (
            math.exp(-genes.selection_pressure * costs[i] / worst)
            if 0.0 < worst < math.inf
            else 1.0
        )
        swarm.costs[i] = total
    for i in range(k):
        swarm.targets[i] = WORST
        if i < genes.crossover_share * k:
            p, q = roulette(swarm.costs, state), roulette(swarm.costs, state)
            for c in range(d):
                share = (1.0 + 2.0 * genes.extension) * next_uniform(state) - genes.extension
                X[i, c] = share * own[p, c] + (1.0 - share) * own[q, c]
        else:
            parent, sure = int(next_uniform(state) * k), int(next_uniform(state) * d)
            for c in range(d):
                X[i, c] = own[parent, c]
                if c == sure or next_uniform(state) < genes.mutation_rate:
                    # Box and Muller 1958.
                    radius = math.sqrt(-2.0 * math.log(1.0 - next_uniform(state)))
                    normal = radius * math.cos(2.0 * math.pi * next_uniform(state))
                    X[i, c] += genes.mutation_step * bound_width(swarm, c) * normal


@borrowing_kernel
def move_differential(swarm: Swarm, difference: DifferenceParameters, state: Stream) -> None:
    """Make a rival of each position from three others, in place: DE/rand/1/bin (Storn, Price 1997).

    F is drawn anew for each coordinate.
    """
    X, own = swarm.positions, swarm.personal_best
    k, d = X.shape
    for i in range(k):
        p = other_index(i, k, state)
        q = other_index(i, k, state)
        while q == p:
            q = other_index(i, k, state)
        r = other_index(i, k, state)
        while r in (p, q):
            r = other_index(i, k, state)
        sure = int(next_uniform(state) * d)
        for c in range(d):
            X[i, c] = own[i, c]
            if c == sure or next_uniform(state) <= difference.crossover_rate:
                F = difference.min_factor + next_uniform(state) * (
                    difference.max_factor - difference.min_factor
                )
                X[i, c] = own[p, c] + F * (own[q, c] - own[r, c])
