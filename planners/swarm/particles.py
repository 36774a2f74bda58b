"""Particle swarms as settings: one class for each rule of the inertia."""

from __future__ import annotations

from planners.swarm import moves as kinds
from planners.swarm.moves import Moves, move
from planners.swarm.pso import ADAPTIVE, CHAOTIC, DAMPED, VARIABLE, Flight
from wheelchair_gym.config import setting, settings

_YARPIZ = "Yarpiz"
_P2 = "P2: Al-Nayar, Dagher and Hadi, results"
_R1 = "R1: project report on PSO and GWO, section 5.4"
_NOT_GIVEN = "not given in R1; usual"


@settings
class Pso:
    """Particles whose inertia is damped: P2's PSO, or a fixed inertia at damping 1."""

    inertia: float = setting(default=1.0, source=_P2 + ", as its listing", low=0.0)
    damping: float = setting(default=0.98, source=_P2, low=0.0, high=1.0)
    own: float = setting(default=2.0, source=_P2 + "; its listing has 1.5", low=0.0)
    best: float = setting(default=2.0, source=_P2 + "; its listing has 1.5", low=0.0)
    speed: float = setting(
        default=0.1, source=_YARPIZ + ": longest step, as a part of the bounds' width", low=0.0
    )
    ring: int = setting(default=0, source="neighbours on each side that are heard; 0: all", low=0)
    ramp: bool = setting(default=False, source="R1, section 5.7: min(1, sqrt(j) / 4)")

    @property
    def moves(self) -> Moves:
        """The settings as kernels take them."""
        inertia = self.inertia, self.inertia, self.damping
        pulls = self.own, self.best, self.speed
        return Moves(
            kinds.PARTICLES, flight=Flight(DAMPED, *inertia, *pulls, 0.0, 0.0, self.ring, self.ramp)
        )

    move = move


@settings
class PsoChaotic:
    """Particles whose falling inertia is multiplied by a logistic map: P2 (13)-(17)."""

    inertia: float = setting(default=0.9, source=_P2, low=0.0)
    least_inertia: float = setting(default=0.3, source=_P2, low=0.0)
    chaos: float = setting(
        default=0.3, source="P2 has 3, which the map does not allow", low=0.0, high=1.0
    )
    mu: float = setting(default=4.0, source=_P2, low=0.0, high=4.0)
    own: float = setting(default=2.0, source=_P2, low=0.0)
    best: float = setting(default=2.0, source=_P2, low=0.0)
    speed: float = setting(
        default=0.1, source=_YARPIZ + ": longest step, as a part of the bounds' width", low=0.0
    )

    @property
    def moves(self) -> Moves:
        """The settings as kernels take them."""
        inertia = self.inertia, self.least_inertia, 1.0
        pulls = self.own, self.best, self.speed
        return Moves(
            kinds.PARTICLES,
            flight=Flight(CHAOTIC, *inertia, *pulls, self.chaos, self.mu, 0, False),
        )

    move = move


@settings
class PsoVariable:
    """Particles whose inertia falls by a constant factor; c1 and c2 follow it: R1 (2.1)-(2.4)."""

    inertia: float = setting(default=0.9, source=_NOT_GIVEN, low=1e-3)
    least_inertia: float = setting(default=0.4, source=_NOT_GIVEN, low=1e-3)
    speed: float = setting(default=0.16, source=_R1 + ": 4 m of 25 m", low=0.0)
    ring: int = setting(default=0, source="neighbours on each side that are heard; 0: all", low=0)
    ramp: bool = setting(default=False, source="R1, section 5.7: min(1, sqrt(j) / 4)")

    @property
    def moves(self) -> Moves:
        """The settings as kernels take them."""
        flight = Flight(
            VARIABLE,
            self.inertia,
            self.least_inertia,
            1.0,
            0.0,
            0.0,
            self.speed,
            0.0,
            0.0,
            self.ring,
            self.ramp,
        )
        return Moves(kinds.PARTICLES, flight=flight)

    move = move


@settings
class PsoAdaptive:
    """Particles whose inertia follows the gain of the last move: R1 (2.5)-(2.6)."""

    inertia: float = setting(default=0.9, source=_NOT_GIVEN, low=0.0)
    least_inertia: float = setting(default=0.4, source=_NOT_GIVEN, low=0.0)
    own: float = setting(default=2.05, source=_R1, low=0.0)
    best: float = setting(default=2.05, source=_R1, low=0.0)
    speed: float = setting(default=0.16, source=_R1 + ": 4 m of 25 m", low=0.0)
    ring: int = setting(default=0, source="neighbours on each side that are heard; 0: all", low=0)
    ramp: bool = setting(default=False, source="R1, section 5.7: min(1, sqrt(j) / 4)")

    @property
    def moves(self) -> Moves:
        """The settings as kernels take them."""
        inertia = self.inertia, self.least_inertia, 1.0
        pulls = self.own, self.best, self.speed
        return Moves(
            kinds.PARTICLES,
            flight=Flight(ADAPTIVE, *inertia, *pulls, 0.0, 0.0, self.ring, self.ramp),
        )

    move = move
