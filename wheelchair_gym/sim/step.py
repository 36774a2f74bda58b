"""One control period of one chair (`step_chair`): physics steps of all that moves, then sensing.

A batch of chairs loops over it.
"""

import math
from typing import Any

import numpy as np

from wheelchair_gym.actors.bodies import (
    apply_forces,
    copy_actor_shapes,
    relocate_obstacles,
    shapes_of,
    write_actor_shapes,
)
from wheelchair_gym.actors.doors import move_leaves, schedule_actors
from wheelchair_gym.actors.pedestrians import choose_velocities
from wheelchair_gym.actors.separation import choose_who_may_touch, move_the_others
from wheelchair_gym.actors.social_force import apply_social_forces
from wheelchair_gym.base.arrays import Array, Floats
from wheelchair_gym.compiled.address import (
    field_at,
    integers_at,
    prefetch,
    read_record,
    rows_of,
    table_at,
)
from wheelchair_gym.compiled.kernel import borrowing_kernel, check_written, inlined
from wheelchair_gym.engine import BODY_DOUBLES, body_view
from wheelchair_gym.geometry.planar import wrap
from wheelchair_gym.sensors.laser import WORKSPACE_ROWS, sense_laser
from wheelchair_gym.sensors.odometry import update_odometry, update_pose_estimate
from wheelchair_gym.sensors.ultrasonic import sense_ultrasonic
from wheelchair_gym.sim.contact import Motion, end_contacts, record_contacts, stop_people
from wheelchair_gym.sim.drive_train import (
    control_speed,
    drive_constants,
    physics_step,
    pull_body,
    ramp_set_point,
    update_explained_motion,
)
from wheelchair_gym.sim.fault_injection import apply_fault, draw_fault
from wheelchair_gym.sim.randomization import randomize_parameters
from wheelchair_gym.sim.state import PARAMETER, SENSED, STATE, SUITE, ranger_of, scanner_of
from wheelchair_gym.sim.world import WORLD, enter_world, measure_clearance, touchable_space

_TOUCH = 1e-6  # N s: smaller impulses are rounding


@borrowing_kernel
def read_true_state(state: Any, p: Any, fields: Any) -> None:
    """Read the true pose and twist of the axle's centre from the body."""
    angle = fields.angle
    c, s = math.cos(angle), math.sin(angle)
    state.pose[0] = fields.x - c * p.body.centre_of_mass
    state.pose[1] = fields.y - s * p.body.centre_of_mass
    state.pose[2] = angle
    state.twist[0] = c * fields.vx + s * fields.vy
    state.twist[1] = fields.w


@borrowing_kernel
def decide_actors(state: Any, p: Any, world: Any, chair: Motion) -> float:
    """Decide for the actors before a physics step, and apply the forces that then push them.

    Returns:
        The impulse [N s] of the person who walks into the chair the hardest.
    """
    read_true_state(state, p, body_view(world.body))
    if state.tick % p.decide_every == 0:
        write_actor_shapes(world)
        end_contacts(world, state, p)
        schedule_actors(world, p, state.pose, state.tick * p.dt)
        choose_velocities(world, p, state.key, state.tick, state.pose, state.twist)
    move_leaves(world, p, state.pose)
    apply_forces(world, p)
    if world.n_headed > 0:
        apply_social_forces(world, p, state.pose)
    return stop_people(world, state, p, chair)


@inlined
def prepare_step(
    engine: Any, world: Any, state: Any, p: Any, chair: Motion, workspace: Floats
) -> tuple[float, np.uint64]:
    """Decide for the actors before a physics step, and find the Space that it needs.

    After the step, `move_the_others` moves the actors that are not in the Space.

    Returns:
        The impulse [N s] of the person who walks into the chair the hardest; the Space, 0 if none.
    """
    bump, space = 0.0, touchable_space(engine, world, p, workspace)
    if world.n_actors > 0:
        bump = decide_actors(state, p, world, chair)
        relocate_obstacles(engine, world)
        if choose_who_may_touch(engine, world, state, p):
            space = np.uint64(world.space)
    return bump, space


@borrowing_kernel
def delayed_command(state: Any, p: Any, world: Any) -> tuple[float, float, bool]:
    """The command that takes effect now: twist, and whether it is a protective stop.

    It is one that the world has recorded; before the first, the chair is told to stand.
    """
    since = state.tick - p.delay
    if since < 0:
        return 0.0, 0.0, False
    command = table_at(world.drives, world.drives_capacity, 3)[since // p.substeps]
    return command[0], command[1], command[2] != 0.0


@borrowing_kernel
def drive_period(
    state: Any,
    p: Any,
    world: Any,
    engine: Any,
    v: float,
    w: float,
    protective: bool,
    order: Any,
    workspace: Floats,
) -> None:
    """Drive towards a target twist for one control period.

    Where commands take effect late, the twist is the one that the world recorded so long ago.
    """
    k = drive_constants(p)
    state.contact, state.bumped = False, False
    state.contact_recorded, state.at_fault, state.contact_with = False, False, -1
    state.approach_speed[0], state.approach_speed[1] = 0.0, 0.0
    fields = body_view(world.body)
    for _ in range(p.substeps):
        if state.tick % p.speed_every == 0:
            if p.delay > 0:
                v, w, protective = delayed_command(state, p, world)
            hard = protective or state.bumped
            ramp_set_point(state, p, v, w, hard, k.run)
            control_speed(state, p, k)
            update_explained_motion(state, p, k)
            if hard:  # what follows begins without a slope
                state.v_rate, state.w_rate = 0.0, 0.0
        before = (fields.x, fields.y, fields.vx, fields.vy, fields.w)
        bump, space = prepare_step(engine, world, state, p, before, workspace)
        if p.pull[0] != 0.0 or p.pull[1] != 0.0:
            pull_body(fields, p.dt, p.pull[0], p.pull[1])
        hit = physics_step(state, p, k, space, world.body, engine.step)
        state.tick += 1
        if world.n_actors > 0:
            move_the_others(world, p.dt)
        if bump > _TOUCH:
            state.contact = True
            state.bumped |= bump > p.body.bumper_force * p.dt
        if hit > _TOUCH:
            state.contact = True
            state.bumped |= hit > p.body.bumper_force * p.dt
            read_true_state(state, p, fields)
            write_actor_shapes(world)
            now = (fields.x, fields.y, before[2], before[3], before[4])
            record_contacts(world, state, p, now)
        if state.tick % p.fire_every == 0:
            read_true_state(state, p, fields)
            which = order[state.firings % order.shape[0]]
            state.fired[which] = state.tick
            for i in range(3):
                state.fire_pose[which, i] = state.pose[i]
            state.firings += 1
            if world.n_actors > 0:
                write_actor_shapes(world)
                copy_actor_shapes(world, which, True)
    read_true_state(state, p, fields)
    state.step += 1


JOULES_PER_WH = 3600.0

CHAIRS, CHAIRS_TARGETS = read_record("CHAIRS", globals())
_STATE_SIZE = STATE.itemsize
_PARAMETER_SIZE = dict(PARAMETER.fields or {})["slope"][1]  # bytes that are read in each step
_suites_at, _parameters_at, _states_at, _worlds_at = map(rows_of, (SUITE, PARAMETER, STATE, WORLD))


@inlined
def chair_row(chairs: Any, i: int) -> Any:
    """The records of row i: sensor suite, parameters, state and world."""
    rows = chairs[0]
    return (
        _suites_at(rows.suite, 1)[0],
        _parameters_at(rows.parameters, rows.n)[i],
        _states_at(rows.states, rows.n)[i],
        _worlds_at(rows.worlds, rows.n)[i],
    )


@borrowing_kernel
def prefetch_chair(i: int, chairs: Any) -> None:
    """Prefetch the data of row i while something else is computed."""
    rows = chairs[0]
    world = _worlds_at(rows.worlds, rows.n)[i]
    prefetch(world.walls, world.n_walls * 32)
    prefetch(world.discs, world.n_discs * 24)
    prefetch(world.body, 8 * BODY_DOUBLES)
    prefetch(rows.states + np.uint64(i * _STATE_SIZE), _STATE_SIZE)
    prefetch(rows.parameters + np.uint64(i * _PARAMETER_SIZE), _PARAMETER_SIZE)


@inlined
def workspace_of(chairs: Any) -> Floats:
    """Return the workspace in which scans are computed (WORKSPACE_ROWS, columns)."""
    return field_at(chairs[0].workspace, WORKSPACE_ROWS, chairs[0].columns)


@borrowing_kernel
def write_sensed(state: Any, p: Any, world: Any, rangers: int, sensed: Any) -> None:
    """Write what was sensed, except the scans, and how things really are.

    Columns of ultrasonics beyond the mounted ones are invalid (NaN), and their age is infinite.
    """
    for i in range(3):
        sensed.pose[i] = state.estimated_pose[i]
        sensed.true_pose[i] = state.pose[i]
    sensed.true_pose[2] = wrap(state.pose[2])
    for i in range(2):
        sensed.twist[i] = state.measured_twist[i]
        sensed.true_twist[i] = state.twist[i]
    for i in range(rangers):
        sensed.ultrasonic[i] = state.ranges[i]
        sensed.age[i] = (state.tick - state.fired[i]) * p.dt
    for i in range(rangers, state.ranges.shape[0]):
        sensed.ultrasonic[i], sensed.age[i] = math.nan, math.inf
    sensed.bumped, sensed.contact = state.bumped, state.contact
    state.touched |= state.contact
    sensed.touched = state.touched
    sensed.battery, sensed.stamp = state.voltage, state.tick * p.dt
    sensed.at_fault, sensed.contact_with = state.at_fault, state.contact_with
    sensed.approach_speed = state.approach_speed[0]
    sensed.other_approach_speed = state.approach_speed[1]
    sensed.distance, sensed.energy = state.distance, state.energy / JOULES_PER_WH
    sensed.clearance = world.clearance


check_written("signal", SENSED.names or (), write_sensed)


@borrowing_kernel
def sense(
    suite: Any,
    p: Any,
    state: Any,
    world: Any,
    fired_after: int,
    workspace: Floats,
    ranges: Floats,
    sensed: Any,
) -> None:
    """Range the ultrasonics that fired after a tick, scan now, and write reading and truth.

    An ultrasonic ranges from the pose, and among the actors, of the moment when it fired.
    `ranges` (beams,) [m] holds the scan of each scanner, one after another. Shapes of actors are
    left at their present places.
    """
    walls, discs = shapes_of(world)
    for which in range(suite.rangers):
        fired = state.fired[which]
        if fired > fired_after:
            if fired > 0 and world.n_actors > 0:
                copy_actor_shapes(world, which, False)
            place = state.fire_pose[which]
            state.ranges[which] = sense_ultrasonic(
                ranger_of(suite, which), p.ranger_sigma[which], place, walls, discs, state.key,
                fired, workspace,
            )  # fmt: skip
    if world.n_actors > 0:
        write_actor_shapes(world)
    for k in range(suite.n_scanners):
        laser = scanner_of(suite, p, k)
        scan = ranges[laser.start : laser.start + laser.cosine.shape[0]]
        sense_laser(laser, state.pose, walls, discs, state.key, state.step, workspace, scan)
    measure_clearance(state, p, world, workspace)
    write_sensed(state, p, world, suite.rangers, sensed)
    apply_fault(state, p, suite, world.past_scans, ranges, sensed)


@borrowing_kernel
def place_chair(i: int, chairs: Any, start: Array, key: np.uint64) -> None:
    """Put row i at a start in its world; it has sensed nothing yet."""
    rows = chairs[0]
    _parameters_at(rows.parameters, rows.n)[i] = _parameters_at(rows.base, 1)[0]
    _states_at(rows.states, rows.n)[i] = _states_at(rows.blank, 1)[0]
    suite, p, state, world = chair_row(chairs, i)
    randomize_parameters(p, key)
    enter_world(suite, world, p, start[0], start[1], start[2], workspace_of(chairs))
    state.key, state.contact_with = key, -1
    draw_fault(state, p, suite)
    empty, full, charge = p.battery.empty_voltage, p.battery.full_voltage, p.battery.initial_charge
    state.charge, state.voltage = charge * p.capacity, empty + (full - empty) * charge
    read_true_state(state, p, body_view(world.body))
    for k in range(3):
        state.odometry[k] = state.pose[k]
    update_pose_estimate(state, p, 0.0)
    order = integers_at(suite.order, suite.rangers)
    # The rangers have been firing in turn all along, from this very place.
    n = order.shape[0]
    for turn in range(n):
        which = order[turn]
        state.fired[which] = (turn + 1 - n) * p.fire_every
        for k in range(3):
            state.fire_pose[which, k] = state.pose[k]


@borrowing_kernel
def reset_chair(
    i: int, chairs: Any, start: Array, key: np.uint64, ranges: Floats, sensed: Any
) -> None:
    """Put row i at a start in its world and take the first reading."""
    place_chair(i, chairs, start, key)
    suite, p, state, world = chair_row(chairs, i)
    fired_after = -suite.rangers * p.fire_every
    sense(suite, p, state, world, fired_after, workspace_of(chairs), ranges, sensed[i])


@borrowing_kernel
def replay_drives(i: int, chairs: Any, start: Array, key: np.uint64, periods: int) -> None:
    """Bring row i where the drives that its world has recorded lead, from the start on.

    Physics alone: what a chair senses has no effect on what is driven.
    """
    place_chair(i, chairs, start, key)
    suite, p, state, world = chair_row(chairs, i)
    order = integers_at(suite.order, suite.rangers)
    drives = table_at(world.drives, periods, 3)
    measure_clearance(state, p, world, workspace_of(chairs))
    for k in range(periods):
        stop = drives[k, 2] != 0.0
        drive_period(
            state, p, world, suite, drives[k, 0], drives[k, 1], stop, order, workspace_of(chairs)
        )
        if world.n_actors > 0:  # as `sense` leaves the world
            write_actor_shapes(world)
        measure_clearance(state, p, world, workspace_of(chairs))


@borrowing_kernel
def step_chair(
    i: int, chairs: Any, v: float, w: float, protective: bool, ranges: Floats, sensed: Any
) -> None:
    """Drive row i towards a twist (v, w) [m/s, rad/s] for one control period, then sense.

    The other arguments are those of `drive_period` and `reset_chair`.
    """
    suite, p, state, world = chair_row(chairs, i)
    before = state.tick
    order = integers_at(suite.order, suite.rangers)
    if state.step < world.drives_capacity:
        record = table_at(world.drives, world.drives_capacity, 3)[state.step]
        record[0], record[1], record[2] = v, w, 1.0 if protective else 0.0
    drive_period(state, p, world, suite, v, w, protective, order, workspace_of(chairs))
    update_odometry(state, p)
    sense(suite, p, state, world, before, workspace_of(chairs), ranges, sensed[i])
