"""Planners on a square grid whose every edge is tested exactly, then straightened.

A*, Dijkstra, breadth-first and depth-first search are values of one search. Edges are tested
against the polygons themselves: a cell that no wall comes near needs no test.

Each finds a path whenever one exists that stays farther than step / sqrt(2) from everything solid,
its ends included; the step is the resolution, halved up to `refinements` times where no path
is found. A grid cannot prove that there is no path: failure is `exhausted`.
"""

import math
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from planners.collision.polygon_tests import SpaceArrays, clearance, edge_free, fill_buckets
from planners.graphs.heap import Heap, new_heap, nodes_to, pop, push
from planners.problem import Plan, PlannerBase, Problem, answer, with_settings
from planners.smoothing.shortcut import edge_cost, shortcut
from wheelchair_gym.base.arrays import Array
from wheelchair_gym.base.settings import setting, settings
from wheelchair_gym.compiled.clock import clock
from wheelchair_gym.compiled.kernel import absorbed_kernel, borrowing_kernel

NEAR = 2  # grid steps within which the start and the goal are joined to the grid
TIE = 1.0 + 1e-9  # factor of the distance left: of paths of equal length, the deepest comes first
LENGTH, EDGES, DEPTH = 0, 1, 2  # first comes the shortest, the fewest edges, the latest node met
MAX_PUSHES = 9  # by one node that is expanded: its neighbours and the goal
START_PUSHES = (2 * NEAR + 2) ** 2 + 1  # by the start


class Grid(NamedTuple):
    """Points at corner + (j, i) * step; node i * columns + j, then the start and the goal."""

    walls_near: NDArray[np.int64]  # (rows * columns,): segments near the cell right of and above
    left: float  # m
    low: float  # m
    step: float  # m
    columns: int
    ends: Array  # (2, 2) m: start, goal


class Order(NamedTuple):
    """The order in which nodes are expanded, and their possible parents."""

    by: int = LENGTH  # or EDGES or DEPTH
    ahead: float = 1.0  # weight of the distance left: 1 is A*, 0 Dijkstra
    diagonal: bool = True
    # The weight and the comfort of `edge_cost`.
    obstacle_weight: float = 0.0
    desired_clearance: float = 1.0  # m


class Frontier(NamedTuple):
    """A search under way; arrays only, so that it may stop and go on."""

    cost: Array  # (n + 2,)
    crowding: Array  # (n,) or (1,): how near walls are, 0 to 1; -1: not looked at yet
    parent: NDArray[np.int64]  # (n + 2,)
    done: NDArray[np.bool_]  # (n + 2,)
    heap: Heap  # of nodes
    counts: NDArray[np.int64]  # (2,): nodes expanded, nodes met


@borrowing_kernel
def _way_left(dx: float, dy: float, order: Order) -> float:
    """Return the length of the shortest path in open space: octile or Manhattan."""
    dx, dy = abs(dx), abs(dy)
    return max(dx, dy) + (math.sqrt(2.0) - 1.0 if order.diagonal else 1.0) * min(dx, dy)


@borrowing_kernel
def _place(grid: Grid, u: int) -> tuple[float, float]:
    """Return the position of a node [m]."""
    n = grid.walls_near.shape[0]
    if u >= n:
        return grid.ends[u - n, 0], grid.ends[u - n, 1]
    return grid.left + (u % grid.columns) * grid.step, grid.low + (u // grid.columns) * grid.step


@absorbed_kernel
def _edge_length(
    arrays: SpaceArrays, grid: Grid, order: Order, crowding: Array, u: int, v: int, far: float
) -> float:
    """Return the length [m] of an edge from u to v, increased near obstacles."""
    weight, comfort = order.obstacle_weight, order.desired_clearance
    if weight == 0.0:
        return far
    if u == grid.walls_near.shape[0]:
        (x, y), (vx, vy) = _place(grid, u), _place(grid, v)
        return edge_cost(arrays, x, y, vx, vy, weight, comfort)
    for w in (u, v):
        if crowding[w] < 0.0:
            wx, wy = _place(grid, w)
            crowding[w] = max(0.0, 1.0 - clearance(arrays, wx, wy) / comfort)
    return far * float(1.0 + 0.5 * weight * (crowding[u] + crowding[v]))


@absorbed_kernel
def _expand(arrays: SpaceArrays, grid: Grid, order: Order, frontier: Frontier, u: int) -> None:
    """Offer a node as the parent of the grid points around it."""
    cost, crowding, parent, done, heap, counts = frontier
    step, columns, n = grid.step, grid.columns, grid.walls_near.shape[0]
    rows, gx, gy = n // columns, grid.ends[1, 0], grid.ends[1, 1]
    x, y = _place(grid, u)
    i, j = int((y - grid.low) / step + 0.5), int((x - grid.left) / step + 0.5)
    if u == n:
        i, j = int((y - grid.low) / step), int((x - grid.left) / step)
    reach = NEAR if u == n else 1
    for di in range(-reach, reach + 1 + (u == n)):
        for dj in range(-reach, reach + 1 + (u == n)):
            vi, vj = i + di, j + dj
            if u != n and (not order.diagonal and di != 0 and dj != 0):
                continue
            if vi < 0 or vi >= rows or vj < 0 or vj >= columns:
                continue
            v = vi * columns + vj
            if done[v]:
                continue
            vx, vy = _place(grid, v)
            far = math.hypot(vx - x, vy - y)
            if order.by == LENGTH and cost[u] + far >= cost[v]:
                continue
            if order.by == EDGES and cost[u] + 1.0 >= cost[v]:
                continue
            walls = u == n or grid.walls_near[min(i, vi) * columns + min(j, vj)] > 0
            if walls and not edge_free(arrays, x, y, vx, vy):
                continue
            counts[1] += 1
            new_cost = cost[u] + _edge_length(arrays, grid, order, crowding, u, v, far)
            if order.by != LENGTH:
                new_cost = cost[u] + 1.0 if order.by == EDGES else -float(counts[1])
            if new_cost < cost[v]:
                cost[v], parent[v] = new_cost, u
                left = order.ahead * TIE * _way_left(gx - vx, gy - vy, order)
                push(heap, new_cost + left, v)


@borrowing_kernel
def _try_goal(arrays: SpaceArrays, grid: Grid, order: Order, frontier: Frontier, u: int) -> None:
    """Join a node near the goal to it, if it sees the goal."""
    cost, parent, n = frontier.cost, frontier.parent, grid.walls_near.shape[0]
    gx, gy = grid.ends[1, 0], grid.ends[1, 1]
    x, y = _place(grid, u)
    far = edge_cost(arrays, x, y, gx, gy, order.obstacle_weight, order.desired_clearance)
    if u != n and far > 0.0:  # counted as by the grid, or the estimate were no bound
        far *= _way_left(gx - x, gy - y, order) / math.hypot(gx - x, gy - y)
    new_cost = cost[u] + far
    if order.by != LENGTH:
        new_cost = cost[u] + 1.0 if order.by == EDGES else -math.inf
    if new_cost < cost[n + 1] and edge_free(arrays, x, y, gx, gy):
        cost[n + 1], parent[n + 1] = new_cost, u
        push(frontier.heap, new_cost, n + 1)


@borrowing_kernel
def search_grid(
    arrays: SpaceArrays, grid: Grid, order: Order, frontier: Frontier, budget: int
) -> bool:
    """Expand up to `budget` nodes; return whether the goal is reached or no node is left."""
    done, n, reach = frontier.done, grid.walls_near.shape[0], NEAR * grid.step
    gx, gy = grid.ends[1, 0], grid.ends[1, 1]
    for _ in range(budget):
        if frontier.heap.size[0] == 0:
            return True
        u = pop(frontier.heap)
        if done[u]:
            continue
        done[u] = True
        if u == n + 1:
            return True
        frontier.counts[0] += 1
        _expand(arrays, grid, order, frontier, u)
        x, y = _place(grid, u)
        if (abs(gx - x) <= reach and abs(gy - y) <= reach) or u == n:
            _try_goal(arrays, grid, order, frontier, u)
    return False


MAX_NODES = 8_000_000  # of one grid: some 300 MB
CHUNK = 20_000  # nodes expanded between two looks at the clock: some 5 ms


def _way(arrays: SpaceArrays, grid: Grid, order: Order, end: float) -> tuple[Array, int, bool]:
    """Return the first path (n, 2) over a grid, or none; nodes expanded; whether time sufficed."""
    n = len(grid.walls_near)
    frontier = Frontier(
        cost=np.full(n + 2, math.inf),
        crowding=np.full(n if order.obstacle_weight > 0.0 else 1, -1.0),
        parent=np.full(n + 2, -1, dtype=np.int64),
        done=np.zeros(n + 2, dtype=np.bool_),
        heap=new_heap(MAX_PUSHES * n + START_PUSHES),
        counts=np.zeros(2, np.int64),
    )
    frontier.cost[n] = 0.0
    frontier.heap.keys[0], frontier.heap.items[0], frontier.heap.size[0] = 0.0, n, 1
    over = False
    while not over and not (frontier.counts[0] > 0 and clock() >= end):
        over = search_grid(arrays, grid, order, frontier, CHUNK)
    path = np.empty((0, 2))
    if frontier.done[n + 1]:
        inner = nodes_to(frontier.parent, n + 1)[1:-1]
        places = np.stack([inner % grid.columns, inner // grid.columns], axis=1)
        inner_points = np.array([grid.left, grid.low]) + grid.step * places
        path = np.vstack([grid.ends[:1], inner_points, grid.ends[1:]])
    return path, int(frontier.counts[0]), over


@settings
class GridPlanner(PlannerBase):
    """A planner on grids whose points are joined to their neighbours."""

    fixed = Order()  # the options that are no settings

    resolution: float = setting(
        default=0.1, unit="m", low=0.005, high=10.0, source="a tenth of the width of a door"
    )
    """Spacing of the grid points at first."""
    refinements: int = setting(default=2, low=0, high=6)
    """Number of times that the resolution is halved where no path is found."""
    shortcut: bool = setting(default=True, source="no higher cost")
    """Whether the path is straightened, at no higher cost."""
    connectivity: Literal[4, 8] = setting(default=8, source="fewer turns than with 4")
    """Neighbours of a grid point."""

    @property
    def order(self) -> Order:
        """The order of the search."""
        return with_settings(self.fixed, self)._replace(diagonal=self.connectivity == 8)

    def solve(self, problem: Problem, rng: np.random.Generator, end: float) -> Plan:
        """Return the path over finer and finer grids; the generator is not used."""
        arrays, order = problem.free.arrays, self.order
        ends = np.array([problem.start[:2], problem.goal[:2]], dtype=np.float64)
        xmin, ymin, xmax, ymax = problem.free.bounds
        path, total, halvings, note = np.empty((0, 2)), 0, 0, "no way over the finest grid"
        for halvings in range(self.refinements + 1):
            step = self.resolution / 2**halvings
            columns, rows = int((xmax - xmin) / step) + 1, int((ymax - ymin) / step) + 1
            if rows * columns > MAX_NODES:
                note = f"a grid of {step:g} m has more than {MAX_NODES:,} points here"
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
        if len(path) and self.shortcut:
            path = shortcut(path, problem.free, order.obstacle_weight, order.desired_clearance)
        return answer(path, {"nodes": total, "halvings": halvings}, note)


@settings
class AStar(GridPlanner):
    """The cheapest path over the grid (Hart, Nilsson and Raphael 1968), straightened.

    With a weight it keeps a comfortable distance where there is space.
    """

    obstacle_weight: float = setting(default=0.0, low=0.0, high=1000.0, source="length alone")
    """Extra cost of a metre at an obstacle, in metres in the open; 0 for length alone."""
    desired_clearance: float = setting(
        default=0.5, unit="m", low=0.01, high=100.0, source="half the width of a door"
    )
    """Clearance from which on a metre costs no more."""


@settings
class Dijkstra(AStar):
    """A* without a heuristic: the same cost, more nodes (Dijkstra 1959)."""

    fixed = Order(ahead=0.0)


@settings
class Bfs(GridPlanner):
    """Breadth first: the grid path of fewest edges (Moore 1959), straightened."""

    fixed = Order(EDGES, ahead=0.0)


@settings
class Dfs(GridPlanner):
    """Depth first: some grid path of any length (Tarjan 1972), straightened."""

    fixed = Order(DEPTH, ahead=0.0)
