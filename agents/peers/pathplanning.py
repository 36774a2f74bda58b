"""Planners of the package `pathplanning`, written in C and C++."""

from __future__ import annotations

import importlib
from functools import partial
from time import perf_counter
from types import SimpleNamespace
from typing import Any, Literal

import numpy as np
import shapely
from numpy.typing import NDArray

from planners import Plan, Problem, Status
from planners.collision.polygon_tests import edge_free
from wheelchair_gym.config import setting, settings

Array = NDArray[np.float64]

UNLIMITED = 1_000_000_000  # iterations, where time is what ends a run


@settings
class Tree:
    """Trees among axis-aligned boxes, with exact tests of edges; a path may not touch a box."""

    planner: Literal["rrt_connect", "rrt_star"]
    step: float = setting(default=5.0, unit="m", source="measured: the best on maps of 50 m")
    """Length of an extension."""
    gamma: float = setting(default=70.0, source="measured; the default of 2 never improves a path")
    """Factor of the radius of rewiring."""
    iterations: int = setting(default=10_000, low=1, source="default of pathplanning")
    """Iterations of rrt_star without a deadline."""
    limit: float = setting(default=10.0, unit="s", low=0.0, source="design choice")
    """Time limit of rrt_connect without a deadline."""

    def prepare(self, case: Any) -> SimpleNamespace | None:
        """The planner for a map of rectangles; None for any other map."""
        if case.rectangles is None or case.problem.clearance > 0.0:
            return None
        model = importlib.import_module("pathplanning.native.continuous_model")
        bounds = np.array(case.problem.space.bounds).reshape(2, 2)
        boxes = {"box_minima": case.rectangles[:, :2], "box_maxima": case.rectangles[:, 2:]}
        native = model.NativeContinuousSpaceModel(*bounds, **boxes)
        space = SimpleNamespace(  # as the package wants it
            bounds=bounds,
            dimension=2,
            distance_metric="euclidean",
            to_native_model=lambda: native,
        )
        return SimpleNamespace(plan=partial(self.plan, space))

    def plan(
        self, space: Any, problem: Problem, rng: np.random.Generator, deadline: float | None = None
    ) -> Plan:
        """The first path, or the best one at the deadline or after all iterations."""
        api = importlib.import_module("pathplanning.api")
        contracts = importlib.import_module("pathplanning.core.contracts")
        params = importlib.import_module("pathplanning.core.params")
        limit = deadline
        if deadline is None and self.planner == "rrt_connect":
            limit = self.limit
        begun = perf_counter()
        start, goal = (np.array(end[:2]) for end in (problem.start, problem.goal))
        found = api.plan_continuous(
            contracts.ContinuousProblem(space, start, contracts.GoalState(goal)),
            planner=self.planner,
            params=params.RrtParams(
                max_iters=self.iterations if self.planner == "rrt_star" else UNLIMITED,
                step_size=self.step,
                rrt_star_radius_gamma=self.gamma,
                time_budget_s=limit,
            ),
            rng=rng,
        )
        return _plan(found.path if found.path is not None else found.best_path, found, begun)


@settings
class LazyThetaStar:
    """Any-angle search on a grid, in which a cell that meets an obstacle is blocked."""

    resolution: float = setting(default=0.1, unit="m", low=0.01, source="as our a_star")
    """Size of a cell."""

    def prepare(self, case: Any) -> ThetaOnMap:
        """The planner for a map."""
        return ThetaOnMap(self, case.problem)


class ThetaOnMap:
    """The grid of one map."""

    def __init__(self, config: LazyThetaStar, problem: Problem) -> None:
        grid = importlib.import_module("pathplanning.spaces.grid2d")
        self.resolution = config.resolution
        free = problem.free
        self._arrays = free.arrays
        x0, y0, x1, y1 = free.bounds
        step = self.resolution
        columns, rows = int((x1 - x0) / step + 1e-9), int((y1 - y0) / step + 1e-9)
        left, low = np.meshgrid(x0 + step * np.arange(columns), y0 + step * np.arange(rows))
        cells = shapely.box(left + 1e-9, low + 1e-9, left + step - 1e-9, low + step - 1e-9)
        solid = free.solid
        shapely.prepare(solid)
        self.origin, self.shape = np.array([x0, y0]), np.array([columns, rows])
        self.space = grid.Grid2DSearchSpace(columns, rows)
        self.space.set_occupancy(shapely.intersects(solid, cells))

    def _cell(self, point: Array) -> tuple[int, int]:
        place = ((np.asarray(point)[:2] - self.origin) / self.resolution + 1e-9).astype(int)
        column, row = np.clip(place, 0, self.shape - 1)
        return int(column), int(row)

    def _joined(self, start: Array, way: list[Array], goal: Array) -> list[Array]:
        """The path with its ends, without the centres of the ends' cells where that is free."""
        arrays = self._arrays
        if len(way) > 1 and edge_free(arrays, *start, *way[1]):
            del way[0]
        if len(way) > 1 and edge_free(arrays, *way[-2], *goal):
            del way[-1]
        return [start, *way, goal]

    def plan(
        self, problem: Problem, rng: np.random.Generator, deadline: float | None = None
    ) -> Plan:
        """The one path; there is no deadline."""
        api = importlib.import_module("pathplanning.api")
        contracts = importlib.import_module("pathplanning.core.contracts")
        begun = perf_counter()
        start, goal = (np.array(end[:2]) for end in (problem.start, problem.goal))
        ends = self._cell(start), self._cell(goal)
        if not all(map(self.space.is_valid_node, ends)):
            return Plan(Status.EXHAUSTED)  # an end lies in a blocked cell
        found = api.plan_discrete(
            contracts.DiscreteProblem(self.space, *ends), planner="lazy_theta_star", rng=rng
        )
        path = found.path
        if path is not None:
            middles = self.origin + (np.asarray(path) + 0.5) * self.resolution
            path = self._joined(start, list(middles), goal)
        return _plan(path, found, begun)


def _plan(path: Any, found: Any, begun: float) -> Plan:
    """Our plan for an answer of the package."""
    counters = {"nodes": int(found.nodes), "iterations": int(found.iters)}
    timings = {"time_s": perf_counter() - begun}
    if path is None:
        return Plan(Status.EXHAUSTED, counters=counters, timings=timings)
    return Plan(
        Status.SOLVED, np.asarray(path, dtype=np.float64), np.empty((0, 4)), counters, timings
    )
