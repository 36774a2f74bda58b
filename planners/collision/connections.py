"""Stretches that an outline drives freely, and connections from pose to pose.

A connection is at most three stretches: pivot, straight and pivot, or two arcs that meet in one
direction (Bolton 1975, Biarc curves), each ahead or back.
"""

from __future__ import annotations

import math

import numpy as np

from planners.collision.footprint import Sweeps, stretch_gap, sweep, sweeps
from planners.collision.nearby import Nearby, segments_in_view
from planners.collision.polygon_tests import clearance
from planners.problem import Problem, Status
from wheelchair_gym.arrays import Array
from wheelchair_gym.compiled.kernel import borrowing_kernel, kernel
from wheelchair_gym.geometry import Footprint, wrap
from wheelchair_gym.kinematics import arc_step
from wheelchair_gym.maps.driving_cost import STILL, MotionCost

PIECE = 0.3  # m: longer stretches are tested in pieces, each from its own beginning


@borrowing_kernel
def free_gap(
    near: Nearby, motion: MotionCost, x: float, y: float, yaw: float, way: float, turn: float,
    workspace: Sweeps, seen: Array,
) -> float:  # fmt: skip
    """Least gap [m] of a stretch, at most the desired clearance; exact only above the margin."""
    pieces = max(1, math.ceil(abs(way) / PIECE))
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


CONNECTIONS = 4  # kinds of them


@borrowing_kernel
def connection(
    kind: int, x: float, y: float, yaw: float, tx: float, ty: float, tyaw: float
) -> tuple[bool, float, float, float, float, float]:
    """A connection to a target pose: whether there is one, and its three stretches.

    They are a way [m] with a turn [rad], another, and a turn in place. Of the kinds 0 and 2 lead
    ahead, 1 and 3 back; 0 and 1 are arcs, 2 and 3 turn in place. A NaN heading is free.
    """
    dx, dy = tx - x, ty - y
    far, towards = math.hypot(dx, dy), wrap(math.atan2(dy, dx) - yaw)
    back = kind % 2 == 1
    sign = -1.0 if back else 1.0
    a, b = 0.0, 0.0  # ways
    s, t, u = 0.0, 0.0, 0.0  # turns
    none = (False, 0.0, 0.0, 0.0, 0.0, 0.0)
    aim = wrap(towards + math.pi) if back else towards
    if kind >= 2:  # pivot, straight, pivot
        if far > STILL:
            s, b = aim, sign * far
        u = 0.0 if math.isnan(tyaw) else wrap(tyaw - yaw - s)
        return True, a, s, b, t, u
    if far <= STILL:
        return none
    if math.isnan(tyaw):  # one arc
        if abs(aim) > 0.5 * math.pi:
            return none
        half = aim
        a = sign * far * (half / math.sin(half) if abs(half) > STILL else 1.0)
        s = 2.0 * half
        return True, a, s, b, t, u
    # two arcs
    c0, s0 = math.cos(yaw), math.sin(yaw)
    c1, s1 = math.cos(tyaw), math.sin(tyaw)
    vt = dx * (c0 + c1) + dy * (s0 + s1)
    less = 2.0 - 2.0 * (c0 * c1 + s0 * s1)  # 4 - |t0 + t1|^2
    square = dx * dx + dy * dy
    if less > 1e-9:
        root = math.sqrt(vt * vt + less * square)
        d = (-vt + sign * root) / less
    elif sign * vt > 1e-9:
        d = 0.5 * square / vt
    else:
        return none
    if sign * d < STILL:
        return none
    mx, my = 0.5 * (dx + d * (c0 - c1)), 0.5 * (dy + d * (s0 - s1))
    first = math.hypot(mx, my)
    half = wrap(math.atan2(my, mx) - yaw + (math.pi if back else 0.0))
    middle = yaw + 2.0 * half
    last = math.hypot(dx - mx, dy - my)
    other = wrap(math.atan2(dy - my, dx - mx) - middle + (math.pi if back else 0.0))
    if abs(half) > 0.5 * math.pi or abs(other) > 0.5 * math.pi:
        return none
    a = sign * first * (half / math.sin(half) if abs(half) > STILL else 1.0)
    b = sign * last * (other / math.sin(other) if abs(other) > STILL else 1.0)
    s, t = 2.0 * half, 2.0 * other
    return True, a, s, b, t, u


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
