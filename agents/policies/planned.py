"""Any planner with any follower: how a chair behaves on its way (T1 3.2.2).

One policy with named states, shown in pictures and logs as the status of its commands:

    follows      along its path; static obstacles are on the map, and planned round
    goes round   a temporary obstacle stands on the way: a whole new plan from where the chair is
    halts        something that moves is near or on course
    gives way    the same, and the chair draws back from it
    waits        nothing leads on for now: a temporary obstacle has closed the way, or the goal
    backs out    no progress for a while; then a new plan
    looks round  the way leads where nobody has seen: the chair turns in place to see it first
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from agents.control import make_follower
from agents.control.follower import CREEP
from agents.control.local_map import Surroundings
from agents.control.reference import Reference
from agents.control.rollout import Motion
from agents.control.unknown_space import BEYOND, assumed, blind_behind, walled
from agents.policies.progress_monitor import Headway, Telling
from agents.policies.recoveries import (
    AGAIN,
    BACK,
    CRAWL,
    DETOUR,
    Detours,
    LookRound,
    Retreats,
    back_out,
    barred,
    crawled,
    widest_plan,
)
from agents.policies.scripted import episode_rng
from planners import make_planner
from planners.problem import Plan, Status
from wheelchair_gym.config import setting, settings
from wheelchair_gym.maps import OccupancyGrid
from wheelchair_gym.types import Command, Mission, Reading, Shown

Array = NDArray[np.float64]

BEHIND = 2.5  # m: with anything nearer that moves, the chair hardly backs: nothing looks back
SHOWN = 1.0  # s for which people see why there is a new path


@settings
class Planned:
    """A planner in the map, and a follower along its path; replans, and backs out.

    Each new plan begins where the chair is, in the map that the chair knows. In one that it was
    given, temporary obstacles are drawn in once they stand on the way; where no way leads round
    them, the chair keeps its path, and waits. A map that the chair draws itself is taken for free
    wherever it is unknown, and as soon as a wall shows on the way, another way is planned (the
    free-space assumption: Koenig and Likhachev 2005).
    """

    planner: Mapping[str, Any] = field(default_factory=lambda: {"name": "a_star"})
    follower: Mapping[str, Any] = field(default_factory=lambda: {"name": "window"})
    seed: int = setting(default=0, low=0, source="design choice")
    """Seed of the planner, with the episode's key."""
    clearance: float = setting(
        default=0.40,
        unit="m",
        low=0.0,
        source="half the chair's width, the pose error and a margin",
    )
    """Clearance that a plan is asked for first; less where no path leads to the goal."""
    least: float = setting(
        default=0.28, unit="m", low=0.0, source="a cell under half the chair's width"
    )
    """Least clearance that a plan is asked for."""
    astray: float = setting(default=0.8, unit="m", low=0.05, source="design choice")
    """Distance from the path above which a new one is planned."""
    beyond: float = setting(default=BEYOND, unit="m", low=0.5, source="design choice")
    """Distance beyond the known map that paths through the unknown may use."""
    redraw: float = setting(default=0.5, unit="s", low=0.0, source="design choice")
    """Time between two looks at a map that grows."""
    patience: float = setting(default=4.0, unit="s", low=0.5, source="design choice")
    """Time without progress after which a recovery begins."""
    backing: float = setting(
        default=2.5, unit="s", low=0.1, source="design choice; about half the chair's length"
    )
    """Time for which the chair backs out."""

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
        self._follower_settings = self._boldly = make_follower(own.follower)
        if (objective := getattr(self._follower_settings, "objective", None)) is not None:
            bold = replace(objective, clearance=0.0)
            self._boldly = replace(self._follower_settings, objective=bold)

    def reset(self, mission: Mission) -> None:
        """See `Policy.reset`."""
        self._mission = mission
        self._rng = episode_rng(mission, self.own.seed)
        self._around = Surroundings(mission)
        self._chair = Motion(mission.limits, mission.footprint, mission.period)
        self._backing = 0.0  # s left to back out
        self._retreats = Retreats()
        self._headway, self._detours = Headway(self.own.patience), Detours()
        self._lost = 0.0  # s until a plan is tried again that led nowhere
        self._peopled = False  # somebody has been seen on this drive
        self._look = LookRound()
        self.plan: Plan | None = None
        self.plans = 0  # made
        self._clearance = self.own.clearance  # m: asked for by the last plan
        self._reference: Reference | None = None
        self._draws = mission.map is None  # the chair draws its own map
        self._telling = Telling(mission.footprint)
        self.aim(mission.goal, mission.reading)

    def aim(self, goal: Array, reading: Reading) -> None:
        """Drive to a goal (2 or 3,) [m, m, rad] from now on; without a heading any will do."""
        self.goal = np.asarray(goal, dtype=np.float64)
        self._map = self._mission.map_at(reading)
        self._replan()

    @property
    def shown(self) -> Shown:
        """The path that the chair follows, and what it is about."""
        return Shown(self._path, self._telling.status, self.plans)

    @property
    def state(self) -> str:
        """What the chair is about."""
        return self._telling.state

    @property
    def solved(self) -> bool:
        """Whether the last plan leads to the goal."""
        return self.plan is not None and self.plan.status is Status.SOLVED

    @property
    def ended(self) -> bool:
        """Whether the chair has come to the end of its path."""
        return self._reference is not None and self._reference.ended

    def _replan(self) -> bool:
        """Plan from where the chair is, and begin the new path; whether one leads to the goal."""
        start, goal = self._around.pose, self.goal
        maps = self._maps(start, goal)
        self._detours.taken = self._temporary
        for known in maps:
            if self._plan(known, start, goal):
                break
        if self._draws:  # the follower never backs where nothing was seen
            self._around.chart(known if known is not maps[-1] else maps[-2])
            if known is maps[-1] and blind_behind(self._map, start, self._mission.footprint):
                self._look.begin(start, goal)
        assert self.plan is not None
        path = self.plan.path
        self._mapped = 0.0
        self._headway.wait()
        plain = self.solved and not self.plan.note
        self._planned = "" if plain else f"{self.plan.status.name} {self.plan.note}".strip()
        self._lost = 0.0 if self.solved else AGAIN  # a search that finds nothing is the longest
        if not self.solved:
            if self._reference is not None:
                return False  # the old path is better than none
            # Straight on: the follower still touches nothing, and the next plan begins elsewhere.
            path = np.stack([start[:2], goal[:2]])
        self._take(path, start)
        return self.solved

    def _take(self, path: Array, start: Array) -> None:
        """Follow a path (n, 2 or 3) [m] from now on."""
        self._path = path[:, :2]
        self._reference = Reference(np.asarray(path, dtype=np.float64), start)
        self._follow()
        self._headway.begin()

    def _follow(self) -> None:
        """Begin to follow: boldly for a while where there was no progress."""
        own = self._boldly if self._headway.bold > 0.0 else self._follower_settings
        self._follower = own.make()

    def _go_round(self) -> None:
        """Plan wholly anew round temporary obstacles; where no way leads, keep the path, and wait.

        T1 3.2.2: temporary obstacles are taken into the plan as soon as they are met.
        """
        start, goal = self._around.pose, self.goal
        kept, before = (self.plan, self._clearance), self._reference
        assert before is not None
        if self._plan(self._around.standing.painted(), start, goal):
            assert self.plan is not None
            round_it = Reference(np.asarray(self.plan.path, dtype=np.float64), start)
            if self._detours.too_long(round_it, before):
                self.plan, self._clearance = kept
                self._telling.say("waits", "the way round is long", self._detours.wait())
                return
            self._take(self.plan.path, start)
            self._detours.taken = True
            self._telling.say("goes round", shown=SHOWN)
            return
        assert self.plan is not None
        blocked = self.plan.status is Status.GOAL_OCCUPIED
        why = "the goal is blocked" if blocked else "no way round"
        self._telling.say("waits", why, self._detours.wait())

    def _maps(self, start: Array, goal: Array) -> list[OccupancyGrid]:
        """Maps to plan in, the next one if the last leads nowhere."""
        known = self._map
        if not self._draws:
            return [self._around.standing.painted(), known] if self._temporary else [known]
        known = known.extended_to(np.stack([start[:2], goal[:2]]), self.own.beyond)
        return assumed(known, start, self._mission.footprint)

    def _plan(self, known: OccupancyGrid, start: Array, goal: Array) -> bool:
        """Plan in a map at the widest clearance that leads to the goal."""
        self.plans += 1
        self.plan, self._clearance = widest_plan(
            self._planner, known, start, goal, self.own.clearance, self.own.least, self._rng
        )
        return self.solved

    def act(self, reading: Reading) -> Command:
        """See `Policy.act`."""
        unseen = self._take_in(reading)
        self._decide(unseen)
        twist = self._steer()
        if twist is None or (twist[0] < 0.0 and self._around.blind):
            twist = np.zeros(2)
        elif self._peopled and twist[0] < 0.0:
            twist = crawled(twist, self._mission.footprint)
        elif unseen and twist[0] < -CREEP:
            twist = twist * (-CREEP / twist[0])
        twist = self._around.unhurried(twist[None], self._chair.state)[0]
        self._chair.command(twist)
        return Command(twist, self.shown)

    def _take_in(self, reading: Reading) -> bool:
        """Take in a reading; whether what is behind the chair is not to be trusted."""
        around = self._around
        self._map = self._mission.map_at(reading)
        around.update(reading)
        self._chair.measured(reading.twist)
        self._peopled |= len(around.movers) > 0
        if self._draws:
            unseen = blind_behind(self._map, around.pose, self._mission.footprint)
        else:  # somebody is so near that they may be behind the chair the next moment
            unseen = bool((np.hypot(around.movers[:, 0], around.movers[:, 1]) < BEHIND).any())
        around.blind = unseen and not self._headway.tries
        return unseen

    def _decide(self, unseen: bool) -> None:
        """Go on as before, or begin something else."""
        period = self._mission.period
        assert self._reference is not None  # reset made one
        off, bold = self._reference.advance(self._around.pose), self._headway.bold
        if self._headway.come(self._reference.way):
            if bold > self._headway.bold == 0.0:
                self._follow()
            self._detours.end_wait()
        self._headway.lose(period, self.state == "halts")
        self._detours.tick(period)
        self._telling.tick(period)
        self._lost -= period
        if self._look.on:
            redrawn = self._redrawn()
            if self._look.done or (redrawn and not unseen):
                self._look.end()
                self._replan()
            elif redrawn:
                known = assumed(self._map, self._around.pose, self._mission.footprint)
                self._around.chart(known[-2])
        elif self._backing > 0.0:
            self._backing -= period * (CRAWL / BACK if self._peopled else 1.0)
            if self._backing <= 0.0:
                self._anew()
        elif self._lost <= 0.0 and (off > self.own.astray or self._walled() or self._gone()):
            self._replan()
        elif self._barred():
            self._go_round()
        elif self._headway.stalled(self._reference.ended):
            self._stalled()

    def _steer(self) -> Array | None:
        """The next twist (2,) of what the chair is about; None where there is none."""
        assert self._reference is not None
        twist: Array | None = None
        way = self._around, self._reference, self._chair
        if self._look.on:
            twist = self._look.twist(*way, self._mission.period)
        elif self._backing > 0.0:
            twist = back_out(*way)
        if twist is not None:
            self._telling.say("looks round" if self._look.on else "backs out")
            return twist
        twist = self._follower.twist(*way)
        self._telling.follow(twist, self._around.movers, self._planned)
        return twist

    def _stalled(self) -> None:
        """No progress: a new plan, or back out of where the last one did not help either.

        Where nothing temporary stands, a new plan that leads a long way round is no better than the
        old one: the chair backs out to try that once more.
        """
        self._headway.dare()
        self._follow()
        if self._headway.tries % 2:
            assert self._reference is not None
            left, waits = self._reference.left, self._temporary
            self._anew()
            if waits or self._reference.left < left + DETOUR:
                return
        self._backing = self._retreats.begin(self._around.pose[:2]) * self.own.backing

    @property
    def _temporary(self) -> bool:
        """Whether something stands that is not on the map that the chair was given."""
        return not self._draws and len(self._around.standing.stood) > 0

    def _anew(self) -> None:
        """A new plan; where something temporary stands, if that is not a long way round."""
        if self._temporary:
            self._go_round()
        else:
            self._replan()

    def _barred(self) -> bool:
        """Whether a temporary obstacle stands on the next metres of the way."""
        due = self._detours.due(self._mission.period, self.own.redraw)
        if not due or self._draws:
            return False
        assert self._reference is not None
        return barred(self._around.standing, self._reference, self._clearance)

    def _gone(self) -> bool:
        """Whether all is gone that the path leads round."""
        return self._detours.taken and not self._temporary

    def _redrawn(self) -> bool:
        """Whether it is time to look at a map that grows."""
        self._mapped += self._mission.period
        if not self._draws or self._mapped < self.own.redraw:
            return False
        self._mapped = 0.0
        return True

    def _walled(self) -> bool:
        """Whether a wall that was drawn since the last plan stands on the way."""
        if not self._redrawn():
            return False
        assert self._reference is not None
        ahead = self._reference.rows[self._reference.at :]
        return walled(self._map, ahead, self._clearance)
