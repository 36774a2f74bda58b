"""Paths along the medial axis: as far from obstacles as possible."""

from __future__ import annotations

import numpy as np
from scipy.spatial import QhullError, cKDTree
from scipy.spatial import Voronoi as Diagram

from planners.graphs.roadmap import Pairs, shortest
from planners.problem import Plan, PlannerBase, Problem, answer
from planners.smoothing.shortcut import subdivided
from wheelchair_gym.arrays import Array
from wheelchair_gym.compiled.clock import clock
from wheelchair_gym.config import setting, settings

MOST_SAMPLES = 200_000  # of the boundary: some seconds
SPACING = 0.4  # m: distance of the boundary samples at first, half the width of a door


def _axis(samples: Array, ends: Array) -> tuple[Array, Pairs]:
    """Return nodes (n, 2), the ends, then the diagram's vertices; and pairs of them to join."""
    diagram = Diagram(samples)
    ridges = np.array(diagram.ridge_vertices, dtype=np.int64)
    pairs = [ridges[(ridges >= 0).all(axis=1)] + 2]
    # An end lies in the cell of the sample nearest to it, from where a straight way leads to the
    # cell's vertices: a cell is convex, and no other wall cuts it.
    _, nearest = cKDTree(samples).query(ends)
    for end, sample in enumerate(nearest):
        cell = np.array(diagram.regions[diagram.point_region[sample]], dtype=np.int64)
        cell = cell[cell >= 0] + 2
        pairs.append(np.stack([np.full(len(cell), end), cell], axis=1))
    return np.vstack([ends, diagram.vertices]), np.concatenate(pairs)


@settings
class Voronoi(PlannerBase):
    """The shortest path along the medial axis, from the Voronoi diagram of boundary samples.

    Aurenhammer 1991; O'Dunlaing and Yap 1985. A passage is found once samples lie about as close as
    it is wide; where none is found, they lie twice as close.
    """

    refinements: int = setting(default=4, low=0, high=8, source="design choice")
    """Number of times that the spacing is halved where no path is found."""

    def solve(self, problem: Problem, rng: np.random.Generator, end: float) -> Plan:
        """Find a path; samples prove nothing, so failure is `exhausted`. No use of `rng`."""
        arrays = problem.free.arrays
        ends = np.array([problem.start[:2], problem.goal[:2]], dtype=np.float64)
        path, tested, halvings, note = np.empty((0, 2)), 0, 0, "no way along the finest axis"
        count = 0
        for halvings in range(self.refinements + 1):
            samples = np.unique(subdivided(arrays.segments, SPACING / 2**halvings, 2), axis=0)
            if len(samples) > MOST_SAMPLES:
                note = f"the boundary has more than {MOST_SAMPLES:,} samples"
                break
            try:
                nodes, pairs = _axis(samples, ends)
            except QhullError:  # a map too thin for the precision of coordinates
                note = "the boundary is too thin for a diagram"
                break
            way = shortest(arrays, nodes, pairs, end)
            path, tested, count = way.path, tested + way.tested, len(nodes)
            if len(path):
                break
            if clock() >= end:
                note = "out of time"
                break
        return answer(path, {"nodes": count, "halvings": halvings, "edges_tested": tested}, note)
