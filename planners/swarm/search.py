"""The one loop in which a swarm of paths searches, and where it begins.

Populations begin round a path, along it or anywhere; any optimizer moves them, any cost rates them.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from time import perf_counter
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from planners.collision.polygon_tests import SpaceArrays, edge_free, point_free
from planners.problem import begin
from planners.random_stream import Stream, in_disc
from planners.smoothing.curves import trace
from planners.swarm.moves import WHALES, Moves, advance, flying
from planners.swarm.path_cost import NO_PUSH, Room, Task, Worth, new_room, place, push_out, value
from planners.swarm.pso import fly
from planners.swarm.state import Swarm, keep_within, remember, rival
from wheelchair_gym.compiled.kernel import borrowing_kernel, kernel

Array = NDArray[np.float64]


class Start(NamedTuple):
    """A task and a population: the same for every optimiser of a fair race."""

    task: Task
    population: Array  # (k, d)
    lower: Array  # (d,) bounds of the positions
    upper: Array  # (d,)


@kernel
def in_discs(k: int, n: int, width: float, height: float, state: Stream) -> Array:
    """Shifts (k, 2 n) [m] of n way points: none of the first path's, the others' in ellipses."""
    population = np.zeros((k, 2 * n))
    for j in range(n):
        for i in range(1, k):
            u, v = in_disc(state)
            population[i, 2 * j] = u * width
            population[i, 2 * j + 1] = v * height
    return population


def bowed(
    k: int, n: int, width: float, height: float, modes: int, rng: np.random.Generator
) -> Array:
    """Shifts (k, 2 n) [m] of n way points that bend a path as a whole; none of the first one's.

    Sine waves over the path's points, the m-th of an amplitude within 1 / m of the bounds, so that
    neighbours move together and a population passes obstacles on both sides.
    """
    m = np.arange(1, modes + 1)
    waves = np.sin(np.pi * np.outer(m, np.arange(1, n + 1) / (n + 1))) / m[:, None]  # (modes, n)
    amplitudes = rng.uniform(-1.0, 1.0, (k, 2, modes))
    shifts = np.clip(amplitudes @ waves, -1.0, 1.0) * np.array([[width], [height]])  # (k, 2, n)
    shifts[0] = 0.0
    return np.ascontiguousarray(shifts.transpose(0, 2, 1).reshape(k, 2 * n))


def along(path: Array, count: int, among: int, rng: np.random.Generator) -> Array:
    """Way points (count, 2) drawn, in order, from `among` points evenly along a path: P1."""
    way = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(path, axis=0).T))])
    at = np.linspace(0.0, way[-1], among)
    drawn = np.sort(rng.choice(at, count, replace=count > among))
    return np.stack([np.interp(drawn, way, path[:, 0]), np.interp(drawn, way, path[:, 1])], axis=1)


def halved(path: Array, legs: NDArray[np.bool_]) -> Array:
    """A path (n, 2) with a point in the middle of some legs (n - 1,)."""
    middles = 0.5 * (path[:-1] + path[1:])
    return np.insert(path, np.flatnonzero(legs) + 1, middles[legs], axis=0)


def blocked_legs(arrays: SpaceArrays, line: Array, legs: int) -> NDArray[np.bool_]:
    """Which legs (legs,) of a curve's line (n, 2) are not free."""
    blocked = np.array([not edge_free(arrays, *a, *b) for a, b in pairwise(line)])
    return np.asarray(blocked.reshape(legs, -1).any(axis=1))


# Between two looks at the clock pass about this many seconds.
_LOOK: Final = 2e-3
# Redraws of way points that fell into discs, in one move of a swarm that pushes them out.
_REDRAWS: Final = 20


class Valid(NamedTuple):
    """The best exactly valid path so far."""

    line: Array  # (m, 2) m
    cost: Array  # (1,) without penalties; infinite before there is one
    found: NDArray[np.int64]  # (1,) after so many iterations


@borrowing_kernel
def appraise(
    task: Task, worth: Worth, moves: Moves, swarm: Swarm, valid: Valid, iteration: int, room: Room
) -> None:
    """Value every position, keep what is worth it, and the best valid path."""
    for i in range(swarm.positions.shape[0]):
        # Whales know the best alone: of what is worse nothing is kept.
        j = 0 if moves.kind == WHALES else rival(swarm, i)
        limit = swarm.now[0].least if moves.kind == WHALES else swarm.own_costs[j]
        cost, plain = value(task, worth, swarm.positions[i], limit, valid.cost[0], room)
        swarm.costs[i] = cost
        if plain < valid.cost[0]:
            valid.cost[0], valid.found[0] = plain, iteration
            for k in range(room.line.shape[0]):
                valid.line[k, 0], valid.line[k, 1] = room.line[k, 0], room.line[k, 1]
        if cost < limit:
            remember(swarm, i, j)
        else:
            swarm.trials[j] += 1


@borrowing_kernel
def search(
    task: Task,
    worth: Worth,
    moves: Moves,
    swarm: Swarm,
    valid: Valid,
    first: int,
    last: int,
    cycle: int,
    room: Room,
    state: Stream,
) -> None:
    """Run iterations `first` to `last`, that one excluded; the very first values the start, too.

    Args:
        task: the problem.
        worth: what paths are worth.
        moves: how the swarm moves.
        swarm: positions, and all that is remembered.
        valid: the best valid path, kept.
        first: iterations made before.
        last: iterations made after.
        cycle: iterations over which inertia and ranges fall; then they begin again.
        room: for one path; the best one's afterwards.
        state: stream of random numbers.
    """
    if first == 0:
        appraise(task, worth, moves, swarm, valid, 0, room)
    for t in range(first, last):
        progress = (t % cycle) / cycle
        if moves.by_occupancy:  # P1 (17)-(19)
            place(task, swarm.best, room.points)
            for i in range(task.anchors.shape[0]):
                x, y = room.points[i + 1, 0], room.points[i + 1, 1]
                w = moves.span if point_free(task.space, x, y) else 0.0
                swarm.span[2 * i], swarm.span[2 * i + 1] = w, w
        inertia = advance(swarm, moves, progress, state)
        if worth.push != NO_PUSH:
            flew = flying(moves, progress)
            for k in range(_REDRAWS):
                inside = 0
                for i in range(swarm.positions.shape[0]):
                    inside += push_out(task, worth, swarm.positions[i], swarm.held[i])
                if inside == 0 or not flew or k == _REDRAWS - 1:
                    break
                fly(swarm, moves.flight, inertia, state)
                keep_within(swarm)
            swarm.held[:] = False
        appraise(task, worth, moves, swarm, valid, t + 1, room)
    n = place(task, swarm.best, room.points)
    trace(task.curve, task.chordal, room.points, n, task.pieces, room.curve, room.line)


@dataclass(frozen=True)
class Search:
    """How a search ended."""

    line: Array  # (m, 2) m: the best exactly valid path; (0, 2) if there was none
    cost: float  # of it, without penalties
    found: int  # iterations after which it was found
    best: Array  # (m, 2) m: the path of least cost, valid or not
    least: float  # its cost
    way_points: Array  # (n + 2, 2) m of it
    iterations: int


def run(
    task: Task,
    worth: Worth,
    moves: Moves,
    swarm: Swarm,
    iterations: int,
    cycle: int,
    state: Stream,
    deadline: float | None = None,
) -> Search:
    """Let a swarm search for so many iterations, or until a deadline.

    Args:
        task: the problem.
        worth: what paths are worth.
        moves: how the swarm moves.
        swarm: where it begins; changed in place.
        iterations: most moves.
        cycle: iterations over which inertia and ranges fall; then they begin again.
        state: stream of random numbers.
        deadline: seconds of wall time from now; None for none.
    """
    _, end = begin(deadline)
    room = new_room(len(task.anchors), task.pieces)
    valid = Valid(np.empty_like(room.line), np.full(1, np.inf), np.zeros(1, np.int64))
    made, chunk = 0, iterations if deadline is None else min(1, iterations)
    while True:
        before = perf_counter()
        search(task, worth, moves, swarm, valid, made, made + chunk, cycle, room, state)
        made += chunk
        if made >= iterations:
            break
        now = perf_counter()
        left = end - now
        if left <= 0.0:
            break
        spent = (now - before) / max(chunk, 1)
        # The first call valued a population, too, and may have been compiled.
        chunk = max(1, min(2 * chunk, int(min(_LOOK, left) / max(spent, 1e-9))))
        chunk = min(chunk, iterations - made)
    solved = valid.cost[0] < np.inf
    line = valid.line if solved else np.empty((0, 2))
    return Search(
        line,
        float(valid.cost[0]),
        int(valid.found[0]),
        room.line,
        float(swarm.now["least"][0]),
        room.points,
        made,
    )
