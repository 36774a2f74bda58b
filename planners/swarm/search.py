"""The search of a swarm of paths, and its initial populations.

A population begins around a path, along it or anywhere. Any optimizer moves it, and any path cost
rates it.
"""

import math
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from planners.collision.polygon_tests import point_free
from planners.problem import begin, chunks
from planners.swarm.optimizers import (
    WHALES,
    MoveParameters,
    Swarm,
    clip_to_bounds,
    competitor,
    is_particle_move,
    move_particles,
    move_swarm,
    new_swarm,
    store,
)
from planners.swarm.path_cost import (
    PathCost,
    PathProblem,
    PathWorkspace,
    evaluate,
    new_workspace,
    push_out_of_discs,
    write_curve,
    write_way_points,
)
from wheelchair_gym.base.arrays import Array
from wheelchair_gym.compiled.kernel import borrowing_kernel
from wheelchair_gym.compiled.random import Stream
from wheelchair_gym.geometry.planar import arc_lengths


class InitialSwarm(NamedTuple):
    """A problem and a population, with which any optimizer can begin."""

    path_problem: PathProblem
    population: Array  # (k, d)
    lower: Array  # (d,) bounds of the positions
    upper: Array  # (d,)


def scatter_bowed(
    k: int, n: int, width: float, height: float, modes: int, rng: np.random.Generator
) -> Array:
    """Return shifts (k, 2 n) [m] of n way points by waves along the path, 0 for the first path.

    Sine waves over the path's points, the m-th of an amplitude within 1 / m of the bounds, so that
    neighbours move together and a population passes obstacles on both sides.
    """
    m = np.arange(1, modes + 1)
    waves = np.sin(np.pi * np.outer(m, np.arange(1, n + 1) / (n + 1))) / m[:, None]  # (modes, n)
    amplitudes = rng.uniform(-1.0, 1.0, (k, 2, modes))
    shifts = np.clip(amplitudes @ waves, -1.0, 1.0) * np.array([[width], [height]])  # (k, 2, n)
    shifts[0] = 0.0
    return np.ascontiguousarray(shifts.transpose(0, 2, 1).reshape(k, 2 * n))


def sample_along(path: Array, count: int, among: int, rng: np.random.Generator) -> Array:
    """Draw way points (count, 2), in order, from `among` points evenly along a path: P1."""
    way = arc_lengths(path)
    drawn = np.sort(rng.choice(np.linspace(0.0, way[-1], among), count, replace=count > among))
    return np.stack([np.interp(drawn, way, path[:, 0]), np.interp(drawn, way, path[:, 1])], axis=1)


def split_legs(path: Array, legs: NDArray[np.bool_]) -> Array:
    """Return a path (n, 2) with a point in the middle of some legs (n - 1,)."""
    middles = 0.5 * (path[:-1] + path[1:])
    return np.insert(path, np.flatnonzero(legs) + 1, middles[legs], axis=0)


# Redraws of way points that fell into discs, in one move of a swarm that pushes them out.
_MAX_PUSHES: Final = 20


class SwarmSearch(NamedTuple):
    """All state of a search: the problem, the optimizer, the swarm and the best path."""

    problem: PathProblem
    path_cost: PathCost
    moves: MoveParameters
    swarm: Swarm
    line: Array  # (m, 2) m: the best exactly valid path so far
    line_cost: Array  # (1,) its cost without penalties; infinite before there is one
    workspace: PathWorkspace


def new_search(start: InitialSwarm, path_cost: PathCost, moves: MoveParameters) -> SwarmSearch:
    """Return a search that has not begun; the start stays unchanged."""
    problem, workspace = start.path_problem, new_workspace(start.path_problem)
    swarm = new_swarm(start.population, start.lower, start.upper)
    line, line_cost = np.empty_like(workspace.line), np.full(1, np.inf)
    return SwarmSearch(problem, path_cost, moves, swarm, line, line_cost, workspace)


@borrowing_kernel
def evaluate_swarm(search: SwarmSearch) -> None:
    """Evaluate every position; store better positions and the best valid path."""
    moves, swarm, workspace = search.moves, search.swarm, search.workspace
    if moves.whales.latest:
        search.line_cost[0] = math.inf
    for i in range(swarm.positions.shape[0]):
        # Whales remember the best position only.
        j = 0 if moves.kind == WHALES else competitor(swarm, i)
        limit = swarm.best_cost[0] if moves.kind == WHALES else swarm.personal_best_costs[j]
        exact = math.inf if moves.listed else limit  # listed wolves are ranked by all costs
        cost, plain = evaluate(
            search.problem, search.path_cost, swarm.positions[i], exact, search.line_cost[0],
            workspace,
        )  # fmt: skip
        swarm.costs[i] = cost
        if plain < search.line_cost[0]:
            search.line_cost[0] = plain
            for k in range(workspace.line.shape[0]):
                search.line[k, 0], search.line[k, 1] = workspace.line[k, 0], workspace.line[k, 1]
        if cost < limit:
            store(swarm, i, j)
        else:
            swarm.trials[j] += 1


@borrowing_kernel
def iterate(search: SwarmSearch, first: int, last: int, cycle: int, state: Stream) -> None:
    """Run iterations from `first` up to, but not including, `last`; 0 evaluates the start, too.

    Inertia and ranges fall over `cycle` iterations; then they start again. The workspace holds the
    best path afterwards.
    """
    problem, moves, swarm, workspace = search.problem, search.moves, search.swarm, search.workspace
    if first == 0:
        evaluate_swarm(search)
    for t in range(first, last):
        progress = (t % cycle) / cycle
        if moves.by_occupancy:  # P1 (17)-(19)
            write_way_points(problem, swarm.best, workspace.points)
            for i in range(problem.anchors.shape[0]):
                x, y = workspace.points[i + 1, 0], workspace.points[i + 1, 1]
                w = 1.0 if point_free(problem.space, x, y) else 0.0
                swarm.c_range[2 * i], swarm.c_range[2 * i + 1] = w, w
        inertia = move_swarm(swarm, moves, progress, state)
        if search.path_cost.push:
            flew = is_particle_move(moves, progress)
            for k in range(_MAX_PUSHES):
                inside = 0
                for i in range(swarm.positions.shape[0]):
                    inside += push_out_of_discs(
                        problem, search.path_cost, swarm.positions[i], swarm.fixed[i]
                    )
                if inside == 0 or not flew or k == _MAX_PUSHES - 1:
                    break
                move_particles(swarm, moves, inertia, state)
                clip_to_bounds(swarm)
            swarm.fixed[:] = False
        evaluate_swarm(search)
    write_curve(problem, swarm.best, workspace)


@dataclass(frozen=True)
class SearchResult:
    """The end of a search."""

    line: Array  # (m, 2) m: the best exactly valid path; (0, 2) if there was none
    cost: float  # of it, without penalties
    best: Array  # (m, 2) m: the path of least cost, valid or not
    best_cost: float  # its cost
    way_points: Array  # (n + 2, 2) m of it
    iterations: int


def result_of(search: SwarmSearch, iterations: int) -> SearchResult:
    """Return the result of a search after a number of iterations."""
    cost, workspace = float(search.line_cost[0]), search.workspace
    line = search.line if cost < np.inf else np.empty((0, 2))
    best_cost = float(search.swarm.best_cost[0])
    return SearchResult(line, cost, workspace.line, best_cost, workspace.points, iterations)


def run(
    search: SwarmSearch, iterations: int, cycle: int, state: Stream, deadline: float | None = None
) -> SearchResult:
    """Run a new search for a number of iterations, or until a deadline [s] from now; see `iterate`.

    The search is changed in place.
    """
    made = 0
    for until in chunks(iterations, begin(deadline)[1]):
        iterate(search, made, until, cycle, state)
        made = until
    return result_of(search, made)
