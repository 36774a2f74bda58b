"""A policy of any planner with any follower (T1 3.2.2), as a state machine.

`State` names what the chair does, and `TRANSITIONS`, at the end, is all that leads from one state
to another. In each control period `PlannedDriver.act`

1. updates what the chair knows (`Surroundings`);
2. receives the plan that was asked for, if it is there (`Planning`), and tries the transitions of
   its event: the first one from the present state whose condition holds is taken;
3. tries the transitions of the control period, unless a plan is being made;
4. gets a twist from what drives in the state: `Spin`, `BackUp` or a follower. While a plan is being
   made, the chair stands if the transition says so, or if something blocks its path ahead.

People see the name of the state, and more of a chair that follows its path: see `StatusReport`.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import field, replace
from enum import Enum
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from agents.control import make_follower
from agents.control.followers import Situation
from agents.control.local_map import MAP_MARGIN, blind_behind
from agents.control.rollout import ChairState, ReferencePath
from agents.policies import Policy, recoveries
from agents.policies.planning import Planning, Thinking
from agents.policies.scripted import episode_rng
from agents.policies.search import CRAWL, Answer, Search, Surroundings
from planners import make_planner
from planners.collision.footprint import FootprintPlanner
from planners.problem import Plan, Status
from wheelchair_gym.base.arrays import Array
from wheelchair_gym.base.settings import setting, settings
from wheelchair_gym.maps import OccupancyGrid
from wheelchair_gym.types import Command, Mission, Reading, Shown

HELD = 1.0  # s for which people see why there is a new path
NEAR = 1.5  # m of way from the axle's centre: the chair's front, and to rest from 0.8 m/s
STILL = 0.02  # m/s and rad/s: slower, the chair stands
LOOK = 2.0  # s between two plans while the chair looks round
STANDING = 1.0  # s without progress, after which the chair waits for a way to become free
LASTING = 5  # plans without a way round, some 15 s: what blocks the way will not go by itself
REJOIN = 2.0  # m along a plan on which a chair that drove on meanwhile may join it
INSIDE = 0.6  # of the tolerance: how far from an occupied goal a path may end


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
    seed: int = setting(default=0, low=0)
    """Seed of the planner, with the episode's key."""
    clearance: float = setting(
        default=0.40,
        unit="m",
        low=0.0,
        source="half the chair's width, the pose error and a margin",
    )
    """Clearance that a plan is asked for first; less where no path leads to the goal."""
    min_clearance: float = setting(
        default=0.28, unit="m", low=0.0, source="a cell under half the chair's width"
    )
    """Minimum clearance that a plan is asked for."""
    astray: float = setting(default=0.8, unit="m", low=0.05)
    """Distance from the path above which a new one is planned."""
    beyond: float = setting(default=MAP_MARGIN, unit="m", low=0.5)
    """Distance beyond the known map that paths through the unknown may use."""
    redraw: float = setting(default=0.5, unit="s", low=0.0)
    """Time between two looks at a map that grows."""
    patience: float = setting(default=4.0, unit="s", low=0.5)
    """Time without progress after which a recovery begins."""
    backing: float = setting(default=2.5, unit="s", low=0.1, source="about half the chair's length")
    """Time for which the chair backs out."""
    deadline: float = setting(default=1.0, unit="s", low=0.05)
    """Time within which a plan has to be there; planners of a real chair end before."""
    planning_time: float = setting(default=0.0, unit="s", low=0.0)
    """Time that a plan takes in simulation; 0: none, the chair follows it at once."""

    def __post_init__(self) -> None:
        make_planner(dict(self.planner))
        make_follower(self.follower)

    def make(self) -> Policy:
        """A fresh policy."""
        return PlannedDriver(self)


class State(Enum):
    """An activity of the chair, by the name that people see."""

    FOLLOWS = "follows"
    LOOKS_ROUND = "looks round"
    MAKES_ROOM = "makes room"
    BACKS_OUT = "backs out"


class Event(Enum):
    """When transitions are tried."""

    PERIOD = "a control period, while no plan is being made"
    STALL = "no progress, and the path is no use"
    PLAN = "an answer to a question for a plan is there, also without a path"
    ASIDE = "a path to a place aside is taken"
    NO_ASIDE = "there is no place aside"
    BLOCKED = "the state's own motion is blocked"


class Transition(NamedTuple):
    """A row of `TRANSITIONS`."""

    event: Event
    state: State
    condition: "Callable[[PlannedDriver], bool] | None"  # None: always
    action: "Callable[[PlannedDriver], None] | None"
    next: State
    stands: bool = False  # until the plan is there that the action asks for


class PlannedDriver:
    """Plans from where the chair believes it is, follows, and recovers when stuck.

    Attributes:
        state: what the chair does.
        goal: (2 or 3,) [m, m, rad], to which it plans.
        answer: the plan that was made last, and what it was made of.
        plans: number of maps searched.
        planning: makes plans beside the loop.
    """

    def __init__(self, config: Planned) -> None:
        self.config = config
        self._planner = self._made = make_planner(dict(config.planner))
        self._follower_settings = self._boldly = make_follower(config.follower)
        if (objective := getattr(self._follower_settings, "objective", None)) is not None:
            bold = replace(objective, clearance=0.0)
            self._boldly = replace(self._follower_settings, objective=bold)

    def reset(self, mission: Mission) -> None:
        """See `Policy.reset`."""
        config, pose = self.config, np.asarray(mission.reading.pose, dtype=np.float64)
        self._mission, self.state = mission, State.FOLLOWS
        self._planner = self._fitted(mission)
        self._rng = episode_rng(mission, config.seed)
        self._surroundings = Surroundings(mission)
        self._local_map = self._surroundings.local_map
        self._chair = ChairState(mission.limits, mission.footprint, mission.period)
        self._progress = recoveries.ProgressMonitor(config.patience)
        self._detours = recoveries.DetourPolicy()
        self._spin, self._backup = recoveries.Spin(), recoveries.BackUp(config.backing)
        self._report = recoveries.StatusReport(mission.footprint)
        self.goal, self.plans = np.asarray(mission.goal, dtype=np.float64), 0
        self.answer = Answer(Plan(Status.EXHAUSTED), config.clearance, pose)
        self._path = ReferencePath(pose[None, :2], pose)  # it stands there until it has a plan
        self._clearance = config.clearance  # m, of that path
        self._follower: Any = None  # begins with the first plan
        self._offset = 0.0  # m between the chair and its path
        self._retry_in = 0.0  # s until a plan to the goal is made again after one that led nowhere
        self.planning = Planning(
            mission.period, config.deadline, config.planning_time, mission.real_time
        )
        self.replan()
        self.planning.stand()

    def _fitted(self, mission: Mission) -> Any:
        """The planner, with the outline of the chair and whether it may reverse."""
        made = self._made
        if not isinstance(made, FootprintPlanner) or "footprint" in self.config.planner:
            return made
        backward = min(made.limits.backward, mission.limits.backward)
        limits = replace(made.limits, backward=backward)
        return replace(made, footprint=mission.footprint, limits=limits)

    def act(self, reading: Reading) -> Command:
        """See `Policy.act`."""
        self._surroundings.update(reading, may_reverse_blind=self._progress.tries > 0)
        self._chair.measured(reading.twist)
        motion = self._chair.body.state
        if reading.stamp > self._mission.reading.stamp:  # a plan that reset asked for is of step 0
            self.planning.step(at_rest=np.abs(motion[[0, 2]]).max() < STILL)
        self._measure()
        if not self.planning.busy:
            self._fire(Event.PERIOD)
        twist = self._surroundings.limited(self._steer(), motion)
        self._chair.command(twist)
        return Command(twist, self.shown)

    def _fire(self, event: Event) -> None:
        """Take the first transition of an event whose condition holds, if any does."""
        for row in TRANSITIONS:
            begins = row.event is event and row.state is self.state
            if begins and (row.condition is None or row.condition(self)):
                self.state = row.next
                if row.action is not None:
                    row.action(self)
                if row.stands:
                    self.planning.stand()
                break

    def _measure(self) -> None:
        """Measure the progress along the path; let time pass."""
        period, progress, path = self._mission.period, self._progress, self._path
        self._offset, bold = path.advance(self._local_map.pose), progress.bold
        if progress.update(path, period, self._report.state == "halts"):
            if bold > progress.bold == 0.0:
                self._begin_to_follow()
            self._detours.waited *= path.reopens
        if path.reopens and progress.stalled_time > STANDING:
            self._detours.waited += period
        self._detours.pause -= period
        self._report.held -= period
        self._retry_in -= period

    @property
    def shown(self) -> Shown:
        """The path that the chair follows, its status, and the roll-out of generated commands."""
        controls = getattr(self._follower, "controls", None)
        path = None if self._follower is None else self._path.path
        return Shown(path, self._report.status, self.plans, controls and controls.rollout)

    @property
    def ended(self) -> bool:
        """Whether the chair has come to the end of its path."""
        return self._follower is not None and self._path.ended

    def search(self, reading: Reading) -> Search:
        """Return a search from the chair's place in the map of a reading."""
        self._surroundings.update_map(reading)
        return self._search([self._surroundings.map])

    def aim(self, goal: Array, answer: Answer) -> None:
        """Drive to a goal (2 or 3,) [m, m, rad] from now on, by an answer of `search`."""
        self.goal = np.asarray(goal, dtype=np.float64)
        self._receive_plan(answer)

    def _steer(self) -> Array | None:
        """The next twist (2,) in the present state; None where there is none."""
        if self.planning.busy:
            stands = self.planning.state is not Thinking.DRIVES
            if stands or self._surroundings.blocks(self._path, self._clearance, NEAR):
                self.planning.figures.stood += self._mission.period
                self._report.set("waits", "for a plan")
                return None
            self.planning.figures.followed += self._mission.period
        now = Situation(self._local_map, self._path, self._chair)
        if self.state in (State.LOOKS_ROUND, State.BACKS_OUT):
            manoeuvre = self._spin if self.state is State.LOOKS_ROUND else self._backup
            if (own := manoeuvre.twist(now)) is not None:
                self._report.set(self.state.value)
                return own
            self._fire(Event.BLOCKED)
        twist: Array | None = self._follower.twist(now)
        if self.state is State.MAKES_ROOM:
            self._report.set(self.state.value)
        else:
            self._report.follow(twist, self._local_map.actors)
        return twist

    # ---- conditions of transitions

    def is_astray(self) -> bool:
        """Return True if the chair is more than `astray` off its path."""
        return self._retry_in <= 0.0 and self._offset > self.config.astray

    def is_clear_again(self) -> bool:
        """Return True if all temporary obstacles are gone that the path leads around."""
        gone = self._detours.taken and not self._surroundings.has_obstacles
        return self._retry_in <= 0.0 and gone

    def is_blocked(self) -> bool:
        """Advance the timer; return True if a check, each `redraw`, shows the path blocked."""
        if self._surroundings.draws and self._retry_in > 0.0:
            return False
        due = self._detours.due(self._mission.period, self.config.redraw)
        return due and self._surroundings.blocks_now(self._path, self._clearance)

    def is_stalled(self) -> bool:
        """Return True if there was no progress for `patience`."""
        return self._progress.stalled(self._path.ended)

    def may_plan(self) -> bool:
        """Return True on every second try, if none is under way and fewer than 5 detours failed."""
        progress = self._progress
        due = progress.tries % 2 == 1 and progress.left_before == math.inf
        return due and self._detours.failed < LASTING

    def is_by_obstacle(self) -> bool:
        """Return True if a temporary obstacle is within 2 m."""
        return len(self._surroundings.obstacles_within(recoveries.ROOM)) > 0

    def is_plan_longer(self) -> bool:
        """Return True if a path planned for want of progress is 2 m longer than the last one."""
        return self._path.left >= self._progress.left_before + recoveries.DETOUR

    def is_plan_in_view(self) -> bool:
        """Return True if the plan leads through known space, or it is seen behind the chair."""
        start, grid = self.answer.start, self._surroundings.map
        return not (self.answer.unseen and blind_behind(grid, start, self._mission.footprint))

    def must_look(self) -> bool:
        """Return True if the plan leads to the unseen, and the chair has not turned here yet."""
        return not self.is_plan_in_view() and self._spin.is_new(self.answer.start)

    def has_turned(self) -> bool:
        """Return True if the chair has turned once around."""
        return self._spin.turned > 2.0 * math.pi

    def is_plan_due(self) -> bool:
        """Advance the timer; return True if the last plan was made 2 s ago."""
        return self._detours.due(self._mission.period, LOOK)

    def has_made_room(self) -> bool:
        """Return True if the path aside has ended, or there is no progress on it."""
        return self._path.ended or self._progress.stalled(True)

    def has_backed_out(self) -> bool:
        """Advance the timer; return True if `backing`, longer in one place, is over."""
        crawls = self._surroundings.crawls
        self._backup.left -= self._mission.period * (CRAWL / recoveries.BACK if crawls else 1.0)
        return self._backup.left <= 0.0

    # ---- actions of transitions

    def replan(self) -> None:
        """Plan to the goal: around temporary obstacles, or else through them."""
        self._detours.taken = around = self._surroundings.has_obstacles
        painted = [self._local_map.temporary.painted()] if around else []
        search = self._search([*painted, self._surroundings.map])
        self.planning.ask(partial(search.plan, self.goal), self._receive_plan)

    def plan_anew(self) -> None:
        """Plan around temporary obstacles, if there are any, or to the goal."""
        if self._surroundings.has_obstacles and self._follower is not None:  # T1 3.2.2
            search = self._search([self._local_map.temporary.painted()])
            self.planning.ask(partial(search.plan, self.goal), self._receive_detour)
        else:
            self.replan()

    def give_up(self) -> None:
        """Try the transitions of a stall."""
        self._fire(Event.STALL)

    def dare(self) -> None:
        """Follow more boldly from now on; try the transitions of a stall."""
        self._progress.retry()
        self._begin_to_follow()
        self.give_up()

    def try_plan(self) -> None:
        """Plan around temporary obstacles, if there are any, or to the goal: not much longer."""
        around = self._surroundings.has_obstacles  # then `DetourPolicy` decides
        self._progress.left_before = math.inf if around else self._path.left
        self.plan_anew()

    def plan_aside(self) -> None:
        """Plan to a place that leaves room to what blocks the path."""
        search = self._search([self._local_map.temporary.painted()])
        blocking = self._surroundings.obstacles_within(recoveries.ROOM)
        self.planning.ask(partial(search.plan_aside, blocking), self._receive_aside)

    def back_up(self) -> None:
        """Begin to back up."""
        self._backup.begin(self._local_map.pose[:2], self._surroundings.crawls)

    def turn(self) -> None:
        """Begin to turn towards the goal."""
        self._spin.begin(self.answer.start, self.goal)

    # ---- planning: questions, and what becomes of the answers

    def _search(self, maps: list[OccupancyGrid]) -> Search:
        config, mission = self.config, self._mission
        drawn = mission.footprint if self._surroundings.draws else None
        return Search(
            self._planner, config.clearance, config.min_clearance, self._rng, self._local_map.pose,
            maps, INSIDE * mission.tolerance, drawn, config.beyond, self._surroundings.reopened(),
            self._detours.allowance,
        )  # fmt: skip

    def _path_of(self, answer: Answer) -> ReferencePath | None:
        """The path of an answer, from where the chair is by now; None where it no longer fits.

        Then the chair stops, and plans again once it stands: that plan fits where it stands.
        """
        self.plans += answer.searched
        start, around = answer.start, self._surroundings
        # Straight on: the follower still touches nothing, and the next plan begins elsewhere.
        straight = np.stack([start[:2], self.goal[:2]])
        path = ReferencePath(answer.plan.path if answer.solved else straight, start, answer.reopens)
        if self.planning.periods and answer.solved:
            off = path.advance(self._local_map.pose, REJOIN)
            if off > self.config.astray or around.blocks(path, answer.clearance):
                self.planning.figures.discarded += 1
                self.planning.ask_at_rest(self.plan_anew)
                return None
        return path

    def _receive_plan(self, answer: Answer) -> None:
        """Take a plan to the goal; where it leads nowhere, the old path is better than none."""
        path = self._path_of(answer)
        if path is None:
            return
        self.answer = answer
        if answer.walls is not None:  # the follower never reverses into unknown space
            self._local_map.set_walls(answer.walls)
            self._detours.unchecked = 0.0
        if answer.solved:
            self._progress.stalled_time = 0.0
        self._report.explain(answer.plan)
        # Finding nothing takes longest.
        self._retry_in = 0.0 if answer.solved else recoveries.RETRY_TIME
        if answer.solved or self._follower is None:
            self._take_path(path, answer.clearance)
        self._fire(Event.PLAN)
        self._progress.left_before = math.inf

    def _receive_detour(self, answer: Answer) -> None:
        """Take a plan around temporary obstacles if it is short enough; or keep the path."""
        path, report, detours = self._path_of(answer), self._report, self._detours
        if path is None:
            return
        detours.failed = 0 if answer.solved else detours.failed + 1
        why = "the way round is long"
        if not answer.solved or not detours.too_long(path, self._path):
            self.answer = answer
            blocked = answer.plan.status is Status.GOAL_OCCUPIED
            why = "" if answer.solved else "the goal is blocked" if blocked else "no way round"
        if why:
            detours.pause = recoveries.RETRY_TIME
            report.set("waits", why, recoveries.RETRY_TIME)
        else:
            self._take_path(path, answer.clearance)
            detours.taken = True
            report.set("goes round", held=HELD)
        self._fire(Event.PLAN)
        self._progress.left_before = math.inf

    def _receive_aside(self, answer: Answer) -> None:
        """Take a plan to a place aside, if there is one."""
        if not answer.solved:
            self._fire(Event.NO_ASIDE)
        elif (path := self._path_of(answer)) is not None:
            self._take_path(path, answer.clearance)
            self._fire(Event.ASIDE)

    def _take_path(self, path: ReferencePath, clearance: float) -> None:
        """Follow a path that was planned with a clearance [m] from now on."""
        if self._path.reopens and not path.reopens:
            self._surroundings.floor.forget_open()  # it is free, or was waited for in vain
        self._path, self._clearance = path, clearance
        self._begin_to_follow()
        self._progress.begin()

    def _begin_to_follow(self) -> None:
        """Make a follower, which is bold for a while where there was no progress."""
        bold = self._progress.bold > 0.0
        self._follower = (self._boldly if bold else self._follower_settings).make()


_FOLLOWS, _LOOKS, _MAKES, _BACKS = State
_Row, _Event, _Driver = Transition, Event, PlannedDriver

TRANSITIONS = (
    _Row(_Event.PERIOD, _FOLLOWS, _Driver.is_astray, _Driver.replan, _FOLLOWS),
    _Row(_Event.PERIOD, _FOLLOWS, _Driver.is_clear_again, _Driver.replan, _FOLLOWS),
    _Row(_Event.PERIOD, _FOLLOWS, _Driver.is_blocked, _Driver.plan_anew, _FOLLOWS),
    _Row(_Event.PERIOD, _FOLLOWS, _Driver.is_stalled, _Driver.dare, _FOLLOWS),
    _Row(_Event.STALL, _FOLLOWS, _Driver.may_plan, _Driver.try_plan, _FOLLOWS),
    _Row(_Event.STALL, _FOLLOWS, _Driver.is_by_obstacle, _Driver.plan_aside, _FOLLOWS, True),
    _Row(_Event.STALL, _FOLLOWS, None, _Driver.back_up, _BACKS),
    _Row(_Event.ASIDE, _FOLLOWS, None, None, _MAKES),
    _Row(_Event.NO_ASIDE, _FOLLOWS, None, _Driver.back_up, _BACKS),
    _Row(_Event.PLAN, _FOLLOWS, _Driver.is_plan_longer, _Driver.give_up, _FOLLOWS),
    _Row(_Event.PLAN, _FOLLOWS, _Driver.must_look, _Driver.turn, _LOOKS),
    _Row(_Event.PLAN, _LOOKS, _Driver.is_plan_in_view, None, _FOLLOWS),
    _Row(_Event.PERIOD, _LOOKS, _Driver.has_turned, _Driver.replan, _FOLLOWS, True),
    _Row(_Event.PERIOD, _LOOKS, _Driver.is_plan_due, _Driver.replan, _LOOKS),
    _Row(_Event.BLOCKED, _LOOKS, None, None, _FOLLOWS),
    _Row(_Event.PERIOD, _MAKES, _Driver.has_made_room, _Driver.replan, _FOLLOWS, True),
    _Row(_Event.PERIOD, _BACKS, _Driver.has_backed_out, _Driver.plan_anew, _FOLLOWS, True),
)
