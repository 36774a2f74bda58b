"""Roll-outs of commands: what the chair would sweep, and what it would gain along its path.

Everything is in the chair's own frame at the present moment: obstacles are points, the reference
path is a chain of poses with the distance s along it, where a radian of turning counts as
`TURN_LENGTH` metres.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from planners.smoothing.shortcut import resample
from wheelchair_gym.base.arrays import Array
from wheelchair_gym.compiled.kernel import kernel
from wheelchair_gym.geometry.kinematics import Limits, approach_twist, arc_step, peak_speed
from wheelchair_gym.geometry.outline import (
    Footprint,
    clearance_to_points,
    rectangle_point_gap,
    required_clearance,
)
from wheelchair_gym.geometry.planar import to_frame

TURN_LENGTH = 0.4  # m per rad: about the mean lever of the outline about the drive axle
# Two steps exist: with the control generator's 0.05 s a fan of twists takes 2.5 times as long. The
# ramps of the twist are the same; here the pose follows the twist at the end of a step.
STEP = 0.1  # s
HOLD = 0.4  # s that a twist is held before the stop that must be clear: four periods at 10 Hz
BRAKING = 4.0  # s of that stop, at most; with default limits it takes half of this
SPEED_CLEARANCE = 0.06  # s: the outline keeps this share of its speed clear, as the shield does
SLOW = 0.1  # m/s: and only above this speed
GENTLE = 0.4  # m/s: slower, people have the time to step back
AT_REST = 0.03  # m/s: slower, a chair stands
SPREAD = 0.25  # standard deviations of a predicted place added to an actor's radius,
MAX_SPREAD = 0.1  # m: up to this
ACTOR_CAUTION = 0.35  # s: of own speed, kept as distance from actors, which may turn any moment
# Terms of the cost of a roll-out beside those of `Objective`; tuned on training crowds and homes.
COMFORT = 0.05  # s: cost of a change of the twist by 1 m/s; by 1 rad/s it costs half as much
REVERSE = 0.5  # cost of a metre in reverse
PROXIMITY = 2.0  # cost of a metre towards an actor, at it; zero from ACTOR_CLEARANCE on
ACTOR_CLEARANCE = 0.8  # m
ACTOR_WEIGHT = 6.0  # m: cost of a predicted contact with an actor; zero from PREDICTION_TIME on
PREDICTION_TIME = 2.0  # s, until which one of the two will have moved aside
X, Y, YAW, S = range(4)  # columns of a reference path
# Columns of actors, after X and Y: of `LocalMap.actors`.
VX, VY, RADIUS, PLACE_VAR, COVARIANCE, SPEED_VAR = 2, 3, 4, 5, 6, 7


def stopping_distance(limits: Limits) -> float:
    """Return a bound [m] of the way that a twist held for `HOLD` and its stop take, ahead."""
    speed, braking = limits.forward, limits.deceleration
    return speed * (HOLD + min(BRAKING, 0.5 * (speed / braking + braking / limits.jerk)))


class Body(NamedTuple):
    """The chair and its present motion, as kernels take them."""

    state: Array  # (4,) speed, its rate of change, turn rate, its rate of change
    last: Array  # (2,) the twist commanded before
    limits: Any  # (1,) of LIMITS: a kernel takes an array sooner than a record
    footprint: Array  # (3,) `Footprint.array`


class ChairState:
    """The chair's twist with its rates of change, which no encoder measures; and what bounds it."""

    def __init__(self, limits: Limits, footprint: Footprint, period: float) -> None:
        self.limits, self.footprint, self.period = limits, footprint, period
        self._limits = limits.record
        self.body = Body(np.zeros(4), np.zeros(2), np.array([limits.record]), footprint.array)

    def measured(self, twist: Array) -> None:
        """Take the encoders' twist where the ramps must be wrong: a bump, a slip, a shield."""
        state = self.body.state
        for k, tolerance in ((0, 0.10), (1, 0.20)):
            if abs(state[2 * k] - twist[k]) > tolerance:
                state[2 * k], state[2 * k + 1] = twist[k], 0.0

    def command(self, twist: Array) -> None:
        """Note what is commanded for the next period."""
        state, limits = self.body.state, self._limits
        v, v_rate, w, w_rate = state
        state[:] = approach_twist(v, v_rate, w, w_rate, twist[0], twist[1], limits, self.period)
        self.body.last[:] = twist


class LocalView(NamedTuple):
    """Surroundings of the chair, in its own frame, as kernels take them."""

    points: Array  # (k, 3) x, y and the distance from the origin [m], which rises
    actors: Array  # (m, 8): see `LocalMap.actors`
    reference: Array  # (n, 4) x, y [m], yaw [rad], s [m]


@kernel
def match(
    x: float, y: float, yaw: float, reference: Array, first: int, max_s: float
) -> tuple[int, float]:
    """The row of the reference pose nearest to a pose, up to a way s, and how far it is [m]."""
    best, row = 1e18, first
    for k in range(first, reference.shape[0]):
        if reference[k, S] > max_s:
            break
        dx, dy = reference[k, X] - x, reference[k, Y] - y
        turn = reference[k, YAW] - yaw
        turn = TURN_LENGTH * (turn - 2.0 * math.pi * math.floor(turn / (2.0 * math.pi) + 0.5))
        distance = dx * dx + dy * dy + turn * turn
        if distance < best:
            best, row = distance, k
    return row, math.sqrt(best)


@kernel
def actor_distance(
    x: float, y: float, yaw: float, footprint: Array, actors: Array, t: float, limit: float
) -> float:
    """Distance [m], at most `limit`, from the outline to the nearest actor predicted at time t.

    Actors keep their velocity, and are as much wider as their place may err by then.
    """
    c, s = math.cos(yaw), math.sin(yaw)
    best = limit
    for k in range(actors.shape[0]):
        px, py = actors[k, X] + t * actors[k, VX] - x, actors[k, Y] + t * actors[k, VY] - y
        gap = rectangle_point_gap(c * px + s * py, c * py - s * px, footprint) - actors[k, RADIUS]
        if gap < best:
            variance = t * (2.0 * actors[k, COVARIANCE] + t * actors[k, SPEED_VAR])
            gap -= min(MAX_SPREAD, SPREAD * math.sqrt(max(0.0, variance)))
            best = min(best, gap)
    return best


@kernel
def stops_clear(
    v: float, w: float, body: Body, view: LocalView, hold: float, margin: float
) -> bool:
    """Whether a twist, held for `hold` seconds and then braked, keeps the margin until rest.

    A chair that does not come to rest within `BRAKING` s does not. An actor is where it is
    predicted, or stops where it is now: in motion the chair comes to neither nearer than it would
    be if it stood.
    """
    x, y, yaw = 0.0, 0.0, 0.0
    limits, footprint, actors = body.limits[0], body.footprint, view.actors
    sv, av, sw, aw = body.state[0], body.state[1], body.state[2], body.state[3]
    held = round(hold / STEP)
    lever = math.hypot(max(footprint[0], footprint[1]), footprint[2])
    for k in range(held + round(BRAKING / STEP)):
        if k == held:
            v, w = 0.0, 0.0
        sv, av, sw, aw = approach_twist(sv, av, sw, aw, v, w, limits, STEP)
        x, y, yaw = arc_step(x, y, yaw, sv, sw, STEP)
        need = required_clearance(margin, SPEED_CLEARANCE, abs(sv), abs(sw), lever, SLOW)
        if clearance_to_points(x, y, yaw, footprint, view.points, need + 0.01) < need:
            return False
        still = abs(sv) < 0.02 and abs(sw) < 0.05
        if not still and actors.shape[0] > 0:
            distance = margin + ACTOR_CAUTION * abs(sv)
            for t in (0.0, (k + 1) * STEP):
                gap = actor_distance(x, y, yaw, footprint, actors, t, distance)
                if gap < distance:  # moving away from an actor is always allowed
                    here = actor_distance(0.0, 0.0, 0.0, footprint, actors, t, distance)
                    if gap < here:
                        return False
        ends = (
            peak_speed(sv, av, limits.jerk) < 0.02 and peak_speed(0.0, aw, limits.turn_jerk) < 0.05
        )
        if k >= held and still and ends:
            return True
    return False


@kernel
def rollout_cost(
    commands: Array, body: Body, view: LocalView, start: int, margin: float, objective: Any
) -> float:
    """The cost [m] of commands (k, 3), rolled out: the one objective of every local controller.

    `start` is the reference's row where the chair is; the last command lasts until the horizon.
    """
    limits, footprint, reference = body.limits[0], body.footprint, view.reference
    desired, weight = objective.desired_clearance, objective.clearance
    steps = round(objective.horizon / STEP)
    lever = math.hypot(max(footprint[0], footprint[1]), footprint[2])
    x, y, yaw = 0.0, 0.0, 0.0
    gap = 0.0  # a lower bound; measured anew only where it might matter
    sv, av, sw, aw = body.state[0], body.state[1], body.state[2], body.state[3]
    v, w, row, until = commands[0, 0], commands[0, 1], 0, commands[0, 2]
    cost: float = COMFORT * (abs(v - body.last[0]) + 0.5 * abs(w - body.last[1]))
    reversed_way, driven, actors = 0.0, 0.1, view.actors.shape[0] > 0
    end = (0.0, 0.0, 0.0)
    for k in range(steps):
        while k * STEP >= until - 1e-9 and row + 1 < commands.shape[0]:
            row += 1
            change = abs(commands[row, 0] - v) + 0.5 * abs(commands[row, 1] - w)
            cost += COMFORT * change
            v, w, until = commands[row, 0], commands[row, 1], until + commands[row, 2]
        sv, av, sw, aw = approach_twist(sv, av, sw, aw, v, w, limits, STEP)
        bx, by, byaw = x, y, yaw
        x, y, yaw = arc_step(x, y, yaw, sv, sw, STEP)
        gap -= (abs(sv) + lever * abs(sw)) * STEP
        if gap < desired:
            gap = clearance_to_points(x, y, yaw, footprint, view.points, desired + 0.2)
        if gap < margin:  # what lies beyond is not reached
            cost += weight * objective.horizon * (steps - k) / steps
            break
        # By way, not by time: slow driving in a narrow place costs no more, and standing before it
        # gains nothing. Who comes to a chair at rest walks round it, or stops.
        moved = (abs(sv) + TURN_LENGTH * abs(sw)) * STEP
        short = max(0.0, 1.0 - gap / desired)
        cost += weight * short * short * moved
        if actors and moved > AT_REST * STEP:
            t = (k + 1) * STEP
            distance = actor_distance(x, y, yaw, footprint, view.actors, t, ACTOR_CLEARANCE)
            before = actor_distance(bx, by, byaw, footprint, view.actors, t, ACTOR_CLEARANCE)
            if distance < before:  # by the chair's own motion, not who walks into its side
                short = 1.0 - distance / ACTOR_CLEARANCE
                cost += PROXIMITY * short * short * (before - distance)
                if distance < margin:  # the later, the surer one of both will have turned aside
                    left = max(0.0, 1.0 - t / PREDICTION_TIME)
                    cost += ACTOR_WEIGHT * left * left * min(1.0, abs(sv) / GENTLE)
                    break
        reversed_way += max(0.0, -sv) * STEP
        driven += 1.1 * moved
        end = (x, y, yaw)
        if k == steps // 2:  # half-way, too, or it cuts corners
            _, error = match(x, y, yaw, reference, start, reference[start, S] + driven)
            cost += 0.5 * objective.path * error
    at, error = match(end[0], end[1], end[2], reference, start, reference[start, S] + driven)
    cost += objective.path * error
    cost -= reference[at, S] - reference[start, S]
    cost += REVERSE * reversed_way
    return cost


@kernel
def start_row(view: LocalView) -> int:
    """The row of the reference where the chair is."""
    row, _ = match(0.0, 0.0, 0.0, view.reference, 0, view.reference[0, S] + 0.3)
    return row


@kernel
def rollout_costs(
    candidates: Array, body: Body, view: LocalView, margin: float, objective: Any
) -> Array:
    """The costs (c,) [m] of candidates (c, k, 3); see `rollout_cost`."""
    costs, start = np.empty(candidates.shape[0]), start_row(view)
    for i in range(candidates.shape[0]):
        costs[i] = rollout_cost(candidates[i], body, view, start, margin, objective)
    return costs


@kernel
def cheapest(
    twists: Array, costs: Array, body: Body, view: LocalView, hold: float, margin: float
) -> int:
    """The index of the cheapest twist (c, 2 or more) that passes `stops_clear`, or -1.

    The test takes long: it is made from the cheapest on, until one passes.
    """
    for i in np.argsort(costs):
        if stops_clear(twists[i, 0], twists[i, 1], body, view, hold, margin):
            return int(i)
    return -1


SPACING = 0.05  # m (or m of turning) between two reference poses
SMOOTHING = 0.25  # m: half of the stretch over which corners of a plain polyline are rounded


def poses_of(path: Array, heading: float) -> Array:
    """The poses (m, 3) of a path (n, 2) with corners a little rounded.

    They begin with a pivot from the chair's heading [rad].
    """
    points = resample(path, SPACING)
    wide = round(SMOOTHING / SPACING)
    if len(points) > 2 * wide + 1:
        before = 2 * points[0] - points[wide:0:-1]
        after = 2 * points[-1] - points[-2 : -wide - 2 : -1]
        padded = np.concatenate([before, points, after])
        window = np.ones(2 * wide + 1) / (2 * wide + 1)
        points = np.column_stack([np.convolve(padded[:, k], window, "valid") for k in (0, 1)])
    steps = np.gradient(points, axis=0)
    yaw = np.unwrap(np.arctan2(steps[:, 1], steps[:, 0]))
    turn = math.remainder(yaw[0] - heading, 2 * math.pi)
    count = math.ceil(abs(turn) * TURN_LENGTH / SPACING)
    yaw += heading + turn - yaw[0]
    pivot = np.column_stack(
        [np.repeat(points[:1], count, axis=0), heading + turn * np.arange(count) / max(1, count)]
    )
    return np.concatenate([pivot, np.column_stack([points, yaw])])


class ReferencePath:
    """Poses to follow, the distance s [m] along them, and how far the chair has come.

    Attributes:
        path: (n, 2) [m]: as it was planned.
        rows: (n, 4) x, y [m], yaw [rad], s [m].
        at: the row where the chair is.
        planned_headings: the planner has given the headings.
        held: the row where the chair is, if its follower knows; else None: the nearest is.
        blocked: its follower cannot drive it as it was planned.
        turning: its follower turns the chair in place, which takes long where it has not looked.
        reopens: it leads through what was free once, and may be free again.
    """

    def __init__(self, path: Array, pose: Array, reopens: bool = False) -> None:
        path = np.asarray(path, dtype=np.float64)
        self.path = path[:, :2]
        self.planned_headings = path.shape[1] == 3 and len(path) > 1
        if len(path) < 2:
            path = np.concatenate([path[:, :2], path[:, :2] + 1e-6])
        poses = path if path.shape[1] == 3 else poses_of(path, float(pose[2]))
        turns = np.remainder(np.diff(poses[:, YAW]) + math.pi, 2 * math.pi) - math.pi
        ways = np.hypot(*np.diff(poses[:, :2], axis=0).T)
        s = np.concatenate([[0.0], np.cumsum(ways + TURN_LENGTH * np.abs(turns))])
        self.rows = np.column_stack([poses, s])  # (n, 4)
        self.at = 0
        self.held: int | None = None
        self.blocked = False
        self.turning, self.reopens = False, reopens

    def advance(self, pose: Array, maximum: float = 0.4) -> float:
        """Move along, at most so far [m], to where the pose is; the distance [m] between both."""
        if self.held is not None:
            rows = self.rows[: self.held + 1]
            self.at, distance = match(pose[0], pose[1], pose[2], rows, self.held, math.inf)
            return float(distance)
        first = int(np.searchsorted(self.rows[:, S], self.way - 0.2))
        self.at, distance = match(pose[0], pose[1], pose[2], self.rows, first, self.way + maximum)
        return float(distance)

    @property
    def way(self) -> float:
        """Distance [m] that the chair has covered along it."""
        return float(self.rows[self.at, S])

    @property
    def left(self) -> float:
        """Distance [m] to the end."""
        return float(self.rows[-1, S]) - self.way

    @property
    def ended(self) -> bool:
        """Whether the chair has come to the end."""
        return self.left < 0.1

    def ahead(self, pose: Array, distance: float = 2.5) -> Array:
        """The reference poses (m, 4) of the next `distance` metres, in the chair's frame."""
        ends = np.searchsorted(self.rows[:, S], [self.way - 0.1, self.way + distance])
        part = self.rows[min(ends[0], self.at) : ends[1] + 1].copy()
        part[:, :2] = to_frame(part[:, :2], pose)
        part[:, YAW] -= pose[2]
        return part
