"""Exact cell decomposition as a planner: from cell to cell through the windows between them."""

from __future__ import annotations

from time import perf_counter

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from planners.exact import SpaceArrays
from planners.graphs.cells import cells_at, decompose, joined
from planners.graphs.roadmap import shortest
from planners.shortcut import shortcut
from planners.types import Plan, Problem, Status, begin, trivial
from wheelchair_gym.config import setting, settings

Array = NDArray[np.float64]
Pairs = NDArray[np.int64]

WINDOW_NODES = 3  # middle, low and high end: paths bend at corners, which are ends of windows


def cut(arrays: SpaceArrays) -> tuple[Pairs, Array, Pairs, Array]:
    """The vertical cells of a space and their windows, as `decompose` returns them."""
    segments = arrays.segments
    upright = segments[:, 0] == segments[:, 2]
    across = np.flatnonzero(~upright)
    lefts, rights = segments[across][:, [0, 2]].min(axis=1), segments[across][:, [0, 2]].max(axis=1)
    return decompose(
        segments,
        np.unique(segments[:, [0, 2]]),
        across[np.argsort(lefts, kind="stable")],
        across[np.argsort(rights, kind="stable")],
    )


@settings
class CellDecomposition:
    """Vertical cell decomposition (Chazelle 1987; Latombe 1991): complete, and soon done.

    It proves it where there is no path. The path is the shortest through the middles and the ends
    of the windows between cells, straightened.
    """

    shortcut: bool = setting(default=True, source="straighten the path, which is never longer then")

    def plan(
        self, problem: Problem, rng: np.random.Generator, deadline: float | None = None
    ) -> Plan:
        """Find a path, within a deadline [s] if there is one; the generator is not used."""
        began, end = begin(deadline)
        plan = trivial(problem)
        if plan is not None:
            return plan
        arrays = problem.free.arrays
        ends = np.array([problem.start[:2], problem.goal[:2]], dtype=np.float64)
        walls, spans, sides, windows = cut(arrays)
        cells = len(walls)
        start_in, goal_in = (cells_at(arrays, walls, spans, *point) for point in ends)
        x, low, high = windows.T
        corners = np.stack([x, 0.5 * (low + high), x, low, x, high], axis=1).reshape(-1, 2)
        pairs = joined(sides, cells, start_in, goal_in, WINDOW_NODES)
        way = shortest(arrays, np.vstack([ends, corners]), pairs, end)
        path, status, note = way.path, Status.SOLVED, ""
        if not len(path):
            links = coo_array((np.ones(len(sides)), sides.T), shape=(cells, cells))
            _, part = connected_components(links, directed=False)
            status, note = Status.NO_PATH, "start and goal lie in parts that do not meet"
            if not way.in_time:
                status, note = Status.EXHAUSTED, "out of time"
            elif np.isin(part[start_in], part[goal_in]).any():
                status, note = Status.EXHAUSTED, "too narrow for the digits of its coordinates"
        elif self.shortcut:
            path = shortcut(path, problem.free)
        return Plan(
            status,
            path,
            counters={"cells": cells, "windows": len(sides), "edges_tested": way.tested},
            timings={"time_s": perf_counter() - began},
            note=note,
        )
