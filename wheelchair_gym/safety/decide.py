"""Decisions: how much of a twist may be driven."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.compiled.kernel import borrowing_kernel
from wheelchair_gym.kinematics import SOONER, approach, brake
from wheelchair_gym.safety.state import FAR, NOTHING, STANDS
from wheelchair_gym.safety.sweep import check_trajectory, needs_protective_stop

Array = NDArray[np.float64]

_HALVINGS = 5  # of the share that is driven: to 3 %
_COARSE = 4  # the same for who plans, of many twists at once
_FINE = 0.01  # s: step of the set point's model, as boards run it at 100 Hz


@borrowing_kernel
def _share(g: Any, s: Any, v: float, w: float) -> tuple[float, int]:
    """How much of a twist may be driven, and why not more."""
    if v == 0.0 and w == 0.0 and s.set[0] == 0.0 and s.set[2] == 0.0:
        return 1.0, NOTHING
    reason = check_trajectory(g, s, v, w)
    if reason == NOTHING:
        return 1.0, reason
    low, high = 0.0, 1.0
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        if check_trajectory(g, s, middle * v, middle * w) == NOTHING:
            low = middle
        else:
            high = middle
    return low, reason


@borrowing_kernel
def limit_for_unseen_space(g: Any, s: Any, motion: Array, twists: Array) -> None:
    """Slow twists (n, 2) to what may be taken up and may last, by the rule of the unseen alone.

    Args:
        g: record of GUARD.
        s: record of SHIELD, which has taken in the latest reading.
        motion: speed, its slope, turn, its slope (4,) of the chair now.
        twists: [m/s, rad/s]; written to.
    """
    known = s.n_near, s.n_moving, s.n_close, s.gap
    a, b, c, d = s.set[0], s.set[1], s.set[2], s.set[3]
    late_v, late_w = s.late[0], s.late[1]
    s.n_near, s.n_moving, s.n_close, s.gap = 0, 0, 0, FAR
    for k in range(twists.shape[0]):
        v, w = twists[k, 0], twists[k, 1]
        low, high, share = 0.0, 1.0, 1.0
        for _ in range(_COARSE + 1):
            for i in range(4):
                s.set[i] = motion[i]
            s.late[0], s.late[1] = motion[0], motion[2]
            good = check_trajectory(g, s, share * v, share * w) == NOTHING
            if good:  # and once the chair drives like that
                s.set[0], s.set[1], s.set[2], s.set[3] = share * v, 0.0, share * w, 0.0
                s.late[0], s.late[1] = share * v, share * w
                good = check_trajectory(g, s, share * v, share * w) == NOTHING
            if good:
                low = share
            else:
                high = share
            if low == 1.0:
                break
            share = 0.5 * (low + high)
        twists[k, 0], twists[k, 1] = low * v, low * w
    s.n_near, s.n_moving, s.n_close, s.gap = known
    s.set[0], s.set[1], s.set[2], s.set[3] = a, b, c, d
    s.late[0], s.late[1] = late_v, late_w


@borrowing_kernel
def delay_setpoint(g: Any, s: Any, dt: float) -> None:
    """What the wheels do follows what they are set to."""
    share = dt / (g.reaction_time + dt)
    s.late[0] += share * (s.set[0] - s.late[0])
    s.late[1] += share * (s.set[2] - s.late[1])


@borrowing_kernel
def decide(g: Any, s: Any, v: float, w: float) -> tuple[float, float, bool]:
    """What may be driven of a twist (v, w) [m/s, rad/s] during the coming period.

    Returns:
        The twist, and whether the chair is to make a protective stop instead: it does for a fault,
        and where it may no longer brake in comfort.
    """
    limits = g.limits[:]
    v = min(limits[0], max(-limits[1], v))
    w = min(limits[2], max(-limits[2], w))
    s.asked[0], s.asked[1] = v, w
    s.rearmed = s.rearmed and s.latched != NOTHING
    share, reason = 0.0, s.latched
    if reason == NOTHING:
        share, reason = _share(g, s, v, w)
    v, w = share * v, share * w
    s.protective = s.latched != NOTHING or (share == 0.0 and needs_protective_stop(g, s))
    s.reason, s.given[0], s.given[1] = reason, v, w
    if s.rearmed and abs(s.set[0]) + abs(s.set[2]) < STANDS:  # it stands a period more
        s.latched, s.rearmed = NOTHING, False
    if s.protective:
        s.set[0], s.set[2] = brake(s.set[0], s.set[2], SOONER * limits[5] * g.period, g.track)
        s.set[1], s.set[3] = 0.0, 0.0
        delay_setpoint(g, s, g.period)
        return 0.0, 0.0, True
    n = max(1, round(g.period / _FINE))
    dt = g.period / n
    for _ in range(n):
        s.set[0], s.set[1] = approach(s.set[0], s.set[1], v, limits[3], limits[4], limits[7], dt)
        s.set[2], s.set[3] = approach(s.set[2], s.set[3], w, limits[6], limits[6], limits[8], dt)
        delay_setpoint(g, s, dt)
    return v, w, False
