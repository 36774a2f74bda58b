"""What is asked and what is answered: problems, plans and their statuses."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import NDArray

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

    @property
    def length(self) -> float:
        """Euclidean length of the path [m]; infinite where there is none."""
        return path_length(self.path) if len(self.path) else float("inf")


class Planner(Protocol):
    """A frozen settings object that plans: same problem, same rng state, same plan."""

    def plan(self, problem: Problem, rng: np.random.Generator) -> Plan:
        """Answer a problem; what the world makes impossible is a status, not an exception."""
        ...
