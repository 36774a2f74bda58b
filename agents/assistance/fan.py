"""Twists near the stick's, and how far the chair's outline could follow each of them."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from agents.assistance.assistant import AssistInput, AssistMission
from wheelchair_gym.compiled.kernel import borrowing_kernel
from wheelchair_gym.geometry import signed_clearance, world_to_body
from wheelchair_gym.kinematics import arc_step

Array = NDArray[np.float64]

SPEEDS, TURNS = 9, 15  # of a fan
STEP, STEPS = 0.1, 20  # s between two poses of an arc, and how many
CLEAR = 0.5  # m: a larger clearance counts as this


@borrowing_kernel
def clearance_at(points: Array, outline: Array, x: float, y: float, yaw: float) -> float:
    """Distance [m] of an outline at a pose to the nearest of points (n, 2); below 0 inside."""
    c, s = math.cos(yaw), math.sin(yaw)
    least = math.inf
    for k in range(points.shape[0]):
        px, py = world_to_body(c, s, points[k, 0] - x, points[k, 1] - y)
        least = min(least, signed_clearance(px, py, outline))
    return least


@borrowing_kernel
def free_steps(
    points: Array, outline: Array, v: float, w: float, step: float, steps: int, margin: float
) -> int:
    """How many steps [s] of a twist keep the margin [m], or come no nearer than the chair is."""
    least = clearance_at(points, outline, 0.0, 0.0, 0.0)
    for j in range(steps):
        x, y, yaw = arc_step(0.0, 0.0, 0.0, v, w, step * (j + 1))
        gap = clearance_at(points, outline, x, y, yaw)
        if gap < margin and gap < least:
            return j
        least = min(margin, gap)
    return steps


@borrowing_kernel
def _fan(
    points: Array, outline: Array, asked: Array, turn: float, margin: float, deceleration: float,
    period: float, out: Array,
) -> int:  # fmt: skip
    """Write rows of twists that the chair could end before a collision; how many there are.

    Columns: speed, turn rate, least clearance of the arc until it ends or touches [m].
    """
    n, now = 0, clearance_at(points, outline, 0.0, 0.0, 0.0)
    for i in range(SPEEDS):
        v = asked[0] * i / (SPEEDS - 1)
        for j in range(TURNS):
            w = asked[1] + turn * (2.0 * j / (TURNS - 1) - 1.0)
            free, clear, least = STEPS, CLEAR, now
            for k in range(STEPS):
                x, y, yaw = arc_step(0.0, 0.0, 0.0, v, w, STEP * (k + 1))
                gap = clearance_at(points, outline, x, y, yaw)
                if gap < margin and gap < least:
                    free = k
                    break
                least = min(margin, gap)
                clear = min(clear, gap)
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
