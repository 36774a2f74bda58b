"""The swarm optimizers as settings; `planners.registries.OPTIMIZERS` names them.

`new_swarm` makes the memory of a swarm, the same record for all optimizers:

    memory = new_swarm(population, lower, upper)
    for t in range(iterations):
        population = optimizer.move(memory.positions, costs_of(memory.positions), memory.best,
                                    t / iterations, rng, memory)
"""

from __future__ import annotations

from typing import Final, Literal

from planners.swarm import moves as kinds
from planners.swarm.moves import MoveParameters, Optimizer, move
from planners.swarm.update_rules import (
    ADAPTIVE,
    CHAOTIC,
    DAMPED,
    VARIABLE,
    BeeParameters,
    DifferenceParameters,
    FireflyParameters,
    GeneticParameters,
    ParticleParameters,
)
from planners.swarm.woa import WhaleSettings
from wheelchair_gym.config import setting, settings

_WHALES = "Mirjalili and Lewis 2016"
_YARPIZ = "Yarpiz (program library)"
_P2 = "P2: Al-Nayar, Dagher and Hadi, results"
_NOT_GIVEN = "usual value, not given in R1"
_R1 = "R1: project report on PSO and GWO, section 5.4"


_NEIGHBOURS: Final = setting(
    default=0,
    doc="Neighbours on each side whose best a particle knows; 0 for the whole swarm.",
    source="design choice",
    low=0,
)
_INERTIA_RAMP: Final = setting(
    default=False,
    doc="Whether the inertia of way point j counts min(1, sqrt(j) / 4).",
    source="R1, section 5.7",
)


@settings
class Woa:
    """Whales (Mirjalili and Lewis 2016), with the thesis's thresholds mu and lambda."""

    a: float = setting(default=WhaleSettings.a, low=0.0, source=_WHALES)
    """Initial bound of the factor A; it falls to 0 over a run."""
    b: float = setting(default=WhaleSettings.b, source=_WHALES)
    """Shape of the logarithmic spiral."""
    mu: float = setting(default=WhaleSettings.mu, low=0.0, high=1.0, source=_WHALES)
    """Probability of a move other than the spiral."""
    lam: float = setting(default=WhaleSettings.lam, low=0.0, source=_WHALES)
    """Bound of |A| below which a whale encircles the best."""

    @property
    def parameters(self) -> MoveParameters:
        """The settings as kernels take them."""
        return MoveParameters(kinds.WHALES, a=self.a, b=self.b, mu=self.mu, lam=self.lam)

    move = move


@settings
class WoaModified:
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

    move = move


@settings
class Pso:
    """Particles whose inertia is damped: P2's PSO, or a fixed inertia at damping 1."""

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
    neighbours: int = _NEIGHBOURS
    inertia_ramp: bool = _INERTIA_RAMP

    @property
    def parameters(self) -> MoveParameters:
        """The settings as kernels take them."""
        inertia = self.inertia, self.inertia, self.damping
        pulls = self.c1, self.c2, self.max_step
        return MoveParameters(
            kinds.PARTICLES,
            particles=ParticleParameters(
                DAMPED, *inertia, *pulls, 0.0, 0.0, self.neighbours, self.inertia_ramp
            ),
        )

    move = move


@settings
class PsoChaotic:
    """Particles whose falling inertia is multiplied by a logistic map: P2 (13)-(17)."""

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

    @property
    def parameters(self) -> MoveParameters:
        """The settings as kernels take them."""
        inertia = self.inertia, self.min_inertia, 1.0
        pulls = self.c1, self.c2, self.max_step
        return MoveParameters(
            kinds.PARTICLES,
            particles=ParticleParameters(CHAOTIC, *inertia, *pulls, self.chaos, self.mu, 0, False),
        )

    move = move


@settings
class PsoVariable:
    """Particles whose inertia falls by a constant factor; c1 and c2 follow it: R1 (2.1)-(2.4)."""

    inertia: float = setting(default=0.9, low=1e-3, source=_NOT_GIVEN)
    """Initial inertia."""
    min_inertia: float = setting(default=0.4, low=1e-3, source=_NOT_GIVEN)
    """Final inertia."""
    max_step: float = setting(default=0.16, low=0.0, source=_R1 + ": 4 m of 25 m")
    """Longest step of a coordinate, as a share of the width of its bounds."""
    neighbours: int = _NEIGHBOURS
    inertia_ramp: bool = _INERTIA_RAMP

    @property
    def parameters(self) -> MoveParameters:
        """The settings as kernels take them."""
        particles = ParticleParameters(
            VARIABLE,
            self.inertia,
            self.min_inertia,
            1.0,
            0.0,
            0.0,
            self.max_step,
            0.0,
            0.0,
            self.neighbours,
            self.inertia_ramp,
        )
        return MoveParameters(kinds.PARTICLES, particles=particles)

    move = move


@settings
class PsoAdaptive:
    """Particles whose inertia follows the gain of the last move: R1 (2.5)-(2.6)."""

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
    neighbours: int = _NEIGHBOURS
    inertia_ramp: bool = _INERTIA_RAMP

    @property
    def parameters(self) -> MoveParameters:
        """The settings as kernels take them."""
        inertia = self.inertia, self.min_inertia, 1.0
        pulls = self.c1, self.c2, self.max_step
        return MoveParameters(
            kinds.PARTICLES,
            particles=ParticleParameters(
                ADAPTIVE, *inertia, *pulls, 0.0, 0.0, self.neighbours, self.inertia_ramp
            ),
        )

    move = move


@settings
class Gwo:
    """Grey wolves (Mirjalili, Mirjalili and Lewis 2014)."""

    a: float = setting(default=2.0, low=0.0, source="Mirjalili et al. 2014")
    """Initial bound of the factor A; it falls to 0 over a run."""

    @property
    def parameters(self) -> MoveParameters:
        """The settings as kernels take them."""
        return MoveParameters(kinds.WOLVES, a=self.a)

    move = move


@settings
class PsoGwo:
    """Particles fly, then wolves hunt from where these ended (R1)."""

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
        particles: dict[str, Optimizer] = {
            "fixed": self.fixed,
            "variable": self.variable,
            "adaptive": self.adaptive,
        }
        return MoveParameters(
            kinds.PARTICLES_THEN_WOLVES,
            a=self.wolves.a,
            particle_share=self.particle_share,
            particles=particles[self.inertia].parameters.particles,
        )

    move = move


@settings
class Abc:
    """An artificial bee colony (Karaboga 2005); two moves are one cycle of it."""

    acceleration: float = setting(default=1.0, low=0.0, source=_YARPIZ)
    """Bound of a step, in differences of two sources."""
    trial_limit: float = setting(default=0.6, low=0.0, source=_YARPIZ)
    """Failed trials per coordinate and bee after which a source is left."""

    @property
    def parameters(self) -> MoveParameters:
        """The settings as kernels take them."""
        return MoveParameters(kinds.BEES, bees=BeeParameters(self.acceleration, self.trial_limit))

    move = move


@settings
class Firefly:
    """Fireflies that fly towards all brighter ones (Yang 2009), the best of old and new kept."""

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

    @property
    def parameters(self) -> MoveParameters:
        """The settings as kernels take them."""
        values = self.attraction, self.absorption, self.randomness, self.damping, self.step
        return MoveParameters(kinds.FIREFLIES, fireflies=FireflyParameters(*values))

    move = move


@settings
class Ga:
    """A real-coded genetic algorithm with roulette, the best of parents and children kept."""

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

    @property
    def parameters(self) -> MoveParameters:
        """The settings as kernels take them."""
        values = (
            self.crossover_share,
            self.extension,
            self.mutation_rate,
            self.mutation_step,
            self.selection_pressure,
        )
        return MoveParameters(kinds.GENES, genes=GeneticParameters(*values))

    move = move


@settings
class De:
    """Differential evolution, DE/rand/1/bin (Storn and Price 1997)."""

    min_factor: float = setting(default=0.2, low=0.0, source=_YARPIZ)
    """Least differential weight F."""
    max_factor: float = setting(default=0.8, low=0.0, source=_YARPIZ)
    """Greatest differential weight F."""
    crossover_rate: float = setting(default=0.2, low=0.0, high=1.0, source=_YARPIZ)
    """Probability of a coordinate to come from the mutant (CR)."""

    @property
    def parameters(self) -> MoveParameters:
        """The settings as kernels take them."""
        return MoveParameters(
            kinds.DIFFERENCE,
            difference=DifferenceParameters(self.min_factor, self.max_factor, self.crossover_rate),
        )

    move = move
