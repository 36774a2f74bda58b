"""A policy of any planner with any follower (T1 3.2.2).

It has named states, shown in pictures and logs as the status of its commands:

    follows      along its path; static obstacles are on the map, and planned around
    goes round   a temporary obstacle blocks the path: a new plan from where the chair is
    halts        an actor is near or on course
    gives way    the same, and the chair moves back from it
    waits        nothing leads on for now: a temporary obstacle blocks the path, or the goal, or
                 the chair stands until there is a plan
    makes room   nothing leads on for a while: to a place away from what blocks the path, so that a
                 leaf can swing and people can pass; then a new plan
    backs out    no progress for a while, and no such place; then a new plan
    looks round  the path leads into unknown space: the chair turns in place to see it first
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import field, replace
from functools import partial
from typing import Any

import numpy as np

from agents.control import make_follower
from agents.control.followers import CREEP, Situation
from agents.control.local_map import LocalMap
from agents.control.rollout import ChairState, ReferencePath
from agents.control.unknown_space import BEYOND, Ground, assumed_maps, blind_behind, walls_block
from agents.policies.planning import Planning, PlanningFigures
from agents.policies.recoveries import (
    AHEAD,
    BACK,
    BLOCKED_SHARE,
    CRAWL,
    DETOUR,
    HALT_SHARE,
    RETRY_TIME,
    ROOM,
    TURNING_SHARE,
    BackUp,
    DetourPolicy,
    ProgressMonitor,
    Spin,
    StatusReport,
    back_up,
    crawled,
    is_blocked,
)
from agents.policies.scripted import episode_rng
from agents.policies.search import Answer, Search
from planners import make_planner
from planners.problem import Plan, Status
from wheelchair_gym.arrays import Array
from wheelchair_gym.config import setting, settings
from wheelchair_gym.maps import OccupancyGrid
from wheelchair_gym.types import Command, Mission, Reading, Shown

Then = Callable[[], object] | None

ACTOR_RANGE = 2.5  # m: with an actor nearer, the chair reverses slowly: no sensor looks back
HELD = 1.0  # s for which people see why there is a new path
NEAR = 1.5  # m of way from the axle's centre: the chair's front, and to rest from 0.8 m/s
STILL = 0.02  # m/s and rad/s: slower, the chair stands
LOOK = 2.0  # s between two plans while the chair looks round
STANDING = 1.0  # s without progress, after which the chair waits for a way to become free
LASTING = 5  # plans without a way round, some 15 s: what blocks the way will not go by itself
REJOIN = 2.0  # m along a plan on which a chair that drove on meanwhile may join it
INSIDE = 0.7  # times the goal's tolerance: so far from it a path may end where the goal is occupied


@settings
class Planned:
    """A planner in the map, and a follower along its path, with recoveries.

    Each new plan begins where the chair is, in the map that the chair has. Temporary obstacles are
    drawn into a given map once they block the path; where no way leads around them, the chair
    keeps its path, and waits. Unknown space of a map that the chair draws itself is taken for
    free, and as soon as a wall shows on the path, the chair plans anew (the free-space assumption:
    Koenig and Likhachev 2005). What was free there once may be free again: where no other way is
    left, or that is much longer, the chair goes and waits there.
    """

    planner: Mapping[str, Any] = field(
        default_factory=lambda: {"name": "a_star"}, metadata={"source": "design choice"}
    )
    """Name and settings of the planner."""
    follower: Mapping[str, Any] = field(
        default_factory=lambda: {"name": "window"}, metadata={"source": "league: most arrivals"}
    )
    """Name and settings of the follower."""
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
    deadline: float = setting(default=1.0, unit="s", low=0.05, source="design choice")
    """Time within which a plan has to be there; planners of a real chair end before."""
    planning_time: float = setting(default=0.0, unit="s", low=0.0, source="design choice")
    """Time that a plan takes in simulation; 0: none, the chair follows it at once."""

    def __post_init__(self) -> None:
        make_planner(dict(self.planner))
        make_follower(self.follower)

    def make(self) -> PlannedDriver:
        """A fresh policy."""
        return PlannedDriver(self)


class PlannedDriver:
    """Plans from where the chair believes it is, follows, and recovers when stuck."""

    def __init__(self, config: Planned) -> None:
        self.config = config
        self._planner = make_planner(dict(config.planner))
        self._follower_settings = self._boldly = make_follower(config.follower)
        if (objective := getattr(self._follower_settings, "objective", None)) is not None:
            bold = replace(objective, clearance=0.0)
            self._boldly = replace(self._follower_settings, objective=bold)

    def reset(self, mission: Mission) -> None:
        """See `Policy.reset`."""
        self._mission = mission
        self._rng = episode_rng(mission, self.config.seed)
        self._local_map = LocalMap(mission)
        self._chair = ChairState(mission.limits, mission.footprint, mission.period)
        self._progress, self._detours = ProgressMonitor(self.config.patience), DetourPolicy()
        self._backup, self._spin = BackUp(), Spin()
        self._backing = 0.0  # s left to back up
        self._aside = False  # the path leads away from what blocks the way
        self._lost = 0.0  # s until a plan that led nowhere is tried again
        self._peopled = False  # an actor has been seen on this drive
        self.plan: Plan | None = None
        self.plans = 0  # made
        self.clearance = self.config.clearance  # m: asked for by the last plan
        self._reference: ReferencePath | None = None
        self._draws = mission.map is None  # the chair draws its own map
        self._looks_back = mission.sensors.looks_back
        self._report = StatusReport(mission.footprint)
        self._follower: Any = None  # begins with the first plan
        self._path: Array | None = None
        self._ground = Ground(mission.footprint)
        self._map = self._map_at(mission.reading)
        self.goal = np.asarray(mission.goal, dtype=np.float64)
        self._held = False  # stands until there is a plan
        self._reopens = False  # the path leads through what was free once
        self._again: Then = None  # asks for one as soon as the chair stands
        self.planning = Planning(
            mission.period, self.config.deadline, self.config.planning_time, mission.real_time
        )
        self._replan()

    @property
    def planning_figures(self) -> PlanningFigures:
        """What planning took in this episode."""
        return self.planning.figures

    def search(self, reading: Reading) -> Search:
        """What a plan from where the chair is, in the map of a reading, is made of."""
        self._map = self._map_at(reading)
        return self._search([self._map])

    def _map_at(self, reading: Reading) -> OccupancyGrid:
        """The newest map; where the chair has stood, one that it draws itself is free."""
        grid = self._mission.map_at(reading)
        return self._ground.marked(grid, np.asarray(reading.pose)) if self._draws else grid

    def aim(self, goal: Array, answer: Answer) -> None:
        """Drive to a goal (2 or 3,) [m, m, rad] from now on, by an answer of `search`."""
        self.goal = np.asarray(goal, dtype=np.float64)
        self._replanned(None, answer)

    @property
    def shown(self) -> Shown:
        """The path that the chair follows, its status, and the roll-out of generated commands."""
        controls = getattr(self._follower, "controls", None)
        return Shown(self._path, self._report.status, self.plans, controls and controls.rollout)

    @property
    def state(self) -> str:
        """The name of the chair's state."""
        return self._report.state

    @property
    def solved(self) -> bool:
        """Whether the last plan leads to the goal."""
        return self.plan is not None and self.plan.status is Status.SOLVED

    @property
    def ended(self) -> bool:
        """Whether the chair has come to the end of its path."""
        return self._reference is not None and self._reference.ended

    def _search(self, maps: list[OccupancyGrid]) -> Search:
        config, mission, start = self.config, self._mission, self._local_map.pose
        drawn = mission.footprint if self._draws else None
        reopened = self._ground.reopened(self._map) if self._draws else self._map
        return Search(
            self._planner, config.clearance, config.least, self._rng, start, maps,
            INSIDE * mission.tolerance, drawn, config.beyond,
            None if reopened is self._map else reopened, self._detours.allowance,
        )  # fmt: skip

    def _replan(self, then: Then = None, held: bool = False) -> None:
        """Plan from where the chair is, and begin the new path if one leads to the goal.

        `then` is called when that is done; if the chair is held, it stands meanwhile.
        """
        self._detours.taken = self._temporary
        painted = [self._local_map.temporary.painted()] if self._temporary else []
        self._ask([*painted, self._map], partial(self._replanned, then), held)

    def _ask(self, maps: list[OccupancyGrid], take: Callable[[Answer], object], held: bool) -> None:
        self.ask(partial(self._search(maps).plan, self.goal), take, held)

    def ask(
        self, make: Callable[[float], Any], take: Callable[[Any], object], held: bool = False
    ) -> None:
        """Begin a plan, see `Planning.ask`; if the chair is held, it stands meanwhile."""
        self._held = held
        self.planning.ask(make, take)

    def _replanned(self, then: Then, answer: Answer) -> None:
        reference = self._received(then, answer)
        if reference is None:
            return
        self.plan, self.clearance = answer.plan, answer.clearance
        looks = False
        if answer.walls is not None:  # the follower never reverses into unknown space
            self._local_map.set_walls(answer.walls)
            looks = answer.unseen and blind_behind(
                self._map, answer.start, self._mission.footprint
            )
            if not looks:
                self._spin.end()
        self._mapped = 0.0
        if self.solved:
            self._progress.stalled_time = 0.0
        plain = self.solved and not self.plan.note
        self._reason = "" if plain else f"{self.plan.status.name} {self.plan.note}".strip()
        self._lost = 0.0 if self.solved else RETRY_TIME  # a search that finds nothing is longest
        # The old path is better than none.
        if self.solved or self._reference is None:
            self._take(reference, answer.reopens)
        if then is not None:
            then()
        if looks and not self._spin.on and self._backing <= 0.0:
            self._spin.begin(answer.start, self.goal)

    def _received(self, then: Then, answer: Answer) -> ReferencePath | None:
        """The path of an answer, from where the chair is by now; None where it no longer fits.

        Then the chair stops, and plans again once it stands: that plan fits where it stands.
        """
        self.plans += answer.searched
        start = answer.start
        # Straight on: the follower still touches nothing, and the next plan begins elsewhere.
        straight = np.stack([start[:2], self.goal[:2]])
        reference = ReferencePath(answer.plan.path if answer.solved else straight, start)
        if self.planning.periods and answer.solved and not self._fits(reference, answer):
            self.planning.figures.discarded += 1
            self._again = partial(self._plan_anew, then, held=True)
            return None
        return reference

    def _fits(self, reference: ReferencePath, answer: Answer) -> bool:
        """Join a path that was planned a while ago; whether that is possible in the newest map."""
        if reference.advance(self._local_map.pose, REJOIN) > self.config.astray:
            return False
        return not self._blocks(reference, AHEAD, answer.clearance, answer.reopens)

    def _take(self, reference: ReferencePath, reopens: bool = False) -> None:
        """Follow a path from now on."""
        if self._reopens and not reopens:
            self._ground.forget_open()  # it is free, or was waited for in vain
        self._reopens = reopens
        self._path, self._reference, self._aside = reference.path, reference, False
        self._follow()
        self._progress.begin()

    def _follow(self) -> None:
        """Begin to follow: boldly for a while where there was no progress."""
        bold = self._progress.bold > 0.0
        self._follower = (self._boldly if bold else self._follower_settings).make()

    def _go_round(self, then: Then = None, held: bool = False) -> None:
        """Plan a detour around temporary obstacles; where there is none, keep the path, and wait.

        T1 3.2.2: temporary obstacles are taken into the plan as soon as they are met.
        """
        self._ask([self._local_map.temporary.painted()], partial(self._went_round, then), held)

    def _went_round(self, then: Then, answer: Answer) -> None:
        detour, before = self._received(then, answer), self._reference
        if detour is None:
            return
        assert before is not None
        blocked = answer.plan.status is Status.GOAL_OCCUPIED
        self._detours.failed = 0 if answer.solved else self._detours.failed + 1
        if not answer.solved:
            self.plan, self.clearance = answer.plan, answer.clearance
            why = "the goal is blocked" if blocked else "no way round"
            self._report.set("waits", why, self._detours.wait())
        elif self._detours.too_long(detour, before):
            self._report.set("waits", "the way round is long", self._detours.wait())
        else:
            self.plan, self.clearance = answer.plan, answer.clearance
            self._take(detour)
            self._detours.taken = True
            self._report.set("goes round", held=HELD)
        if then is not None:
            then()

    def act(self, reading: Reading) -> Command:
        """See `Policy.act`."""
        unseen = self._update(reading)
        if reading.stamp > self._mission.reading.stamp:  # a plan that reset asked for is of step 0
            self.planning.step()
        self._decide(unseen)
        twist = self._steer()
        if twist is None or (twist[0] < 0.0 and self._local_map.blind):
            twist = np.zeros(2)
        elif self._crawls and twist[0] < 0.0:
            twist = crawled(twist, self._mission.footprint)
        elif unseen and twist[0] < -CREEP:
            twist = twist * (-CREEP / twist[0])
        twist = self._local_map.limit_for_unseen_space(twist[None], self._chair.body.state)[0]
        self._chair.command(twist)
        return Command(twist, self.shown)

    def _update(self, reading: Reading) -> bool:
        """Update the local map; whether the space behind the chair may hold something unseen."""
        local_map = self._local_map
        self._map = self._map_at(reading)
        local_map.update(reading)
        self._chair.measured(reading.twist)
        self._peopled |= len(local_map.actors) > 0
        if self._draws:
            unseen = blind_behind(self._map, local_map.pose, self._mission.footprint)
        else:  # an actor so near may be behind the chair the next moment
            distances = np.hypot(local_map.actors[:, 0], local_map.actors[:, 1])
            unseen = not self._looks_back and bool((distances < ACTOR_RANGE).any())
        local_map.blind = unseen and not self._progress.tries
        return unseen

    def _decide(self, unseen: bool) -> None:
        """Go on as before, or begin a recovery."""
        period, progress = self._mission.period, self._progress
        if self._again is not None and np.abs(self._chair.body.state[[0, 2]]).max() < STILL:
            again, self._again = self._again, None
            again()
        if self._reference is None:
            return  # the first plan is being made
        off, bold = self._reference.advance(self._local_map.pose), progress.bold
        if progress.update(self._reference.way):
            if bold > progress.bold == 0.0:
                self._follow()
            self._detours.waited *= self._reopens
        reference = self._reference
        share = BLOCKED_SHARE if reference.blocked else TURNING_SHARE if reference.turning else 1.0
        progress.stalled_time += period * (HALT_SHARE if self.state == "halts" else share)
        self._detours.pause -= period
        if self._reopens and progress.stalled_time > STANDING:
            self._detours.waited += period
        self._report.held -= period
        self._lost -= period
        if self.thinks:
            return
        if self._spin.on:
            if self._spin.done:
                self._spin.end()
                self._replan(held=True)
            elif self._redrawn(LOOK):
                self._replan()
        elif self._backing > 0.0:
            self._backing -= period * (CRAWL / BACK if self._crawls else 1.0)
            if self._backing <= 0.0:
                self._plan_anew(held=True)
        elif self._aside:
            if self._reference.ended or progress.stalled(True):
                self._replan(held=True)
        elif self._lost <= 0.0 and (off > self.config.astray or self._outdated()):
            self._replan()
        elif self._blocked():
            self._go_round()
        elif progress.stalled(self._reference.ended):
            self._recover()

    def _steer(self) -> Array | None:
        """The next twist (2,) in the present state; None where there is none."""
        if self.thinks and self._stands():
            self.planning.figures.stood += self._mission.period
            self._report.set("waits", "for a plan")
            return None
        assert self._reference is not None
        self.planning.figures.followed += self._mission.period * self.thinks
        twist: Array | None = None
        now = Situation(self._local_map, self._reference, self._chair)
        if self._spin.on:
            twist = self._spin.twist(now)
        elif self._backing > 0.0:
            twist = back_up(now)
        if twist is not None:
            self._report.set("looks round" if self._spin.on else "backs out")
            return twist
        twist = self._follower.twist(now)
        if self._aside:
            self._report.set("makes room")
        else:
            self._report.follow(twist, self._local_map.actors, self._reason)
        return twist

    def _recover(self) -> None:
        """No progress: a new plan, or back up from where the last one did not help either.

        Where there is no temporary obstacle, a new plan with a long detour is no better than the
        old one: the chair backs up to try that once more.
        """
        self._progress.retry()
        self._follow()
        if self._progress.tries % 2 and self._detours.failed < LASTING:
            assert self._reference is not None
            self._plan_anew(partial(self._recovered, self._reference.left, self._temporary))
        else:
            self._back_out()

    def _recovered(self, left: float, waits: bool) -> None:
        """Back out if the new plan is longer by a detour than what was left [m] of the old one."""
        assert self._reference is not None
        if not waits and self._reference.left >= left + DETOUR:
            self._back_out()

    def _back_out(self) -> None:
        """Make room for what blocks the path; back out where nothing does or no room is left."""
        blocking = self._local_map.temporary.points if self._temporary else np.empty((0, 2))
        away = np.hypot(*(blocking - self._local_map.pose[:2]).T)
        if not (away < ROOM).any():
            self._back_up()
            return
        search = self._search([self._local_map.temporary.painted()])
        self.ask(partial(search.plan_aside, blocking[away < ROOM]), self._make_room, held=True)

    def _make_room(self, answer: Answer) -> None:
        if not answer.solved:
            self._back_up()
        elif (reference := self._received(None, answer)) is not None:
            self._take(reference)
            self._aside = True

    def _back_up(self) -> None:
        times = self._backup.begin(self._local_map.pose[:2])
        self._backing = self.config.backing * (1 if self._crawls else times)

    @property
    def _crawls(self) -> bool:
        """Whether people may be behind the chair, where no sensor looks."""
        return self._peopled and not self._looks_back

    @property
    def _temporary(self) -> bool:
        """Whether there is an obstacle that is not on the map that the chair was given."""
        return not self._draws and len(self._local_map.temporary.points) > 0

    def _plan_anew(self, then: Then = None, held: bool = False) -> None:
        """A new plan; around temporary obstacles if that is not a long detour."""
        if self._temporary and self._reference is not None:
            self._go_round(then, held)
        else:
            self._replan(then, held)

    @property
    def thinks(self) -> bool:
        """Whether a plan is being made, or will be as soon as the chair stands."""
        return self.planning.busy or self._again is not None

    def _stands(self) -> bool:
        """Whether the chair stands while a plan is made: it goes nowhere, or not by its path."""
        held, reference = self._held or self._again is not None, self._reference
        return (
            held
            or reference is None
            or self._blocks(reference, NEAR, self.clearance, self._reopens)
        )

    def _blocks(
        self, reference: ReferencePath, ahead: float, clearance: float, reopens: bool
    ) -> bool:
        """Whether the newest map shows something on the next metres of a path."""
        if self._draws:
            rows = reference.rows[reference.at :]
            rows = rows[rows[:, 3] < reference.way + ahead]
            return walls_block(self._planned_in(reopens), rows, clearance)
        return is_blocked(self._local_map.temporary, reference, clearance, ahead)

    def _blocked(self) -> bool:
        """Whether a temporary obstacle is on the next metres of the path."""
        due = self._detours.due(self._mission.period, self.config.redraw)
        if not due or self._draws:
            return False
        assert self._reference is not None
        return is_blocked(self._local_map.temporary, self._reference, self.clearance)

    def _planned_in(self, reopens: bool) -> OccupancyGrid:
        """The newest map, or the one in which all is free that was free once."""
        return self._ground.reopened(self._map) if reopens else self._map

    def _redrawn(self, every: float) -> bool:
        """Whether it is time [s] to look at a map that grows."""
        self._mapped += self._mission.period
        if not self._draws or self._mapped < every:
            return False
        self._mapped = 0.0
        return True

    def _outdated(self) -> bool:
        """Whether a newly drawn wall blocks the path, or all is gone that it leads around."""
        assert self._reference is not None
        if self._redrawn(self.config.redraw):
            if self._reopens:  # what the chair waits for may be gone
                maps = assumed_maps(self._map, self._local_map.pose, self._mission.footprint)
                self._local_map.set_walls(maps[1])
            ahead = self._reference.rows[self._reference.at :]
            if walls_block(self._planned_in(self._reopens), ahead, self.clearance):
                return True
        return self._detours.taken and not self._temporary
