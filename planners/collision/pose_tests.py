"""Gaps of the footprint at poses and along stretches, and whether it fits at both ends."""

from __future__ import annotations

import math

import numpy as np

from planners.collision.footprint import Sweeps, stretch_gap, sweep, sweeps
from planners.collision.nearby import Nearby, segments_in_view
from planners.collision.polygon_tests import clearance
from planners.problem import Problem, Status
from wheelchair_gym.arrays import Array
from wheelchair_gym.compiled.kernel import borrowing_kernel, kernel
from wheelchair_gym.geometry import Footprint
from wheelchair_gym.kinematics import arc_step
from wheelchair_gym.maps.driving_cost import MotionCost

TESTED_LENGTH = 0.3  # m: longer stretches are tested in pieces, each from its own beginning


@borrowing_kernel
def free_gap(
    near: Nearby, motion: MotionCost, x: float, y: float, yaw: float, way: float, turn: float,
    workspace: Sweeps, seen: Array,
) -> float:  # fmt: skip
    """Least gap [m] of a stretch, at most the desired clearance; exact only above the margin."""
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
    """Gaps (n,) [m] of the outline at poses (n, 3), at most the desired clearance."""
    seen, gaps = np.empty_like(near.segments), np.empty(poses.shape[0])
    for k in range(poses.shape[0]):
        x, y, yaw = poses[k]
        gaps[k] = free_gap(near, motion, x, y, yaw, 0.0, 0.0, workspace, seen)
    return gaps


MIN_GAP = 2e-6  # m: least gap of the outline, above rounding errors and those of tiny turns
YAWS = 360  # headings tried at a goal without heading
START_GAP_SHARE = (
    0.98  # share of the gap to keep at a start that is nearer to a wall than the margin
)


def fit_ends(
    problem: Problem, footprint: Footprint, near: Nearby, motion: MotionCost
) -> tuple[Status | None, MotionCost]:
    """Why the outline does not fit at an end, or None; and the cost with a margin that fits.

    A start without heading has heading 0. The space's boundary `near` reaches beyond the outline.
    """
    start, goal = start_and_goal(problem)
    workspace = sweeps(1)
    if clearance(problem.space.arrays, *start[:2]) < motion.margin:
        return Status.START_OCCUPIED, motion  # at the axle already
    gap = float(gaps_at(near, motion._replace(margin=MIN_GAP), start[None], workspace)[0])
    if gap < MIN_GAP:
        return Status.START_OCCUPIED, motion
    if gap < motion.margin:  # it may leave with the gap that it has
        motion = motion._replace(margin=START_GAP_SHARE * gap)
    poses, smaller = goal[None], motion
    if len(goal) == 2:  # a smaller outline covers the headings between those tried
        yaws = np.arange(YAWS) * (2.0 * math.pi / YAWS)
        poses = np.column_stack([np.tile(goal, (YAWS, 1)), yaws])
        less = 2.0 * footprint.reach * math.sin(0.5 * math.pi / YAWS)
        smaller = motion._replace(outline=motion.outline - less)
    if (gaps_at(near, smaller, poses, workspace) < motion.margin).all():
        return Status.GOAL_OCCUPIED, motion
    return None, motion


def start_and_goal(problem: Problem) -> tuple[Array, Array]:
    """The start (3,) and the goal (2,) or (3,) of a problem; a start without heading has 0."""
    start = np.zeros(3)
    start[: len(problem.start)] = problem.start
    return start, np.array(problem.goal, dtype=np.float64)


def goal_poses(near: Nearby, motion: MotionCost, goal: Array, most: int) -> Array:
    """Poses (n, 3) at a goal; where it has no heading, about `most` of the headings that fit."""
    if len(goal) == 3:
        return goal[None]
    yaws = np.arange(YAWS) * (2.0 * math.pi / YAWS)
    poses = np.column_stack([np.tile(goal, (YAWS, 1)), yaws])
    poses = poses[gaps_at(near, motion, poses, sweeps(1)) >= motion.margin]
    return poses[:: max(1, len(poses) // most)]
