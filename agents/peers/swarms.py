"""Swarms of mealpy and NiaPy that move the way points of a path, with our objective.

They start from a path of our RRT-Connect, which is free of collisions: from random starts no swarm
finds one in clutter.
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
# The planner whose weights of the objective, and bounds of the shifts, the peers get, too.
WEIGHTS: Any = make_planner("rrt_star_woa_global")


@kernel
def shifted_cost(
    space: SpaceArrays, path: Array, shift: Array, shortness: float, collision_free: float
) -> float:
    """Our objective `length_free` of a path (n, 2) [m] whose inner points are shifted (2 (n - 2),).

    It has few arguments: a call from Python takes 33 us, of the general objective 67 us.
    """
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
    """A path (n, 2) [m] with at least this many inner points: its longest edges are halved."""
    path = np.asarray(path, dtype=np.float64)[:, :2]
    while len(path) - 2 < least:
        k = int(np.hypot(*np.diff(path, axis=0).T).argmax())
        path = np.insert(path, k + 1, 0.5 * (path[k] + path[k + 1]), axis=0)
    return path


def scatter(path: Array, population: int, rng: np.random.Generator) -> Array:
    """Shifts (population, 2 (n - 2)) [m]: zero, and uniform draws in the ellipse of our start."""
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
    """Our objective `length_free` of a path's shifts; it keeps the best shifts.

    Args:
        problem: whose map and clearance count.
        path: points (n, 2) [m], all edges free.
        ends: time of `perf_counter` [s] after which a call raises TimeoutError.
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


@settings
class PathSwarm:
    """A swarm of another package on the way points of a path without collisions.

    Under a deadline it restarts from its best path after each run, since whales slow down over a
    run.
    """

    package: Literal["mealpy", "niapy"]
    algorithm: Literal["WOA", "PSO"]
    population: int = setting(default=10, low=5, source="thesis, figure 3.1")
    """Paths in the swarm."""
    way_points: int = setting(default=20, low=1, source="as measured for the others")
    """Least number of inner points."""
    iterations: int = setting(default=100, low=1, source="as rrt_star_woa_global")
    """Iterations of a run."""

    def prepare(self, case: Any) -> PathSwarm:
        """The planner for a map; nothing is prepared."""
        return self

    def search(self, cost: Cost, start: Array, iterations: int, seed: int) -> None:
        """One run from shifts (population, 2 (n - 2)); the cost keeps the best."""
        bounds = [WEIGHTS.width_bound, WEIGHTS.height_bound]
        reach = np.tile(bounds, start.shape[1] // 2)
        run = _mealpy if self.package == "mealpy" else _niapy
        run(self.algorithm, cost, start, reach, iterations, seed)

    def plan(
        self, problem: Problem, rng: np.random.Generator, deadline: float | None = None
    ) -> Plan:
        """A path that is never longer than the first one."""
        started = perf_counter()
        first = make_planner(FIRST).plan(problem, rng)
        if first.status != Status.SOLVED:
            return first
        first_s = perf_counter() - started
        path = subdivide(first.path, self.way_points)
        ends = math.inf if deadline is None else started + deadline
        runs = 0
        while perf_counter() < ends:
            cost = Cost(problem, path, ends)
            start = scatter(path, self.population, rng)
            with contextlib.suppress(TimeoutError):
                self.search(cost, start, self.iterations, int(rng.integers(2**31)))
            path = shift_path(path, cost.best)
            runs += 1
            if deadline is None:
                break
        counters = {"nodes": first.counters.get("nodes", 0), "iterations": runs * self.iterations}
        timings = {"first_path_s": first_s, "time_s": perf_counter() - started}
        return Plan(Status.SOLVED, path, first.tree, counters, timings)


def _mealpy(
    algorithm: str, cost: Cost, start: Array, reach: Array, iterations: int, seed: int
) -> None:
    mealpy = importlib.import_module("mealpy")
    model = getattr(getattr(mealpy, algorithm), f"Original{algorithm}")(
        epoch=iterations, pop_size=len(start)
    )
    bounds = mealpy.FloatVar(lb=-reach, ub=reach)
    problem = {"bounds": bounds, "minmax": "min", "obj_func": cost, "log_to": None}
    model.solve(problem, starting_solutions=list(start), seed=seed)


def _niapy(_: str, cost: Cost, start: Array, reach: Array, iterations: int, seed: int) -> None:
    """Its particle swarm with its own default parameters."""
    basic = importlib.import_module("niapy.algorithms.basic")
    problems = importlib.import_module("niapy.problems")
    task_module = importlib.import_module("niapy.task")

    class PathCost(problems.Problem):  # type: ignore[misc, name-defined]
        def _evaluate(self, x: Any) -> float:
            return cost(x)

    def initial(task: Any, **_: Any) -> tuple[Array, Array]:
        return start.copy(), np.array([task.eval(shift) for shift in start])

    task = task_module.Task(PathCost(start.shape[1], -reach, reach))
    swarm = basic.ParticleSwarmAlgorithm(
        population_size=len(start), initialization_function=initial, seed=seed
    )
    population, costs, more = swarm.init_population(task)
    best, least = swarm.get_best(population, costs)
    for _iteration in range(iterations):
        population, costs, best, least, more = swarm.run_iteration(
            task, population, costs, best, least, **more
        )
