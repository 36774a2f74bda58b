"""Assistants that hold a belief over a person's goals: `Blend`, `Hindsight` and `Hypotheses`.

The belief follows Bayes' rule: a person's stick is the likelier, the less it costs on the way to
its goal beside the best twist there is (maximum-entropy inverse control, Javdani 2015; Dragan and
Srinivasa 2013). Each chooses among twists near the stick's (`fan`) that the chair could follow.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.spatial.distance import cdist

from agents.people.assistant import AssistInput, AssistMission, SharedAssistant, Twist
from agents.people.targets import find_targets
from wheelchair_gym.base.arrays import Array
from wheelchair_gym.base.settings import setting, settings
from wheelchair_gym.compiled.kernel import borrowing_kernel
from wheelchair_gym.geometry.kinematics import arc_step
from wheelchair_gym.geometry.planar import to_frame, to_world
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
LOOK_AHEAD = 1.5  # s for which `hypotheses` predicts a collision


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

    def __init__(self, config: Believing) -> None:
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
            before = to_frame(to_world(self._targets, self._pose), now.reading.pose)
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
        hits = now.free_share(goals.mission, now.asked, LOOK_AHEAD) < 1.0
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
