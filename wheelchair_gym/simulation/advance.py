"""One control period of one chair: drive, then sense. What a batch of chairs loops over."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.kernel import kernel
from wheelchair_gym.sensing.laser import LaserArrays, scan
from wheelchair_gym.sensing.odometry import locate_self, reckon
from wheelchair_gym.sensing.ultrasonic import UltrasonicArrays, fire
from wheelchair_gym.simulation.engine import body_view
from wheelchair_gym.simulation.motion import drive, locate

Array = NDArray[np.float64]
Floats = NDArray[np.float32]


@kernel
def hear(
    state: Any,
    fired_after: int,
    rangers: UltrasonicArrays,
    walls: Array,
    discs: Array,
    scratch: Floats,
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
                scratch,
            )


@kernel
def begin(
    states: Any,
    parameters: Any,
    body: np.uint64,
    key: np.uint64,
    charge: float,
    laser: LaserArrays,
    rangers: UltrasonicArrays,
    walls: Array,
    discs: Array,
    scratch: Floats,
    out: Floats,
) -> None:
    """Set up the state of a chair that stands at its start, and take its first reading.

    Args:
        states: (1,) record, zero.
        parameters: (1,) record.
        body: address of the cpBody, at the start.
        key: of the episode's randomness.
        charge: of the battery, share.
        laser: the laser.
        rangers: the ultrasonics.
        walls: (n, 4) [m].
        discs: (m, 3) [m].
        scratch: (SCRATCH, n or more), overwritten.
        out: (beams,) the scan [m].
    """
    state, p = states[0], parameters[0]
    state.key = key
    state.charge = charge * p.capacity
    state.voltage = p.empty + (p.full - p.empty) * charge
    locate(state, p, body_view(body))
    for i in range(3):
        state.odometry[i] = state.pose[i]
    locate_self(state, p, 0.0)
    # The rangers have been firing in turn all along, from this very place.
    n = rangers.order.shape[0]
    for k in range(n):
        which = rangers.order[k]
        state.fired[which] = (k + 1 - n) * p.fire_every
        state.fire_pose[which, :] = state.pose
    hear(state, -n * p.fire_every, rangers, walls, discs, scratch)
    scan(laser, state.pose, walls, discs, state.key, state.step, scratch, out)


@kernel
def advance(
    states: Any,
    parameters: Any,
    space: np.uint64,
    body: np.uint64,
    engine: np.uint64,
    v: float,
    w: float,
    laser: LaserArrays,
    rangers: UltrasonicArrays,
    walls: Array,
    discs: Array,
    scratch: Floats,
    out: Floats,
) -> None:
    """One control period towards a target twist (v, w) [m/s, rad/s], then one reading.

    The arguments are those of `begin`; `space`, `body` and `engine` are addresses.
    """
    state, p = states[0], parameters[0]
    before = state.tick
    drive(state, p, space, body, engine, v, w, rangers.order)
    reckon(state, p)
    hear(state, before, rangers, walls, discs, scratch)
    scan(laser, state.pose, walls, discs, state.key, state.step, scratch, out)
