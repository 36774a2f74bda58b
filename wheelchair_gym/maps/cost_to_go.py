"""Quickest paths to a goal for the chair's own outline: time to go from every pose of a lattice.

`geodesic` knows a disc and its path; this knows a rectangle, its heading and its speed, so it
shows where to swing out before a door. As in hybrid A* (Dolgov et al. 2010), a state is a cell of
position and a heading, and keeps one continuous pose.

Dijkstra's algorithm runs backwards from the goal. Moves are short arcs ahead and back and pivots,
dearer near walls, as the planner `lattice` has them. The result guides: what a planner returns is
tested exactly, these paths are good to a few millimetres of the map's raster.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wheelchair_gym.compiled.kernel import borrowing_kernel, kernel
from wheelchair_gym.config import setting, settings
from wheelchair_gym.geometry import Footprint, to_world, wrap
from wheelchair_gym.kinematics import Limits
from wheelchair_gym.maps.distance import distance_to_occupied, field_clearance, footprint_discs
from wheelchair_gym.maps.grid import OccupancyGrid
from wheelchair_gym.random import STARTS, bits

Array = NDArray[np.float64]
Field = NDArray[np.float32]

_BUCKETS = 1024  # more than the dearest move takes, in ticks
_UNSEEN, _SETTLED = -1, -2  # of states that wait in no bucket


@settings
class CostToGoSettings:
    """How the cost-to-go of the outline is computed."""

    cell: float = setting(default=0.1, unit="m", low=0.02, high=0.5, source="half a move")
    """Side of a lattice cell."""
    headings: int = setting(default=32, low=8, high=128, source="11 deg, the least turn of a move")
    """Number of headings of the lattice."""
    step_length: float = setting(default=0.2, unit="m", low=0.02, source="a fifth of the chair")
    """Length of a move."""
    desired_clearance: float = setting(
        default=0.25, unit="m", low=0.01, source="clearance beside the chair in a 1.1 m door"
    )
    """Clearance beyond which more brings no lower cost."""
    obstacle_weight: float = setting(
        default=3.0, low=0.0, high=6.0, source="as the planner lattice"
    )
    """Additional cost of a move without clearance, as a multiple of its time."""
    lateral_acceleration: float = setting(default=0.35, unit="m/s2", low=0.01, source="comfort")
    """Greatest lateral acceleration in curves."""
    pivot_speed_ratio: float = setting(default=0.6, low=0.05, high=1.0, source="design choice")
    """Turn rate of pivots as a share of the limit."""
    reverse_factor: float = setting(default=2.0, low=1.0, high=4.0, source="design choice")
    """Cost of reversing as a multiple of its time."""
    margin: float = setting(default=0.02, unit="m", low=0.0, source="design choice")
    """Clearance that the outline keeps."""
    shrink_step: float = setting(default=0.02, unit="m", low=0.0, source="design choice")
    """Amount by which the outline shrinks on each side when no path exists."""
    shrink_tries: int = setting(default=5, low=1, source="8 cm less on each side at most")
    """Number of outlines that are tried."""


@kernel
def _spread(
    field: Field,
    scale: float,
    shape: tuple[int, int],
    cell: float,
    discs: Array,
    moves: Whole,
    cost: Array,
    kind: Whole,
    seeds: Whole,
    switch: float,
    wish: float,
    dear: float,
    margin: float,
    start: Whole,
    ease: float,
    slack: int,
) -> Words:
    """A search from the goal backwards, with a bucket for each tick of time.

    Dijkstra's algorithm for the ways from everywhere; A* (Hart et al. 1968) for those from a start.
    """
    rows, cols = shape
    headings = moves.shape[1]
    count = rows * cols * headings
    far = np.uint32(FAR) << np.uint32(TIME)
    words = np.full(count, far, np.uint32)
    ahead, behind = np.full(count, -1, np.int32), np.full(count, -1, np.int32)
    heads, waits = np.full(_BUCKETS, -1, np.int32), np.full(count, _UNSEEN, np.int16)
    cosines = np.cos(np.arange(headings) * (2.0 * math.pi / headings))
    sines = np.sin(np.arange(headings) * (2.0 * math.pi / headings))
    size = cell / UNITS
    waiting = 0
    for s in range(seeds.shape[0]):
        x, y = seeds[s, 0], seeds[s, 1]
        for k in range(headings):
            state = ((y >> X_BITS) * cols + (x >> X_BITS)) * headings + k
            if words[state] != far:
                continue
            gap = field_clearance(
                field, scale, discs, x * size, y * size, cosines[k], sines[k], wish
            )
            if gap < margin:
                continue
            words[state] = np.uint32(
                (REST << MOVE) | ((x & (UNITS - 1)) << X_BITS) | (y & (UNITS - 1))
            )
            ahead[state], behind[state], waits[state] = heads[0], -1, 0
            if heads[0] >= 0:
                behind[heads[0]] = state
            heads[0] = state
            waiting += 1
    now, last, apart = 0, FAR - _BUCKETS, 0.0
    if seeds.shape[0] > 0:  # cells between the start and the goal
        apart = math.hypot((seeds[0, 1] >> X_BITS) - start[0], (seeds[0, 0] >> X_BITS) - start[1])
    while waiting > 0 and now < last:
        bucket = now % _BUCKETS
        while heads[bucket] >= 0:
            state = heads[bucket]
            heads[bucket] = ahead[state]
            if ahead[state] >= 0:
                behind[ahead[state]] = -1
            waits[state] = _SETTLED
            waiting -= 1
            k = state % headings
            row, col = state // headings // cols, state // headings % cols
            near = max(abs(row - start[0]), abs(col - start[1])) <= 1
            if ease > 0.0 and near and (k - start[2] + 1) % headings <= 2:
                last = min(last, now + slack)
            word = words[state]
            ticks = int(word >> np.uint32(TIME))
            before = (word >> np.uint32(MOVE)) & np.uint32(15)
            x = col * UNITS + int((word >> np.uint32(X_BITS)) & np.uint32(UNITS - 1))
            y = row * UNITS + int(word & np.uint32(UNITS - 1))
            for m in range(moves.shape[0]):
                k0 = (k - moves[m, 0, 2]) % headings
                x0, y0 = x - moves[m, k0, 0], y - moves[m, k0, 1]
                c0, r0 = x0 >> X_BITS, y0 >> X_BITS
                if not (0 <= c0 < cols and 0 <= r0 < rows):
                    continue
                other = (r0 * cols + c0) * headings + k0
                if waits[other] == _SETTLED:  # others are led from its pose: it stays
                    continue
                known = int(words[other] >> np.uint32(TIME))
                spent = cost[m]
                if before != REST and kind[before] != kind[m]:
                    spent += switch
                if ticks + round(spent * TICKS) >= known:
                    continue
                gap = field_clearance(
                    field, scale, discs, x0 * size, y0 * size, cosines[k0], sines[k0], wish
                )
                if gap < margin:
                    continue
                short = (wish - gap) / wish
                spent += cost[m] * dear * short * short
                then = ticks + max(1, round(spent * TICKS))
                if then >= known:
                    continue
                if waits[other] >= 0:
                    if behind[other] >= 0:
                        ahead[behind[other]] = ahead[other]
                    else:
                        heads[waits[other]] = ahead[other]
                    if ahead[other] >= 0:
                        behind[ahead[other]] = behind[other]
                    waiting -= 1
                words[other] = (np.uint32(then) << np.uint32(TIME)) | np.uint32(
                    (m << MOVE) | ((x0 & (UNITS - 1)) << X_BITS) | (y0 & (UNITS - 1))
                )
                due = then
                if ease > 0.0:
                    due += int(ease * (math.hypot(r0 - start[0], c0 - start[1]) - apart))
                    due = max(now, due)
                place = due % _BUCKETS
                ahead[other], behind[other], waits[other] = heads[place], -1, place
                if heads[place] >= 0:
                    behind[heads[place]] = other
                heads[place] = other
                waiting += 1
        now += 1
    return words


def _moves(own: CostToGoSettings, limits: Limits) -> tuple[Whole, Array, Whole]:
    """Where moves lead (moves, headings, 3), the seconds that they take, and their kinds."""
    step = 2.0 * math.pi / own.headings
    ahead: list[tuple[float, int]] = [(own.step_length, turn) for turn in (0, 1, -1, 2, -2)]
    back = [(-own.step_length, turn) for turn in (0, 1, -1)] if limits.backward > 0.0 else []
    every = [*ahead, (0.0, 1), (0.0, -1), *back]
    moves = np.zeros((len(every), own.headings, 3), np.int32)
    cost, kind = np.zeros(len(every)), np.zeros(len(every), np.int32)
    yaw = step * np.arange(own.headings)
    for m, (way, turn) in enumerate(every):
        half = 0.5 * turn * step
        chord = way * (math.sin(half) / half if half else 1.0) * UNITS / own.cell
        moves[m, :, 0] = np.rint(chord * np.cos(yaw + half))
        moves[m, :, 1] = np.rint(chord * np.sin(yaw + half))
        moves[m, :, 2] = turn
        if way == 0.0:
            cost[m], kind[m] = abs(turn) * step / (own.pivot_speed_ratio * limits.turn), 2
            continue
        bend = abs(turn) * step / abs(way)
        pace = limits.forward if way > 0.0 else limits.backward / own.reverse_factor
        if bend > 0.0:
            pace = min(pace, limits.turn / bend, math.sqrt(own.lateral_acceleration / bend))
        cost[m], kind[m] = abs(way) / pace, 1 if way > 0.0 else -1
    return moves, cost, kind


def cost_to_go(
    grid: OccupancyGrid,
    goal: ArrayLike,
    footprint: Footprint,
    limits: Limits,
    *,
    tolerance: float = 0.0,
    starts: Sequence[ArrayLike] = (),
    own: CostToGoSettings | None = None,
    slack: float | None = None,
) -> CostToGo:
    """The time to a goal and the quickest path, from every pose or from about one start.

    Args:
        grid: the map; what is not known to be solid may be driven on, what lies beyond may not.
        goal: (2,) or more [m]; any heading will do.
        footprint: of the chair.
        limits: of the chair.
        tolerance: how far [m] from the goal its axle may end.
        starts: poses (3,) from which a way shall lead: where none does, a smaller outline is tried.
        own: settings; None: the defaults.
        slack: s; only ways that may be so much dearer than those from the first start are sought,
            which is sooner done. None: all are.

    Raises:
        ValueError: there is slack, but no start.
    """
    if slack is not None and not starts:
        raise ValueError("slack needs a start")
    own = own or CostToGoSettings()
    moves, cost, kind = _moves(own, limits)
    reach = footprint.reach + own.desired_clearance + grid.resolution
    field = distance_to_occupied(grid.solid(), reach / grid.resolution)
    field = np.minimum(field, np.float32(1e3)) * np.float32(grid.resolution)
    rows, cols = (math.ceil(n * grid.resolution / own.cell) for n in grid.shape)
    centre = grid.to_lattice(np.asarray(goal, np.float64)[:2]) * grid.resolution / own.cell
    around = math.floor(tolerance / own.cell)
    shifts = np.indices((2 * around + 1, 2 * around + 1)).reshape(2, -1).T - around
    shifts = shifts[np.argsort(np.hypot(*shifts.T), kind="stable")]
    shifts = shifts[np.hypot(*shifts.T) * own.cell <= tolerance + 1e-9]
    seeds = np.floor((centre + shifts) * UNITS).astype(np.int32)
    inside = (seeds >= 0) & (seeds < np.array([cols, rows]) * UNITS)
    seeds = np.ascontiguousarray(seeds[inside.all(axis=1)])
    switch = 0.5 * limits.forward / limits.acceleration  # half the time to go to full speed
    begin, ease = np.zeros(3, np.int32), 0.0
    if slack is not None:
        ease = own.cell * TICKS / max(limits.forward, limits.backward)
        x, y, yaw = to_local(grid.origin, *np.asarray(starts[0], np.float64).tolist())
        turn = 2.0 * math.pi / own.headings
        begin[:] = y // own.cell, x // own.cell, round(yaw / turn) % own.headings
    for k in range(own.shrink_tries):
        words = _spread(
            field, 1.0 / grid.resolution, (rows, cols), own.cell,
            footprint_discs(footprint, k * own.shrink_step), moves, cost, kind, seeds, switch,
            own.desired_clearance, own.obstacle_weight, own.margin if k == 0 else 0.0,
            begin, ease, round((slack or 0.0) * TICKS),
        )  # fmt: skip
        ways = CostToGo(words.reshape(rows, cols, own.headings), moves, own.cell, grid.origin)
        if all(math.isfinite(float(ways.time_to_goal(start))) for start in starts):
            break
    return ways


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
class CostToGo:
    """Quickest ways to one goal from every pose.

    `words` (rows, cols, headings) hold a state each; `moves` (moves, headings, 3) where a move
    leads from a heading: along x and y [units], and headings on.
    """

    packed_states: Words
    moves: Whole
    cell: float  # m
    origin: tuple[float, float, float]  # m, m, rad: of the lower-left corner

    def time_to_goal(self, poses: ArrayLike) -> Array:
        """Time to go [s] from poses (..., 3); NaN where no way is known."""
        every = np.asarray(poses, np.float64)
        found = [
            time_to_go(self.packed_states, self.cell, *self._local(p)) for p in every.reshape(-1, 3)
        ]
        return np.array(found).reshape(every.shape[:-1])

    def sample(self, key: int, least: float, most: float) -> Array | None:
        """A random pose (3,) [m, m, rad] with a time to goal in [least, most] [s], or None."""
        x, y, yaw = _drawn(self.packed_states, self.cell, np.uint64(key), least, most)
        if math.isnan(x):
            return None
        return np.array([*to_world(np.array([x, y]), self.origin), yaw + self.origin[2]])

    def path(self, pose: ArrayLike) -> Array:
        """The poses (n, 3) [m, m, rad] on the way from a pose to the goal, empty if none leads."""
        local = np.empty((int(FAR), 3))
        n = _traced(self.packed_states, self.moves, self.cell, *self._local(pose), local)
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
    """The best lattice state near a pose: row, column, heading, and time to the goal [s].

    Reaching the state costs the time of driving to it, so that the result is smooth in the pose.
    NaN where no state near the pose is known.
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
