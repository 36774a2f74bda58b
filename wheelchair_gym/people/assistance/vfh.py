"""Minimum vector field histogram: the free direction nearest to the stick's (Levine et al. 1999).

The density of obstacles in each direction plus a parabola around the stick's direction is a curve
whose minimum is the direction that the chair takes; how wide the parabola is says how freely the
chair may choose. It slows before a collision on the arc that leads there.
"""

from __future__ import annotations

import math
from typing import Any

from wheelchair_gym.base.arrays import Array
from wheelchair_gym.base.settings import settings
from wheelchair_gym.compiled.kernel import borrowing_kernel
from wheelchair_gym.people.assistance.freedom import Sharing, Twist
from wheelchair_gym.people.assistance.teleop import slowed

DIRECTIONS = 72  # of the histogram
REACH = 1.5  # m within which obstacles count
LOOK_AHEAD = 1.2  # s: time to a collision from which on it slows
_WIDEN = 0.05  # m on each side of the chair's width
# 1/rad2: weight of the squared angle from the stick's direction (Levine 1999; its value assumed);
# less gives the chair more freedom.
_PARABOLA = 1.0
_TURN_PER_ANGLE = 1.0  # 1/s: turn rate per angle between the stick's direction and the one taken


@settings
class Vfh(Sharing):
    """Turns towards the free direction nearest to the stick's, and slows with the room there."""


@borrowing_kernel
def _density(points: Array, front: float, half: float, direction: float) -> float:
    """Of obstacles in the strip that the chair's width sweeps from its axle in a direction."""
    c, s = math.cos(direction), math.sin(direction)
    found = 0.0
    for j in range(points.shape[0]):
        along = c * points[j, 0] + s * points[j, 1]
        aside = abs(c * points[j, 1] - s * points[j, 0])
        room = along - front
        if along > 0.0 and aside < half and room < REACH:
            share = 1.0 - max(0.0, room) / REACH
            found = max(found, share * share)
    return float(found)


@borrowing_kernel
def _direction(p: Any, a: Any, wanted: float) -> float:
    """The direction [rad] of the least of density and parabola, within a right angle of ahead."""
    points = a.points[: a.n_points]
    front, half = p.outline[0], p.outline[2] + _WIDEN
    best, minimum = wanted, _density(points, front, half, wanted)
    for k in range(DIRECTIONS):
        direction = math.pi * ((k + 0.5) / DIRECTIONS - 0.5)
        off = direction - wanted
        cost = _PARABOLA * off * off
        if cost < minimum:  # a density would only add to it
            cost += _density(points, front, half, direction)
            if cost < minimum - 1e-12:
                best, minimum = direction, cost
    return float(best)


@borrowing_kernel
def vfh(p: Any, a: Any) -> Twist:
    """The twist of a row; see `wheelchair_gym.people.assistance.step`."""
    v, w = a.asked[0], a.asked[1]
    if v > 0.0:
        wanted = math.atan2(w / p.turn, v / p.forward)
        change = _TURN_PER_ANGLE * (_direction(p, a, wanted) - wanted)
        w += min(a.turn, max(-a.turn, change))
    return slowed(p, a, v, w, LOOK_AHEAD)
