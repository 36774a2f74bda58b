"""Intention: what a person sees of the obstacles, and which signal it wants next.

Every `period` a person foresees where the chair will be once a new signal takes effect, from the
motion that the chair really makes. From there it rolls each signal of its interface out along an
arc, and takes the one that costs least: time to go from the arc's end, obstacles that it sees, and
the change of the signal.
"""

import math
from typing import Any

from wheelchair_gym.base.arrays import Array, Floats
from wheelchair_gym.compiled.address import doubles_at, integers_at, on_stack
from wheelchair_gym.compiled.kernel import borrowing_kernel
from wheelchair_gym.compiled.random import DRIVERS, normal, uniform
from wheelchair_gym.geometry.kinematics import arc_step, twist_of_action
from wheelchair_gym.geometry.outline import signed_clearance, signed_gap
from wheelchair_gym.geometry.planar import body_to_world, world_to_body, wrap
from wheelchair_gym.people.drivers.state import (
    ELSEWHERE,
    GO,
    LOOK,
    OBSTACLE,
    OUTLINE,
    PENDING,
    RETREAT,
    SECTORS,
    SIGNALS,
    STICK,
)
from wheelchair_gym.sensors.laser import nearest_beam, shown_range
from wheelchair_gym.task.prepared_episode import geodesic_to_go, seconds_to_go

# Indices of draws of a decision in the channel DRIVERS.
LAPSE, LAPSE_TIME, MIND, WHERE, LOOKS = 100, 101, 102, 103, 104
NOTICED, INDECISION = 200, 300  # and on: of each sector, of each signal
POSES = 6  # on the arc of a signal
TOUCH = 0.01  # m: nearer is a collision
COLLISION = 1e4  # s: an arc that collides costs more than any other
NO_WAY = 60.0  # s more where the quickest way is not known
AHEAD = 0.5  # m before the axle, where a route's length shows whether the heading is right
PUSHED = 0.15  # deflection from which on somebody pushes
STILL = 0.03  # m/s, rad/s: slower does not count as motion
APPROACH = 20.0  # s for which somebody goes up to a thing
NEAR_GOAL = 1.0  # m
MAX_DARING = 4.0  # halvings of the distance that it likes to keep
MANOEUVRE = 1.5  # m from a goal that is a pose, within which somebody manoeuvres
FUNNEL = (0.3, 0.8)  # m to a side of it, and rad, within which it does so by itself, unguided
LEADS, LEAD, TURN_WITHIN = 6, 0.2, 0.1  # stretches straight up to it; m between their lengths; m
PIVOT = 0.6  # of the turn rate, for turns in place
MANOEUVRE_TIME = (1.2, 2.4)  # s that it then looks ahead, at least and at most
ARRIVAL, CREEP = 1.5, 0.1  # s to go, at least, there with a stick; m/s that is always allowed
MAX_SURPLUS = 0.4  # rad/s that a person learns to expect beside what it asks for
SHORTEST_LAPSE, LONGEST_LAPSE = 1.0, 3.0  # s of a lapse of attention: assumed
CAUTION = 3.0  # s that a person would spend for each second without the clearance that it likes
MIND_CHANGE_TIME = 4.0  # s for which it keeps to another direction: assumed
LOOK_DISTANCE = 0.10  # m at which it stops to look at something; docking: 0.05 to 0.15, assumed
LOOK_SPEED, LOOK_TIME = 0.25, 3.0  # deflection with which it comes near; s that it stays: assumed
RESPONSE = 0.4  # s: time constant with which chairs follow a change of turn
DECELERATION = 0.8  # m/s2: as chairs brake


@borrowing_kernel
def _see(p: Any, d: Any, scan: Floats) -> None:
    """Take from a scan the obstacles that the person sees: of each sector the nearest beam."""
    sight, n = p.perception, p.beams
    sees_all = min(sight.left, sight.right, sight.neglect) >= math.pi
    d.n_points = 0
    epoch = math.floor(d.clock)
    for sector in range(min(SECTORS, n)):
        low, high = sector * n // min(SECTORS, n), (sector + 1) * n // min(SECTORS, n)
        best = nearest_beam(scan, low, high)
        r = shown_range(scan[best])
        if r == math.inf:
            continue
        angle = p.mount[2] + p.first + p.per_beam * best
        x = p.mount[0] + r * math.cos(angle)
        y = p.mount[1] + r * math.sin(angle)
        if not sees_all:
            side = math.atan2(y, x)
            if not -sight.right < side < sight.left:
                continue
            if side > sight.neglect and (
                uniform(d.key, epoch, DRIVERS, NOTICED + sector) >= sight.noticed
            ):
                continue
        d.points[d.n_points, 0], d.points[d.n_points, 1] = x, y
        d.n_points += 1


@borrowing_kernel
def _gap(p: Any, d: Any, x: float, y: float, yaw: float) -> float:
    """Distance [m] of the outline at a pose in the chair's frame to what is seen; < 0 inside."""
    return float(signed_gap(d.points[:], d.n_points, p.outline[:], x, y, yaw))


@borrowing_kernel
def _nearest(d: Any, maximum: float) -> tuple[float, float]:
    """Return the nearest point within an angle ahead [rad], in the chair's frame [m]; NaN: none."""
    x, y, minimum = math.nan, math.nan, math.inf
    for k in range(d.n_points):
        px, py = d.points[k, 0], d.points[k, 1]
        if math.hypot(px, py) < minimum and abs(math.atan2(py, px)) <= maximum:
            x, y, minimum = px, py, math.hypot(px, py)
    return x, y


@borrowing_kernel
def _slowing(far: float) -> float:
    """Seconds for the last stretch [m] to a goal, at the speeds that `_take_aim` allows."""
    last = ARRIVAL * CREEP
    return far / CREEP if far < last else ARRIVAL * (1.0 + math.log(far / last))


@borrowing_kernel
def _seconds_to_pose(p: Any, goal: Any, x: float, y: float, yaw: float) -> float:
    """Seconds to a goal (3,) that is a pose: a turn, a straight stretch, a turn, and on ahead.

    The first stretch, forward or backward, ends behind the goal, as far as is quickest.
    """
    c, s = math.cos(goal[2]), math.sin(goal[2])
    ahead, left = world_to_body(c, s, x - goal[0], y - goal[1])
    off, best = wrap(yaw - goal[2]), math.inf
    for k in range(LEADS):
        lead = k * LEAD
        dx, dy = -lead - ahead, -left
        far = math.hypot(dx, dy)
        turned = min(1.0, far / TURN_WITHIN)  # nobody turns for a shorter stretch
        for back in range(2):
            way = wrap(math.atan2(dy, dx) + back * math.pi)
            turns = turned * (abs(wrap(way - off)) + abs(way)) + (1.0 - turned) * abs(off)
            seconds = max(_slowing(far), far / (p.forward if back == 0 else 0.5 * p.backward))
            best = min(best, turns / (PIVOT * p.turn) + seconds + _slowing(lead))
    return float(best)


@borrowing_kernel
def _to_go(p: Any, d: Any, prepared: Any, x: float, y: float, yaw: float) -> float:
    """Seconds from a pose on the map, at full speed, to where the person wants to be."""
    if d.mode == ELSEWHERE or d.mode == LOOK or (p.way == OBSTACLE and d.mode == GO):
        ahead = 0.0 if d.mode == ELSEWHERE else p.outline[0]
        fx, fy = x + ahead * math.cos(yaw), y + ahead * math.sin(yaw)
        bearing = math.atan2(d.target[1] - y, d.target[0] - x)
        far = math.hypot(d.target[0] - fx, d.target[1] - fy)
        return float(far / p.forward + abs(wrap(bearing - yaw)) / p.turn)
    drift = p.perception.drift
    if drift != 0.0:  # it takes its place for one further to the other side
        x, y = x + math.sin(yaw) * drift, y - math.cos(yaw) * drift
    if p.way == OUTLINE:
        if d.manoeuvres:
            return _seconds_to_pose(p, prepared.goal, x, y, yaw)
        seconds = seconds_to_go(prepared, x, y, yaw)
        if seconds >= 0.0:  # else none is known
            return seconds
    seconds = NO_WAY if p.way == OUTLINE and prepared.state_rows > 0 else 0.0
    fx, fy = x + AHEAD * math.cos(yaw), y + AHEAD * math.sin(yaw)
    seconds += geodesic_to_go(prepared, fx, fy) / p.forward
    return float(seconds + 0.1 * geodesic_to_go(prepared, x, y) / p.forward)


@borrowing_kernel
def _motion(p: Any, d: Any, k: int) -> tuple[float, float]:
    """The twist that a person expects of signal k [m/s, rad/s]."""
    v, w = twist_of_action(p.signals[k, 0], p.signals[k, 1], p.forward, p.backward, p.turn)
    return v, w if k == 0 else w + d.surplus


@borrowing_kernel
def _fixed(p: Any, d: Any, k: int) -> float:
    """Seconds that signal k costs wherever it leads: its wait, and the change of the signal."""
    plan = p.intention
    cost = p.wait[k] if k != d.chosen else 0.0
    cost += plan.steadiness * math.hypot(
        p.signals[k, 0] - p.signals[d.chosen, 0], p.signals[k, 1] - p.signals[d.chosen, 1]
    )
    if plan.indecision > 0.0:
        cost += plan.indecision * normal(d.key, d.decisions, DRIVERS, INDECISION + k)
    return float(cost)


@borrowing_kernel
def _begin(p: Any, twist: Array, k: int) -> tuple[float, float, float]:
    """Return the pose, in the chair's frame, that a person expects once signal k takes effect."""
    later = p.perception.anticipation * p.late[k]
    return arc_step(0.0, 0.0, 0.0, twist[0], twist[1], later)


@borrowing_kernel
def _only_end(p: Any, d: Any, v: float, w: float) -> bool:
    """Whether only the end of an arc counts.

    A stick leaves many arcs to choose from. With few signals, and near a goal that is a pose, an
    arc may be left at any of its poses.
    """
    return bool((p.kind == STICK and not d.manoeuvres) or (v == 0.0 and w == 0.0))


@borrowing_kernel
def _spent(p: Any, d: Any, v: float, w: float, j: int) -> float:
    """Seconds that an arc costs which is left at pose j.

    With few signals, half of the horizon's rest is thought to be lost.
    """
    share = (j + 1) / POSES
    if not d.manoeuvres or p.kind != STICK:
        return float(d.horizon * (0.5 + 0.5 * share))
    return float(p.intention.period if v == 0.0 and w == 0.0 else d.horizon * share)


@borrowing_kernel
def _time_to_stop(p: Any, d: Any, v: float) -> float:
    """Seconds on an arc, from the pose where it is left, that must be free of obstacles.

    A stick chooses no arc that collides at all, unless it manoeuvres. Few signals are held until
    the chair must be stopped: the person's delay, the longest delay of its next decision
    beyond the next pose, and the braking distance as time on the arc.
    """
    if p.kind == STICK and not d.manoeuvres:
        return float(d.horizon)
    if p.kind == STICK:
        return float(p.late[0] + p.intention.period + abs(v) / DECELERATION)
    waits = max(0.0, p.intention.period - d.horizon / POSES)
    return float(p.late[0] + waits + 0.5 * abs(v) / DECELERATION)


@borrowing_kernel
def _min_cost(
    p: Any, d: Any, prepared: Any, k: int, begin: tuple[float, float, float], pose: Array,
    to_go: Array,
) -> float:  # fmt: skip
    """Seconds that signal k costs without obstacles; writes the seconds to go (POSES,) of its arc.

    Those of poses at which it may not be left are not written.
    """
    horizon, minimum = d.horizon, math.inf
    v, w = _motion(p, d, k)
    c, s = math.cos(pose[2]), math.sin(pose[2])
    for j in range(POSES - 1 if _only_end(p, d, v, w) else 0, POSES):
        x, y, yaw = arc_step(begin[0], begin[1], begin[2], v, w, horizon * (j + 1) / POSES)
        wx, wy = body_to_world(c, s, x, y)
        seconds = _to_go(p, d, prepared, pose[0] + wx, pose[1] + wy, pose[2] + yaw)
        to_go[j] = p.slowness * seconds
        minimum = min(minimum, _spent(p, d, v, w, j) + to_go[j])
    return float(_fixed(p, d, k) + minimum)


@borrowing_kernel
def _cost(
    p: Any, d: Any, k: int, begin: tuple[float, float, float], to_go: Array, before: float,
    spare: float,
) -> float:  # fmt: skip
    """Seconds that signal k costs, with the obstacles on its arc.

    `to_go` is as `_min_cost` writes it, `before` the distance [m] to what is seen where the arc
    begins. If only its end counts, the cost may be infinite from where obstacles cost `spare` [s].
    """
    horizon = d.horizon
    v, w = _motion(p, d, k)
    to_stop, only_end = _time_to_stop(p, d, v), _only_end(p, d, v, w)
    touch = 0.5 * LOOK_DISTANCE if d.mode == LOOK else TOUCH
    costs = doubles_at(on_stack(8 * POSES), POSES)
    cost, free = 0.0, POSES
    for j in range(POSES):
        x, y, yaw = arc_step(begin[0], begin[1], begin[2], v, w, horizon * (j + 1) / POSES)
        gap = _gap(p, d, x, y, yaw)
        # Where it already touches, as it seems, what leads away is no collision.
        if gap < touch and gap <= before:
            free = j
            break
        short = max(0.0, (d.clearance - gap) / max(d.clearance, 1e-6))
        cost += CAUTION * min(4.0, short * short) * horizon / POSES
        before = gap
        if only_end and cost > spare:
            return math.inf
        costs[j] = cost + _spent(p, d, v, w, j) + to_go[j]
    usable = free
    if free < POSES:
        usable = math.floor(free - to_stop / horizon * POSES)
        if usable <= 0:
            return float(COLLISION * (2.0 - (free + 1.0) / POSES) + horizon * abs(v))
    if only_end:
        return float(_fixed(p, d, k) + costs[POSES - 1])
    best = math.inf
    for j in range(usable):
        best = min(best, costs[j])
    return float(_fixed(p, d, k) + best)


@borrowing_kernel
def _change_mode(p: Any, d: Any, pose: Array) -> None:
    """End the person's present mode, or begin another one."""
    plan = p.intention
    c, s = math.cos(pose[2]), math.sin(pose[2])
    if d.stuck > plan.patience and d.mode != RETREAT and plan.retreat > 0.0:
        d.mode, d.mode_until, d.stuck = RETREAT, d.clock + plan.retreat, 0.0
    if d.mode != GO and d.clock >= d.mode_until:
        d.mode = GO
    if p.way == OBSTACLE:
        x, y = _nearest(d, math.pi)
        wx, wy = body_to_world(c, s, x, y)
        d.target[0], d.target[1] = pose[0] + wx, pose[1] + wy
    if d.mode != GO:
        return
    each = plan.period / 60.0
    if uniform(d.key, d.decisions, DRIVERS, MIND) < plan.mind_changes * each:
        open_, found = 0, -1
        for k in range(d.n_points):
            px, py = d.points[k, 0], d.points[k, 1]
            if math.hypot(px, py) > 2.0 and abs(math.atan2(py, px)) > 0.5:
                open_ += 1  # each of them is as likely
                if uniform(d.key, d.decisions, DRIVERS, WHERE + 400 + k) * open_ < 1.0:
                    found = k
        if found >= 0:
            wx, wy = body_to_world(c, s, 0.7 * d.points[found, 0], 0.7 * d.points[found, 1])
            d.target[0], d.target[1] = pose[0] + wx, pose[1] + wy
            d.mode, d.mode_until = ELSEWHERE, d.clock + MIND_CHANGE_TIME
            return
    if uniform(d.key, d.decisions, DRIVERS, LOOKS) < plan.looks * each:
        x, y = _nearest(d, 1.0)
        if math.hypot(x, y) < 2.5:  # NaN: there is nothing
            wx, wy = body_to_world(c, s, x, y)
            d.target[0], d.target[1] = pose[0] + wx, pose[1] + wy
            d.mode, d.mode_until = LOOK, d.clock + APPROACH


@borrowing_kernel
def _may_choose(p: Any, d: Any, k: int) -> bool:
    """Whether what the person is about allows signal k."""
    x = p.signals[k, 0]
    if d.mode == RETREAT:
        return bool(x <= 0.0)
    if d.mode == LOOK:
        return bool(0.0 <= x <= LOOK_SPEED)
    return bool(p.kind != STICK or abs(_motion(p, d, k)[0]) <= d.fastest)


@borrowing_kernel
def _weigh(
    p: Any, d: Any, prepared: Any, pose: Array, twist: Array, bounds: Array, around: int,
    reach: int, best: int, minimum: float,
) -> tuple[int, float]:  # fmt: skip
    """The signal that costs least, of the best so far, the coarse ones, and those around one.

    Those whose bounds (n_signals,) are numbers have been weighed before.
    """
    to_go = doubles_at(on_stack(8 * SIGNALS * POSES), SIGNALS * POSES)
    weighed, count = integers_at(on_stack(8 * SIGNALS), SIGNALS), 0
    late, begin, before = math.nan, (0.0, 0.0, 0.0), 0.0
    for k in range(p.n_signals):
        if not math.isnan(bounds[k]):
            continue
        off_x, off_y = p.place[k, 0] - p.place[around, 0], p.place[k, 1] - p.place[around, 1]
        if not (p.coarse[k] or max(abs(off_x), abs(off_y)) <= reach):
            continue
        bounds[k] = math.inf
        if _may_choose(p, d, k):
            if p.late[k] != late:
                begin = _begin(p, twist, k)
            late, at = p.late[k], POSES * k
            bounds[k] = _min_cost(p, d, prepared, k, begin, pose, to_go[at : at + POSES])
            weighed[count] = k
            count += 1
    # Obstacles only add to a cost: the signals that are cheapest without are looked at first.
    late = math.nan
    while True:
        k, bound = 0, math.inf
        for place in range(count):
            other = weighed[place]
            if bounds[other] < bound:
                k, bound = other, bounds[other]
        if bound > minimum or bound == math.inf:
            return best, minimum
        bounds[k] = math.inf
        if p.late[k] != late:
            begin = _begin(p, twist, k)
            before = _gap(p, d, begin[0], begin[1], begin[2])
        late, cost = p.late[k], bound
        if p.way != OBSTACLE:
            at = POSES * k
            cost = _cost(p, d, k, begin, to_go[at : at + POSES], before, minimum - bound + 1e-9)
        if cost < minimum or (cost == minimum and k < best):
            best, minimum = k, cost


@borrowing_kernel
def _choose(p: Any, d: Any, prepared: Any, pose: Array, twist: Array) -> int:
    """The signal that costs least from where the chair will be."""
    if d.mode == LOOK and d.n_points > 0:
        x, y = _nearest(d, 1.0)
        if signed_clearance(x, y, p.outline[:]) <= LOOK_DISTANCE:  # NaN: never
            d.mode_until = min(d.mode_until, d.clock + LOOK_TIME)
            return 0
    best, minimum = 0, math.inf
    if d.mode == RETREAT:  # back, as far from everything as possible
        for k in range(p.n_signals):
            if _may_choose(p, d, k):
                v, w = _motion(p, d, k)
                x, y, yaw = arc_step(0.0, 0.0, 0.0, v, w, p.intention.horizon)
                cost = v - min(1.0, _gap(p, d, x, y, yaw)) + 0.1 * abs(w)
                if cost < minimum:
                    best, minimum = k, cost
        return best
    bounds = doubles_at(on_stack(8 * SIGNALS), SIGNALS)
    for k in range(p.n_signals):
        bounds[k] = math.nan  # it has not been weighed
    best, minimum = _weigh(p, d, prepared, pose, twist, bounds, d.chosen, 1, best, minimum)
    # Who manoeuvres slowly weighs all.
    reach = 1 if p.signals[best, 0] > 0.5 * p.intention.speed * p.interface.gain else SIGNALS
    best, minimum = _weigh(p, d, prepared, pose, twist, bounds, best, reach, best, minimum)
    return best


@borrowing_kernel
def notice_motion(p: Any, d: Any, twist: Array) -> None:
    """Notice how a push moves the chair: what the chair does counts, not what it was asked."""
    pushes = math.hypot(d.stick[0], d.stick[1]) > PUSHED
    stands = abs(twist[0]) < STILL and abs(twist[1]) < STILL
    d.stuck = d.stuck + p.period if pushes and stands else 0.0
    more = p.period / p.intention.patience
    more = more if stands and d.chosen == 0 and d.mode == GO else -0.1 * more
    d.daring = min(MAX_DARING, max(0.0, d.daring + more))
    asked = 0.0 if d.intended == 0 else p.signals[d.intended, 1] * p.turn
    d.expected += (asked - d.expected) * min(1.0, p.period / RESPONSE)
    more = min(MAX_SURPLUS, max(-MAX_SURPLUS, twist[1] - d.expected))
    if pushes and p.kind == STICK:  # few signals cannot correct it
        d.surplus += (more - d.surplus) * min(1.0, p.period / p.intention.adaptation)


@borrowing_kernel
def decide(p: Any, d: Any, prepared: Any, pose: Array, twist: Array, scan: Floats) -> None:
    """Decide on a signal if it is time, which the body follows after the reaction time."""
    if d.clock + 1e-9 < d.decide_at:
        return
    d.decide_at += p.intention.period
    d.decisions += 1
    sight = p.perception
    if d.clock < d.lapse_until:
        return
    if uniform(d.key, d.decisions, DRIVERS, LAPSE) < sight.lapses / 60.0 * p.intention.period:
        share = uniform(d.key, d.decisions, DRIVERS, LAPSE_TIME)
        d.lapse_until = d.clock + SHORTEST_LAPSE + share * (LONGEST_LAPSE - SHORTEST_LAPSE)
        return
    _see(p, d, scan)
    _change_mode(p, d, pose)
    _take_aim(p, d, prepared, pose)
    chosen = _choose(p, d, prepared, pose, twist)
    d.chosen = chosen
    if d.pending < PENDING:
        d.pending_signal[d.pending] = chosen
        late = p.interface.delay if p.kind == STICK else 0.0
        d.pending_at[d.pending] = d.clock + sight.reaction + late
        d.pending += 1


@borrowing_kernel
def _take_aim(p: Any, d: Any, prepared: Any, pose: Array) -> None:
    """Decide how far to look ahead and how near to come.

    Who hesitates comes to dare more. Near a goal that is a pose, somebody looks further ahead,
    slows down with a stick, and accepts the obstacles beside the goal.
    """
    d.clearance, d.horizon = p.intention.clearance * 0.5**d.daring, p.intention.horizon
    d.fastest, d.manoeuvres = math.inf, False
    c, s = math.cos(pose[2]), math.sin(pose[2])
    dx, dy = prepared.goal[0] - pose[0], prepared.goal[1] - pose[1]
    docks = prepared.arrival[0] != 0.0 and p.way != OBSTACLE and d.mode == GO
    if not docks or math.hypot(dx, dy) > MANOEUVRE:
        return
    x, y = world_to_body(c, s, dx, dy)
    gap = _gap(p, d, x, y, prepared.goal[2] - pose[2])
    d.clearance = min(d.clearance, max(2.0 * TOUCH, gap))
    d.fastest = max(CREEP, math.hypot(dx, dy) / ARRIVAL)
    turn = wrap(pose[2] - prepared.goal[2])
    _, left = world_to_body(math.cos(prepared.goal[2]), math.sin(prepared.goal[2]), dx, dy)
    if abs(left) < FUNNEL[0] and abs(turn) < FUNNEL[1]:
        seconds = _seconds_to_pose(p, prepared.goal, pose[0], pose[1], pose[2])
        d.manoeuvres = True
        d.horizon = min(MANOEUVRE_TIME[1], max(MANOEUVRE_TIME[0], seconds))


@borrowing_kernel
def begin_intention(d: Any) -> None:
    """Reset the state of an intention: nothing is decided yet."""
    d.decisions = d.chosen = d.n_points = 0
    d.mode, d.decide_at, d.mode_until, d.stuck, d.lapse_until = GO, 0.0, 0.0, 0.0, 0.0
    d.target[0] = d.target[1] = d.surplus = d.expected = d.daring = 0.0
