"""What is asked and what is answered: problems, plans and their statuses."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import NDArray

from planners.exact import point_free
from wheelchair_gym.config import InputError
from wheelchair_gym.geometry import path_length

if TYPE_CHECKING:
    from planners.space import Space

Array = NDArray[np.float64]


class Status(StrEnum):
    """How planning ended: failure in the world is data with a name."""

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
    """A free space, a start and a goal, and how far from obstacles the path must stay.

    A path may touch what is occupied at exactly the clearance; it may not leave the space's bounds.
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


@dataclass(frozen=True)
class Plan:
    """An answer: a status and, if solved, a path from the start to the goal itself.

    Field and key names that end in `_s` are seconds, and exempt from 'same rng, same plan'.
    """

    status: Status
    path: Array = field(default_factory=lambda: np.empty((0, 2)))  # (n, 2) or (n, 3)
    tree: Array = field(default_factory=lambda: np.empty((0, 4)))  # (k, 4) edges, to look at
    counters: Mapping[str, int] = field(default_factory=dict)  # nodes, iterations, ...
    timings: Mapping[str, float] = field(default_factory=dict)  # time_s, first_path_s, ...
    note: str = ""  # for a person: why there is no path, or why a refinement changed nothing

    @property
    def length(self) -> float:
        """Euclidean length of the path [m]; infinite where there is none."""
        return path_length(self.path) if len(self.path) else float("inf")


class Planner(Protocol):
    """A frozen settings object that plans: same problem, same rng state, same plan."""

    def plan(self, problem: Problem, rng: np.random.Generator) -> Plan:
        """Answer a problem; what the world makes impossible is a status, not an exception."""
        ...


def check(problem: Problem) -> Status | None:
    """Why no path can start or end where the problem says; None if nothing is wrong.

    Raises:
        InputError: the start, the goal or the clearance is not made of finite numbers.
    """
    ends = {"start": np.asarray(problem.start), "goal": np.asarray(problem.goal)}
    where = f"problem {problem.name}".rstrip()
    for name, point in ends.items():
        if point.shape not in ((2,), (3,)) or not np.isfinite(point).all():
            raise InputError(f"{where}: {name} is {point.tolist()}; expected finite x, y (and yaw)")
    if not 0.0 <= problem.clearance < np.inf:
        raise InputError(f"{where}: clearance is {problem.clearance}; expected metres, at least 0")
    xmin, ymin, xmax, ymax = problem.space.bounds
    for name, point in ends.items():
        x, y = float(point[0]), float(point[1])
        if not (xmin <= x <= xmax and ymin <= y <= ymax):
            return Status(f"{name}_outside")
        if not point_free(problem.free.arrays, x, y):
            return Status(f"{name}_occupied")
    return None


def trivial(problem: Problem) -> Plan | None:
    """The plan where there is nothing to search: a bad end, or a goal that is the start."""
    status = check(problem)
    if status is not None:
        return Plan(status)
    start, goal = np.asarray(problem.start)[:2], np.asarray(problem.goal)[:2]
    if np.array_equal(start, goal):
        return Plan(Status.SOLVED, np.array([start, goal], dtype=np.float64))
    return None
