"""Any optimiser of mealpy, with the same tasks, costs and exact tests as ours."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from planners.swarm.path_cost import PathCost, evaluate, new_workspace
from planners.swarm.search import InitialSwarm, SearchResult
from wheelchair_gym.config import InputError, setting, settings

Array = NDArray[np.float64]

LEAST_TIME = 0.1  # s: mealpy refuses less


@settings
class Mealpy:
    """An optimiser of the library mealpy, which the extra `peers` installs."""

    algorithm: str = setting(default="OriginalWOA", source="a class of mealpy, by its name")
    """Name of a class of mealpy."""
    options: Mapping[str, Any] | None = setting(default=None, source="its own, see mealpy")
    """Arguments of that class."""

    def search(
        self,
        start: InitialSwarm,
        path_cost: PathCost,
        iterations: int,
        rng: np.random.Generator,
        deadline: float | None = None,
    ) -> SearchResult:
        """Let it search from a start.

        Args:
            start: the path_problem and the population.
            path_cost: what paths are path_cost.
            iterations: most epochs, at least one is made.
            rng: seeds the run.
            deadline: seconds of wall time from now; None for none.

        Raises:
            InputError: mealpy is not installed, or has no such optimiser.
        """
        try:
            import mealpy
        except ImportError:
            needs = "pip install 'wheelchair_gym[peers]'"
            raise InputError(f"optimizer mealpy needs: {needs}") from None
        try:
            k, _ = start.population.shape
            model = mealpy.get_optimizer_by_class(self.algorithm)(
                epoch=max(1, iterations), pop_size=k, **(self.options or {})
            )
        except Exception as error:  # whatever it raises, it is about what was asked for
            raise InputError(f"optimizer mealpy: {self.algorithm}: {error}") from None
        workspace = new_workspace(len(start.path_problem.anchors), start.path_problem.pieces)
        found: list[Any] = [np.inf, np.empty((0, 2))]

        def cost_of(position: Array) -> float:
            cost, plain = evaluate(
                start.path_problem, path_cost, np.asarray(position), np.inf, found[0], workspace
            )
            if plain < found[0]:
                found[:] = plain, workspace.line.copy()
            return float(cost)

        bounds = mealpy.FloatVar(lb=start.lower, ub=start.upper)
        best = model.solve(
            {"obj_func": cost_of, "bounds": bounds, "minmax": "min", "log_to": None},
            starting_solutions=list(start.population),
            seed=int(rng.integers(2**31)),
            termination=None if deadline is None else {"max_time": max(deadline, LEAST_TIME)},
        )
        costs = np.array([agent.target.fitness for agent in model.history.list_global_best])
        evaluate(
            start.path_problem, path_cost, np.asarray(best.solution), np.inf, np.inf, workspace
        )
        least = float(best.target.fitness)
        return SearchResult(
            found[1],
            float(found[0]),
            int((costs > least).sum()),
            workspace.line,
            least,
            workspace.points,
            len(costs) - 1,
        )
