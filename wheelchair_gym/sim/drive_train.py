"""Motion of a chair: set point, speed control, motors, tyres, battery, and Munk2D's step.

Tyres hold by friction: the forces are those that let both wheels roll and the axle not slide, found
exactly for the coming step, as long as each wheel stays inside its friction circle; beyond it, the
wheels slip and the forces come from projected Gauss-Seidel sweeps. Velocities are staggered by half
a step (leapfrog): the velocity after a step points along the heading in the middle of the next one,
so an arc is driven to second order.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from wheelchair_gym.compiled.kernel import absorbed_kernel, borrowing_kernel
from wheelchair_gym.engine import GRAVITY, body_view, move_freely, step_space
from wheelchair_gym.geometry.kinematics import (
    STOP_RAMP_FACTOR,
    approach_twist,
    brake,
    clip_to_limits,
    wheels_of_twist,
)
from wheelchair_gym.geometry.planar import body_to_world, world_to_body
from wheelchair_gym.sim.settings import WHEEL_INERTIA

CASTER_TRACK = 0.46  # m between the two casters
BATTERY_RESISTANCE = 0.1  # ohm, internal
_SWEEPS = 20  # of Gauss-Seidel, when a wheel slips
_BRAKING_SHARE = 0.8  # of what it can brake: wheels follow their set point late
_CREEP = 0.05  # m/s: drag rises linearly below this speed, so that it never reverses a motion


class DriveConstants(NamedTuple):
    """Constants of physics steps from parameters, computed once a period: divisions are slow."""

    run: float  # s, between two runs of the speed control
    share: float  # of the low-pass
    counts_per_rad: float
    metres_per_run: float  # m/s of one count in a run
    feed: float  # V s/m of feed-forward
    per_ohm: float  # A/V
    drag: float  # N s, of one caster in a physics step
    rolling: float  # N m per m of radius
    bound: float  # N s, that a tyre holds in a physics step
    radii: tuple[float, float]  # m
    per_radius: tuple[float, float]  # 1/m
    inertia: tuple[float, float]  # kg, of each wheel at its rim
    matrix: tuple[float, float, float]  # a11, a12, a22 of both wheels rolling
    per_det: float


@borrowing_kernel
def drive_constants(p: Any) -> DriveConstants:
    """The constants of one control period of a chair with parameters p."""
    run = p.dt * p.speed_every
    load = p.mass * GRAVITY
    ahead = p.body.centre_of_mass
    on_casters = load * ahead / p.body.wheelbase
    grip = 0.5 * (load - on_casters)
    half = 0.5 * p.track
    gl = WHEEL_INERTIA / (p.radius_left * p.radius_left)
    gr = WHEEL_INERTIA / (p.radius_right * p.radius_right)
    a11, a12 = p.mass + gl + gr, half * (gr - gl)
    a22 = p.moment + p.mass * ahead * ahead + half * half * (gl + gr)
    return DriveConstants(
        run,
        run / (p.motor.filter_time + run),
        p.nominal_radius * p.counts_per_metre,
        1.0 / (p.counts_per_metre * run),
        p.feed_constant / p.nominal_radius,
        1.0 / p.motor.resistance,
        0.5 * p.body.caster_drag * on_casters * p.dt,
        p.body.rolling_resistance * grip,
        p.friction * grip * p.dt,
        (p.radius_left, p.radius_right),
        (1.0 / p.radius_left, 1.0 / p.radius_right),
        (gl, gr),
        (a11, a12, a22),
        1.0 / (a11 * a22 - a12 * a12),
    )


@borrowing_kernel
def ramp_set_point(state: Any, p: Any, v: float, w: float, protective: bool, dt: float) -> None:
    """Move the set point towards the target twist within the limits of comfort.

    In a protective stop it falls at once, exempt from jerk; as on the boards faster than the chair
    is to slow down, so that the chair does.
    """
    limits = p.limits
    if protective:
        v, w = state.v, state.w
        state.v, state.w = brake(v, w, STOP_RAMP_FACTOR * limits.protective * dt, p.nominal_track)
        state.v_rate, state.w_rate = (state.v - v) / dt, (state.w - w) / dt
        return
    v, w = clip_to_limits(v, w, limits)
    state.v, state.v_rate, state.w, state.w_rate = approach_twist(
        state.v, state.v_rate, state.w, state.w_rate, v, w, limits, dt
    )


@borrowing_kernel
def update_explained_motion(state: Any, p: Any, k: DriveConstants) -> None:
    """Update the motions that the set point explains: its own, and earlier ones braked since then.

    It brakes no faster than comfort, tyres and motors let it, and a little slower.
    """
    motors = 2.0 * p.gain * p.motor.torque_constant * p.motor.current_limit / p.nominal_radius
    force = min(motors, 2.0 * k.bound / p.dt)
    slower = _BRAKING_SHARE * k.run * min(p.limits.deceleration, force / p.mass)
    a22 = k.matrix[2]
    turn_rate = min(p.limits.turn_acceleration, 0.5 * p.track * force / a22)
    turn_slower = _BRAKING_SHARE * k.run * turn_rate
    e = state.explained
    e[0], e[1] = min(state.v, e[0] + slower), max(state.v, e[1] - slower)
    e[2], e[3] = min(state.w, e[2] + turn_slower), max(state.w, e[3] - turn_slower)


@borrowing_kernel
def control_speed(state: Any, p: Any, k: DriveConstants) -> None:
    """One run of the two wheels' PID with feed-forward, on quantised encoder counts.

    As on the drive board, both wheels count as equal: the host divides each wheel's speed by its
    share of the mean radius.
    """
    left, right = wheels_of_twist(state.v, state.w, p.nominal_track)
    for i in range(2):
        target = (left if i == 0 else right) / p.wheel_share[i]
        counts = math.floor(state.turned[i] * k.counts_per_rad)
        measured = (counts - state.counts[i]) * k.metres_per_run
        state.counts[i] = counts
        state.speed[i] += k.share * (measured - state.speed[i])
        # The target passes the same low-pass, so that its delay does not wind up the integral.
        state.target[i] += k.share * (target - state.target[i])
        error = state.target[i] - state.speed[i]
        slope = (error - state.error[i]) / k.run
        state.error[i] = error
        rate = (state.v_rate + (i - 0.5) * p.nominal_track * state.w_rate) / p.wheel_share[i]
        forward = k.feed * target + p.motor.ka * rate
        volts = forward + p.motor.kp * error + state.integral[i] + p.motor.kd * slope
        if target == 0.0 and abs(state.speed[i]) < 0.5 * k.metres_per_run:
            # At rest both ends of the motor are joined: it holds without drawing current.
            state.integral[i], volts = 0.0, 0.0
        elif abs(volts) < state.voltage:
            state.integral[i] += p.motor.ki * error * k.run
        state.duty[i] = min(1.0, max(-1.0, volts / state.voltage))


@absorbed_kernel
def _drag_of_casters(
    p: Any, k: DriveConstants, ahead: float, aside: float, turning: float
) -> tuple[float, float, float]:
    """Return the impulse along and across [N s] and its moment [N m s] of two dragged casters."""
    push, shove, twist = 0.0, 0.0, 0.0
    lever = p.body.wheelbase - p.body.centre_of_mass
    for side in range(2):
        across = (0.5 - side) * CASTER_TRACK
        vx, vy = ahead - turning * across, aside + turning * lever
        drag = -k.drag / math.sqrt(vx * vx + vy * vy + _CREEP * _CREEP)
        push += drag * vx
        shove += drag * vy
        twist += lever * drag * vy - across * drag * vx
    return push, shove, twist


@absorbed_kernel
def _turn_wheel(state: Any, p: Any, k: DriveConstants, i: int) -> tuple[float, float]:
    """Return what a wheel brings along [N s], and what its motor driver draws [A]."""
    motor, spin = p.motor, state.spin[i]
    state.turned[i] += spin * p.dt  # as the body moves in this step: by its velocity before
    amperes = (state.duty[i] * state.voltage - motor.torque_constant * spin) * k.per_ohm
    amperes = min(motor.current_limit, max(-motor.current_limit, amperes))
    rim = spin * k.radii[i]
    # The sign of the speed, smooth about rest.
    rolling = k.rolling * k.radii[i] * (rim / math.sqrt(rim * rim + _CREEP * _CREEP))
    torque = p.gain * motor.torque_constant * amperes - rolling
    impulse = (torque * p.dt + WHEEL_INERTIA * spin) * k.per_radius[i]
    return impulse, state.duty[i] * amperes


@absorbed_kernel
def _slide(
    p: Any, k: DriveConstants, brings: tuple[float, float], ahead: float, aside: float,
    turning: float,
) -> tuple[float, float, float]:  # fmt: skip
    """Return the impulses [N s] of the left and right tyre along, and of both across, that slide.

    The velocities are those without them; Gauss-Seidel sweeps within the bounds of friction.
    """
    mass, moment, arm, half, bound = p.mass, p.moment, p.body.centre_of_mass, 0.5 * p.track, k.bound
    u, w, side_speed = ahead, turning, aside
    sl = (brings[0] * k.radii[0]) / WHEEL_INERTIA
    sr = (brings[1] * k.radii[1]) / WHEEL_INERTIA
    jl, jr, jy = 0.0, 0.0, 0.0
    gl, gr = k.inertia
    ease_l = 1.0 / (1.0 / mass + half * half / moment + 1.0 / gl)
    ease_r = 1.0 / (1.0 / mass + half * half / moment + 1.0 / gr)
    ease_y = 1.0 / (1.0 / mass + arm * arm / moment)
    for _ in range(_SWEEPS):
        change = -(u - half * w - k.radii[0] * sl) * ease_l
        change = min(bound, max(-bound, jl + change)) - jl
        jl += change
        u, w = u + change / mass, w - half * change / moment
        sl -= k.radii[0] * change / WHEEL_INERTIA
        change = -(u + half * w - k.radii[1] * sr) * ease_r
        change = min(bound, max(-bound, jr + change)) - jr
        jr += change
        u, w = u + change / mass, w + half * change / moment
        sr -= k.radii[1] * change / WHEEL_INERTIA
        left = max(0.0, bound * bound - jl * jl)
        right = max(0.0, bound * bound - jr * jr)
        maximum = math.sqrt(left) + math.sqrt(right)
        change = -(side_speed - arm * w) * ease_y
        change = min(maximum, max(-maximum, jy + change)) - jy
        jy += change
        side_speed, w = side_speed + change / mass, w - arm * change / moment
    return jl, jr, jy


@absorbed_kernel
def _drain_battery(state: Any, p: Any, drawn: float) -> None:
    """Take what drivers draw [A] from the battery: ideal choppers; braking gives a share back."""
    battery, power = p.battery, drawn * state.voltage
    power = (power if power > 0.0 else power * battery.regeneration) + battery.idle_power
    state.energy += power * p.dt
    state.charge = min(p.capacity, max(0.0, state.charge - power * p.dt))
    empty, full = battery.empty_voltage, battery.full_voltage
    rest = empty + (full - empty) * state.charge / p.capacity
    state.voltage = rest - BATTERY_RESISTANCE * power / rest


@borrowing_kernel
def pull_body(fields: Any, dt: float, x: float, y: float) -> None:
    """Accelerate a body (x, y) [m/s2] for the coming physics step.

    Munk2D moves a body by its speed before a step, and tyres react within the step: this part of
    the speed must not move it.
    """
    fields.vx += x * dt
    fields.x -= x * dt * dt
    fields.vy += y * dt
    fields.y -= y * dt * dt


@borrowing_kernel
def physics_step(
    state: Any, p: Any, k: DriveConstants, space: np.uint64, body: np.uint64, engine: np.uint64
) -> float:
    """One physics step: motors push, tyres hold, Munk2D moves.

    `space` is 0 where nothing is near enough to be touched in this step.

    Returns:
        The impulse of contact [N s]; 0, up to rounding, where nothing is touched.
    """
    fields = body_view(body)
    dt, mass, moment, arm = p.dt, p.mass, p.moment, p.body.centre_of_mass
    turning = fields.w
    middle = fields.angle + 1.5 * turning * dt  # heading half-way through the next step
    c, s = math.cos(middle), math.sin(middle)
    ahead, aside = world_to_body(c, s, fields.vx, fields.vy)
    push, shove, twist = _drag_of_casters(p, k, ahead, aside, turning)
    bring_left, drawn_left = _turn_wheel(state, p, k, 0)
    bring_right, drawn_right = _turn_wheel(state, p, k, 1)
    brings = (bring_left, bring_right)

    # Both wheels roll, the axle does not slide: two equations for speed and turn.
    half, bound = 0.5 * p.track, k.bound
    gl, gr = k.inertia
    a11, a12, a22 = k.matrix
    b1 = mass * ahead + bring_left + bring_right + push
    turned = half * (bring_right - bring_left)
    b2 = moment * turning + mass * arm * aside + turned + arm * shove + twist
    u, w = (b1 * a22 - a12 * b2) * k.per_det, (a11 * b2 - a12 * b1) * k.per_det
    jl = bring_left - gl * (u - half * w)
    jr = bring_right - gr * (u + half * w)
    jy = mass * (arm * w - aside) - shove
    if max(jl * jl, jr * jr) + 0.25 * jy * jy > bound * bound:
        jl, jr, jy = _slide(
            p, k, brings, ahead + push / mass, aside + shove / mass, turning + twist / moment
        )

    px, py = jl + jr + push, jy + shove
    fx, fy = body_to_world(c, s, px, py)
    fx, fy = fx / dt, fy / dt
    torque = (half * (jr - jl) - arm * jy + twist) / dt
    vx, vy = fields.vx, fields.vy
    fields.fx, fields.fy, fields.torque = fx, fy, torque
    if space == 0:
        move_freely(body, dt)
    else:
        step_space(engine, space, dt)
    hit_x = mass * (fields.vx - vx) - fx * dt
    hit_y = mass * (fields.vy - vy) - fy * dt
    hit_w = moment * (fields.w - turning) - torque * dt

    # Each wheel rolls at the ground speed that came out, as far as its tyre can hold it there.
    ahead = c * fields.vx + s * fields.vy
    state.distance += abs(ahead) * dt
    for i in range(2):
        ground = ahead + (2 * i - 1) * half * fields.w
        hold = brings[i] - k.inertia[i] * ground
        hold = min(bound, max(-bound, hold))
        state.spin[i] = (brings[i] - hold) * k.radii[i] / WHEEL_INERTIA
    _drain_battery(state, p, drawn_left + drawn_right)
    return float(math.sqrt(hit_x * hit_x + hit_y * hit_y) + abs(hit_w) / p.body.wheelbase)
