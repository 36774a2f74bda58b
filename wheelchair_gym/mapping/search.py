"""The best pose of a window, found by bounds (Olson 2009, Real-time correlative scan matching).

Of costs and units as in `descent`.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.kernel import borrowing_kernel, kernel
from wheelchair_gym.mapping.descent import Six, quadratic

Array = NDArray[np.float64]
Floats = NDArray[np.float32]

_BLOCK = 3  # cells: side of the blocks of the coarse search


@borrowing_kernel
def _raise(line: Floats, over: Floats) -> None:
    """Raise a row to another; a select, for numba's `max` heeds NaN and is not vectorised."""
    for k in range(min(len(line), len(over))):
        over[k] = line[k] if line[k] > over[k] else over[k]


@borrowing_kernel
def _pool(field: Floats, wide: Floats, box: tuple[int, int, int, int]) -> None:
    """The largest value of each block of cells that begins at a cell, within a box."""
    for r in range(box[0], box[1]):
        line, over = field[r, box[2] : box[3]], wide[r, box[2] : box[3]]
        for k in range(len(over)):
            over[k] = line[k]
        for k in range(1, _BLOCK):
            _raise(field[r, box[2] + k : box[3] + k], over)
    for r in range(box[0], box[1]):
        for k in range(1, _BLOCK):
            if r + k < box[1]:
                _raise(wide[r + k, box[2] : box[3]], wide[r, box[2] : box[3]])


@kernel
def search(
    field: Floats, points: Array, guess: Array, told: Six, spread: float,
    window: int, turns: int, step: float, wide: Floats, out: Array,
) -> float:  # fmt: skip
    """The pose of least cost among whole cells and turns within a window about a guess.

    Args:
        field: (rows, cols).
        points: (n, 2) [cells] in the chair's frame.
        guess: (3,) x, y [cells], yaw [rad]; the mean of the prior.
        told: information of the prior.
        spread: of one point.
        window: cells to each side.
        turns: steps of yaw to each side.
        step: of yaw [rad].
        wide: scratch (rows, cols).
        out: (3,) the pose found.

    Returns:
        Its cost, with the field as it stands in whole cells.
    """
    rows, cols = field.shape
    n = len(points)
    blocks = (2 * window + _BLOCK) // _BLOCK
    span = blocks * _BLOCK  # cells from -window on; those beyond it are searched as well
    yaws = 2 * turns + 1
    place = np.empty((yaws, n, 2), np.int32)
    bound = np.empty(yaws * blocks * blocks)
    bottom, top, left, right = rows, 0, cols, 0
    per = 0.5 / (spread * spread)
    for a in range(yaws):
        yaw = guess[2] + (a - turns) * step
        c, s = math.cos(yaw), math.sin(yaw)
        for k in range(n):
            place[a, k, 0] = math.floor(guess[1] + s * points[k, 0] + c * points[k, 1]) - window
            place[a, k, 1] = math.floor(guess[0] + c * points[k, 0] - s * points[k, 1]) - window
            bottom, top = min(bottom, place[a, k, 0]), max(top, place[a, k, 0])
            left, right = min(left, place[a, k, 1]), max(right, place[a, k, 1])
    box = (min(max(bottom, 0), rows), max(min(top + span, rows), 0),
           min(max(left, 0), cols), max(min(right + span, cols), 0))  # fmt: skip
    _pool(field, wide, box)
    for a in range(yaws):
        for b in range(blocks * blocks):
            up, aside = (b // blocks) * _BLOCK, (b % blocks) * _BLOCK
            gain = 0.0
            for k in range(n):
                r, q = place[a, k, 0] + up, place[a, k, 1] + aside
                if box[0] <= r < box[1] and box[2] <= q < box[3]:
                    value = wide[r, q]
                    gain += value * (2.0 - value)
                elif -_BLOCK < r < rows and -_BLOCK < q < cols:
                    gain += 1.0  # it may reach into the map from outside
            bound[a * blocks * blocks + b] = per * (n - gain)
    least = math.inf
    while True:
        first = int(np.argmin(bound))
        if bound[first] >= least:
            break
        bound[first] = math.inf
        a, b = first // (blocks * blocks), first % (blocks * blocks)
        for up in range((b // blocks) * _BLOCK, (b // blocks) * _BLOCK + _BLOCK):
            for aside in range((b % blocks) * _BLOCK, (b % blocks) * _BLOCK + _BLOCK):
                dx, dy, dt = aside - window, up - window, (a - turns) * step
                cost = 0.5 * quadratic(told, dx, dy, dt) + per * n
                for k in range(n):
                    r, q = place[a, k, 0] + up, place[a, k, 1] + aside
                    if 0 <= r < rows and 0 <= q < cols:
                        value = field[r, q]
                        cost -= per * value * (2.0 - value)
                if cost < least:
                    least = cost
                    out[0], out[1], out[2] = guess[0] + dx, guess[1] + dy, guess[2] + dt
    return least
