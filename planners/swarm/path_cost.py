"""What a path is terms: one compiled cost with the terms of all objectives, exactly tested."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from planners.collision.polygon_tests import SpaceArrays, edge_free, point_free
from planners.smoothing.curves import CurveWorkspace, new_curve_workspace, sample_curve
from wheelchair_gym.compiled.kernel import borrowing_kernel
from wheelchair_gym.geometry import point_segment_distance

Array = NDArray[np.float64]

LENGTH, ENERGY, PRINTED_ENERGY = range(3)  # how a path's size is taken
NO_TURNING, MEAN_TURNING, PRINTED_TURNING = range(3)  # and its turning
EDGES, WAY_POINTS, NOTHING = range(3)  # what is tested against what is solid
NO_PUSH, TO_RIM, DOUBLED = range(3)  # how way points leave discs

_TINY = 1e-12  # m: keeps a leg without length from dividing by zero


class PathProblem(NamedTuple):
    """A problem as a swarm of paths sees it."""

    space: SpaceArrays  # what is free for a point
    discs: Array  # (m, 3) x, y, radius [m]: what of the solid is round, exactly
    start: Array  # (2,) m
    goal: Array  # (2,) m
    anchors: Array  # (n, 2) m: way points are these plus a position's coordinates
    curve: int  # through the way points: see `planners.smoothing.curves`
    chordal: bool  # its knots as far apart as the way points are
    pieces: int  # straight pieces of each leg


class PathCost(NamedTuple):
    """The terms of a cost.

    cost = turning + weight x size x (1 + violation x mean intrusion + blocked x [any edge blocked])
    + each_blocked x blocked edges
    """

    length_measure: (
        int  # LENGTH [m] of the curve; of the way points: ENERGY sqrt(legs x sum of squares) [m],
    )
    # which is the length where all legs are as long; PRINTED_ENERGY sqrt(sum of squares)
    weight: float  # cost per metre of size
    turning: (
        int  # NO_TURNING; MEAN_TURNING: mean absolute angle [rad] between legs; PRINTED: P1 (5)
    )
    violation_range: float  # discs' radii count times this in intrusions; 0: none are looked for
    points_only: bool  # intrusions at the curve's points alone, not along its pieces
    violation: float  # factor of the mean intrusion, as a part of the radius
    collision_test: int  # EDGES, WAY_POINTS or NOTHING
    blocked_factor: float  # part of the size that being blocked costs
    blocked_edge_cost: float  # cost of each blocked edge
    push: int  # NO_PUSH, TO_RIM, DOUBLED: way points are pushed out of discs before they are valued
    slack: float  # m^2 that are added to a disc's radius squared there


class Workspace(NamedTuple):
    """Room to value a path."""

    points: Array  # (n + 2, 2) way points and both ends
    curve: CurveWorkspace
    line: Array  # pieces of the curve


def new_workspace(way_points: int, pieces: int) -> Workspace:
    """Room for paths of so many way points."""
    n = way_points + 2
    return Workspace(np.empty((n, 2)), new_curve_workspace(n), np.empty(((n - 1) * pieces + 1, 2)))


@borrowing_kernel
def write_way_points(problem: PathProblem, position: Array, points: Array) -> int:
    """Write start, way points and goal (n + 2, 2) of a position (2 n,); returns how many."""
    n = problem.anchors.shape[0]
    points[0, 0], points[0, 1] = problem.start[0], problem.start[1]
    for i in range(n):
        points[i + 1, 0] = problem.anchors[i, 0] + position[2 * i]
        points[i + 1, 1] = problem.anchors[i, 1] + position[2 * i + 1]
    points[n + 1, 0], points[n + 1, 1] = problem.goal[0], problem.goal[1]
    return int(n) + 2


@borrowing_kernel
def polyline_length(points: Array, n: int) -> float:
    """Length [m] of a polyline of n points."""
    length = 0.0
    for i in range(n - 1):
        length += math.hypot(points[i + 1, 0] - points[i, 0], points[i + 1, 1] - points[i, 1])
    return length


@borrowing_kernel
def root_sum_of_squares(points: Array, n: int) -> float:
    """Root of the sum of squared legs [m]: R1's loss."""
    total = 0.0
    for i in range(n - 1):
        dx, dy = points[i + 1, 0] - points[i, 0], points[i + 1, 1] - points[i, 1]
        total += dx * dx + dy * dy
    return math.sqrt(total)


@borrowing_kernel
def mean_turning(points: Array, n: int) -> float:
    """Mean absolute angle [rad] between successive legs; 0 for a single leg."""
    total = 0.0
    for i in range(n - 2):
        ux, uy = points[i + 1, 0] - points[i, 0], points[i + 1, 1] - points[i, 1]
        vx, vy = points[i + 2, 0] - points[i + 1, 0], points[i + 2, 1] - points[i + 1, 1]
        total += abs(math.atan2(ux * vy - uy * vx, ux * vx + uy * vy))
    return total / max(1, n - 2)


@borrowing_kernel
def printed_turning(points: Array, n: int) -> float:
    """Smoothness as P1 (1)-(5) print it: A the next leg, B the way to the point after it.

    (A^2 + B^2) / (2 A B) lacks the third side of the law of cosines: it is no cosine of an angle.
    """
    total = 0.0
    for i in range(n - 2):
        A = math.hypot(points[i + 1, 0] - points[i, 0], points[i + 1, 1] - points[i, 1])
        B = math.hypot(points[i + 2, 0] - points[i, 0], points[i + 2, 1] - points[i, 1])
        total += (A * A + B * B) / (2.0 * max(A * B, _TINY))
    return total / (n - 1)


@borrowing_kernel
def intrusion(discs: Array, line: Array, n: int, reach: float, sampled: bool) -> float:
    """Sum over discs of the mean of max(reach - D / R, 0): P2 (19)-(21).

    D is the distance [m] of a disc's centre from a point of the line, or from a piece of it.
    """
    total, count = 0.0, n if sampled else n - 1
    for k in range(discs.shape[0]):
        x, y, radius = discs[k, 0], discs[k, 1], discs[k, 2]
        near = reach * radius
        for i in range(count):
            ax, ay = line[i, 0], line[i, 1]
            j = i if sampled else i + 1
            bx, by = line[j, 0], line[j, 1]
            if min(ax, bx) >= x + near or max(ax, bx) <= x - near:
                continue
            if min(ay, by) >= y + near or max(ay, by) <= y - near:
                continue
            gap = point_segment_distance(x, y, ax, ay, bx, by)
            if gap < near:
                total += reach - gap / radius
    return total / count


@borrowing_kernel
def evaluate(
    problem: PathProblem,
    terms: PathCost,
    position: Array,
    limit: float,
    valid_limit: float,
    workspace: Workspace,
) -> tuple[float, float]:
    """What a position costs, and what it costs if its path is exactly valid (infinity if not).

    Tests end as soon as the cost reaches `limit` and the path is of no use as the best valid one:
    then the costs returned are bounds that are not below the limits.

    Args:
        problem: the problem.
        terms: the terms of the cost.
        position: way points (2 n,).
        limit: costs above this need not be exact.
        valid_limit: the least cost of a valid path so far.
        workspace: for the path; its line is the position's afterwards.
    """
    points, line = workspace.points, workspace.line
    n = write_way_points(problem, position, points)
    m = sample_curve(
        problem.curve,
        problem.chordal,
        points,
        n,
        problem.pieces,
        workspace.curve,
        line,
    )
    if terms.length_measure == LENGTH:
        size = polyline_length(line, m)
    else:
        size = root_sum_of_squares(points, n)
        if terms.length_measure == ENERGY:
            size *= math.sqrt(n - 1.0)
    size *= terms.weight
    cost = size
    if terms.turning == MEAN_TURNING:
        cost += mean_turning(points, n)
    elif terms.turning == PRINTED_TURNING:
        cost += printed_turning(points, n)
    plain = cost
    if cost >= limit and plain >= valid_limit:
        return cost, math.inf
    valid = True
    if terms.violation_range > 0.0:
        deep = intrusion(problem.discs, line, m, terms.violation_range, terms.points_only)
        cost += size * terms.violation * deep
        valid = deep == 0.0
    if terms.collision_test == WAY_POINTS:
        for i in range(1, n - 1):
            if not point_free(problem.space, points[i, 0], points[i, 1]):
                cost += terms.blocked_edge_cost + size * terms.blocked_factor
                valid = False
                break
    blocked = 0
    counted = terms.collision_test == EDGES
    for j in range(m - 1):
        if (cost >= limit or not counted) and (plain >= valid_limit or blocked > 0 or not valid):
            return cost, math.inf
        if not edge_free(problem.space, line[j, 0], line[j, 1], line[j + 1, 0], line[j + 1, 1]):
            if counted:
                cost += terms.blocked_edge_cost
                if blocked == 0:
                    cost += size * terms.blocked_factor
            blocked += 1
    return cost, plain if valid and blocked == 0 else math.inf


@borrowing_kernel
def push_out_of_discs(
    problem: PathProblem, terms: PathCost, position: Array, held: NDArray[np.bool_]
) -> int:
    """Push way points out of discs, and hold (2 n,) the others; returns how many were inside.

    As printed in R1, the vector from a centre is added, which doubles it; ours ends on the rim.
    """
    inside = 0
    for i in range(problem.anchors.shape[0]):
        x, y = (
            problem.anchors[i, 0] + position[2 * i],
            problem.anchors[i, 1] + position[2 * i + 1],
        )
        dx, dy = 0.0, 0.0
        for k in range(problem.discs.shape[0]):
            ux, uy = x - problem.discs[k, 0], y - problem.discs[k, 1]
            square = problem.discs[k, 2] ** 2 + terms.slack
            if ux * ux + uy * uy <= square:
                share = 1.0
                if terms.push == TO_RIM:
                    share = math.sqrt(square) / max(_TINY, math.hypot(ux, uy)) - 1.0
                dx += share * ux
                dy += share * uy
        position[2 * i] += dx
        position[2 * i + 1] += dy
        pushed = dx != 0.0 or dy != 0.0
        held[2 * i], held[2 * i + 1] = not pushed, not pushed
        inside += pushed
    return inside
