"""One control period: physics steps of the chair, and of all that moves beside it."""

from __future__ import annotations

import math
from typing import Any

from wheelchair_gym.kernel import borrowing_kernel
from wheelchair_gym.simulation.contact import (
    Motion,
    forget_contacts,
    note_contacts,
    stop_people,
)
from wheelchair_gym.simulation.doors import keep_times, turn_leaves
from wheelchair_gym.simulation.engine import ANGLE, VX, VY, W, X, Y, body_view
from wheelchair_gym.simulation.motion import (
    control_speed,
    explain,
    step_once,
    track_set_point,
    work_out,
)
from wheelchair_gym.simulation.moving import carry, follow, push
from wheelchair_gym.simulation.people import walk
from wheelchair_gym.simulation.shown import show, take_shot

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
