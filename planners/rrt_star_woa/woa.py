"""The whale optimization algorithm of Mirjalili and Lewis 2016, used by all our whale swarms.

It has the two thresholds mu and lambda that the thesis adds (section 2.6). Steering, path
optimization and control generation differ only in what a position means and costs.
"""

from __future__ import annotations

import math
from typing import Any, Literal, NamedTuple

from wheelchair_gym.arrays import Array
from wheelchair_gym.compiled.kernel import borrowing_kernel
from wheelchair_gym.config import setting, settings
from wheelchair_gym.random import Stream, next_uniform


class WhaleParameters(NamedTuple):
    """Parameters of a whale swarm, as kernels take them."""

    population: int
    iterations: int
    a: float
    b: float
    mu: float
    lam: float
    latest: bool = False  # the leader is the best of the latest population


@borrowing_kernel
def move_whales(
    population: Array,
    best: Array,
    moves: Any,
    progress: float,
    c_range: Array,
    lower: Array,
    upper: Array,
    state: Stream,
) -> None:
    """Move every whale once, in place: equations (2.1)-(2.8), then clip to the bounds (d,).

    A whale draws one A and one p, which choose its move, and one C per coordinate. A and C are
    independent draws, as in the original paper. `a` of the moves, `WhaleParameters` or
    `MoveParameters`, bounds A; it falls to 0 with the progress of a run from 0 to 1. A whale with p
    below `mu` encircles the best (d,), or, with |A| of at least `lam`, searches around another
    whale; with p from `mu` on it spirals. C lies in [0, c_range] (d,): 2 in (2.4); P1 weights it by
    occupancy.
    """
    k, d = population.shape
    a, b, mu, lam = moves.a * (1.0 - progress), moves.b, moves.mu, moves.lam
    for i in range(k):
        X = population[i]
        A = 2.0 * a * next_uniform(state) - a  # (2.3)
        p = next_uniform(state)
        if p < mu:
            towards = best
            if abs(A) >= lam:
                towards = population[int(next_uniform(state) * k)]
            for j in range(d):
                C = c_range[j] * next_uniform(state)  # (2.4)
                D = abs(C * towards[j] - X[j])  # (2.1), (2.7)
                X[j] = towards[j] - A * D  # (2.2), (2.8)
        else:
            phase = 2.0 * next_uniform(state) - 1.0  # l of (2.6)
            swirl = math.exp(b * phase) * math.cos(2.0 * math.pi * phase)
            for j in range(d):
                X[j] = abs(best[j] - X[j]) * swirl + best[j]  # (2.5), (2.6)
        for j in range(d):
            X[j] = min(max(X[j], lower[j]), upper[j])


@settings
class WhaleMoves:
    """The choice of a whale's moves."""

    a: float = setting(default=2.0, low=0.0, source="Mirjalili and Lewis 2016")
    """Initial bound of the factor A; it falls to 0 over a run."""
    b: float = setting(default=1.0, source="Mirjalili and Lewis 2016; thesis, figure 3.1")
    """Shape of the logarithmic spiral."""
    mu: float = setting(default=0.5, low=0.0, high=1.0, source="Mirjalili and Lewis 2016")
    """Probability of a move other than the spiral; 1 never spirals."""
    lam: float = setting(default=1.0, low=0.0, source="Mirjalili and Lewis 2016")
    """Bound of |A| below which a whale encircles the best; 0 always searches."""


@settings
class LeaderChoice:
    """The choice of the leader that whales swim to."""

    leader: Literal["best", "latest"] = setting(
        default="best", source="Mirjalili and Lewis 2016; the thesis's algorithms: latest"
    )
    """The leader: the best position of all populations so far, or of the latest one alone, which
    can be worse than an earlier one. The result of a run is its last leader."""


@settings
class WhaleSettings(WhaleMoves):
    """Size and duration of a whale swarm, and the choice of its moves."""

    population: int = setting(default=10, low=1, source="thesis, figure 3.1")
    """Number of whales."""
    iterations: int = setting(default=10, low=0, source="thesis, figure 3.1")
    """Moves of the swarm."""

    @property
    def parameters(self) -> WhaleParameters:
        """The settings as kernels take them."""
        latest = isinstance(self, LeaderChoice) and self.leader == "latest"
        return WhaleParameters(
            self.population, self.iterations, self.a, self.b, self.mu, self.lam, latest
        )


@settings
class LedWhales(WhaleSettings, LeaderChoice):
    """A whale swarm with a choice of its leader."""
