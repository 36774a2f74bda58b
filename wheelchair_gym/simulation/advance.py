"""One control period of one chair: drive, then sense. What a batch of chairs loops over."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.address import doubles_at, table_at
from wheelchair_gym.geometry import footprint_clearance, wrap
from wheelchair_gym.kernel import borrowing_kernel
from wheelchair_gym.sensing.laser import scan
from wheelchair_gym.sensing.odometry import locate_self, reckon
from wheelchair_gym.sensing.ultrasonic import UltrasonicArrays, fire
from wheelchair_gym.simulation.engine import BODY_DOUBLES
from wheelchair_gym.simulation.motion import drive, locate
from wheelchair_gym.simulation.rig import laser_of, rangers_of
from wheelchair_gym.simulation.state import vary
from wheelchair_gym.simulation.world import enter

Array = NDArray[np.float64]
Floats = NDArray[np.float32]

CLEARANCE_REACH = 2.0  # m: clearances beyond this are reported as this
JOULES_PER_WH = 3600.0


@borrowing_kernel
def hear(
    state: Any, fired_after: int, rangers: UltrasonicArrays, walls: Array, discs: Array
) -> None:
    """Range the ultrasonics that fired after a tick, each from where it stood then."""
    n = rangers.order.shape[0]
    for which in range(n):
        if state.fired[which] > fired_after:
            state.ranges[which] = fire(
                rangers,
                which,
                state.fire_pose[which],
                walls,
                discs,
                state.key,
                state.fired[which],
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
    sensed.way, sensed.energy = state.way, state.energy / JOULES_PER_WH
    sensed.clearance = footprint_clearance(
        state.pose[0], state.pose[1], state.pose[2], p.outline, walls, discs, CLEARANCE_REACH
    )


@borrowing_kernel
def begin(
    rig: Any,
    p: Any,
    state: Any,
    world: Any,
    start: Array,
    key: np.uint64,
    scratch: Floats,
    ranges: Floats,
    sensed: Any,
) -> None:
    """Stand at a start in a world, and take the first reading.

    Args:
        rig: record of RIG.
        p: record of PARAMETER, as the settings give it; what is random is drawn here.
        state: record of STATE, zero.
        world: record of WORLD; walls and discs are this episode's.
        start: (3,) [m, m, rad].
        key: of the episode's randomness.
        scratch: room for the laser to work in.
        ranges: (beams,) the scan [m].
        sensed: record of SENSED.
    """
    vary(p, key)
    enter(rig, world, p, start[0], start[1], start[2])
    state.key = key
    state.charge = p.charge * p.capacity
    state.voltage = p.empty + (p.full - p.empty) * p.charge
    locate(state, p, doubles_at(world.body, BODY_DOUBLES))
    for i in range(3):
        state.odometry[i] = state.pose[i]
    locate_self(state, p, 0.0)
    walls = table_at(world.walls, world.n_walls, 4)
    discs = table_at(world.discs, world.n_discs, 3)
    rangers = rangers_of(rig)
    # The rangers have been firing in turn all along, from this very place.
    n = rangers.order.shape[0]
    for k in range(n):
        which = rangers.order[k]
        state.fired[which] = (k + 1 - n) * p.fire_every
        for i in range(3):
            state.fire_pose[which, i] = state.pose[i]
    hear(state, -n * p.fire_every, rangers, walls, discs)
    scan(laser_of(rig), state.pose, walls, discs, key, 0, ranges)
    tell(state, p, walls, discs, sensed)


@borrowing_kernel
def advance(
    rig: Any,
    p: Any,
    state: Any,
    world: Any,
    v: float,
    w: float,
    scratch: Floats,
    ranges: Floats,
    sensed: Any,
) -> None:
    """One control period towards a target twist (v, w) [m/s, rad/s], then one reading.

    The other arguments are those of `begin`.
    """
    before = state.tick
    rangers = rangers_of(rig)
    drive(state, p, world.space, world.body, rig.step, v, w, rangers.order)
    reckon(state, p)
    walls = table_at(world.walls, world.n_walls, 4)
    discs = table_at(world.discs, world.n_discs, 3)
    hear(state, before, rangers, walls, discs)
    scan(laser_of(rig), state.pose, walls, discs, state.key, state.step, ranges)
    tell(state, p, walls, discs, sensed)


@borrowing_kernel
def begin_row(
    rigs: Any,
    base: Any,
    chairs: Any,
    states: Any,
    blank: Any,
    worlds: Any,
    start: Array,
    key: np.uint64,
    scratch: Floats,
    ranges: Floats,
    sensed: Any,
) -> None:
    """`begin` for the only row of each array; `base` and `blank` are what it starts from."""
    chairs[0], states[0] = base[0], blank[0]
    begin(rigs[0], chairs[0], states[0], worlds[0], start, key, scratch, ranges, sensed[0])


@borrowing_kernel
def advance_row(
    rigs: Any,
    chairs: Any,
    states: Any,
    worlds: Any,
    v: float,
    w: float,
    scratch: Floats,
    ranges: Floats,
    sensed: Any,
) -> None:
    """`advance` for the only row of each array."""
    advance(rigs[0], chairs[0], states[0], worlds[0], v, w, scratch, ranges, sensed[0])
