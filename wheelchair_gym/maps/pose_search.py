"""Finding the quickest ways of the chair's outline: Dijkstra's algorithm backwards from the goal.

Moves are short arcs ahead and back and pivots, dearer near walls, as the planner `lattice` has
them. Ways guide: what a planner returns is tested exactly, these are good to a few millimetres of
the map's raster.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wheelchair_gym.config import setting, settings
from wheelchair_gym.geometry import Footprint
from wheelchair_gym.kernel import kernel
from wheelchair_gym.kinematics import Limits
from wheelchair_gym.maps.distance import distance_to_squares
from wheelchair_gym.maps.grid import OccupancyGrid
from wheelchair_gym.maps.outline import outline_discs, outline_gap
from wheelchair_gym.maps.pose_ways import (
    FAR,
    MOVE,
    REST,
    TICKS,
    TIME,
    UNITS,
    X_BITS,
    PoseWays,
    Whole,
    Words,
    to_local,
)

Array = NDArray[np.float64]
Field = NDArray[np.float32]

_BUCKETS = 1024  # more than the dearest move takes, in ticks
_UNSEEN, _SETTLED = -1, -2  # of states that wait in no bucket


@settings
class WaysSettings:
    """How ways of the chair's outline are found."""

    cell: float = setting(default=0.1, unit="m", source="half a move", low=0.02, high=0.5)
    headings: int = setting(default=32, source="11 deg, a move's least turn", low=8, high=128)
    stride: float = setting(default=0.2, unit="m", source="a fifth of the chair", low=0.02)
    wish: float = setting(
        default=0.25, unit="m", source="play beside the chair in a 1.1 m door", low=0.01
    )
    dear: float = setting(default=3.0, source="as the planner `lattice`", low=0.0, high=6.0)
    lateral: float = setting(default=0.35, unit="m/s2", source="comfort in curves", low=0.01)
    spin: float = setting(default=0.6, source="of the turn limit, in pivots", low=0.05, high=1.0)
    back: float = setting(default=2.0, source="times a way back is dearer", low=1.0, high=4.0)
    margin: float = setting(default=0.02, unit="m", source="kept by the outline", low=0.0)
    slimmer: float = setting(
        default=0.02,
        unit="m",
        source="less on each side where no way leads from the start",
        low=0.0,
    )
    tries: int = setting(default=5, source="outlines tried: 8 cm less on each side", low=1)


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

    Args:
        field: distances (rows, cols) [m] on the map's raster.
        scale: cells of it per metre.
        shape: rows and columns of the lattice.
        cell: side of its cells [m].
        discs: (n, 3) of the outline.
        moves: (moves, headings, 3).
        cost: (moves,) s.
        kind: (moves,) 1 ahead, -1 back, 2 a pivot.
        seeds: (n, 2) x and y [units], at the goal.
        switch: s to change from one kind to another.
        wish: gap [m] beyond which more is worth nothing.
        dear: how many times dearer a move is at no gap.
        margin: least gap [m].
        start: row, column and heading that ways are sought from.
        ease: ticks that a cell on the way to it takes at least; 0 for ways from everywhere.
        slack: ticks that the search goes on when it is there.
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
            gap = outline_gap(field, scale, discs, x * size, y * size, cosines[k], sines[k], wish)
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
                gap = outline_gap(
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


def _moves(own: WaysSettings, limits: Limits) -> tuple[Whole, Array, Whole]:
    """Where moves lead (moves, headings, 3), the seconds that they take, and their kinds."""
    step = 2.0 * math.pi / own.headings
    ahead: list[tuple[float, int]] = [(own.stride, turn) for turn in (0, 1, -1, 2, -2)]
    back = [(-own.stride, turn) for turn in (0, 1, -1)] if limits.backward > 0.0 else []
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
            cost[m], kind[m] = abs(turn) * step / (own.spin * limits.turn), 2
            continue
        bend = abs(turn) * step / abs(way)
        pace = limits.forward if way > 0.0 else limits.backward / own.back
        if bend > 0.0:
            pace = min(pace, limits.turn / bend, math.sqrt(own.lateral / bend))
        cost[m], kind[m] = abs(way) / pace, 1 if way > 0.0 else -1
    return moves, cost, kind


def pose_ways(
    grid: OccupancyGrid,
    goal: ArrayLike,
    footprint: Footprint,
    limits: Limits,
    *,
    tolerance: float = 0.0,
    starts: Sequence[ArrayLike] = (),
    own: WaysSettings | None = None,
    slack: float | None = None,
) -> PoseWays:
    """Quickest ways to a goal from every pose, or from about one start.

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
    own = own or WaysSettings()
    moves, cost, kind = _moves(own, limits)
    reach = footprint.reach + own.wish + grid.resolution
    field = distance_to_squares(grid.solid(), reach / grid.resolution)
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
    for k in range(own.tries):
        words = _spread(
            field, 1.0 / grid.resolution, (rows, cols), own.cell,
            outline_discs(footprint, k * own.slimmer), moves, cost, kind, seeds, switch,
            own.wish, own.dear, own.margin if k == 0 else 0.0,
            begin, ease, round((slack or 0.0) * TICKS),
        )  # fmt: skip
        ways = PoseWays(words.reshape(rows, cols, own.headings), moves, own.cell, grid.origin)
        if all(math.isfinite(float(ways.time(start))) for start in starts):
            break
    return ways
