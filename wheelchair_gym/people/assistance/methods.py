"""Methods of the compiled assistants: a twist from a row's stick and the obstacles around.

Stick, with or without the shield behind it, and nav2's assisted teleop (nav2_behaviors,
AssistedTeleop, main, August 2026): the twist is projected in steps; a collision at the first of
them gives rest, one at time t scales all components by t over the whole time, so that the arc is
kept. It never steers.

Minimum vector field histogram: the free direction nearest to the stick's (Levine et al. 1999). The
density of obstacles in each direction plus a parabola around the stick's direction is a curve whose
minimum is the direction that the chair takes; how wide the parabola is says how freely the chair
may choose. It slows before a collision on the arc that leads there.

Shared dynamic window: of the twists that can be ended in time, the one nearest to the stick's. The
objective is that of the public shared dynamic window of a powered wheelchair
(scwheelchair-simulation): J = 1 - c + c (0.7 heading difference + 0.3 relative speed difference),
with the clearance c in [0, 1]. Its second part, which follows a path to a goal, is left out: an
assistant here knows no goal. With d, the weighted difference from the stick, of at most 1,
J = 1 - c (1 - d) is never below d. So twists are tried in the order of d, until d reaches the least
J found, and an arc is followed only while its clearance can still give a smaller J. Only twists
that cannot be the best are left out.

Slide: the twist nearest to the stick's that closes on no obstacle too fast: it slides along walls.
Each near obstacle limits the speed at which the outline closes on it. For the nearest pair of
points, o on the obstacle and one on the outline, with distance d and unit normal n from the chair,

    n_x v + (n_y o_x - n_x o_y) w <= s(d - margin),   s t + s^2 / (2 a) = d - margin,

where s is the speed from which the chair stops within the distance, after a time t at a
deceleration a. It is the form of Devigne et al. 2016, and a control barrier function. The nearest
twist is a quadratic program in two variables. It is solved exactly: its solution is the stick's
twist, its projection on a constraint, or where two constraints meet. Constraints enter the program
one by one, the most violated one first, until none is violated.
"""

import math
from typing import Any

from wheelchair_gym.base.arrays import Array
from wheelchair_gym.base.settings import setting, settings
from wheelchair_gym.compiled.address import doubles_at, integers_at, on_stack, table_at
from wheelchair_gym.compiled.kernel import borrowing_kernel
from wheelchair_gym.geometry.kinematics import arc_step
from wheelchair_gym.geometry.outline import signed_gap
from wheelchair_gym.people.assistance.state import MAXIMUM, Freedom, Sharing, Twist


@borrowing_kernel
def follow_arc(
    points: Array, outline: Array, v: float, w: float, step: float, steps: int, margin: float,
    maximum: float, give_up: float,
) -> tuple[int, float]:  # fmt: skip
    """Follow a twist with the outline among points (n, 2) [m] in the chair's frame, in steps [s].

    Return the number of steps that keep the margin [m], or come no nearer than the chair is, and
    the minimum clearance on them, up to `maximum` [m]. Where it is below `give_up` [m], the rest is
    not followed. Poses at which it cannot have come near enough to matter are left out.
    """
    n = points.shape[0]
    reach = math.hypot(max(outline[0], outline[1]), outline[2])
    nearer = step * (abs(v) + abs(w) * reach)  # m a step that a point of the outline moves at most
    minimum, clear, k = signed_gap(points, n, outline, 0.0, 0.0, 0.0), maximum, 0
    matters = max(clear, margin)  # a pose with a larger clearance changes nothing
    if minimum > matters:
        k = int(min(float(steps), (minimum - matters) / max(nearer, 1e-9)))
    while k < steps:
        x, y, yaw = arc_step(0.0, 0.0, 0.0, v, w, step * (k + 1))
        gap = signed_gap(points, n, outline, x, y, yaw)
        if gap < margin and gap < minimum:
            return k, clear
        minimum, clear = min(margin, gap), min(clear, gap)
        if clear < give_up:
            return steps, clear
        k, matters = k + 1, max(clear, margin)
        if gap > matters:
            k += int(min(float(steps), (gap - matters) / max(nearer, 1e-9)))
    return steps, clear


@borrowing_kernel
def free_share(
    points: Array, outline: Array, v: float, w: float, time: float, step: float, margin: float
) -> float:
    """Share of a time [s] for which the outline can follow a twist, in steps [s]: `follow_arc`."""
    steps = max(1, round(time / step))
    free, _ = follow_arc(points, outline, v, w, step, steps, margin, 0.0, -math.inf)
    return float(free / steps)


@settings
class Shielded:
    """The stick is the twist, behind the shield."""

    freedom: Freedom = Freedom(backward=2.0)


@settings
class Direct(Shielded):
    """The stick is the twist; nothing is filtered."""

    shielded = False


TIME, _STEP = 1.0, 0.1  # s that the twist is projected, and between its poses: nav2 AssistedTeleop


@settings
class Teleop:
    """Scales the stick's twist by the time to a collision; keeps its arc."""

    freedom: Freedom = Freedom(turn=0.0)


@borrowing_kernel
def slowed(p: Any, a: Any, v: float, w: float, time: float) -> Twist:
    """Scale a twist by the share of a time [s] for which a row's outline can follow it."""
    points = a.points[: a.n_points]
    share = free_share(points, p.outline[:], v, w, time, _STEP, a.margin)
    return share * v, share * w


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
    """The direction [rad] ahead with the smallest sum of density and parabola."""
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
