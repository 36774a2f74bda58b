"""A disc's shortest path, driven with the outline; where that does not fit, the lattice."""

from __future__ import annotations

import math
import time
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from planners.collision.footprint import path_gap
from planners.graphs.visibility import Visibility
from planners.lattice.lattice import POINTS, TOUCH, Lattice
from planners.problem import Plan, Problem, Status, begin
from wheelchair_gym.config import setting, settings
from wheelchair_gym.geometry import wrap

Array = NDArray[np.float64]

FILLETS = (1.0, 0.5, 0.0)  # m: from so far before a corner it is rounded; 0: a pivot


def driven(path: Array, start: Array, goal: Array, fillet: float) -> Array:
    """Poses (n, 3) of a chair that drives a path (k, 2): arcs at corners, pivots at its ends.

    Args:
        path: corners [m], the first one at the start.
        start: (3,).
        goal: (2,) or (3,).
        fillet: how far before and behind a corner its arc begins and ends [m], at most half of
            the way to the next.
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
        parts = max(1, math.ceil(abs(turn) / (2.0 * POINTS)))
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
        parts = max(1, math.ceil(abs(turn) / (2.0 * POINTS)))
        poses.extend(poses[-1] + [0.0, 0.0, turn * k / parts] for k in range(1, parts + 1))
    return np.array(poses)


@settings
class DiscThenLattice:
    """The shortest path of a disc as wide as the chair, if the outline can drive it; or a lattice.

    Quicker than the lattice in a map that was planned in before; in a new one slower, for what is
    solid must first be grown for the disc. It drives forward only, unless the lattice is asked.
    """

    lattice: Lattice = Lattice()
    play: float = setting(
        default=0.10, unit="m", source="beside the disc: corners are cut in arcs", low=0.0
    )

    def plan(
        self, problem: Problem, rng: np.random.Generator, deadline: float | None = None
    ) -> Plan:
        """See `Planner.plan`; nothing is drawn. `tight` counts whether the lattice was asked."""
        begun, end = begin(deadline)
        footprint = self.lattice.footprint
        margin = max(TOUCH, problem.clearance - footprint.half_width)
        wide = replace(problem, clearance=max(problem.clearance, footprint.half_width) + self.play)
        disc = Visibility().plan(wide, rng, deadline)
        start = np.zeros(3)
        start[: len(problem.start)] = problem.start
        goal = np.asarray(problem.goal, dtype=np.float64)
        path, solved = disc.path, False
        if disc.status is Status.SOLVED:
            for fillet in FILLETS:
                path = driven(disc.path, start, goal, fillet)
                solved = self._free(problem, path, margin)
                if solved:
                    break
        if solved:
            status, counters = disc.status, {**disc.counters, "iterations": 0, "tight": 0}
        else:
            left = max(0.0, end - time.perf_counter())
            plan = self.lattice.plan(problem, rng, None if deadline is None else left)
            status, path, counters = plan.status, plan.path, {**plan.counters, "tight": 1}
        spent = {"time_s": time.perf_counter() - begun}
        return Plan(status, path, counters=counters, timings=spent)

    def _free(self, problem: Problem, path: Array, margin: float) -> bool:
        """Whether the outline keeps the margin along a path; the start is on the map."""
        footprint, space = self.lattice.footprint, problem.space
        return path_gap(path, space, footprint, 2.0 * margin) >= margin
