"""The cost of a path of a swarm: its terms, and the objectives that weigh them.

`OBJECTIVES` names the cost functions of the sources. Each tests edges exactly; `faithful` keeps
the tests of its source, sound or not.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from planners.collision.polygon_tests import SpaceArrays, edge_free, point_free
from planners.collision.solids import DISC_SIDES
from planners.smoothing.curves import CurveWorkspace, new_curve_workspace, sample_curve
from wheelchair_gym.base.arrays import Array
from wheelchair_gym.base.settings import setting, settings
from wheelchair_gym.compiled.kernel import borrowing_kernel
from wheelchair_gym.geometry.planar import point_segment_distance

LENGTH, ENERGY, PRINTED_ENERGY = range(3)  # measures of a path's size
NO_TURNING, MEAN_TURNING, PRINTED_TURNING = range(3)
EDGES, WAY_POINTS, NOTHING = range(3)  # objects of the collision test

_TINY = 1e-12  # m: keeps a leg without length from dividing by zero


class PathProblem(NamedTuple):
    """A problem as a swarm of paths sees it."""

    space: SpaceArrays  # the free space of a point
    discs: Array  # (m, 3) x, y, radius [m]: the round obstacles, exactly
    start: Array  # (2,) m
    goal: Array  # (2,) m
    anchors: Array  # (n, 2) m: way points are these plus a position's coordinates
    curve: int  # through the way points: see `planners.smoothing.curves`
    chordal: bool  # its knots as far apart as the way points are
    pieces: int  # straight pieces of each leg


class PathCost(NamedTuple):
    """The terms of a cost; by default the length of the curve.

    cost = turning
         + weight x size x (1 + violation x mean intrusion + blocked_factor x [any edge blocked])
         + blocked_edge_cost x blocked edges
    """

    # LENGTH: of the curve [m]; ENERGY: sqrt(legs x sum of squared legs) [m] of the way points,
    # the length where all legs are as long; PRINTED_ENERGY: sqrt(sum of squared legs) [m].
    length_measure: int = LENGTH
    weight: float = 1.0  # cost per metre of size
    # MEAN_TURNING: mean absolute angle [rad] between legs; PRINTED_TURNING: P1 (5).
    turning: int = NO_TURNING
    violation_range: float = 0.0  # factor of discs' radii in intrusions; 0: no intrusions
    points_only: bool = False  # intrusions at the curve's points alone, not along its pieces
    violation: float = 0.0  # factor of the mean intrusion, as a part of the radius
    collision_test: int = EDGES
    blocked_factor: float = 0.0  # part of the size that being blocked costs
    blocked_edge_cost: float = 0.0
    push: bool = False  # way points leave discs before they are evaluated
    slack: float = 0.0  # m^2, added to a disc's squared radius there


class PathWorkspace(NamedTuple):
    """Arrays for one path."""

    points: Array  # (n + 2, 2) way points and both ends
    curve: CurveWorkspace
    line: Array  # pieces of the curve


def new_workspace(problem: PathProblem) -> PathWorkspace:
    """Return arrays for paths of a problem."""
    n = len(problem.anchors) + 2
    line = np.empty(((n - 1) * problem.pieces + 1, 2))
    return PathWorkspace(np.empty((n, 2)), new_curve_workspace(n), line)


@borrowing_kernel
def write_way_points(problem: PathProblem, position: Array, points: Array) -> None:
    """Write start, way points and goal (n + 2, 2) of a position (2 n,)."""
    n = problem.anchors.shape[0]
    points[0, 0], points[0, 1] = problem.start[0], problem.start[1]
    for i in range(n):
        points[i + 1, 0] = problem.anchors[i, 0] + position[2 * i]
        points[i + 1, 1] = problem.anchors[i, 1] + position[2 * i + 1]
    points[n + 1, 0], points[n + 1, 1] = problem.goal[0], problem.goal[1]


@borrowing_kernel
def write_curve(problem: PathProblem, position: Array, workspace: PathWorkspace) -> None:
    """Write the way points and the line of a position (2 n,)."""
    points = workspace.points
    write_way_points(problem, position, points)
    sample_curve(
        problem.curve, problem.chordal, points, problem.pieces, workspace.curve, workspace.line
    )


@borrowing_kernel
def path_sizes(points: Array) -> tuple[float, float]:
    """Return the length [m] of a polyline (n, 2), and the root of the sum of squares: R1's loss."""
    length = squares = 0.0
    for i in range(points.shape[0] - 1):
        dx, dy = points[i + 1, 0] - points[i, 0], points[i + 1, 1] - points[i, 1]
        length, squares = length + math.hypot(dx, dy), squares + (dx * dx + dy * dy)
    return length, math.sqrt(squares)


@borrowing_kernel
def mean_turning(points: Array) -> float:
    """Return the mean absolute angle [rad] between successive legs; 0 for a single leg."""
    total, n = 0.0, len(points)
    for i in range(n - 2):
        ux, uy = points[i + 1, 0] - points[i, 0], points[i + 1, 1] - points[i, 1]
        vx, vy = points[i + 2, 0] - points[i + 1, 0], points[i + 2, 1] - points[i + 1, 1]
        total += abs(math.atan2(ux * vy - uy * vx, ux * vx + uy * vy))
    return total / max(1, n - 2)


@borrowing_kernel
def printed_turning(points: Array) -> float:
    """Return the smoothness of P1 (1)-(5) as printed; A is the next leg, B the distance beyond it.

    (A^2 + B^2) / (2 A B) lacks the third side of the law of cosines: it is no cosine of an angle.
    """
    total, n = 0.0, len(points)
    for i in range(n - 2):
        A = math.hypot(points[i + 1, 0] - points[i, 0], points[i + 1, 1] - points[i, 1])
        B = math.hypot(points[i + 2, 0] - points[i, 0], points[i + 2, 1] - points[i, 1])
        total += (A * A + B * B) / (2.0 * max(A * B, _TINY))
    return total / (n - 1)


@borrowing_kernel
def intrusion(discs: Array, line: Array, reach: float, sampled: bool) -> float:
    """Return the sum over discs of the mean of max(reach - D / R, 0): P2 (19)-(21).

    D is the distance [m] of a disc's centre from a point of the line, or from a piece of it.
    """
    total, count = 0.0, len(line) if sampled else len(line) - 1
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
    workspace: PathWorkspace,
) -> tuple[float, float]:
    """Return the cost of a position (2 n,), and its cost without penalties if its path is valid.

    The second is infinite for an invalid path. Tests end as soon as the cost reaches `limit` and
    the path cannot cost less than `valid_limit` without penalties; then the costs returned are
    bounds that are not below the limits. The workspace's line is the position's afterwards.
    """
    points, line = workspace.points, workspace.line
    n, m = points.shape[0], line.shape[0]
    write_curve(problem, position, workspace)
    if terms.length_measure == LENGTH:
        size, _ = path_sizes(line)
    else:
        _, size = path_sizes(points)
        if terms.length_measure == ENERGY:
            size *= math.sqrt(n - 1.0)
    size *= terms.weight
    cost = size
    if terms.turning == MEAN_TURNING:
        cost += mean_turning(points)
    elif terms.turning == PRINTED_TURNING:
        cost += printed_turning(points)
    plain = cost
    if cost >= limit and plain >= valid_limit:
        return cost, math.inf
    valid = True
    if terms.violation_range > 0.0:
        deep = intrusion(problem.discs, line, terms.violation_range, terms.points_only)
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
    problem: PathProblem, terms: PathCost, position: Array, fixed: NDArray[np.bool_]
) -> int:
    """Push way points out of discs, mark the others fixed (2 n,), return the number inside.

    Each moves by its vector from the disc's centre, as R1 prints it.
    """
    inside = 0
    for i in range(problem.anchors.shape[0]):
        x = problem.anchors[i, 0] + position[2 * i]
        y = problem.anchors[i, 1] + position[2 * i + 1]
        dx, dy = 0.0, 0.0
        for k in range(problem.discs.shape[0]):
            ux, uy = x - problem.discs[k, 0], y - problem.discs[k, 1]
            square = problem.discs[k, 2] ** 2 + terms.slack
            if ux * ux + uy * uy <= square:
                dx += ux
                dy += uy
        position[2 * i] += dx
        position[2 * i + 1] += dy
        pushed = dx != 0.0 or dy != 0.0
        fixed[2 * i], fixed[2 * i + 1] = not pushed, not pushed
        inside += pushed
    return inside


# Cost factor of a blocked path ("considerable" in P1 (7)) and of the mean violation (Yarpiz, whose
# program P2 follows).
PENALTY = 100.0
VIOLATION_RANGE = 1.2  # radii from a centre up to which a disc is violated: P2 (20)
# The same for exact segments: pi^2 / 2 n^2, the corners of the polygon of a disc.
EXACT_RANGE = 1.0 + 5.0 / DISC_SIDES**2
BLOCKED_COST = 100.0  # m: an edge inside weighs more than all lengths on a map
SLACK = 1.0  # m^2, added to the square of a radius: R1, section 5.3


@settings
class FaithfulOption:
    """The choice between our exact tests and those of an objective's source."""

    faithful: bool = setting(default=False, source="exact tests; true: the source's own")
    """Whether the source's own tests replace the exact ones."""


@settings
class LengthFree:
    """Weighted length and number of blocked edges: the thesis, section 2.8."""

    shortness_weight: float = setting(
        default=10.0, unit="1/m", low=0.0, source="thesis, figure 3.1"
    )
    """Cost of length."""
    collision_free_weight: float = setting(
        default=1e4, low=0.0, source="above all lengths on a map; thesis: 1"
    )
    """Cost of each blocked edge."""

    @property
    def path_cost(self) -> PathCost:
        """The terms of the cost."""
        return PathCost(weight=self.shortness_weight, blocked_edge_cost=self.collision_free_weight)


@settings
class Smooth(FaithfulOption):
    """Smoothness, length and validity: P1 (8), f1 + f2 (1 + f3).

    f1 is the mean absolute turning angle [rad] of the way points, f2 the length [m] of the curve,
    f3 the penalty where any of its edges is blocked. Faithful: f1 is (5) with (3) as printed, and
    only way points are tested.
    """

    @property
    def path_cost(self) -> PathCost:
        """The terms of the cost."""
        return PathCost(
            turning=PRINTED_TURNING if self.faithful else MEAN_TURNING,
            collision_test=WAY_POINTS if self.faithful else EDGES,
            blocked_factor=PENALTY,
        )


@settings
class Violation(FaithfulOption):
    """Length of the curve, times one and the violation of round obstacles: P2 (18)-(21).

    The violation is the mean over the curve of max(1.2 - D / R, 0), with D from the
    curve's pieces; blocked edges have a cost. Faithful: D is from sampled points, and nothing else
    is tested.
    """

    @property
    def path_cost(self) -> PathCost:
        """The terms of the cost."""
        return PathCost(
            violation_range=VIOLATION_RANGE,
            points_only=self.faithful,
            violation=PENALTY,
            collision_test=NOTHING if self.faithful else EDGES,
            blocked_edge_cost=0.0 if self.faithful else BLOCKED_COST,
        )


@settings
class WayPoints(FaithfulOption):
    """R1's loss, the root of the sum of squared legs.

    Ours is in metres, the length where all legs are as long, and adds P2's violation along the
    exact segments. Faithful: as printed; only way points are tested, and one that falls into a disc
    (d^2 <= r^2 + 1) is pushed out and drawn again.
    """

    @property
    def path_cost(self) -> PathCost:
        """The terms of the cost."""
        if self.faithful:
            return PathCost(PRINTED_ENERGY, collision_test=NOTHING, push=True, slack=SLACK)
        return PathCost(
            length_measure=ENERGY,
            violation_range=EXACT_RANGE,
            violation=PENALTY,
            blocked_edge_cost=BLOCKED_COST,
        )
