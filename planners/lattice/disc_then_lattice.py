"""The shortest path of a disc if the chair's rectangle can follow it; otherwise the lattice."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from planners.collision.footprint import path_gap
from planners.graphs.visibility import Visibility
from planners.lattice.lattice import MIN_GAP, POSE_SPACING, Lattice
from planners.problem import Plan, PlannerBase, Problem, Status, remaining
from wheelchair_gym.config import setting, settings
from wheelchair_gym.geometry import wrap

Array = NDArray[np.float64]

FILLETS = (1.0, 0.5, 0.0)  # m: tried in this order; 0 is a pivot


def drive_path(path: Array, start: Array, goal: Array, fillet: float) -> Array:
    """Poses (n, 3) along a path (k, 2): arcs at corners, pivots at the ends.

    Args:
        path: corners [m], the first one at the start.
        start: (3,).
        goal: (2,) or (3,).
        fillet: distance of an arc's ends from its corner [m], at most half an edge.
    """
    poses = [start]
    path = path[np.append(True, np.hypot(*np.diff(path, axis=0).T) > 0.0)]
    steps = np.diff(path, axis=0)
    ways, yaws = np.hypot(*steps.T), np.arctan2(steps[:, 1], steps[:, 0])
    for k, (corner, yaw) in enumerate(zip(path[:-1], yaws, strict=True)):
        turn = float(wrap(yaw - poses[-1][2]))
        cut = min(fillet, 0.5 * ways[k - 1], 0.5 * ways[k]) if k > 0 else 0.0
        back = cut * np.array([math.cos(poses[-1][2]), math.sin(poses[-1][2]), 0.0])
        begin = np.array([*corner, poses[-1][2]]) - back
        poses.append(begin)
        parts = max(1, math.ceil(abs(turn) / (2.0 * POSE_SPACING)))
        bend = math.tan(0.5 * turn) / cut if cut > 0.0 else 0.0  # 1/m
        for part in range(1, parts + 1):
            angle = turn * part / parts
            chord = 2.0 * math.sin(0.5 * angle) / bend if bend != 0.0 else 2.0 * cut * part / parts
            along = begin[2] + 0.5 * angle
            x, y = begin[0] + chord * math.cos(along), begin[1] + chord * math.sin(along)
            poses.append(np.array([x, y, begin[2] + angle]))
    poses.append(np.array([*path[-1], poses[-1][2]]))
    if len(goal) == 3:
        turn = float(wrap(goal[2] - poses[-1][2]))
        parts = max(1, math.ceil(abs(turn) / (2.0 * POSE_SPACING)))
        poses.extend(poses[-1] + [0.0, 0.0, turn * k / parts] for k in range(1, parts + 1))
    return np.array(poses)


@settings
class DiscThenLattice(PlannerBase):
    """The shortest path of a disc as wide as the chair, if the rectangle fits; or the lattice's.

    It is faster than the lattice on a map that was planned in before, and slower on a new map,
    whose obstacles must be inflated first. The disc's path is driven forward only.
    """

    lattice: Lattice = Lattice()
    lateral_margin: float = setting(default=0.10, unit="m", low=0.0, source="design choice")
    """Extra radius of the disc, because arcs cut corners."""

    def trivial(self, problem: Problem) -> Plan | None:
        """Nothing: the planners that this one asks know trivial problems."""
        return None

    def solve(self, problem: Problem, rng: np.random.Generator, end: float) -> Plan:
        """Plan without random numbers; the counter `tight` is 1 where the lattice answered."""
        footprint = self.lattice.footprint
        margin = max(MIN_GAP, problem.clearance - footprint.half_width)
        wide = replace(
            problem, clearance=max(problem.clearance, footprint.half_width) + self.lateral_margin
        )
        disc = Visibility().plan(wide, rng, remaining(end))
        start = np.zeros(3)
        start[: len(problem.start)] = problem.start
        goal = np.asarray(problem.goal, dtype=np.float64)
        path, solved = disc.path, False
        if disc.status is Status.SOLVED:
            for fillet in FILLETS:
                path = drive_path(disc.path, start, goal, fillet)
                solved = self._free(problem, path, margin)
                if solved:
                    break
        if solved:
            status, counters = disc.status, {**disc.counters, "iterations": 0, "tight": 0}
        else:
            plan = self.lattice.plan(problem, rng, remaining(end))
            status, path, counters = plan.status, plan.path, {**plan.counters, "tight": 1}
        return Plan(status, path, counters=counters)

    def _free(self, problem: Problem, path: Array, margin: float) -> bool:
        """Whether the rectangle keeps the margin along a path."""
        footprint, space = self.lattice.footprint, problem.space
        return path_gap(path, space, footprint, 2.0 * margin) >= margin
