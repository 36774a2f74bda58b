"""The entrants of a planner benchmark: all registered planners, and installed peers.

A peer (extra `peers`) is a planner of ours with an optimizer of another package, or a settings
object, as `Ompl`, whose `prepare(case)` returns an object for one map, untimed, with
`plan(problem, rng, deadline)` as our planners have it. A new one needs a row of `PEERS`. A new
planner is registered in `planners.PLANNERS`.
"""

from __future__ import annotations

import dataclasses
import importlib
import importlib.metadata
import importlib.util
import inspect
import math
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from time import perf_counter
from types import FrameType, SimpleNamespace
from typing import Any, Final, Literal, cast

import numba
import numpy as np

from agents.benchmarks.cases import Case
from planners import PLANNERS, Plan, Problem, Space, Status, make_planner
from planners.collision import polygon_tests
from planners.collision.polygon_tests import SpaceArrays
from planners.swarm.planner import SwarmPlanner
from wheelchair_gym.base.settings import InputError, dump, setting, settings

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
        values = {"name": spec} if isinstance(spec, str) else dict(spec)
        label = str(values.pop("label", values.get("name")))
        planner = make_planner(values)
        calls = called_planners(planner)
        timed = "deadline" in inspect.signature(planner.plan).parameters
        unlimited = with_iterations(planner, UNLIMITED)
        found.append(Entrant(label, planner, unlimited, timed=timed, calls=calls))
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
