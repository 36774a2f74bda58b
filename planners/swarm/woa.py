"""The whale optimisation algorithm: its equations stand here once, for every swarm of ours.

Mirjalili and Lewis 2016, with the two thresholds mu and lambda that the thesis adds (its section
2.6 and its studies). The point steering, the path optimisation and the control generator differ in
what a particle means and what it costs, never in how it moves.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from planners.random_stream import Stream, uniform
from wheelchair_gym.compiled.kernel import borrowing_kernel
from wheelchair_gym.config import setting, settings

Array = NDArray[np.float64]


class Whales(NamedTuple):
    """The numbers of a swarm, as kernels take them."""

    population: int
    iterations: int
    a: float
    b: float
    mu: float
    lam: float


@borrowing_kernel
def move(
    population: Array,
    best: Array,
    a: float,
    b: float,
    mu: float,
    lam: float,
    span: Array,
    lower: Array,
    upper: Array,
    state: Stream,
) -> None:
    """Move every whale once, in place: equations (2.1)-(2.8), then the boundary check.

    A whale draws one A and one p, which choose its manoeuvre, and a C for each coordinate. A and C
    come from independent draws, as in the original paper.

    Args:
        population: positions X (k, d).
        best: the best position found so far X* (d,).
        a: bound of A at this iteration; it falls to 0 over a run.
        b: shape of the logarithmic spiral.
        mu: a whale with p below this encircles or searches; the others follow the spiral.
        lam: a whale with |A| below this encircles the best; the others search.
        span: C lies in [0, span]: (d,), 2 in (2.4); another paper weighs it by occupancy.
        lower: bounds of the positions (d,).
        upper: see lower.
        state: stream of random numbers.
    """
    k, d = population.shape
    for i in range(k):
        X = population[i]
        A = 2.0 * a * uniform(state) - a  # (2.3)
        p = uniform(state)
        if p < mu:
            towards = best
            if abs(A) >= lam:
                towards = population[int(uniform(state) * k)]
            for j in range(d):
                C = span[j] * uniform(state)  # (2.4)
                D = abs(C * towards[j] - X[j])  # (2.1), (2.7)
                X[j] = towards[j] - A * D  # (2.2), (2.8)
        else:
            phase = 2.0 * uniform(state) - 1.0  # l of (2.6)
            swirl = math.exp(b * phase) * math.cos(2.0 * math.pi * phase)
            for j in range(d):
                X[j] = abs(best[j] - X[j]) * swirl + best[j]  # (2.5), (2.6)
        for j in range(d):
            X[j] = min(max(X[j], lower[j]), upper[j])


@settings
class WhaleSettings:
    """How many whales, how long, and when each manoeuvre is chosen."""

    population: int = setting(default=10, source="thesis, figure 3.1", low=1)
    iterations: int = setting(default=10, source="thesis, figure 3.1", low=0)
    a: float = setting(default=2.0, source="Mirjalili and Lewis 2016: falls from 2 to 0", low=0.0)
    b: float = setting(default=1.0, source="Mirjalili and Lewis 2016; thesis, figure 3.1")
    mu: float = setting(
        default=0.5, source="Mirjalili and Lewis 2016; 1 never spirals", low=0.0, high=1.0
    )
    lam: float = setting(default=1.0, source="Mirjalili and Lewis 2016; 0 always searches", low=0.0)

    @property
    def values(self) -> Whales:
        """The settings as kernels take them."""
        return Whales(self.population, self.iterations, self.a, self.b, self.mu, self.lam)
