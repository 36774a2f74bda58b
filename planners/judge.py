"""An independent judge of paths: shapely's geometry, none of the planners' kernels.

Tests, benchmarks and users ask the same judge. It is exact but slow: a path takes milliseconds.
"""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import shapely
from numpy.typing import ArrayLike

from planners.types import Problem

TOLERANCE = 1e-6  # m


class Judge:
    """Tells what is wrong with paths on one map.

    Args:
        solid: shapely geometry of all obstacles.
        bounds: xmin, ymin, xmax, ymax [m].
        clearance: distance [m] to keep from obstacles and from the border.
    """

    def __init__(self, solid: Any, bounds: ArrayLike, clearance: float = 0.0) -> None:
        map_ = shapely.box(*np.asarray(bounds)).buffer(-clearance, join_style="mitre")
        # What is solid and the outside of the map are one: nothing passes where they touch.
        xmin, ymin, xmax, ymax = map_.bounds
        outside = shapely.difference(shapely.box(xmin - 9, ymin - 9, xmax + 9, ymax + 9), map_)
        self._solid = shapely.union(solid, outside) if clearance == 0.0 else solid
        self._core = shapely.buffer(self._solid, -TOLERANCE, join_style="mitre")
        self._map = map_.buffer(TOLERANCE)
        self._clearance = clearance
        for geometry in (self._solid, self._core, self._map):
            shapely.prepare(geometry)

    @classmethod
    def of(cls, problem: Problem) -> Judge:
        """The judge of a problem's map and clearance."""
        return cls(problem.space.solid, problem.space.bounds, problem.clearance)

    def faults(
        self, path: ArrayLike, start: ArrayLike | None = None, goal: ArrayLike | None = None
    ) -> list[str]:
        """What is wrong with a path (n, 2) or (n, 3), as text; empty if it is valid.

        Args:
            path: points [m]; a heading is not looked at.
            start: where it is to start [m]; None: anywhere.
            goal: where it is to end [m]; None: anywhere.
        """
        points = np.asarray(path, dtype=np.float64)[:, :2]
        if not np.isfinite(points).all():
            return ["a point is not finite"]
        found = []
        for name, end, at in (("start", start, 0), ("end", goal, -1)):
            if end is not None:
                gap = float(np.hypot(*(points[at] - np.asarray(end)[:2])))
                if gap > TOLERANCE:
                    found.append(f"its {name} is {gap} m from where it should be")
        edges = np.array(
            [
                shapely.LineString([a, b]) if np.any(a != b) else shapely.Point(a)
                for a, b in itertools.pairwise(points)
            ],
            dtype=object,
        )
        for k in np.flatnonzero(~shapely.covers(self._map, edges)):
            found.append(f"edge {k} leaves the map")
        # Tangled only if they meet at all, which a prepared geometry tells sooner.
        near = np.flatnonzero(shapely.intersects(self._core, edges))
        for k in near[shapely.relate_pattern(edges[near], self._core, "T********")]:
            inside = edges[k].intersection(self._core).length
            found.append(f"edge {k} is inside an obstacle for {inside} m")
        if self._clearance > 0.0:
            gaps = shapely.distance(edges, self._solid)
            for k in np.flatnonzero(gaps < self._clearance - TOLERANCE):
                found.append(f"edge {k} is {gaps[k]} m from an obstacle")
        return found


def faults(path: ArrayLike, solid: Any, bounds: ArrayLike, clearance: float = 0.0) -> list[str]:
    """What is wrong with one path (n, 2), as text; see `Judge`."""
    return Judge(solid, bounds, clearance).faults(path)
