"""How a chair drives from pose to pose: what a stretch costs, whether it is free, and joins.

To a given pose lead pivot, straight and pivot, or two arcs that meet in one direction (Bolton
1975, Biarc curves).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from planners.footprint import Sweeps, stretch_gap, sweep
from planners.nearby import Nearby, seen_from
from wheelchair_gym.geometry import wrap
from wheelchair_gym.kernel import borrowing_kernel
from wheelchair_gym.kinematics import arc_step

Array = NDArray[np.float64]

PIECE = 0.3  # m: longer stretches are looked at in pieces, each from its own beginning
STILL = 1e-9  # m, rad: less is no motion


class Manner(NamedTuple):
    """How the chair drives, and what it likes."""

    outline: Array  # (3,) m: front, rear, half width
    margin: float  # m: least gap
    wish: float  # m: gap beyond which more is worth nothing
    dear: float  # how many times dearer a move is at no gap
    forward: float  # m/s
    backward: float  # m/s that a way back is counted at
    turn: float  # rad/s
    spin: float  # rad/s of a pivot
    lateral: float  # m/s2
    switch: float  # s: to stop, and to start in another way
    steer: float  # s per 1/m of a change of curvature


@borrowing_kernel
def seconds(manner: Manner, way: float, turn: float) -> float:
    """Time [s] that a stretch takes at the speed it allows."""
    if abs(way) < STILL:
        return abs(turn) / manner.spin
    bend = abs(turn / way)
    speed = manner.forward if way > 0.0 else manner.backward
    if bend > 0.0:
        speed = min(speed, min(manner.turn / bend, math.sqrt(manner.lateral / bend)))
    return abs(way) / speed


@borrowing_kernel
def kind_of(way: float, turn: float) -> int:
    """1: ahead, -1: back, 2: a pivot, 0: none."""
    if abs(way) < STILL:
        return 2 if abs(turn) > STILL else 0
    return 1 if way > 0.0 else -1


@borrowing_kernel
def priced(manner: Manner, way: float, turn: float, gap: float) -> float:
    """Cost [s] of a stretch: its time, dearer the nearer it comes to anything."""
    short = (manner.wish - gap) / manner.wish
    return seconds(manner, way, turn) * (1.0 + manner.dear * short * short)


@borrowing_kernel
def free_gap(
    near: Nearby, manner: Manner, x: float, y: float, yaw: float, way: float, turn: float,
    room: Sweeps, seen: Array,
) -> float:  # fmt: skip
    """Least gap [m] of a stretch of any length, at most the wish; below the margin any."""
    pieces = max(1, math.ceil(abs(way) / PIECE))
    gap = manner.wish
    part, bend = way / pieces, turn / pieces
    sweep(room, 0, part, bend, manner.outline)
    for k in range(pieces):
        ax, ay, ayaw = arc_step(x, y, yaw, way, turn, k / pieces)
        if not (near.box[0] <= ax <= near.box[2] and near.box[1] <= ay <= near.box[3]):
            return 0.0
        count = seen_from(near, ax, ay, ayaw, room.box[0], gap, seen)
        gap = stretch_gap(room, 0, manner.outline, seen, count, gap, manner.margin)
        if gap < manner.margin:
            break
    return gap


@borrowing_kernel
def connect(
    near: Nearby, manner: Manner, x: float, y: float, yaw: float, kind: int,
    tx: float, ty: float, tyaw: float, budget: float, room: Sweeps, seen: Array, out: Array,
) -> float:  # fmt: skip
    """The cheapest of a few ways to a target pose; its heading is free if it is NaN.

    Writes ways and turns (3, 2) to `out`.

    Returns:
        The cost [s], infinite where no way is free or below the budget.
    """
    dx, dy = tx - x, ty - y
    far, towards = math.hypot(dx, dy), wrap(math.atan2(dy, dx) - yaw)
    best = budget
    found = False
    for option in range(4):
        back = option % 2 == 1
        sign = -1.0 if back else 1.0
        a, b = 0.0, 0.0  # ways
        s, t, u = 0.0, 0.0, 0.0  # turns
        aim = wrap(towards + math.pi) if back else towards
        if option < 2:
            if far <= STILL:
                continue
            if math.isnan(tyaw):  # one arc
                if abs(aim) > 0.5 * math.pi:
                    continue
                half = aim
                a = sign * far * (half / math.sin(half) if abs(half) > STILL else 1.0)
                s = 2.0 * half
            else:  # two arcs
                c0, s0 = math.cos(yaw), math.sin(yaw)
                c1, s1 = math.cos(tyaw), math.sin(tyaw)
                vt = dx * (c0 + c1) + dy * (s0 + s1)
                less = 2.0 - 2.0 * (c0 * c1 + s0 * s1)  # 4 - |t0 + t1|^2
                square = dx * dx + dy * dy
                if less > 1e-9:
                    root = math.sqrt(vt * vt + less * square)
                    d = (-vt + sign * root) / less
                elif sign * vt > 1e-9:
                    d = 0.5 * square / vt
                else:
                    continue
                if sign * d < STILL:
                    continue
                mx, my = 0.5 * (dx + d * (c0 - c1)), 0.5 * (dy + d * (s0 - s1))
                first = math.hypot(mx, my)
                half = wrap(math.atan2(my, mx) - yaw + (math.pi if back else 0.0))
                middle = yaw + 2.0 * half
                last = math.hypot(dx - mx, dy - my)
                other = wrap(math.atan2(dy - my, dx - mx) - middle + (math.pi if back else 0.0))
                if abs(half) > 0.5 * math.pi or abs(other) > 0.5 * math.pi:
                    continue
                a = sign * first * (half / math.sin(half) if abs(half) > STILL else 1.0)
                b = sign * last * (other / math.sin(other) if abs(other) > STILL else 1.0)
                s, t = 2.0 * half, 2.0 * other
        else:  # pivot, straight, pivot
            if far > STILL:
                s, b = aim, sign * far
            u = 0.0 if math.isnan(tyaw) else wrap(tyaw - yaw - s)
        cost = 0.0
        before = kind
        for part in range(3):
            way, turn = (a, b, 0.0)[part], (s, t, u)[part]
            now = kind_of(way, turn)
            if now != 0:
                cost += seconds(manner, way, turn)
                if before != 0 and before != now:
                    cost += manner.switch
                before = now
        if cost >= best:
            continue
        px, py, pyaw = x, y, yaw
        for part in range(3):
            way, turn = (a, b, 0.0)[part], (s, t, u)[part]
            if kind_of(way, turn) == 0:
                continue
            gap = free_gap(near, manner, px, py, pyaw, way, turn, room, seen)
            if gap < manner.margin:
                cost = math.inf
                break
            cost += priced(manner, way, turn, gap) - seconds(manner, way, turn)
            if cost >= best:
                break
            px, py, pyaw = arc_step(px, py, pyaw, way, turn, 1.0)
        if cost < best:
            best, found = cost, True
            out[0, 0], out[1, 0], out[2, 0] = a, b, 0.0
            out[0, 1], out[1, 1], out[2, 1] = s, t, u
    return best if found else math.inf
