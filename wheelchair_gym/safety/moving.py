"""Moving things near the chair, and the places that they may reach.

Whatever moves may walk anywhere at `person_speed`, or set off from rest with `person_acceleration`.
A person who is tracked (`wheelchair_gym.perception`) moreover has a velocity, which they can change
by that acceleration at most, since they were seen last. What no single confirmed track of a person
explains has the first bound alone.
"""

import math
from typing import Any

from wheelchair_gym.base.arrays import Floats
from wheelchair_gym.compiled.address import on_stack, rows_of
from wheelchair_gym.compiled.kernel import borrowing_kernel
from wheelchair_gym.geometry.planar import world_to_body
from wheelchair_gym.perception.track_state import (
    ACCELERATION_DENSITY,
    CONSTANTS,
    PERSON,
    STATIC_MAP,
)
from wheelchair_gym.perception.tracker import place_variance, predict, reset
from wheelchair_gym.perception.tracker import update as update_tracks

_constants_at, _maps_at = rows_of(CONSTANTS), rows_of(STATIC_MAP)
_MAP_SIZE = STATIC_MAP.itemsize

_BETWEEN = 0.02  # m: samples of the outline are farther from a point than it is by less
_STOOD = 0.15  # s: a scan or two
_BLIND = 0.3  # m ahead of the axle: the laser does not see what is beside a point farther back
_QUIET = 1.0  # s without anything that moves, after which nobody is tracked
_OUTSIDE = 0.10  # m: points so far outside a track's circle may be of the same person
_EARLIER = 1.0  # s before a person was seen last: what was seen there was of them


@borrowing_kernel
def track(g: Any, s: Any, laser: Floats) -> None:
    """Give the tracker a new scan while something moves nearby; else it forgets everything.

    It forgets, too, where time stands still: it would take what it has for what is seen now.
    """
    if s.n_marks > 0:
        s.marked = s.stamp
    if g.tracks == 0.0:
        return
    quiet = s.stamp - s.marked > _QUIET
    if s.tracker.begun and (quiet or s.stamp <= s.tracker.stamp):
        reset(s.tracker)
    if quiet:
        return
    unknown = _maps_at(on_stack(_MAP_SIZE), 1)[0]
    unknown.rows = 0
    constants = _constants_at(g.tracker, 1)[0]
    update_tracks(constants, s.tracker, unknown, s.pose[:], s.read_twist[:], laser, s.stamp)


@borrowing_kernel
def _place_tracked(s: Any, near: Any) -> None:
    """Store what is tracked, in the chair's frame, as it was seen last."""
    tracker = s.tracker
    if not tracker.begun or tracker.stamp != s.stamp:
        return
    pose = tracker.pose
    c, sn = math.cos(pose[2]), math.sin(pose[2])
    for k in range(tracker.n_tracks):
        t = tracker.tracks[k]
        one, dt = near.tracked[near.n_tracked], s.stamp - t.seen
        one.is_person = t.confirmed and t.kind == PERSON
        one.x, one.y = world_to_body(c, sn, t.x - pose[0], t.y - pose[1])
        one.vx, one.vy = world_to_body(c, sn, t.vx, t.vy)
        one.radius, one.unseen = t.radius, dt
        one.place_var, one.covariance, one.speed_var = t.place_var, t.covariance, t.speed_var
        predict(one, -dt, ACCELERATION_DENSITY)
        near.n_tracked += 1


@borrowing_kernel
def _owner(near: Any, x: float, y: float, ago: float) -> int:
    """The tracked person that a point was of, seen so long ago [s].

    -1: nobody, or it may be of something else that is tracked, be it only predicted there.
    """
    owner = -1
    for i in range(near.n_tracked):
        one = near.tracked[i]
        earlier = ago - one.unseen
        if earlier > _EARLIER:
            continue
        dx, dy = x - one.x + earlier * one.vx, y - one.y + earlier * one.vy
        far = one.radius + _OUTSIDE
        if earlier < 0.0:
            far += math.sqrt(place_variance(one, -earlier, 0.0))
        if dx * dx + dy * dy < far * far:
            if owner >= 0 or earlier < 0.0 or not one.is_person:
                return -1
            owner = i
    return owner


@borrowing_kernel
def place_moving(g: Any, s: Any, near: Any, c: float, sn: float) -> None:
    """Store what may move in the chair's frame, and who of it is tracked."""
    if g.tracks != 0.0 and s.n_marks > 0:
        _place_tracked(s, near)
    for k in range(s.n_marks):
        mark = s.marks[k]
        x, y = world_to_body(c, sn, mark.x - s.pose[0], mark.y - s.pose[1])
        near.moving_x[k], near.moving_y[k] = x, y
        near.standing_for[k], near.hidden_for[k] = s.stamp - mark.stamp, s.stamp - mark.seen
        near.hidden = max(near.hidden, near.hidden_for[k])
        near.owner[k] = _owner(near, x, y, near.hidden_for[k])
    near.n_moving = s.n_marks


@borrowing_kernel
def spread_tracked(g: Any, near: Any, t: float) -> None:
    """Store where each who is tracked would be at a time t [s] from now, and how far from there."""
    for i in range(near.n_tracked):
        one = near.tracked[i]
        dt = t + one.unseen
        spread = g.track_sigmas * math.sqrt(place_variance(one, dt, 0.0))
        spread += 0.5 * g.person_acceleration * dt * dt
        one.spread = one.radius + _OUTSIDE + spread
        one.then_x, one.then_y = one.x + dt * one.vx, one.y + dt * one.vy


@borrowing_kernel
def may_reach_point(g: Any, near: Any, ahead: float, px: float, py: float, t: float) -> bool:
    """Whether something that moves may reach a point (px, py) at a time t [s] from now.

    The point is of the outline, so far `ahead` of the axle [m].
    """
    walks, margin = g.person_speed * t, g.stop_margin + _BETWEEN
    starts = min(walks, 0.5 * g.person_acceleration * t * t)
    for i in range(near.n_moving):
        reach = margin + (starts if near.standing_for[i] > _STOOD else walks)
        if near.hidden_for[i] > 0.0:
            if ahead < _BLIND:
                reach = margin + walks + g.person_speed * near.hidden_for[i]
            elif near.moving_x[i] < _BLIND:
                continue  # the laser sees them before they are ahead
            else:
                reach = margin + walks
        dx, dy = near.moving_x[i] - px, near.moving_y[i] - py
        if dx * dx + dy * dy >= reach * reach:
            continue
        if near.owner[i] < 0:
            return True
        one = near.tracked[near.owner[i]]
        dx, dy, reach = one.then_x - px, one.then_y - py, margin + one.spread
        if dx * dx + dy * dy < reach * reach:
            return True
    return False
