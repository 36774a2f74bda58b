"""Where a search begins: populations round a path, along it or anywhere."""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from planners.draws import Stream, in_disc
from planners.exact import SpaceArrays, edge_free
from planners.swarm.worth import Task
from wheelchair_gym.kernel import kernel

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
