"""The swarm optimizers as settings; `planners.registries.OPTIMIZERS` names them."""

from __future__ import annotations

from typing import ClassVar, Literal

from planners.problem import with_settings
from planners.rrt_star_woa.woa import WhaleMoves, WhaleParameters
from planners.swarm import optimizers as kinds
from planners.swarm.optimizers import MoveParameters
from wheelchair_gym.config import setting, settings

_YARPIZ = "Yarpiz (program library)"
_P2 = "P2: Al-Nayar, Dagher and Hadi, results"
_NOT_GIVEN = "usual value, not given in R1"
_R1 = "R1: project report on PSO and GWO, section 5.4"


class Optimizer:
    """Settings of the moves of a swarm."""

    moves: ClassVar[MoveParameters]  # the kind of moves, before the settings

    @property
    def parameters(self) -> MoveParameters:
        """The settings as kernels take them."""
        return with_settings(self.moves, self)


@settings
class Woa(WhaleMoves, Optimizer):
    """Whales (Mirjalili and Lewis 2016), with the thesis's thresholds mu and lambda."""

    @property
    def parameters(self) -> MoveParameters:
        """The settings as kernels take them."""
        latest = self.leader == "latest"
        whales = WhaleParameters(0, 0, self.a, self.b, self.mu, self.lam, latest)
        return MoveParameters(kinds.WHALES, whales)


@settings
class WoaModified(Optimizer):
    """Whales whose factor C counts where the best path is free: P1 (17)-(19).

    C lies in [0, w], w = 1 where a way point of the best path is free and 0 where it is occupied;
    a map of free and solid has no third case.
    """

    whales: Woa = setting(default=Woa(), source="P1: as WOA")
    """The moves of the whales, the factor C apart."""

    @property
    def parameters(self) -> MoveParameters:
        """The settings as kernels take them."""
        return self.whales.parameters._replace(by_occupancy=True)


@settings
class Particles(Optimizer):
    """Settings that the particle swarms of R1 and P2 share."""

    neighbours: int = setting(default=0, low=0, source="design choice")
    """Neighbours on each side whose best a particle knows; 0 for the whole swarm."""
    inertia_ramp: bool = setting(default=False, source="R1, section 5.7")
    """Whether the inertia of way point j counts min(1, sqrt(j) / 4)."""


@settings
class Acceleration:
    """Acceleration of particles: P2's results have 2, its listings 1.5."""

    c1: float = setting(default=2.0, low=0.0, source=_P2)
    """Acceleration towards the personal best (c1)."""
    c2: float = setting(default=2.0, low=0.0, source=_P2)
    """Acceleration towards the best of the swarm (c2)."""


@settings
class Pso(Acceleration, Particles):
    """Particles whose inertia is damped: P2's PSO, or a fixed inertia at damping 1."""

    moves = MoveParameters(kinds.PARTICLES, rule=kinds.DAMPED)

    inertia: float = setting(default=1.0, low=0.0, source=_P2 + ", its listing")
    """Initial inertia."""
    damping: float = setting(default=0.98, low=0.0, high=1.0, source=_P2)
    """Factor of the inertia per move."""
    max_step: float = setting(default=0.1, low=0.0, source=_YARPIZ)
    """Longest step of a coordinate, as a share of the width of its bounds."""


@settings
class PsoChaotic(Acceleration, Optimizer):
    """Particles whose falling inertia is multiplied by a logistic map: P2 (13)-(17)."""

    # P2's values, except for the longest step, which is Yarpiz's.
    moves = MoveParameters(
        kinds.PARTICLES, rule=kinds.CHAOTIC, inertia=0.9, min_inertia=0.3, max_step=0.1
    )


@settings
class PsoVariable(Particles):
    """Particles whose inertia falls by a constant factor; c1 and c2 follow it: R1 (2.1)-(2.4)."""

    # The inertia's usual values, not given in R1; the longest step is R1's 4 m of 25 m.
    moves = MoveParameters(
        kinds.PARTICLES, rule=kinds.VARIABLE, inertia=0.9, min_inertia=0.4, max_step=0.16
    )


@settings
class PsoAdaptive(Particles):
    """Particles whose inertia follows the gain of the last move: R1 (2.5)-(2.6)."""

    # R1, section 5.4; the longest step is 4 m of 25 m.
    moves = MoveParameters(kinds.PARTICLES, rule=kinds.ADAPTIVE, c1=2.05, c2=2.05, max_step=0.16)

    inertia: float = setting(default=0.9, low=0.0, source=_NOT_GIVEN)
    """Initial inertia."""
    min_inertia: float = setting(default=0.4, low=0.0, source=_NOT_GIVEN)
    """Final inertia."""


@settings
class Gwo(Optimizer):
    """Grey wolves (Mirjalili, Mirjalili and Lewis 2014)."""

    moves = MoveParameters(kinds.WOLVES)

    listed: bool = setting(default=False, source="Mirjalili et al. 2014; R1's listing: true")
    """Whether the wolves move as R1's listing has it: the leaders are the three best of the current
    positions, stay where they are, and share the factors A and C."""


@settings
class PsoGwo(Optimizer):
    """Particles fly; then wolves hunt from where the particles ended (R1)."""

    inertia: Literal["fixed", "adaptive"] = setting(default="adaptive", source="R1's best")
    """The change of the inertia of the particles."""
    fixed: Pso = setting(
        default=Pso(inertia=0.9, damping=1.0, c1=2.05, c2=2.05, max_step=0.16), source=_R1
    )
    """Particles of a fixed inertia."""
    adaptive: PsoAdaptive = setting(default=PsoAdaptive(), source=_R1)
    """Particles of an adaptive inertia."""
    wolves: Gwo = setting(default=Gwo(), source=_R1)
    """The wolves."""

    @property
    def parameters(self) -> MoveParameters:
        """The settings as kernels take them."""
        particles: Optimizer = getattr(self, self.inertia)
        return particles.parameters._replace(
            kind=kinds.PARTICLES_THEN_WOLVES, listed=self.wolves.listed
        )


@settings
class Abc(Optimizer):
    """An artificial bee colony (Karaboga 2005); two moves are one cycle of it."""

    moves = MoveParameters(kinds.BEES)


@settings
class Firefly(Optimizer):
    """Fireflies that fly towards all brighter ones (Yang 2009), the best of old and new kept."""

    moves = MoveParameters(kinds.FIREFLIES, damping=0.98)
