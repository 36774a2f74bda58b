"""Twists near the stick's, and how far the chair's outline could follow each of them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from agents.assistance.assistant import AssistInput, AssistMission, Twist
from wheelchair_gym.compiled.kernel import borrowing_kernel
from wheelchair_gym.geometry import signed_gap
from wheelchair_gym.kinematics import arc_step

Array = NDArray[np.float64]

SPEEDS, TURNS = 9, 15  # of a fan
STEP, STEPS = 0.1, 20  # s between two poses of an arc, and how many
CLEAR = 0.5  # m: a larger clearance counts as this


@borrowing_kernel
def follow_arc(
    points: Array, outline: Array, v: float, w: float, step: float, steps: int, margin: float
) -> tuple[int, float]:
    """How far the outline can follow a twist among points (n, 2) [m].

    Returns:
        How many steps [s] keep the margin [m], or come no nearer than the chair is, and the least
        clearance [m] on them, at most `CLEAR`.
    """
    n = points.shape[0]
    least, clear = signed_gap(points, n, outline, 0.0, 0.0, 0.0), CLEAR
    for k in range(steps):
        x, y, yaw = arc_step(0.0, 0.0, 0.0, v, w, step * (k + 1))
        gap = signed_gap(points, n, outline, x, y, yaw)
        if gap < margin and gap < least:
            return k, clear
        least, clear = min(margin, gap), min(clear, gap)
    return steps, clear


def free_share(
    mission: AssistMission, now: AssistInput, twist: Twist, time: float, step: float = STEP
) -> float:
    """Share of a time [s] for which the chair could follow a twist, tested in steps [s]."""
    steps = max(1, round(time / step))
    outline = mission.chair.footprint.array
    free, _ = follow_arc(now.points, outline, *twist, step, steps, now.margin)
    return float(free / steps)


@borrowing_kernel
def _fan(
    points: Array, outline: Array, asked: Array, turn: float, margin: float, deceleration: float,
    period: float, out: Array,
) -> int:  # fmt: skip
    """Write rows of twists that the chair could end before a collision; how many there are.

    Columns: speed, turn rate, least clearance of the arc until it ends or touches [m].
    """
    n = 0
    for i in range(SPEEDS):
        v = asked[0] * i / (SPEEDS - 1)
        for j in range(TURNS):
            w = asked[1] + turn * (2.0 * j / (TURNS - 1) - 1.0)
            free, clear = follow_arc(points, outline, v, w, STEP, STEPS, margin)
            to_stop = period + max(abs(v) / deceleration, abs(w) / 2.0)
            if free < STEPS and free * STEP < to_stop:
                continue
            out[n, 0], out[n, 1], out[n, 2] = v, w, max(0.0, clear)
            n += 1
    return n


def fan(mission: AssistMission, now: AssistInput) -> Array:
    """Twists within an assistant's freedom that the chair could end in time, and the stick's.

    Returns:
        (n, 3): speed [m/s], turn rate [rad/s], least clearance on the way [m]; none where the
        chair can only stand.
    """
    out = np.empty((SPEEDS * TURNS, 3))
    n = _fan(
        now.points, mission.chair.footprint.array, np.array(now.asked), now.turn, now.margin,
        mission.limits.deceleration, mission.period, out,
    )  # fmt: skip
    return out[:n]


def scaled_distance(twists: Array, asked: tuple[float, float], mission: AssistMission) -> Array:
    """Squared distances (n,) of twists (n, 2 or more) from the stick's, in full speeds."""
    full = mission.limits.forward, mission.limits.turn
    off: Array = (twists[:, :2] - asked) / full
    return np.asarray((off**2).sum(axis=1))
