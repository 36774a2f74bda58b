"""The control generator: from a path to commands (v, w, t) that the chair can drive.

Segment by segment a swarm searches the commands whose roll-out ends where the segment ends, turned
towards the next one, soon, and away from obstacles (thesis, section 2.9.3 and algorithm 6). Each
segment's commands leave space to come to rest; if nothing leads on, earlier segments are searched
again, and at last the commands end at rest. Between two segments the chair does not stop.

A particle is a list of at most `COMMANDS` commands and the number of those that are driven. The
swarm starts from maneuvers and from the commands that are being driven, or at random. From top to
bottom: the cost of a particle, the maneuvers, algorithm 6 for one segment and for all, and the
settings.
"""

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from planners.rrt_star_woa.rollout import (
    MAX_CLEARANCE,
    MOTION,
    REST,
    STEP,
    Motion,
    World,
    advance,
    brake,
    drive,
    measure_clearance,
    rollout,
    stopping_time,
    time_to_cover,
    turn_limit,
)
from planners.rrt_star_woa.woa import WhaleParameters, WhaleSettings, move, new_whales, tell
from wheelchair_gym.base.arrays import Array
from wheelchair_gym.base.settings import setting, settings
from wheelchair_gym.compiled.kernel import borrowing_kernel, kernel
from wheelchair_gym.compiled.random import Stream, next_uniform, stream
from wheelchair_gym.geometry.kinematics import Limits
from wheelchair_gym.geometry.outline import Footprint
from wheelchair_gym.geometry.planar import arc_lengths, project, wrap

COMMANDS = 6  # maximum number of commands in a particle
V, W, T = range(3)  # columns of commands
_COUNT = 3 * COMMANDS  # index of the number of driven commands in a particle
_SIZE = _COUNT + 1
_NO_COMMANDS = np.empty((0, 3))
# Kinds of maneuvers; see `write_maneuver`.
_MANEUVERS = 9
_ARC, _ARC_TO_REST, _TURN, _TURN_TO_REST, _BACK = range(5)
_TWO_ARCS, _RETREAT, _PURSUIT, _FAST_PURSUIT = range(5, _MANEUVERS)
_COLLISION = 1e5  # s: cost of a contact, above all other costs of a segment
_MISSED = 1e4  # s: cost of an end that is not reached, above all costs except a contact
# Design choices:
SPACING = 0.1  # m between the points of the path that a pure pursuit follows
ONWARD = 0.3  # m beyond a segment's end: the point towards which the chair heads there
SEARCH_RANGE = 1.0  # m: largest distance of the commands from the box of their segment
RETREAT = 0.3  # m
ABOUT_TURN = 0.5  # rad below pi: larger turns keep the direction in which they have begun
PIVOT = 0.9  # rad: heading error above which a pure pursuit turns in place
DESIRED_CLEARANCE = 0.15  # m: larger clearances cost nothing
END_WEIGHT = 10.0  # s/m: cost of the distance from the end of a segment; 5 cm cost 0.5 s
LAST_END_COST = 5.0  # s: cost of the largest distance from the goal that counts as arrived
MIDDLE_WEIGHT = 10.0  # s/m: cost of the distance from the middle of the segment's path
MIDDLE_REACH = 0.05  # m: a smaller distance from there costs nothing
RAMPS = 0.5  # s/rad: additional duration of a turn in place, for its ramps
CLEARANCE_WEIGHT = 2.0  # s: cost of no clearance
REACHED = 0.35  # m: largest distance from the end of a segment that counts as reached
RETRIES = 60  # maximum number of times that a search goes back to an earlier segment


@dataclass(frozen=True)
class Controls:
    """Commands and their roll-out."""

    commands: Array  # (k, 3) m/s, rad/s, s
    rollout: Array  # (n, 3) m, m, rad: poses, the start first
    twists: Array  # (n, 2) m/s, rad/s
    times: Array  # (n,) s
    collision_free: bool  # the footprint touches nothing
    arrived: bool  # at rest at the path's end, or driven up to the horizon
    error: float  # m: from the last pose to the path's end, or from the nearest pose to the horizon
    segments: int  # number of segments up to the horizon
    reached: int  # number of segments, from the first one on, whose ends are reached
    missed: float  # m: distance of the commands' end from that of the first segment not reached

    def twist_at(self, time: float) -> Array:
        """Return the target twist (2,) at a time [s] since the start; 0 after the end."""
        left = self.after(time)
        return left[0, :2] if len(left) else np.zeros(2)

    def after(self, time: float) -> Array:
        """Return the commands (k, 3) that are left at a time [s] since the start."""
        ends = np.cumsum(self.commands[:, 2])
        k = int(np.searchsorted(ends, time, side="right"))
        left = self.commands[k:].copy()
        left[:1, 2] = ends[k : k + 1] - time
        return left


SEGMENT = np.dtype(
    [
        ("x", np.float64),  # m: the end
        ("y", np.float64),
        ("middle_x", np.float64),  # m: half-way along the path
        ("middle_y", np.float64),
        ("onward", np.float64),  # rad: heading of the path at the end
        ("reach", np.float64),  # m: largest distance from the end that counts as reached
        ("last", np.bool_),  # the chair comes to rest here
        ("first_point", np.int64),  # the first point of the path on the segment
        ("end_point", np.int64),  # the first point after the segment
    ]
)


class Search(NamedTuple):
    """Options of the search for a segment's commands."""

    swarm: WhaleParameters
    maneuvers: bool  # the swarm starts from maneuvers, not at random
    printed: bool  # the cost is our reading of the thesis: the distance from the end


@borrowing_kernel
def segment_cost(
    particle: Array, now: Motion, leg: Any, world: World, printed: bool, trial: Motion
) -> float:
    """Return the cost [s] of a particle that begins with the motion `now`.

    It adds up the distances from the segment's end and middle, the duration, the turn towards the
    next segment, which takes longer at speed, too little clearance, and prices of a missed end and
    of a contact, also while coming to rest from there. As printed it is the distance from the end
    [m]. `trial` is workspace.
    """
    trial[0] = now[0]
    motion = trial[0]
    motion.minimum = MAX_CLEARANCE
    motion.marked = math.hypot(leg.middle_x - motion.x, leg.middle_y - motion.y)
    for k in range(int(particle[_COUNT])):
        drive(motion, particle[3 * k + V], particle[3 * k + W], particle[3 * k + T], world)
    off_middle = max(0.0, motion.marked - MIDDLE_REACH)
    if leg.last:
        brake(motion, world)
    gap = math.hypot(leg.x - motion.x, leg.y - motion.y)
    if printed:
        return gap if motion.free else _COLLISION + gap
    end = LAST_END_COST / leg.reach if leg.last else END_WEIGHT
    cost: float = end * gap + MIDDLE_WEIGHT * off_middle + (motion.time - now[0].time)
    if gap > leg.reach:
        cost += _MISSED
    if not leg.last:
        error = abs(wrap(leg.onward - motion.yaw))
        rate = turn_limit(motion.v, world.limits, world.pivot)
        cost += error * (1.0 / rate + RAMPS) * (1.0 + 2.0 * abs(motion.v))
        brake(motion, world)  # the chair must be able to come to rest without contact
    if not motion.free:
        return _COLLISION + cost
    near: float = max(0.0, 1.0 - motion.minimum / DESIRED_CLEARANCE)
    return cost + CLEARANCE_WEIGHT * near


@borrowing_kernel
def arc(now: Any, x: float, y: float, limits: Any, rest: bool, commands: Array) -> int:
    """Write commands that drive an arc to a point [m]; return their number."""
    dx, dy = x - now.x, y - now.y
    gap = max(1e-6, math.hypot(dx, dy))
    angle = wrap(math.atan2(dy, dx) - now.yaw)
    sine = math.sin(angle)
    bend = 2.0 * sine / gap
    speed = min(limits.forward, limits.turn / max(abs(bend), 1e-6))
    length = gap * angle / sine if abs(sine) > 1e-3 else gap
    commands[0, V], commands[0, W] = speed, speed * bend
    gain = max(0.0, speed - now.v)
    # The distance [m] that is lost while speeding up.
    slow = 0.5 * gain * stopping_time(gain, limits.acceleration, limits.jerk)
    if rest:
        halt = stopping_time(speed, limits.deceleration, limits.jerk)
        slow -= 0.5 * speed * (halt - STEP)
        commands[1, T] = halt
    commands[0, T] = max(0.0, (length + slow) / speed)
    return 2 if rest else 1


@borrowing_kernel
def straight(now: Any, leg: Any, world: World, backward: bool, rest: bool, commands: Array) -> int:
    """Write commands that stop and turn to the segment's end, then drive straight there.

    A turn that has begun goes on. With `backward` the chair drives backward, with `rest` it comes
    to rest at the end. Returns the number of commands.
    """
    limits = world.limits
    rate, jerk = limits.turn_acceleration, limits.turn_jerk
    halt = stopping_time(now.v, limits.deceleration, limits.jerk)
    # The chair will rest there: speeds fall in curves that are symmetric in time.
    run = 0.5 * now.v * max(0.0, halt - STEP)
    x, y = now.x + run * math.cos(now.yaw), now.y + run * math.sin(now.yaw)
    length = math.hypot(leg.x - x, leg.y - y)
    facing = math.atan2(leg.y - y, leg.x - x) + (math.pi if backward else 0.0)
    angle = wrap(facing - now.yaw)
    if abs(angle) > math.pi - ABOUT_TURN and now.w * angle < 0.0:
        angle += math.copysign(2.0 * math.pi, now.w)
    k = 0
    if abs(angle) > 2e-3 or abs(now.w) > REST:
        # Small angles are turned slowly, so that the target speed is reached.
        speed = min(world.pivot, limits.turn, math.sqrt(0.5 * max(abs(angle), 2e-3) * rate))
        begun = now.w * math.copysign(1.0, angle)
        commands[k, W] = math.copysign(speed, angle)
        commands[k, T] = time_to_cover(abs(angle), speed, rate, rate, jerk, True, begun)
        stop = stopping_time(max(speed, abs(now.w)), rate, jerk)
        commands[k + 1, T] = max(stop, halt - commands[k, T])
        k += 2
    elif halt > 0.0:
        commands[k, T] = halt
        k += 1
    limit = limits.backward if backward else limits.forward
    if length > 5e-3 and limit > 0.0:
        up, down, jerk = limits.acceleration, limits.deceleration, limits.jerk
        speed = min(limit, math.sqrt(0.5 * length * up)) if rest else limit
        commands[k, V] = -speed if backward else speed
        commands[k, T] = time_to_cover(length, speed, up, down, jerk, rest, 0.0)
        k += 1
        if rest:
            commands[k, T] = stopping_time(speed, down, jerk)
            k += 1
    return max(1, k)


@borrowing_kernel
def coast(motion: Any, v: float, w: float, t: float, world: World) -> None:
    """Move on towards a twist for t seconds, without a test for obstacles."""
    while t > 1e-9:
        step = min(STEP, t)
        advance(motion, v, w, step, world.limits, world.pivot)
        t -= step


@borrowing_kernel
def pursue(
    now: Motion, line: Array, world: World, speed: float, lookahead: float, trial: Motion,
    commands: Array,
) -> int:  # fmt: skip
    """Write the commands of a pure pursuit (Coulter 1992) along points (n, 2) `SPACING` apart.

    All commands have the same duration, in all that of the points at the speed [m/s].
    """
    turn = world.limits.turn
    trial[0] = now[0]
    motion = trial[0]
    each = max(0.2, line.shape[0] * SPACING / speed / COMMANDS)
    at = 0
    for k in range(COMMANDS):
        nearest = math.inf
        for i in range(at, line.shape[0]):
            gap = math.hypot(line[i, 0] - motion.x, line[i, 1] - motion.y)
            if gap < nearest:
                nearest, at = gap, i
        aim = line[min(line.shape[0] - 1, at + round(lookahead / SPACING))]
        dx, dy = aim[0] - motion.x, aim[1] - motion.y
        error = wrap(math.atan2(dy, dx) - motion.yaw)
        v, w = 0.0, math.copysign(turn, error)
        if abs(error) <= PIVOT:
            curvature = 2.0 * math.sin(error) / max(SPACING, math.hypot(dx, dy))
            v = min(speed, 0.9 * turn / max(abs(curvature), 1e-6))
            w = v * curvature
        commands[k, V], commands[k, W], commands[k, T] = v, w, each
        coast(motion, v, w, each, world)
    return COMMANDS


@borrowing_kernel
def write_maneuver(
    kind: int, now: Motion, leg: Any, world: World, line: Array, trial: Motion, commands: Array
) -> int:
    """Write a maneuver of a kind; return the number of its commands.

    The kinds are an arc to the end; a turn in place and a straight to the end, forward or backward;
    two arcs that meet in the middle of the segment; a retreat, then a turn and a straight; and a
    pure pursuit of the path at two speeds.
    """
    commands[:] = 0.0
    limits = world.limits
    if kind <= _ARC_TO_REST:
        return arc(now[0], leg.x, leg.y, limits, kind == _ARC_TO_REST, commands)
    if kind <= _BACK:
        return straight(now[0], leg, world, kind == _BACK, kind != _TURN, commands)
    if kind == _PURSUIT:
        return pursue(now, line, world, 0.4 * limits.forward, 0.2, trial, commands)
    if kind == _FAST_PURSUIT:
        return pursue(now, line, world, 0.7 * limits.forward, 0.5, trial, commands)
    trial[0] = now[0]
    motion, count = trial[0], 1
    if kind == _TWO_ARCS:
        count = arc(now[0], leg.middle_x, leg.middle_y, limits, False, commands)
    else:
        commands[0, V] = -limits.backward
        commands[0, T] = RETREAT / max(limits.backward, 0.05)
    coast(motion, commands[0, V], commands[0, W], commands[0, T], world)
    if kind == _TWO_ARCS:
        return count + arc(motion, leg.x, leg.y, limits, leg.last, commands[count:])
    return count + straight(motion, leg, world, False, False, commands[count:])


@borrowing_kernel
def continue_commands(
    left: Array, now: Motion, leg: Any, world: World, particle: Array, trial: Motion
) -> int:
    """Write driven commands (k, 3) to a particle, up to their point nearest to the segment's end.

    Returns their number, 0 if none leads nearer to the end.
    """
    trial[0] = now[0]
    motion = trial[0]
    nearest, count, duration = math.hypot(leg.x - motion.x, leg.y - motion.y), 0, 0.0
    for k in range(min(COMMANDS, left.shape[0])):
        t = 0.0
        while t < left[k, T] - 1e-9:
            step = min(STEP, left[k, T] - t)
            advance(motion, left[k, V], left[k, W], step, world.limits, world.pivot)
            t += step
            gap = math.hypot(leg.x - motion.x, leg.y - motion.y)
            if gap < nearest:
                nearest, count, duration = gap, k + 1, t
    for k in range(count):
        particle[3 * k + V], particle[3 * k + W] = left[k, V], left[k, W]
        particle[3 * k + T] = left[k, T] if k < count - 1 else duration
    particle[_COUNT] = count
    return count


@kernel
def optimise_segment(
    now: Motion, leg: Any, world: World, search: Search, driven: Array, line: Array, state: Stream
) -> tuple[Array, bool]:
    """Return the best commands (k, 3) for one segment (algorithm 6), and whether they are free.

    Args:
        now: the motion with which they begin.
        leg: a record of SEGMENT.
        world: the chair and the obstacles.
        search: options of the search.
        driven: the particle of the commands that are being driven; without commands there is none.
        line: points (n, 2) of the segment's path [m], `SPACING` apart.
        state: draws the numbers.
    """
    limits, swarm = world.limits, search.swarm
    gap = math.hypot(leg.x - now[0].x, leg.y - now[0].y)
    # The segment's duration at the limits, with half a turn. Six random commands take this long
    # together, each on average half of the longest; one command of a maneuver may take it alone.
    whole = gap / limits.forward + math.pi / world.pivot
    longest = 2.0 * whole if search.maneuvers else 2.0 * whole / COMMANDS
    lower, upper = np.empty(_SIZE), np.empty(_SIZE)
    lower[V::3], upper[V::3] = -limits.backward, limits.forward
    lower[W::3], upper[W::3] = -limits.turn, limits.turn
    lower[T::3], upper[T::3] = 0.0, longest
    lower[_COUNT], upper[_COUNT] = 1.0, COMMANDS + 0.999
    trial = np.zeros(1, MOTION)
    kinds = _MANEUVERS if search.maneuvers else 0
    seeds = kinds + 1 if search.maneuvers and driven[_COUNT] > 0 else kinds
    population = np.zeros((max(swarm.population, seeds), _SIZE))
    for i in range(population.shape[0]):
        X = population[i]
        if seeds == 0:
            for j in range(_SIZE):
                X[j] = lower[j] + next_uniform(state) * (upper[j] - lower[j])
        elif i < kinds:
            commands = X[:_COUNT].reshape(COMMANDS, 3)
            X[_COUNT] = write_maneuver(i, now, leg, world, line, trial, commands)
        elif i < seeds:
            X[:] = driven
        else:
            X[:] = population[i % seeds]
            for j in range(_SIZE):
                # The duration of a command varies with itself, a speed with its whole range.
                scale = X[j] if j % 3 == T else upper[j] - lower[j]
                X[j] += 0.3 * scale * (2.0 * next_uniform(state) - 1.0)
                X[j] = min(max(X[j], lower[j]), upper[j])
    whales = new_whales(population, swarm, lower, upper)
    for t in range(swarm.iterations + 1):
        for i in range(population.shape[0]):
            cost = segment_cost(population[i], now, leg, world, search.printed, trial)
            tell(whales, i, cost)
        if t < swarm.iterations:
            move(whales, t / swarm.iterations, state)
    best, count = whales.leader, int(whales.leader[_COUNT])
    return best[: 3 * count].copy().reshape(count, 3), whales.leader_cost[0] < _COLLISION


@kernel
def around(walls: Array, box: Array) -> Array:
    """Return the walls (k, 4) whose boxes meet a box (4,) xmin, ymin, xmax, ymax [m]."""
    low, high = np.minimum(walls[:, :2], walls[:, 2:]), np.maximum(walls[:, :2], walls[:, 2:])
    in_x = (high[:, 0] >= box[0]) & (low[:, 0] <= box[2])
    near: Array = walls[in_x & (high[:, 1] >= box[1]) & (low[:, 1] <= box[3])]
    return near


@borrowing_kernel
def append(found: Array, now: Motion, world: World, commands: Array, count: int) -> int:
    """Drive commands (k, 3), append them to `count` others, and return the number of all."""
    for k in range(found.shape[0]):
        if found[k, T] > 1e-3:
            drive(now[0], found[k, V], found[k, W], found[k, T], world)
            commands[count, V], commands[count, W] = found[k, V], found[k, W]
            commands[count, T] = found[k, T]
            count += 1
    return count


@kernel
def follow(
    legs: NDArray[Any], line: Array, start: Motion, everything: World, search: Search,
    driven: Array, state: Stream,
) -> tuple[Array, int, float, bool]:  # fmt: skip
    """Return commands (k, 3) along segments (n,) SEGMENT.

    The axle stays within `SEARCH_RANGE` of a segment. Where an end is missed, the search goes back,
    one segment farther each time, and draws other numbers. After `RETRIES` of this the commands end
    as near as possible to the missed end. As printed, nothing is searched again, and commands
    follow after a missed end, too.

    Args:
        legs: the segments.
        line: points (m, 2) of the path [m].
        start: the motion with which the commands begin.
        everything: the chair and all obstacles.
        search: options of the search.
        driven: (j, 3) commands that are being driven.
        state: draws the numbers.

    Returns:
        The commands; the number of segments, from the first one on, whose ends are reached; the
        distance [m] from the next segment's end; whether all is free.
    """
    n = legs.shape[0]
    commands = np.empty((8 * n + 1, 3))
    motion, trial, left = start.copy(), start.copy(), driven.copy()
    now, outline = motion[0], everything.footprint
    far = math.hypot(max(outline[0], outline[1]), outline[2]) + 2.0 * MAX_CLEARANCE
    begins, counts = np.zeros(n, MOTION), np.zeros(n, np.int64)  # where each segment begins
    k, count, reached, missed = 0, 0, 0, 0.0
    farthest, back, retries = 0, 0, 0 if search.printed else RETRIES
    while k < n:
        leg = legs[k]
        begins[k], counts[k] = motion[0], count
        box = np.array([min(leg.x, now.x), min(leg.y, now.y), max(leg.x, now.x), max(leg.y, now.y)])
        box += SEARCH_RANGE * np.array([-1.0, -1.0, 1.0, 1.0])
        walls = around(everything.walls, box + np.array([-far, -far, far, far]))
        world = World(
            walls, everything.discs, box, outline, everything.limits, everything.margin,
            everything.pivot, leg.middle_x, leg.middle_y,
        )  # fmt: skip
        known = np.zeros(_SIZE)
        used = continue_commands(left, motion, leg, world, known, trial)
        points = line[leg.first_point : leg.end_point]
        found, free = optimise_segment(motion, leg, world, search, known, points, state)
        before = math.hypot(leg.x - now.x, leg.y - now.y)
        gap = before
        if free:
            trial[0] = motion[0]
            for i in range(found.shape[0]):
                drive(trial[0], found[i, V], found[i, W], found[i, T], world)
            if leg.last:
                brake(trial[0], world)
            gap = math.hypot(leg.x - trial[0].x, leg.y - trial[0].y)
        there = free and gap <= leg.reach
        if not there and max(k, farthest) > 0 and retries > 0:
            back = back + 1 if k <= farthest else 1
            farthest, retries = max(k, farthest), retries - 1
            k = max(0, k - back)
            motion[0], count, reached, left = begins[k], counts[k], k, left[:0]
            continue
        if there or (free and (search.printed or gap < before)):
            left = left[max(0, used - 1) :]
            left[:1, T] -= known[3 * max(0, used - 1) + T]
            count = append(found, motion, world, commands, count)
        if there and reached == k:
            reached, missed = k + 1, 0.0
        elif reached == k:
            missed = gap
            if not search.printed:
                break
        k += 1
    rest = brake(now, everything)
    if rest > 0.0:
        commands[count] = 0.0, 0.0, rest
        count += 1
    return commands[:count].copy(), reached, missed, bool(now.free)


def ahead(path: Array, position: Array, horizon: float | None) -> tuple[Array, bool]:
    """Return a position (2,) and the path (n, 2) ahead of it, up to a horizon [m].

    Returns:
        The points, and whether the last of them is the path's own end.
    """
    k, _, _ = project(path, position[0], position[1])
    rest = np.vstack([position, path[k + 1 :]])
    distances = arc_lengths(rest)
    if horizon is None or distances[-1] <= horizon:
        return rest, True
    end = [np.interp(horizon, distances, rest[:, k]) for k in (0, 1)]
    return np.vstack([rest[distances < horizon], end]), False


@settings
class ControlGenerator:
    """Settings of the search for commands."""

    whales: WhaleSettings = setting(default=WhaleSettings(population=12, iterations=10))
    """The swarm that searches the commands of a segment."""
    maneuvers: bool = setting(default=True, source="the thesis's swarm starts at random: false")
    """Whether the swarm starts from maneuvers, or at random."""
    printed: bool = setting(default=False, source="thesis, section 2.9.3 and algorithm 6: true")
    """Whether segments end at the path's own points and cost the distance from there alone; the
    swarm then starts at random."""
    horizon: float | None = setting(default=None, unit="m", low=0.4)
    """Length of the path to follow; null for the whole path."""
    segment: float = setting(default=1.0, unit="m", low=0.4, source="measured on training homes")
    """Maximum length of a segment."""
    margin: float = setting(default=0.02, unit="m", low=0.0)
    """Minimum clearance to obstacles."""
    arrival: float = setting(default=0.10, unit="m", low=0.01, source="below the task's 0.30 m")
    """Distance from the path's end that counts as arrived."""

    def segments(self, path: Array, start: Array) -> tuple[NDArray[Any], Array]:
        """Return the segments (n,) SEGMENT ahead of a start (3,), and points (m, 2) of the path."""
        points, to_rest = ahead(path, start[:2], self.horizon)
        distances = arc_lengths(points)
        length, ends = distances[-1], distances[1:]
        if not self.printed:
            count = max(1, math.ceil(length / self.segment))
            ends = length * np.arange(1, count + 1) / count
        begins = np.concatenate([[0.0], ends[:-1]])
        fine = np.linspace(0.0, length, 1 + math.ceil(max(length, SPACING) / SPACING))[1:]

        def at(s: Array) -> Array:
            return np.column_stack([np.interp(s, distances, points[:, k]) for k in (0, 1)])

        legs = np.zeros(len(ends), SEGMENT)
        legs["x"], legs["y"] = at(ends).T
        legs["middle_x"], legs["middle_y"] = at(0.5 * (begins + ends)).T
        beyond = at(np.minimum(ends + ONWARD, length)) - at(np.minimum(ends, length - ONWARD))
        legs["onward"] = np.arctan2(beyond[:, 1], beyond[:, 0])
        legs["reach"], legs["last"][-1] = REACHED, to_rest
        legs["reach"][-1] = self.arrival if to_rest else REACHED
        legs["first_point"] = np.minimum(np.searchsorted(fine, begins), len(fine) - 1)
        legs["end_point"] = np.maximum(
            np.searchsorted(fine, ends, side="right"), legs["first_point"] + 1
        )
        return legs, at(fine)

    def generate(
        self,
        path: ArrayLike,
        start_pose: ArrayLike,
        walls: ArrayLike,
        discs: ArrayLike,
        footprint: Footprint,
        limits: Limits,
        rng: np.random.Generator,
        start_twist: ArrayLike = (0.0, 0.0),
        driven: Array = _NO_COMMANDS,
        pivot: float = math.inf,
    ) -> Controls:
        """Generate commands that drive a path from the chair's pose on.

        Args:
            path: points (n, 2 or 3) [m]; the part behind the chair does not count.
            start_pose: (3,) m, m, rad.
            walls: segments (k, 4) [m].
            discs: (m, 3) m: x, y, radius.
            footprint: the chair's footprint.
            limits: bounds of twists, accelerations and jerks.
            rng: draws the numbers.
            start_twist: (2,) m/s, rad/s.
            driven: (k, 3) commands that the chair is driving; the swarm also starts from them.
            pivot: turn limit [rad/s] of a chair at rest, besides that of a moving one.

        Raises:
            ValueError: the path has fewer than two points.
        """
        points = np.ascontiguousarray(np.asarray(path, dtype=np.float64)[:, :2])
        if len(points) < 2:
            raise ValueError(f"path has {len(points)} points; expected at least two")
        pose, twist = (np.array(v, dtype=np.float64) for v in (start_pose, start_twist))
        pivot = min(pivot, limits.turn)
        world = World(
            np.ascontiguousarray(walls, dtype=np.float64).reshape(-1, 4),
            np.ascontiguousarray(discs, dtype=np.float64).reshape(-1, 3),
            np.array([-np.inf, -np.inf, np.inf, np.inf]),
            footprint.array, limits.record, self.margin, pivot, 0.0, 0.0,
        )  # fmt: skip
        start = np.zeros(1, MOTION)
        start["x"], start["y"], start["yaw"] = pose
        start["v"], start["w"] = twist
        start["minimum"], start["free"] = MAX_CLEARANCE, True
        measure_clearance(start[0], pose[0], pose[1], pose[2], world)
        if 0.0 < start[0]["gap"] < self.margin:  # the chair already has less clearance
            world = world._replace(margin=float(start[0]["gap"]) * 0.999)
            measure_clearance(start[0], pose[0], pose[1], pose[2], world)
        legs, line = self.segments(points, pose)
        search = Search(self.whales.parameters, self.maneuvers and not self.printed, self.printed)
        commands, reached, missed, free = follow(
            legs, line, start, world, search, np.array(driven), stream(rng)
        )
        poses, twists, times = rollout(commands, pose, twist, world.limits, pivot)
        gaps = np.hypot(poses[:, 0] - legs["x"][-1], poses[:, 1] - legs["y"][-1])
        error = float(gaps[-1] if legs["last"][-1] else gaps.min())
        arrived = reached == len(legs)
        return Controls(
            commands, poses, twists, times, free, arrived, error, len(legs), reached, missed
        )
