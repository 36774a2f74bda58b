"""Exact tracking of a plan where it turns or reverses close to obstacles.

A follower that chooses among sampled twists leaves such a manoeuvre by some centimetres, which are
all that there is beside the chair. There `ManoeuvreTracker` drives the planned poses themselves,
one stretch (ahead, in reverse, a turn in place) after another; a follower drives everywhere else.
"""

import math
from typing import TYPE_CHECKING

import numpy as np

from agents.control.rollout import SPACING, YAW, ReferencePath, S, X, Y, match
from wheelchair_gym.base.arrays import Array
from wheelchair_gym.geometry.outline import clearance_to_points
from wheelchair_gym.geometry.planar import relative_pose, to_frame

if TYPE_CHECKING:
    from agents.control.followers import Follower, Situation


TIGHT = 0.10  # m between the planned outline and what is seen, below which turns are tracked
LOOK = 1.2  # m of way ahead, within which a tight turn makes the chair track its plan
TURNING = 0.8  # rad a metre of way, of which a turn in place has 2.5: sharper is a turn
REACH = 0.3  # m of way along the plan, where the chair may be a period later
PAST = 0.2  # m of way behind the chair that still count as here
MIN_STEP = 1e-3  # m: a shorter step of a plan is a turn in place
SIDE, HEADING = 0.10, 0.35  # m and rad off the plan, up to which the chair tracks it
ACTORS = 2.5  # m: with an actor nearer, the follower decides
CRUISE = 0.25  # m/s within a manoeuvre
SLOWING = 0.3  # m/s2 before one,
RAMP = 0.4  # s after it has begun to brake, since its jerk is limited
TURN_RATE = 0.5  # rad/s of a turn in place
TURN_SLOWING = 0.8  # rad/s2 before its end
MIN_LEFT = 0.003  # rad to its end, at least, so that it comes there
TURN_SHARE = 0.8  # of the turn limit, at most, while it drives
SLOWEST = 0.03  # m/s before a stretch ends
JERK = 0.6  # m/s3 with which a stretch ends
LATENCY = 0.15  # s between a command and the motion
ENDS, TURN_ENDS = 0.01, 0.025  # m and rad from the end of a stretch, where the next one begins
STIFFNESS = 25.0  # 1/m2: curvature for a metre beside the plan, critically damped
KEEP = 0.8  # 1/s: speed for a metre off the place of a turn
KEEP_SPEED = 0.05  # m/s at most
HELD = 0.2  # s for which a twist is held before the stop that must be clear
SHARES = (1.0, 0.6, 0.35)  # of a twist, the first that is clear


class ManoeuvreTracker:
    """Drives the poses of a plan where it turns close to obstacles; else what its follower says.

    It writes `at`, `held` and `blocked` of the reference path.

    Args:
        follower: drives everywhere else.
        margin: clearance [m] that the outline keeps where it can.
    """

    def __init__(self, follower: "Follower", margin: float) -> None:
        self._follower, self._margin = follower, margin
        self._of: ReferencePath | None = None  # what the next three are of
        self._rows = np.empty((0, 4))  # with headings that do not jump
        self._kinds = np.empty(0)  # (n - 1,) of steps from row to row: 1 ahead, -1 back, 0 turn
        self._turns = np.empty(0, np.bool_)  # (n - 1,) steps that are turns, or lead back

    def twist(self, now: "Situation") -> Array | None:
        """See `Follower.twist`."""
        reference = now.reference
        reference.held = None
        if reference.planned_headings:
            if reference is not self._of:
                self._prepare(reference)
            twist, reference.blocked = self._tracked(now), False
            if twist is not None:
                return twist
            reference.blocked, reference.held = reference.held is not None, None
        return self._follower.twist(now)

    def _prepare(self, reference: ReferencePath) -> None:
        self._of, rows = reference, reference.rows.copy()
        rows[:, YAW] = np.unwrap(rows[:, YAW])
        self._rows, steps = rows, np.diff(rows, axis=0)
        middle = rows[:-1, YAW] + 0.5 * steps[:, YAW]
        way = steps[:, X] * np.cos(middle) + steps[:, Y] * np.sin(middle)
        self._kinds = np.where(np.abs(way) > MIN_STEP, np.sign(way), 0.0)
        self._turns = np.abs(steps[:, YAW]) > TURNING * steps[:, S]
        self._turns |= self._kinds < 0.0

    def _tracked(self, now: "Situation") -> Array | None:
        """The twist (2,) that tracks the plan; None where nothing is tight, or it is not clear."""
        local_map, reference, _ = now
        actors = local_map.actors
        if len(actors) and np.hypot(actors[:, 0], actors[:, 1]).min() < ACTORS:
            return None
        to_turn = self._way_to_tight_turn(now)
        if to_turn is None:
            return None
        row = reference.at
        while True:
            end = self._end(row)
            row, side, turned, left = self._place(local_map.pose, row, end)
            done = left < (ENDS if self._kinds[min(row, end - 1)] else TURN_ENDS)
            if not done or end == len(reference.rows) - 1:
                break
            row = end
        if abs(side) > SIDE or abs(turned) > HEADING:
            return None
        reference.held = reference.at = row
        kind = self._kinds[min(row, end - 1)]
        v, w = (
            self._turn(now, end, left)
            if kind == 0.0
            else self._drive(now, row, end, side, turned, left, to_turn)
        )
        if v < 0.0 and local_map.blind:
            return None
        return now.first_clear(((share * v, share * w) for share in SHARES), self._margin, HELD)

    def _way_to_tight_turn(self, now: "Situation") -> float | None:
        """Distance [m] along the path to the first turn; None where there is no tight one near."""
        local_map, reference, _ = now
        way, rows = reference.way, reference.rows
        first, last = np.searchsorted(rows[:, S], [way - PAST, way + LOOK])
        near = first + np.flatnonzero(self._turns[first:last])
        if not len(near):
            return None
        pose, points, outline = local_map.pose, local_map.points, local_map.outline
        for x, y, yaw in relative_pose(pose, rows[near, :3]):
            if clearance_to_points(x, y, yaw, outline, points, TIGHT) < TIGHT:
                return max(0.0, float(rows[near[0], S]) - way)
        return None

    def _end(self, row: int) -> int:
        """The last row of the stretch that begins, or goes on, at a row."""
        if row >= len(self._kinds):
            return len(self._kinds)
        other = np.flatnonzero(self._kinds[row:] != self._kinds[row])
        return row + int(other[0]) if len(other) else len(self._kinds)

    def _place(self, pose: Array, row: int, end: int) -> tuple[int, float, float, float]:
        """Locate a pose on the stretch from a row to its end.

        Returns:
            The row, how far the pose is to the left of the plan [m] and turned [rad], and how far
            it is to the end [m; of a turn: rad].
        """
        rows, kind = self._rows, self._kinds[min(row, end - 1)]
        if kind == 0.0:
            row, _ = match(pose[0], pose[1], pose[2], rows[: end + 1], row, rows[row, S] + REACH)
        else:  # by place alone: a chair that turns too late is as far along
            last = min(end + 1, int(np.searchsorted(rows[:, S], rows[row, S] + REACH)))
            row += int(np.argmin(np.hypot(*(rows[row : max(last, row + 1), :2] - pose[:2]).T)))
        along, side, turned = relative_pose(rows[row, :3], pose).tolist()
        if kind == 0.0:
            left = rows[end, YAW] - rows[row, YAW] - turned
            return row, side, 0.0, left * math.copysign(1.0, rows[end, YAW] - rows[end - 1, YAW])
        turned -= self._curvature(row, end) * along
        past, _ = to_frame(pose[:2], rows[end, :3])
        return row, side, turned, -kind * float(past)

    def _curvature(self, row: int, end: int) -> float:
        """Turn a metre of signed way [1/m] of the plan just after a row."""
        k = max(0, min(row, end - 1))
        step = self._rows[k + 1] - self._rows[k]
        way = math.hypot(step[X], step[Y]) * self._kinds[k]
        return float(step[YAW] / way) if self._kinds[k] else 0.0

    def _turn(self, now: "Situation", end: int, left: float) -> tuple[float, float]:
        """The twist that turns in place, so far [rad], and keeps the place."""
        pose, body = now.local_map.pose, now.chair.body
        row = self._rows[end]
        sign = math.copysign(1.0, row[YAW] - self._rows[end - 1, YAW])
        left -= LATENCY * sign * body.state[2]
        w = sign * min(TURN_RATE, math.sqrt(2.0 * TURN_SLOWING * max(left, MIN_LEFT)))
        ahead = math.cos(pose[2]) * (row[X] - pose[0]) + math.sin(pose[2]) * (row[Y] - pose[1])
        return float(np.clip(KEEP * ahead, -KEEP_SPEED, KEEP_SPEED)), w

    def _drive(
        self, now: "Situation", row: int, end: int, side: float, turned: float, left: float,
        to_turn: float,
    ) -> tuple[float, float]:  # fmt: skip
        """The twist along a stretch that is not a turn in place."""
        rows, limits, speed = self._rows, now.chair.limits, abs(now.chair.body.state[0])
        kind = self._kinds[min(row, end - 1)]
        left, to_turn = (max(0.0, way - RAMP * speed) for way in (left, to_turn))
        v = min(math.sqrt(CRUISE**2 + 2.0 * SLOWING * to_turn), limits.forward)
        if end < len(self._kinds):
            v = min(v, max(SLOWEST, (JERK * left**2) ** (1.0 / 3.0)))
        v = min(v, limits.backward) if kind < 0.0 else v
        ahead = int(np.searchsorted(rows[:, S], rows[row, S] + 0.5 * SPACING + LATENCY * speed))
        curvature = self._curvature(max(row, min(ahead, end - 1)), end)
        bend = kind * (curvature - STIFFNESS * side) - 2.0 * math.sqrt(STIFFNESS) * turned
        maximum = TURN_SHARE * limits.turn
        v = min(v, maximum / abs(bend)) if abs(bend) * v > maximum else v
        return kind * v, bend * v
