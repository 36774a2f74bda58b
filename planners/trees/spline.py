"""Spline-RRT*: the path of a tree made into a smooth curve, tested as the polyline it returns."""

from __future__ import annotations

import math
from dataclasses import replace
from time import perf_counter

import numpy as np
from numpy.typing import NDArray

from planners.collision.polygon_tests import SpaceArrays, way_free
from planners.problem import Plan, PlannerBase, Problem, Status
from planners.trees.variants import InformedRrtStar
from wheelchair_gym.compiled.kernel import borrowing_kernel, inlined
from wheelchair_gym.config import setting, settings

Array = NDArray[np.float64]


@inlined
def _edge(path: Array, i: int) -> tuple[float, float, float]:
    """Edge i of a path (n, 2): its components and its length [m]."""
    dx, dy = path[i + 1, 0] - path[i, 0], path[i + 1, 1] - path[i, 1]
    return dx, dy, math.hypot(dx, dy)


@borrowing_kernel
def _write_tangents(path: Array, out: Array) -> None:
    """The unit tangent at each point of a path (n, 2): the bisector of its two edges there."""
    n = path.shape[0]
    for i in range(n):
        ux = uy = 0.0
        for k in range(max(i - 1, 0), min(i + 1, n - 1)):
            dx, dy, edge = _edge(path, k)
            ux, uy = ux + dx / edge, uy + dy / edge
        size = math.hypot(ux, uy)
        out[i, 0] = ux / size if size > 0.0 else 0.0  # a way straight goal_tree has none
        out[i, 1] = uy / size if size > 0.0 else 0.0


@borrowing_kernel
def _append_curve(
    path: Array,
    directions: Array,
    i: int,
    tangent_length: float,
    tolerance: float,
    out: Array,
    count: int,
) -> int:
    """Add edge i to `out`: a cubic Hermite curve, its tangents `tangent_length` long [m].

    A polyline of n equal pieces errs by at most |p''| / (8 n^2); p'' is linear, so that its ends
    bound it. Returns how many points there are then.
    """
    dx, dy, _ = _edge(path, i)
    ux, uy = tangent_length * directions[i, 0], tangent_length * directions[i, 1]
    vx, vy = tangent_length * directions[i + 1, 0], tangent_length * directions[i + 1, 1]
    bend = max(
        math.hypot(6.0 * dx - 4.0 * ux - 2.0 * vx, 6.0 * dy - 4.0 * uy - 2.0 * vy),
        math.hypot(6.0 * dx - 2.0 * ux - 4.0 * vx, 6.0 * dy - 2.0 * uy - 4.0 * vy),
    )
    n = 1
    if tangent_length > 0.0:
        n = max(math.ceil(math.sqrt(bend / (8.0 * tolerance))), 1)
    for k in range(1, n):
        t = k / n
        s = 1.0 - t
        a, b, c = t * s * s, t * t * s, t * t * (3.0 - 2.0 * t)
        out[count, 0] = path[i, 0] + a * ux - b * vx + c * dx
        out[count, 1] = path[i, 1] + a * uy - b * vy + c * dy
        count += 1
    out[count, 0], out[count, 1] = path[i + 1, 0], path[i + 1, 1]
    return count + 1


@borrowing_kernel
def _all_free(space: SpaceArrays, points: Array, first: int, end: int) -> bool:
    """Whether the edges that end in the points from the first on are free."""
    for k in range(first, end):
        if not way_free(space, points[k - 1, 0], points[k - 1, 1], points[k, 0], points[k, 1]):
            return False
    return True


@borrowing_kernel
def _max_points(path: Array, tangent_scale: float, tolerance: float) -> int:
    """How many points the curve through a path has at most."""
    most = 1
    for i in range(path.shape[0] - 1):
        edge = _edge(path, i)[2]
        most += math.ceil(math.sqrt(6.0 * (1.0 + tangent_scale) * edge / (8.0 * tolerance))) + 1
    return most


@borrowing_kernel
def _smooth(
    space: SpaceArrays,
    path: Array,
    directions: Array,
    tangent_scale: float,
    halvings: int,
    tolerance: float,
    out: Array,
) -> tuple[int, int]:
    """Write `smooth`'s polyline; returns how many points it has, and how many straight edges."""
    _write_tangents(path, directions)
    count, straight = 1, 0
    out[0, 0], out[0, 1] = path[0, 0], path[0, 1]
    for i in range(path.shape[0] - 1):
        tangent_length = tangent_scale * _edge(path, i)[2]
        for trial in range(halvings + 1):
            if trial == halvings:
                tangent_length = 0.0
                straight += 1
            end = _append_curve(path, directions, i, tangent_length, tolerance, out, count)
            if tangent_length == 0.0 or _all_free(space, out, count, end):
                count = end
                break
            tangent_length *= 0.5
    return count, straight


def smooth(
    space: SpaceArrays, path: Array, tangent_scale: float, halvings: int, tolerance: float
) -> tuple[Array, int]:
    """A curve through the points of a free path, as a free polyline, and its straight edges.

    Args:
        space: what is free.
        path: points (n, 2) [m], all edges free, no two in a row the same.
        tangent_scale: length of the tangents, in lengths of the edge; 1 is Catmull and Rom's.
        halvings: how often a edge that is not free may halve its tangents before it is straight.
        tolerance: how far the polyline may lie from the curve [m].
    """
    out = np.empty((_max_points(path, tangent_scale, tolerance), 2))
    count, straight = _smooth(
        space, path, np.empty_like(path), tangent_scale, halvings, tolerance, out
    )
    return out[:count], straight


@settings
class SplineRrtStar(PlannerBase):
    """Spline-RRT*: an RRT* path that is executed as a spline (Yu et al. 2018, with other splines).

    Each edge of the tree's path becomes a cubic Hermite curve whose direction at a vertex bisects
    the edges there, so that the direction never jumps. Where the curve is not free its tangents are
    halved, which draws it towards the edge; `straight_legs` counts those that had to stay straight.
    The path is the curve's polyline, within `tolerance`, and every edge of it is tested exactly.
    """

    tree: InformedRrtStar = setting(
        default=InformedRrtStar(iterations=2_000), source="design choice"
    )
    """The tree search."""
    tangent_scale: float = setting(default=1.0, low=0.0, high=3.0, source="Catmull and Rom 1974")
    """Length of the tangents, in lengths of the edge."""
    halvings: int = setting(
        default=8, low=0, source="design choice: tangents of 1/256 bend invisibly"
    )
    """How often blocked curves halve their tangents before they are straight."""
    tolerance: float = setting(
        default=1e-3, unit="m", low=1e-9, source="design choice: below the noise of sensors"
    )
    """Largest distance of the polyline from the curve."""

    def solve(self, problem: Problem, rng: np.random.Generator, end: float) -> Plan:
        """Answer a problem with a smooth free path; a deadline is the tree's."""
        began = perf_counter()
        plan = self.tree.solve(problem, rng, end)
        if plan.status != Status.SOLVED or plan.length == 0.0:
            return plan
        tree_s = perf_counter() - began
        path, straight = smooth(
            problem.free.arrays, plan.path, self.tangent_scale, self.halvings, self.tolerance
        )
        counters = {**plan.counters, "straight_legs": straight}
        return replace(plan, path=path, counters=counters, timings={"tree_s": tree_s})
