"""Gaps of the footprint at poses and along stretches, and the base of planners for it."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from planners.collision.footprint import Sweeps, stretch_gap, sweep, sweeps
from planners.collision.nearby import Nearby, segments_in_view
from planners.collision.polygon_tests import clearance
from planners.problem import Plan, PlannerBase, Problem, Status, check
from wheelchair_gym.arrays import Array
from wheelchair_gym.compiled.kernel import borrowing_kernel, kernel
from wheelchair_gym.config import settings
from wheelchair_gym.geometry import Footprint
from wheelchair_gym.kinematics import Limits, arc_step
from wheelchair_gym.maps.driving_cost import DrivingCost, MotionCost

TESTED_LENGTH = 0.3  # m: longer stretches are tested in pieces, each from its own beginning


@borrowing_kernel
def free_gap(
    near: Nearby, motion: MotionCost, x: float, y: float, yaw: float, way: float, turn: float,
    workspace: Sweeps, seen: Array,
) -> float:  # fmt: skip
    """Return the minimum gap [m] of a stretch, at most the desired clearance.

    It is exact only above the margin.
    """
    pieces = max(1, math.ceil(abs(way) / TESTED_LENGTH))
    gap = motion.desired_clearance
    part, bend = way / pieces, turn / pieces
    sweep(workspace, 0, part, bend, motion.outline)
    for k in range(pieces):
        ax, ay, ayaw = arc_step(x, y, yaw, way, turn, k / pieces)
        if not (near.box[0] <= ax <= near.box[2] and near.box[1] <= ay <= near.box[3]):
            return 0.0
        count = segments_in_view(near, ax, ay, ayaw, workspace.box[0], gap, seen)
        gap = stretch_gap(workspace, 0, motion.outline, seen, count, gap, motion.margin)
        if gap < motion.margin:
            break
    return gap


@kernel
def gaps_at(near: Nearby, motion: MotionCost, poses: Array, workspace: Sweeps) -> Array:
    """Return gaps (n,) [m] of the outline at poses (n, 3), at most the desired clearance."""
    seen, gaps = np.empty_like(near.segments), np.empty(poses.shape[0])
    for k in range(poses.shape[0]):
        x, y, yaw = poses[k]
        gaps[k] = free_gap(near, motion, x, y, yaw, 0.0, 0.0, workspace, seen)
    return gaps


def start_and_goal(problem: Problem) -> tuple[Array, Array]:
    """Return the start (3,) and the goal (2,) or (3,); a start without heading has heading 0."""
    start = np.zeros(3)
    start[: len(problem.start)] = problem.start
    return start, np.array(problem.goal, dtype=np.float64)


def with_headings(goal: Array, count: int) -> Array:
    """Return the pose (1, 3) at a goal (3,), or `count` headings (count, 3) at a goal (2,)."""
    if len(goal) == 3:
        return goal[None]
    yaws = np.arange(count) * (2.0 * math.pi / count)
    return np.column_stack([np.tile(goal, (count, 1)), yaws])


MIN_GAP = 2e-6  # m: least gap of the outline, above rounding errors and those of tiny turns
YAWS = 360  # headings tried at a goal without heading
# Share of the gap to keep at a start that is nearer to a wall than the margin.
START_GAP_SHARE = 0.98


def goal_poses(near: Nearby, motion: MotionCost, goal: Array, most: int) -> Array:
    """Return poses (n, 3) at a goal; without a heading, about `most` of those that fit."""
    poses = with_headings(goal, YAWS)
    if len(goal) == 2:
        poses = poses[gaps_at(near, motion, poses, sweeps(1)) >= motion.margin]
    return poses[:: max(1, len(poses) // most)]


@settings
class FootprintPlanner(DrivingCost, PlannerBase):
    """A planner of poses (n, 3) for the chair's rectangle.

    The rectangle keeps the problem's clearance less half its width. A start without heading has
    heading 0; a goal without heading allows any.
    """

    footprint: Footprint = Footprint()
    limits: Limits = Limits()

    def trivial(self, problem: Problem) -> Plan | None:
        """Return a plan if the axle cannot stand at an end; the rectangle is tested later."""
        status = check(replace(problem, clearance=0.0 * problem.clearance))  # NaN stays NaN
        return None if status is None else Plan(status)

    def fit(
        self, problem: Problem, near: Nearby, curvature_weight: float = 0.0
    ) -> tuple[Status | None, MotionCost]:
        """Return why the rectangle does not fit at an end, or None, and the cost of its motion.

        The cost has a margin that fits. The boundary `near` reaches beyond the rectangle.
        """
        margin = max(MIN_GAP, problem.clearance - self.footprint.half_width)
        motion = self.motion_cost(self.footprint, self.limits, margin, curvature_weight)
        start, goal = start_and_goal(problem)
        workspace = sweeps(1)
        if clearance(problem.space.arrays, *start[:2]) < margin:
            return Status.START_OCCUPIED, motion  # at the axle already
        gap = float(gaps_at(near, motion._replace(margin=MIN_GAP), start[None], workspace)[0])
        if gap < MIN_GAP:
            return Status.START_OCCUPIED, motion
        if gap < margin:  # it may leave with the gap that it has
            motion = motion._replace(margin=START_GAP_SHARE * gap)
        smaller = motion
        if len(goal) == 2:  # a smaller outline covers the headings between those tried
            less = 2.0 * self.footprint.reach * math.sin(0.5 * math.pi / YAWS)
            smaller = motion._replace(outline=motion.outline - less)
        gaps = gaps_at(near, smaller, with_headings(goal, YAWS), workspace)
        return Status.GOAL_OCCUPIED if (gaps < motion.margin).all() else None, motion
