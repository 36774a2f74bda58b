"""Every optimiser's move behind one door, for compiled loops and for Python alike."""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from planners.swarm.state import MIN_POPULATION, Swarm, clip_to_bounds, competitor, new_swarm, store
from planners.swarm.update_rules import (
    BeeParameters,
    DifferenceParameters,
    FireflyParameters,
    GeneticParameters,
    ParticleParameters,
    move_bees,
    move_differential,
    move_fireflies,
    move_genetic,
    move_particles,
    move_wolves,
    next_inertia,
)
from planners.swarm.woa import move_whales as circle
from wheelchair_gym.compiled.kernel import borrowing_kernel, kernel
from wheelchair_gym.config import InputError
from wheelchair_gym.random import Stream, stream

Array = NDArray[np.float64]

WHALES, PARTICLES, WOLVES, PARTICLES_THEN_WOLVES, BEES, FIREFLIES, GENES, DIFFERENCE = range(8)


class MoveParameters(NamedTuple):
    """An optimiser as kernels take it: its kind, and the numbers of all kinds."""

    kind: int
    a: float = 2.0  # whales, and wolves: see their equations
    b: float = 1.0
    mu: float = 0.5
    lam: float = 1.0
    c_range: float = (
        2.0  # of the whales' factor C; where occupancy counts, that of a free way point
    )
    by_occupancy: bool = False  # C is 0 for way points of the best that are not free
    particle_share: float = 0.5  # of a run that particles fly before wolves hunt
    particles: ParticleParameters = ParticleParameters(
        0, 1.0, 1.0, 1.0, 2.0, 2.0, 0.1, 0.3, 4.0, 0, False
    )
    bees: BeeParameters = BeeParameters(1.0, 0.6)
    fireflies: FireflyParameters = FireflyParameters(2.0, 1.0, 0.2, 0.98, 0.05)
    genes: GeneticParameters = GeneticParameters(0.7, 0.4, 0.1, 0.1, 8.0)
    difference: DifferenceParameters = DifferenceParameters(0.2, 0.8, 0.2)


@borrowing_kernel
def is_particle_move(moves: MoveParameters, progress: float) -> bool:
    """Whether the next move is one of particles."""
    return moves.kind == PARTICLES or (
        moves.kind == PARTICLES_THEN_WOLVES and progress < moves.particle_share
    )


@borrowing_kernel
def move_swarm(swarm: Swarm, moves: MoveParameters, progress: float, state: Stream) -> float:
    """Move a swarm once, in place; returns the inertia, where particles flew.

    Args:
        swarm: its positions are valued, and remembered.
        moves: how.
        progress: the part of the run that is over, in [0, 1].
        state: stream of random numbers.
    """
    inertia, kind = 0.0, moves.kind
    if kind == WHALES:
        if not swarm.c_range[0] >= 0.0:
            swarm.c_range[:] = moves.c_range
        circle(
            swarm.positions,
            swarm.best,
            moves.a * (1.0 - progress),
            moves.b,
            moves.mu,
            moves.lam,
            swarm.c_range,
            swarm.lower,
            swarm.upper,
            state,
        )
    elif is_particle_move(moves, progress):
        flown = progress / moves.particle_share if kind == PARTICLES_THEN_WOLVES else progress
        inertia = next_inertia(swarm, moves.particles, flown)
        move_particles(swarm, moves.particles, inertia, state)
    elif kind == WOLVES:
        move_wolves(swarm, moves.a * (1.0 - progress), state)
    elif kind == PARTICLES_THEN_WOLVES:
        move_wolves(swarm, moves.a * (1.0 - progress) / (1.0 - moves.particle_share), state)
    elif kind == BEES:
        move_bees(swarm, moves.bees, state)
    elif kind == FIREFLIES:
        move_fireflies(swarm, moves.fireflies, state)
    elif kind == GENES:
        move_genetic(swarm, moves.genes, state)
    else:
        move_differential(swarm, moves.difference, state)
    if kind != WHALES:  # they keep within by themselves
        clip_to_bounds(swarm)
    swarm.record[0].move_count += 1
    return inertia


@kernel
def store_and_move(swarm: Swarm, moves: MoveParameters, progress: float, state: Stream) -> None:
    """Take the costs of a swarm's positions for good, and move it."""
    for i in range(swarm.positions.shape[0]):
        j = competitor(swarm, i)
        if swarm.costs[i] < swarm.personal_best_costs[j]:
            store(swarm, i, j)
        else:
            swarm.trials[j] += 1
    move_swarm(swarm, moves, progress, state)


class Optimizer(Protocol):
    """Settings that say how a swarm moves."""

    @property
    def parameters(self) -> MoveParameters:
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
    def parameters(self) -> MoveParameters: ...


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
        swarm = new_swarm(population, -np.inf, np.inf)
        swarm.best[:] = best
        swarm.record["best_cost"] = -np.inf
    k = len(swarm.positions)
    if k < MIN_POPULATION and self.parameters.kind != WHALES:
        raise InputError(f"population has {k} positions; expected at least {MIN_POPULATION}")
    swarm.positions[:] = population
    swarm.costs[:] = costs
    store_and_move(swarm, self.parameters, progress, stream(rng))
    return swarm.positions.copy()
