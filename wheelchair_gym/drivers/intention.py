"""Intention: what a person sees of the obstacles, and which signal it wants next.

Every `period` a person foresees where the chair will be once a new signal takes effect, from the
motion that the chair really makes. From there it rolls each signal of its interface out along an
arc, and takes the one that costs least: time to go from the arc's end, obstacles that it sees, and
the change of the signal.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.compiled.address import doubles_at, on_stack
from wheelchair_gym.compiled.kernel import borrowing_kernel
from wheelchair_gym.drivers.state import (
    ELSEWHERE,
    GO,
    LOOK,
    OBSTACLE,
    OUTLINE,
    PENDING,
    RETREAT,
    SECTORS,
    STICK,
)
from wheelchair_gym.geometry import body_to_world, signed_clearance, signed_gap, wrap
from wheelchair_gym.kinematics import arc_step, twist_of_action
from wheelchair_gym.random import DRIVERS, normal, uniform
from wheelchair_gym.task.prepared_episode import geodesic_to_go, seconds_to_go

Array = NDArray[np.float64]
Floats = NDArray[np.float32]

# Indices of draws of a decision in the channel DRIVERS.
LAPSE, LAPSE_TIME, MIND, WHERE, LOOKS = 100, 101, 102, 103, 104
NOTICED, INDECISION = 200, 300  # and on: of each sector, of each signal
POSES = 6  # on the arc of a signal
TOUCH = 0.01  # m: nearer is a collision
COLLISION = 100.0  # s: an arc that collides costs more than any other
NO_WAY = 60.0  # s more where the quickest way is not known
AHEAD = 0.5  # m before the axle, where a route's length shows whether the heading is right
PUSHED = 0.15  # deflection from which on somebody pushes
STILL = 0.03  # m/s, rad/s: slower does not count as motion
APPROACH = 20.0  # s for which somebody goes up to a thing
NEAR_GOAL = 1.0  # m
MOST_SURPLUS = 0.4  # rad/s that a person learns to expect beside what it asks for
RESPONSE = 0.4  # s: time constant with which chairs follow a change of turn
DECELERATION = 0.8  # m/s2: as chairs brake


@borrowing_kernel
def _see(p: Any, d: Any, scan: Floats) -> None:
    """Take from a scan the obstacles that the person sees: of each sector the nearest beam."""
    sight, n = p.perception, p.beams
    d.n_points = 0
    epoch = math.floor(d.clock)
    for sector in range(min(SECTORS, n)):
        low, high = sector * n // min(SECTORS, n), (sector + 1) * n // min(SECTORS, n)
        best, nearest = -1, np.float32(np.inf)
        for k in range(low, high):
            if np.float32(0.0) < scan[k] < nearest:
                best, nearest = k, scan[k]
        if best < 0:
            continue
        angle = p.mount[2] + p.first + p.per_beam * best
        x = p.mount[0] + nearest * math.cos(angle)
        y = p.mount[1] + nearest * math.sin(angle)
        side = math.atan2(y, x)
        if not -sight.right < side < sight.left:
            continue
        if side > sight.neglect and (
            uniform(d.key, epoch, DRIVERS, NOTICED + sector) >= sight.noticed
        ):
            continue
        d.points[d.n_points, 0], d.points[d.n_points, 1] = x, y
        d.n_points += 1


@borrowing_kernel
def _gap(p: Any, d: Any, x: float, y: float, yaw: float) -> float:
    """Distance [m] of the outline at a pose in the chair's frame to what is seen; < 0 inside."""
    return float(signed_gap(d.points[:], d.n_points, p.outline[:], x, y, yaw))


@borrowing_kernel
def _nearest(d: Any, most: float) -> tuple[float, float]:
    """What is seen nearest within an angle ahead [rad], in the chair's frame [m]; NaN: nothing."""
    x, y, least = math.nan, math.nan, math.inf
    for k in range(d.n_points):
        px, py = d.points[k, 0], d.points[k, 1]
        if math.hypot(px, py) < least and abs(math.atan2(py, px)) <= most:
            x, y, least = px, py, math.hypot(px, py)
    return x, y


@borrowing_kernel
def _to_go(p: Any, d: Any, prepared: Any, x: float, y: float, yaw: float) -> float:
    """Seconds from a pose on the map to where the person wants to be."""
    c, s = math.cos(yaw), math.sin(yaw)
    if d.mode == ELSEWHERE or d.mode == LOOK or (p.way == OBSTACLE and d.mode == GO):
        ahead = 0.0 if d.mode == ELSEWHERE else p.outline[0]
        fx, fy = x + ahead * c, y + ahead * s
        bearing = math.atan2(d.target[1] - y, d.target[0] - x)
        far = math.hypot(d.target[0] - fx, d.target[1] - fy)
        return float(far / p.forward + abs(wrap(bearing - yaw)) / p.turn)
    # Who drifts takes its place for one further to the other side.
    x, y = x + s * p.perception.drift, y - c * p.perception.drift
    if p.way == OUTLINE:
        seconds = seconds_to_go(prepared, x, y, yaw)
        if seconds >= 0.0:  # else none is known
            return seconds
    seconds = NO_WAY if p.way == OUTLINE and prepared.state_rows > 0 else 0.0
    seconds += geodesic_to_go(prepared, x + AHEAD * c, y + AHEAD * s) / p.forward
    return float(seconds + 0.1 * geodesic_to_go(prepared, x, y) / p.forward)


@borrowing_kernel
def _motion(p: Any, d: Any, k: int) -> tuple[float, float]:
    """The twist that a person expects of signal k [m/s, rad/s]."""
    v, w = twist_of_action(p.signals[k, 0], p.signals[k, 1], p.forward, p.backward, p.turn)
    return v, w if k == 0 else w + d.surplus


@borrowing_kernel
def _cost(p: Any, d: Any, prepared: Any, k: int, pose: Array, twist: Array) -> float:
    """Seconds that signal k costs.

    With few signals, an arc may be left at any of its poses; then half of the horizon's rest is
    thought to be lost.
    """
    plan, horizon = p.intention, p.intention.horizon
    later = p.perception.anticipation * p.late[k]
    begin = arc_step(0.0, 0.0, 0.0, twist[0], twist[1], later)
    v, w = _motion(p, d, k)
    # A stick leaves many arcs to choose from: none that collides. Of few signals, one is good
    # until the chair must be stopped.
    to_stop = horizon if p.kind == STICK else p.late[0] + plan.period + abs(v) / DECELERATION
    cos_pose, sin_pose = math.cos(pose[2]), math.sin(pose[2])
    fixed = p.wait[k] if k != d.chosen else 0.0
    fixed += plan.steadiness * math.hypot(
        p.signals[k, 0] - p.signals[d.chosen, 0], p.signals[k, 1] - p.signals[d.chosen, 1]
    )
    if plan.indecision > 0.0:
        fixed += plan.indecision * normal(d.key, d.decisions, DRIVERS, INDECISION + k)
    costs = doubles_at(on_stack(8 * POSES), POSES)
    free = POSES
    touch = TOUCH
    if d.mode == LOOK:
        touch = 0.5 * plan.look_distance
    cost, x, y, yaw = 0.0, begin[0], begin[1], begin[2]
    before = _gap(p, d, x, y, yaw)
    for j in range(POSES):
        x, y, yaw = arc_step(begin[0], begin[1], begin[2], v, w, horizon * (j + 1) / POSES)
        if p.way != OBSTACLE:
            gap = _gap(p, d, x, y, yaw)
            # Where it already touches, as it seems, what leads away is no collision.
            if gap < touch and gap <= before:
                free = j
                break
            short = max(0.0, (plan.clearance - gap) / max(plan.clearance, 1e-6))
            cost += plan.caution * min(4.0, short * short) * horizon / POSES
            before = gap
        if p.kind == STICK and j < POSES - 1:  # only the arc's end counts
            continue
        wx, wy = body_to_world(cos_pose, sin_pose, x, y)
        to_go = _to_go(p, d, prepared, pose[0] + wx, pose[1] + wy, pose[2] + yaw)
        costs[j] = cost + horizon * (0.5 + 0.5 * (j + 1) / POSES) + to_go
    usable = free
    if free < POSES:
        usable = math.floor(free - to_stop / horizon * POSES)
        if usable <= 0:
            return float(COLLISION * (2.0 - (free + 1.0) / POSES) + horizon * abs(v))
    if p.kind == STICK or (v == 0.0 and w == 0.0):
        return float(fixed + costs[POSES - 1])
    best = math.inf
    for j in range(usable):
        best = min(best, costs[j])
    return float(fixed + best)


@borrowing_kernel
def _change_mode(p: Any, d: Any, pose: Array) -> None:
    """Let what the person is about end, or something else begin."""
    plan = p.intention
    c, s = math.cos(pose[2]), math.sin(pose[2])
    if d.stuck > plan.patience and d.mode != RETREAT and plan.retreat > 0.0:
        d.mode, d.mode_until, d.stuck = RETREAT, d.clock + plan.retreat, 0.0
    if d.mode != GO and d.clock >= d.mode_until:
        d.mode = GO
    if p.way == OBSTACLE:
        x, y = _nearest(d, math.pi)
        wx, wy = body_to_world(c, s, x, y)
        d.target[0], d.target[1] = pose[0] + wx, pose[1] + wy
    if d.mode != GO:
        return
    each = plan.period / 60.0
    if uniform(d.key, d.decisions, DRIVERS, MIND) < plan.mind_changes * each:
        open_, found = 0, -1
        for k in range(d.n_points):
            px, py = d.points[k, 0], d.points[k, 1]
            if math.hypot(px, py) > 2.0 and abs(math.atan2(py, px)) > 0.5:
                open_ += 1  # each of them is as likely
                if uniform(d.key, d.decisions, DRIVERS, WHERE + 400 + k) * open_ < 1.0:
                    found = k
        if found >= 0:
            wx, wy = body_to_world(c, s, 0.7 * d.points[found, 0], 0.7 * d.points[found, 1])
            d.target[0], d.target[1] = pose[0] + wx, pose[1] + wy
            d.mode, d.mode_until = ELSEWHERE, d.clock + plan.mind_change_time
            return
    if uniform(d.key, d.decisions, DRIVERS, LOOKS) < plan.looks * each:
        x, y = _nearest(d, 1.0)
        if math.hypot(x, y) < 2.5:  # NaN: there is nothing
            wx, wy = body_to_world(c, s, x, y)
            d.target[0], d.target[1] = pose[0] + wx, pose[1] + wy
            d.mode, d.mode_until = LOOK, d.clock + APPROACH


@borrowing_kernel
def _may_choose(p: Any, d: Any, k: int) -> bool:
    """Whether what the person is about allows signal k."""
    x = p.signals[k, 0]
    if d.mode == RETREAT:
        return bool(x <= 0.0)
    if d.mode == LOOK:
        return bool(0.0 <= x <= p.intention.look_speed)
    return True


@borrowing_kernel
def _choose(p: Any, d: Any, prepared: Any, pose: Array, twist: Array) -> int:
    """The signal that costs least from where the chair will be."""
    if d.mode == LOOK and d.n_points > 0:
        x, y = _nearest(d, 1.0)
        if signed_clearance(x, y, p.outline[:]) <= p.intention.look_distance:  # NaN: never
            d.mode_until = min(d.mode_until, d.clock + p.intention.look_time)
            return 0
    best, least = 0, math.inf
    for k in range(p.n_signals):
        if not _may_choose(p, d, k):
            continue
        if d.mode == RETREAT:  # back, as far from everything as possible
            v, w = _motion(p, d, k)
            x, y, yaw = arc_step(0.0, 0.0, 0.0, v, w, p.intention.horizon)
            cost = v - min(1.0, _gap(p, d, x, y, yaw)) + 0.1 * abs(w)
        else:
            cost = _cost(p, d, prepared, k, pose, twist)
        if cost < least:
            best, least = k, cost
    return best


@borrowing_kernel
def notice_motion(p: Any, d: Any, twist: Array) -> None:
    """Notice how a push moves the chair: what the chair does counts, not what it was asked."""
    pushes = math.hypot(d.stick[0], d.stick[1]) > PUSHED
    stands = abs(twist[0]) < STILL and abs(twist[1]) < STILL
    d.stuck = d.stuck + p.period if pushes and stands else 0.0
    asked = 0.0 if d.intended == 0 else p.signals[d.intended, 1] * p.turn
    d.expected += (asked - d.expected) * min(1.0, p.period / RESPONSE)
    more = min(MOST_SURPLUS, max(-MOST_SURPLUS, twist[1] - d.expected))
    if pushes:
        d.surplus += (more - d.surplus) * min(1.0, p.period / p.intention.adaptation)


@borrowing_kernel
def decide(p: Any, d: Any, prepared: Any, pose: Array, twist: Array, scan: Floats) -> None:
    """Decide on a signal if it is time, which the body follows after the reaction time."""
    if d.clock + 1e-9 < d.decide_at:
        return
    d.decide_at += p.intention.period
    d.decisions += 1
    sight = p.perception
    if d.clock < d.lapse_until:
        return
    if uniform(d.key, d.decisions, DRIVERS, LAPSE) < sight.lapses / 60.0 * p.intention.period:
        share = uniform(d.key, d.decisions, DRIVERS, LAPSE_TIME)
        d.lapse_until = d.clock + sight.lapse_least + share * (sight.lapse_most - sight.lapse_least)
        return
    _see(p, d, scan)
    _change_mode(p, d, pose)
    chosen = _choose(p, d, prepared, pose, twist)
    d.chosen = chosen
    if d.pending < PENDING:
        d.pending_signal[d.pending] = chosen
        late = p.interface.delay if p.kind == STICK else 0.0
        d.pending_at[d.pending] = d.clock + sight.reaction + late
        d.pending += 1


@borrowing_kernel
def begin_intention(d: Any) -> None:
    """Let nothing be decided yet."""
    d.decisions = d.chosen = d.n_points = 0
    d.mode, d.decide_at, d.mode_until, d.stuck, d.lapse_until = GO, 0.0, 0.0, 0.0, 0.0
    d.target[0] = d.target[1] = d.surplus = d.expected = 0.0
