"""Decides how much of a twist may be driven: predicted trajectories that end at rest."""

import math
from typing import Any

import numpy as np

from wheelchair_gym.base.arrays import Array
from wheelchair_gym.compiled.address import on_stack, rows_of
from wheelchair_gym.compiled.kernel import borrowing_kernel, inlined
from wheelchair_gym.compiled.simd import bits_of_double, double_of_bits
from wheelchair_gym.geometry.kinematics import (
    STOP_RAMP_FACTOR,
    approach_twist,
    brake,
    clip_to_limits,
    odometric_step,
    peak_speed,
)
from wheelchair_gym.geometry.outline import required_clearance, signed_clearance
from wheelchair_gym.geometry.planar import point_to_world, world_to_body
from wheelchair_gym.safety.agreement import is_doubted
from wheelchair_gym.safety.grid import was_seen
from wheelchair_gym.safety.moving import may_reach_point, place_moving, spread_tracked
from wheelchair_gym.safety.state import (
    CLOSE,
    FAR,
    MOVING,
    NEARBY,
    NOTHING,
    OBSTACLE,
    REACH,
    REST_SPEED,
    SIDES,
    UNSEEN,
    follow_wheels,
    set_motion,
)

_nearby_at, _SIZE = rows_of(NEARBY), NEARBY.itemsize

STEP = 0.05  # s between two poses of a predicted trajectory
_MAX_STEPS = 100
_FAST, _TURNS = 1.03, 1.15  # maximum ratios of a chair's speed and turn rate to the set ones
_MARGIN_SHARE = 0.25  # share of the margin that is kept where the chair creeps or stops hard
_TOO_FAST = 2.0  # times the speed allowed in unseen space: too fast for a comfort stop
_HEADWAY_SHARE = 0.5  # share of the slow zone that must be left for a comfort stop
_PIVOT = 0.05  # m/s ahead: slower is a pivot
_REST = 0.01  # m/s: slower is at rest
_TURN_REST = 0.02  # rad/s
_ROUND = 1e-6  # of a pose
_WORSE = 1e-6  # m: what is inside the stop zone may not come nearer, beyond rounding
_HALVINGS = 5  # of the share that is driven: to 3 %
_COARSE = 4  # the same for planning, with many twists at once
_BLOCK = 32  # points that are compared at once
_NOWHERE = 1e9  # m
_FINE = 0.01  # s: step of the set point's model, as boards run it at 100 Hz


@borrowing_kernel
def held_steps(g: Any) -> int:
    """Number of steps of a predicted trajectory that cover one control period."""
    poses: int = math.ceil(g.period / STEP - _ROUND)
    return poses


@inlined
def _outward_speed(samples: Any, k: int, v: float, v1: float, w: float, w1: float) -> float:
    """Maximum speed [m/s] of a point of the outline along the normal of its side."""
    nx, ny = samples.normal_x[k], samples.normal_y[k]
    turning = samples.x[k] * ny - samples.y[k] * nx
    return float((v1 if nx > 0.0 else v) * nx + (w1 if turning > 0.0 else w) * turning)


@borrowing_kernel
def _find_outward(g: Any, near: Any, v: float, v1: float, w: float, w1: float, limit: float) -> int:
    """Store the points of the outline that go outward faster than `limit` [m/s]; how many they are.

    Speed and turn rate are intervals. For a rear corner in a pivot or in reverse it is the corner's
    full speed; ahead, it follows its own side.
    """
    samples, n = g.samples, 0
    for k in range(2 if v <= _PIVOT else 0):  # the rear corners
        ax, ay = samples.x[k], samples.y[k]
        low, high = (w * ay, w1 * ay) if ay > 0.0 else (w1 * ay, w * ay)
        vx, vy = max(high - v, v1 - low), max(-w, w1) * ax
        if math.sqrt(vx * vx + vy * vy) > limit:
            near.out_x[n], near.out_y[n] = ax, ay
            n += 1
    for begin, last in SIDES:  # no point of a side is faster than both of its ends
        fastest = _outward_speed(samples, begin, v, v1, w, w1)
        if max(fastest, _outward_speed(samples, last, v, v1, w, w1)) > limit:
            for k in range(begin, last + 1):
                if _outward_speed(samples, k, v, v1, w, w1) > limit:
                    near.out_x[n], near.out_y[n] = samples.x[k], samples.y[k]
                    n += 1
    return n


@borrowing_kernel
def may_reach_person(
    g: Any, near: Any, x: float, y: float, yaw: float, v: float, w: float, t: float
) -> bool:
    """Whether a moving object may reach a part of the outline that moves outward.

    Other parts are left out: contact there would happen to a standing chair, too.
    """
    c, sn = math.cos(yaw), math.sin(yaw)
    n = _find_outward(g, near, v, v, w, w, g.creep_speed)
    if n > 0:
        spread_tracked(g, near, t)
    for k in range(n):
        px, py = point_to_world(c, sn, x, y, near.out_x[k], near.out_y[k])
        if may_reach_point(g, near, near.out_x[k], px, py, t):
            return True
    return False


@borrowing_kernel
def speed_interval(speed: float, delayed: float, factor: float) -> tuple[float, float]:
    """Interval between a speed and its delayed value, where that is farther from zero.

    Both ends are scaled away from zero by the factor. A delay of a rising speed is no danger.
    """
    delayed = delayed if abs(delayed) > abs(speed) else speed
    low, high = min(speed, delayed), max(speed, delayed)
    return low * (factor if low < 0.0 else 1.0), high * (factor if high > 0.0 else 1.0)


@borrowing_kernel
def _enters_unseen_space(
    s: Any, near: Any, n: int, x: float, y: float, yaw: float, since: float
) -> bool:
    """Whether a pose puts one of the n points stored where nobody has looked since a stamp."""
    c, sn = math.cos(yaw), math.sin(yaw)
    out_x, out_y = near.out_x[:], near.out_y[:]
    for k in range(n):
        px, py = point_to_world(c, sn, x, y, out_x[k], out_y[k])
        if not was_seen(s, px, py, since):
            return True
    return False


@borrowing_kernel
def _place_near(
    g: Any, near: Any, points_x: Array, points_y: Array, n: int, c: float, s: float, x: float,
    y: float,
) -> None:  # fmt: skip
    """Store n points in the chair's frame, either as inside the stop zone or as near."""
    outline, margin, begin = g.outline[:], g.stop_margin, near.n
    front, rear, half = outline[0], -outline[1], outline[2]
    near_x, near_y, gap = near.x[begin:], near.y[begin:], near.gaps[:]
    minimum = bits_of_double(near.gap)
    for k in range(np.uint64(n)):
        px, py = world_to_body(c, s, points_x[k] - x, points_y[k] - y)
        dx, dy = max(px - front, rear - px), abs(py) - half
        beside = math.sqrt(dx * dx + dy * dy)
        apart = beside if (dx > 0.0) & (dy > 0.0) else max(dx, dy)
        inside = math.sqrt(px * px + py * py) < REACH
        near_x[k], near_y[k], gap[k] = px, py, apart if inside else FAR
        bits = bits_of_double(max(0.0, gap[k]))
        minimum = bits if bits < minimum else minimum
    near.gap = double_of_bits(minimum)
    m = np.uint64(0)
    for k in range(np.uint64(n)):
        near_x[m], near_y[m] = near_x[k], near_y[k]
        if gap[k] < margin and near.n_close < CLOSE:
            point = near.close[near.n_close]
            point.x, point.y, point.distance = near_x[k], near_y[k], gap[k]
            near.n_close += 1
        else:
            m += np.uint64(gap[k] < FAR)
    near.n += np.int64(m)


@borrowing_kernel
def empty_nearby(near: Any) -> None:
    """Reset a record of NEARBY: nothing is near."""
    near.n, near.n_moving, near.n_close, near.gap, near.hidden = 0, 0, 0, FAR, 0.0
    near.n_tracked = 0


@borrowing_kernel
def _pad(x: Array, y: Array, n: int) -> None:
    """Put points that matter nowhere behind n points, since vectors take blocks of them."""
    for k in range(n, n + -n % _BLOCK):
        x[k] = y[k] = _NOWHERE


@borrowing_kernel
def gather(g: Any, s: Any, near: Any) -> None:
    """Store points and echoes in the chair's frame, as NEARBY."""
    empty_nearby(near)
    c, sn = math.cos(s.pose[2]), math.sin(s.pose[2])
    x, y = s.pose[0], s.pose[1]
    points, others = s.points, s.others
    _place_near(g, near, points.x[:], points.y[:], s.n_points, c, sn, x, y)
    _place_near(g, near, others.x[:], others.y[:], s.n_others, c, sn, x, y)
    for k in range(s.n_arc.shape[0]):
        arc = s.arc[k]
        _place_near(g, near, arc.x[:], arc.y[:], s.n_arc[k], c, sn, x, y)
    place_moving(g, s, near, c, sn)
    s.gap = near.gap
    _pad(near.x[:], near.y[:], near.n)
    _pad(near.moving_x[:], near.moving_y[:], near.n_moving)


@borrowing_kernel
def _clearance(
    px: Array, py: Array, n: int, x: float, y: float, yaw: float, outline: Array,
    interest: float,
) -> float:  # fmt: skip
    """Distance [m] from the outline at a pose to the nearest of n points, at most `interest`."""
    c, s = math.cos(yaw), math.sin(yaw)
    middle = 0.5 * (outline[0] - outline[1])
    half_length, half_width = 0.5 * (outline[0] + outline[1]), outline[2]
    mx, my = x + c * middle, y + s * middle
    minimum = bits_of_double(interest * interest)
    for k in range(np.uint64(n + -n % _BLOCK)):
        ahead, left = world_to_body(c, s, px[k] - mx, py[k] - my)
        dx, dy = max(abs(ahead) - half_length, 0.0), max(abs(left) - half_width, 0.0)
        bits = bits_of_double(dx * dx + dy * dy)
        minimum = bits if bits < minimum else minimum
    return math.sqrt(double_of_bits(minimum))


@borrowing_kernel
def check_trajectory(g: Any, s: Any, near: Any, v: float, w: float) -> int:
    """The reason why a twist may not be driven for one period and then braked; NOTHING if it may.

    Without a better option the next decision brakes in the same way: within the comfort limits
    before static obstacles, at the protective limit before moving ones.
    """
    if is_doubted(s.keys[0]) and max(abs(v), 0.5 * g.track * abs(w)) > g.creep_speed:
        return UNSEEN
    wary = s.n_lost > 0 or (v < 0.0 and s.stamp - s.marked < g.wary_time)
    unseen = min(g.creep_speed, g.unseen_speed) if wary else g.unseen_speed
    reason = _sweep_static(g, s, near, v, w, g.stop_margin, g.time_headway, unseen)
    return _sweep_moving(g, s, near, v, w) if reason == NOTHING and near.n_moving > 0 else reason


@borrowing_kernel
def needs_protective_stop(g: Any, s: Any, near: Any) -> bool:
    """Whether the chair must brake harder than a comfort stop does.

    It must if a moving object would come too near even to a protective stop. At creep speed beside
    something close it need not. Else it must if a comfort stop would leave less than fixed shares
    of the stop margin and of the headway, shares that noise does not use up.
    """
    v, w = s.setpoint.v, s.setpoint.w
    if v == 0.0 and w == 0.0:
        return False
    if near.n_moving > 0 and _sweep_moving(g, s, near, 0.0, 0.0) != NOTHING:
        return True
    if near.n_close > 0:
        corner = math.sqrt(max(g.outline[0], g.outline[1]) ** 2 + g.outline[2] ** 2)
        if abs(v) + 0.5 * corner * abs(w) <= _TOO_FAST * g.creep_speed:
            return False
    margin, unseen = _MARGIN_SHARE * g.stop_margin, _TOO_FAST * g.unseen_speed
    headway = _HEADWAY_SHARE * g.time_headway
    return bool(_sweep_static(g, s, near, 0.0, 0.0, margin, headway, unseen) != NOTHING)


@borrowing_kernel
def _sweep_moving(g: Any, s: Any, near: Any, v: float, w: float) -> int:
    """Check one period and a protective stop against moving objects and all other points."""
    limits, outline, setpoint = g.limits, g.outline[:], s.setpoint
    px, py, moving_x, moving_y = near.x[:], near.y[:], near.moving_x[:], near.moving_y[:]
    lever = math.sqrt(max(outline[0], outline[1]) ** 2 + outline[2] ** 2)
    sv, av, sw, aw = setpoint.v, setpoint.v_slope, setpoint.w, setpoint.w_slope
    x, y, yaw = odometric_step(0.0, 0.0, 0.0, sv * s.reaction_time, sw * s.reaction_time)
    t, hold = s.reaction_time, held_steps(g)
    minimum = _MARGIN_SHARE * g.stop_margin
    # Lower bounds of both clearances, which are computed anew only where they might matter.
    bound, moving_bound = near.gap - (abs(sv) + lever * abs(sw)) * t, 0.0
    for k in range(_MAX_STEPS):
        v0, w0 = sv, sw
        if k < hold:
            sv, av, sw, aw = approach_twist(sv, av, sw, aw, v, w, limits, STEP)
        else:
            sv, sw = brake(sv, sw, limits.protective * STEP, g.track)
        x, y, yaw = odometric_step(x, y, yaw, 0.5 * (v0 + sv) * STEP, 0.5 * (w0 + sw) * STEP)
        t += STEP
        fastest = abs(sv) + lever * abs(sw)
        if k >= hold and fastest <= g.creep_speed:
            break
        bound -= fastest * STEP
        if bound < minimum and near.n_close == 0:
            bound = _clearance(px, py, near.n, x, y, yaw, outline, minimum + 0.2)
            if bound < minimum:
                return OBSTACLE
        moving_bound -= fastest * STEP
        need = g.stop_margin + g.person_speed * (t + near.hidden)
        if fastest > g.creep_speed and moving_bound < need:
            moving_bound = _clearance(
                moving_x, moving_y, near.n_moving, x, y, yaw, outline, need + 0.3
            )
            fast, turns = _FAST * sv, _TURNS * sw
            if moving_bound < need and may_reach_person(g, near, x, y, yaw, fast, turns, t):
                return MOVING
    return NOTHING


@borrowing_kernel
def _sweep_static(
    g: Any, s: Any, near: Any, v: float, w: float, margin: float, headway: float, unseen: float
) -> int:
    """Check one period and a comfort stop against static obstacles and unseen space.

    It keeps a margin [m] and a time headway [s], and enters unseen space no faster than `unseen`.
    """
    limits, outline, setpoint = g.limits, g.outline[:], s.setpoint
    sv, av, sw, aw = setpoint.v, setpoint.v_slope, setpoint.w, setpoint.w_slope
    lever = math.sqrt(max(outline[0], outline[1]) ** 2 + outline[2] ** 2)
    px, py, yaw0 = s.pose[0], s.pose[1], s.pose[2]
    c0, s0 = math.cos(yaw0), math.sin(yaw0)
    bx, by, byaw = px, py, yaw0  # the pose if the wheels follow the set point at once
    # The wheels keep their present speeds for a reaction time.
    x, y, yaw = odometric_step(0.0, 0.0, 0.0, sv * s.reaction_time, sw * s.reaction_time)
    t = s.reaction_time
    hold = held_steps(g)
    # Along something inside the stop zone the chair may creep on, as far as noise permits.
    minimum = _MARGIN_SHARE * g.stop_margin if near.n_close > 0 else margin
    # A lower bound of the clearance, which is computed anew only where it might matter.
    bound = near.gap - (abs(sv) + lever * abs(sw)) * t if near.n_close == 0 else 0.0
    lv, lw = s.delayed_v, s.delayed_w
    rises, late = True, STEP / (s.reaction_time + STEP)
    for k in range(_MAX_STEPS):
        if k == hold:
            v, w = 0.0, 0.0
        v0, w0 = sv, sw
        sv, av, sw, aw = approach_twist(sv, av, sw, aw, v, w, limits, STEP)
        x, y, yaw = odometric_step(x, y, yaw, 0.5 * (v0 + sv) * STEP, 0.5 * (w0 + sw) * STEP)
        t += STEP
        speed, turn = abs(sv), abs(sw)
        fastest = speed + lever * turn
        bound -= fastest * STEP
        need = required_clearance(minimum, headway, speed, turn, lever, g.creep_speed)
        if bound < need:
            bound = _clearance(near.x[:], near.y[:], near.n, x, y, yaw, outline, need + 0.2)
            if bound < need:
                return OBSTACLE
        if near.n_close > 0:
            if k >= hold and speed + 0.5 * lever * turn > g.creep_speed:
                return OBSTACLE
            c, sn = math.cos(yaw), math.sin(yaw)
            for i in range(near.n_close):
                ex, ey = world_to_body(c, sn, near.close[i].x - x, near.close[i].y - y)
                if signed_clearance(ex, ey, outline) < near.close[i].distance - _WORSE:
                    return OBSTACLE
        rises = rises and (k < hold or speed > abs(v0) or turn > abs(w0))
        lv, lw = lv + late * (sv - lv), lw + late * (sw - lw)
        vl, vh = speed_interval(sv, lv, _FAST)
        wl, wh = speed_interval(sw, lw, _TURNS)
        if max(-vl, vh) + lever * max(-wl, wh) > unseen:
            since, n = s.stamp - g.memory_time, _find_outward(g, near, vl, vh, wl, wh, unseen)
            # Until it brakes, the chair may lag behind its set point by up to a reaction time.
            if n > 0 and rises and _enters_unseen_space(s, near, n, bx, by, byaw, since + k * STEP):
                return UNSEEN
            wx, wy = point_to_world(c0, s0, px, py, x, y)
            if n > 0 and _enters_unseen_space(s, near, n, wx, wy, yaw0 + yaw, since + t):
                return UNSEEN
        if rises:
            way, turned = 0.5 * (v0 + sv) * STEP, 0.5 * (w0 + sw) * STEP
            bx, by, byaw = odometric_step(bx, by, byaw, way, turned)
        rests = peak_speed(sv, av, limits.jerk) < _REST
        if k >= hold and rests and peak_speed(sw, aw, limits.turn_jerk) < _TURN_REST:
            break
    return NOTHING


@borrowing_kernel
def _allowed_share(g: Any, s: Any, near: Any, v: float, w: float) -> tuple[float, int]:
    """The share of a twist that may be driven, and the reason that limits it."""
    if v == 0.0 and w == 0.0 and s.setpoint.v == 0.0 and s.setpoint.w == 0.0:
        return 1.0, NOTHING
    reason = check_trajectory(g, s, near, v, w)
    if reason == NOTHING:
        return 1.0, reason
    low, high = 0.0, 1.0
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        if check_trajectory(g, s, near, middle * v, middle * w) == NOTHING:
            low = middle
        else:
            high = middle
    return low, reason


@borrowing_kernel
def limit_for_unseen_space(g: Any, s: Any, motion: Array, twists: Array) -> None:
    """Scale twists (n, 2) in place to what the rule of unseen space allows, now and later.

    `motion` (4,) is the chair's speed, its slope, its turn rate and its slope.
    """
    near, setpoint = _nearby_at(on_stack(_SIZE), 1)[0], s.setpoint
    empty_nearby(near)
    v0, v0_slope, w0, w0_slope = setpoint.v, setpoint.v_slope, setpoint.w, setpoint.w_slope
    delayed = s.delayed_v, s.delayed_w
    for k in range(twists.shape[0]):
        v, w = twists[k, 0], twists[k, 1]
        low, high, share = 0.0, 1.0, 1.0
        for _ in range(_COARSE + 1):
            set_motion(s, motion[0], motion[1], motion[2], motion[3])
            good = check_trajectory(g, s, near, share * v, share * w) == NOTHING
            if good:  # and once the chair drives like that
                set_motion(s, share * v, 0.0, share * w, 0.0)
                good = check_trajectory(g, s, near, share * v, share * w) == NOTHING
            if good:
                low = share
            else:
                high = share
            if low == 1.0:
                break
            share = 0.5 * (low + high)
        twists[k, 0], twists[k, 1] = low * v, low * w
    set_motion(s, v0, v0_slope, w0, w0_slope)
    s.delayed_v, s.delayed_w = delayed


@borrowing_kernel
def delay_setpoint(g: Any, s: Any, dt: float) -> None:
    """Advance the delayed set point, which follows the set point as the wheels do."""
    share = dt / (s.reaction_time + dt)
    s.delayed_v += share * (s.setpoint.v - s.delayed_v)
    s.delayed_w += share * (s.setpoint.w - s.delayed_w)


@borrowing_kernel
def decide(g: Any, s: Any, v: float, w: float) -> tuple[float, float, bool]:
    """The part of a twist (v, w) [m/s, rad/s] that may be driven during the next period.

    Returns:
        The twist, and whether the chair makes a protective stop instead: after a fault, and where
        a comfort stop is no longer enough.
    """
    limits, setpoint, decision = g.limits, s.setpoint, s.decision
    follow_wheels(s, s.read_twist[0], s.read_twist[1])
    near = _nearby_at(on_stack(_SIZE), 1)[0]
    gather(g, s, near)
    v, w = clip_to_limits(v, w, limits)
    decision.asked[0], decision.asked[1] = v, w
    s.rearmed = s.rearmed and s.latched != NOTHING
    share, reason = 0.0, s.latched
    if reason == NOTHING:
        share, reason = _allowed_share(g, s, near, v, w)
    v, w = share * v, share * w
    decision.protective = s.latched != NOTHING or (
        share == 0.0 and needs_protective_stop(g, s, near)
    )
    decision.reason, decision.given[0], decision.given[1] = reason, v, w
    if s.rearmed and abs(setpoint.v) + abs(setpoint.w) < REST_SPEED:  # it stands one more period
        s.latched, s.rearmed = NOTHING, False
    if decision.protective:
        decision.given[0] = decision.given[1] = 0.0
        slower = STOP_RAMP_FACTOR * limits.protective * g.period
        setpoint.v, setpoint.w = brake(setpoint.v, setpoint.w, slower, g.track)
        setpoint.v_slope, setpoint.w_slope = 0.0, 0.0
        delay_setpoint(g, s, g.period)
        return 0.0, 0.0, True
    n = max(1, round(g.period / _FINE))
    dt = g.period / n
    for _ in range(n):
        setpoint.v, setpoint.v_slope, setpoint.w, setpoint.w_slope = approach_twist(
            setpoint.v, setpoint.v_slope, setpoint.w, setpoint.w_slope, v, w, limits, dt
        )
        delay_setpoint(g, s, dt)
    return v, w, False
