"""An independent judge of paths: shapely's geometry, none of the planners' kernels.

Tests, benchmarks and users ask the same judge. It is exact but slow: a path takes milliseconds.
"""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray

from planners.problem import Plan, Problem, Status
from wheelchair_gym.base.arrays import Array
from wheelchair_gym.geometry.outline import Footprint
from wheelchair_gym.geometry.planar import wrap_angle

TOLERANCE = 1e-6  # m
MAX_TURN = 0.1 + 1e-9  # rad: between two poses of a plan
FINE_TURN = 0.002  # rad: pieces of a sweep; a corner's arc bulges 1 m x 0.002^2 / 8 = 5e-7 m
OUTSIDE = 9  # m: width of the solid frame round a map
INTERIORS_MEET = "T********"  # pattern of DE-9IM, as shapely writes it


class Judge:
    """Finds faults of paths on one map.

    Args:
        solid: shapely geometry of all obstacles.
        bounds: xmin, ymin, xmax, ymax [m].
        clearance: distance [m] to keep from obstacles and from the border.
    """

    def __init__(self, solid: Any, bounds: ArrayLike, clearance: float = 0.0) -> None:
        inner = shapely.box(*np.asarray(bounds)).buffer(-clearance, join_style="mitre")
        # Without a clearance, obstacles and the outside are one: nothing passes where they touch.
        frame = shapely.box(*(np.array(inner.bounds) + np.repeat((-OUTSIDE, OUTSIDE), 2)))
        outside = shapely.difference(frame, inner)
        self._solid = shapely.union(solid, outside) if clearance == 0.0 else solid
        self._core = shapely.buffer(self._solid, -TOLERANCE, join_style="mitre")
        self._map = inner.buffer(TOLERANCE)
        self._clearance = clearance
        for geometry in (self._solid, self._core, self._map):
            shapely.prepare(geometry)

    @classmethod
    def of(cls, problem: Problem) -> Judge:
        """Return the judge of a problem's map and clearance."""
        return cls(problem.space.solid, problem.space.bounds, problem.clearance)

    def faults(
        self, path: ArrayLike, start: ArrayLike | None = None, goal: ArrayLike | None = None
    ) -> list[str]:
        """Return the faults of a path (n, 2) or (n, 3), as text; empty if it is valid.

        Args:
            path: points [m]; headings are compared at the ends only.
            start: required start [m]; None: anywhere.
            goal: required end [m]; None: anywhere.
        """
        points = np.asarray(path, dtype=np.float64)
        if not np.isfinite(points).all():
            return ["a point is not finite"]
        found = _end_faults(points, start, goal)
        points = points[:, :2]
        edges = shapely.linestrings(np.stack([points[:-1], points[1:]], axis=1))
        still = (points[:-1] == points[1:]).all(axis=1)
        edges[still] = shapely.points(points[:-1][still])
        for k in np.flatnonzero(~shapely.covers(self._map, edges)):
            found.append(f"edge {k} leaves the map")
        # A prepared geometry finds quickly which edges meet it at all.
        near = np.flatnonzero(shapely.intersects(self._core, edges))
        for k in near[shapely.relate_pattern(edges[near], self._core, INTERIORS_MEET)]:
            inside = edges[k].intersection(self._core).length
            found.append(f"edge {k} is inside an obstacle for {inside} m")
        if self._clearance > 0.0:
            clearances = shapely.distance(edges, self._solid)
            for k in np.flatnonzero(clearances < self._clearance - TOLERANCE):
                found.append(f"edge {k} is {clearances[k]} m from an obstacle")
        return found


def _end_faults(path: Array, start: ArrayLike | None, goal: ArrayLike | None) -> list[str]:
    """Return the faults of the ends of a path (n, 2) or (n, 3), headings included."""
    found = []
    for name, end, at in (("start", start, 0), ("end", goal, -1)):
        if end is None:
            continue
        asked = np.asarray(end, dtype=np.float64)
        gap = float(np.hypot(*(path[at, :2] - asked[:2])))
        if gap > TOLERANCE:
            found.append(f"its {name} is {gap} m from where it should be")
        if path.shape[1] == len(asked) == 3:
            turn = abs(float(wrap_angle(path[at, 2] - asked[2])))
            if turn > TOLERANCE:
                found.append(f"its {name} is turned by {turn} rad from where it should be")
    return found


def plan_faults(
    plan: Plan, problem: Problem, footprint: Footprint | None = None, judge: Judge | None = None
) -> list[str]:
    """Return the faults of a planner's answer; empty if it is a valid plan.

    A plan is solved if and only if it has a path. The path goes from start to goal, headings
    included, and turns by at most `MAX_TURN` between two poses. A path of points is judged for a
    disc with the problem's clearance, a path of poses for the footprint of its planner, if given.
    Pass a `Judge` of this problem to avoid building it again.
    """
    path = np.asarray(plan.path, dtype=np.float64)
    if (plan.status is Status.SOLVED) != (len(path) > 0):
        return [f"its status is {plan.status} with {len(path)} points"]
    if not len(path):
        return []
    if path.shape[1] == 2 or footprint is None:
        return (judge or Judge.of(problem)).faults(path, problem.start, problem.goal)
    if not np.isfinite(path).all():
        return ["a point is not finite"]
    turns = abs(wrap_angle(np.diff(path[:, 2])))
    space = problem.space
    return [
        *_end_faults(path, problem.start, problem.goal),
        *(f"step {k} turns by {turns[k]} rad" for k in np.flatnonzero(turns > MAX_TURN)),
        *sweep_faults(path, footprint.corners, space.solid, space.bounds),
    ]


def _swept(footprint: Array, start: Array, turn: float, chord: float) -> NDArray[Any]:
    """Return polygons that cover a rectangle's sweep between two poses, to O(`FINE_TURN`^2).

    The rectangle is cut at its centre of rotation. The hull of two poses of a part is its sweep
    between them, except for the bulge of the corners' arcs.
    """
    half = 0.5 * turn
    way = chord * half / np.sin(half) if abs(half) > 1e-9 else chord
    (x0, y0), (x1, y1) = footprint.min(axis=0), footprint.max(axis=0)
    xs, ys = [x0, x1], [y0, y1]
    if abs(turn) > 1e-9:
        centre = way / turn
        xs, ys = [x0, 0.0, x1], ([y0, centre, y1] if y0 < centre < y1 else ys)
    t = np.linspace(0.0, 1.0, int(np.ceil(abs(turn) / FINE_TURN)) + 2)
    share = np.sin(half * t) / np.sin(half) if abs(half) > 1e-9 else t
    yaw, along = start[2] + turn * t, start[2] + half * t
    place = start[:2] + chord * (share * np.stack([np.cos(along), np.sin(along)])).T
    c, s = np.cos(yaw), np.sin(yaw)
    frames = np.moveaxis(np.array([(c, s), (-s, c)]), -1, 0)  # (pieces, 2, 2)
    parts = []
    for a, b in itertools.pairwise(xs):
        for d, e in itertools.pairwise(ys):
            corners = np.array([(a, d), (b, d), (b, e), (a, e)]) @ frames + place[:, None]
            ends = np.concatenate([corners[:-1], corners[1:]], axis=1)
            parts.append(shapely.convex_hull(shapely.multipoints(ends)))
    return np.concatenate(parts)


def sweep_faults(
    path: ArrayLike, footprint: Array, solid: Any, bounds: ArrayLike, margin: float = 0.0
) -> list[str]:
    """Return the faults of a path of poses (n, 3) that a rectangle drives; empty if it is valid.

    From pose to pose the chair drives and turns at constant rates.

    Args:
        path: poses [m, m, rad].
        footprint: corners (4, 2) [m] in the chair's frame.
        solid: shapely geometry of all obstacles.
        bounds: xmin, ymin, xmax, ymax [m].
        margin: distance [m] that the outline keeps from obstacles and from the border.
    """
    poses = np.asarray(path, dtype=np.float64)
    turns = np.remainder(np.diff(poses[:, 2]) + np.pi, 2 * np.pi) - np.pi
    steps = np.diff(poses[:, :2], axis=0)
    middle = poses[:-1, 2] + 0.5 * turns
    ahead = np.cos(middle) * steps[:, 0] + np.sin(middle) * steps[:, 1]
    aside = np.cos(middle) * steps[:, 1] - np.sin(middle) * steps[:, 0]
    found = [
        f"step {k} slips {aside[k]} m sideways" for k in np.flatnonzero(abs(aside) > TOLERANCE)
    ]
    pieces = [_swept(footprint, *stretch) for stretch in zip(poses[:-1], turns, ahead, strict=True)]
    swept = np.concatenate(pieces) if pieces else _swept(footprint, poses[0], 0.0, 0.0)
    if not shapely.covers(shapely.box(*np.asarray(bounds)).buffer(TOLERANCE - margin), swept).all():
        found.append("the outline leaves the map")
    gap = shapely.distance(swept, solid).min() if not solid.is_empty else np.inf
    if margin > 0.0 and gap < margin - TOLERANCE:
        found.append(f"the outline is {gap} m from an obstacle")
    core = shapely.buffer(solid, -TOLERANCE, join_style="mitre")
    if shapely.relate_pattern(swept, core, INTERIORS_MEET).any():
        found.append("the outline is inside an obstacle")
    return found
