"""Every optimiser's move behind one door, for compiled loops and for Python alike."""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from planners.random_stream import Stream, stream
from planners.swarm.evolution import Difference, Genes, breed, differ
from planners.swarm.foragers import Bees, Fireflies, forage, glow
from planners.swarm.gwo import hunt
from planners.swarm.pso import Flight, fly, inertia_of
from planners.swarm.state import FEWEST, Swarm, begin, keep_within, remember, rival
from planners.swarm.woa import move as circle
from wheelchair_gym.compiled.kernel import borrowing_kernel, kernel
from wheelchair_gym.config import InputError

Array = NDArray[np.float64]

WHALES, PARTICLES, WOLVES, PARTICLES_THEN_WOLVES, BEES, FIREFLIES, GENES, DIFFERENCE = range(8)


class Moves(NamedTuple):
    """An optimiser as kernels take it: its kind, and the numbers of all kinds."""

    kind: int
    a: float = 2.0  # whales, and wolves: see their equations
    b: float = 1.0
    mu: float = 0.5
    lam: float = 1.0
    span: float = 2.0  # of the whales' factor C; where occupancy counts, that of a free way point
    by_occupancy: bool = False  # C is 0 for way points of the best that are not free
    share: float = 0.5  # of a run that particles fly before wolves hunt
    flight: Flight = Flight(0, 1.0, 1.0, 1.0, 2.0, 2.0, 0.1, 0.3, 4.0, 0, False)
    bees: Bees = Bees(1.0, 0.6)
    fireflies: Fireflies = Fireflies(2.0, 1.0, 0.2, 0.98, 0.05)
    genes: Genes = Genes(0.7, 0.4, 0.1, 0.1, 8.0)
    difference: Difference = Difference(0.2, 0.8, 0.2)


@borrowing_kernel
def flying(moves: Moves, progress: float) -> bool:
    """Whether the next move is one of particles."""
    return moves.kind == PARTICLES or (
        moves.kind == PARTICLES_THEN_WOLVES and progress < moves.share
    )


@borrowing_kernel
def advance(swarm: Swarm, moves: Moves, progress: float, state: Stream) -> float:
    """Move a swarm once, in place; returns the inertia, where particles flew.

    Args:
        swarm: its positions are valued, and remembered.
        moves: how.
        progress: the part of the run that is over, in [0, 1].
        state: stream of random numbers.
    """
    inertia, kind = 0.0, moves.kind
    if kind == WHALES:
        if not swarm.span[0] >= 0.0:
            swarm.span[:] = moves.span
        circle(
            swarm.positions,
            swarm.best,
            moves.a * (1.0 - progress),
            moves.b,
            moves.mu,
            moves.lam,
            swarm.span,
            swarm.lower,
            swarm.upper,
            state,
        )
    elif flying(moves, progress):
        flown = progress / moves.share if kind == PARTICLES_THEN_WOLVES else progress
        inertia = inertia_of(swarm, moves.flight, flown)
        fly(swarm, moves.flight, inertia, state)
    elif kind == WOLVES:
        hunt(swarm, moves.a * (1.0 - progress), state)
    elif kind == PARTICLES_THEN_WOLVES:
        hunt(swarm, moves.a * (1.0 - progress) / (1.0 - moves.share), state)
    elif kind == BEES:
        forage(swarm, moves.bees, state)
    elif kind == FIREFLIES:
        glow(swarm, moves.fireflies, state)
    elif kind == GENES:
        breed(swarm, moves.genes, state)
    else:
        differ(swarm, moves.difference, state)
    if kind != WHALES:  # they keep within by themselves
        keep_within(swarm)
    swarm.now[0].moves += 1
    return inertia


@kernel
def told(swarm: Swarm, moves: Moves, progress: float, state: Stream) -> None:
    """Take the costs of a swarm's positions for good, and move it."""
    for i in range(swarm.positions.shape[0]):
        j = rival(swarm, i)
        if swarm.costs[i] < swarm.own_costs[j]:
            remember(swarm, i, j)
        else:
            swarm.trials[j] += 1
    advance(swarm, moves, progress, state)


class Optimizer(Protocol):
    """Settings that say how a swarm moves."""

    @property
    def moves(self) -> Moves:
        """The settings as kernels take them."""
        ...

    def move(
        self,
        population: ArrayLike,
        costs: ArrayLike,
        best: ArrayLike,
        progress: float,
        rng: np.random.Generator,
        memory: Swarm | None = None,
    ) -> Array:
        """A population (k, d) moved once; see `move`."""
        ...


class _Moving(Protocol):
    @property
    def moves(self) -> Moves: ...


def move(
    self: _Moving,
    population: ArrayLike,
    costs: ArrayLike,
    best: ArrayLike,
    progress: float,
    rng: np.random.Generator,
    memory: Swarm | None = None,
) -> Array:
    """A population moved once: the next positions to be valued.

    Args:
        self: the optimiser's settings.
        population: positions (k, d); left as they are.
        costs: their costs (k,).
        best: the best position so far (d,); a memory knows it by itself.
        progress: the part of the run that is over, in [0, 1].
        rng: draws the numbers.
        memory: what `begin` made for this run, changed in place: velocities, personal bests,
            parents, trials, bounds. Without it nothing is remembered: a first move, unbounded.

    Raises:
        InputError: fewer than FEWEST positions, and these are no whales.
    """
    swarm = memory
    if swarm is None:
        swarm = begin(population, -np.inf, np.inf)
        swarm.best[:] = best
        swarm.now["least"] = -np.inf
    k = len(swarm.positions)
    if k < FEWEST and self.moves.kind != WHALES:
        raise InputError(f"population has {k} positions; expected at least {FEWEST}")
    swarm.positions[:] = population
    swarm.costs[:] = costs
    told(swarm, self.moves, progress, stream(rng))
    return swarm.positions.copy()
