"""Cost-to-go of the chair's outline: time to a goal from every pose of a lattice.

`geodesic` computes the shortest path of a disc; this one knows a rectangle, its heading and its
speed, so it shows where to swing out before a door. As in hybrid A* (Dolgov et al. 2010), a state
is a cell of position and a heading, and keeps one continuous pose.

Dijkstra's algorithm runs backwards from the goal. Moves are short arcs ahead and back and pivots,
whose cost is that of the planner `lattice`. The result guides: what a planner returns is tested
exactly, these paths are good to a few millimetres of the map's raster.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wheelchair_gym.base.arrays import Array
from wheelchair_gym.base.settings import setting, settings
from wheelchair_gym.compiled.kernel import borrowing_kernel, kernel
from wheelchair_gym.compiled.random import STARTS, bits
from wheelchair_gym.geometry.kinematics import Limits
from wheelchair_gym.geometry.outline import Footprint
from wheelchair_gym.geometry.planar import to_world, wrap, wrap_angle
from wheelchair_gym.maps.distance import distance_to_occupied, field_clearance, footprint_discs
from wheelchair_gym.maps.driving_cost import DrivingCost, MotionCost, duration, kind_of
from wheelchair_gym.maps.grid import OccupancyGrid

Field = NDArray[np.float32]
Ints = NDArray[np.int32]
States = NDArray[np.uint32]

# A state in one word: time to go, the move it begins with, and where its pose lies in the cell.
UNITS = 64  # of a cell's side
TICKS = 64.0  # a second
FAR = (1 << 14) - 1  # ticks: no path is known; one of 255 s and more counts as none
MOVE, X_BITS, TIME = 12, 6, 18  # bits above which these stand
REST = 15  # the move of a state at the goal

DRAWS = 4096  # poses tried
_BUCKETS = 1024  # of the queue; twice as many until a move takes fewer ticks
_NEW, _SETTLED = -1, -2  # of states that wait in no bucket
_STEP = 0.2  # m: length of a move, a fifth of the chair
HEADINGS = 32  # of the lattice
_TURN = 2.0 * math.pi / HEADINGS  # rad: the smallest turn of a move, 11 deg
# Without a path the outline shrinks by so much on each side [m], and so often that it is tried.
_SHRINK, _TRIES = 0.02, 5


@settings
class CostToGoSettings(DrivingCost):
    """Settings of the outline's cost-to-go."""

    cell: float = setting(default=0.1, unit="m", low=0.02, high=0.5, source="half a move")
    """Side of a lattice cell."""
    margin: float = setting(default=0.02, unit="m", low=0.0)
    """Clearance that the outline keeps."""


@borrowing_kernel
def _time_of(state: int) -> int:
    return int(state >> np.uint32(TIME))


@borrowing_kernel
def _move_of(state: int) -> int:
    return int((state >> np.uint32(MOVE)) & np.uint32(15))


@borrowing_kernel
def _units_of(state: int, row: int, col: int) -> tuple[int, int]:
    """Return the place (x, y) [units] of the pose of a state in a cell."""
    x = col * UNITS + int((state >> np.uint32(X_BITS)) & np.uint32(UNITS - 1))
    return x, row * UNITS + int(state & np.uint32(UNITS - 1))


@borrowing_kernel
def _packed(ticks: int, move: int, x: int, y: int) -> np.uint32:
    place = (move << MOVE) | ((x & (UNITS - 1)) << X_BITS) | (y & (UNITS - 1))
    return (np.uint32(ticks) << np.uint32(TIME)) | np.uint32(place)


class Buckets(NamedTuple):
    """A priority queue of states: a doubly linked list for each tick of time."""

    heads: Ints  # (buckets,)
    ahead: Ints  # (states,)
    behind: Ints  # (states,)
    place: NDArray[np.int16]  # (states,) the bucket in which a state waits, _NEW or _SETTLED


@borrowing_kernel
def _insert(queue: Buckets, state: int, bucket: int) -> None:
    head = queue.heads[bucket]
    queue.ahead[state], queue.behind[state], queue.place[state] = head, -1, bucket
    if head >= 0:
        queue.behind[head] = state
    queue.heads[bucket] = state


@borrowing_kernel
def _remove(queue: Buckets, state: int) -> None:
    ahead, behind = queue.ahead[state], queue.behind[state]
    if behind >= 0:
        queue.ahead[behind] = ahead
    else:
        queue.heads[queue.place[state]] = ahead
    if ahead >= 0:
        queue.behind[ahead] = behind


class LatticeMoves(NamedTuple):
    """The moves of the lattice."""

    steps: Ints  # (moves, headings, 3): where a move leads, x and y [units] and headings on
    time: Array  # (moves,) s
    kind: Ints  # (moves,) see `kind_of`


class Aim(NamedTuple):
    """Goal, at which a search begins, and the start that it looks for."""

    seeds: Ints  # (k, 2) x, y [units] of the goal and of places near it
    headings: Ints  # (h,) numbers of those with which the goal may be reached
    start: Ints  # (3,) row, column and heading of the pose that A* looks for
    ease: float  # ticks that a cell of distance takes at least; 0: Dijkstra's algorithm
    slack: int  # ticks for which A* goes on once it has come to the start


@kernel
def _search(
    field: Field, scale: float, shape: tuple[int, int], cell: float, discs: Array,
    moves: LatticeMoves, motion: MotionCost, margin: float, aim: Aim,
) -> States:  # fmt: skip
    """A search from the goal backwards, with a bucket for each tick of time.

    Dijkstra's algorithm for the paths from everywhere; A* (Hart et al. 1968) for those from a
    start.
    """
    rows, cols = shape
    steps, start, seeds, ease = moves.steps, aim.start, aim.seeds, aim.ease
    desired = motion.desired_clearance
    headings = steps.shape[1]
    count = rows * cols * headings
    max_time = moves.time.max() * (1.0 + motion.obstacle_weight) + motion.switch_time
    buckets = _BUCKETS
    while buckets < max_time * TICKS + 2.0:
        buckets *= 2
    far = np.uint32(FAR) << np.uint32(TIME)
    states = np.full(count, far, np.uint32)
    queue = Buckets(
        np.full(buckets, -1, np.int32), np.full(count, -1, np.int32),
        np.full(count, -1, np.int32), np.full(count, _NEW, np.int16),
    )  # fmt: skip
    cosines = np.cos(np.arange(headings) * (2.0 * math.pi / headings))
    sines = np.sin(np.arange(headings) * (2.0 * math.pi / headings))
    size = cell / UNITS
    waiting = 0
    for s in range(seeds.shape[0]):
        x, y = seeds[s, 0], seeds[s, 1]
        for k in aim.headings:
            state = ((y >> X_BITS) * cols + (x >> X_BITS)) * headings + k
            if states[state] != far:
                continue
            gap = field_clearance(
                field, scale, discs, x * size, y * size, cosines[k], sines[k], desired
            )
            if gap < margin:
                continue
            states[state] = _packed(0, REST, x, y)
            _insert(queue, state, 0)
            waiting += 1
    now, last, apart = 0, FAR - _BUCKETS, 0.0
    if seeds.shape[0] > 0:  # cells between the start and the goal
        apart = math.hypot((seeds[0, 1] >> X_BITS) - start[0], (seeds[0, 0] >> X_BITS) - start[1])
    while waiting > 0 and now < last:
        bucket = now & (buckets - 1)
        while queue.heads[bucket] >= 0:
            state = queue.heads[bucket]
            _remove(queue, state)
            queue.place[state] = _SETTLED
            waiting -= 1
            k = state % headings
            row, col = state // headings // cols, state // headings % cols
            near = max(abs(row - start[0]), abs(col - start[1])) <= 1
            if ease > 0.0 and near and (k - start[2] + 1) % headings <= 2:
                last = min(last, now + aim.slack)
            ticks, before = _time_of(states[state]), _move_of(states[state])
            x, y = _units_of(states[state], row, col)
            for m in range(steps.shape[0]):
                k0 = (k - steps[m, 0, 2]) % headings
                x0, y0 = x - steps[m, k0, 0], y - steps[m, k0, 1]
                c0, r0 = x0 >> X_BITS, y0 >> X_BITS
                if not (0 <= c0 < cols and 0 <= r0 < rows):
                    continue
                other = (r0 * cols + c0) * headings + k0
                if queue.place[other] == _SETTLED:  # others are led from its pose: it stays
                    continue
                minimum = _time_of(states[other])
                spent = moves.time[m]
                if before != REST and moves.kind[before] != moves.kind[m]:
                    spent += motion.switch_time
                if ticks + round(spent * TICKS) >= minimum:
                    continue
                gap = field_clearance(
                    field, scale, discs, x0 * size, y0 * size, cosines[k0], sines[k0], desired
                )
                if gap < margin:
                    continue
                short = (desired - gap) / desired
                spent += moves.time[m] * motion.obstacle_weight * short * short
                then = ticks + max(1, round(spent * TICKS))
                if then >= minimum:
                    continue
                if queue.place[other] >= 0:
                    _remove(queue, other)
                    waiting -= 1
                states[other] = _packed(then, m, x0, y0)
                due = then
                if ease > 0.0:
                    due += int(ease * (math.hypot(r0 - start[0], c0 - start[1]) - apart))
                    due = max(now, due)
                _insert(queue, other, due & (buckets - 1))
                waiting += 1
        now += 1
    return states


def _moves(config: CostToGoSettings, motion: MotionCost) -> LatticeMoves:
    ahead: list[tuple[float, int]] = [(_STEP, turn) for turn in (0, 1, -1, 2, -2)]
    back = [(-_STEP, turn) for turn in (0, 1, -1)] if motion.backward > 0.0 else []
    every = [*ahead, (0.0, 1), (0.0, -1), *back]
    steps = np.zeros((len(every), HEADINGS, 3), np.int32)
    yaw = _TURN * np.arange(HEADINGS)
    for m, (way, turn) in enumerate(every):
        half = 0.5 * turn * _TURN
        chord = way * (math.sin(half) / half if half else 1.0) * UNITS / config.cell
        steps[m, :, 0] = np.rint(chord * np.cos(yaw + half))
        steps[m, :, 1] = np.rint(chord * np.sin(yaw + half))
        steps[m, :, 2] = turn
    time = np.array([duration(motion, way, turn * _TURN) for way, turn in every])
    kind = np.array([kind_of(way, turn * _TURN) for way, turn in every], np.int32)
    return LatticeMoves(steps, time, kind)


def cost_to_go(
    grid: OccupancyGrid,
    goal: ArrayLike,
    footprint: Footprint,
    limits: Limits,
    *,
    tolerance: float = 0.0,
    heading: float | None = None,
    starts: Sequence[ArrayLike] = (),
    config: CostToGoSettings | None = None,
    slack: float | None = None,
) -> CostToGo:
    """The time to a goal and the quickest path, from every pose or from about one start.

    Args:
        grid: the map; what is not known to be solid may be driven on, what lies beyond may not.
        goal: (2,) or (3,) [m, m, rad].
        footprint: of the chair.
        limits: of the chair.
        tolerance: how far [m] from the goal its axle may end.
        heading: how far [rad] from the goal's heading it may end; the lattice's nearest heading
            will always do. None: any heading will do.
        starts: poses (3,) from which a path shall lead: where none does, a smaller outline is
            tried.
        config: settings; None: the defaults.
        slack: s; only paths that cost at most so much more than those from the first start are
            searched, which is faster. None: all are.

    Raises:
        ValueError: there is slack, but no start.
    """
    if slack is not None and not starts:
        raise ValueError("slack needs a start")
    config = config or CostToGoSettings()
    motion = config.motion_cost(footprint, limits, config.margin)
    moves, cell = _moves(config, motion), config.cell
    reach = footprint.reach + config.desired_clearance + grid.resolution
    field = distance_to_occupied(grid.solid(), reach / grid.resolution)
    field = np.minimum(field, np.float32(1e3)) * np.float32(grid.resolution)
    rows, cols = (math.ceil(n * grid.resolution / cell) for n in grid.shape)
    centre = grid.to_lattice(np.asarray(goal, np.float64)[:2]) * grid.resolution / cell
    around = math.floor(tolerance / cell)
    shifts = np.indices((2 * around + 1, 2 * around + 1)).reshape(2, -1).T - around
    shifts = shifts[np.argsort(np.hypot(*shifts.T), kind="stable")]
    shifts = shifts[np.hypot(*shifts.T) * cell <= tolerance + 1e-9]
    seeds = np.floor((centre + shifts) * UNITS).astype(np.int32)
    inside = (seeds >= 0) & (seeds < np.array([cols, rows]) * UNITS)
    seeds = np.ascontiguousarray(seeds[inside.all(axis=1)])
    begin, ease = np.zeros(3, np.int32), 0.0
    if slack is not None:
        ease = cell * TICKS / max(limits.forward, limits.backward)
        x, y, yaw = to_local(grid.origin, *np.asarray(starts[0], np.float64).tolist())
        begin[:] = y // cell, x // cell, round(yaw / _TURN) % HEADINGS
    ends = np.arange(HEADINGS, dtype=np.int32)
    if heading is not None:
        off = np.abs(wrap_angle(ends * _TURN + grid.origin[2] - np.asarray(goal, np.float64)[2]))
        ends = ends[off <= max(0.5 * heading, float(off.min()) + 1e-9)]
    aim = Aim(seeds, ends, begin, ease, round((slack or 0.0) * TICKS))
    for k in range(_TRIES):
        states = _search(
            field, 1.0 / grid.resolution, (rows, cols), cell,
            footprint_discs(footprint, k * _SHRINK), moves, motion,
            config.margin if k == 0 else 0.0, aim,
        )  # fmt: skip
        found = CostToGo(states.reshape(rows, cols, HEADINGS), moves.steps, cell, grid.origin)
        if all(math.isfinite(float(found.time_to_goal(start))) for start in starts):
            break
    return found


@dataclass(frozen=True, eq=False)
class CostToGo:
    """Quickest paths to one goal from every pose.

    `packed_states` (rows, cols, headings) hold a state each; `moves` (moves, headings, 3) where a
    move leads from a heading: along x and y [units], and headings on.
    """

    packed_states: States
    moves: Ints
    cell: float  # m
    origin: tuple[float, float, float]  # m, m, rad: of the lower-left corner

    def time_to_goal(self, poses: ArrayLike) -> Array:
        """Time to go [s] from poses (..., 3); NaN where no path is known."""
        every, states = np.asarray(poses, np.float64), self.packed_states
        rows = map(self._local, every.reshape(-1, 3))
        found = [nearest_state(states, self.cell, *row)[3] for row in rows]
        return np.array(found).reshape(every.shape[:-1])

    def sample(self, key: int, minimum: float, maximum: float) -> Array | None:
        """A random pose (3,) [m, m, rad] with a time to goal in [least, most] [s], or None."""
        x, y, yaw = _sample(self.packed_states, self.cell, np.uint64(key), minimum, maximum)
        if math.isnan(x):
            return None
        return np.array([*to_world(np.array([x, y]), self.origin), yaw + self.origin[2]])

    def path(self, pose: ArrayLike) -> Array:
        """The poses (n, 3) [m, m, rad] from a pose to the goal, empty if no path is known."""
        local = np.empty((int(FAR), 3))
        n = _trace(self.packed_states, self.moves, self.cell, *self._local(pose), local)
        return np.column_stack(
            [to_world(local[:n, :2], self.origin), local[:n, 2] + self.origin[2]]
        )

    def _local(self, pose: ArrayLike) -> tuple[float, float, float]:
        x, y, yaw = np.asarray(pose, np.float64).tolist()
        return to_local(self.origin, x, y, yaw)


@borrowing_kernel
def to_local(origin: Any, x: float, y: float, yaw: float) -> tuple[float, float, float]:
    """A pose in the frame of a grid's lower-left corner (3,)."""
    dx, dy = x - origin[0], y - origin[1]
    if origin[2] == 0.0:  # as of most maps
        return dx, dy, yaw
    c, s = math.cos(origin[2]), math.sin(origin[2])
    return c * dx + s * dy, c * dy - s * dx, yaw - origin[2]


@borrowing_kernel
def _pose_of(states: States, cell: float, r: int, c: int, k: int) -> tuple[float, float, float]:
    x, y = _units_of(states[r, c, k], r, c)
    return x / UNITS * cell, y / UNITS * cell, k * 2.0 * math.pi / states.shape[2]


@borrowing_kernel
def nearest_state(
    states: States, cell: float, x: float, y: float, yaw: float
) -> tuple[int, int, int, float]:
    """The best state near a pose in the lattice's frame: row, column, heading, time to go [s].

    Reaching the state costs the time of driving to it, so that the result is smooth in the pose.
    NaN where no state near the pose is known.
    """
    rows, cols, headings = states.shape
    step = 2.0 * math.pi / headings
    row, col = math.floor(y / cell), math.floor(x / cell)
    middle = math.floor(yaw / step + 0.5)
    unit = cell / UNITS
    best, at_r, at_c, at_k = math.inf, 0, 0, 0
    for reach in (1, 3):
        low_r, high_r = max(0, row - reach), min(rows, row + reach + 1)
        low_c, high_c = max(0, col - reach), min(cols, col + reach + 1)
        for j in range(middle - reach, middle + reach + 1):
            k, turn = j % headings, abs(wrap(j * step - yaw))
            for r in range(low_r, high_r):
                for c in range(low_c, high_c):
                    state = states[np.uint64(r), np.uint64(c), np.uint64(k)]
                    ticks = _time_of(state)
                    spare = 0.5 * (best - ticks / TICKS - turn)
                    px, py = _units_of(state, r, c)
                    dx, dy = px * unit - x, py * unit - y
                    if spare > 0.0 and dx * dx + dy * dy < spare * spare and ticks < FAR:
                        best = ticks / TICKS + 2.0 * math.sqrt(dx * dx + dy * dy) + turn
                        at_r, at_c, at_k = r, c, k
        if best < math.inf:
            return at_r, at_c, at_k, best
    return 0, 0, 0, math.nan


@borrowing_kernel
def _next(states: States, moves: Ints, r: int, c: int, k: int) -> tuple[int, int, int]:
    """The state that a state's move leads to exactly."""
    m = _move_of(states[r, c, k])
    x, y = _units_of(states[r, c, k], r, c)
    row, col = (y + moves[m, k, 1]) >> X_BITS, (x + moves[m, k, 0]) >> X_BITS
    return int(row), int(col), (k + moves[m, k, 2]) % states.shape[2]


@borrowing_kernel
def poses_ahead(
    states: States, moves: Ints, cell: float, x: float, y: float, yaw: float, times: Array, out: Any
) -> float:
    """Seconds to go from a pose in the lattice's frame, NaN where no path is known.

    Writes the poses that the path has at rising times.
    """
    r, c, k, left = nearest_state(states, cell, x, y, yaw)
    if math.isnan(left):
        return math.nan
    begin = _time_of(states[r, c, k]) / TICKS
    ax, ay, ayaw = _pose_of(states, cell, r, c, k)
    now, j = 0.0, 0
    while j < times.shape[0]:
        if _move_of(states[r, c, k]) == REST:
            out[4 * j], out[4 * j + 1], out[4 * j + 2] = ax, ay, ayaw
            j += 1
            continue
        nr, nc, nk = _next(states, moves, r, c, k)
        bx, by, byaw = _pose_of(states, cell, nr, nc, nk)
        then = begin - _time_of(states[nr, nc, nk]) / TICKS
        while j < times.shape[0] and times[j] <= then:
            share = min(1.0, max(0.0, (times[j] - now) / max(then - now, 1e-9)))
            out[4 * j], out[4 * j + 1] = ax + share * (bx - ax), ay + share * (by - ay)
            out[4 * j + 2] = ayaw + share * wrap(byaw - ayaw)
            j += 1
        r, c, k, ax, ay, ayaw, now = nr, nc, nk, bx, by, byaw, then
    return left


@borrowing_kernel
def _sample(
    states: States, cell: float, key: np.uint64, minimum: float, maximum: float
) -> tuple[float, float, float]:
    rows, cols, headings = states.shape
    count = np.uint64(rows * cols * headings)
    for k in range(DRAWS):
        state = int(bits(key, k, STARTS, 0) % count)
        r, c, h = state // headings // cols, state // headings % cols, state % headings
        ticks = _time_of(states[r, c, h])
        if ticks < FAR and minimum * TICKS <= ticks <= maximum * TICKS:
            return _pose_of(states, cell, r, c, h)
    return math.nan, math.nan, math.nan


@borrowing_kernel
def _trace(
    states: States, moves: Ints, cell: float, x: float, y: float, yaw: float, out: Array
) -> int:
    r, c, k, left = nearest_state(states, cell, x, y, yaw)
    if math.isnan(left):
        return 0
    n = 0
    while n < out.shape[0]:
        out[n, 0], out[n, 1], out[n, 2] = _pose_of(states, cell, r, c, k)
        n += 1
        if _move_of(states[r, c, k]) == REST:
            break
        r, c, k = _next(states, moves, r, c, k)
    return n
