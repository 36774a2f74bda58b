"""The twist nearest to the stick's that closes on no obstacle too fast: it slides along walls.

Each near obstacle limits the speed at which the outline closes on it. For the nearest pair of
points, o on the obstacle and one on the outline, with distance d and unit normal n from the chair,

    n_x v + (n_y o_x - n_x o_y) w <= s(d - margin),   s t + s^2 / (2 a) = d - margin,

where s is the speed from which the chair stops within the distance, after a time t at a
deceleration a. It is the form of Devigne et al. 2016, and a control barrier function. The nearest
twist is a quadratic program in two variables. It is solved exactly: its solution is the stick's
twist, its projection on a constraint, or where two constraints meet. Constraints enter the program
one by one, the most violated one first, until none is violated.
"""

from __future__ import annotations

import math
from typing import Any

from wheelchair_gym.base.arrays import Array
from wheelchair_gym.base.settings import setting, settings
from wheelchair_gym.compiled.address import on_stack, table_at
from wheelchair_gym.compiled.kernel import borrowing_kernel
from wheelchair_gym.people.assistance.freedom import Sharing, Twist
from wheelchair_gym.people.assistance.state import MAXIMUM

NEAR = 1.5  # m: farther obstacles do not limit
DECELERATION = 0.6  # m/s2 that the speed towards an obstacle counts on; below the chair's 0.8
ROWS = 24  # constraints that enter the program at most, beside the bounds
_FEASIBLE = 1e-9
_TURN_WEIGHT = 0.3  # of a change of the turn rate beside one of the speed, both in full speeds


@settings
class Slide(Sharing):
    """The nearest twist to the stick's that closes on no obstacle too fast."""

    latency: float = setting(default=0.2, unit="s", low=0.0, high=2.0)
    """Time before the chair begins to brake."""


@borrowing_kernel
def write_constraints(
    points: Array, outline: Array, margin: float, latency: float, out: Array
) -> int:
    """Write rows (a_v, a_w, b) of a_v v + a_w w <= b, one for each near point; how many."""
    n, front, rear, half = 0, outline[0], -outline[1], outline[2]
    at = DECELERATION * latency
    for k in range(points.shape[0]):
        x, y = points[k, 0], points[k, 1]
        nx, ny = x - min(front, max(rear, x)), y - min(half, max(-half, y))
        square = nx * nx + ny * ny
        if square > NEAR * NEAR:
            continue
        d = math.sqrt(square)
        if d > 0.0:
            nx, ny = nx / d, ny / d
        elif front - x < half - abs(y):  # it seems to be inside: the chair may not go deeper
            nx, ny = 1.0, 0.0
        else:
            nx, ny = 0.0, math.copysign(1.0, y)
        maximum = max(0.0, d - margin)
        out[n, 0], out[n, 1] = nx, ny * x - nx * y
        out[n, 2] = math.sqrt(at * at + 2.0 * DECELERATION * maximum) - at
        n += 1
    return n


@borrowing_kernel
def _largest_violation(rows: Array, n: int, v: float, w: float) -> int:
    """The row of a_v v + a_w w <= b that a twist violates most; -1: it violates none."""
    worst, excess = -1, _FEASIBLE
    for k in range(n):
        over = rows[k, 0] * v + rows[k, 1] * w - rows[k, 2]
        if over > excess:
            worst, excess = k, over
    return worst


@borrowing_kernel
def nearest_twist(rows: Array, n: int, asked: Twist, weights: Twist) -> Twist:
    """The point nearest to `asked` that satisfies rows (n, 3) of a_v v + a_w w <= b.

    The distance is weighted: weights[0] dv^2 + weights[1] dw^2. (0, 0) satisfies all rows.
    """
    v0, w0 = asked
    if _largest_violation(rows, n, v0, w0) < 0:
        return v0, w0
    best, found_v, found_w = math.inf, 0.0, 0.0
    for i in range(n):
        a, b, c = rows[i, 0], rows[i, 1], rows[i, 2]
        for j in range(i, n):
            if i == j:  # the projection on row i
                scale = a * a / weights[0] + b * b / weights[1]
                if scale <= 0.0:
                    continue
                step = (a * v0 + b * w0 - c) / scale
                v, w = v0 - step * a / weights[0], w0 - step * b / weights[1]
            else:  # where rows i and j meet
                det = a * rows[j, 1] - b * rows[j, 0]
                if abs(det) < 1e-12:
                    continue
                v = (c * rows[j, 1] - b * rows[j, 2]) / det
                w = (a * rows[j, 2] - c * rows[j, 0]) / det
            cost = weights[0] * (v - v0) ** 2 + weights[1] * (w - w0) ** 2
            if cost < best and _largest_violation(rows, n, v, w) < 0:
                best, found_v, found_w = cost, v, w
    return found_v, found_w


@borrowing_kernel
def slide(p: Any, a: Any) -> Twist:
    """The twist of a row; see `wheelchair_gym.people.assistance.step`."""
    m, asked, turn = p.method, (a.asked[0], a.asked[1]), a.turn
    every = table_at(on_stack(8 * 3 * MAXIMUM), MAXIMUM, 3)
    n = write_constraints(a.points[: a.n_points], p.outline[:], a.margin, m.latency, every)
    v, w = asked
    worst = _largest_violation(every, n, v, w)
    if worst < 0:
        return asked
    rows = table_at(on_stack(8 * 3 * (ROWS + 4)), ROWS + 4, 3)
    rows[0, 0], rows[0, 1], rows[0, 2] = 1.0, 0.0, max(0.0, v)
    rows[1, 0], rows[1, 1], rows[1, 2] = 0.0, 1.0, max(0.0, w) + turn
    rows[2, 0], rows[2, 1], rows[2, 2] = -1.0, 0.0, -min(0.0, v)
    rows[3, 0], rows[3, 1], rows[3, 2] = 0.0, -1.0, turn - min(0.0, w)
    weights = 1.0 / (p.forward * p.forward), _TURN_WEIGHT / (p.turn * p.turn)
    count = 4
    while worst >= 0 and count < ROWS + 4:
        for j in range(3):
            rows[count, j] = every[worst, j]
        count += 1
        v, w = nearest_twist(rows, count, asked, weights)
        worst = _largest_violation(every, n, v, w)
    share = 1.0  # of what satisfies the constraints that are not in the program, too
    if worst >= 0:
        for k in range(n):
            speed = every[k, 0] * v + every[k, 1] * w
            if speed > every[k, 2] + _FEASIBLE:
                share = min(share, every[k, 2] / speed)
    return share * v, share * w
