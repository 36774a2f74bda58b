"""Roll-outs of candidate twists: what the chair would sweep, and what it would gain.

Everything is in the chair's own frame at the present moment: obstacles are points, the reference
is a chain of poses with its way s, where a radian of turning counts as `TURN_LENGTH` metres.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.kernel import kernel
from wheelchair_gym.kinematics import approach, arc_step
from wheelchair_gym.safety.sweep import outline_gap

Array = NDArray[np.float64]

TURN_LENGTH = 0.4  # m per rad: about the mean lever of the outline about the drive axle
STEP = 0.1  # s between two poses of a roll-out


class Weights(NamedTuple):
    """What a roll-out is scored by; all costs are in metres of way."""

    hold: float  # s for which a twist is held and must leave room to stop
    horizon: float  # s over which it is scored
    margin: float  # m that must always remain between the outline and an obstacle
    wish: float  # m of clearance beyond which more is worth nothing
    clearance: float  # cost of touching, falling to nothing at the wish
    error: float  # cost of a metre beside the reference, at the end
    change: float  # cost of changing the twist by 1 m/s or 1 rad/s
    reverse: float  # cost of a metre in reverse


@kernel
def match(
    x: float, y: float, yaw: float, reference: Array, first: int, most: float
) -> tuple[int, float]:
    """The reference pose nearest to a pose, and how far it is [m].

    Args:
        x: the pose's x [m]; then y [m] and yaw [rad].
        y: see x.
        yaw: see x.
        reference: rows (n, 4) x, y, yaw, s.
        first: row to begin with.
        most: rows with a larger s [m] are not looked at: no way is gained that was not driven.
    """
    best, row = 1e18, first
    for k in range(first, reference.shape[0]):
        if reference[k, 3] > most:
            break
        dx, dy = reference[k, 0] - x, reference[k, 1] - y
        turn = reference[k, 2] - yaw
        turn = TURN_LENGTH * (turn - 2.0 * math.pi * math.floor(turn / (2.0 * math.pi) + 0.5))
        distance = dx * dx + dy * dy + turn * turn
        if distance < best:
            best, row = distance, k
    return row, math.sqrt(best)


@kernel
def stops_clear(
    v: float,
    w: float,
    state: Array,
    limits: Array,
    footprint: Array,
    points: Array,
    hold: float,
    margin: float,
) -> bool:
    """Whether a twist, held for a while and then braked, keeps the margin until the chair rests.

    Args:
        v: target speed [m/s].
        w: target turn [rad/s].
        state: speed, its slope, turn, its slope now (4,).
        limits: `Limits.array`.
        footprint: `Footprint.array`.
        points: obstacles (k, 3), see `outline_gap`.
        hold: how long the twist is held [s].
        margin: what must remain [m].
    """
    x, y, yaw = 0.0, 0.0, 0.0
    sv, av, sw, aw = state[0], state[1], state[2], state[3]
    held = round(hold / STEP)
    for k in range(held + 40):
        if k == held:
            v, w = 0.0, 0.0
        sv, av = approach(sv, av, v, limits[3], limits[4], limits[7], STEP)
        sw, aw = approach(sw, aw, w, limits[6], limits[6], limits[8], STEP)
        x, y, yaw = arc_step(x, y, yaw, sv, sw, STEP)
        if outline_gap(x, y, yaw, footprint, points, margin + 0.01) < margin:
            return False
        if k >= held and abs(sv) < 0.02 and abs(sw) < 0.05:
            break
    return True


@kernel
def choose(
    candidates: Array,
    state: Array,
    last: Array,
    limits: Array,
    footprint: Array,
    points: Array,
    reference: Array,
    weights: Weights,
) -> int:
    """The cheapest candidate twist that leaves room to stop, or -1.

    Args:
        candidates: target twists (c, 2) [m/s, rad/s].
        state: speed, its slope, turn, its slope now (4,).
        last: the twist commanded before (2,).
        limits: `Limits.array`.
        footprint: `Footprint.array`.
        points: obstacles (k, 3) in the chair's frame, see `outline_gap`.
        reference: rows (n, 4) x, y, yaw, s in the chair's frame.
        weights: see `Weights`.
    """
    costs = np.empty(candidates.shape[0])
    start, _ = match(0.0, 0.0, 0.0, reference, 0, reference[0, 3] + 0.3)
    steps = round(weights.horizon / STEP)
    lever = math.hypot(max(footprint[0], footprint[1]), footprint[2])
    interest = weights.wish + 0.2
    for i in range(candidates.shape[0]):
        v, w = candidates[i, 0], candidates[i, 1]
        x, y, yaw = 0.0, 0.0, 0.0
        gap = 0.0  # a lower bound; looked for anew only where it might matter
        sv, av, sw, aw = state[0], state[1], state[2], state[3]
        cost, backed, driven = 0.0, 0.0, 0.1
        for k in range(steps):
            sv, av = approach(sv, av, v, limits[3], limits[4], limits[7], STEP)
            sw, aw = approach(sw, aw, w, limits[6], limits[6], limits[8], STEP)
            ax, ay, ayaw = arc_step(x, y, yaw, sv, sw, STEP)
            gap -= (abs(sv) + lever * abs(sw)) * STEP
            if gap < weights.wish:
                gap = outline_gap(ax, ay, ayaw, footprint, points, interest)
            short = max(0.0, 1.0 - gap / weights.wish)
            cost += weights.clearance * short * short / steps
            if gap < weights.margin:  # whatever lies beyond is not gained
                cost += weights.clearance * (steps - k) / steps
                break
            backed += max(0.0, -sv) * STEP
            driven += 1.1 * (abs(sv) + TURN_LENGTH * abs(sw)) * STEP
            x, y, yaw = ax, ay, ayaw
        row, error = match(x, y, yaw, reference, start, reference[start, 3] + driven)
        cost += weights.error * error - (reference[row, 3] - reference[start, 3])
        cost += weights.change * (abs(v - last[0]) + 0.5 * abs(w - last[1]))
        cost += weights.reverse * backed
        costs[i] = cost
    # The dear test only where it matters: from the best candidate on, until one leaves room.
    for i in np.argsort(costs):
        v, w = candidates[i, 0], candidates[i, 1]
        if stops_clear(v, w, state, limits, footprint, points, weights.hold, weights.margin):
            return int(i)
    return -1
