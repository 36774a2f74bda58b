"""Followers: from a path and what is around the chair to the next twist.

All of them accept a twist only if the chair, once it has held it for a moment, can still stop clear
of everything (`stops_clear`). Window, dwa, mppi and whales (`whales.py`) choose by roll-outs with
one `Objective`. A new follower also needs a row of `FOLLOWERS` (`agents/control/__init__.py`). In
each period the policy (`agents/policies/planned.py`) moves `ReferencePath.at` by `advance`.
"""

import math
from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import Any, NamedTuple, Protocol

import numpy as np

from agents.control import rollout
from agents.control.local_map import LocalMap
from agents.control.tight_places import SHARES, ManoeuvreTracker
from planners.rrt_star_woa.control_generator import ControlGenerator, Controls
from planners.rrt_star_woa.woa import WhaleSettings
from wheelchair_gym.base.arrays import Array
from wheelchair_gym.base.settings import record_of, setting, settings
from wheelchair_gym.geometry.kinematics import Limits
from wheelchair_gym.geometry.planar import to_world, wrap
from wheelchair_gym.types import no_walls

TIGHT = 0.5  # share of the margin: where less of it is left, the chair creeps
CREEP = 0.1  # m/s: walking-stick speed
STILL = 0.03  # m/s, rad/s: slower is at rest
OFF, TURNED_OFF = 0.10, 0.15  # m, rad from the predicted pose; beyond, new commands are generated
BACKWARD = 0.2  # m/s: fastest reverse speed of roll-outs; no sensor looks back
SPEEDS = np.array([0.12, 0.25, 0.45, 0.7, 1.0])  # shares of the speed limit, in a fan
TURNS = np.array([0.06, 0.14, 0.25, 0.4, 0.6, 0.8, 1.0])  # shares of the turn limit, in a fan
PIECES = 4  # twists within the horizon of `mppi`
SPREAD = np.array([0.2, 0.3])  # m/s, rad/s: standard deviations of its twists; tuned
LATERAL = 0.35  # m/s2: maximum lateral acceleration of `pure_pursuit` in curves; comfort
PIVOT, PIVOTED = 0.9, 0.3  # rad: heading errors at which it begins and ends a turn in place


class Situation(NamedTuple):
    """Input of a follower: local map, reference path and state of the chair."""

    local_map: LocalMap
    reference: rollout.ReferencePath
    chair: rollout.ChairState

    @property
    def view(self) -> rollout.LocalView:
        """Obstacle points, actors and the path ahead, as kernels take them."""
        local_map = self.local_map
        reference = self.reference.ahead(local_map.pose)
        return rollout.LocalView(local_map.points, local_map.actors, reference)

    def first_clear(
        self, twists: Iterable[Any], margin: float, hold: float = rollout.HOLD, creeps: bool = False
    ) -> Array | None:
        """Return the first twist (2,) from which the chair can stop clear, at the widest margin.

        A twist beyond the limits is slowed: ahead it keeps its arc. A chair that creeps does so
        where little of the margin [m] is left. None: none is clear.
        """
        view, body, limits = self.view, self.chair.body, self.chair.limits
        driven: list[tuple[float, float]] = []
        for v, w in twists:
            part = min(1.0, limits.turn / max(abs(w), 1e-9), limits.forward / max(v, 1e-9))
            driven.append((max(part * v, -limits.backward), part * w))
        for less in self.local_map.margins(margin):
            for v, w in driven:
                fits = not creeps or less >= TIGHT * margin or abs(v) <= CREEP
                if fits and rollout.stops_clear(v, w, body, view, hold, less):
                    return np.array([v, w])
        return None


class Follower(Protocol):
    """Drives along one reference; made anew for every path."""

    def twist(self, now: Situation) -> Array | None:
        """The next target twist (2,) [m/s, rad/s], or None where nothing safe leads on."""
        ...


@settings
class Objective:
    """The cost of a roll-out; every term counts in metres of way, as one along the path does."""

    horizon: float = setting(default=1.5, unit="s", low=0.3, source="tuned on training floor plans")
    """Time over which commands are rolled out and scored."""
    desired_clearance: float = setting(
        default=0.20, unit="m", low=0.01, source="half the play in a 1.0 m door"
    )
    """Clearance to static obstacles beyond which more brings no lower cost."""
    clearance: float = setting(
        default=0.8, low=0.0, source="less than progress, or nothing tight is entered"
    )
    """Cost of a metre in contact, which falls to zero at the desired clearance."""
    path: float = setting(default=1.5, low=0.0, source="tuned")
    """Cost of a metre beside the path at the end; half of it counts half-way."""


@settings
class RolloutSettings:
    """Settings common to the followers that choose by roll-outs."""

    margin: float = setting(default=0.05, unit="m", low=0.0, source="laser sigma 15 mm, 3 sigma")
    """Clearance that the outline keeps where it can."""
    objective: Objective = Objective()


def relax_clearance(
    now: Situation, margin: float, pick: Callable[[float, bool], Array | None]
) -> Array | None:
    """Return the first twist that moves, from the widest margin on; else a safe stop; else None.

    Where there are actors, a stop is as good as a twist that moves. `pick` gives a twist (2,) for a
    margin [m] and whether to creep; None where none is safe.
    """
    rest = None
    for less in now.local_map.margins(margin):
        twist = pick(less, less < TIGHT * margin)
        if twist is None:
            continue
        if abs(twist[0]) > 0.02 or abs(twist[1]) > 0.02 or len(now.local_map.actors):
            return twist
        rest = twist if rest is None else rest
    return rest


def allowed(candidates: Array, local_map: LocalMap, slow: bool) -> Array:
    """Commands (c, k, 3) that neither reverse into unknown space nor, if slow, exceed creeping."""
    v = candidates[:, 0, 0]
    good = ((v >= 0.0) | (not local_map.blind)) & ((np.abs(v) <= CREEP) | (not slow))
    return candidates[good]


def full_fan(limits: Limits) -> Array:
    """A fan of twists (c, 2) over the whole range of the limits, finer where they are slow."""
    back = min(BACKWARD, limits.backward)
    v = np.concatenate([[-back, -0.5 * back, 0.0], limits.forward * SPEEDS])
    w = limits.turn * np.concatenate([-TURNS[::-1], [0.0], TURNS])
    return np.stack(np.meshgrid(v, w, indexing="ij"), axis=-1).reshape(-1, 2)


@settings
class Window(RolloutSettings):
    """The best of a fan over all twists that the chair may be asked for.

    The chair approaches a twist by its ramps, in the roll-out as on the floor: so a fast turn is a
    candidate from rest, too, which it is not in the classic dynamic window. Where the plan turns
    close to obstacles, the chair tracks the planned poses instead.
    """

    def fan(self, chair: rollout.ChairState) -> Array:
        """Twists (c, 2) to choose among [m/s, rad/s]."""
        return full_fan(chair.limits)

    def make(self) -> Follower:
        """A follower at rest."""
        return ManoeuvreTracker(FanFollower(self), self.margin)


@settings
class DynamicWindow(RolloutSettings):
    """The classic dynamic window approach (Fox, Burgard and Thrun 1997).

    Its candidates are a grid over the twists that the chair reaches within a short time; of these
    it takes the best that it can still stop from. Objective and outline are those of the others.
    """

    reach: float = setting(default=0.5, unit="s", low=0.05)
    """Time within which the candidates are reached."""
    speeds: int = setting(default=7, low=2, high=50)
    """Number of speeds in the grid."""
    turns: int = setting(default=15, low=3, high=99)
    """Number of turn rates in the grid."""

    def fan(self, chair: rollout.ChairState) -> Array:
        """Twists (c, 2) to choose among [m/s, rad/s]."""
        limits, (v, _, w, _) = chair.limits, chair.body.state
        back = min(BACKWARD, limits.backward)
        low = max(-back, v - limits.deceleration * self.reach)
        high = max(low, min(limits.forward, v + limits.acceleration * self.reach))
        wide = limits.turn_acceleration * self.reach
        left, right = max(-limits.turn, w - wide), min(limits.turn, w + wide)
        v_grid = np.append(np.linspace(low, high, self.speeds), np.clip(0.0, low, high))
        w_grid = np.append(np.linspace(left, right, self.turns), np.clip(0.0, left, right))
        return np.stack(np.meshgrid(v_grid, w_grid, indexing="ij"), axis=-1).reshape(-1, 2)

    def make(self) -> Follower:
        """A follower at rest."""
        return FanFollower(self)


class FanFollower:
    """Chooses among a fan of twists by roll-out."""

    def __init__(self, config: Window | DynamicWindow) -> None:
        self.config, self._objective = config, record_of(config.objective)

    def twist(self, now: Situation) -> Array | None:
        """See `Follower.twist`."""
        config, view, body, local_map = self.config, now.view, now.chair.body, now.local_map
        twists = local_map.limit_for_unseen_space(config.fan(now.chair), body.state)
        times = np.full(len(twists), config.objective.horizon)
        fan = np.column_stack([twists, times])[:, None]  # (c, 1, 3)

        def pick(margin: float, slow: bool) -> Array | None:
            some = allowed(fan, local_map, slow)
            costs = rollout.rollout_costs(some, body, view, margin, self._objective)
            best = rollout.cheapest(some[:, 0], costs, body, view, rollout.HOLD, margin)
            return np.array(some[best, 0, :2]) if best >= 0 else None

        return relax_clearance(now, config.margin, pick)


@settings
class PathIntegral(RolloutSettings):
    """MPPI (Williams et al. 2017): the mean of many noisy roll-outs, weighted by cost.

    Every period begins with the mean of the one before.
    """

    samples: int = setting(default=72, low=4, high=10_000, source="10 ms on one core")
    """Number of noisy roll-outs."""
    temperature: float = setting(default=0.03, unit="m", low=1e-6, source="tuned")
    """Difference of cost at which a weight falls to 1/e."""

    def make(self) -> Follower:
        """A follower at rest."""
        return PathIntegralFollower(self)


class PathIntegralFollower:
    """Carries the mean commands from one period to the next."""

    def __init__(self, config: PathIntegral) -> None:
        self.config, self._objective = config, record_of(config.objective)
        self._rng = np.random.default_rng(0)  # anew for every path
        self._mean: Array = np.zeros((PIECES, 2))

    def twist(self, now: Situation) -> Array | None:
        """See `Follower.twist`."""
        config, limits, body = self.config, now.chair.limits, now.chair.body
        view, objective = now.view, self._objective
        long = config.objective.horizon / PIECES
        following = np.vstack([self._mean[1:], self._mean[-1:]])
        self._mean += now.chair.period / long * (following - self._mean)
        # Noise that lasts over the horizon and noise of each piece, in equal parts; and a coarse
        # fan, so that a mean that is suddenly blocked finds another way at once.
        noise = self._rng.standard_normal((config.samples, PIECES + 1, 2)) * SPREAD
        drawn = self._mean + (noise[:, :1] + noise[:, 1:]) / np.sqrt(2.0)
        drawn[0] = self._mean
        fan = full_fan(limits)[::3]
        drawn = np.concatenate([drawn, np.repeat(fan[:, None], PIECES, axis=1)])
        low = -min(BACKWARD, limits.backward), -limits.turn
        drawn = np.clip(drawn, low, (limits.forward, limits.turn))
        times = np.full((*drawn.shape[:2], 1), long)
        candidates = np.concatenate([drawn, times], axis=2)  # (c, pieces, 3)

        def pick(margin: float, slow: bool) -> Array | None:
            some = allowed(candidates, now.local_map, slow)
            costs = rollout.rollout_costs(some, body, view, margin, objective)
            share = np.exp((costs.min() - costs) / config.temperature)
            mean = (share / share.sum()) @ some.reshape(len(some), -1)
            mean = mean.reshape(1, PIECES, 3)
            # The mean first if it is about as good as the best: it wobbles less.
            mean_cost = rollout.rollout_costs(mean, body, view, margin, objective)
            costs = np.append(mean_cost - config.temperature, costs)
            some = np.concatenate([mean, some])
            first = np.ascontiguousarray(some[:, 0])
            best = rollout.cheapest(first, costs, body, view, rollout.HOLD, margin)
            if best < 0:
                return None
            self._mean = some[best, :, :2].copy()
            return first[best, :2]

        twist = relax_clearance(now, config.margin, pick)
        if twist is None:
            self._mean[:] = 0.0
        return twist


@settings
class GeneratedControls:
    """Whales search commands (v, w, t) along the path's next metres, again and again.

    Each search starts from what is left of the commands that are being driven.
    """

    generator: ControlGenerator = ControlGenerator(
        whales=WhaleSettings(population=40, iterations=10), horizon=2.0, segment=2.0, margin=0.06,
        arrival=0.2,
    )  # fmt: skip
    """Search of commands."""
    again: float | None = setting(
        default=0.4, unit="s", low=0.1, source="measured on training homes"
    )
    """Time between two searches; null: the commands are driven to their end first."""
    margin: float = setting(default=0.04, unit="m", low=0.0, source="laser sigma 15 mm, 3 sigma")
    """Clearance that the outline keeps where it can."""

    def make(self) -> Follower:
        """A follower at rest."""
        return GeneratedControlsFollower(self)


@settings
class ThesisControls(GeneratedControls):
    """The thesis's generator: commands for the whole path, searched once and driven to their end.

    Where they end, or lead no further without contact, commands for the rest of the path follow.
    """

    generator: ControlGenerator = ControlGenerator(
        whales=WhaleSettings(population=10, iterations=10, a=4.0, leader="latest"), maneuvers=False,
        printed=True,
    )  # fmt: skip
    """Search of commands."""
    again: float | None = setting(default=None, unit="s", low=0.1, source="thesis, section 2.9.3")
    """Time between two searches; null: the commands are driven to their end first."""


class GeneratedControlsFollower:
    """Drives the commands generated last, and generates new ones when they no longer fit."""

    def __init__(self, config: GeneratedControls) -> None:
        self.config = config
        self._rng = np.random.default_rng(0)  # anew for every path
        self.controls: Controls | None = None  # generated last
        self._age = 0.0  # s since they were generated
        self._driven = 0.0  # s of them that have been driven

    def twist(self, now: Situation) -> Array | None:
        """See `Follower.twist`."""
        self._age += now.chair.period
        again = self.config.again
        twist = self._drive(now) if again is None or self._age < again else None
        if twist is None:
            self._generate(now)
            twist = self._drive(now)
        now.reference.turning = twist is not None and abs(twist[0]) < STILL < abs(twist[1])
        return twist

    def _drive(self, now: Situation) -> Array | None:
        """Return the twist in the middle of the coming period; None where the commands do not fit.

        A chair that may not drive as fast as it is asked to drives the commands more slowly.
        """
        controls, local_map, chair = self.controls, now.local_map, now.chair
        if controls is None or self._driven >= controls.commands[:, 2].sum():
            return None
        if self.config.again is not None:
            k = int(np.searchsorted(controls.times[:-1], self._driven))
            off = local_map.pose - controls.rollout[k]
            if math.hypot(off[0], off[1]) > OFF or abs(wrap(off[2])) > TURNED_OFF:
                return None
        asked = controls.twist_at(self._driven + 0.5 * chair.period)
        v, w = local_map.limit_for_unseen_space(asked[None], chair.body.state)[0]
        part = max(abs(v), abs(w)) / max(abs(asked[0]), abs(asked[1]), 1e-9) if asked.any() else 1.0
        twists = [(share * v, share * w) for share in SHARES]
        twist = now.first_clear(twists, self.config.margin, 2 * chair.period, creeps=True)
        if twist is not None:
            nearest = int(np.abs(np.array(twists) - twist).sum(axis=1).argmin())
            self._driven += SHARES[nearest] * part * chair.period
        return twist

    def _generate(self, now: Situation) -> None:
        """Generate commands; with less margin, or for a shorter path, where none lead on."""
        local_map, reference, chair = now
        points = to_world(local_map.points[:, :2], local_map.pose)
        discs = np.column_stack([points, np.zeros(len(points))])
        generator = self.config.generator
        path = reference.path if generator.printed else reference.rows[reference.at :, :2]
        if len(path) < 2:
            path = np.concatenate([local_map.pose[None, :2], reference.rows[-1:, :2]])
        twist = chair.body.state[[0, 2]]
        left = np.empty((0, 3)) if self.controls is None else self.controls.after(self._driven)
        self._age = self._driven = 0.0
        limits = chair.limits
        pivot = math.inf
        if not local_map.looks_back:  # unseen floor is entered slowly: in reverse, and in a turn
            back = 0.0 if local_map.blind else min(CREEP, limits.backward)
            limits = replace(limits, backward=back)
            pivot = CREEP / math.hypot(chair.footprint.rear, chair.footprint.half_width)
        for margin in local_map.margins(generator.margin):
            for share in (1.0, 0.5) if generator.horizon is not None else (1.0,):
                horizon = None if generator.horizon is None else share * generator.horizon
                some = replace(generator, margin=margin, horizon=horizon)
                self.controls = some.generate(
                    path, local_map.pose, no_walls(), discs, chair.footprint, limits, self._rng,
                    twist, left, pivot,
                )  # fmt: skip
                if self.controls.reached:
                    return


@settings
class PurePursuit:
    """Regulated pure pursuit (Coulter 1992): steers for a point ahead on the path.

    It is slower in curves, near walls and near the goal.
    """

    lookahead: float = setting(default=0.45, unit="m", low=0.05, source="about half a chair")
    """Minimum distance of the point that is steered for."""
    lookahead_time: float = setting(default=0.7, unit="s", low=0.0)
    """Time by whose way the point is farther ahead in motion."""
    margin: float = setting(default=0.05, unit="m", low=0.0, source="laser sigma 15 mm, 3 sigma")
    """Clearance that the outline keeps where it can."""

    def make(self) -> Follower:
        """A follower at rest."""
        return PurePursuitFollower(self)


class PurePursuitFollower:
    """Steers for a point ahead on the path."""

    def __init__(self, config: PurePursuit) -> None:
        self.config = config
        self._pivoting = False

    def twist(self, now: Situation) -> Array | None:
        """See `Follower.twist`."""
        v, w = self._steer(now.reference.ahead(now.local_map.pose, 4.0), now.chair)
        shares = (1.0, 0.7, 0.45, 0.25, 0.12)  # the same arc at the first clear speed
        twists = ((share * v, share * w) for share in shares)
        return now.first_clear(twists, self.config.margin, creeps=True)

    def _steer(self, rows: Array, chair: rollout.ChairState) -> tuple[float, float]:
        """The twist towards a point ahead on the next reference poses (n, 4)."""
        config, limits = self.config, chair.limits
        far = np.hypot(rows[:, 0], rows[:, 1])
        ahead = config.lookahead + config.lookahead_time * max(0.0, chair.body.state[0])
        nearest = int(np.argmin(far))
        beyond = nearest + np.flatnonzero(far[nearest:] > ahead)
        x, y = rows[beyond[0] if len(beyond) else -1, :2]
        error = math.atan2(y, x)
        self._pivoting = abs(error) > (PIVOTED if self._pivoting else PIVOT)
        if self._pivoting:
            return 0.0, math.copysign(0.6 * limits.turn, error)
        curvature = 2.0 * y / max(x * x + y * y, 0.01)
        left = float(far[nearest] + rows[-1, rollout.S] - rows[nearest, rollout.S])
        v = min(limits.forward, math.sqrt(2.0 * 0.5 * limits.deceleration * left))
        v = min(v, math.sqrt(LATERAL / max(abs(curvature), 1e-6)))
        v = max(CREEP, min(v, 0.9 * limits.turn / max(abs(curvature), 1e-6)))
        return v, v * curvature
