"""The problems of a planner benchmark: those of a file, or one of each scene."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import shapely

from agents.evaluation.evaluate import Spec, label, without_labels
from planners import Problem, Space, make_planner
from planners.judge import Judge
from planners.problem_files import read_problems
from wheelchair_gym.base.settings import InputError, suggest
from wheelchair_gym.geometry.outline import Footprint
from wheelchair_gym.scenes import SCENES, make_scene

MARGIN = 0.05  # m between the chair's side and obstacles, in problems made from scenes
SEED = 0  # of the episode from which a problem is made
OPTIMUM = "visibility"  # the planner of the optimum where none is stored
_LISTED = 20  # names in the message about an unknown one


@dataclass(frozen=True)
class Case:
    """A problem with its optimum."""

    problem: Problem
    optimum: float | None  # length of the shortest path [m]; None if unknown
    optimum_source: str  # `file`, the planner that found it, or `unknown`

    @property
    def name(self) -> str:
        """The problem's name."""
        return self.problem.name

    @cached_property
    def digest(self) -> str:
        """A hash of the problem."""
        space, ends = self.problem.space, (self.problem.start, self.problem.goal)
        parts = [shapely.to_wkb(space.solid), repr(space.bounds).encode()]
        parts += [np.asarray(end, dtype=np.float64).tobytes() for end in ends]
        parts.append(repr(self.problem.clearance).encode())
        return hashlib.sha256(b"".join(parts)).hexdigest()[:16]

    @cached_property
    def judge(self) -> Judge:
        """The independent judge of paths."""
        return Judge.of(self.problem)

    @property
    def description(self) -> dict[str, Any]:
        """The case in the results file."""
        return {
            "name": self.name,
            "clearance_m": self.problem.clearance,
            "optimum_m": self.optimum,
            "optimum_from": self.optimum_source,
            "digest": self.digest,
        }

    def fresh_problem(self) -> Problem:
        """Return the same problem on a new map, ready for exact tests."""
        space = Space(self.problem.space.solid, self.problem.space.bounds)
        problem = replace(self.problem, space=space)
        _ = problem.free.arrays
        return problem


def _case(problem: Problem, optimum: float | None = None) -> Case:
    _ = problem.free.arrays
    if optimum is not None:
        return Case(problem, optimum, "file")
    plan = make_planner(OPTIMUM).plan(problem, np.random.default_rng(0))
    if len(plan.path):
        return Case(problem, plan.length, OPTIMUM)
    return Case(problem, None, "unknown")


def stored_cases(path: str | Path, only: Sequence[str] = ()) -> list[Case]:
    """Read the problems of a file, all or the named ones.

    Raises:
        InputError: the file is wrong, or has no problem of a name.
    """
    problems = read_problems(path)
    names = [problem.name for problem, _ in problems]
    if len(set(names)) < len(names):
        raise InputError(f"{path}: two problems share a name")
    wanted = _wanted(names, only, str(path))
    return [_case(problem, optimum) for problem, optimum in problems if problem.name in wanted]


def scene_cases(only: Sequence[str] = ()) -> list[Case]:
    """Make a problem of each scene that needs no file; see `scene_case`.

    Raises:
        InputError: a name is no scene's, or a scene needs a file.
    """
    wanted = _wanted(list(SCENES), only, "scenes")
    cases = []
    for name in wanted:
        try:
            cases.append(scene_case(name))
        except InputError:  # of a scene of recorded worlds, which are not part of the project
            if only:
                raise
    return cases


def scene_case(scene: Spec) -> Case:
    """Make a problem of a scene, for a disc as wide as the chair and a margin.

    Raises:
        InputError: there is no such scene, or it needs a file.
    """
    episode = make_scene(without_labels(scene)).sample(np.random.default_rng(SEED))
    space = Space.from_map(episode.map, episode.walls, episode.discs)
    clearance = Footprint().half_width + MARGIN
    return _case(Problem(space, episode.start, episode.goal, clearance, label(scene)))


def _wanted(names: Sequence[str], only: Sequence[str], where: str) -> list[str]:
    for name in only:
        if name not in names:
            known = ", ".join(names[:_LISTED]) + (", ..." if len(names) > _LISTED else "")
            raise InputError(
                f"--only {name}: not a problem of {where}; there are {known}" + suggest(name, names)
            )
    return [name for name in names if not only or name in only]
