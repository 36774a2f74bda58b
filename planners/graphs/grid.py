"""Planners on a square grid whose every edge is tested exactly, then straightened.

Each finds a path whenever one exists that stays farther than step / sqrt(2) from everything solid,
its ends included; the step is the resolution, halved as often as `refinements` says where nothing
is found. A grid cannot prove that there is no path: failure is `exhausted`.
"""

from __future__ import annotations

import math
from time import perf_counter
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from planners.exact import fill_buckets
from planners.graphs.grid_search import (
    DEPTH,
    EDGES,
    LENGTH,
    MOST_PUSHES,
    START_PUSHES,
    Frontier,
    Grid,
    Order,
    search_grid,
)
from planners.shortcut import shortcut
from planners.space import SpaceArrays
from planners.types import Plan, Problem, Status, begin, trivial
from wheelchair_gym.config import setting, settings

Array = NDArray[np.float64]

MOST_NODES = 8_000_000  # of one grid: some 300 MB
CHUNK = 20_000  # nodes expanded between two looks at the clock: some 5 ms

RESOLUTION: Final = setting(
    default=0.1, unit="m", source="a tenth of a door's width", low=0.005, high=10.0
)
CONNECTIVITY: Final = setting(default=8, source="fewer turns than with 4")
REFINEMENTS: Final = setting(
    default=2, source="times the resolution is halved where no path is found", low=0, high=6
)
SHORTCUT: Final = setting(default=True, source="straighten the grid path, at no higher cost")
WEIGHT: Final = setting(
    default=0.0,
    source="how much more a metre costs at an obstacle than in the open; 0: length alone",
    low=0.0,
    high=1000.0,
)
COMFORT: Final = setting(
    default=0.5, unit="m", source="clearance that costs no more", low=0.01, high=100.0
)


def _way(arrays: SpaceArrays, grid: Grid, order: Order, end: float) -> tuple[Array, int, bool]:
    """The first path (n, 2) over a grid, or none; nodes expanded; was there time for it?"""
    n = len(grid.walls_near)
    frontier = Frontier(
        cost=np.full(n + 2, math.inf),
        crowding=np.full(n if order.weight > 0.0 else 1, -1.0),
        parent=np.full(n + 2, -1, dtype=np.int64),
        done=np.zeros(n + 2, dtype=np.bool_),
        keys=np.zeros(1),
        items=np.full(1, n, dtype=np.int64),
        counts=np.array([1, 0, 0]),
    )
    frontier.cost[n] = 0.0
    over = False
    while not over:
        size = int(frontier.counts[0])
        room = size + START_PUSHES + MOST_PUSHES * CHUNK
        if len(frontier.keys) < room:  # left untouched beyond its size: it costs no time
            keys, items = np.empty(2 * room), np.empty(2 * room, dtype=np.int64)
            keys[:size], items[:size] = frontier.keys[:size], frontier.items[:size]
            frontier = frontier._replace(keys=keys, items=items)
        over = search_grid(arrays, grid, order, frontier, CHUNK)
        if not over and perf_counter() >= end:
            return np.empty((0, 2)), int(frontier.counts[1]), False
    nodes = [n + 1] if frontier.done[n + 1] else []
    while nodes and nodes[-1] != n:
        nodes.append(int(frontier.parent[nodes[-1]]))
    inner = np.array(nodes[-2:0:-1], dtype=np.int64)
    places = np.stack([inner % grid.columns, inner // grid.columns], axis=1)
    path = np.array([grid.left, grid.low]) + grid.step * places
    return (
        np.vstack([grid.ends[:1], path, grid.ends[1:]]) if nodes else np.empty((0, 2)),
        int(frontier.counts[1]),
        True,
    )


def _planned(
    problem: Problem,
    resolution: float,
    refinements: int,
    order: Order,
    straighten: bool,
    deadline: float | None,
) -> Plan:
    """The plan of a search in some order, on finer and finer grids."""
    began, end = begin(deadline)
    plan = trivial(problem)
    if plan is not None:
        return plan
    arrays = problem.free.arrays
    ends = np.array([problem.start[:2], problem.goal[:2]], dtype=np.float64)
    xmin, ymin, xmax, ymax = problem.free.bounds
    path, total, halvings, note = np.empty((0, 2)), 0, 0, "no way over the finest grid"
    for halvings in range(refinements + 1):
        step = resolution / 2**halvings
        columns, rows = int((xmax - xmin) / step) + 1, int((ymax - ymin) / step) + 1
        if rows * columns > MOST_NODES:
            note = f"a grid of {step:g} m has more than {MOST_NODES:,} points here"
            break
        walls_near = np.zeros(rows * columns, dtype=np.int64)
        corner, nothing = np.array([xmin, ymin, step]), np.empty(0, dtype=np.int32)
        fill_buckets(arrays.segments, corner, rows, columns, walls_near, nothing)
        grid = Grid(walls_near, xmin, ymin, step, columns, ends)
        path, expanded, in_time = _way(arrays, grid, order, end)
        total += expanded
        if not in_time:
            note = "out of time"
            break
        if len(path):
            break
    if len(path) and straighten:
        path = shortcut(path, problem.free, order.weight, order.comfort)
    return Plan(
        Status.SOLVED if len(path) else Status.EXHAUSTED,
        path,
        counters={"nodes": total, "halvings": halvings},
        timings={"time_s": perf_counter() - began},
        note="" if len(path) else note,
    )


@settings
class AStar:
    """The cheapest path over the grid (Hart, Nilsson and Raphael 1968), straightened.

    With a weight it keeps a comfortable distance where there is room.
    """

    resolution: float = RESOLUTION
    connectivity: Literal[4, 8] = CONNECTIVITY
    refinements: int = REFINEMENTS
    shortcut: bool = SHORTCUT
    weight: float = WEIGHT
    comfort: float = COMFORT

    def plan(
        self, problem: Problem, rng: np.random.Generator, deadline: float | None = None
    ) -> Plan:
        """Find a path, within a deadline [s] if there is one; the generator is not used."""
        order = Order(LENGTH, 1.0, self.connectivity == 8, False, self.weight, self.comfort)
        return _planned(problem, self.resolution, self.refinements, order, self.shortcut, deadline)


@settings
class Dijkstra:
    """As A*, without looking towards the goal: the same cost, more nodes (Dijkstra 1959)."""

    resolution: float = RESOLUTION
    connectivity: Literal[4, 8] = CONNECTIVITY
    refinements: int = REFINEMENTS
    shortcut: bool = SHORTCUT
    weight: float = WEIGHT
    comfort: float = COMFORT

    def plan(
        self, problem: Problem, rng: np.random.Generator, deadline: float | None = None
    ) -> Plan:
        """Find a path, within a deadline [s] if there is one; the generator is not used."""
        order = Order(LENGTH, 0.0, self.connectivity == 8, False, self.weight, self.comfort)
        return _planned(problem, self.resolution, self.refinements, order, self.shortcut, deadline)


@settings
class Bfs:
    """Breadth first: the grid path of fewest edges (Moore 1959), straightened."""

    resolution: float = RESOLUTION
    connectivity: Literal[4, 8] = CONNECTIVITY
    refinements: int = REFINEMENTS
    shortcut: bool = SHORTCUT

    def plan(
        self, problem: Problem, rng: np.random.Generator, deadline: float | None = None
    ) -> Plan:
        """Find a path, within a deadline [s] if there is one; the generator is not used."""
        order = Order(EDGES, 0.0, self.connectivity == 8, False, 0.0, 1.0)
        return _planned(problem, self.resolution, self.refinements, order, self.shortcut, deadline)


@settings
class Dfs:
    """Depth first: some grid path, as long as it may be (Tarjan 1972), straightened."""

    resolution: float = RESOLUTION
    connectivity: Literal[4, 8] = CONNECTIVITY
    refinements: int = REFINEMENTS
    shortcut: bool = SHORTCUT

    def plan(
        self, problem: Problem, rng: np.random.Generator, deadline: float | None = None
    ) -> Plan:
        """Find a path, within a deadline [s] if there is one; the generator is not used."""
        order = Order(DEPTH, 0.0, self.connectivity == 8, False, 0.0, 1.0)
        return _planned(problem, self.resolution, self.refinements, order, self.shortcut, deadline)


@settings
class ThetaStar:
    """Lazy Theta* (Nash, Koenig and Tovey 2010): grid points joined by edges of any angle.

    Short, but not always the shortest way over the grid's points.
    """

    resolution: float = RESOLUTION
    refinements: int = REFINEMENTS
    shortcut: bool = SHORTCUT

    def plan(
        self, problem: Problem, rng: np.random.Generator, deadline: float | None = None
    ) -> Plan:
        """Find a path, within a deadline [s] if there is one; the generator is not used."""
        order = Order(LENGTH, 1.0, True, True, 0.0, 1.0)
        return _planned(problem, self.resolution, self.refinements, order, self.shortcut, deadline)
