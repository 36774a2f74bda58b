"""Particle swarms: one way to fly, and four rules for the inertia.

Kennedy and Eberhart 1995; the rules are those of two papers on path planning, whose equations are
cited where they stand.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from planners.random_stream import Stream, uniform
from planners.swarm.state import Swarm, spread
from wheelchair_gym.compiled.kernel import borrowing_kernel

DAMPED, CHAOTIC, VARIABLE, ADAPTIVE = range(4)


class Flight(NamedTuple):
    """How particles fly, as kernels take it."""

    rule: int  # of the inertia: DAMPED, CHAOTIC, VARIABLE or ADAPTIVE
    inertia: float  # at the beginning
    least_inertia: float  # at the end, where the rule lets it fall
    damping: float  # factor of the inertia per move
    own: float  # c1, pull of the personal best
    best: float  # c2, pull of the swarm's best
    speed: float  # longest step of a coordinate, as a part of its bounds' width
    chaos: float  # start of the logistic map
    mu: float  # its parameter
    ring: int  # neighbours on each side that a particle hears of; 0: the whole swarm
    ramp: bool  # the inertia of way point j counts min(1, sqrt(j) / 4)


@borrowing_kernel
def inertia_of(swarm: Swarm, flight: Flight, progress: float) -> float:
    """The inertia of the next move."""
    now = swarm.now[0]
    high, low = flight.inertia, flight.least_inertia
    if flight.rule == CHAOTIC:
        if now.moves == 0:
            now.chaos = flight.chaos
        now.chaos = flight.mu * now.chaos * (1.0 - now.chaos)  # P2 (13)
        return (high - (high - low) * progress) * float(now.chaos)  # P2 (14), (15)
    if flight.rule == VARIABLE:  # R1 (2.1), (2.2)
        return math.exp(-(progress * (math.log(high) - math.log(low)) - math.log(high)))
    if flight.rule == ADAPTIVE:  # R1 (2.5), (2.6)
        gain = now.least / now.before if now.before < math.inf and now.before > 0.0 else 1.0
        now.before = now.least
        return (high + low) * gain - high * progress
    return high * float(flight.damping**now.moves)


@borrowing_kernel
def fly(swarm: Swarm, flight: Flight, inertia: float, state: Stream) -> None:
    """Move every particle once, in place, but for coordinates that are held: P2 (9)-(12)."""
    X, V = swarm.positions, swarm.velocities
    own, best = flight.own, flight.best
    if flight.rule == VARIABLE:
        own, best = math.cos(inertia), math.sin(inertia)  # R1 (2.3), (2.4)
    k, d = X.shape
    for i in range(k):
        guide = swarm.best
        if flight.ring > 0:
            nearest = i
            for step in range(-flight.ring, flight.ring + 1):
                j = (i + step) % k
                if swarm.own_costs[j] < swarm.own_costs[nearest]:
                    nearest = j
            guide = swarm.own[nearest]
        for c in range(d):
            if swarm.held[i, c]:
                continue
            limit = flight.speed * spread(swarm, c)
            w = inertia * min(1.0, math.sqrt(c // 2) / 4.0) if flight.ramp else inertia
            v = (
                w * V[i, c]
                + own * uniform(state) * (swarm.own[i, c] - X[i, c])
                + best * uniform(state) * (guide[c] - X[i, c])
            )
            V[i, c] = min(max(v, -limit), limit)
            X[i, c] += V[i, c]
