"""What a swarm is and remembers, for every optimiser: one record of arrays.

A swarm holds positions to be valued. Once their costs are known, `remember` settles what each of
them is worth to the swarm's memory: a personal best of a particle, a food source of bees and a
parent in an evolution are one thing, a position that a better one replaces.
"""

from __future__ import annotations

import math
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wheelchair_gym.compiled.kernel import borrowing_kernel
from wheelchair_gym.config import InputError

Array = NDArray[np.float64]

FEWEST = 4  # positions: differential evolution draws three others
WORST = -1  # target of a position that competes with the worst remembered one

NOW: Final = np.dtype(
    [
        ("moves", "i8"),  # made so far
        ("least", "f8"),  # cost of the best position
        ("before", "f8"),  # the same, one move ago
        ("chaos", "f8"),  # state of the logistic map
    ]
)


class Swarm(NamedTuple):
    """Positions to be valued next, and what the swarm remembers."""

    positions: Array  # (k, d)
    costs: Array  # (k,) of the positions, as far as they were valued
    velocities: Array  # (k, d) per move
    own: Array  # (k, d) remembered positions: personal bests, food sources, parents
    own_costs: Array  # (k,)
    targets: NDArray[np.int64]  # (k,) which remembered position each competes with, or WORST
    trials: NDArray[np.int64]  # (k,) vain ones since each was remembered
    best: Array  # (d,) of all positions valued so far
    span: Array  # (d,) of the whales' factor C
    lower: Array  # (d,) bounds of the positions
    upper: Array  # (d,)
    held: NDArray[np.bool_]  # (k, d) coordinates that particles leave where they are
    now: Any  # (1,) of NOW


def begin(population: ArrayLike, lower: ArrayLike, upper: ArrayLike) -> Swarm:
    """A swarm that starts at given positions, whatever optimiser will move it.

    Args:
        population: (k, d); copied. All optimisers but whales need FEWEST.
        lower: bounds of the positions, a number or (d,); may be infinite.
        upper: see lower.

    Raises:
        InputError: no positions, or bounds that are crossed.
    """
    positions = np.array(population, dtype=np.float64)
    if positions.ndim != 2 or len(positions) < 1:
        raise InputError(f"population has shape {positions.shape}; expected (1 or more, d)")
    k, d = positions.shape
    low, high = (np.array(np.broadcast_to(np.asarray(b, np.float64), d)) for b in (lower, upper))
    if not (low <= high).all():
        raise InputError(f"bounds are {low.tolist()} and {high.tolist()}; expected lower <= upper")
    now = np.zeros(1, NOW)
    now["least"] = now["before"] = np.inf
    return Swarm(
        positions=positions,
        costs=np.full(k, np.inf),
        velocities=np.zeros((k, d)),
        own=positions.copy(),
        own_costs=np.full(k, np.inf),
        targets=np.arange(k),
        trials=np.zeros(k, np.int64),
        best=positions[0].copy(),
        span=np.full(d, np.nan),  # until an optimiser sets its own
        lower=low,
        upper=high,
        held=np.zeros((k, d), np.bool_),
        now=now,
    )


@borrowing_kernel
def rival(swarm: Swarm, i: int) -> int:
    """The remembered position that position i competes with."""
    target = swarm.targets[i]
    if target != WORST:
        return int(target)
    worst = 0
    for j in range(1, swarm.own_costs.shape[0]):
        if swarm.own_costs[j] > swarm.own_costs[worst]:
            worst = j
    return worst


@borrowing_kernel
def remember(swarm: Swarm, i: int, j: int) -> None:
    """Keep position i, which costs less, in place of the remembered one j; perhaps as the best."""
    cost, now = swarm.costs[i], swarm.now[0]
    swarm.own_costs[j] = cost
    swarm.trials[j] = 0
    for c in range(swarm.positions.shape[1]):
        swarm.own[j, c] = swarm.positions[i, c]
    if cost < now.least:
        now.least = cost
        for c in range(swarm.positions.shape[1]):
            swarm.best[c] = swarm.positions[i, c]


@borrowing_kernel
def keep_within(swarm: Swarm) -> None:
    """Bring every position within the bounds; a velocity that led out turns round."""
    k, d = swarm.positions.shape
    for i in range(k):
        for c in range(d):
            x = min(max(swarm.positions[i, c], swarm.lower[c]), swarm.upper[c])
            if x != swarm.positions[i, c]:
                swarm.positions[i, c] = x
                swarm.velocities[i, c] = -swarm.velocities[i, c]


@borrowing_kernel
def spread(swarm: Swarm, c: int) -> float:
    """How wide a coordinate's bounds lie apart; 1 where they are infinite."""
    width = swarm.upper[c] - swarm.lower[c]
    return width if width < math.inf else 1.0
