"""What a swarm is and remembers, for every optimiser: one record of arrays.

A swarm holds positions to be valued. Once their costs are known, `remember` settles what each of
them is path_cost to the swarm's memory: a personal best of a particle, a food source of bees and a
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

MIN_POPULATION = 4  # positions: differential evolution draws three others
WORST = -1  # target of a position that competes with the worst remembered one

RECORD: Final = np.dtype(
    [
        ("move_count", "i8"),  # made so far
        ("best_cost", "f8"),  # cost of the best position
        ("previous_best_cost", "f8"),  # the same, one move ago
        ("chaos", "f8"),  # state of the logistic map
    ]
)


class Swarm(NamedTuple):
    """Positions to be valued next, and what the swarm remembers."""

    positions: Array  # (k, d)
    costs: Array  # (k,) of the positions, as far as they were valued
    velocities: Array  # (k, d) per move
    personal_best: Array  # (k, d) remembered positions: personal bests, food sources, parents
    personal_best_costs: Array  # (k,)
    targets: NDArray[np.int64]  # (k,) which remembered position each competes with, or WORST
    trials: NDArray[np.int64]  # (k,) vain ones since each was remembered
    best: Array  # (d,) of all positions valued so far
    c_range: Array  # (d,) of the whales' factor C
    lower: Array  # (d,) bounds of the positions
    upper: Array  # (d,)
    fixed: NDArray[np.bool_]  # (k, d) coordinates that particles leave where they are
    record: Any  # (1,) of NOW


def new_swarm(population: ArrayLike, lower: ArrayLike, upper: ArrayLike) -> Swarm:
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
    record = np.zeros(1, RECORD)
    record["best_cost"] = record["previous_best_cost"] = np.inf
    return Swarm(
        positions=positions,
        costs=np.full(k, np.inf),
        velocities=np.zeros((k, d)),
        personal_best=positions.copy(),
        personal_best_costs=np.full(k, np.inf),
        targets=np.arange(k),
        trials=np.zeros(k, np.int64),
        best=positions[0].copy(),
        c_range=np.full(d, np.nan),  # until an optimiser sets its own
        lower=low,
        upper=high,
        fixed=np.zeros((k, d), np.bool_),
        record=record,
    )


@borrowing_kernel
def competitor(swarm: Swarm, i: int) -> int:
    """The remembered position that position i competes with."""
    target = swarm.targets[i]
    if target != WORST:
        return int(target)
    worst = 0
    for j in range(1, swarm.personal_best_costs.shape[0]):
        if swarm.personal_best_costs[j] > swarm.personal_best_costs[worst]:
            worst = j
    return worst


@borrowing_kernel
def store(swarm: Swarm, i: int, j: int) -> None:
    """Keep position i, which costs less, in place of the remembered one j; perhaps as the best."""
    cost, record = swarm.costs[i], swarm.record[0]
    swarm.personal_best_costs[j] = cost
    swarm.trials[j] = 0
    for c in range(swarm.positions.shape[1]):
        swarm.personal_best[j, c] = swarm.positions[i, c]
    if cost < record.best_cost:
        record.best_cost = cost
        for c in range(swarm.positions.shape[1]):
            swarm.best[c] = swarm.positions[i, c]


@borrowing_kernel
def clip_to_bounds(swarm: Swarm) -> None:
    """Bring every position within the bounds; a velocity that led out turns round."""
    k, d = swarm.positions.shape
    for i in range(k):
        for c in range(d):
            x = min(max(swarm.positions[i, c], swarm.lower[c]), swarm.upper[c])
            if x != swarm.positions[i, c]:
                swarm.positions[i, c] = x
                swarm.velocities[i, c] = -swarm.velocities[i, c]


@borrowing_kernel
def bound_width(swarm: Swarm, c: int) -> float:
    """How wide a coordinate's bounds lie apart; 1 where they are infinite."""
    width = swarm.upper[c] - swarm.lower[c]
    return width if width < math.inf else 1.0
