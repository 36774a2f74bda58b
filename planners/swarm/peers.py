"""Optimizers of the library mealpy in the planner `swarm`, with our path costs and exact tests."""

import contextlib
import importlib
import importlib.util
from typing import Any

import numpy as np

from planners.problem import begin
from planners.swarm.optimizers import WHALES, MoveParameters
from planners.swarm.path_cost import PathCost, evaluate, write_curve
from planners.swarm.search import InitialSwarm, SearchResult, SwarmSearch, new_search, result_of
from wheelchair_gym.base.settings import InputError, setting, settings
from wheelchair_gym.compiled.clock import clock


class Evaluator:
    """Evaluates positions (d,); a search keeps the best one and the best exactly valid path."""

    def __init__(self, search: SwarmSearch, end: float) -> None:
        self.search, self.end, self.calls = search, end, 0

    def __call__(self, position: Any) -> float:
        """Return the cost of a position; raise TimeoutError once `clock` has shown `end` [s]."""
        if clock() > self.end and self.calls > 0:
            raise TimeoutError
        self.calls += 1
        search, swarm, at = self.search, self.search.swarm, np.array(position, dtype=np.float64)
        cost, plain = evaluate(
            search.problem, search.path_cost, at, np.inf, search.line_cost[0], search.workspace
        )
        if plain < search.line_cost[0]:
            search.line[:], search.line_cost[0] = search.workspace.line, plain
        if cost < swarm.best_cost[0]:
            swarm.best[:], swarm.best_cost[0] = at, cost
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
        # The optimizer moves its own swarm: of ours it needs the memory alone.
        search = new_search(start, path_cost, MoveParameters(WHALES))
        cost, scattered, made = Evaluator(search, end), start, 0
        while made == 0 or (made < iterations and clock() < end):
            count = max(1, min(cycle, iterations - made))
            with contextlib.suppress(TimeoutError):
                self._run(cost, scattered, count, int(rng.integers(2**31)))
            made += count
            population = search.swarm.best + start.population - start.population[0]
            scattered = start._replace(population=np.clip(population, start.lower, start.upper))
        write_curve(search.problem, search.swarm.best, search.workspace)
        return result_of(search, max(0, cost.calls // len(start.population) - 1))

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
