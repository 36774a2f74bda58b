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

    a: float = setting(
        default=WhaleSettings.a,
        doc="Initial bound of the factor A; it falls to 0 over a run.",
        source=_WHALES,
        low=0.0,
    )
    b: float = setting(
        default=WhaleSettings.b, doc="Shape of the logarithmic spiral.", source=_WHALES
    )
    mu: float = setting(
        default=WhaleSettings.mu,
        doc="Probability of a move other than the spiral.",
        source=_WHALES,
        low=0.0,
        high=1.0,
    )
    lam: float = setting(
        default=WhaleSettings.lam,
        doc="Bound of |A| below which a whale encircles the best.",
        source=_WHALES,
        low=0.0,
    )

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

    whales: Woa = setting(
        default=Woa(), doc="The whales, but for the factor C.", source="P1: as WOA"
    )

    @property
    def parameters(self) -> MoveParameters:
        """The settings as kernels take them."""
        return self.whales.parameters._replace(c_range=1.0, by_occupancy=True)

    move = move


@settings
class Pso:
    """Particles whose inertia is damped: P2's PSO, or a fixed inertia at damping 1."""

    inertia: float = setting(
        default=1.0, doc="Initial inertia.", source=_P2 + ", its listing", low=0.0
    )
    damping: float = setting(
        default=0.98, doc="Factor of the inertia per move.", source=_P2, low=0.0, high=1.0
    )
    c1: float = setting(
        default=2.0,
        doc="Acceleration towards the personal best (c1).",
        source=_P2 + "; its listing has 1.5",
        low=0.0,
    )
    c2: float = setting(
        default=2.0,
        doc="Acceleration towards the best of the swarm (c2).",
        source=_P2 + "; its listing has 1.5",
        low=0.0,
    )
    max_step: float = setting(
        default=0.1,
        doc="Longest step of a coordinate, as a share of the width of its bounds.",
        source=_YARPIZ,
        low=0.0,
    )
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

    inertia: float = setting(default=0.9, doc="Initial inertia.", source=_P2, low=0.0)
    min_inertia: float = setting(default=0.3, doc="Final inertia.", source=_P2, low=0.0)
    chaos: float = setting(
        default=0.3,
        doc="Initial state of the logistic map.",
        source="P2 prints 3, outside the domain of the map",
        low=0.0,
        high=1.0,
    )
    mu: float = setting(
        default=4.0, doc="Parameter of the logistic map.", source=_P2, low=0.0, high=4.0
    )
    c1: float = setting(
        default=2.0, doc="Acceleration towards the personal best (c1).", source=_P2, low=0.0
    )
    c2: float = setting(
        default=2.0, doc="Acceleration towards the best of the swarm (c2).", source=_P2, low=0.0
    )
    max_step: float = setting(
        default=0.1,
        doc="Longest step of a coordinate, as a share of the width of its bounds.",
        source=_YARPIZ,
        low=0.0,
    )

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

    inertia: float = setting(default=0.9, doc="Initial inertia.", source=_NOT_GIVEN, low=1e-3)
    min_inertia: float = setting(default=0.4, doc="Final inertia.", source=_NOT_GIVEN, low=1e-3)
    max_step: float = setting(
        default=0.16,
        doc="Longest step of a coordinate, as a share of the width of its bounds.",
        source=_R1 + ": 4 m of 25 m",
        low=0.0,
    )
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

    inertia: float = setting(default=0.9, doc="Initial inertia.", source=_NOT_GIVEN, low=0.0)
    min_inertia: float = setting(default=0.4, doc="Final inertia.", source=_NOT_GIVEN, low=0.0)
    c1: float = setting(
        default=2.05, doc="Acceleration towards the personal best (c1).", source=_R1, low=0.0
    )
    c2: float = setting(
        default=2.05, doc="Acceleration towards the best of the swarm (c2).", source=_R1, low=0.0
    )
    max_step: float = setting(
        default=0.16,
        doc="Longest step of a coordinate, as a share of the width of its bounds.",
        source=_R1 + ": 4 m of 25 m",
        low=0.0,
    )
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

    a: float = setting(
        default=2.0,
        doc="Initial bound of the factor A; it falls to 0 over a run.",
        source="Mirjalili et al. 2014",
        low=0.0,
    )

    @property
    def parameters(self) -> MoveParameters:
        """The settings as kernels take them."""
        return MoveParameters(kinds.WOLVES, a=self.a)

    move = move


@settings
class PsoGwo:
    """Particles fly, then wolves hunt from where these ended (R1)."""

    inertia: Literal["fixed", "variable", "adaptive"] = setting(
        default="adaptive", doc="How the inertia of the particles changes.", source="R1's best"
    )
    fixed: Pso = setting(
        default=Pso(inertia=0.9, damping=1.0, c1=2.05, c2=2.05, max_step=0.16),
        doc="Particles of a fixed inertia.",
        source=_R1,
    )
    variable: PsoVariable = setting(
        default=PsoVariable(), doc="Particles of a variable inertia.", source=_R1
    )
    adaptive: PsoAdaptive = setting(
        default=PsoAdaptive(), doc="Particles of an adaptive inertia.", source=_R1
    )
    wolves: Gwo = setting(default=Gwo(), doc="The wolves.", source=_R1)
    particle_share: float = setting(
        default=0.5,
        doc="Share of a run in which particles move; then wolves follow.",
        source="R1, section 5.4: 150 of 300 iterations",
        low=0.01,
        high=0.99,
    )

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

    acceleration: float = setting(
        default=1.0, doc="Bound of a step, in differences of two sources.", source=_YARPIZ, low=0.0
    )
    trial_limit: float = setting(
        default=0.6,
        doc="Failed trials per coordinate and bee after which a source is left.",
        source=_YARPIZ,
        low=0.0,
    )

    @property
    def parameters(self) -> MoveParameters:
        """The settings as kernels take them."""
        return MoveParameters(kinds.BEES, bees=BeeParameters(self.acceleration, self.trial_limit))

    move = move


@settings
class Firefly:
    """Fireflies that fly towards all brighter ones (Yang 2009), the best of old and new kept."""

    attraction: float = setting(
        default=2.0, doc="Attraction beta at distance 0.", source=_YARPIZ, low=0.0
    )
    absorption: float = setting(
        default=1.0,
        doc="Light absorption gamma, per square of the distance in diagonals of the bounds.",
        source=_YARPIZ,
        low=0.0,
    )
    randomness: float = setting(
        default=0.2, doc="Initial factor alpha of the random step.", source=_YARPIZ, low=0.0
    )
    damping: float = setting(
        default=0.98, doc="Factor of the random step per move.", source=_YARPIZ, low=0.0, high=1.0
    )
    step: float = setting(
        default=0.05,
        doc="Random step, as a share of the width of the bounds.",
        source=_YARPIZ,
        low=0.0,
    )

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
        default=0.73,
        doc="Share of the children that have two parents; the others are mutants.",
        source="Yarpiz: 0.8 n by crossover, 0.3 n mutants",
        low=0.0,
        high=1.0,
    )
    extension: float = setting(
        default=0.4,
        doc="How far beyond its parents a child may lie, as a share of their distance (gamma).",
        source=_YARPIZ,
        low=0.0,
    )
    mutation_rate: float = setting(
        default=0.1,
        doc="Probability that a coordinate of a mutant changes (mu).",
        source=_YARPIZ,
        low=0.0,
        high=1.0,
    )
    mutation_step: float = setting(
        default=0.1,
        doc="Standard deviation of a mutation, as a share of the width of the bounds (sigma).",
        source=_YARPIZ,
        low=0.0,
    )
    selection_pressure: float = setting(
        default=8.0, doc="Exponent beta of the roulette selection.", source=_YARPIZ, low=0.0
    )

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

    min_factor: float = setting(
        default=0.2, doc="Least differential weight F.", source=_YARPIZ, low=0.0
    )
    max_factor: float = setting(
        default=0.8, doc="Greatest differential weight F.", source=_YARPIZ, low=0.0
    )
    crossover_rate: float = setting(
        default=0.2,
        doc="Probability of a coordinate to come from the mutant (CR).",
        source=_YARPIZ,
        low=0.0,
        high=1.0,
    )

    @property
    def parameters(self) -> MoveParameters:
        """The settings as kernels take them."""
        return MoveParameters(
            kinds.DIFFERENCE,
            difference=DifferenceParameters(self.min_factor, self.max_factor, self.crossover_rate),
        )

    move = move
