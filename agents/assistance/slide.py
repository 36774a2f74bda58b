"""The twist nearest to the stick's that closes on no obstacle too fast: it slides along walls.

Each near obstacle limits the speed at which the outline closes on it. For the nearest pair of
points, o on the obstacle and one on the outline, with distance d and unit normal n from the chair,

    n_x v + (n_y o_x - n_x o_y) w <= s(d - margin),   s t + s^2 / (2 a) = d - margin,

where s is the speed from which the chair stops within the distance, after a time t at a
deceleration a. It is the form of Devigne et al. 2016, and a control barrier function. The nearest
twist is a quadratic program in two variables, solved exactly: its solution is the stick's twist,
its projection on a constraint, or where two constraints meet.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from agents.assistance.assistant import (
    AssistInput,
    AssistMission,
    Freedom,
    Plain,
    SharedAssistant,
    Twist,
)
from wheelchair_gym.compiled.kernel import borrowing_kernel
from wheelchair_gym.config import setting, settings

Array = NDArray[np.float64]

NEAR = 1.5  # m: farther obstacles do not limit
ROWS = 24  # constraints that the program has, beside the bounds: the most violated ones
_FEASIBLE = 1e-9


@borrowing_kernel
def write_constraints(
    points: Array, outline: Array, margin: float, deceleration: float, latency: float, out: Array
) -> int:
    """Write rows (a_v, a_w, b, 0) of a_v v + a_w w <= b, one for each near point; how many."""
    n, front, rear, half = 0, outline[0], -outline[1], outline[2]
    for k in range(points.shape[0]):
        x, y = points[k, 0], points[k, 1]
        nx, ny = x - min(front, max(rear, x)), y - min(half, max(-half, y))
        d = math.hypot(nx, ny)
        if d > NEAR:
            continue
        if d > 0.0:
            nx, ny = nx / d, ny / d
        elif front - x < half - abs(y):  # it seems to be inside: the chair may not go deeper
            nx, ny = 1.0, 0.0
        else:
            nx, ny = 0.0, math.copysign(1.0, y)
        most, at = max(0.0, d - margin), deceleration * latency
        speed = math.sqrt(at * at + 2.0 * deceleration * most) - at
        out[n, 0], out[n, 1], out[n, 2], out[n, 3] = nx, ny * x - nx * y, speed, 0.0
        n += 1
    return n


@borrowing_kernel
def _fits(rows: Array, n: int, v: float, w: float) -> bool:
    fits = True
    for k in range(n):
        fits = fits and rows[k, 0] * v + rows[k, 1] * w <= rows[k, 2] + _FEASIBLE
    return fits


@borrowing_kernel
def nearest_twist(
    rows: Array, n: int, asked: tuple[float, float], weights: tuple[float, float]
) -> tuple[float, float]:
    """The point nearest to `asked` that satisfies rows (n, 3) of a_v v + a_w w <= b.

    The distance is weighted: weights[0] dv^2 + weights[1] dw^2. (0, 0) satisfies all rows.
    """
    v0, w0 = asked
    if _fits(rows, n, v0, w0):
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
            if cost < best and _fits(rows, n, v, w):
                best, found_v, found_w = cost, v, w
    return found_v, found_w


@borrowing_kernel
def _slide(
    points: Array, outline: Array, margin: float, deceleration: float, latency: float,
    asked: tuple[float, float], turn: float, weights: tuple[float, float], every: Array,
    rows: Array,
) -> tuple[float, float]:  # fmt: skip
    n = write_constraints(points, outline, margin, deceleration, latency, every)
    m = 0
    for _ in range(min(ROWS, n)):  # the most violated ones, by the stick's twist
        worst, excess = -1, -math.inf
        for k in range(n):
            over = every[k, 0] * asked[0] + every[k, 1] * asked[1] - every[k, 2]
            if over > excess and every[k, 3] == 0.0:
                worst, excess = k, over
        every[worst, 3] = 1.0  # it is in the program
        for j in range(3):
            rows[m, j] = every[worst, j]
        m += 1
    low_v, high_v = min(0.0, asked[0]), max(0.0, asked[0])
    low_w, high_w = min(0.0, asked[1]) - turn, max(0.0, asked[1]) + turn
    for sign, v, w in ((1.0, high_v, high_w), (-1.0, low_v, low_w)):
        rows[m, 0], rows[m, 1], rows[m, 2] = sign, 0.0, sign * v
        rows[m + 1, 0], rows[m + 1, 1], rows[m + 1, 2] = 0.0, sign, sign * w
        m += 2
    v, w = nearest_twist(rows, m, asked, weights)
    share = 1.0  # of what fits the other constraints, too
    for k in range(n):
        speed = every[k, 0] * v + every[k, 1] * w
        if speed > every[k, 2] + _FEASIBLE:
            share = min(share, every[k, 2] / speed)
    return share * v, share * w


@settings
class Slide:
    """The nearest twist to the stick's that closes on no obstacle too fast."""

    deceleration: float = setting(
        default=0.6, unit="m/s2", low=0.05, high=5.0, source="below the chair's 0.8: design choice"
    )
    """Deceleration that the speed towards an obstacle counts on."""
    latency: float = setting(default=0.2, unit="s", low=0.0, high=2.0, source="design choice")
    """Time before the chair begins to brake."""
    turn_weight: float = setting(default=0.3, low=0.01, high=100.0, source="design choice")
    """How much a change of the turn rate counts beside one of the speed, both in full speeds."""
    freedom: Freedom = Freedom()

    def make(self) -> SharedAssistant:
        """A fresh assistant."""
        return SharedAssistant(Plain(self._twist), self.freedom)

    def _twist(self, mission: AssistMission, now: AssistInput) -> Twist:
        limits, n = mission.limits, len(now.points)
        weights = 1.0 / limits.forward**2, self.turn_weight / limits.turn**2
        return _slide(
            now.points, mission.chair.footprint.array, now.margin, self.deceleration, self.latency,
            now.asked, now.turn, weights, np.empty((n, 4)), np.empty((ROWS + 4, 3)),
        )  # fmt: skip
