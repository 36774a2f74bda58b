"""The control generator: from a path to commands (v, w, t) that the chair can drive.

Segment by segment a swarm searches the commands whose roll-out ends where the segment ends, turned
towards the next one, soon, and away from obstacles (thesis, section 2.9.3 and algorithm 6). Each
segment's commands leave space to come to rest, so that a chair that drives them is never trapped in
motion: where nothing leads on, the commands end at rest.

A particle is a list of at most `COMMANDS` commands and how many of them count. It is rolled out
under the chair's limits. The swarm starts from maneuvers that can be written down, or at random.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from planners.rrt_star_woa.rollout import (
    MAX_CLEARANCE,
    MOTION,
    STEP,
    Motion,
    World,
    brake,
    drive,
    measure_clearance,
    motion_at,
    rollout,
    stopping_time,
    time_to_cover,
)
from planners.rrt_star_woa.woa import WhaleParameters, WhaleSettings, move, new_whales, tell
from wheelchair_gym.arrays import Array
from wheelchair_gym.compiled.kernel import borrowing_kernel, kernel
from wheelchair_gym.config import setting, settings
from wheelchair_gym.geometry import Footprint, wrap
from wheelchair_gym.kinematics import Limits
from wheelchair_gym.random import Stream, next_uniform, stream

COMMANDS = 6  # in a particle, at most
V, W, T = range(3)  # columns of commands
_COUNT = 3 * COMMANDS  # where a particle says how many of its commands count
_SIZE = _COUNT + 1
_MANEUVERS = 5
_COLLISION = 1e3  # s: cost of a contact, above all else that can be wrong with a segment
# Design choices:
TOLERANCE = 0.05  # m from the simplified path, up to which points are left out
MAX_SEGMENT_LENGTH = 1.5  # m
MIN_FIRST_SEGMENT_LENGTH = 0.25  # m
SEARCH_RANGE = 1.0  # m: how far the commands of a segment may lead off it
DESIRED_CLEARANCE = 0.15  # m, from which on more costs no less
END_WEIGHT = 10.0  # s/m: cost of the distance from the end of a segment; 5 cm cost 0.5 s
ARRIVAL_WEIGHT = 50.0  # s/m: cost of the distance from the goal; 2 cm cost 1 s
HEADING_WEIGHT = 1.5  # s/rad at the end of a segment: duration of a turn in place, with its ramps
CLEARANCE_WEIGHT = 2.0  # s: cost of a lack of clearance
ARRIVAL = 0.10  # m from the goal that counts as arrived: below the 0.30 m of the task


@dataclass(frozen=True)
class Controls:
    """Commands, and where they take the chair."""

    commands: Array  # (k, 3) m/s, rad/s, s
    rollout: Array  # (n, 3) m, m, rad: poses on the way, the start first
    twists: Array  # (n, 2) m/s, rad/s
    times: Array  # (n,) s
    collision_free: bool  # the outline touches nothing on the way
    arrived: bool  # at rest at the path's end, or led on as far as the horizon
    error: float  # m, from that end: of the last pose, or of the nearest where a horizon ends it

    def twist_at(self, time: float) -> Array:
        """The twist (2,) to ask for at a time [s] since the start; at rest after the end."""
        k = int(np.searchsorted(np.cumsum(self.commands[:, 2]), time, side="right"))
        return self.commands[k, :2].copy() if k < len(self.commands) else np.zeros(2)


class Segment(NamedTuple):
    """One segment: its end, and where the path goes from there."""

    x: float  # m
    y: float
    onward: float  # rad: direction of the next segment
    last: bool  # the chair comes to rest here


@borrowing_kernel
def segment_cost(particle: Array, now: Motion, leg: Segment, world: World, trial: Motion) -> float:
    """The cost [s] of a particle that begins with the motion `now`; `trial` is workspace."""
    trial[0] = now[0]
    motion = trial[0]
    for k in range(int(particle[_COUNT])):
        drive(motion, particle[3 * k + V], particle[3 * k + W], particle[3 * k + T], world)
    if leg.last:
        brake(motion, world)
    gap = math.hypot(leg.x - motion.x, leg.y - motion.y)
    end = ARRIVAL_WEIGHT if leg.last else END_WEIGHT
    cost: float = end * gap + (motion.time - now[0].time)
    if not leg.last:
        error = abs(wrap(leg.onward - motion.yaw))
        cost += HEADING_WEIGHT * error * (1.0 + 2.0 * abs(motion.v))
        brake(motion, world)  # whatever follows, the chair can come to rest without contact
    if not motion.free:
        return _COLLISION + cost
    near: float = max(0.0, 1.0 - motion.least / DESIRED_CLEARANCE)
    cost += CLEARANCE_WEIGHT * near
    return cost


@borrowing_kernel
def arc(now: Any, leg: Segment, limits: Any, rest: bool, commands: Array) -> int:
    """Write commands that drive an arc to the segment's end; how many they are."""
    dx, dy = leg.x - now.x, leg.y - now.y
    gap = max(1e-6, math.hypot(dx, dy))
    angle = wrap(math.atan2(dy, dx) - now.yaw)
    sine = math.sin(angle)
    bend = 2.0 * sine / gap
    speed = min(limits.forward, limits.turn / max(abs(bend), 1e-6))
    way = gap * angle / sine if abs(sine) > 1e-3 else gap
    commands[0, V], commands[0, W] = speed, speed * bend
    gain = max(0.0, speed - now.v)
    # The way [m] that is lost while speeding up.
    slow = 0.5 * gain * stopping_time(gain, limits.acceleration, limits.jerk)
    if rest:
        halt = stopping_time(speed, limits.deceleration, limits.jerk)
        slow -= 0.5 * speed * (halt - STEP)
        commands[1, T] = halt
    commands[0, T] = max(0.0, (way + slow) / speed)
    return 2 if rest else 1


@borrowing_kernel
def straight(
    now: Any, leg: Segment, limits: Any, backward: bool, rest: bool, commands: Array
) -> int:
    """Write commands that come to rest, turn to the segment's end and drive straight there.

    The chair drives backward, and comes to rest at the end, too, if it shall. Returns how many
    commands they are.
    """
    halt_v = stopping_time(now.v, limits.deceleration, limits.jerk)
    halt_w = stopping_time(now.w, limits.turn_acceleration, limits.turn_jerk)
    # Where the chair will rest: speeds fall in curves that are symmetric in time.
    run = 0.5 * now.v * max(0.0, halt_v - STEP)
    yaw = now.yaw + 0.5 * now.w * max(0.0, halt_w - STEP)
    x, y = now.x + run * math.cos(now.yaw), now.y + run * math.sin(now.yaw)
    k, halt = 0, max(halt_v, halt_w)
    if halt > 0.0:
        commands[k, T] = halt
        k += 1
    way = math.hypot(leg.x - x, leg.y - y)
    facing = math.atan2(leg.y - y, leg.x - x) + (math.pi if backward else 0.0)
    angle = wrap(facing - yaw)
    if abs(angle) > 2e-3:
        # Small angles are turned slowly, so that the speed asked for is reached.
        rate, jerk = limits.turn_acceleration, limits.turn_jerk
        speed = min(limits.turn, math.sqrt(0.5 * abs(angle) * rate))
        commands[k, W] = math.copysign(speed, angle)
        commands[k, T] = time_to_cover(abs(angle), speed, rate, rate, jerk, True)
        commands[k + 1, T] = stopping_time(speed, rate, jerk)
        k += 2
    limit = limits.backward if backward else limits.forward
    if way > 5e-3 and limit > 0.0:
        up, down, jerk = limits.acceleration, limits.deceleration, limits.jerk
        speed = min(limit, math.sqrt(0.5 * way * up)) if rest else limit
        commands[k, V] = -speed if backward else speed
        commands[k, T] = time_to_cover(way, speed, up, down, jerk, rest)
        k += 1
        if rest:
            commands[k, T] = stopping_time(speed, down, jerk)
            k += 1
    return max(1, k)


@borrowing_kernel
def write_maneuver(kind: int, now: Any, leg: Segment, limits: Any, commands: Array) -> int:
    """Write one of the maneuvers that serve well in free space; how many commands it has."""
    commands[:] = 0.0
    if kind <= 1:
        return arc(now, leg, limits, kind == 1, commands)
    return straight(now, leg, limits, kind == 4, kind != 2, commands)


@kernel
def bridge(
    now: Motion, leg: Segment, world: World, swarm: WhaleParameters, from_maneuvers: bool,
    state: Stream,
) -> tuple[Array, bool]:  # fmt: skip
    """The commands (k, 3) for one segment from the motion `now`, and whether they are free."""
    limits = world.limits
    gap = math.hypot(leg.x - now[0].x, leg.y - now[0].y)
    lower, upper = np.empty(_SIZE), np.empty(_SIZE)
    lower[V::3], upper[V::3] = -limits.backward, limits.forward
    lower[W::3], upper[W::3] = -limits.turn, limits.turn
    lower[T::3], upper[T::3] = 0.0, 3.0 + 2.0 * gap / limits.forward + math.pi / limits.turn
    lower[_COUNT], upper[_COUNT] = 1.0, COMMANDS + 0.999
    trial = np.zeros(1, MOTION)
    seeds = _MANEUVERS if from_maneuvers else 0
    population = np.zeros((max(swarm.population, seeds), _SIZE))
    for i in range(population.shape[0]):
        X = population[i]
        if seeds == 0:
            for j in range(_SIZE):
                X[j] = lower[j] + next_uniform(state) * (upper[j] - lower[j])
            continue
        if i < seeds:
            commands = X[:_COUNT].reshape(COMMANDS, 3)
            X[_COUNT] = write_maneuver(i, now[0], leg, limits, commands)
            continue
        X[:] = population[i % _MANEUVERS]
        for j in range(_SIZE):
            # The duration of a command varies with itself, a speed with its whole range.
            scale = X[j] if j % 3 == T else upper[j] - lower[j]
            X[j] += 0.3 * scale * (2.0 * next_uniform(state) - 1.0)
            X[j] = min(max(X[j], lower[j]), upper[j])
    whales = new_whales(population, swarm, lower, upper)
    for t in range(swarm.iterations + 1):
        for i in range(population.shape[0]):
            tell(whales, i, segment_cost(population[i], now, leg, world, trial))
        if t < swarm.iterations:
            move(whales, t / swarm.iterations, state)
    best, count = whales.leader, int(whales.leader[_COUNT])
    return best[: 3 * count].copy().reshape(count, 3), whales.leader_cost[0] < _COLLISION


@kernel
def around(walls: Array, box: Array) -> Array:
    """The walls (k, 4) whose own boxes meet a box (4,) xmin, ymin, xmax, ymax [m]."""
    kept = np.empty_like(walls)
    n = 0
    for k in range(walls.shape[0]):
        ax, ay, bx, by = walls[k]
        in_x = max(ax, bx) >= box[0] and min(ax, bx) <= box[2]
        if in_x and max(ay, by) >= box[1] and min(ay, by) <= box[3]:
            kept[n] = walls[k]
            n += 1
    return kept[:n].copy()


@kernel
def follow(
    targets: Array, start: Motion, everything: World, to_rest: bool, swarm: WhaleParameters,
    from_maneuvers: bool, state: Stream,
) -> tuple[Array, int, bool]:  # fmt: skip
    """Commands (k, 3) through targets (n, 2) [m]; the targets reached, and whether all was free.

    The axle stays within `SEARCH_RANGE` of a segment. The chair comes to rest at the last
    target if it shall.
    """
    n = targets.shape[0]
    commands = np.empty((8 * n + 1, 3))
    count = 0
    motion = start.copy()
    now, footprint = motion[0], everything.footprint
    reach = math.hypot(max(footprint[0], footprint[1]), footprint[2])
    far = reach + 2.0 * MAX_CLEARANCE
    reached = 0
    while reached < n:
        x, y = targets[reached, 0], targets[reached, 1]
        box = np.array([min(x, now.x), min(y, now.y), max(x, now.x), max(y, now.y)])
        box += SEARCH_RANGE * np.array([-1.0, -1.0, 1.0, 1.0])
        walls = around(everything.walls, box + np.array([-far, -far, far, far]))
        world = World(walls, everything.discs, box, footprint, everything.limits, everything.margin)
        onward = math.atan2(y - now.y, x - now.x)
        if reached + 1 < n:
            onward = math.atan2(targets[reached + 1, 1] - y, targets[reached + 1, 0] - x)
        leg = Segment(x, y, onward, to_rest and reached + 1 == n)
        found, free = bridge(motion, leg, world, swarm, from_maneuvers, state)
        if not free:
            break
        for k in range(found.shape[0]):
            if found[k, T] > 1e-3:
                drive(now, found[k, V], found[k, W], found[k, T], world)
                commands[count] = found[k]
                count += 1
        reached += 1
    rest = brake(now, everything)
    if rest > 0.0:
        commands[count] = 0.0, 0.0, rest
        count += 1
    return commands[:count].copy(), reached, bool(now.free)


def simplified(path: Array, tolerance: float) -> Array:
    """A path (n, 2) by fewer of its points; none left out lies farther off than the tolerance [m].

    Douglas and Peucker 1973.
    """
    if len(path) < 3:
        return path
    first, last = path[0], path[-1]
    along = last - first
    square = float(along @ along)
    part = np.clip((path - first) @ along / square, 0.0, 1.0) if square > 0 else np.zeros(len(path))
    off = np.hypot(*(path - first - part[:, None] * along).T)
    k = int(off.argmax())
    if off[k] <= tolerance:
        return path[[0, -1]]
    return np.vstack([simplified(path[: k + 1], tolerance)[:-1], simplified(path[k:], tolerance)])


def ahead(path: Array, position: Array, horizon: float | None) -> tuple[Array, bool]:
    """What of a path (n, 2) lies ahead of a position (2,), that first, up to a horizon [m].

    Returns:
        The points, and whether the last of them is the path's own end.
    """
    here, there = path[:-1], path[1:]
    along = there - here
    square = np.maximum((along**2).sum(axis=1), 1e-12)
    part = np.clip(((position - here) * along).sum(axis=1) / square, 0.0, 1.0)
    k = int(np.hypot(*(position - here - part[:, None] * along).T).argmin())
    rest = np.vstack([position, path[k + 1 :]])
    way = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(rest, axis=0).T))])
    if horizon is None or way[-1] <= horizon:
        return rest, True
    end = [np.interp(horizon, way, rest[:, 0]), np.interp(horizon, way, rest[:, 1])]
    return np.vstack([rest[way < horizon], end]), False


@settings
class ControlGenerator:
    """How commands are searched."""

    whales: WhaleSettings = setting(
        default=WhaleSettings(population=12, iterations=10), source="design choice"
    )
    """The swarm that searches the commands of a segment."""
    maneuvers: bool = setting(
        default=True, source="design choice; the thesis's swarm starts at random: false"
    )
    """Whether the swarm starts from maneuvers that serve well in free space, or at random."""
    horizon: float | None = setting(default=None, unit="m", low=0.1, source="design choice")
    """Length of the path to follow; null for the whole path."""
    margin: float = setting(default=0.02, unit="m", low=0.0, source="design choice")
    """Least gap to obstacles."""

    def targets(self, path: Array, start: Array) -> tuple[Array, bool]:
        """Ends (n, 2) of the segments to drive from a start (3,); is the last the path's end?"""
        points, to_rest = ahead(path, start[:2], self.horizon)
        near = np.hypot(*(points - start[:2]).T) < MIN_FIRST_SEGMENT_LENGTH
        near[[0, -1]] = False
        begun = near.argmin() if near[1:].all() else 1 + int(near[1:].argmin())
        points = simplified(np.vstack([points[:1], points[begun:]]), TOLERANCE)
        pieces = []
        for a, b in pairwise(points):
            k = max(1, math.ceil(math.hypot(*(b - a)) / MAX_SEGMENT_LENGTH))
            pieces.append(a + np.arange(1, k + 1)[:, None] / k * (b - a))
        return np.vstack(pieces), to_rest

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
    ) -> Controls:
        """Commands that drive a path from where the chair is.

        Args:
            path: points (n, 2 or 3) [m]; what lies behind the chair does not count.
            start_pose: (3,) m, m, rad.
            walls: segments (k, 4) [m].
            discs: (m, 3) m: x, y, radius.
            footprint: the chair's outline.
            limits: what it may be asked to do.
            rng: draws the numbers.
            start_twist: (2,) m/s, rad/s.

        Raises:
            ValueError: the path has fewer than two points.
        """
        points = np.asarray(path, dtype=np.float64)[:, :2]
        if len(points) < 2:
            raise ValueError(f"path has {len(points)} points; expected at least two")
        pose, twist = (np.array(v, dtype=np.float64) for v in (start_pose, start_twist))
        everywhere = np.array([-np.inf, -np.inf, np.inf, np.inf])
        world = World(
            np.ascontiguousarray(walls, dtype=np.float64).reshape(-1, 4),
            np.ascontiguousarray(discs, dtype=np.float64).reshape(-1, 3),
            everywhere, footprint.array, limits.record, self.margin,
        )  # fmt: skip
        start = motion_at(pose, twist)
        measure_clearance(start[0], pose[0], pose[1], pose[2], world)
        if 0.0 < start[0]["gap"] < self.margin:  # already nearer: at least no nearer than now
            world = world._replace(margin=float(start[0]["gap"]) * 0.999)
            measure_clearance(start[0], pose[0], pose[1], pose[2], world)
        targets, to_rest = self.targets(points, pose)
        commands, reached, free = follow(
            targets, start, world, to_rest, self.whales.parameters, self.maneuvers, stream(rng),
        )  # fmt: skip
        poses, twists, times = rollout(commands, pose, twist, world.limits)
        gaps = np.hypot(*(poses[:, :2] - targets[-1]).T)
        error = float(gaps[-1] if to_rest else gaps.min())
        arrived = reached == len(targets) and (not to_rest or error <= ARRIVAL)
        return Controls(commands, poses, twists, times, free, arrived, error)
