"""The planner `swarm`: an optimizer moves way points, and a curve leads through them.

P1's planner `rrt_woa` is one of its settings.
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Final, Literal

import numpy as np

from planners.collision.polygon_tests import blocked_edges
from planners.problem import Plan, PlannerBase, Problem, Status, remaining
from planners.registries import FIRST_PLANNERS, OBJECTIVES, SWARM_OPTIMIZERS
from planners.rrt_star_woa.path_shortening import scatter_in_ellipses
from planners.rrt_star_woa.woa import ShiftBounds
from planners.smoothing.curves import CURVES, POLYLINE, curve
from planners.swarm.optimizers import MIN_POPULATION, WoaModified
from planners.swarm.path_cost import PathProblem, Smooth
from planners.swarm.peers import Mealpy
from planners.swarm.search import (
    InitialSwarm,
    SearchResult,
    new_search,
    run,
    sample_along,
    scatter_bowed,
    split_legs,
)
from planners.trees.rrt import Rrt
from wheelchair_gym.base.arrays import Array
from wheelchair_gym.base.settings import InputError, setting, settings
from wheelchair_gym.compiled.clock import clock
from wheelchair_gym.compiled.random import stream
from wheelchair_gym.geometry.planar import without_repeats

# Times that the legs of a first path are halved until a curve through it is free.
_HALVINGS: Final = 8
_AMONG: Final = 100  # points along the first path from which others are drawn: P1
_MODES: Final = 3  # sine waves along a path
_CURVED: Final = 20  # pieces of a curve's leg, where none are asked for


@settings
class SwarmPlanner(ShiftBounds, PlannerBase):
    """A swarm of paths: a particle is way points, its cost that of a curve through them.

    With a planner for the first path this is a hybrid, which cannot fail where that one succeeds;
    from a straight line or from nothing a swarm may find no valid path: Status.EXHAUSTED.
    """

    optimizer: Any = setting(default="pso", source="measured with the planner benchmark")
    """The optimizer that moves the swarm: a name or an object with a name."""
    objective: Any = setting(default="length_free", source="thesis, section 2.8")
    """The path cost: a name or an object with a name."""
    curve: Literal["polyline", "pchip", "spline"] = setting(
        default="polyline", source="exact edges"
    )
    """The curve through the way points."""
    chordal: bool = setting(default=True, source="the papers space them evenly")
    """Whether knots are spaced by the distance of the way points."""
    pieces: int | None = setting(default=None, low=1)
    """Straight pieces of each leg; null for 1 of a polyline and 20 of a curve."""
    way_points: int = setting(default=0, low=0)
    """Minimum number of way points; a first path may have more."""
    population: int = setting(default=30, low=MIN_POPULATION, high=100_000, source="RRT*-WOA")
    """Number of paths."""
    iterations: int = setting(default=100, low=0, source="as rrt_star_woa_global")
    """Largest number of moves."""
    cycle: int = setting(default=100, low=1, source="as iterations")
    """Moves after which the decreasing factors start again."""
    first: Any = setting(default="rrt_connect")
    """Planner of the first path, 'line' for the straight line, or null for none."""
    scatter: Literal["disc", "bow", "along", "uniform"] = setting(
        default="disc", source="thesis: disc; P1: along; P2 and R1: uniform"
    )
    """Distribution of the population around the first path."""

    def __post_init__(self) -> None:
        """Check the names and settings of the parts, and keep them as plain objects."""
        parts = {"optimizer": SWARM_OPTIMIZERS, "objective": OBJECTIVES}
        if self.first not in (None, "line"):
            parts["first"] = FIRST_PLANNERS
        elif self.way_points < 1:
            raise InputError("way_points is 0; without a first path it must be at least 1")
        elif self.first is None and self.scatter != "uniform":
            raise InputError(
                f"scatter is {self.scatter!r}; without a first path it must be uniform"
            )
        for key, registry in parts.items():
            spec = registry.spec(getattr(self, key))
            registry.make(spec)
            object.__setattr__(self, key, spec["name"] if len(spec) == 1 else spec)

    def start(self, problem: Problem, path: Array | None, rng: np.random.Generator) -> InitialSwarm:
        """Return the problem and the population that a search begins with.

        Args:
            problem: the problem.
            path: the first path (n, 2) [m], or None.
            rng: draws the population.
        """
        free = problem.free
        start, goal = (np.array(end[:2], dtype=np.float64) for end in (problem.start, problem.goal))
        kind, pieces = CURVES[self.curve], self.pieces
        if pieces is None:
            pieces = 1 if kind == POLYLINE else _CURVED
        if path is None:
            path = np.stack([start, goal])
        while len(path) - 2 < self.way_points:
            longest = np.hypot(*np.diff(path, axis=0).T).argmax()
            path = split_legs(path, np.arange(len(path) - 1) == longest)
        if isinstance(self.first, str | Mapping) and self.first != "line" and kind != POLYLINE:
            for _ in range(_HALVINGS):
                line = curve(path, self.curve, pieces, self.chordal)
                edges = blocked_edges(free.arrays, line).reshape(len(path) - 1, -1)
                blocked = np.asarray(edges.any(axis=1))
                if not blocked.any():
                    break
                # Neighbours, too: the slopes of a leg depend on them.
                blocked[1:] |= blocked[:-1].copy()
                blocked[:-1] |= blocked[1:].copy()
                path = split_legs(path, blocked)
        inner = path[1:-1]
        n = len(inner)
        low, high = np.array(free.bounds).reshape(2, 2)
        if self.scatter in ("disc", "bow"):
            anchors, box = inner, np.tile([self.width_bound, self.height_bound], n)
            lower, upper = -box, box
            size = self.population, n, self.width_bound, self.height_bound
            if self.scatter == "disc":
                population = scatter_in_ellipses(*size, stream(rng))
            else:
                population = scatter_bowed(*size, _MODES, rng)
        else:
            anchors, lower, upper = np.zeros((n, 2)), np.tile(low, n), np.tile(high, n)
            if self.scatter == "along":
                drawn = [
                    sample_along(path, n, _AMONG, rng).ravel() for _ in range(self.population - 1)
                ]
                population = np.vstack([inner.ravel(), *drawn])
            else:
                population = rng.uniform(lower, upper, (self.population, 2 * n))
                if self.first is not None:
                    population[0] = inner.ravel()
        path_problem = PathProblem(
            free.arrays, free.discs, start, goal, anchors.copy(), kind, self.chordal, pieces
        )
        return InitialSwarm(path_problem, population, lower, upper)

    def search(
        self, start: InitialSwarm, rng: np.random.Generator, deadline: float | None = None
    ) -> SearchResult:
        """Return the result of a search from a start, which stays unchanged.

        Args:
            start: the problem and the population.
            rng: draws the moves.
            deadline: seconds of wall time from now; None for none.
        """
        optimizer = SWARM_OPTIMIZERS.make(self.optimizer)
        path_cost = OBJECTIVES.make(self.objective).path_cost
        if isinstance(optimizer, Mealpy):
            return optimizer.search(start, path_cost, self.iterations, self.cycle, rng, deadline)
        search = new_search(start, path_cost, optimizer.parameters)
        return run(search, self.iterations, self.cycle, stream(rng), deadline)

    def solve(self, problem: Problem, rng: np.random.Generator, end: float) -> Plan:
        """Return the cheapest valid path of all candidates.

        The planner of the first path may use the full deadline; then the swarm makes one
        iteration. The counter `first_iterations` is its iterations, which replay a plan.
        """
        began = clock()
        path: Array | None = None
        first, hybrid = Plan(Status.EXHAUSTED), self.first not in (None, "line")
        if hybrid:
            first = FIRST_PLANNERS.make(self.first).plan(problem, rng, remaining(end))
        counters = {"nodes": first.counters.get("nodes", 0), "iterations": 0}
        if "iterations" in first.counters:
            counters["first_iterations"] = first.counters["iterations"]
        if hybrid:
            if first.status != Status.SOLVED:
                return replace(first, counters=dict(first.counters) | counters)
            path = first.path[:, :2]
        first_s = clock() - began
        start = self.start(problem, path, rng)
        if len(start.path_problem.anchors) > 0:
            found = self.search(start, rng, remaining(end))
            counters["iterations"] = found.iterations
            if len(found.line):
                path = found.line
        timings = {"first_s": first_s}
        if path is None:
            return Plan(Status.EXHAUSTED, counters=counters, timings=timings)
        return Plan(Status.SOLVED, without_repeats(path), first.tree, counters, timings)


_P1 = "P1: Saleh, Borhan and Rahiman 2024"


@settings
class RrtWoa(PlannerBase):
    """RRT, then whales whose C counts where the best path is free (P1).

    The first whale is the RRT's path, the others are points drawn from 100 along it, in order.
    """

    tree: Rrt = setting(default=Rrt(), source=_P1)
    """The tree search."""
    whales: WoaModified = setting(default=WoaModified(), source=_P1 + " (17)-(19)")
    """The whales."""
    population: int = setting(default=30, low=MIN_POPULATION, high=100_000, source="as swarm")
    """Number of whales."""
    iterations: int = setting(default=20, low=0, source=_P1)
    """Moves of the swarm."""

    @property
    def swarm(self) -> SwarmPlanner:
        """The same settings as those of the planner `swarm`."""
        return SwarmPlanner(
            optimizer=self.whales,
            objective=Smooth(),  # (1)-(8)
            curve="pchip",
            population=self.population,
            iterations=self.iterations,
            cycle=20,
            first=self.tree,
            scatter="along",
        )

    def solve(self, problem: Problem, rng: np.random.Generator, end: float) -> Plan:
        """Return the cheapest valid curve of all whales."""
        return self.swarm.solve(problem, rng, end)
