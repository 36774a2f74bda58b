"""The entrants of a planner benchmark (all planners of ours, installed peers), and its problems.

A peer (extra `peers`) is a planner of ours with an optimizer of another package, or a settings
object, as `Ompl`, whose `prepare(case)` returns an object for one map, untimed, with
`plan(problem, rng, deadline)` as our planners have it. A new one needs a row of `PEERS`. A new
planner is registered in `planners.PLANNERS`.
"""

import dataclasses
import hashlib
import importlib
import importlib.metadata
import importlib.util
import inspect
import math
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path
from time import perf_counter
from types import FrameType, SimpleNamespace
from typing import Any, Final, Literal, cast

import numba
import numpy as np
import shapely

from agents.evaluation.evaluate import Spec, label, named, without_labels
from planners import PLANNERS, Plan, Problem, Space, Status, make_planner
from planners.collision import polygon_tests
from planners.collision.polygon_tests import SpaceArrays
from planners.judge import Judge
from planners.problem_files import read_problems
from planners.swarm.planner import SwarmPlanner
from wheelchair_gym.base.settings import InputError, dump, setting, settings, suggest
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
    cases = []
    for name in _wanted(list(SCENES), only, "scenes"):
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


EdgeTest = Callable[[float, float, float, float], bool]
PointTest = Callable[[float, float], bool]


def collision_tests(arrays: SpaceArrays) -> tuple[EdgeTest, PointTest]:
    """Our exact tests of edges and points, compiled for one map.

    Passing a map's arrays takes 9 us a call, more than a test; compiling takes a second.
    """
    edge, point = polygon_tests.edge_free, polygon_tests.point_free

    @numba.njit(error_model="numpy")
    def edge_free(ax: float, ay: float, bx: float, by: float) -> bool:
        return edge(arrays, ax, ay, bx, by)

    @numba.njit(error_model="numpy")
    def point_free(x: float, y: float) -> bool:
        return point(arrays, x, y)

    edge_free(0.0, 0.0, 0.0, 0.0)
    point_free(0.0, 0.0)
    return cast(EdgeTest, edge_free), cast(PointTest, point_free)


@settings
class Ompl:
    """A planner of OMPL with its default parameters.

    Its random numbers are one stream of the process, so equal calls give different paths.
    """

    algorithm: Literal["RRTConnect", "InformedRRTstar", "BITstar"]
    limit: float = setting(default=10.0, unit="s", low=0.0)
    """Time limit of a call without a deadline."""

    def prepare(self, case: Any) -> SimpleNamespace:
        """Return the planner for the map of a case of `planner_benchmark`."""
        base = importlib.import_module("ompl.base")
        util = importlib.import_module("ompl.util")
        util.setLogLevel(util.LOG_NONE)
        free = case.problem.free
        edge_free, point_free = collision_tests(free.arrays)
        space, bounds = base.RealVectorStateSpace(2), base.RealVectorBounds(2)
        for axis in range(2):
            bounds.setLow(axis, free.bounds[axis])
            bounds.setHigh(axis, free.bounds[axis + 2])
        space.setBounds(bounds)
        information = base.SpaceInformation(space)
        information.setStateValidityChecker(lambda state: point_free(state[0], state[1]))

        class ExactMotionValidator(base.MotionValidator):  # type: ignore[misc, name-defined]
            def checkMotion(self, a: Any, b: Any) -> bool:  # noqa: N802
                return edge_free(a[0], a[1], b[0], b[1])

        validator = ExactMotionValidator(information)
        information.setMotionValidator(validator)
        information.setup()
        # OMPL does not keep the validator alive.
        return SimpleNamespace(plan=partial(self.plan, information), validator=validator)

    def plan(
        self,
        information: Any,
        problem: Problem,
        rng: np.random.Generator,
        deadline: float | None = None,
    ) -> Plan:
        """The best path at the deadline, or the first path without one."""
        base = importlib.import_module("ompl.base")
        geometric = importlib.import_module("ompl.geometric")
        begun = perf_counter()
        definition = base.ProblemDefinition(information)
        ends = []
        for point in (problem.start, problem.goal):
            state = information.allocState()
            state[0], state[1] = float(point[0]), float(point[1])
            ends.append(state)
        definition.setStartAndGoalStates(*ends)
        left = self.limit
        if deadline is None:  # any path will do
            objective = base.PathLengthOptimizationObjective(information)
            objective.setCostThreshold(base.Cost(math.inf))
            definition.setOptimizationObjective(objective)
        else:
            left = max(deadline - (perf_counter() - begun), 0.0)
        planner = getattr(geometric, self.algorithm)(information)
        planner.setProblemDefinition(definition)
        planner.setup()
        planner.solve(base.timedPlannerTerminationCondition(left))
        timings = {"time_s": perf_counter() - begun}
        if not definition.hasExactSolution():
            return Plan(Status.EXHAUSTED, timings=timings)
        states = definition.getSolutionPath().getStates()
        path = np.array([(state[0], state[1]) for state in states])
        return Plan(Status.SOLVED, path, timings=timings)


EXTRA = "wheelchair_gym[peers]"
UNLIMITED = 10_000_000  # iterations under a deadline, so that time alone ends a run


def _mealpy(algorithm: str) -> SwarmPlanner:
    """A swarm on the way points of a free path: from random starts no swarm finds one in clutter.

    Each run of 100 iterations starts around the best path so far.
    """
    optimizer = {"name": "mealpy", "algorithm": algorithm}
    return SwarmPlanner(optimizer=optimizer, population=10, way_points=20)


# Settings by name, which begins with the package.
PEERS: Final[dict[str, Any]] = {
    "ompl_rrt_connect": Ompl("RRTConnect"),
    "ompl_informed_rrt_star": Ompl("InformedRRTstar"),
    "ompl_bit_star": Ompl("BITstar"),
    "mealpy_woa": _mealpy("OriginalWOA"),
    "mealpy_pso": _mealpy("OriginalPSO"),
}


def package_of(peer: str) -> str:
    """The package that a peer is of."""
    return peer.partition("_")[0]


def installed(package: str) -> bool:
    """Whether a package can be imported."""
    return importlib.util.find_spec(package) is not None


def prepare(settings: Any, case: Any) -> Any:
    """The planner of a peer's settings for the map of a case."""
    return settings.prepare(case) if hasattr(settings, "prepare") else settings


@dataclass(frozen=True)
class Entrant:
    """A planner that takes part."""

    name: str  # in results
    config: Any  # its settings
    unlimited: Any  # its settings under a deadline, without a limit of iterations
    package: str | None = None  # package and version of a peer; None for ours
    timed: bool = True  # whether it takes a deadline
    calls: tuple[str, ...] = ()  # the planners that it calls, if it is a hybrid

    def prepare(self, case: Case) -> tuple[Any, Any]:
        """Return the planners for a map, without and with a deadline."""
        ready = prepare(self.config, case)
        return ready, ready if self.unlimited is self.config else prepare(self.unlimited, case)

    @property
    def description(self) -> dict[str, Any]:
        """The entrant in the results file."""
        return {
            "name": self.name,
            "package": self.package,
            "takes_deadline": self.timed,
            "calls": list(self.calls),
            "settings": settings_dump(self.config),
        }


def settings_dump(planner: Any) -> Any:
    """Return a planner's settings as plain values; without settings, the place of its class."""
    if dataclasses.is_dataclass(planner):
        return dump(planner)
    return {"class": f"{type(planner).__module__}:{type(planner).__qualname__}"}


def make_plan(planner: Any, problem: Problem, seed: int, deadline: float | None = None) -> Plan:
    """Plan with a seed."""
    rng = np.random.default_rng(seed)
    limits = () if deadline is None else (deadline,)
    plan: Plan = planner.plan(problem, rng, *limits)
    return plan


def with_iterations(planner: Any, iterations: int) -> Any:
    """Return a planner with a limit of iterations, also for the planners in its settings."""
    changes: dict[str, Any] = {}
    for field in dataclasses.fields(planner) if dataclasses.is_dataclass(planner) else ():
        value = getattr(planner, field.name)
        if field.name == "iterations" and isinstance(value, int):
            changes[field.name] = iterations
        elif PLANNERS.name_of(value) is not None:
            changes[field.name] = with_iterations(value, iterations)
    return replace(planner, **changes) if changes else planner


def named_planners(values: Any) -> Iterator[str]:
    """Generate the names of planners in settings, such as the one for a first path."""
    if isinstance(values, str) and values in PLANNERS.places:
        yield values
    elif isinstance(values, Mapping):
        for key, value in values.items():
            if key != "name":
                yield from named_planners(value)
            elif value in PLANNERS.places:
                yield value


def called_planners(planner: Any) -> tuple[str, ...]:
    """Return the planners that were called on a small problem, and those named in the settings.

    A planner *object* in the settings, such as the tree of RRT*-WOA, counts only if it was called.
    """
    seen = dict.fromkeys(named_planners(settings_dump(planner)))

    def watch(frame: FrameType, event: str, _: Any) -> None:
        if event == "call" and frame.f_code.co_name == "solve":
            called = frame.f_locals.get("self")
            name = None if called is planner else PLANNERS.name_of(called)
            if name is not None:
                seen[name] = None

    before = sys.getprofile()
    sys.setprofile(watch)
    try:
        make_plan(planner, small_problem(), 0)
    finally:
        sys.setprofile(before)
    return tuple(seen)


def small_problem(clearance: float = 0.0) -> Problem:
    """Make a hall to compile planners on: a block between start and goal, with 1.5 m beside it."""
    space = Space.from_rectangles([(2.0, 1.5, 3.0, 2.5)], (0.0, 0.0, 5.0, 4.0))
    ends = np.array([1.0, 2.0]), np.array([4.0, 2.0])
    return Problem(space, *ends, clearance, "small")


def make_entrants(specs: Sequence[Any], peers: Sequence[str]) -> list[Entrant]:
    """The entrants, compiled: our planners by name or settings with an optional label, and peers.

    Raises:
        InputError: a planner is unknown, or a setting is wrong.
    """
    found = []
    for spec in specs:
        planner = make_planner({key: value for key, value in named(spec).items() if key != "label"})
        calls = called_planners(planner)
        timed = "deadline" in inspect.signature(planner.plan).parameters
        unlimited = with_iterations(planner, UNLIMITED)
        found.append(Entrant(label(spec), planner, unlimited, timed=timed, calls=calls))
    small = Case(small_problem(), None, "unknown")
    for name in peers:
        peer, package = PEERS[name], package_of(name)
        package += f" {importlib.metadata.version(package)}"
        calls = called_planners(prepare(peer, small))
        found.append(Entrant(name, peer, with_iterations(peer, UNLIMITED), package, calls=calls))
    return found


def select_peers(wanted: Sequence[str] | None) -> tuple[list[str], list[str]]:
    """The names of the wanted peers, or of all installed ones, and a line for each missing package.

    Raises:
        InputError: a name is unknown, or its package is not installed.
    """
    for name in wanted or ():
        if name not in PEERS:
            raise InputError(f"peer {name!r} is unknown; there are {', '.join(PEERS)}")
    absent = [one for one in sorted(set(map(package_of, PEERS))) if not installed(one)]
    missing = {one: f"{one} is not installed: pip install '{EXTRA}'" for one in absent}
    for name in wanted or ():
        if package_of(name) in missing:
            raise InputError(f"peer {name}: {missing[package_of(name)]}")
    here = [name for name in PEERS if package_of(name) not in missing]
    return (here, [*missing.values()]) if wanted is None else (list(wanted), [])
