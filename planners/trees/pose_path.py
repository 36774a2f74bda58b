"""Paths of an outline as pieces of arcs, and how shortcuts and whales make them cheaper.

A path is a list of short pieces, each driven at a constant curvature, with its cost: its duration
at the chair's limits, and more near obstacles. Part of a path, a window, is replaced by connections
that cost less and that the outline drives freely, by an exact test. A shortcut is one connection.
Whales (Mirjalili and Lewis 2016) search poses on the way: a whale is the shifts of some poses of
the window, all of them jointly, and costs what connections through these poses cost.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from planners.collision.connections import CONNECTIONS, connection
from planners.collision.footprint import Sweeps, stretch_gap, sweep, sweeps
from planners.collision.nearby import Nearby, segments_in_view
from planners.rrt_star_woa.woa import WhaleParameters, Whales, move, new_whales, tell
from wheelchair_gym.arrays import Array
from wheelchair_gym.compiled.kernel import borrowing_kernel, kernel
from wheelchair_gym.geometry import wrap
from wheelchair_gym.kinematics import arc_step
from wheelchair_gym.maps.driving_cost import STILL, MotionCost, duration, kind_of, stretch_cost
from wheelchair_gym.random import Stream, next_uniform

LONGEST_PIECE = 0.2  # m: as the lattice's moves, so that costs are comparable
WIDEST_PIECE = 0.4  # rad
CAPACITY = 8192  # pieces of a path: 1.6 km
MIN_GAIN = 1e-6  # s: smaller gains are rounding
MAX_POSES = 64  # that whales move jointly

PIECE = np.dtype(
    [
        ("x", np.float64),  # m: where it begins
        ("y", np.float64),
        ("yaw", np.float64),  # rad
        ("way", np.float64),  # m
        ("turn", np.float64),  # rad
        ("cost", np.float64),  # s
        ("kind", np.int64),  # ahead, back or a pivot; see `kind_of`
    ]
)


class Drive(NamedTuple):
    """What an outline can drive, and what it costs; and workspace."""

    near: Nearby
    motion: MotionCost
    workspace: Sweeps
    seen: Array  # (segments, 4)
    trial: NDArray[Any]  # (CAPACITY,) PIECE: of one connection
    candidate: NDArray[Any]  # (CAPACITY,) PIECE: of several
    times: Array  # (CONNECTIONS,) s
    sharpest: float  # 1/m: greatest curvature of arcs


def new_drive(near: Nearby, motion: MotionCost, sharpest: float) -> Drive:
    """A drive on a map; `near` reaches `LONGEST_PIECE` beyond the outline's reach and clearance."""
    return Drive(
        near, motion, sweeps(1), np.empty_like(near.segments), np.zeros(CAPACITY, PIECE),
        np.zeros(CAPACITY, PIECE), np.zeros(CONNECTIONS), sharpest,
    )  # fmt: skip


@borrowing_kernel
def switch(motion: MotionCost, before: int, after: int) -> float:
    """Time [s] that a change of the kind of motion takes."""
    return motion.switch_time if before != 0 and after != 0 and before != after else 0.0


@borrowing_kernel
def piece_count(way: float, turn: float) -> int:
    """How many pieces a stretch has."""
    if kind_of(way, turn) == 0:
        return 0
    return int(max(1, math.ceil(max(abs(way) / LONGEST_PIECE, abs(turn) / WIDEST_PIECE) - 1e-9)))


@borrowing_kernel
def drive_stretch(
    drive: Drive, x: float, y: float, yaw: float, way: float, turn: float,
    pieces: NDArray[Any], first: int, budget: float,
) -> tuple[int, float]:  # fmt: skip
    """Write a stretch's pieces from index `first` on while they are free and within a budget [s].

    Returns how many have been written, and their cost [s].
    """
    near, motion, work = drive.near, drive.motion, drive.workspace
    count = piece_count(way, turn)
    if count == 0 or first + count >= pieces.shape[0]:
        return 0, 0.0
    part, bend, kind = way / count, turn / count, kind_of(way, turn)
    least = duration(motion, part, bend)
    sweep(work, 0, part, bend, motion.outline)
    cost = 0.0
    for k in range(count):
        ax, ay, ayaw = arc_step(x, y, yaw, way, turn, k / count)
        if not (near.box[0] <= ax <= near.box[2] and near.box[1] <= ay <= near.box[3]):
            return k, cost
        if cost + (count - k) * least >= budget:
            return k, cost
        gap = motion.desired_clearance
        seen = segments_in_view(near, ax, ay, ayaw, work.box[0], gap, drive.seen)
        gap = stretch_gap(work, 0, motion.outline, drive.seen, seen, gap, motion.margin)
        if gap < motion.margin:
            return k, cost
        piece = pieces[first + k]
        piece.x, piece.y, piece.yaw, piece.way, piece.turn = ax, ay, ayaw, part, bend
        piece.cost, piece.kind = stretch_cost(motion, part, bend, gap), kind
        cost += piece.cost
    return count, cost


@borrowing_kernel
def connection_time(
    motion: MotionCost, sharpest: float, kind: int, x: float, y: float, yaw: float, before: int,
    tx: float, ty: float, tyaw: float, after: int, sign: float,
) -> float:  # fmt: skip
    """Least time [s] of a connection between two kinds of motion; infinite if there is none.

    With a sign of -1 it is driven from the target.
    """
    possible, a, s, b, t, u = connection(kind, x, y, yaw, tx, ty, tyaw)
    if not possible:
        return math.inf
    time = 0.0
    for part in range(3):
        way, turn = (sign * a, sign * b, 0.0)[part], (s, t, u)[part]
        now = kind_of(way, turn)
        if abs(now) == 1 and abs(turn) > sharpest * abs(way) + STILL:
            return math.inf
        if now != 0:
            time += duration(motion, way, turn) + switch(motion, before, now)
            before = now
    return time + switch(motion, before, after)


@borrowing_kernel
def write_times(
    drive: Drive, x: float, y: float, yaw: float, before: int,
    tx: float, ty: float, tyaw: float, after: int, sign: float,
) -> float:  # fmt: skip
    """Write the time of each connection to `drive.times`; the least of them."""
    least = math.inf
    for kind in range(CONNECTIONS):
        drive.times[kind] = connection_time(
            drive.motion, drive.sharpest, kind, x, y, yaw, before, tx, ty, tyaw, after, sign
        )
        least = min(least, drive.times[kind])
    return least


@borrowing_kernel
def quickest(times: Array) -> int:
    """The connection of least time, or -1 where no time is finite."""
    best, found = math.inf, -1
    for kind in range(CONNECTIONS):
        if times[kind] < best:
            best, found = times[kind], kind
    return found


@borrowing_kernel
def connect(
    drive: Drive, x: float, y: float, yaw: float, before: int,
    tx: float, ty: float, tyaw: float, after: int, budget: float,
    pieces: NDArray[Any], first: int,
) -> tuple[int, int, float]:  # fmt: skip
    """Write the pieces of the cheapest free connection below a budget [s] from `first` on.

    A NaN heading of the target is free. Returns the kind of connection, -1 if there is none, how
    many pieces it has, and its cost [s] with the changes from and to other kinds of motion.
    """
    motion, trial, times = drive.motion, drive.trial, drive.times
    write_times(drive, x, y, yaw, before, tx, ty, tyaw, after, 1.0)
    best, found, length = budget, -1, 0
    while True:
        kind = quickest(times)
        if kind < 0 or times[kind] >= best:
            return found, length, best if found >= 0 else math.inf
        times[kind] = math.inf
        _, a, s, b, t, u = connection(kind, x, y, yaw, tx, ty, tyaw)
        px, py, pyaw, last, cost, count = x, y, yaw, before, 0.0, 0
        free = True
        for part in range(3):
            way, turn = (a, b, 0.0)[part], (s, t, u)[part]
            now = kind_of(way, turn)
            if now == 0:
                continue
            cost += switch(motion, last, now)
            made, more = drive_stretch(drive, px, py, pyaw, way, turn, trial, count, best - cost)
            cost += more
            free = made == piece_count(way, turn) and cost < best
            if not free:
                break
            count += made
            px, py, pyaw = arc_step(px, py, pyaw, way, turn, 1.0)
            last = now
        cost += switch(motion, last, after)
        if free and cost < best and first + count < pieces.shape[0]:
            best, found, length = cost, kind, count
            for k in range(count):
                pieces[first + k] = trial[k]


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


@borrowing_kernel
def via_cost(
    drive: Drive, path: Path, i: int, j: int, shifts: Array, turned: float, budget: float
) -> tuple[int, float]:
    """Write connections through shifted poses of a window to `drive.candidate`; count and cost [s].

    The shifts (3 k,) [m, m, rad] are in the frames of k poses, which share the window evenly; with
    none it is one connection. Each pose is `turned` [rad], too. The cost is infinite where they are
    not free below the budget.
    """
    pieces, poses = path.pieces, shifts.shape[0] // 3
    at = pieces[i]
    x, y, yaw, before = at.x, at.y, at.yaw, kind_before(path, i)
    cost, count = 0.0, 0
    for k in range(poses + 1):
        if k < poses:
            on = pieces[i + ((k + 1) * (j - i)) // (poses + 1)]
            c, s = math.cos(on.yaw), math.sin(on.yaw)
            ahead, aside = shifts[3 * k], shifts[3 * k + 1]
            tx, ty = on.x + c * ahead - s * aside, on.y + s * ahead + c * aside
            tyaw, after = on.yaw + turned + shifts[3 * k + 2], 0
        else:
            tx, ty, tyaw, after = pieces[j].x, pieces[j].y, pieces[j].yaw, kind_after(path, j)
            if j == path.size[0]:
                tyaw = path.goal[2]
        kind, made, more = connect(
            drive, x, y, yaw, before, tx, ty, tyaw, after, budget - cost, drive.candidate, count
        )
        if kind < 0:
            return 0, math.inf
        cost += more
        count += made
        if count > 0:
            before = int(drive.candidate[count - 1].kind)
        x, y, yaw = tx, ty, tyaw
    return count, cost


class PoseWhales(NamedTuple):
    """A swarm whose whales are shifts of poses of a path, in the frames of these."""

    whales: Whales  # (k, 3 MAX_POSES) m, m, rad
    bounds: Array  # (3,) largest shift ahead and aside [m], and turn [rad]
    scale: Array  # (1,) of the bounds


def new_pose_whales(
    parameters: WhaleParameters, bounds: tuple[float, float, float]
) -> PoseWhales:
    """A swarm with bounds of its shifts."""
    size = 3 * MAX_POSES
    population = np.zeros((parameters.population, size))
    whales = new_whales(population, parameters, np.zeros(size), np.zeros(size))
    return PoseWhales(whales, np.array(bounds), np.ones(1))


LEAST_SCALE, SHRINK, GROW = 0.02, 0.8, 1.3  # of the bounds, after a search without and with a gain


@borrowing_kernel
def search_vias(
    drive: Drive, path: Path, swarm: PoseWhales, i: int, j: int, poses: int, turned: float,
    state: Stream,
) -> int:  # fmt: skip
    """Let whales replace a window by connections through shifted poses; evaluations made.

    The leader at first is the path itself: all shifts are 0. Bounds shrink where nothing is found.
    With the poses turned by pi, the chair turns round and drives ahead where it backed.
    """
    d, all_, scale = 3 * poses, swarm.whales, swarm.scale[0]
    parameters, made = all_.parameters, 0
    whales = Whales(
        all_.population[:, :d], all_.leader[:d], all_.leader_cost, all_.c_range[:d],
        all_.lower[:d], all_.upper[:d], parameters,
    )  # fmt: skip
    for k in range(d):
        whales.leader[k], whales.upper[k] = 0.0, scale * swarm.bounds[k % 3]
        whales.lower[k] = -whales.upper[k]
    for whale in range(parameters.population):
        for k in range(d):
            low, high = whales.lower[k], whales.upper[k]
            drawn = low + (high - low) * next_uniform(state)
            whales.population[whale, k] = drawn if whale > 0 else 0.0
    old = window_cost(drive.motion, path, i, j)
    whales.leader_cost[0] = old - MIN_GAIN
    for t in range(parameters.iterations + 1):
        for whale in range(parameters.population):
            shifts = whales.population[whale]
            _, cost = via_cost(drive, path, i, j, shifts, turned, whales.leader_cost[0])
            tell(whales, whale, cost)
            made += 1
        if t < parameters.iterations:
            move(whales, t / parameters.iterations, state)
    found = whales.leader_cost[0] < old - MIN_GAIN
    if found:
        count, cost = via_cost(drive, path, i, j, whales.leader, turned, math.inf)
        found = cost < old and splice(path, drive.motion, i, j, drive.candidate, count)
    if turned != 0.0:
        return made
    factor = GROW if found else SHRINK
    swarm.scale[0] = min(1.0, max(LEAST_SCALE, factor * scale))
    return made


@borrowing_kernel
def shortcut(drive: Drive, path: Path, none: Array, i: int, j: int) -> bool:
    """Replace a window by one connection where that is cheaper; `none` are the shifts of none."""
    old = window_cost(drive.motion, path, i, j)
    count, cost = via_cost(drive, path, i, j, none, 0.0, old - MIN_GAIN)
    return cost < old and splice(path, drive.motion, i, j, drive.candidate, count)


@kernel
def poses_of_path(path: Path, spacing: float) -> Array:
    """The poses (n, 3) of a path, at most `spacing` [m] and twice as many rad apart."""
    n, total = path.size[0], 1
    for k in range(n):
        piece = path.pieces[k]
        total += int(max(1, math.ceil(max(abs(piece.way), 0.5 * abs(piece.turn)) / spacing - 1e-9)))
    poses = np.empty((total, 3))
    m = 0
    for k in range(n):
        piece = path.pieces[k]
        parts = int(max(1, math.ceil(max(abs(piece.way), 0.5 * abs(piece.turn)) / spacing - 1e-9)))
        for part in range(parts):
            poses[m, 0], poses[m, 1], poses[m, 2] = arc_step(
                piece.x, piece.y, piece.yaw, piece.way, piece.turn, part / parts
            )
            m += 1
    end = path.pieces[n]
    poses[m, 0], poses[m, 1], poses[m, 2] = end.x, end.y, end.yaw
    for k in range(1, total):
        poses[k, 2] = poses[k - 1, 2] + wrap(poses[k, 2] - poses[k - 1, 2])
    return poses
