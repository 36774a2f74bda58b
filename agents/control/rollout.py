"""Roll-outs of candidate twists: what the chair would sweep, and what it would gain.

Everything is in the chair's own frame at the present moment: obstacles are points, the reference
is a chain of poses with its way s, where a radian of turning counts as `TURN_LENGTH` metres.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.compiled.kernel import kernel
from wheelchair_gym.geometry import (
    Footprint,
    clearance_to_points,
    rectangle_point_gap,
    required_clearance,
)
from wheelchair_gym.kinematics import Limits, approach_twist, arc_step, peak_speed

Array = NDArray[np.float64]


class Motion:
    """Speed and turn with their slopes, which no encoder tells; and what bounds them.

    Attributes:
        state: speed, its slope, turn, its slope (4,).
        last: the target twist commanded last (2,).
    """

    def __init__(self, limits: Limits, outline: Footprint, period: float) -> None:
        self.limits = limits
        self.outline = outline
        self.array = limits.array
        self.footprint = outline.array
        self.period = period
        self.state: Array = np.zeros(4)
        self.last: Array = np.zeros(2)

    @property
    def body(self) -> Body:
        """The chair as kernels take it."""
        return Body(self.state, self.last, self.array, self.footprint)

    def measured(self, twist: Array) -> None:
        """Believe the encoders where the ramps must be wrong: a bump, a slip, a shield."""
        for k, far in ((0, 0.10), (1, 0.20)):
            if abs(self.state[2 * k] - twist[k]) > far:
                self.state[2 * k], self.state[2 * k + 1] = twist[k], 0.0

    def command(self, twist: Array) -> None:
        """Note what is commanded for the next period."""
        v, v_rate, w, w_rate = self.state.tolist()
        to_v, to_w = twist.tolist()
        self.state[:] = approach_twist(v, v_rate, w, w_rate, to_v, to_w, self.array, self.period)
        self.last = np.array(twist)


TURN_LENGTH = 0.4  # m per rad: about the mean lever of the outline about the drive axle
STEP = 0.1  # s between two poses of a roll-out
HEADWAY = 0.06  # s: so much of its own speed the outline keeps clear beside it, as a shield has it
SLOW = 0.1  # m/s: and from here on only
CAUTION = 0.35  # s: of way by which the chair keeps farther from what moves; it may turn any moment


class Weights(NamedTuple):
    """What a roll-out is scored by (`agents.control.follower`); all costs are in metres of way."""

    horizon: float  # s over which it is scored
    foresight: float  # s over which movers are foreseen
    wish: float  # m of clearance beyond which more is worth nothing
    room: float  # m, the same from what moves
    progress: float  # gain of a metre along the reference
    clearance: float  # cost of a metre in touch with something, falling to nothing at the wish
    path: float  # cost of a metre beside the reference, at the end, and half half-way
    comfort: float  # cost of changing the twist by 1 m/s or 1 rad/s
    reverse: float  # cost of a metre in reverse
    struck: float  # cost of a mover that comes up to the chair


class Near(NamedTuple):
    """What is round the chair, in its own frame."""

    points: Array  # (k, 3) x, y and the distance from the origin [m], which rises
    movers: Array  # (m, 5) x, y [m], vx, vy [m/s], radius [m]
    reference: Array  # (n, 4) x, y [m], yaw [rad], way [m]


class Body(NamedTuple):
    """The chair, and how it moves now."""

    state: Array  # (4,) speed, its slope, turn, its slope
    last: Array  # (2,) the twist commanded before
    limits: Any  # record, `Limits.array`
    footprint: Array  # (3,) `Footprint.array`


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
def mover_gap(
    x: float, y: float, yaw: float, footprint: Array, movers: Array, t: float, interest: float
) -> float:
    """Distance [m] from the outline at a pose to where the nearest mover is foreseen; 0 inside.

    Args:
        x: the pose's x [m]; then y [m] and yaw [rad].
        y: see x.
        yaw: see x.
        footprint: `Footprint.array`.
        movers: see `Near`.
        t: when the chair is at that pose [s].
        interest: farther ones are not looked for [m].
    """
    c, s = math.cos(yaw), math.sin(yaw)
    best = interest
    for k in range(movers.shape[0]):
        px, py = movers[k, 0] + t * movers[k, 2] - x, movers[k, 1] + t * movers[k, 3] - y
        gap = rectangle_point_gap(c * px + s * py, c * py - s * px, footprint)
        best = min(best, max(0.0, gap - movers[k, 4]))
    return best


@kernel
def stops_clear(v: float, w: float, body: Body, near: Near, hold: float, margin: float) -> bool:
    """Whether a twist, held for a while and then braked, keeps the margin until the chair rests.

    What moves is where it is foreseen, or stops where it is now: in motion the chair comes to
    neither nearer than it would be if it stood.

    Args:
        v: target speed [m/s].
        w: target turn [rad/s].
        body: the chair now.
        near: what is round it.
        hold: how long the twist is held [s].
        margin: what must remain [m].
    """
    x, y, yaw = 0.0, 0.0, 0.0
    state, limits = body.state, body.limits
    sv, av, sw, aw = state[0], state[1], state[2], state[3]
    held = round(hold / STEP)
    lever = math.hypot(max(body.footprint[0], body.footprint[1]), body.footprint[2])
    for k in range(held + 40):
        if k == held:
            v, w = 0.0, 0.0
        sv, av, sw, aw = approach_twist(sv, av, sw, aw, v, w, limits, STEP)
        x, y, yaw = arc_step(x, y, yaw, sv, sw, STEP)
        need = required_clearance(margin, HEADWAY, abs(sv), abs(sw), lever, SLOW)
        if clearance_to_points(x, y, yaw, body.footprint, near.points, need + 0.01) < need:
            return False
        still = abs(sv) < 0.02 and abs(sw) < 0.05
        if not still and near.movers.shape[0] > 0:
            room = margin + CAUTION * abs(sv)
            for t in (0.0, (k + 1) * STEP):
                gap = mover_gap(x, y, yaw, body.footprint, near.movers, t, room)
                if gap < room:  # drawing away from who comes is always allowed
                    here = mover_gap(0.0, 0.0, 0.0, body.footprint, near.movers, t, room)
                    if gap < here:
                        return False
        ends = (
            peak_speed(sv, av, limits.jerk) < 0.02 and peak_speed(0.0, aw, limits.turn_jerk) < 0.05
        )
        if k >= held and still and ends:
            break
    return True


@kernel
def cost_of(
    commands: Array, body: Body, near: Near, start: int, margin: float, weights: Weights
) -> float:
    """The cost [m] of commands, rolled out: the one objective of every local controller.

    Args:
        commands: (k, 3) m/s, rad/s, s, one after another; the last one lasts.
        body: the chair now.
        near: what is round it.
        start: the row of the reference where the chair is.
        margin: what must always remain between the outline and an obstacle [m].
        weights: see `Weights`.
    """
    state, limits, footprint, reference = body.state, body.limits, body.footprint, near.reference
    steps = round(weights.horizon / STEP)
    lever = math.hypot(max(footprint[0], footprint[1]), footprint[2])
    x, y, yaw = 0.0, 0.0, 0.0
    gap = 0.0  # a lower bound; looked for anew only where it might matter
    sv, av, sw, aw = state[0], state[1], state[2], state[3]
    v, w, row, until = commands[0, 0], commands[0, 1], 0, commands[0, 2]
    cost: float = weights.comfort * (abs(v - body.last[0]) + 0.5 * abs(w - body.last[1]))
    backed, driven, barred, some = 0.0, 0.1, False, near.movers.shape[0] > 0
    end = (0.0, 0.0, 0.0)
    for k in range(max(steps, round(weights.foresight / STEP)) if some else steps):
        if k == steps:  # from here on it comes to rest: is that where others come?
            v, w = 0.0, 0.0
        while k < steps and k * STEP >= until - 1e-9 and row + 1 < commands.shape[0]:
            row += 1
            change = abs(commands[row, 0] - v) + 0.5 * abs(commands[row, 1] - w)
            cost += weights.comfort * change
            v, w, until = commands[row, 0], commands[row, 1], until + commands[row, 2]
        if not barred:
            sv, av, sw, aw = approach_twist(sv, av, sw, aw, v, w, limits, STEP)
            ax, ay, ayaw = arc_step(x, y, yaw, sv, sw, STEP)
            if k < steps:
                gap -= (abs(sv) + lever * abs(sw)) * STEP
                if gap < weights.wish:
                    gap = clearance_to_points(
                        ax, ay, ayaw, footprint, near.points, weights.wish + 0.2
                    )
                if gap < margin:  # whatever lies beyond is not gained
                    cost += weights.clearance * weights.horizon * (steps - k) / steps
                    barred = True
                else:
                    # By way, not by time: a chair that is slow where it is tight is no worse off,
                    # and none is better off where it stands before a narrow place.
                    moved = (abs(sv) + TURN_LENGTH * abs(sw)) * STEP
                    short = max(0.0, 1.0 - gap / weights.wish)
                    cost += weights.clearance * short * short * moved
                    backed += max(0.0, -sv) * STEP
                    driven += 1.1 * moved
                    end = (ax, ay, ayaw)
                    if k == steps // 2:  # half-way, too, or it cuts corners
                        most = reference[start, 3] + driven
                        _, error = match(ax, ay, ayaw, reference, start, most)
                        cost += 0.5 * weights.path * error
            if not barred:
                x, y, yaw = ax, ay, ayaw
        if some:
            room = mover_gap(x, y, yaw, footprint, near.movers, (k + 1) * STEP, weights.room)
            short = 1.0 - room / weights.room
            cost += weights.clearance * short * short * STEP
            if room < margin:
                cost += weights.struck * (1.0 - 0.6 * k * STEP / weights.foresight)
                break
        elif barred:
            break
    at, error = match(end[0], end[1], end[2], reference, start, reference[start, 3] + driven)
    cost += weights.path * error
    cost -= weights.progress * (reference[at, 3] - reference[start, 3])
    return cost + weights.reverse * backed


@kernel
def begin(near: Near) -> int:
    """The row of the reference where the chair is."""
    row, _ = match(0.0, 0.0, 0.0, near.reference, 0, near.reference[0, 3] + 0.3)
    return row


@kernel
def costs_of(candidates: Array, body: Body, near: Near, margin: float, weights: Weights) -> Array:
    """The costs (c,) [m] of candidates (c, k, 3); see `cost_of`."""
    costs, start = np.empty(candidates.shape[0]), begin(near)
    for i in range(candidates.shape[0]):
        costs[i] = cost_of(candidates[i], body, near, start, margin, weights)
    return costs


@kernel
def cheapest(
    twists: Array, costs: Array, body: Body, near: Near, hold: float, margin: float
) -> int:
    """The cheapest twist that leaves room to stop, or -1.

    The dear test is made only from the best on, until one passes.

    Args:
        twists: (c, 2 or 3) [m/s, rad/s]; what follows does not count.
        costs: (c,) of what begins with them.
        body: the chair now.
        near: what is round it.
        hold: how long the twist is held [s].
        margin: what must always remain [m].
    """
    for i in np.argsort(costs):
        if stops_clear(twists[i, 0], twists[i, 1], body, near, hold, margin):
            return int(i)
    return -1
