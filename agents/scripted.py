"""Policies without learning: random, straight, and any planner with any follower."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from agents.followers import make_follower
from agents.followers.follower import CREEP, near_of
from agents.motion import Motion
from agents.reference import Reference
from agents.rollout import stops_clear
from agents.surroundings import Surroundings
from agents.unseen import assumed, blind_behind, walled
from planners import make_planner
from planners.space import Space
from planners.types import Plan, Problem, Status
from wheelchair_gym.config import setting, settings
from wheelchair_gym.maps import OccupancyGrid

Array = NDArray[np.float64]
Observation = Mapping[str, NDArray[np.float32]]

FINER = 0.04  # m: a plan that finds no way is tried again with this much less clearance
GAIN = 0.1  # m of way that count as progress
HURRY = 0.4  # share of the patience at the path's end, where the goal is near but not reached
BACK = 0.15  # m/s in reverse: nothing looks back
TURNS = (0.0, 0.3, -0.3, 0.7, -0.7)  # rad/s, in order of preference while backing out
MARGIN = 0.05  # m and
HOLD = 0.4  # s: what a way back must leave, as `Window` asks of a way ahead


def episode_rng(task: Any, seed: int) -> np.random.Generator:
    """Random draws of an episode: the same for the same episode and seed."""
    return np.random.default_rng([seed, task.key])


@settings
class RandomPolicy:
    """Twists drawn evenly, each held for a while."""

    seed: int = setting(default=0, low=0)
    hold: float = setting(default=0.5, unit="s", source="else inertia averages all out", low=0.0)

    def make(self) -> RandomDriver:
        """A fresh policy."""
        return RandomDriver(self)


class RandomDriver:
    """Holds one random action after another."""

    def __init__(self, own: RandomPolicy) -> None:
        self.own = own

    def reset(self, task: Any) -> None:
        """See `Policy.reset`."""
        self._rng = episode_rng(task, self.own.seed)
        self._held = max(1, round(self.own.hold / task.period))
        self._count = 0

    def act(self, observation: Observation) -> Array:
        """See `Policy.act`."""
        if self._count % self._held == 0:
            self._action: Array = self._rng.uniform(-1.0, 1.0, 2)
        self._count += 1
        return self._action


@settings
class StraightPolicy:
    """Turns to the goal and drives there, whatever stands between."""

    gain: float = setting(default=1.5, unit="1/s", source="turn per heading error", low=0.0)
    pivot: float = setting(default=0.5, unit="rad", source="turn in place above this", low=0.0)

    def make(self) -> StraightDriver:
        """A fresh policy."""
        return StraightDriver(self)


class StraightDriver:
    """Steers for the goal."""

    def __init__(self, own: StraightPolicy) -> None:
        self.own = own

    def reset(self, task: Any) -> None:
        """See `Policy.reset`."""
        self._task = task

    def act(self, observation: Observation) -> Array:
        """See `Policy.act`."""
        x, y, yaw = self._task.reading.pose
        goal = self._task.goal
        error = math.remainder(math.atan2(goal[1] - y, goal[0] - x) - yaw, 2 * math.pi)
        v = self._task.limits.forward * max(0.0, 1.0 - abs(error) / self.own.pivot)
        action: Array = self._task.limits.action(np.array([v, self.own.gain * error]))
        return action


@settings
class Planned:
    """A planner in the map, and a follower along its path; replans, and backs out.

    Each new plan begins where the chair is, in the map that the chair knows. In one that it was
    given, what stands unmapped is the follower's to see and to go round: where it closes the only
    passage the map shows, the chair plans through it again and again, and runs out of time. A map
    that the chair draws itself is taken for free wherever it is unknown, and as soon as a wall
    shows on the way, another way is planned (the free-space assumption: Koenig and Likhachev 2005).
    """

    planner: Mapping[str, Any] = field(default_factory=lambda: {"name": "a_star"})
    follower: Mapping[str, Any] = field(default_factory=lambda: {"name": "window"})
    seed: int = setting(default=0, source="of the planner's draws", low=0)
    clearance: float = setting(
        default=0.40, unit="m", source="half width, pose error and a margin; less where none leads",
        low=0.0,
    )  # fmt: skip
    least: float = setting(default=0.28, unit="m", source="a cell under the half width", low=0.0)
    astray: float = setting(default=0.8, unit="m", source="farther off the path: replan", low=0.05)
    beyond: float = setting(
        default=5.0, unit="m", source="ways through the unknown may lead so far round", low=0.5
    )
    creeps_back: bool = setting(
        default=True, source="once stuck, where nobody has seen; false: rather stays where it is"
    )
    redraw: float = setting(
        default=0.5, unit="s", source="between two looks at a map that grows", low=0.0
    )
    patience: float = setting(default=4.0, unit="s", source="without progress: act", low=0.5)
    backing: float = setting(default=2.5, unit="s", source="about half a chair's length", low=0.1)

    def __post_init__(self) -> None:
        make_planner(dict(self.planner))
        make_follower(self.follower)

    def make(self) -> PlannedDriver:
        """A fresh policy."""
        return PlannedDriver(self)


class PlannedDriver:
    """Plans from where the chair believes it is, follows, and finds its way out when stuck."""

    def __init__(self, own: Planned) -> None:
        self.own = own
        self._planner = make_planner(dict(own.planner))
        self._follower_settings = make_follower(own.follower)

    def reset(self, task: Any) -> None:
        """See `Policy.reset`."""
        self._task = task
        self._rng = episode_rng(task, self.own.seed)
        self._around = Surroundings(task)
        self._chair = Motion(task.limits, task.footprint, task.period)
        self._backing = 0.0  # s left to back out
        self._tries = 0  # plans made since there was progress
        self.plan: Plan | None = None
        self._reference: Reference | None = None
        self.aim(task.goal)

    def aim(self, goal: Array) -> None:
        """Drive to a goal (2 or 3,) [m, m, rad] from now on; without a heading any will do."""
        self.goal = np.asarray(goal, dtype=np.float64)
        self._replan()

    @property
    def solved(self) -> bool:
        """Whether the last plan leads to the goal."""
        return self.plan is not None and self.plan.status is Status.SOLVED

    @property
    def ended(self) -> bool:
        """Whether the chair has come to the end of its path."""
        return self._reference is not None and self._reference.ended

    def _replan(self) -> None:
        """Plan from where the chair is, and begin the new path."""
        start, goal = self._around.pose, self.goal
        maps = self._maps(start, goal)
        for known in maps:
            if self._plan(Space.from_grid(known), start, goal):
                break
        if len(maps) > 1:  # the follower never backs where nothing was seen
            self._around.chart(known if known is not maps[-1] else maps[-2])
        assert self.plan is not None
        path = self.plan.path
        self._mapped = self._since = 0.0
        self._task.note = " ".join((self.plan.status.name, self.plan.note)).strip()
        if not self.solved:
            if self._reference is not None:
                return  # the old path is better than none
            # Straight on: the follower still touches nothing, and the next plan begins elsewhere.
            path = np.stack([start[:2], goal[:2]])
        self._task.path = path[:, :2]
        self._reference = Reference(np.asarray(path, dtype=np.float64), start)
        self._follower = self._follower_settings.make()
        self._best = 0.0

    def _maps(self, start: Array, goal: Array) -> list[OccupancyGrid]:
        """Maps to plan in, the next one if the last leads nowhere."""
        known = self._task.map
        if self._task.chart is None:
            return [known]
        known = known.holding(np.stack([start[:2], goal[:2]]), self.own.beyond)
        return assumed(known, start, self._task.footprint)

    def _plan(self, space: Space, start: Array, goal: Array) -> bool:
        """Plan at the widest clearance that leads to the goal."""
        clearance = self.own.clearance
        while True:
            self.plan = self._planner.plan(Problem(space, start, goal, clearance), self._rng)
            self._clearance = clearance
            clearance -= FINER
            if self.solved or clearance < self.own.least:
                return self.solved

    def act(self, observation: Observation) -> Array:
        """See `Policy.act`."""
        period = self._task.period
        self._around.update(self._task.reading)
        unseen = False
        if self._task.chart is not None:
            outline = self._task.footprint
            unseen = blind_behind(self._task.map, self._around.pose, outline)
            stuck = self._tries > 0 and self.own.creeps_back
            self._around.blind = unseen and not stuck
        self._chair.measured(self._task.reading.twist)
        assert self._reference is not None  # reset made one
        off = self._reference.advance(self._around.pose)
        if self._reference.way > self._best + GAIN:
            self._best, self._since, self._tries = self._reference.way, 0.0, 0
        self._since += period
        patience = HURRY * self.own.patience if self._reference.ended else self.own.patience
        if self._backing > 0.0:
            self._backing -= period
            if self._backing <= 0.0:
                self._replan()
        elif off > self.own.astray or self._walled():
            self._replan()
        elif self._since > patience:
            self._tries += 1
            if self._tries % 2:
                self._replan()
            else:
                self._backing, self._since = self.own.backing, 0.0
                self._task.note = "backs out"
        twist = self._back_out() if self._backing > 0.0 else None
        if twist is None:
            twist = self._follower.twist(self._around, self._reference, self._chair)
        if twist is None or (twist[0] < 0.0 and self._around.blind):
            twist = np.zeros(2)
        elif unseen and twist[0] < -CREEP:
            twist = twist * (-CREEP / twist[0])
        self._chair.command(twist)
        action: Array = self._task.limits.action(twist)
        return action

    def _walled(self) -> bool:
        """Whether a wall that was drawn since the last plan stands on the way."""
        self._mapped += self._task.period
        if self._task.chart is None or self._mapped < self.own.redraw:
            return False
        self._mapped = 0.0
        assert self._reference is not None
        ahead = self._reference.rows[self._reference.at :]
        return walled(self._task.map, ahead, self._clearance)

    def _back_out(self) -> Array | None:
        """The straightest slow way back that leaves room to stop."""
        chair, around = self._chair, self._around
        if around.blind:
            return None
        assert self._reference is not None
        near = near_of(around, self._reference)
        back = -min(BACK, self._task.limits.backward)
        for margin in around.margins(chair.footprint, MARGIN):
            for turn in TURNS:
                for v, w in ((back, turn), (0.0, turn)):
                    if (v or w) and stops_clear(v, w, chair.body, near, HOLD, margin):
                        return np.array([v, w])
        return None
