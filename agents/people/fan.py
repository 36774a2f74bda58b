"""Twists near the stick's, and how far the chair's outline could follow each of them."""

from __future__ import annotations

import math

import numpy as np

from agents.people.assistant import AssistInput, AssistMission, Twist
from wheelchair_gym.base.arrays import Array
from wheelchair_gym.compiled.kernel import borrowing_kernel
from wheelchair_gym.people.assistance.arcs import follow_arc
from wheelchair_gym.people.assistance.arcs import free_share as free_share_of
from wheelchair_gym.people.assistance.shared_dwa import (
    CLEAR,
    SPEEDS,
    STEP,
    STEPS,
    TURNS,
    time_to_stop,
)


def free_share(mission: AssistMission, now: AssistInput, twist: Twist, time: float) -> float:
    """Share of a time [s] for which the chair could follow a twist."""
    outline = mission.chair.footprint.array
    return float(free_share_of(now.points, outline, *twist, time, STEP, now.margin))


@borrowing_kernel
def _fan(
    points: Array, outline: Array, asked: Array, turn: float, margin: float, deceleration: float,
    period: float, reach: float, near: Array, out: Array,
) -> int:  # fmt: skip
    """Write rows of twists that the chair could end before a collision; how many there are.

    Columns: speed, turn rate, least clearance of the arc until it ends or touches [m]. The array
    near (n, 2) is for the points that arcs of one speed can come near to: those within reach [m],
    and as far as it drives.
    """
    n = 0
    for i in range(SPEEDS):
        v = asked[0] * i / (SPEEDS - 1)
        far, count = reach + abs(v) * STEP * STEPS, 0
        for k in range(points.shape[0]):
            x, y = points[k, 0], points[k, 1]
            if x * x + y * y <= far * far:
                near[count, 0], near[count, 1] = x, y
                count += 1
        around = near[:count]
        for j in range(TURNS):
            w = asked[1] + turn * (2.0 * j / (TURNS - 1) - 1.0)
            free, clear = follow_arc(around, outline, v, w, STEP, STEPS, margin, CLEAR, -math.inf)
            if free < STEPS and free * STEP < time_to_stop(v, w, deceleration, period):
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
    outline, out = mission.chair.footprint, np.empty((SPEEDS * TURNS, 3))
    reach = outline.reach + max(CLEAR, now.margin) + 1e-6
    n = _fan(
        now.points, outline.array, np.array(now.asked), now.turn, now.margin,
        mission.limits.deceleration, mission.period, reach, np.empty_like(now.points), out,
    )  # fmt: skip
    return out[:n]


def scaled_distance(twists: Array, asked: tuple[float, float], mission: AssistMission) -> Array:
    """Squared distances (n,) of twists (n, 2 or more) from the stick's, in full speeds."""
    full = mission.limits.forward, mission.limits.turn
    off: Array = (twists[:, :2] - asked) / full
    return np.asarray((off**2).sum(axis=1))


def cheapest(costs: Array) -> int:
    """The first of the least costs (n,); differences below 1e-12 are none."""
    return int(np.argmin(np.round(costs, 12)))


def nearest(twists: Array, asked: Twist, mission: AssistMission) -> Twist:
    """Of twists (n, 2 or more) the one nearest to the stick's; rest if there is none."""
    if not len(twists):
        return 0.0, 0.0
    v, w = twists[cheapest(scaled_distance(twists, asked, mission)), :2]
    return float(v), float(w)
