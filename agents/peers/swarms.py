"""Swarms of other packages that move whole paths, with the objective that ours have.

Both set out from a path that is free, ours of RRT-Connect: from a random start no swarm finds one
in clutter.
"""

from __future__ import annotations

import contextlib
import importlib
import math
from time import perf_counter
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from planners import Plan, Problem, Status, make_planner
from planners.collision.polygon_tests import SpaceArrays, edge_free
from wheelchair_gym.compiled.kernel import kernel
from wheelchair_gym.config import setting, settings

Array = NDArray[np.float64]

FIRST = "rrt_connect"
# Whose weights of length and of blocked edges count, and whose bounds of how far points may move.
WEIGHTS: Any = make_planner("rrt_star_woa_global")


@kernel
def shifted_cost(
    space: SpaceArrays, path: Array, shift: Array, shortness: float, collision_free: float
) -> float:
    """Cost of a path (n, 2) [m] with its inner points shifted (2 (n - 2),): thesis, section 2.8."""
    n = path.shape[0]
    cost = 0.0
    ax, ay = path[0, 0], path[0, 1]
    for i in range(1, n):
        bx, by = path[i, 0], path[i, 1]
        if i < n - 1:
            bx += shift[2 * i - 2]
            by += shift[2 * i - 1]
        cost += shortness * math.hypot(bx - ax, by - ay)
        if not edge_free(space, ax, ay, bx, by):
            cost += collision_free
        ax, ay = bx, by
    return cost


def subdivide(path: Array, least: int) -> Array:
    """A path (n, 2) [m] of at least so many inner points: its longest legs are halved."""
    path = np.asarray(path, dtype=np.float64)[:, :2]
    while len(path) - 2 < least:
        k = int(np.hypot(*np.diff(path, axis=0).T).argmax())
        path = np.insert(path, k + 1, 0.5 * (path[k] + path[k + 1]), axis=0)
    return path


def scatter(path: Array, population: int, rng: np.random.Generator) -> Array:
    """Shifts (population, 2 (n - 2)) [m]: none, and points of the ellipse that ours start in."""
    size = (population, len(path) - 2)
    radius, angle = np.sqrt(rng.random(size)), 2 * np.pi * rng.random(size)
    shifts = np.stack([np.cos(angle), np.sin(angle)], axis=-1) * radius[..., None]
    shifts *= (WEIGHTS.width_bound, WEIGHTS.height_bound)
    shifts[0] = 0.0
    return shifts.reshape(population, -1)


def shift_path(path: Array, shift: Array) -> Array:
    """The path (n, 2) [m] with its inner points shifted."""
    path = path.copy()
    path[1:-1] += np.asarray(shift).reshape(-1, 2)
    return path


class Cost:
    """The cost of a path's shifts on a map; it keeps the best, and ends a run that is out of time.

    Args:
        problem: whose map and clearance count.
        path: points (n, 2) [m], all edges free.
        ends: when `perf_counter` shows this [s], a call raises TimeoutError.
    """

    def __init__(self, problem: Problem, path: Array, ends: float = math.inf) -> None:
        self._arrays, self._path, self._ends = problem.free.arrays, path, ends
        self.best, self.least = np.zeros(2 * (len(path) - 2)), math.inf

    def __call__(self, shift: Any) -> float:
        """The cost of shifts (2 (n - 2),) [m]."""
        weights = WEIGHTS.shortness_weight, WEIGHTS.collision_free_weight
        cost = shifted_cost(self._arrays, self._path, shift, *weights)
        if cost < self.least:
            self.best, self.least = np.array(shift), cost
        if perf_counter() > self._ends:
            raise TimeoutError
        return cost


def _plan(
    own: Mealpy | Niapy, problem: Problem, rng: np.random.Generator, deadline: float | None
) -> Plan:
    begun = perf_counter()
    first = make_planner(FIRST).plan(problem, rng)
    if first.status != Status.SOLVED:
        return first
    first_s = perf_counter() - begun
    path = subdivide(first.path, own.way_points)
    ends = math.inf if deadline is None else begun + deadline
    runs = 0
    while perf_counter() < ends:
        cost = Cost(problem, path, ends)
        start = scatter(path, own.population, rng)
        with contextlib.suppress(TimeoutError):
            own.search(cost, start, own.iterations, int(rng.integers(2**31)))
        path = shift_path(path, cost.best)
        runs += 1
        if deadline is None:
            break
    counters = {"nodes": first.counters.get("nodes", 0), "iterations": runs * own.iterations}
    timings = {"first_path_s": first_s, "time_s": perf_counter() - begun}
    return Plan(Status.SOLVED, path, first.tree, counters, timings)


@settings
class Mealpy:
    """A swarm of mealpy on the way points of a free path.

    Under a deadline it begins anew from its best, with another scatter, after each run of so many
    iterations, since its whales slow down over a run.
    """

    algorithm: Literal["WOA", "PSO"]
    population: int = setting(default=10, source="thesis, figure 3.1", low=5)
    way_points: int = setting(default=20, source="at least; as measured of others", low=1)
    iterations: int = setting(default=100, source="of a run: as rrt_star_woa_global", low=1)

    def prepare(self, case: Any) -> Mealpy:
        """Prepare for a map: there is nothing to prepare."""
        return self

    def search(self, cost: Cost, start: Array, iterations: int, seed: int) -> None:
        """One run from shifts (population, 2 (n - 2)); the cost keeps the best."""
        mealpy = importlib.import_module("mealpy")
        model = getattr(getattr(mealpy, self.algorithm), f"Original{self.algorithm}")(
            epoch=iterations, pop_size=len(start)
        )
        reach = _reach(start)
        problem = {
            "bounds": mealpy.FloatVar(lb=-reach, ub=reach),
            "minmax": "min",
            "obj_func": cost,
            "log_to": None,
        }
        model.solve(problem, starting_solutions=list(start), seed=seed)

    def plan(
        self, problem: Problem, rng: np.random.Generator, deadline: float | None = None
    ) -> Plan:
        """Answer with a path that is never longer than the first."""
        return _plan(self, problem, rng, deadline)


@settings
class Niapy:
    """The particle swarm of NiaPy on the way points of a free path, with its own defaults."""

    population: int = setting(default=10, source="thesis, figure 3.1", low=2)
    way_points: int = setting(default=20, source="at least; as measured of others", low=1)
    iterations: int = setting(default=100, source="of a run: as rrt_star_woa_global", low=1)

    def prepare(self, case: Any) -> Niapy:
        """Prepare for a map: there is nothing to prepare."""
        return self

    def search(self, cost: Cost, start: Array, iterations: int, seed: int) -> None:
        """One run from shifts (population, 2 (n - 2)); the cost keeps the best."""
        basic = importlib.import_module("niapy.algorithms.basic")
        problems = importlib.import_module("niapy.problems")
        task_module = importlib.import_module("niapy.task")
        reach = _reach(start)

        class PathCost(problems.Problem):  # type: ignore[misc, name-defined]
            def _evaluate(self, x: Any) -> float:
                return cost(x)

        def given(task: Any, **_: Any) -> tuple[Array, Array]:
            return start.copy(), np.array([task.eval(shift) for shift in start])

        task = task_module.Task(PathCost(start.shape[1], -reach, reach))
        swarm = basic.ParticleSwarmAlgorithm(
            population_size=len(start), initialization_function=given, seed=seed
        )
        population, costs, more = swarm.init_population(task)
        best, least = swarm.get_best(population, costs)
        for _ in range(iterations):
            population, costs, best, least, more = swarm.run_iteration(
                task, population, costs, best, least, **more
            )

    def plan(
        self, problem: Problem, rng: np.random.Generator, deadline: float | None = None
    ) -> Plan:
        """Answer with a path that is never longer than the first."""
        return _plan(self, problem, rng, deadline)


def _reach(start: Array) -> Array:
    """How far each coordinate (2 (n - 2),) may move [m]."""
    return np.tile([WEIGHTS.width_bound, WEIGHTS.height_bound], start.shape[1] // 2)
