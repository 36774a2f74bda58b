"""One control period of one chair: physics steps of all that moves, then sensing (`advance`).

A batch of chairs loops over it.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.compiled.address import doubles_at, field_at, integers_at, rows_of, table_at
from wheelchair_gym.compiled.kernel import borrowing_kernel
from wheelchair_gym.geometry import footprint_clearance, wrap
from wheelchair_gym.physics.actors.bodies import carry, follow, push
from wheelchair_gym.physics.actors.doors import keep_times, turn_leaves
from wheelchair_gym.physics.actors.people import walk
from wheelchair_gym.physics.actors.shapes import show, show_shot, take_shot
from wheelchair_gym.physics.contact import Motion, forget_contacts, note_contacts, stop_people
from wheelchair_gym.physics.drive_train import (
    control_speed,
    explain,
    step_once,
    track_set_point,
    work_out,
)
from wheelchair_gym.physics.engine import ANGLE, BODY_DOUBLES, VX, VY, W, X, Y, body_view
from wheelchair_gym.physics.fault_injection import draw_fault, fail
from wheelchair_gym.physics.rig import RIG, laser_of, rangers_of
from wheelchair_gym.physics.state import PARAMETER, STATE, vary
from wheelchair_gym.physics.world import WORLD, enter
from wheelchair_gym.sensors.laser import SCRATCH, scan
from wheelchair_gym.sensors.odometry import locate_self, reckon
from wheelchair_gym.sensors.ultrasonic import UltrasonicArrays, fire

_TOUCH = 1e-6  # N s: smaller impulses are rounding


@borrowing_kernel
def locate(state: Any, p: Any, fields: Any) -> None:
    """Read the true pose and twist of the axle's centre from the body."""
    angle = fields[ANGLE]
    c, s = math.cos(angle), math.sin(angle)
    state.pose[0] = fields[X] - c * p.centre
    state.pose[1] = fields[Y] - s * p.centre
    state.pose[2] = angle
    state.twist[0] = c * fields[VX] + s * fields[VY]
    state.twist[1] = fields[W]


@borrowing_kernel
def move_on(state: Any, p: Any, world: Any, chair: Motion) -> float:
    """What movers decide before a physics step, and what then pushes them.

    Args:
        state: of the chair.
        p: its parameters.
        world: record of WORLD.
        chair: its motion.

    Returns:
        The impulse [N s] of the hardest who walks into the chair.
    """
    locate(state, p, body_view(world.body))
    if state.tick % p.choose_every == 0:
        show(world)
        forget_contacts(world, state, p)
        keep_times(world, p, state.pose, state.tick * p.dt)
        walk(world, p, state.key, state.tick, state.pose, state.twist)
    turn_leaves(world, p, state.pose)
    push(world, p)
    return stop_people(world, state, p, chair)


@borrowing_kernel
def drive(
    state: Any,
    p: Any,
    world: Any,
    engine: Any,
    v: float,
    w: float,
    protective: bool,
    order: Any,
) -> None:
    """Drive towards a target twist for one control period.

    Args:
        state: of the chair; its truth, set point, wheels and battery move on.
        p: its parameters.
        world: record of WORLD; its movers move on.
        engine: record with the fields of ENGINE.
        v: target speed [m/s].
        w: target turn [rad/s].
        protective: come to rest as in an emergency, whatever the target.
        order: (n,) which ranger fires k-th.
    """
    k = work_out(p)
    state.contact, state.bumped = False, False
    state.noted, state.caused, state.met = False, False, -1
    state.closing[0], state.closing[1] = 0.0, 0.0
    fields = body_view(world.body)
    for _ in range(p.substeps):
        if state.tick % p.speed_every == 0:
            hard = protective or state.bumped
            track_set_point(state, p, v, w, hard, k.run)
            control_speed(state, p, k)
            explain(state, p, k)
            if hard:  # what follows begins without a slope
                state.v_rate, state.w_rate = 0.0, 0.0
        before = (fields[X], fields[Y], fields[VX], fields[VY], fields[W])
        bump = 0.0
        if world.n_movers > 0:
            bump = move_on(state, p, world, before)
            carry(engine, world)
        hit = step_once(state, p, k, world.space, world.body, engine.step)
        state.tick += 1
        if world.n_movers > 0:
            follow(world)
        if bump > _TOUCH:
            state.contact = True
            state.bumped |= bump > p.bumper * p.dt
        if hit > _TOUCH:
            state.contact = True
            state.bumped |= hit > p.bumper * p.dt
            locate(state, p, fields)
            show(world)
            now = (fields[X], fields[Y], before[2], before[3], before[4])
            note_contacts(world, state, p, now)
        if state.tick % p.fire_every == 0:
            locate(state, p, fields)
            which = order[state.firings % order.shape[0]]
            state.fired[which] = state.tick
            for i in range(3):
                state.fire_pose[which, i] = state.pose[i]
            state.firings += 1
            if world.n_movers > 0:
                take_shot(world, which)
    locate(state, p, fields)
    state.step += 1


Array = NDArray[np.float64]
Floats = NDArray[np.float32]

CLEARANCE_REACH = 2.0  # m: clearances beyond this are reported as this
JOULES_PER_WH = 3600.0

# Where the only row of each argument of `advance` lies: a call takes a microsecond per array.
ALONE = np.dtype(
    [
        ("rig", "u8"),
        ("chair", "u8"),
        ("state", "u8"),
        ("world", "u8"),
        ("scratch", "u8"),
        ("walls", "i8"),  # columns of scratch
    ]
)
_rigs_at, _chairs_at, _states_at, _worlds_at = map(rows_of, (RIG, PARAMETER, STATE, WORLD))


@borrowing_kernel
def hear(
    state: Any,
    fired_after: int,
    rangers: UltrasonicArrays,
    world: Any,
    scratch: Floats,
) -> None:
    """Range the ultrasonics that fired after a tick, each in the world as it stood then."""
    walls = table_at(world.walls, world.n_walls, 4)
    discs = table_at(world.discs, world.n_discs, 3)
    n = rangers.order.shape[0]
    for which in range(n):
        if state.fired[which] > fired_after:
            if state.fired[which] > 0 and world.n_movers > 0:
                show_shot(world, which)
            state.ranges[which] = fire(
                rangers,
                which,
                state.fire_pose[which],
                walls,
                discs,
                state.key,
                state.fired[which],
                scratch,
            )


@borrowing_kernel
def tell(state: Any, p: Any, walls: Array, discs: Array, sensed: Any) -> None:
    """Write what was sensed, but for the scan, and how things really are."""
    for i in range(3):
        sensed.pose[i] = state.seen_pose[i]
        sensed.true_pose[i] = state.pose[i]
    sensed.true_pose[2] = wrap(state.pose[2])
    for i in range(2):
        sensed.twist[i] = state.seen_twist[i]
        sensed.true_twist[i] = state.twist[i]
    for i in range(state.ranges.shape[0]):
        sensed.ultrasonic[i] = state.ranges[i]
        sensed.age[i] = (state.tick - state.fired[i]) * p.dt
    sensed.bumped, sensed.contact = state.bumped, state.contact
    state.touched |= state.contact
    sensed.touched = state.touched
    sensed.battery, sensed.stamp = state.voltage, state.tick * p.dt
    sensed.caused, sensed.met = state.caused, state.met
    sensed.closing, sensed.closed_on = state.closing[0], state.closing[1]
    sensed.way, sensed.energy = state.way, state.energy / JOULES_PER_WH
    sensed.clearance = footprint_clearance(
        state.pose[0], state.pose[1], state.pose[2], p.outline[:], walls, discs, CLEARANCE_REACH
    )


@borrowing_kernel
def sense(
    rig: Any,
    p: Any,
    state: Any,
    world: Any,
    fired_after: int,
    scratch: Floats,
    ranges: Floats,
    sensed: Any,
) -> None:
    """Scan, range the ultrasonics that fired after a tick, and tell."""
    walls = table_at(world.walls, world.n_walls, 4)
    discs = table_at(world.discs, world.n_discs, 3)
    hear(state, fired_after, rangers_of(rig), world, scratch)
    if world.n_movers > 0:
        show(world)
    scan(laser_of(rig), state.pose, walls, discs, state.key, state.step, scratch, ranges)
    tell(state, p, walls, discs, sensed)
    fail(state, p, world.kept, ranges, sensed)


@borrowing_kernel
def stand(
    i: int,
    rigs: Any,
    base: Any,
    blank: Any,
    chairs: Any,
    states: Any,
    worlds: Any,
    start: Array,
    key: np.uint64,
) -> None:
    """Row i stands at a start in its world, and has sensed nothing yet; see `begin`."""
    chairs[i], states[i] = base[0], blank[0]
    rig, p, state, world = rigs[0], chairs[i], states[i], worlds[i]
    vary(p, key)
    enter(rig, world, p, start[0], start[1], start[2])
    state.key, state.met = key, -1
    draw_fault(state, p)
    state.charge = p.charge * p.capacity
    state.voltage = p.empty + (p.full - p.empty) * p.charge
    locate(state, p, doubles_at(world.body, BODY_DOUBLES))
    for k in range(3):
        state.odometry[k] = state.pose[k]
    locate_self(state, p, 0.0)
    order = integers_at(rig.order, rig.rangers)
    # The rangers have been firing in turn all along, from this very place.
    n = order.shape[0]
    for turn in range(n):
        which = order[turn]
        state.fired[which] = (turn + 1 - n) * p.fire_every
        for k in range(3):
            state.fire_pose[which, k] = state.pose[k]


@borrowing_kernel
def begin(
    i: int,
    rigs: Any,
    base: Any,
    blank: Any,
    chairs: Any,
    states: Any,
    worlds: Any,
    start: Array,
    key: np.uint64,
    scratch: Floats,
    ranges: Floats,
    sensed: Any,
) -> None:
    """Row i stands at a start in its world, and takes the first reading.

    Args:
        i: row.
        rigs: (1,) of RIG.
        base: (1,) of PARAMETER, as the settings give it; what is random is drawn here.
        blank: (1,) of STATE, zero.
        chairs: (n,) of PARAMETER.
        states: (n,) of STATE.
        worlds: (n,) of WORLD; walls, discs and movers are this episode's.
        start: (3,) [m, m, rad].
        key: of the episode's randomness.
        scratch: (SCRATCH, walls or more), overwritten.
        ranges: (beams,) the scan [m].
        sensed: (n,) of SENSED.
    """
    stand(i, rigs, base, blank, chairs, states, worlds, start, key)
    rig, p, state, world = rigs[0], chairs[i], states[i], worlds[i]
    sense(rig, p, state, world, -rig.rangers * p.fire_every, scratch, ranges, sensed[i])


@borrowing_kernel
def drive_again(
    i: int,
    rigs: Any,
    base: Any,
    blank: Any,
    chairs: Any,
    states: Any,
    worlds: Any,
    start: Array,
    key: np.uint64,
    periods: int,
) -> None:
    """Bring row i where the drives that its world has recorded lead, from the start on.

    Physics alone: what a chair senses has no effect on what is driven.
    """
    stand(i, rigs, base, blank, chairs, states, worlds, start, key)
    rig, p, state, world = rigs[0], chairs[i], states[i], worlds[i]
    order = integers_at(rig.order, rig.rangers)
    drives = table_at(world.drives, periods, 3)
    for k in range(periods):
        stop = drives[k, 2] != 0.0
        drive(state, p, world, rig, drives[k, 0], drives[k, 1], stop, order)
        if world.n_movers > 0:  # as `sense` leaves the world
            show(world)


@borrowing_kernel
def advance(
    i: int,
    rigs: Any,
    chairs: Any,
    states: Any,
    worlds: Any,
    v: float,
    w: float,
    protective: bool,
    scratch: Floats,
    ranges: Floats,
    sensed: Any,
) -> None:
    """One control period of row i towards a target twist (v, w) [m/s, rad/s], then one reading.

    The other arguments are those of `drive` and `begin`.
    """
    rig, p, state, world = rigs[0], chairs[i], states[i], worlds[i]
    before = state.tick
    order = integers_at(rig.order, rig.rangers)
    if state.step < world.drives_room:
        record = table_at(world.drives, world.drives_room, 3)[state.step]
        record[0], record[1], record[2] = v, w, 1.0 if protective else 0.0
    drive(state, p, world, rig, v, w, protective, order)
    reckon(state, p)
    sense(rig, p, state, world, before, scratch, ranges, sensed[i])


@borrowing_kernel
def advance_alone(
    alone: Any, v: float, w: float, protective: bool, ranges: Floats, sensed: Any
) -> None:
    """`advance` of a chair that is alone; its rows are found by address: alone (1,) of ALONE."""
    own = alone[0]
    advance(
        0,
        _rigs_at(own.rig, 1),
        _chairs_at(own.chair, 1),
        _states_at(own.state, 1),
        _worlds_at(own.world, 1),
        v,
        w,
        protective,
        field_at(own.scratch, SCRATCH, own.walls),
        ranges,
        sensed,
    )
