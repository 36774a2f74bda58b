"""Manoeuvres on request: through a door, or up to a desk, on a planned way, while the stick asks.

Who holds the stick forward, towards a door or, low, towards a thing straight ahead, asks for the
manoeuvre. The lattice planner plans it among the obstacles around, for the exact outline and
without reversing. The chair follows the plan as fast as the stick says, at most, until it is there,
or the stick is centred, goes back, or points elsewhere. Everywhere else the stick is the twist.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from agents.people import assistant
from planners.collision.space import Space
from planners.lattice.lattice import Lattice
from planners.problem import Problem, Status
from wheelchair_gym.base.arrays import Array
from wheelchair_gym.base.settings import settings
from wheelchair_gym.geometry.kinematics import arc_step
from wheelchair_gym.geometry.planar import arc_lengths, compose, relative_pose, wrap

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
        self._pose = compose(self._pose, motion)

    def _goal(self, now: assistant.AssistInput, wanted: float) -> tuple[Array, bool] | None:
        """The pose (3,) in the chair's frame that the stick asks for, and whether it is docking."""
        limits, (v, w) = self._mission.limits, now.asked
        front = self._mission.chair.footprint.front
        low = math.hypot(v / limits.forward, w / limits.turn) <= DOCK_STICK
        ahead = assistant.find_front(now.points, front, DOCK_REACH) if low else None
        if ahead is not None and abs(ahead[1]) < DOCK_ANGLE and abs(wanted) < ANGLE:
            far, yaw = ahead
            away = front + DOCK_GAP
            return np.array([far - away * math.cos(yaw), -away * math.sin(yaw), yaw]), True
        best, minimum = None, math.inf
        for x, y, yaw, gap in assistant.find_doors(
            now.points, self._mission.chair.footprint.half_width
        ):
            bearing, far = math.atan2(y, x), math.hypot(x, y)
            off = abs(wrap(bearing - wanted))
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
            path = compose(self._pose, plan.path)
            self._plan = _Plan(path, arc_lengths(path), goal[1])

    def _next(self, now: assistant.AssistInput) -> assistant.Twist | None:
        """The twist on the plan; None where it is over or the chair has left it."""
        assert self._plan is not None
        path, along, docks = self._plan
        local = relative_pose(self._pose, path)
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
