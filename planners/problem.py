"""Problems, plans and their statuses, and the base of planners."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from enum import StrEnum
from typing import TYPE_CHECKING, Any, Protocol, TypeVar

import numpy as np

from planners.collision.polygon_tests import point_free
from wheelchair_gym.base.arrays import Array
from wheelchair_gym.base.errors import shorten
from wheelchair_gym.base.settings import InputError
from wheelchair_gym.compiled.clock import clock
from wheelchair_gym.geometry.planar import path_length, to_frame, to_world

if TYPE_CHECKING:
    from planners.collision.space import Space

Options = TypeVar("Options", bound=tuple[Any, ...])
CHUNK_PERIOD = 2e-3  # s of work between two looks at the clock


class Status(StrEnum):
    """The end of planning; each failure has a name."""

    SOLVED = "solved"
    START_OUTSIDE = "start_outside"  # of the map
    START_OCCUPIED = "start_occupied"  # or nearer to an obstacle than the clearance asked for
    GOAL_OUTSIDE = "goal_outside"
    GOAL_OCCUPIED = "goal_occupied"
    NO_PATH = "no_path"  # proven: start and goal are not connected
    EXHAUSTED = "exhausted"  # iterations, nodes or time ran out first
    STUCK = "stuck"  # nothing near leads on, as in a local minimum


@dataclass(frozen=True)
class Problem:
    """A free space, a start, a goal, and the clearance of the path.

    A path may touch obstacles at exactly the clearance; it may not leave the space's bounds.
    """

    space: Space
    start: Array  # (2,) or (3,) m, m, rad
    goal: Array  # (2,) or (3,)
    clearance: float = 0.0  # m: the radius of the disc that moves along the path
    name: str = ""

    @property
    def free(self) -> Space:
        """The space in which a point may move: obstacles grown by the clearance."""
        return self.space.inflated(self.clearance)

    def in_frame(self) -> Problem:
        """Return the same problem in the frame of its map; `check` refuses ends that are none."""
        frame, ends = self.space.frame, [self.start, self.goal]
        for k, end in enumerate(ends):
            if np.shape(end) in ((2,), (3,)) and np.isfinite(end).all():
                yaw = end[2:] if k or len(end) == 3 else np.zeros(1)  # a start's heading is 0
                ends[k] = np.append(to_frame(end[:2], frame), yaw - frame[2])
        return replace(self, space=self.space.in_frame, start=ends[0], goal=ends[1])


@dataclass(frozen=True)
class Plan:
    """An answer: a status and, if solved, a path from the start to the goal itself.

    Fields and keys that end in `_s` are seconds, and exempt from 'same rng, same plan'.
    """

    status: Status
    path: Array = field(default_factory=lambda: np.empty((0, 2)))  # (n, 2) or (n, 3)
    tree: Array = field(default_factory=lambda: np.empty((0, 4)))  # (k, 4) edges, for pictures
    counters: Mapping[str, int] = field(default_factory=dict)  # nodes, iterations, ...
    timings: Mapping[str, float] = field(default_factory=dict)  # time_s, first_path_s, ...
    note: str = ""  # the reason of a failure, in words

    @property
    def length(self) -> float:
        """Euclidean length of the path [m]; infinite where there is none."""
        return path_length(self.path) if len(self.path) else float("inf")


class Planner(Protocol):
    """A frozen settings object that plans: same problem, same state of `rng`, same plan."""

    def plan(
        self, problem: Problem, rng: np.random.Generator, deadline: float | None = None
    ) -> Plan:
        """Answer a problem; an impossible problem has a status, it is no exception.

        Args:
            problem: the problem.
            rng: draws the numbers, if any.
            deadline: seconds of wall time from the call, without those in which kernels are
                compiled or loaded. Then the planner answers with its best path so far, or, if it
                has none, with `Status.EXHAUSTED`. None: only its own limits count.
                It looks at the clock between chunks of work, which change nothing else:
                `counters["iterations"]`, given as the planner's iterations (its tree's, if it
                has none), makes the same plan without a clock.

        Raises:
            InputError: the deadline is negative or NaN, or the problem is not made of numbers.
        """


class PlannerBase(ABC):
    """Deadline, trivial problems and time of a planner; its `solve` searches."""

    def plan(
        self, problem: Problem, rng: np.random.Generator, deadline: float | None = None
    ) -> Plan:
        """Answer a problem; see `Planner.plan`."""
        began, end = begin(deadline)
        rotated = problem.space.in_frame is not problem.space
        asked = problem.in_frame() if rotated else problem
        plan = self.trivial(asked)
        if plan is None:
            plan = self.solve(asked, rng, end)
            plan = replace(plan, timings={**plan.timings, "time_s": clock() - began})
        return _from_frame(plan, problem) if rotated else plan

    def trivial(self, problem: Problem) -> Plan | None:
        """Return the plan of a problem that needs no search, or None."""
        status = check(problem)
        if status is not None:
            return Plan(status)
        start, goal = problem.start, problem.goal
        if start[0] == goal[0] and start[1] == goal[1]:
            return Plan(Status.SOLVED, np.array([start[:2], goal[:2]], dtype=np.float64))
        return None

    @abstractmethod
    def solve(self, problem: Problem, rng: np.random.Generator, end: float) -> Plan:
        """Search a path until `clock` shows `end` [s], which may be infinite."""


def _from_frame(plan: Plan, problem: Problem) -> Plan:
    """Return a plan made in the frame of a problem's map in world coordinates, ends exactly."""
    frame = problem.space.frame
    path = plan.path.copy()
    path[:, :2] = to_world(path[:, :2], frame)
    path[:, 2:] += frame[2]
    for end, at in ((problem.start, 0), (problem.goal, -1)):
        if len(path) and np.allclose(path[at, :2], end[:2], rtol=0.0, atol=1e-9):
            path[at, :2] = end[:2]
    tree = to_world(plan.tree.reshape(-1, 2), frame).reshape(-1, 4)
    return replace(plan, path=path, tree=tree)


def checked_plan(planner: object, plan: Any) -> Plan:
    """Return the answer of a planner.

    Raises:
        InputError: it is no plan.
    """
    if not isinstance(plan, Plan):
        name = type(planner).__name__
        raise InputError(f"{name}.plan gave {shorten(plan)}; expected a Plan (planners.Plan)")
    return plan


def answer(
    path: Array,
    counters: Mapping[str, int],
    note: str = "",
    failure: Status = Status.EXHAUSTED,
    tree: Array | None = None,
) -> Plan:
    """Return the plan of a path; without points it is a failure, with a note that says why."""
    edges = np.empty((0, 4)) if tree is None else tree
    if len(path):
        return Plan(Status.SOLVED, path, edges, counters)
    return Plan(failure, np.empty((0, 2)), edges, counters, note=note)


def remaining(end: float) -> float | None:
    """Return the seconds until `clock` shows `end`; None if that is infinite."""
    return max(0.0, end - clock()) if end < math.inf else None


def chunks(total: int, end: float) -> Iterator[int]:
    """Yield the number of iterations to reach next, until `total` or until `clock` shows `end` [s].

    At least one chunk is made. Without an end it is the only one.
    """
    made, chunk = 0, total if end == math.inf else min(1, total)
    before = clock()
    while True:
        made += chunk
        yield made
        now = clock()
        if made >= total or now >= end:
            return
        # The first chunks may have prepared or compiled something.
        maximum = int(min(CHUNK_PERIOD, end - now) * chunk / max(now - before, 1e-9))
        chunk, before = min(max(1, min(2 * chunk, maximum)), total - made), now


def with_settings(options: Options, settings: object) -> Options:
    """Return a named tuple of options with the values of settings that have their names.

    A setting that is null leaves the option unchanged.
    """
    given: Any = options
    values = {name: getattr(settings, name, None) for name in given._fields}
    changed: Options = given._replace(**{k: v for k, v in values.items() if v is not None})
    return changed


def begin(deadline: float | None) -> tuple[float, float]:
    """Return the time of `clock`, and the time a deadline [s] later (infinite for None).

    Raises:
        InputError: the deadline is negative or NaN.
    """
    now = clock()
    if deadline is None:
        return now, math.inf
    if not deadline >= 0.0:
        raise InputError(f"deadline is {deadline}; expected seconds, at least 0, or None")
    return now, now + deadline


def check(problem: Problem) -> Status | None:
    """Return why no path can start or end where the problem says; None if one can.

    Raises:
        InputError: the start, the goal or the clearance is not made of finite numbers.
    """
    where = f"problem {problem.name}".rstrip()
    points = {}
    for name, end in (("start", problem.start), ("goal", problem.goal)):
        point = points[name] = np.asarray(end).tolist()
        if np.shape(end) not in ((2,), (3,)) or not all(map(math.isfinite, point)):
            raise InputError(f"{where}: {name} is {point}; expected finite x, y (and yaw)")
    if not 0.0 <= problem.clearance < np.inf:
        raise InputError(f"{where}: clearance is {problem.clearance}; expected metres, at least 0")
    xmin, ymin, xmax, ymax = problem.space.bounds
    arrays = problem.free.arrays
    for name, (x, y, *_) in points.items():
        if not (xmin <= x <= xmax and ymin <= y <= ymax):
            return Status(f"{name}_outside")
        if not point_free(arrays, float(x), float(y)):
            return Status(f"{name}_occupied")
    return None
