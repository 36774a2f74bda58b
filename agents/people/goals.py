"""Assistants that know where a person may want to go: by a belief over goals, or on request.

`Blend`, `Hindsight` and `Hypotheses` hold a belief. It follows Bayes' rule: a person's stick is the
likelier, the less it costs on the way to its goal beside the best twist there is (maximum-entropy
inverse control, Javdani 2015; Dragan and Srinivasa 2013). Each chooses among twists near the
stick's (`fan`) that the chair could follow.

`Manoeuvre` leads through a door, or up to a desk, on a planned way. Who holds the stick forward,
towards a door or, low, towards a thing straight ahead, asks for it. The lattice planner plans it
among the obstacles around, for the exact outline and without reversing. The chair follows the plan
as fast as the stick says, at most, until it is there, or the stick is centred, goes back, or points
elsewhere. Everywhere else the stick is the twist.
"""

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.spatial.distance import cdist

from agents.people import assistant
from agents.people.assistant import AssistInput, AssistMission, SharedAssistant, Twist, find_targets
from planners.collision.space import Space
from planners.lattice.lattice import Lattice
from planners.problem import Problem, Status
from wheelchair_gym.base.arrays import Array
from wheelchair_gym.base.settings import setting, settings
from wheelchair_gym.compiled.kernel import borrowing_kernel
from wheelchair_gym.geometry import planar
from wheelchair_gym.geometry.kinematics import arc_step
from wheelchair_gym.people.assistance.methods import (
    CLEAR,
    SPEEDS,
    STEP,
    STEPS,
    TURNS,
    follow_arc,
    time_to_stop,
)
from wheelchair_gym.people.assistance.state import Sharing

SAME = 0.6  # m: a target so near one of before is the same
FORGET = 0.2  # 1/s, a choice: the belief returns to an even one, as people change their minds
AHEAD = 0.4  # m before the axle, where distances are measured, so that headings count
RATE = 6.0  # evidence for each second of a stick that costs a second more than the best twist
HORIZON = 1.0  # s for which a twist is followed to see what it costs
TIMID, SURE = 0.3, 0.8  # beliefs from which on the share of `blend` rises, and is largest
CLEARANCE_COST = 0.3  # s that a twist of `hindsight` costs on whose way the chair touches something
ENOUGH = 0.10  # m: clearance that costs nothing; less while somebody docks
CONFIDENCE = 0.4  # belief in a target from which on `hypotheses` helps
MISS = 0.4  # s that the stick may cost more than the best twist before `hypotheses` helps
PREDICTED = 1.5  # s for which `hypotheses` predicts a collision


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


@borrowing_kernel
def _ends(twists: Array, horizon: float, ahead: float, out: Array) -> None:
    """Compute the position of a point ahead of the axle after twists (n, 2 or more)."""
    for k in range(twists.shape[0]):
        x, y, yaw = arc_step(0.0, 0.0, 0.0, twists[k, 0], twists[k, 1], horizon)
        out[k, 0], out[k, 1] = x + ahead * math.cos(yaw), y + ahead * math.sin(yaw)


class Goals:
    """Goals that a person may have, and how far each is believed in: the method of an assistant.

    Attributes:
        config: settings of the assistant, which decide.
        mission: the chair.
        belief: (k,) of each goal; they sum to 1.
    """

    def __init__(self, config: "Believing") -> None:
        self.config = config

    def reset(self, mission: AssistMission) -> None:
        """Know no goal."""
        self.mission = mission
        self._targets: Array = np.empty((0, 2))
        self.belief: Array = np.empty(0)
        self._pose: Array | None = None

    def twist(self, now: AssistInput) -> Twist:
        """See `Method.twist`."""
        twists = fan(self.mission, now)
        return self.config.choose(self, now, twists, self.update(now, twists))

    def update(self, now: AssistInput, twists: Array) -> Array:
        """Update the belief by the stick; the costs (n, k) [s] of twists (n, 2) to each goal."""
        mission = self.mission
        self._take_scan(now)
        asked = np.array([now.asked])
        rows = np.vstack([asked, np.zeros((1, 2)), twists[:, :2]])
        ends = np.empty((len(rows), 2))
        _ends(rows, HORIZON, AHEAD, ends)
        every = cdist(ends, self._targets) / mission.limits.forward  # (n + 2, k) s
        over = np.minimum(every[0] - every.min(axis=0), 10.0)
        belief = self.belief * np.exp(-RATE * mission.period * over)
        share = min(1.0, FORGET * mission.period)
        belief = (1.0 - share) * belief / belief.sum() + share / len(belief)
        self.belief = belief / belief.sum()
        return np.asarray(every[2:])

    def _take_scan(self, now: AssistInput) -> None:
        """Find goals anew; each inherits the belief in the one of before that it is."""
        found = find_targets(now.points, self.mission.chair.footprint.front)
        belief = np.full(len(found), 1.0)
        if len(self._targets) and self._pose is not None:
            before = planar.to_frame(planar.to_world(self._targets, self._pose), now.reading.pose)
            apart = cdist(found, before)
            nearest = apart.argmin(axis=1)
            same = apart[np.arange(len(found)), nearest] < SAME
            belief = np.where(same, self.belief[nearest], self.belief.mean())
        self._targets, self.belief = found, belief / belief.sum()
        self._pose = now.reading.pose.copy()


@settings
class Believing(Sharing):
    """Settings of an assistant that holds a belief over a person's goals."""

    def make(self) -> SharedAssistant:
        """Make a fresh assistant."""
        return SharedAssistant(Goals(self), self.freedom)

    def choose(self, goals: Goals, now: AssistInput, twists: Array, costs: Array) -> Twist:
        """The twist [m/s, rad/s], by the costs (n, k) [s] of safe twists (n, 3) to each goal."""
        raise NotImplementedError


@settings
class Blend(Believing):
    """Mixes the stick with a safe twist towards the likeliest goal.

    Policy blending: the stick and the twist towards the likely goal, mixed by confidence.
    Source: Dragan and Srinivasa 2013: u = (1 - a) u_h + a u_r(g*), where the share a grows with the
    confidence in the likeliest goal g*. Two safe twists may blend into an unsafe one: the shield
    filters afterwards.
    """

    max_share: float = setting(
        default=0.6, low=0.0, high=1.0, source="Dragan 2013: timid to aggressive"
    )
    """Largest share of the robot."""

    def choose(self, goals: Goals, now: AssistInput, twists: Array, costs: Array) -> Twist:
        """See `Believing.choose`."""
        if now.asked[0] < 0.0:  # a person who backs is manoeuvring, not driving to a goal
            return nearest(twists, now.asked, goals.mission)
        likely = int(np.argmax(goals.belief))
        ramp = (float(goals.belief[likely]) - TIMID) / (SURE - TIMID)
        share = self.max_share * min(1.0, max(0.0, ramp))
        if share == 0.0 or not len(twists):
            return now.asked
        best = twists[cheapest(costs[:, likely])]
        v, w = (1.0 - share) * np.array(now.asked) + share * best[:2]
        return float(v), float(w)


@settings
class Hindsight(Believing):
    """Minimises the expected cost to go over the goals, and the distance from the stick.

    Hindsight optimisation: the twist that is best on average over all goals believed in.
    Source: Javdani et al. 2015, 2018: the action of least expected cost, sum over goals g of
    b(g) Q_g(x, a, u), as if the goal were known from the next step on; Q_g is the cost to go after
    the twist and a price for leaving the stick. So it helps before any goal is certain.
    """

    stick: float = setting(default=4.0, unit="s", low=0.0, high=100.0)
    """Seconds that a twist off the stick's by full speed costs."""

    def choose(self, goals: Goals, now: AssistInput, twists: Array, costs: Array) -> Twist:
        """See `Believing.choose`."""
        # A person who backs is manoeuvring, not driving to a goal.
        if now.asked[0] < 0.0 or not len(twists):
            return nearest(twists, now.asked, goals.mission)
        expected = costs @ goals.belief
        expected += self.stick * scaled_distance(twists, now.asked, goals.mission)
        enough = ENOUGH * min(1.0, now.margin / max(self.freedom.margin, 1e-6))
        expected += CLEARANCE_COST * np.maximum(0.0, 1.0 - twists[:, 2] / max(enough, 1e-6))
        best = twists[cheapest(expected)]
        return float(best[0]), float(best[1])


@settings
class Hypotheses(Believing):
    """Takes over towards the likely target when the stick is predicted to miss it.

    Collaborative control: help only who is about to miss the likely target.
    Source: Carlson and Demiris 2012. Local targets carry a confidence that each reading updates.
    While the stick leads to the likeliest one, it is the twist. When it is predicted to miss that
    target, or to collide, a safe twist towards the target is taken instead.
    """

    def choose(self, goals: Goals, now: AssistInput, twists: Array, costs: Array) -> Twist:
        """See `Believing.choose`."""
        if not len(twists):
            return 0.0, 0.0
        hits = now.free_share(goals.mission, now.asked, PREDICTED) < 1.0
        likely = int(np.argmax(goals.belief))
        off = scaled_distance(twists, now.asked, goals.mission)
        best = cheapest(costs[:, likely] + 0.1 * off)
        same = cheapest(off)  # the stick's, or the nearest that is safe
        misses = costs[same, likely] - costs[best, likely] > MISS
        sure = float(goals.belief[likely]) >= CONFIDENCE
        if not (hits or (misses and sure)):
            return now.asked
        chosen = twists[best if sure else same]
        return float(chosen[0]), float(chosen[1])


SQUARE = 0.01  # m: half the side of the square that stands for a point of an obstacle
AROUND = 4.5  # m: half the side of the ground on which it plans
BEYOND = 1.0  # m behind a door where its manoeuvre ends
NEAR_END = 0.04  # m from the end where a manoeuvre is over
REACH = 2.5  # m: from which on a door counts
WIDEST = 1.25  # m: through wider doors people drive without help
ANGLE = 0.4  # rad: largest angle between the stick's direction and that of a door
DOCK_REACH = 1.0  # m from the chair's front, within which a thing ahead counts
DOCK_ANGLE = 0.3  # rad: largest angle between the chair and the way straight up to a thing
DOCK_STICK = 0.65  # deflection that asks to drive up to a thing, at most: more only drives on
DOCK_GAP = 0.10  # m before a thing where its manoeuvre ends; docking is 0.05 to 0.15 m, assumed
LOOK_AHEAD = 0.3  # m along the plan to the place that the chair steers to
ASTRAY = 0.10  # m from the plan, at which a new one is made
ITERATIONS = 3000  # poses that the planner expands at most


@settings
class Manoeuvre:
    """Follows a planned way through a door, or up to a desk, while the stick asks for it."""

    freedom: assistant.Freedom = assistant.Freedom(turn=1.0, backward=0.1)

    def make(self) -> assistant.SharedAssistant:
        """A fresh assistant."""
        return assistant.SharedAssistant(_Method(), self.freedom)


class _Plan(NamedTuple):
    """A way, in the frame of the odometry."""

    path: Array  # (n, 3) m, m, rad
    along: Array  # (n,) m from its beginning
    docks: bool


class _Method:
    def reset(self, mission: assistant.AssistMission) -> None:
        self._mission = mission
        self._planner = Lattice(
            footprint=mission.chair.footprint,
            limits=replace(mission.limits, backward=0.0),
            iterations=ITERATIONS,
            improvement=200,
        )
        self._pose, self._stamp = np.zeros(3), math.nan  # by odometry
        self._plan: _Plan | None = None
        self._wait = 0.0  # s until it may plan again

    def twist(self, now: assistant.AssistInput) -> assistant.Twist:
        self._follow_odometry(now)
        v, w = now.asked
        limits = self._mission.limits
        wanted = math.atan2(w / limits.turn, v / limits.forward)
        if v <= 0.0 or abs(wanted) > ANGLE + 0.5:
            self._plan, self._wait = None, 0.0
            return now.asked
        if self._plan is None and self._wait <= 0.0:
            self._begin(now, wanted)
        found = self._next(now) if self._plan is not None else None
        if found is None:
            return now.asked
        share = now.free_share(self._mission, found, 1.0)
        return share * found[0], share * found[1]

    def _follow_odometry(self, now: assistant.AssistInput) -> None:
        reading = now.reading
        since = 0.0 if math.isnan(self._stamp) else reading.stamp - self._stamp
        self._stamp, self._wait = reading.stamp, self._wait - since
        v, w = reading.twist.tolist()
        motion = np.array(arc_step(0.0, 0.0, 0.0, v, w, since))
        self._pose = planar.compose(self._pose, motion)

    def _goal(self, now: assistant.AssistInput, wanted: float) -> tuple[Array, bool] | None:
        """The pose (3,) in the chair's frame that the stick asks for, and whether it is docking."""
        limits, (v, w) = self._mission.limits, now.asked
        footprint = self._mission.chair.footprint
        low = math.hypot(v / limits.forward, w / limits.turn) <= DOCK_STICK
        ahead = assistant.find_front(now.points, footprint.front, DOCK_REACH) if low else None
        if ahead is not None and abs(ahead[1]) < DOCK_ANGLE and abs(wanted) < ANGLE:
            far, yaw = ahead
            away = footprint.front + DOCK_GAP
            return np.array([far - away * math.cos(yaw), -away * math.sin(yaw), yaw]), True
        best, minimum = None, math.inf
        for x, y, yaw, gap in assistant.find_doors(now.points, footprint.half_width):
            bearing, far = math.atan2(y, x), math.hypot(x, y)
            off = abs(planar.wrap(bearing - wanted))
            fits = gap < WIDEST and far < REACH and off < ANGLE
            if fits and abs(yaw) < 1.3 and x > 0.0:
                cost = off + 0.2 * far + gap
                if cost < minimum:
                    place = x + BEYOND * math.cos(yaw), y + BEYOND * math.sin(yaw), yaw
                    best, minimum = np.array(place), cost
        return None if best is None else (best, False)

    def _begin(self, now: assistant.AssistInput, wanted: float) -> None:
        """Plan what the stick asks for, if it asks for anything."""
        goal = self._goal(now, wanted)
        if goal is None or math.hypot(*goal[0][:2]) < NEAR_END:
            return
        self._wait = 1.0
        around = np.hstack([now.points - SQUARE, now.points + SQUARE])
        space = Space.from_rectangles(around, (-AROUND, -AROUND, AROUND, AROUND))
        half = self._mission.chair.footprint.half_width
        problem = Problem(space, np.zeros(3), goal[0], half + min(now.margin, 0.02))
        plan = self._planner.plan(problem, np.random.default_rng(0))
        if plan.status is Status.SOLVED and len(plan.path) > 1:
            path = planar.compose(self._pose, plan.path)
            self._plan = _Plan(path, planar.arc_lengths(path), goal[1])

    def _next(self, now: assistant.AssistInput) -> assistant.Twist | None:
        """The twist on the plan; None where it is over or the chair has left it."""
        assert self._plan is not None
        path, along, docks = self._plan
        local = planar.relative_pose(self._pose, path)
        off = np.hypot(*local[:, :2].T) + 0.2 * np.abs(local[:, 2])
        at = int(off.argmin())
        left = float(along[-1] - along[at])
        if math.hypot(*local[at, :2]) > ASTRAY:
            self._plan, self._wait = None, 0.0
            return None
        to = min(len(path) - 1, int(np.searchsorted(along, along[at] + LOOK_AHEAD)))
        x, y, yaw = local[to].tolist()
        if left < NEAR_END and abs(yaw) < 0.05:
            self._plan, self._wait = None, 2.0
            return None
        v, w = now.asked
        low, high = min(0.0, w) - now.turn, max(0.0, w) + now.turn
        if left < NEAR_END or x < 0.02:  # a turn in place
            return 0.0, min(high, max(low, 2.0 * yaw))
        if docks:
            v = min(v, max(0.08, left / 1.5))
        if left > 0.5 * LOOK_AHEAD:
            bend = 2.0 * y / (x * x + y * y)
        else:  # the heading counts at the end
            bend = (yaw + 2.0 * y / LOOK_AHEAD) / max(left, 0.1)
        maximum = high if bend > 0.0 else -low
        v = min(v, maximum / max(abs(bend), 1e-9))
        return v, v * bend
