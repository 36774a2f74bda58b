"""Moves of swarms: the memory of a swarm, the update rule of every optimizer, and the settings.

A swarm holds positions to be evaluated. `store` replaces a remembered position by a better one:
the personal best of a particle, a food source of bees, or a firefly. The optimizers are at the
end; `planners.registries.OPTIMIZERS` names them.
"""

import math
from typing import Any, ClassVar, Final, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from planners.problem import with_settings
from planners.rrt_star_woa.woa import WhaleMoves, WhaleParameters, Whales, move
from wheelchair_gym.base.arrays import Array
from wheelchair_gym.base.settings import setting, settings
from wheelchair_gym.compiled.kernel import borrowing_kernel
from wheelchair_gym.compiled.random import Stream, next_uniform

MIN_POPULATION = 4  # positions: three wolves lead, and others follow
WORST = -1  # target of a position that competes with the worst remembered one

RECORD: Final = np.dtype(
    [
        ("move_count", "i8"),  # moves made
        ("previous_best_cost", "f8"),  # cost of the best position one move ago
        ("chaos", "f8"),  # state of the logistic map
    ]
)


class Swarm(NamedTuple):
    """Positions to be evaluated next, and the memory of the swarm."""

    positions: Array  # (k, d)
    costs: Array  # (k,) of the positions, as far as they were evaluated
    velocities: Array  # (k, d) per move
    personal_best: Array  # (k, d) remembered positions: personal bests, food sources, parents
    personal_best_costs: Array  # (k,)
    targets: NDArray[np.int64]  # (k,) which remembered position each competes with, or WORST
    trials: NDArray[np.int64]  # (k,) failed ones since each was remembered
    best: Array  # (d,) of all positions evaluated so far
    best_cost: Array  # (1,)
    c_range: Array  # (d,) bound of the whales' factor C
    lower: Array  # (d,) bounds of the positions
    upper: Array  # (d,)
    fixed: NDArray[np.bool_]  # (k, d) coordinates that particles leave where they are
    record: Any  # (1,) RECORD


def new_swarm(population: ArrayLike, lower: ArrayLike, upper: ArrayLike) -> Swarm:
    """Return a swarm at given positions, for any optimizer.

    Args:
        population: (k, d); copied. All optimizers but whales need `MIN_POPULATION`.
        lower: lower bounds of the positions, a number or (d,); may be infinite.
        upper: upper bounds, likewise.
    """
    positions = np.array(population, dtype=np.float64)
    k, d = positions.shape
    low, high = (np.array(np.broadcast_to(np.asarray(b, np.float64), d)) for b in (lower, upper))
    record = np.zeros(1, RECORD)
    record["previous_best_cost"] = np.inf
    return Swarm(
        positions=positions,
        costs=np.full(k, np.inf),
        velocities=np.zeros((k, d)),
        personal_best=positions.copy(),
        personal_best_costs=np.full(k, np.inf),
        targets=np.arange(k),
        trials=np.zeros(k, np.int64),
        best=positions[0].copy(),
        best_cost=np.full(1, np.inf),
        c_range=np.full(d, 2.0),
        lower=low,
        upper=high,
        fixed=np.zeros((k, d), np.bool_),
        record=record,
    )


@borrowing_kernel
def competitor(swarm: Swarm, i: int) -> int:
    """Return the remembered position that position i competes with."""
    target = swarm.targets[i]
    if target != WORST:
        return int(target)
    return int(np.argmax(swarm.personal_best_costs))


@borrowing_kernel
def store(swarm: Swarm, i: int, j: int) -> None:
    """Replace the remembered position j, and perhaps the best, by position i, which costs less."""
    cost = swarm.costs[i]
    swarm.personal_best_costs[j] = cost
    swarm.trials[j] = 0
    for c in range(swarm.positions.shape[1]):
        swarm.personal_best[j, c] = swarm.positions[i, c]
    if cost < swarm.best_cost[0]:
        swarm.best_cost[0] = cost
        for c in range(swarm.positions.shape[1]):
            swarm.best[c] = swarm.positions[i, c]


@borrowing_kernel
def clip_to_bounds(swarm: Swarm) -> None:
    """Clip every position to the bounds; a velocity that led out changes its sign."""
    k, d = swarm.positions.shape
    for i in range(k):
        for c in range(d):
            x = min(max(swarm.positions[i, c], swarm.lower[c]), swarm.upper[c])
            if x != swarm.positions[i, c]:
                swarm.positions[i, c] = x
                swarm.velocities[i, c] = -swarm.velocities[i, c]


@borrowing_kernel
def bound_width(swarm: Swarm, c: int) -> float:
    """Return the width of a coordinate's bounds; 1 where they are infinite."""
    width = swarm.upper[c] - swarm.lower[c]
    return width if width < math.inf else 1.0


WHALES, PARTICLES, WOLVES, PARTICLES_THEN_WOLVES, BEES, FIREFLIES = range(6)
DAMPED, CHAOTIC, VARIABLE, ADAPTIVE = range(4)


class MoveParameters(NamedTuple):
    """An optimizer as kernels take it; fields named as one of its settings have its value."""

    kind: int  # the rule that moves the swarm: WHALES, PARTICLES, ...
    whales: WhaleParameters = WhaleParameters(0, 0, 2.0, 1.0, 0.5, 1.0)
    by_occupancy: bool = False  # C of the whales is in [0, 1], 0 where the best path is not free
    listed: bool = False  # wolves as R1's listing has them
    rule: int = DAMPED  # of the inertia: DAMPED, CHAOTIC, VARIABLE or ADAPTIVE
    inertia: float = 1.0
    min_inertia: float = 1.0
    damping: float = 1.0  # factor per move of the inertia, or of the fireflies' random step
    c1: float = 2.0
    c2: float = 2.0
    max_step: float = 0.1
    neighbours: int = 0
    inertia_ramp: bool = False


# Of the logistic map: its initial state (P2 prints 3, outside the map's domain) and its parameter.
CHAOS, CHAOS_RATE = 0.3, 4.0
PARTICLE_SHARE = 0.5  # of a run, before wolves follow: 150 of 300 iterations (R1, section 5.4)
WOLF_RANGE = 2.0  # initial bound of the wolves' factor A
# The constants of the other optimizers are those of the program library Yarpiz.
ACCELERATION = 1.0  # bound of a bee's step, in differences of two sources
TRIAL_LIMIT = 0.6  # failed trials per coordinate and bee after which a source is left
ATTRACTION = 2.0  # of fireflies, beta at distance 0
ABSORPTION = 1.0  # of light, gamma, per square of the distance in diagonals of the bounds
RANDOMNESS = 0.2  # initial factor alpha of a firefly's random step
FIREFLY_STEP = 0.05  # random step, as a share of the width of the bounds


@borrowing_kernel
def next_inertia(swarm: Swarm, moves: MoveParameters, progress: float) -> float:
    """Return the inertia of the next move."""
    record = swarm.record[0]
    high, low = moves.inertia, moves.min_inertia
    if moves.rule == CHAOTIC:
        if record.move_count == 0:
            record.chaos = CHAOS
        record.chaos = CHAOS_RATE * record.chaos * (1.0 - record.chaos)  # P2 (13)
        return (high - (high - low) * progress) * float(record.chaos)  # P2 (14), (15)
    if moves.rule == VARIABLE:  # R1 (2.1), (2.2)
        return math.exp(-(progress * (math.log(high) - math.log(low)) - math.log(high)))
    if moves.rule == ADAPTIVE:  # R1 (2.5), (2.6)
        previous = record.previous_best_cost
        gain = swarm.best_cost[0] / previous if 0.0 < previous < math.inf else 1.0
        record.previous_best_cost = swarm.best_cost[0]
        return (high + low) * gain - high * progress
    return high * float(moves.damping**record.move_count)


@borrowing_kernel
def move_particles(swarm: Swarm, moves: MoveParameters, inertia: float, state: Stream) -> None:
    """Move the coordinates of every particle that are not fixed once, in place: P2 (9)-(12)."""
    X, V = swarm.positions, swarm.velocities
    c1, c2 = moves.c1, moves.c2
    if moves.rule == VARIABLE:
        c1, c2 = math.cos(inertia), math.sin(inertia)  # R1 (2.3), (2.4)
    k, d = X.shape
    for i in range(k):
        guide = swarm.best
        if moves.neighbours > 0:
            nearest = i
            for step in range(-moves.neighbours, moves.neighbours + 1):
                j = (i + step) % k
                if swarm.personal_best_costs[j] < swarm.personal_best_costs[nearest]:
                    nearest = j
            guide = swarm.personal_best[nearest]
        for c in range(d):
            if swarm.fixed[i, c]:
                continue
            limit = moves.max_step * bound_width(swarm, c)
            w = inertia * min(1.0, math.sqrt(c // 2) / 4.0) if moves.inertia_ramp else inertia
            v = (
                w * V[i, c]
                + c1 * next_uniform(state) * (swarm.personal_best[i, c] - X[i, c])
                + c2 * next_uniform(state) * (guide[c] - X[i, c])
            )
            V[i, c] = min(max(v, -limit), limit)
            X[i, c] += V[i, c]


@borrowing_kernel
def move_wolves(swarm: Swarm, a: float, listed: bool, state: Stream) -> None:
    """Move every wolf once, in place: R1 (4.3)-(4.11), with the D of the original in (4.6)-(4.8).

    The leaders alpha, beta and delta are the three best remembered positions. As R1's listing has
    it, they are the three best current ones and stay, and share A and C.
    """
    X, pack = swarm.positions, swarm.positions if listed else swarm.personal_best
    costs = swarm.costs if listed else swarm.personal_best_costs
    k, d = X.shape
    alpha, beta, delta = -1, -1, -1
    for i in range(k):
        if alpha < 0 or costs[i] < costs[alpha]:
            alpha, beta, delta = i, alpha, beta
        elif beta < 0 or costs[i] < costs[beta]:
            beta, delta = i, beta
        elif delta < 0 or costs[i] < costs[delta]:
            delta = i
    for i in range(k):
        if listed and i in (alpha, beta, delta):
            continue
        for c in range(d):
            total, A, C = 0.0, 0.0, 0.0
            for leader in (alpha, beta, delta):
                if leader == alpha or not listed:
                    A = 2.0 * a * next_uniform(state) - a  # (4.10)
                    C = 2.0 * next_uniform(state)  # (4.11)
                prey = pack[leader, c]
                total += prey - A * abs(C * prey - X[i, c])  # (4.3)-(4.8)
            X[i, c] = total / 3.0  # (4.9)


@borrowing_kernel
def move_bees(swarm: Swarm, state: Stream) -> None:
    """Send the bees out once, in place: employed bees and onlookers in turn (Karaboga 2005).

    On the turn of the employed bees, scouts leave sources that failed too often for random ones.
    Two moves are one cycle of the original.
    """
    k, d = swarm.positions.shape
    onlookers = swarm.record[0].move_count % 2 == 1
    bounded = True
    for c in range(d):
        bounded &= swarm.upper[c] - swarm.lower[c] < math.inf
    if onlookers:
        mean, total = 0.0, 0.0
        for i in range(k):
            mean += swarm.personal_best_costs[i] / k
        for i in range(k):  # fitness exp(-cost / mean), as a running sum
            total += math.exp(-swarm.personal_best_costs[i] / mean) if mean > 0.0 else 1.0
            swarm.costs[i] = total
    for i in range(k):
        source = i
        if onlookers:  # by roulette
            source = int(np.searchsorted(swarm.costs[:-1], next_uniform(state) * swarm.costs[-1]))
        swarm.targets[i] = source
        if not onlookers and bounded and swarm.trials[i] >= TRIAL_LIMIT * k * d:
            swarm.personal_best_costs[i] = math.inf
            for c in range(d):
                width = swarm.upper[c] - swarm.lower[c]
                swarm.positions[i, c] = swarm.lower[c] + next_uniform(state) * width
            continue
        j = int(next_uniform(state) * (k - 1))  # another source
        j += j >= source
        for c in range(d):
            phi = ACCELERATION * (2.0 * next_uniform(state) - 1.0)
            x = swarm.personal_best[source, c]
            swarm.positions[i, c] = x + phi * (x - swarm.personal_best[j, c])


@borrowing_kernel
def move_fireflies(swarm: Swarm, damping: float, state: Stream) -> None:
    """Move every firefly towards all brighter ones, in place (Yang 2009); the best k live on."""
    X, parents, costs = swarm.positions, swarm.personal_best, swarm.personal_best_costs
    k, d = X.shape
    alpha = RANDOMNESS * damping ** swarm.record[0].move_count
    diagonal = 0.0
    for c in range(d):
        diagonal += bound_width(swarm, c) ** 2
    for i in range(k):
        swarm.targets[i] = WORST
        for c in range(d):
            X[i, c] = parents[i, c]
        for j in range(k):
            if costs[j] < costs[i]:
                square = 0.0
                for c in range(d):
                    square += (parents[j, c] - X[i, c]) ** 2
                beta = ATTRACTION * math.exp(-ABSORPTION * square / diagonal)
                for c in range(d):
                    X[i, c] += beta * next_uniform(state) * (parents[j, c] - X[i, c])
        for c in range(d):
            step = FIREFLY_STEP * bound_width(swarm, c)
            X[i, c] += alpha * step * (2.0 * next_uniform(state) - 1.0)


@borrowing_kernel
def is_particle_move(moves: MoveParameters, progress: float) -> bool:
    """Return whether the next move is one of particles."""
    return moves.kind == PARTICLES or (
        moves.kind == PARTICLES_THEN_WOLVES and progress < PARTICLE_SHARE
    )


@borrowing_kernel
def move_swarm(swarm: Swarm, moves: MoveParameters, progress: float, state: Stream) -> float:
    """Move an evaluated swarm once, in place, and return the inertia of particles, or 0.

    `progress` is the finished part of the run, in [0, 1].
    """
    inertia, kind = 0.0, moves.kind
    if kind == WHALES:
        whales = Whales(
            swarm.positions, swarm.best, swarm.best_cost, swarm.c_range, swarm.lower, swarm.upper,
            moves.whales,
        )  # fmt: skip
        move(whales, progress, state)
    elif is_particle_move(moves, progress):
        flown = progress / PARTICLE_SHARE if kind == PARTICLES_THEN_WOLVES else progress
        inertia = next_inertia(swarm, moves, flown)
        move_particles(swarm, moves, inertia, state)
    elif kind == WOLVES:
        move_wolves(swarm, WOLF_RANGE * (1.0 - progress), moves.listed, state)
    elif kind == PARTICLES_THEN_WOLVES:
        a = WOLF_RANGE * (1.0 - progress) / (1.0 - PARTICLE_SHARE)
        move_wolves(swarm, a, moves.listed, state)
    elif kind == BEES:
        move_bees(swarm, state)
    else:
        move_fireflies(swarm, moves.damping, state)
    if kind != WHALES:  # whales stay within the bounds by themselves
        clip_to_bounds(swarm)
    swarm.record[0].move_count += 1
    return inertia


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
        return MoveParameters(WHALES, self.whale_moves())


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

    neighbours: int = setting(default=0, low=0)
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

    moves = MoveParameters(PARTICLES, rule=DAMPED)

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
    moves = MoveParameters(PARTICLES, rule=CHAOTIC, inertia=0.9, min_inertia=0.3, max_step=0.1)


@settings
class PsoVariable(Particles):
    """Particles whose inertia falls by a constant factor; c1 and c2 follow it: R1 (2.1)-(2.4)."""

    # The inertia's usual values, not given in R1; the longest step is R1's 4 m of 25 m.
    moves = MoveParameters(PARTICLES, rule=VARIABLE, inertia=0.9, min_inertia=0.4, max_step=0.16)


@settings
class PsoAdaptive(Particles):
    """Particles whose inertia follows the gain of the last move: R1 (2.5)-(2.6)."""

    # R1, section 5.4; the longest step is 4 m of 25 m.
    moves = MoveParameters(PARTICLES, rule=ADAPTIVE, c1=2.05, c2=2.05, max_step=0.16)

    inertia: float = setting(default=0.9, low=0.0, source=_NOT_GIVEN)
    """Initial inertia."""
    min_inertia: float = setting(default=0.4, low=0.0, source=_NOT_GIVEN)
    """Final inertia."""


@settings
class Gwo(Optimizer):
    """Grey wolves (Mirjalili, Mirjalili and Lewis 2014)."""

    moves = MoveParameters(WOLVES)

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
        return particles.parameters._replace(kind=PARTICLES_THEN_WOLVES, listed=self.wolves.listed)


@settings
class Abc(Optimizer):
    """An artificial bee colony (Karaboga 2005); two moves are one cycle of it."""

    moves = MoveParameters(BEES)


@settings
class Firefly(Optimizer):
    """Fireflies that fly towards all brighter ones (Yang 2009), the best of old and new kept."""

    moves = MoveParameters(FIREFLIES, damping=0.98)
