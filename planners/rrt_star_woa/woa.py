"""The whale optimization algorithm (WOA): equations (2.1) to (2.8) and algorithm 3 of the thesis.

Algorithm 3 has the thresholds 0.5 and 1, which section 3.3.3 calls mu and lambda. Steering, path
shortening, control generation, the refinement of poses and the followers run this one loop by ask
and tell; they differ in what a whale means and costs:

    whales = new_whales(population, parameters, lower, upper)  # line 1
    for t in range(parameters.iterations + 1):  # line 3
        for i in range(len(population)):
            tell(whales, i, cost(whales.population[i]))  # lines 2 and 14
        if t < parameters.iterations:
            move(whales, t / parameters.iterations, state)  # lines 4 to 13
    return whales.leader  # line 16
"""

import math
from typing import Literal, NamedTuple

import numpy as np

from wheelchair_gym.base.arrays import Array
from wheelchair_gym.base.settings import setting, settings
from wheelchair_gym.compiled.kernel import absorbed_kernel, borrowing_kernel, kernel
from wheelchair_gym.compiled.random import Stream, next_uniform


class WhaleParameters(NamedTuple):
    """Parameters of a whale swarm, as kernels take them."""

    population: int
    iterations: int
    a: float
    b: float
    mu: float
    lam: float
    latest: bool = False  # the leader is the best whale of the latest population


class Whales(NamedTuple):
    """A swarm of k whales in d dimensions, between two calls of its user."""

    population: Array  # (k, d) X
    leader: Array  # (d,) X*
    leader_cost: Array  # (1,) of it; infinite until a whale is told
    c_range: Array  # (d,) bound of C: 2 in (2.4)
    lower: Array  # (d,) bounds of the population
    upper: Array  # (d,)
    parameters: WhaleParameters


@kernel
def new_whales(
    population: Array, parameters: WhaleParameters, lower: Array, upper: Array
) -> Whales:
    """Return a swarm at given positions (k, d), which it moves in place: line 1."""
    d = population.shape[1]
    leader, cost = population[0].copy(), np.full(1, np.inf)
    return Whales(population, leader, cost, np.full(d, 2.0), lower, upper, parameters)


@absorbed_kernel
def tell(whales: Whales, i: int, cost: float) -> None:
    """Make whale i the leader if it costs less than the leader: lines 2 and 14.

    A user may stop computing a cost once it has reached `leader_cost`.
    """
    if cost < whales.leader_cost[0]:
        whales.leader_cost[0] = cost
        for j in range(whales.leader.shape[0]):
            whales.leader[j] = whales.population[i, j]


@borrowing_kernel
def move(whales: Whales, progress: float, state: Stream) -> None:
    """Move all whales once, then clip them to the bounds: lines 4 to 13, equations (2.1) to (2.8).

    The progress of the run rises from 0 to 1. A whale draws one A and one p, which choose its move,
    one l for its spiral, one other whale for its search, and one C per coordinate. With a latest
    leader the cost of the leader is forgotten, so that the best whale of the next population leads.
    """
    population, leader, parameters = whales.population, whales.leader, whales.parameters
    lower, upper, c_range = whales.lower, whales.upper, whales.c_range
    k, d = population.shape
    a = parameters.a * (1.0 - progress)  # falls linearly towards 0: section 2.6.2 C
    b, mu, lam = parameters.b, parameters.mu, parameters.lam
    for i in range(k):
        X = population[i]
        A = 2.0 * a * next_uniform(state) - a  # (2.3)
        p = next_uniform(state)
        if p < mu:  # line 6
            towards = leader
            if abs(A) >= lam:  # line 9: search for prey
                towards = population[int(next_uniform(state) * k)]
            for j in range(d):
                C = c_range[j] * next_uniform(state)  # (2.4)
                D = abs(C * towards[j] - X[j])  # (2.1), (2.7)
                X[j] = towards[j] - A * D  # (2.2), (2.8)
        else:  # line 11: spiral
            phase = 2.0 * next_uniform(state) - 1.0  # l of (2.6)
            swirl = math.exp(b * phase) * math.cos(2.0 * math.pi * phase)
            for j in range(d):
                X[j] = abs(leader[j] - X[j]) * swirl + leader[j]  # (2.5), (2.6)
        for j in range(d):  # line 13
            X[j] = min(max(X[j], lower[j]), upper[j])
    if parameters.latest:
        whales.leader_cost[0] = math.inf


@settings
class WhaleMoves:
    """The moves of whales, and the choice of their leader."""

    leader: Literal["best", "latest"] = setting(
        default="best", source="thesis, section 2.6.1; one reading of its algorithms: latest"
    )
    """The leader: the best position of all populations so far, or of the latest one alone, which
    can be worse than an earlier one. The result of a run is its last leader."""
    a: float = setting(default=2.0, low=0.0, source="Mirjalili and Lewis 2016")
    """Initial bound of the factor A; it falls to 0 over a run."""
    b: float = setting(default=1.0, low=-99.0, high=99.0, source="thesis, figure 3.1")
    """Shape of the logarithmic spiral."""
    mu: float = setting(default=0.5, low=0.0, high=1.0, source="Mirjalili and Lewis 2016")
    """Probability of a move other than the spiral; 1 never spirals."""
    lam: float = setting(default=1.0, low=0.0, source="Mirjalili and Lewis 2016")
    """Bound of |A| below which a whale encircles the best; 0 always searches."""

    def whale_moves(self, population: int = 0, iterations: int = 0) -> WhaleParameters:
        """Return the moves of a swarm as kernels take them."""
        latest = self.leader == "latest"
        return WhaleParameters(population, iterations, self.a, self.b, self.mu, self.lam, latest)


@settings
class WhaleSettings(WhaleMoves):
    """Size and duration of a whale swarm, and its moves."""

    population: int = setting(default=10, low=1, high=100_000, source="thesis, figure 3.1")
    """Number of whales."""
    iterations: int = setting(default=10, low=0, source="thesis, figure 3.1")
    """Moves of the swarm."""

    @property
    def parameters(self) -> WhaleParameters:
        """The settings as kernels take them."""
        return self.whale_moves(self.population, self.iterations)


@settings
class ShiftBounds:
    """Bounds of a point's shift by whales."""

    width_bound: float = setting(default=2.5, unit="m", low=0.0, source="thesis, figure 3.1")
    """Largest shift of a point in x."""
    height_bound: float = setting(default=2.5, unit="m", low=0.0, source="thesis, figure 3.1")
    """Largest shift of a point in y."""
