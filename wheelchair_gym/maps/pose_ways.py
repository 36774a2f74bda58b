"""Quickest ways to a goal for the chair's own outline: time to go from every pose of a lattice.

Where `geodesic` knows a disc and its way, this knows a rectangle, its heading and its pace: it
tells where to swing out before a door. As in hybrid A* (Dolgov et al. 2010), a state is a cell of
position and a heading, and keeps the one pose in it that is led from exactly. `pose_search` finds
the ways.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wheelchair_gym.geometry import to_world, wrap
from wheelchair_gym.kernel import borrowing_kernel
from wheelchair_gym.sensing.noise import STARTS, bits

Array = NDArray[np.float64]
Whole = NDArray[np.int32]
Words = NDArray[np.uint32]

# A state in one word: time to go, the move it begins with, and where its pose lies in the cell.
UNITS = 64  # of a cell's side
TICKS = 64.0  # a second
FAR = (1 << 14) - 1  # ticks: no way is known; one of 255 s and more counts as none
MOVE, X_BITS, TIME = 12, 6, 18  # bits above which these stand
REST = 15  # the move of a state at the goal

DRAWS = 4096  # poses tried


@dataclass(frozen=True, eq=False)
class PoseWays:
    """Quickest ways to one goal from every pose.

    `words` (rows, cols, headings) hold a state each; `moves` (moves, headings, 3) where a move
    leads from a heading: along x and y [units], and headings on.
    """

    words: Words
    moves: Whole
    cell: float  # m
    origin: tuple[float, float, float]  # m, m, rad: of the lower-left corner

    def time(self, poses: ArrayLike) -> Array:
        """Time to go [s] from poses (..., 3); NaN where no way is known."""
        every = np.asarray(poses, np.float64)
        found = [time_to_go(self.words, self.cell, *self._local(p)) for p in every.reshape(-1, 3)]
        return np.array(found).reshape(every.shape[:-1])

    def draw(self, key: int, least: float, most: float) -> Array | None:
        """A pose (3,) [m, m, rad] so many seconds from the goal, drawn; None if none was found."""
        x, y, yaw = _drawn(self.words, self.cell, np.uint64(key), least, most)
        if math.isnan(x):
            return None
        return np.array([*to_world(np.array([x, y]), self.origin), yaw + self.origin[2]])

    def path(self, pose: ArrayLike) -> Array:
        """The poses (n, 3) [m, m, rad] on the way from a pose to the goal, empty if none leads."""
        local = np.empty((int(FAR), 3))
        n = _traced(self.words, self.moves, self.cell, *self._local(pose), local)
        return np.column_stack(
            [to_world(local[:n, :2], self.origin), local[:n, 2] + self.origin[2]]
        )

    def _local(self, pose: ArrayLike) -> tuple[float, float, float]:
        x, y, yaw = np.asarray(pose, np.float64).tolist()
        return to_local(self.origin, x, y, yaw)


@borrowing_kernel
def to_local(origin: Any, x: float, y: float, yaw: float) -> tuple[float, float, float]:
    """A pose in the frame of a grid's lower-left corner (3,)."""
    c, s = math.cos(origin[2]), math.sin(origin[2])
    dx, dy = x - origin[0], y - origin[1]
    return c * dx + s * dy, c * dy - s * dx, yaw - origin[2]


@borrowing_kernel
def _time_of(word: int) -> int:
    return int(word >> np.uint32(TIME))


@borrowing_kernel
def nearest_state(
    words: Words, cell: float, x: float, y: float, yaw: float
) -> tuple[int, int, int, float]:
    """The state by which a pose is soonest at the goal: row, column, heading, and seconds to go.

    Only states near the pose are looked at; to change over costs the time of driving across at a
    walking pace, so that the seconds change smoothly with the pose. NaN where none is known.
    """
    rows, cols, headings = words.shape
    step = 2.0 * math.pi / headings
    row, col = math.floor(y / cell), math.floor(x / cell)
    middle = math.floor(yaw / step + 0.5)
    best, place = math.inf, (0, 0, 0)
    for reach in (1, 3):
        for r in range(max(0, row - reach), min(rows, row + reach + 1)):
            for c in range(max(0, col - reach), min(cols, col + reach + 1)):
                for k in range(middle - reach, middle + reach + 1):
                    word = words[r, c, k % headings]
                    ticks = _time_of(word)
                    if ticks == FAR:
                        continue
                    px = (c + ((word >> np.uint32(X_BITS)) & np.uint32(UNITS - 1)) / UNITS) * cell
                    py = (r + (word & np.uint32(UNITS - 1)) / UNITS) * cell
                    across = 2.0 * math.hypot(px - x, py - y) + abs(wrap(k * step - yaw))
                    if ticks / TICKS + across < best:
                        best, place = ticks / TICKS + across, (r, c, k % headings)
        if best < math.inf:
            return place[0], place[1], place[2], best
    return 0, 0, 0, math.nan


@borrowing_kernel
def time_to_go(words: Words, cell: float, x: float, y: float, yaw: float) -> float:
    """Seconds to the goal from a pose in the lattice's frame; NaN where no way is known."""
    return nearest_state(words, cell, x, y, yaw)[3]


@borrowing_kernel
def _next(words: Words, moves: Whole, r: int, c: int, k: int) -> tuple[int, int, int]:
    """The state that a state's move leads to exactly."""
    word = words[r, c, k]
    m = (word >> np.uint32(MOVE)) & np.uint32(15)
    x = c * UNITS + ((word >> np.uint32(X_BITS)) & np.uint32(UNITS - 1)) + moves[m, k, 0]
    y = r * UNITS + (word & np.uint32(UNITS - 1)) + moves[m, k, 1]
    return int(y) >> X_BITS, int(x) >> X_BITS, (k + moves[m, k, 2]) % words.shape[2]


@borrowing_kernel
def _at_rest(words: Words, r: int, c: int, k: int) -> bool:
    return bool(((words[r, c, k] >> np.uint32(MOVE)) & np.uint32(15)) == np.uint32(REST))


@borrowing_kernel
def _pose_of(words: Words, cell: float, r: int, c: int, k: int) -> tuple[float, float, float]:
    word = words[r, c, k]
    x = (c + ((word >> np.uint32(X_BITS)) & np.uint32(UNITS - 1)) / UNITS) * cell
    y = (r + (word & np.uint32(UNITS - 1)) / UNITS) * cell
    return x, y, k * 2.0 * math.pi / words.shape[2]


@borrowing_kernel
def poses_ahead(
    words: Words,
    moves: Whole,
    cell: float,
    x: float,
    y: float,
    yaw: float,
    times: Array,
    out: Any,
) -> float:
    """Poses on the way from a pose at rising plan times, in the lattice's frame.

    Args:
        words: of the lattice.
        moves: of the lattice.
        cell: its side [m].
        x: of the pose [m].
        y: of the pose [m].
        yaw: of the pose [rad].
        times: (k,) [s]; beyond the goal the goal itself.
        out: (4 k,) x, y [m], yaw [rad] and room, of each; untouched where no way is known.

    Returns:
        Seconds to go, NaN where no way is known.
    """
    r, c, k, left = nearest_state(words, cell, x, y, yaw)
    if math.isnan(left):
        return math.nan
    begin = _time_of(words[r, c, k]) / TICKS
    ax, ay, ayaw = _pose_of(words, cell, r, c, k)
    now, j = 0.0, 0
    while j < times.shape[0]:
        if _at_rest(words, r, c, k):
            out[4 * j], out[4 * j + 1], out[4 * j + 2] = ax, ay, ayaw
            j += 1
            continue
        nr, nc, nk = _next(words, moves, r, c, k)
        bx, by, byaw = _pose_of(words, cell, nr, nc, nk)
        then = begin - _time_of(words[nr, nc, nk]) / TICKS
        while j < times.shape[0] and times[j] <= then:
            share = min(1.0, max(0.0, (times[j] - now) / max(then - now, 1e-9)))
            out[4 * j], out[4 * j + 1] = ax + share * (bx - ax), ay + share * (by - ay)
            out[4 * j + 2] = ayaw + share * wrap(byaw - ayaw)
            j += 1
        r, c, k, ax, ay, ayaw, now = nr, nc, nk, bx, by, byaw, then
    return left


@borrowing_kernel
def _drawn(
    words: Words, cell: float, key: np.uint64, least: float, most: float
) -> tuple[float, float, float]:
    rows, cols, headings = words.shape
    count = np.uint64(rows * cols * headings)
    for k in range(DRAWS):
        state = int(bits(key, k, STARTS, 0) % count)
        r, c, h = state // headings // cols, state // headings % cols, state % headings
        ticks = _time_of(words[r, c, h])
        if ticks < FAR and least * TICKS <= ticks <= most * TICKS:
            return _pose_of(words, cell, r, c, h)
    return math.nan, math.nan, math.nan


@borrowing_kernel
def _traced(
    words: Words, moves: Whole, cell: float, x: float, y: float, yaw: float, out: Array
) -> int:
    r, c, k, left = nearest_state(words, cell, x, y, yaw)
    if math.isnan(left):
        return 0
    n = 0
    while n < out.shape[0]:
        out[n, 0], out[n, 1], out[n, 2] = _pose_of(words, cell, r, c, k)
        n += 1
        if _at_rest(words, r, c, k):
            break
        r, c, k = _next(words, moves, r, c, k)
    return n
