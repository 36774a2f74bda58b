"""Spline-RRT*: the path of a tree made into a smooth curve, tested as the polyline it returns."""

from __future__ import annotations

import math
from dataclasses import replace
from time import perf_counter

import numpy as np
from numpy.typing import NDArray

from planners.exact import SpaceArrays, edge_free
from planners.trees.variants import InformedRrtStar
from planners.types import Plan, Problem, Status
from wheelchair_gym.config import setting, settings
from wheelchair_gym.kernel import borrowing_kernel, kernel

Array = NDArray[np.float64]


@borrowing_kernel
def _directions(path: Array, out: Array) -> None:
    """The unit tangent at each point of a path (n, 2): the bisector of its two legs there."""
    n = path.shape[0]
    for i in range(n):
        ux = uy = 0.0
        for k in range(max(i - 1, 0), min(i + 1, n - 1)):
            dx, dy = path[k + 1, 0] - path[k, 0], path[k + 1, 1] - path[k, 1]
            leg = math.hypot(dx, dy)
            ux, uy = ux + dx / leg, uy + dy / leg
        size = math.hypot(ux, uy)
        out[i, 0] = ux / size if size > 0.0 else 0.0  # a way straight back has none
        out[i, 1] = uy / size if size > 0.0 else 0.0


@borrowing_kernel
def _pieces(
    path: Array, directions: Array, i: int, stretch: float, tolerance: float, out: Array
) -> int:
    """Points of leg i, its first left out: a cubic Hermite curve, its tangents `stretch` long [m].

    A polyline of n equal pieces errs by at most |p''| / (8 n^2); p'' is linear, so that its ends
    bound it.
    """
    ax, ay, bx, by = path[i, 0], path[i, 1], path[i + 1, 0], path[i + 1, 1]
    ux, uy = stretch * directions[i, 0], stretch * directions[i, 1]
    vx, vy = stretch * directions[i + 1, 0], stretch * directions[i + 1, 1]
    bend = max(
        math.hypot(6.0 * (bx - ax) - 4.0 * ux - 2.0 * vx, 6.0 * (by - ay) - 4.0 * uy - 2.0 * vy),
        math.hypot(6.0 * (bx - ax) - 2.0 * ux - 4.0 * vx, 6.0 * (by - ay) - 2.0 * uy - 4.0 * vy),
    )
    n = min(max(math.ceil(math.sqrt(bend / (8.0 * tolerance))), 1), out.shape[0])
    if stretch == 0.0:
        n = 1
    for k in range(1, n + 1):
        t = k / n
        s = 1.0 - t
        a, u, v, b = s * s * (1.0 + 2.0 * t), t * s * s, -t * t * s, t * t * (3.0 - 2.0 * t)
        out[k - 1, 0] = a * ax + u * ux + v * vx + b * bx
        out[k - 1, 1] = a * ay + u * uy + v * vy + b * by
    out[n - 1, 0], out[n - 1, 1] = bx, by
    return int(n)


@kernel
def smooth(
    space: SpaceArrays, path: Array, reach: float, halvings: int, tolerance: float
) -> tuple[Array, int]:
    """A curve through the points of a free path (n, 2), as a free polyline, and its straight legs.

    Args:
        space: what is free.
        path: points [m], all edges free, no two in a row the same.
        reach: length of the tangents, in lengths of the leg; 1 is Catmull and Rom's.
        halvings: how often a leg that is not free may halve its tangents before it is straight.
        tolerance: how far the polyline may lie from the curve [m].
    """
    n = path.shape[0]
    directions, most = np.empty((n, 2)), 0
    _directions(path, directions)
    for i in range(n - 1):
        leg = math.hypot(path[i + 1, 0] - path[i, 0], path[i + 1, 1] - path[i, 1])
        most += math.ceil(math.sqrt(12.0 * (1.0 + reach) * leg / (8.0 * tolerance))) + 1
    out, count, straight = np.empty((most + 1, 2)), 1, 0
    out[0] = path[0]
    for i in range(n - 1):
        leg = math.hypot(path[i + 1, 0] - path[i, 0], path[i + 1, 1] - path[i, 1])
        stretch, added = reach * leg, 0
        for trial in range(halvings + 1):
            if trial == halvings:
                stretch = 0.0
                straight += 1
            added = _pieces(path, directions, i, stretch, tolerance, out[count:])
            free = True
            for k in range(count, count + added):
                if not edge_free(space, out[k - 1, 0], out[k - 1, 1], out[k, 0], out[k, 1]):
                    free = False
                    break
            if free:
                break
            stretch *= 0.5
        count += added
    return out[:count].copy(), straight


@settings
class SplineRrtStar:
    """Spline-RRT*: an RRT* path that is executed as a spline (Yu et al. 2018, with other splines).

    Each leg of the tree's path becomes a cubic Hermite curve whose direction at a vertex bisects
    the legs there, so that the direction never jumps. Where the curve is not free its tangents are
    halved, which draws it towards the leg; `straight_legs` counts those that had to stay straight.
    The path is the curve's polyline, within `tolerance`, and every edge of it is tested exactly.
    """

    tree: InformedRrtStar = setting(default=InformedRrtStar(iterations=2_000))
    reach: float = setting(default=1.0, source="Catmull and Rom 1974", low=0.0, high=3.0)
    halvings: int = setting(default=8, source="tangents of 1/256 of a leg bend unseen", low=0)
    tolerance: float = setting(default=1e-3, unit="m", source="below any sensor's noise", low=1e-6)

    def plan(
        self, problem: Problem, rng: np.random.Generator, deadline: float | None = None
    ) -> Plan:
        """Answer a problem with a smooth free path; a deadline is the tree's."""
        began = perf_counter()
        plan = self.tree.plan(problem, rng, deadline)
        if plan.status != Status.SOLVED or plan.length == 0.0:
            return plan
        tree_s = perf_counter() - began
        path, straight = smooth(
            problem.free.arrays, plan.path, self.reach, self.halvings, self.tolerance
        )
        counters = {**plan.counters, "straight_legs": straight}
        timings = {"tree_s": tree_s, "time_s": perf_counter() - began}
        return replace(plan, path=path, counters=counters, timings=timings)
