"""The swarm optimizers as settings; `planners.registries.OPTIMIZERS` names them.

`new_swarm` makes the memory of a swarm, the same record for all optimizers:

    memory = new_swarm(population, lower, upper)
    for t in range(iterations):
        population = optimizer.move(memory.positions, costs_of(memory.positions), memory.best,
                                    t / iterations, rng, memory)
"""

from __future__ import annotations

from dataclasses import fields
from typing import Any, ClassVar, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from planners.swarm import optimizers as kinds
from planners.swarm.optimizers import (
    MIN_POPULATION,
    MoveParameters,
    Swarm,
    new_swarm,
    store_and_move,
    whale_moves,
)
from planners.swarm.woa import WhaleMoves
from wheelchair_gym.config import InputError, setting, settings
from wheelchair_gym.random import stream

_YARPIZ = "Yarpiz (program library)"
_P2 = "P2: Al-Nayar, Dagher and Hadi, results"
_NOT_GIVEN = "usual value, not given in R1"
_R1 = "R1: project report on PSO and GWO, section 5.4"


class Optimizer:
    """Settings that say how a swarm moves."""

    moves: ClassVar[MoveParameters]  # the kind of moves, before the settings

    @property
    def parameters(self) -> MoveParameters:
        """The settings as kernels take them."""
        values: Any = {field.name: getattr(self, field.name) for field in fields(self)}  # type: ignore[arg-type]
        return self.moves._replace(**values)

    def move(
        self,
        population: ArrayLike,
        costs: ArrayLike,
        best: ArrayLike,
        progress: float,
        rng: np.random.Generator,
        memory: Swarm | None = None,
    ) -> NDArray[np.float64]:
        """A population moved once: the next positions to be evaluated.

        Args:
            population: positions (k, d); they stay unchanged.
            costs: their costs (k,).
            best: the best position so far (d,); ignored where there is a memory.
            progress: the finished part of the run, in [0, 1].
            rng: draws the numbers.
            memory: what `new_swarm` made for this run, changed in place: velocities, personal
                bests, parents, trials, bounds. Without it, this is a first move, unbounded.

        Raises:
            InputError: fewer than `MIN_POPULATION` positions, unless whales move them.
        """
        swarm = memory
        if swarm is None:
            swarm = new_swarm(population, -np.inf, np.inf)
            swarm.best[:] = best
            swarm.record["best_cost"] = -np.inf
        k = len(swarm.positions)
        if k < MIN_POPULATION and self.parameters.kind != kinds.WHALES:
            raise InputError(f"population has {k} positions; expected at least {MIN_POPULATION}")
        swarm.positions[:] = population
        swarm.costs[:] = costs
        store_and_move(swarm, self.parameters, progress, stream(rng))
        return swarm.positions.copy()


@settings
class Woa(WhaleMoves, Optimizer):
    """Whales (Mirjalili and Lewis 2016), with the thesis's thresholds mu and lambda."""

    moves = MoveParameters(kinds.WHALES)

    @property
    def parameters(self) -> MoveParameters:
        """The settings as kernels take them."""
        return whale_moves(self)


@settings
class WoaModified(Optimizer):
    """Whales whose factor C counts where the best path is free: P1 (17)-(19).

    C lies in [0, w], w = 1 where a way point of the best path is free and 0 where it is occupied;
    a map of free and solid has no third case.
    """

    whales: Woa = setting(default=Woa(), source="P1: as WOA")
    """The whales, but for the factor C."""

    @property
    def parameters(self) -> MoveParameters:
        """The settings as kernels take them."""
        return self.whales.parameters._replace(c_range=1.0, by_occupancy=True)


@settings
class Particles(Optimizer):
    """What the particle swarms of R1 and P2 share."""

    neighbours: int = setting(default=0, low=0, source="design choice")
    """Neighbours on each side whose best a particle knows; 0 for the whole swarm."""
    inertia_ramp: bool = setting(default=False, source="R1, section 5.7")
    """Whether the inertia of way point j counts min(1, sqrt(j) / 4)."""


@settings
class Pso(Particles):
    """Particles whose inertia is damped: P2's PSO, or a fixed inertia at damping 1."""

    moves = MoveParameters(kinds.PARTICLES, rule=kinds.DAMPED)

    inertia: float = setting(default=1.0, low=0.0, source=_P2 + ", its listing")
    """Initial inertia."""
    damping: float = setting(default=0.98, low=0.0, high=1.0, source=_P2)
    """Factor of the inertia per move."""
    c1: float = setting(default=2.0, low=0.0, source=_P2 + "; its listing has 1.5")
    """Acceleration towards the personal best (c1)."""
    c2: float = setting(default=2.0, low=0.0, source=_P2 + "; its listing has 1.5")
    """Acceleration towards the best of the swarm (c2)."""
    max_step: float = setting(default=0.1, low=0.0, source=_YARPIZ)
    """Longest step of a coordinate, as a share of the width of its bounds."""


@settings
class PsoChaotic(Optimizer):
    """Particles whose falling inertia is multiplied by a logistic map: P2 (13)-(17)."""

    moves = MoveParameters(kinds.PARTICLES, rule=kinds.CHAOTIC)

    inertia: float = setting(default=0.9, low=0.0, source=_P2)
    """Initial inertia."""
    min_inertia: float = setting(default=0.3, low=0.0, source=_P2)
    """Final inertia."""
    chaos: float = setting(
        default=0.3, low=0.0, high=1.0, source="P2 prints 3, outside the domain of the map"
    )
    """Initial state of the logistic map."""
    mu: float = setting(default=4.0, low=0.0, high=4.0, source=_P2)
    """Parameter of the logistic map."""
    c1: float = setting(default=2.0, low=0.0, source=_P2)
    """Acceleration towards the personal best (c1)."""
    c2: float = setting(default=2.0, low=0.0, source=_P2)
    """Acceleration towards the best of the swarm (c2)."""
    max_step: float = setting(default=0.1, low=0.0, source=_YARPIZ)
    """Longest step of a coordinate, as a share of the width of its bounds."""


@settings
class PsoVariable(Particles):
    """Particles whose inertia falls by a constant factor; c1 and c2 follow it: R1 (2.1)-(2.4)."""

    moves = MoveParameters(kinds.PARTICLES, rule=kinds.VARIABLE)

    inertia: float = setting(default=0.9, low=1e-3, source=_NOT_GIVEN)
    """Initial inertia."""
    min_inertia: float = setting(default=0.4, low=1e-3, source=_NOT_GIVEN)
    """Final inertia."""
    max_step: float = setting(default=0.16, low=0.0, source=_R1 + ": 4 m of 25 m")
    """Longest step of a coordinate, as a share of the width of its bounds."""


@settings
class PsoAdaptive(Particles):
    """Particles whose inertia follows the gain of the last move: R1 (2.5)-(2.6)."""

    moves = MoveParameters(kinds.PARTICLES, rule=kinds.ADAPTIVE)

    inertia: float = setting(default=0.9, low=0.0, source=_NOT_GIVEN)
    """Initial inertia."""
    min_inertia: float = setting(default=0.4, low=0.0, source=_NOT_GIVEN)
    """Final inertia."""
    c1: float = setting(default=2.05, low=0.0, source=_R1)
    """Acceleration towards the personal best (c1)."""
    c2: float = setting(default=2.05, low=0.0, source=_R1)
    """Acceleration towards the best of the swarm (c2)."""
    max_step: float = setting(default=0.16, low=0.0, source=_R1 + ": 4 m of 25 m")
    """Longest step of a coordinate, as a share of the width of its bounds."""


@settings
class Gwo(Optimizer):
    """Grey wolves (Mirjalili, Mirjalili and Lewis 2014)."""

    moves = MoveParameters(kinds.WOLVES)

    a: float = setting(default=2.0, low=0.0, source="Mirjalili et al. 2014")
    """Initial bound of the factor A; it falls to 0 over a run."""
    listed: bool = setting(default=False, source="Mirjalili et al. 2014; R1's listing: true")
    """Whether the wolves move as R1's listing has it: the leaders are the three best of the current
    positions, stay where they are, and share the factors A and C."""


@settings
class PsoGwo(Optimizer):
    """Particles fly; then wolves hunt from where the particles ended (R1)."""

    inertia: Literal["fixed", "variable", "adaptive"] = setting(
        default="adaptive", source="R1's best"
    )
    """How the inertia of the particles changes."""
    fixed: Pso = setting(
        default=Pso(inertia=0.9, damping=1.0, c1=2.05, c2=2.05, max_step=0.16), source=_R1
    )
    """Particles of a fixed inertia."""
    variable: PsoVariable = setting(default=PsoVariable(), source=_R1)
    """Particles of a variable inertia."""
    adaptive: PsoAdaptive = setting(default=PsoAdaptive(), source=_R1)
    """Particles of an adaptive inertia."""
    wolves: Gwo = setting(default=Gwo(), source=_R1)
    """The wolves."""
    particle_share: float = setting(
        default=0.5, low=0.01, high=0.99, source="R1, section 5.4: 150 of 300 iterations"
    )
    """Share of a run in which particles move; then wolves follow."""

    @property
    def parameters(self) -> MoveParameters:
        """The settings as kernels take them."""
        particles: Optimizer = getattr(self, self.inertia)
        return particles.parameters._replace(
            kind=kinds.PARTICLES_THEN_WOLVES, a=self.wolves.a, listed=self.wolves.listed,
            particle_share=self.particle_share,
        )  # fmt: skip


@settings
class Abc(Optimizer):
    """An artificial bee colony (Karaboga 2005); two moves are one cycle of it."""

    moves = MoveParameters(kinds.BEES)

    acceleration: float = setting(default=1.0, low=0.0, source=_YARPIZ)
    """Bound of a step, in differences of two sources."""
    trial_limit: float = setting(default=0.6, low=0.0, source=_YARPIZ)
    """Failed trials per coordinate and bee after which a source is left."""


@settings
class Firefly(Optimizer):
    """Fireflies that fly towards all brighter ones (Yang 2009), the best of old and new kept."""

    moves = MoveParameters(kinds.FIREFLIES)

    attraction: float = setting(default=2.0, low=0.0, source=_YARPIZ)
    """Attraction beta at distance 0."""
    absorption: float = setting(default=1.0, low=0.0, source=_YARPIZ)
    """Light absorption gamma, per square of the distance in diagonals of the bounds."""
    randomness: float = setting(default=0.2, low=0.0, source=_YARPIZ)
    """Initial factor alpha of the random step."""
    damping: float = setting(default=0.98, low=0.0, high=1.0, source=_YARPIZ)
    """Factor of the random step per move."""
    step: float = setting(default=0.05, low=0.0, source=_YARPIZ)
    """Random step, as a share of the width of the bounds."""


@settings
class Ga(Optimizer):
    """A real-coded genetic algorithm with roulette, the best of parents and children kept."""

    moves = MoveParameters(kinds.GENES)

    crossover_share: float = setting(
        default=0.73, low=0.0, high=1.0, source="Yarpiz: 0.8 n by crossover, 0.3 n mutants"
    )
    """Share of the children that have two parents; the others are mutants."""
    extension: float = setting(default=0.4, low=0.0, source=_YARPIZ)
    """How far beyond its parents a child may lie, as a share of their distance (gamma)."""
    mutation_rate: float = setting(default=0.1, low=0.0, high=1.0, source=_YARPIZ)
    """Probability that a coordinate of a mutant changes (mu)."""
    mutation_step: float = setting(default=0.1, low=0.0, source=_YARPIZ)
    """Standard deviation of a mutation, as a share of the width of the bounds (sigma)."""
    selection_pressure: float = setting(default=8.0, low=0.0, source=_YARPIZ)
    """Exponent beta of the roulette selection."""


@settings
class De(Optimizer):
    """Differential evolution, DE/rand/1/bin (Storn and Price 1997)."""

    moves = MoveParameters(kinds.DIFFERENCE)

    min_factor: float = setting(default=0.2, low=0.0, source=_YARPIZ)
    """Least differential weight F."""
    max_factor: float = setting(default=0.8, low=0.0, source=_YARPIZ)
    """Greatest differential weight F."""
    crossover_rate: float = setting(default=0.2, low=0.0, high=1.0, source=_YARPIZ)
    """Probability of a coordinate to come from the mutant (CR)."""
