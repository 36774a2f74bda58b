"""Optimizers of the library mealpy in the planner `swarm`, with our path costs and exact tests."""

from __future__ import annotations

import contextlib
import importlib
import importlib.util
from typing import Any

import numpy as np

from planners.problem import begin
from planners.swarm.path_cost import PathCost, evaluate, new_workspace
from planners.swarm.search import InitialSwarm, SearchResult
from wheelchair_gym.compiled.clock import clock
from wheelchair_gym.config import InputError, setting, settings


class Evaluator:
    """Evaluates positions (d,), and keeps the best one and the best exactly valid path."""

    def __init__(self, start: InitialSwarm, path_cost: PathCost, end: float) -> None:
        self.problem, self.path_cost, self.end = start.path_problem, path_cost, end
        self.workspace = new_workspace(self.problem)
        self.calls, self.best, self.least = 0, start.population[0], np.inf
        self.line, self.valid_cost = np.empty((0, 2)), np.inf

    def __call__(self, position: Any) -> float:
        """Return the cost of a position; raise TimeoutError once `clock` has shown `end` [s]."""
        if clock() > self.end and self.calls > 0:
            raise TimeoutError
        at = np.array(position, dtype=np.float64)
        cost, plain = evaluate(
            self.problem, self.path_cost, at, np.inf, self.valid_cost, self.workspace
        )
        self.calls += 1
        if plain < self.valid_cost:
            self.line, self.valid_cost = self.workspace.line.copy(), float(plain)
        if cost < self.least:
            self.best, self.least = at, float(cost)
        return float(cost)


@settings
class Mealpy:
    """An optimizer of the library mealpy, which the extra `peers` installs."""

    algorithm: str = setting(default="OriginalWOA", source="a class of mealpy, by its name")
    """Name of a class of mealpy."""

    def search(
        self,
        start: InitialSwarm,
        path_cost: PathCost,
        iterations: int,
        cycle: int,
        rng: np.random.Generator,
        deadline: float | None = None,
    ) -> SearchResult:
        """Return the best of runs of `cycle` iterations, each scattered around the best so far.

        Args:
            start: the problem and the population of the first run.
            path_cost: the terms of the cost.
            iterations: largest number of iterations in all; at least one is made.
            cycle: iterations of a run.
            rng: seeds the runs.
            deadline: seconds of wall time from now; None for none.

        Raises:
            InputError: mealpy is not installed, or has no such optimizer.
        """
        if importlib.util.find_spec("mealpy") is None:
            raise InputError("optimizer mealpy needs: pip install 'wheelchair_gym[peers]'")
        _, end = begin(deadline)
        cost, scattered, made = Evaluator(start, path_cost, end), start, 0
        while made == 0 or (made < iterations and clock() < end):
            count = max(1, min(cycle, iterations - made))
            with contextlib.suppress(TimeoutError):
                self._run(cost, scattered, count, int(rng.integers(2**31)))
            made += count
            population = cost.best + start.population - start.population[0]
            scattered = start._replace(population=np.clip(population, start.lower, start.upper))
        k, workspace = len(start.population), cost.workspace
        evaluate(cost.problem, path_cost, cost.best, np.inf, np.inf, workspace)
        return SearchResult(
            cost.line,
            cost.valid_cost,
            workspace.line,
            cost.least,
            workspace.points,
            max(0, cost.calls // k - 1),
        )

    def _run(self, cost: Evaluator, start: InitialSwarm, iterations: int, seed: int) -> None:
        """Search once; the evaluator keeps the best."""
        mealpy = importlib.import_module("mealpy")
        try:
            model = mealpy.get_optimizer_by_class(self.algorithm)(
                epoch=iterations, pop_size=len(start.population)
            )
        except Exception as error:  # whatever it raises, it is about what was asked for
            raise InputError(f"optimizer mealpy: {self.algorithm}: {error}") from None
        bounds = mealpy.FloatVar(lb=start.lower, ub=start.upper)
        problem = {"bounds": bounds, "minmax": "min", "obj_func": cost, "log_to": None}
        model.solve(problem, starting_solutions=list(start.population), seed=seed)
