"""The optimisers as settings: `OPTIMIZERS` names them.

Each says how a swarm moves; how many move and for how long is said by who uses it. `begin` makes
what a swarm remembers, and one record serves all of them:

    memory = begin(population, lower, upper)
    for t in range(iterations):
        population = optimizer.move(memory.positions, costs_of(memory.positions), memory.best,
                                    t / iterations, rng, memory)
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final, Literal

from planners.swarm import moves as kinds
from planners.swarm.evolution import Difference, Genes
from planners.swarm.foragers import Bees, Fireflies
from planners.swarm.moves import Moves, Optimizer, move
from planners.swarm.particles import Pso, PsoAdaptive, PsoChaotic, PsoVariable
from planners.swarm.state import Swarm, begin
from planners.swarm.woa import WhaleSettings
from wheelchair_gym.config import InputError, dump, load, setting, settings

__all__ = ["OPTIMIZERS", "Moves", "Optimizer", "Swarm", "begin", "make_optimizer"]

_WHALES = "as WhaleSettings"
_YARPIZ = "Yarpiz"
_R1 = "R1: project report on PSO and GWO, section 5.4"


@settings
class Woa:
    """Whales (Mirjalili and Lewis 2016), with the thesis's thresholds mu and lambda."""

    a: float = setting(default=WhaleSettings.a, source=_WHALES, low=0.0)
    b: float = setting(default=WhaleSettings.b, source=_WHALES)
    mu: float = setting(default=WhaleSettings.mu, source=_WHALES, low=0.0, high=1.0)
    lam: float = setting(default=WhaleSettings.lam, source=_WHALES, low=0.0)

    @property
    def moves(self) -> Moves:
        """The settings as kernels take them."""
        return Moves(kinds.WHALES, a=self.a, b=self.b, mu=self.mu, lam=self.lam)

    move = move


@settings
class WoaModified:
    """Whales whose factor C counts where the best path is free: P1 (17)-(19).

    C lies in [0, w], w = 1 where a way point of the best path is free and 0 where it is occupied;
    a map of free and solid has no third case.
    """

    whales: Woa = setting(default=Woa(), source="P1: as WOA")

    @property
    def moves(self) -> Moves:
        """The settings as kernels take them."""
        return self.whales.moves._replace(span=1.0, by_occupancy=True)

    move = move


@settings
class Gwo:
    """Grey wolves (Mirjalili, Mirjalili and Lewis 2014)."""

    a: float = setting(default=2.0, source="Mirjalili et al. 2014: falls from 2 to 0", low=0.0)

    @property
    def moves(self) -> Moves:
        """The settings as kernels take them."""
        return Moves(kinds.WOLVES, a=self.a)

    move = move


@settings
class PsoGwo:
    """Particles fly, then wolves hunt from where these ended (R1)."""

    inertia: Literal["fixed", "variable", "adaptive"] = setting(
        default="adaptive", source="R1's best"
    )
    fixed: Pso = setting(
        default=Pso(inertia=0.9, damping=1.0, own=2.05, best=2.05, speed=0.16), source=_R1
    )
    variable: PsoVariable = setting(default=PsoVariable(), source=_R1)
    adaptive: PsoAdaptive = setting(default=PsoAdaptive(), source=_R1)
    wolves: Gwo = setting(default=Gwo(), source=_R1)
    share: float = setting(default=0.5, source=_R1 + ": 150 iterations each", low=0.01, high=0.99)

    @property
    def moves(self) -> Moves:
        """The settings as kernels take them."""
        particles: dict[str, Optimizer] = {
            "fixed": self.fixed,
            "variable": self.variable,
            "adaptive": self.adaptive,
        }
        return Moves(
            kinds.PARTICLES_THEN_WOLVES,
            a=self.wolves.a,
            share=self.share,
            flight=particles[self.inertia].moves.flight,
        )

    move = move


@settings
class Abc:
    """An artificial bee colony (Karaboga 2005); two moves are one cycle of it."""

    reach: float = setting(default=1.0, source=_YARPIZ + ": acceleration", low=0.0)
    patience: float = setting(
        default=0.6, source=_YARPIZ + ": vain trials per coordinate and bee", low=0.0
    )

    @property
    def moves(self) -> Moves:
        """The settings as kernels take them."""
        return Moves(kinds.BEES, bees=Bees(self.reach, self.patience))

    move = move


@settings
class Firefly:
    """Fireflies that fly towards all brighter ones (Yang 2009), the best of old and new kept."""

    attraction: float = setting(default=2.0, source=_YARPIZ + ": beta0", low=0.0)
    absorption: float = setting(default=1.0, source=_YARPIZ + ": gamma", low=0.0)
    randomness: float = setting(default=0.2, source=_YARPIZ + ": alpha", low=0.0)
    damping: float = setting(default=0.98, source=_YARPIZ, low=0.0, high=1.0)
    step: float = setting(default=0.05, source=_YARPIZ + ": of the bounds' width", low=0.0)

    @property
    def moves(self) -> Moves:
        """The settings as kernels take them."""
        values = self.attraction, self.absorption, self.randomness, self.damping, self.step
        return Moves(kinds.FIREFLIES, fireflies=Fireflies(*values))

    move = move


@settings
class Ga:
    """A real-coded genetic algorithm with roulette, the best of parents and children kept."""

    crossed: float = setting(
        default=0.73, source=_YARPIZ + ": 0.8 n by crossover, 0.3 n mutants", low=0.0, high=1.0
    )
    extension: float = setting(default=0.4, source=_YARPIZ + ": gamma", low=0.0)
    mutated: float = setting(default=0.1, source=_YARPIZ + ": mu", low=0.0, high=1.0)
    step: float = setting(default=0.1, source=_YARPIZ + ": sigma", low=0.0)
    pressure: float = setting(default=8.0, source=_YARPIZ + ": beta", low=0.0)

    @property
    def moves(self) -> Moves:
        """The settings as kernels take them."""
        values = self.crossed, self.extension, self.mutated, self.step, self.pressure
        return Moves(kinds.GENES, genes=Genes(*values))

    move = move


@settings
class De:
    """Differential evolution, DE/rand/1/bin (Storn and Price 1997)."""

    least: float = setting(default=0.2, source=_YARPIZ + ": least F", low=0.0)
    most: float = setting(default=0.8, source=_YARPIZ + ": greatest F", low=0.0)
    crossed: float = setting(default=0.2, source=_YARPIZ + ": CR", low=0.0, high=1.0)

    @property
    def moves(self) -> Moves:
        """The settings as kernels take them."""
        return Moves(kinds.DIFFERENCE, difference=Difference(self.least, self.most, self.crossed))

    move = move


OPTIMIZERS: Final[dict[str, type[Any]]] = {
    "abc": Abc,
    "de": De,
    "firefly": Firefly,
    "ga": Ga,
    "gwo": Gwo,
    "pso": Pso,
    "pso_adaptive": PsoAdaptive,
    "pso_chaotic": PsoChaotic,
    "pso_gwo": PsoGwo,
    "pso_variable": PsoVariable,
    "woa": Woa,
    "woa_modified": WoaModified,
}


def named(spec: Any, registry: Mapping[str, type[Any]], what: str) -> dict[str, Any]:
    """A name, or an object with a name and settings, or such settings themselves, as an object.

    Raises:
        InputError: it is none of these, or the name is unknown.
    """
    names = {cls: name for name, cls in registry.items()}
    if type(spec) in names:
        return {"name": names[type(spec)], **dump(spec)}
    if not isinstance(spec, str | Mapping):
        raise InputError(f"{what} is {spec!r}; expected a name or an object with a name")
    values = {"name": spec} if isinstance(spec, str) else dict(spec)
    if values.get("name") not in registry:
        known = ", ".join(sorted(registry))
        raise InputError(f"{what} {values.get('name')!r} is unknown; there are {known}")
    return values


def make_optimizer(spec: Any) -> Any:
    """An optimiser by name, or by a mapping with its name and settings; an optimiser is itself.

    Raises:
        InputError: the name is unknown, or a setting is not one of the optimiser's.
    """
    if type(spec) in OPTIMIZERS.values():
        return spec
    values = named(spec, OPTIMIZERS, "optimizer")
    name = values.pop("name")
    return load(OPTIMIZERS[name], values, f"optimizer {name}")
