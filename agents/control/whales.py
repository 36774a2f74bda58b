"""The whales' control generator as receding-horizon control: a few iterations every period.

A particle is a list of commands (v, w, t) and how many of them count (thesis, section 2.9.3 and
algorithm 6), as in `planners.controls.maneuver`;
here the swarm begins with what it found a period ago.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from agents.control.fan import whole_fan
from agents.control.follower import CREEP, Follower, Objective, near_of, widest
from agents.control.local_map import Surroundings
from agents.control.reference import Reference
from agents.control.rollout import Body, Motion, Near, Weights, begin, cheapest, cost_of
from planners.swarm.woa import WhaleParameters, WhaleSettings, move_whales
from wheelchair_gym.compiled.kernel import kernel
from wheelchair_gym.config import setting, settings
from wheelchair_gym.random import Stream, stream

Array = NDArray[np.float64]

TRIPLES = 3  # commands in a particle, at most
SIZE = 3 * TRIPLES + 1  # (v, w, t) of each, then how many count
SHARE = 7  # of the fan, every so manieth twist is in the first swarm


@settings
class WhaleFollower:
    """Whales search the commands of the next moments, warm-started every period."""

    whales: WhaleSettings = setting(
        default=WhaleSettings(population=24, iterations=4), source="10 ms on one core"
    )
    hold: float = setting(default=0.4, unit="s", low=0.1, source="four periods at 10 Hz")
    margin: float = setting(default=0.05, unit="m", low=0.0, source="laser sigma 15 mm, 3 sigma")
    backward: float = setting(default=0.2, unit="m/s", low=0.0, source="nothing looks back")
    seed: int = setting(default=0, low=0, source="of the whales, anew for every path")
    objective: Objective = Objective()

    def make(self) -> Follower:
        """A follower at rest."""
        return RecedingWhales(self)


@kernel
def search(
    first: Array, lower: Array, upper: Array, body: Body, near: Near, margin: float,
    weights: Weights, swarm: WhaleParameters, state: Stream,
) -> tuple[Array, Array]:  # fmt: skip
    """All particles (n, SIZE) that were tried and their costs (n,), the last one the best.

    Args:
        first: the swarm at the beginning (k, SIZE).
        lower: bounds of particles (SIZE,).
        upper: see lower.
        body: the chair now.
        near: what is round it.
        margin: what must always remain [m].
        weights: the objective.
        swarm: how many iterations, and how whales move.
        state: stream of random numbers.
    """
    k, start, span = first.shape[0], begin(near), np.full(SIZE, 2.0)
    tried = np.empty((k * (swarm.iterations + 1) + 1, SIZE))
    costs = np.empty(tried.shape[0])
    population, best, least, n = first.copy(), first[0].copy(), np.inf, 0
    for t in range(swarm.iterations + 1):
        for i in range(k):
            X = population[i]
            count = int(X[SIZE - 1])
            commands = X[: 3 * count].reshape(count, 3)
            costs[n] = cost_of(commands, body, near, start, margin, weights)
            tried[n] = X
            if costs[n] < least:
                least = costs[n]
                best[:] = X
            n += 1
        if t < swarm.iterations:
            a = swarm.a * (1.0 - t / swarm.iterations)
            move_whales(
                population, best, a, swarm.b, swarm.mu, swarm.lam, span, lower, upper, state
            )
    tried[n], costs[n] = best, least
    return tried, costs


class RecedingWhales:
    """Carries the best commands from one period to the next."""

    def __init__(self, own: WhaleFollower) -> None:
        self.own = own
        self._state = stream(np.random.default_rng(own.seed))
        self._best: Array | None = None  # (SIZE,)

    def twist(self, around: Surroundings, reference: Reference, chair: Motion) -> Array | None:
        """See `Follower.twist`."""
        own, near = self.own, near_of(around, reference)
        swarm, weights = own.whales.parameters, own.objective.weights

        def pick(margin: float, slow: bool) -> Array | None:
            lower, upper = self._bounds(around, chair, slow)
            first = np.clip(self._first(chair), lower, upper)
            tried, costs = search(
                first, lower, upper, chair.body, near, margin, weights, swarm, self._state
            )
            best = cheapest(tried, costs, chair.body, near, own.hold, margin)
            if best < 0:
                return None
            self._best = tried[best]
            return np.array(tried[best, :2])

        twist = widest(around, chair, own.margin, pick)
        if twist is None:
            self._best = None
        return twist

    def _bounds(self, around: Surroundings, chair: Motion, slow: bool) -> tuple[Array, Array]:
        limits, horizon = chair.limits, self.own.objective.horizon
        back = 0.0 if around.blind else min(self.own.backward, limits.backward)
        ahead = limits.forward
        if slow:
            back, ahead = min(back, CREEP), min(ahead, CREEP)
        low = [-back, -limits.turn, 2.0 * chair.period] * TRIPLES + [1.0]
        high = [ahead, limits.turn, horizon] * TRIPLES + [TRIPLES + 0.999]
        return np.array(low), np.array(high)

    def _first(self, chair: Motion) -> Array:
        """The swarm at the beginning: what was best, what is driven now, rest, part of a fan."""
        count = self.own.whales.population
        fan = whole_fan(chair.limits, self.own.backward)
        fan = fan[(np.arange(max(0, count - 3)) * SHARE) % len(fan)]
        first = np.zeros((count, SIZE))
        lasting = 0.5 * self.own.objective.horizon
        first[:, 2:-1:3], first[:, -1] = lasting, 1.0
        for k in range(TRIPLES):
            first[3:, 3 * k : 3 * k + 2] = fan
        if count > 1:
            first[1, :2] = chair.last
        if self._best is not None:
            first[0] = self._best
            first[0, 2] -= chair.period
            if first[0, 2] < chair.period and first[0, -1] >= 2.0:
                first[0, :-4] = first[0, 3:-1]
                first[0, -1] -= 1.0
        return first
