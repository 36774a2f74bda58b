"""The exact minimum gap between a moving rectangular footprint and a map's boundary.

A stretch is a motion with a constant rate of turn: straight, an arc, or a pivot. In the chair's
frame at its beginning the rectangle turns about one point (or moves along x). The gap to a segment
is least where a corner's arc comes nearest to it, or where one of its ends comes nearest to the
rectangle; either happens at an end of the stretch or in one of a few directions. From top to
bottom: stretches, gaps at poses and along stretches on a map, and the base of planners of poses.
"""

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from planners.collision.nearby import Nearby, segments_in_view
from planners.collision.polygon_tests import clearance
from planners.problem import Plan, PlannerBase, Problem, Status, check
from wheelchair_gym.base.arrays import Array
from wheelchair_gym.base.settings import settings
from wheelchair_gym.compiled.kernel import absorbed_kernel, borrowing_kernel, kernel
from wheelchair_gym.geometry.kinematics import Limits, arc_step
from wheelchair_gym.geometry.outline import Footprint, rectangle_point_gap, rectangle_segment_gap
from wheelchair_gym.geometry.planar import point_segment_distance
from wheelchair_gym.maps.driving_cost import DrivingCost, MotionCost

STRAIGHT = 1e-6  # rad: a stretch that turns less counts as straight, and is within 1e-6 of it


class Sweeps(NamedTuple):
    """Stretches (m of them) in the chair's frame at their beginning, and what they sweep."""

    way: Array  # (m,) m, backwards below 0
    turn: Array  # (m,) rad, to the left above 0
    box: Array  # (m, 4) m: xmin, ymin, xmax, ymax around all that is swept
    long: Array  # (m, 3) m: front, rear, half width of the rectangle swept by a straight one
    centre: Array  # (m,) m: y of the point turned about; its x is 0
    rotation: Array  # (m, 2) cosine and sine of the turn
    first: Array  # (m, 4, 2) m: corners as seen from the centre, where their arc begins...
    last: Array  # (m, 4, 2) ... and ends, counter-clockwise
    radius: Array  # (m, 4) m
    around: Array  # (m, 4, 4) m: boxes around the corners' arcs, in the chair's frame


def sweeps(count: int) -> Sweeps:
    """Return arrays for `count` stretches; `sweep` writes them."""
    shapes = ((), (), (4,), (3,), (), (2,), (4, 2), (4, 2), (4,), (4, 4))
    return Sweeps(*(np.zeros((count, *shape)) for shape in shapes))


@borrowing_kernel
def _between(ax: float, ay: float, bx: float, by: float, wide: bool, dx: float, dy: float) -> bool:
    """Return whether a direction d lies on the left turn from a to b; `wide`: beyond pi."""
    if wide:
        return bx * dy - by * dx <= 0.0 or dx * ay - dy * ax <= 0.0
    return ax * dy - ay * dx >= 0.0 and dx * by - dy * bx >= 0.0


@borrowing_kernel
def sweep(sweeps: Sweeps, m: int, way: float, turn: float, outline: Array) -> None:
    """Write stretch m; it turns by less than a full turn."""
    front, rear, half = outline[0], outline[1], outline[2]
    straight = abs(turn) < STRAIGHT
    sweeps.way[m], sweeps.turn[m] = way, 0.0 if straight else turn
    low_x, low_y, high_x, high_y = -rear, -half, front, half
    if straight:
        low_x, high_x = low_x + min(way, 0.0), high_x + max(way, 0.0)
    else:
        cy = way / turn
        c, s = math.cos(turn), math.sin(turn)
        sweeps.centre[m], sweeps.rotation[m, 0], sweeps.rotation[m, 1] = cy, c, s
        for k in range(4):
            x, y = (front if k < 2 else -rear), (half if k % 2 == 0 else -half) - cy
            ax, ay, bx, by = x, y, c * x - s * y, s * x + c * y
            if turn < 0.0:
                ax, ay, bx, by = bx, by, ax, ay
            sweeps.first[m, k, 0], sweeps.first[m, k, 1] = ax, ay
            sweeps.last[m, k, 0], sweeps.last[m, k, 1] = bx, by
            radius = math.hypot(x, y)
            sweeps.radius[m, k] = radius
            wide = abs(turn) > math.pi
            left = -radius if _between(ax, ay, bx, by, wide, -1.0, 0.0) else min(ax, bx)
            right = radius if _between(ax, ay, bx, by, wide, 1.0, 0.0) else max(ax, bx)
            low = -radius if _between(ax, ay, bx, by, wide, 0.0, -1.0) else min(ay, by)
            high = radius if _between(ax, ay, bx, by, wide, 0.0, 1.0) else max(ay, by)
            around = sweeps.around[m, k]
            around[0], around[1], around[2], around[3] = left, low + cy, right, high + cy
            low_x, low_y = min(low_x, around[0]), min(low_y, around[1])
            high_x, high_y = max(high_x, around[2]), max(high_y, around[3])
    box, long = sweeps.box[m], sweeps.long[m]
    box[0], box[1], box[2], box[3] = low_x, low_y, high_x, high_y
    long[0], long[1], long[2] = high_x, -low_x, half


@borrowing_kernel
def _apart(box: Array, px: float, py: float, qx: float, qy: float, gap: float) -> bool:
    """Return whether the box of a segment is a gap or more away from another, along x or y."""
    return bool(
        min(px, qx) - box[2] >= gap
        or box[0] - max(px, qx) >= gap
        or min(py, qy) - box[3] >= gap
        or box[1] - max(py, qy) >= gap
    )


@borrowing_kernel
def _end_gap(sweeps: Sweeps, m: int, px: float, py: float, outline: Array, enough: float) -> float:
    """Return the minimum gap between a rectangle that turns about a centre and a point.

    The gap is at most `enough`. Seen from the chair the point turns back. It comes nearest at the
    ends of its arc, in line with a corner, or opposite the side towards the centre; or it crosses
    a side.
    """
    front, rear, half = outline[0], outline[1], outline[2]
    cy, c, s = sweeps.centre[m], sweeps.rotation[m, 0], sweeps.rotation[m, 1]
    gap = min(enough, rectangle_point_gap(px, py, outline))
    bx, by = px, py - cy
    ax, ay = c * bx + s * by, c * by - s * bx
    gap = min(gap, rectangle_point_gap(ax, ay + cy, outline))
    if sweeps.turn[m] < 0.0:
        ax, ay, bx, by = bx, by, ax, ay
    wide = abs(sweeps.turn[m]) > math.pi
    square = px * px + (py - cy) * (py - cy)
    radius = math.sqrt(square)
    for k in range(4):
        x, y = (front if k < 2 else -rear), (half if k % 2 == 0 else -half) - cy
        far = sweeps.radius[m, k]
        if radius - far < gap and _between(ax, ay, bx, by, wide, x, y):
            part = radius / far
            gap = min(gap, rectangle_point_gap(part * x, cy + part * y, outline))
    if abs(cy) > half and _between(ax, ay, bx, by, wide, 0.0, -cy):
        gap = min(gap, rectangle_point_gap(0.0, cy - math.copysign(radius, cy), outline))
    if gap <= 0.0:
        return 0.0
    for k in range(4):  # where its circle crosses the lines along the sides
        level = (front, -rear, half - cy, -half - cy)[k]
        if level * level >= square:
            continue
        aside = math.sqrt(square - level * level)
        for sign in (-1.0, 1.0):
            x, y = (level, sign * aside) if k < 2 else (sign * aside, level)
            inside = abs(y + cy) <= half if k < 2 else -rear <= x <= front
            if inside and _between(ax, ay, bx, by, wide, x, y):
                return 0.0
    return gap


@borrowing_kernel
def _corner_gap(
    sweeps: Sweeps, m: int, k: int, px: float, py: float, qx: float, qy: float, enough: float
) -> float:
    """Return the minimum gap between the arc of a corner k and a segment, at most `enough`."""
    cy, radius = sweeps.centre[m], sweeps.radius[m, k]
    ux, uy, vx, vy = px, py - cy, qx, qy - cy
    ex, ey = vx - ux, vy - uy
    length = math.hypot(ex, ey)
    if length == 0.0:
        return enough
    nx, ny = -ey / length, ex / length
    off = nx * ux + ny * uy
    if off < 0.0:
        nx, ny, off = -nx, -ny, -off
    if off - radius >= enough:
        return enough
    ax, ay = sweeps.first[m, k, 0], sweeps.first[m, k, 1]
    bx, by = sweeps.last[m, k, 0], sweeps.last[m, k, 1]
    wide = abs(sweeps.turn[m]) > math.pi
    gap = min(enough, point_segment_distance(ax, ay, ux, uy, vx, vy))
    gap = min(gap, point_segment_distance(bx, by, ux, uy, vx, vy))
    if radius <= off:
        along = (radius * nx - ux) * ex + (radius * ny - uy) * ey
        if 0.0 <= along <= length * length and _between(ax, ay, bx, by, wide, nx, ny):
            gap = min(gap, off - radius)
        return gap
    aside = math.sqrt(radius * radius - off * off)
    for sign in (-1.0, 1.0):  # where the circle crosses the segment's line
        hx, hy = off * nx - sign * aside * ny, off * ny + sign * aside * nx
        along = (hx - ux) * ex + (hy - uy) * ey
        if 0.0 <= along <= length * length and _between(ax, ay, bx, by, wide, hx, hy):
            return 0.0
    return gap


@borrowing_kernel
def stretch_gap(
    sweeps: Sweeps, m: int, outline: Array, segments: Array, count: int, enough: float, below: float
) -> float:
    """Return the minimum gap [m] along stretch m, at most `enough`; 0 if something is touched.

    `segments` (n, 4) [m], `count` of them, are the boundary in the chair's frame at the beginning:
    each end of a segment that matters is the first end of one of them, or of one farther than
    `enough`. A gap below `below` ends the search; then any gap below it is returned.
    """
    gap = enough
    straight = sweeps.turn[m] == 0.0
    box, long = sweeps.box[m], sweeps.long[m]
    for k in range(count):
        px, py, qx, qy = segments[k, 0], segments[k, 1], segments[k, 2], segments[k, 3]
        if _apart(box, px, py, qx, qy, gap):
            continue
        if straight:  # what is swept is a longer rectangle
            gap = min(gap, rectangle_segment_gap(0.0, 0.0, 0.0, long, px, py, qx, qy))
        else:
            if not _apart(box, px, py, px, py, gap):
                gap = _end_gap(sweeps, m, px, py, outline, gap)
            for corner in range(4):
                if not _apart(sweeps.around[m, corner], px, py, qx, qy, gap):
                    gap = _corner_gap(sweeps, m, corner, px, py, qx, qy, gap)
        if gap < below or gap <= 0.0:
            return gap
    return gap


TESTED_LENGTH = 0.3  # m: longer stretches are tested in pieces, each from its own beginning


Pose = tuple[float, float, float]  # x, y [m], yaw [rad]


class Surroundings(NamedTuple):
    """A footprint, the boundary near it, and workspace of its tests."""

    near: Nearby
    motion: MotionCost
    sweeps: Sweeps  # one stretch
    seen: Array  # (segments, 4)


def surroundings(near: Nearby, motion: MotionCost) -> Surroundings:
    """Return what tests of a footprint on a map need."""
    return Surroundings(near, motion, sweeps(1), np.empty_like(near.segments))


@absorbed_kernel
def swept_gap(around: Surroundings, pose: Pose, enough: float) -> float:
    """Return the minimum gap [m] along the stretch in `sweeps` from a pose on, at most `enough`.

    It is exact only above the margin, and 0 at a pose outside of the map.
    """
    near, motion, swept = around.near, around.motion, around.sweeps
    x, y, yaw = pose
    if not (near.box[0] <= x <= near.box[2] and near.box[1] <= y <= near.box[3]):
        return 0.0
    count = segments_in_view(near, x, y, yaw, swept.box[0], enough, around.seen)
    return stretch_gap(swept, 0, motion.outline, around.seen, count, enough, motion.margin)


@borrowing_kernel
def free_gap(around: Surroundings, pose: Pose, way: float, turn: float) -> float:
    """Return the minimum gap [m] of a stretch, at most the desired clearance; see `swept_gap`."""
    motion, (x, y, yaw) = around.motion, pose
    pieces = max(1, math.ceil(abs(way) / TESTED_LENGTH))
    gap = motion.desired_clearance
    sweep(around.sweeps, 0, way / pieces, turn / pieces, motion.outline)
    for k in range(pieces):
        gap = swept_gap(around, arc_step(x, y, yaw, way, turn, k / pieces), gap)
        if gap < motion.margin:
            break
    return gap


@kernel
def gaps_at(around: Surroundings, poses: Array) -> Array:
    """Return gaps (n,) [m] of the outline at poses (n, 3), at most the desired clearance."""
    gaps = np.empty(poses.shape[0])
    for k in range(poses.shape[0]):
        gaps[k] = free_gap(around, (poses[k, 0], poses[k, 1], poses[k, 2]), 0.0, 0.0)
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


def goal_poses(around: Surroundings, goal: Array, maximum: int) -> Array:
    """Return poses (n, 3) at a goal; without a heading, about `maximum` of those that fit."""
    poses = with_headings(goal, YAWS)
    if len(goal) == 2:
        poses = poses[gaps_at(around, poses) >= around.motion.margin]
    return poses[:: max(1, len(poses) // maximum)]


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
        if clearance(problem.space.arrays, *start[:2]) < margin:
            return Status.START_OCCUPIED, motion  # at the axle already
        around = surroundings(near, motion._replace(margin=MIN_GAP))
        gap = float(gaps_at(around, start[None])[0])
        if gap < MIN_GAP:
            return Status.START_OCCUPIED, motion
        if gap < margin:  # it may leave with the gap that it has
            motion = motion._replace(margin=START_GAP_SHARE * gap)
        smaller = motion
        if len(goal) == 2:  # a smaller outline covers the headings between those tried
            less = 2.0 * self.footprint.reach * math.sin(0.5 * math.pi / YAWS)
            smaller = motion._replace(outline=motion.outline - less)
        gaps = gaps_at(around._replace(motion=smaller), with_headings(goal, YAWS))
        return Status.GOAL_OCCUPIED if (gaps < motion.margin).all() else None, motion
