"""A path of the footprint as pieces of arcs, part of which can be replaced by cheaper ones."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from planners.steering import CAPACITY, PIECE, switch
from wheelchair_gym.arrays import Array
from wheelchair_gym.compiled.kernel import borrowing_kernel
from wheelchair_gym.maps.driving_cost import MotionCost

MIN_GAIN = 1e-6  # s: smaller gains are rounding


class Path(NamedTuple):
    """The best path so far: its pieces, then one of no length at its end."""

    pieces: NDArray[Any]  # (CAPACITY,) PIECE
    size: NDArray[np.int64]  # (1,): without the one at the end; 0: there is no path
    cost: Array  # (1,) s
    goal: Array  # (3,) x, y [m], yaw [rad], NaN if it is free


def new_path(goal: Array) -> Path:
    """No path yet, to a goal (2,) or (3,)."""
    end = np.full(3, math.nan)
    end[: len(goal)] = goal
    return Path(np.zeros(CAPACITY, PIECE), np.zeros(1, np.int64), np.full(1, np.inf), end)


@borrowing_kernel
def kind_before(path: Path, i: int) -> int:
    """The kind of motion before piece i; 0 at the start."""
    return int(path.pieces[i - 1].kind) if i > 0 else 0


@borrowing_kernel
def kind_after(path: Path, j: int) -> int:
    """The kind of motion of piece j; 0 at the end."""
    return int(path.pieces[j].kind) if j < path.size[0] else 0


@borrowing_kernel
def window_cost(motion: MotionCost, path: Path, i: int, j: int) -> float:
    """Cost [s] of the pieces from i to j, with the changes of kind at both ends."""
    cost, before = 0.0, kind_before(path, i)
    for k in range(i, j):
        cost += path.pieces[k].cost + switch(motion, before, path.pieces[k].kind)
        before = int(path.pieces[k].kind)
    return cost + switch(motion, before, kind_after(path, j))


@borrowing_kernel
def splice(path: Path, motion: MotionCost, i: int, j: int, new: NDArray[Any], count: int) -> bool:
    """Replace the pieces from i to j by so many new ones; false if there is no space for them."""
    pieces, n = path.pieces, path.size[0]
    more = count - (j - i)
    if n + more + 1 >= pieces.shape[0]:
        return False
    if more > 0:
        for k in range(n, j - 1, -1):
            pieces[k + more] = pieces[k]
    elif more < 0:
        for k in range(j, n + 1):
            pieces[k + more] = pieces[k]
    for k in range(count):
        pieces[i + k] = new[k]
    path.size[0] = n + more
    end = pieces[n + more]
    if math.isnan(path.goal[2]) and n + more > 0:
        last = pieces[n + more - 1]
        end.yaw = last.yaw + last.turn
    path.cost[0] = window_cost(motion, path, 0, n + more)
    return True
