"""Shared dynamic window: of the twists that can be ended in time, the one nearest to the stick's.

The objective is that of the public shared dynamic window of a powered wheelchair
(scwheelchair-simulation): J = 1 - c + c (0.7 heading difference + 0.3 relative speed difference),
with the clearance c in [0, 1]. Its second part, which follows a path to a goal, is left out: an
assistant here knows no goal.

With d, the weighted difference from the stick, of at most 1, J = 1 - c (1 - d) is never below d. So
twists are tried in the order of d, until d reaches the least J found, and an arc is followed only
while its clearance can still give a smaller J. Only twists that cannot be the best are left out.
"""

from __future__ import annotations

import math
from typing import Any

from wheelchair_gym.base.arrays import Array
from wheelchair_gym.base.settings import setting, settings
from wheelchair_gym.compiled.address import doubles_at, integers_at, on_stack
from wheelchair_gym.compiled.kernel import borrowing_kernel
from wheelchair_gym.people.assistance.arcs import follow_arc
from wheelchair_gym.people.assistance.freedom import Sharing, Twist

SPEEDS, TURNS = 9, 15  # of the fan
STEP, STEPS = 0.1, 20  # s between two poses of an arc, and how many
CLEAR = 0.5  # m: a larger clearance counts as this
# Weights of the differences from the stick (scwheelchair-simulation): of headings at the arcs' ends
# as a share of a half turn, and of speeds as a share of the stick's.
HEADING_WEIGHT, SPEED_WEIGHT = 0.7, 0.3
SAME = 1e-12  # a difference of costs that is none


@settings
class SharedDwa(Sharing):
    """Weighs clearance against nearness to the stick's heading and speed."""

    enough: float = setting(
        default=0.06, unit="m", low=0.01, high=CLEAR, source="doors leave 0.09 m: measured"
    )
    """Clearance that counts as full; less in proportion to the margin while somebody docks. From
    0.08 m on, waiting before a door of 0.80 m often costs less than going through it."""


@borrowing_kernel
def time_to_stop(v: float, w: float, deceleration: float, period: float) -> float:
    """Seconds that a twist goes on for at least, until the chair rests."""
    return period + max(abs(v) / deceleration, abs(w) / 2.0)


@borrowing_kernel
def _sort(keys: Array, order: Any, n: int) -> None:
    """Sort n numbers, and what belongs to each, in place: by insertion."""
    for k in range(1, n):
        key, what, j = keys[k], order[k], k - 1
        while j >= 0 and keys[j] > key:
            keys[j + 1], order[j + 1] = keys[j], order[j]
            j -= 1
        keys[j + 1], order[j + 1] = key, what


@borrowing_kernel
def shared_dwa(p: Any, a: Any) -> Twist:
    """The twist of a row; see `wheelchair_gym.people.assistance.step`."""
    m, asked_v, asked_w, turn = p.method, a.asked[0], a.asked[1], a.turn
    points, outline, enough = a.points[: a.n_points], p.outline[:], m.enough
    if a.margin < p.freedom.margin:
        enough = m.enough * a.margin / p.freedom.margin
    # Differences from the stick, which both turns of a pair share; without speed, one row of them.
    offs, pairs = (TURNS + 1) // 2, 0
    size = SPEEDS * offs
    differences = doubles_at(on_stack(8 * size), size)
    order = integers_at(on_stack(8 * size), size)
    for i in range(SPEEDS if asked_v != 0.0 else 1):
        for j in range(offs):
            heading = turn * 2.0 * j / (TURNS - 1) * STEP * STEPS / math.pi
            differences[pairs] = HEADING_WEIGHT * heading + SPEED_WEIGHT * i / (SPEEDS - 1)
            order[pairs] = i * offs + j
            pairs += 1
    best, found_v, found_w = math.inf, 0.0, 0.0
    for k in range(pairs):
        if k == 1:  # the stick's own twist is the first in any order, and often all
            _sort(differences, order, pairs)
        difference = differences[k]
        if difference >= best - SAME:
            break
        i, j = order[k] // offs, order[k] % offs
        v = asked_v * (SPEEDS - 1 - i) / (SPEEDS - 1)
        for sign in range(2 if j > 0 else 1):
            w = asked_w + (2 * sign - 1) * turn * 2.0 * j / (TURNS - 1)
            needed = -math.inf  # m: clearance that gives less
            if best < 1.0:
                needed = enough * (1.0 - best) / (1.0 - difference)
            free, clear = follow_arc(points, outline, v, w, STEP, STEPS, a.margin, enough, needed)
            if free < STEPS and free * STEP < time_to_stop(v, w, p.deceleration, p.period):
                continue
            share = max(0.0, clear) / enough
            cost = 1.0 - share * (1.0 - difference)
            if cost < best - SAME:
                best, found_v, found_w = cost, v, w
    return found_v, found_w
