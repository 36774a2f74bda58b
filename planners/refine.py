"""Refinement: a valid path in, a valid path out that is shorter, smoother or has more clearance.

`REFINERS` names them; a refiner is its settings. Where it finds no better free path, the plan stays
as it is, and its note says why.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from planners.collision.space import Space
from planners.problem import Plan, Problem, Status
from planners.smoothing.shortcut import path_cost, push_off_walls, resample, shortcut
from planners.smoothing.smooth import blocked_edges, pchip, smooth_curve, spline
from planners.swarm.search import PathShortening
from wheelchair_gym.compiled.clock import clock
from wheelchair_gym.config import setting, settings
from wheelchair_gym.geometry import path_length
from wheelchair_gym.random import stream

Array = NDArray[np.float64]


class Refiner(ABC):
    """A frozen settings object that refines: same plan, same rng state, same answer."""

    def refine(self, plan: Plan | ArrayLike, problem: Problem, rng: np.random.Generator) -> Plan:
        """A better plan, or the same with a note that says why; headings are dropped.

        The plan may be a path (n, 2 or 3) [m].
        """
        began = clock()
        given = plan if isinstance(plan, Plan) else Plan(Status.SOLVED, np.asarray(plan, float))
        if given.status != Status.SOLVED:
            return replace(given, note=given.note or "there is no path to refine")
        path = np.ascontiguousarray(given.path[:, :2], dtype=np.float64)
        arrays = problem.free.arrays
        if not np.isfinite(path).all() or len(path) < 2 or blocked_edges(arrays, path).any():
            return replace(given, note="not refined: the path itself is not free")
        answer = self.better(problem.free, path, rng)
        if not isinstance(answer, str) and blocked_edges(arrays, answer).any():
            answer = "the precision of coordinates does not tell whether the new path is free"
        if isinstance(answer, str):
            return replace(given, note=f"not refined: {answer}")
        timings = {**given.timings, "refine_s": clock() - began}
        return replace(given, path=answer, timings=timings, note="")

    @abstractmethod
    def better(self, free: Space, path: Array, rng: np.random.Generator) -> Array | str:
        """A better path (k, 2) [m] than a free path (n, 2), or why there is none."""


@settings
class Shortcut(Refiner):
    """The cheapest path over points of the path; never costlier."""

    obstacle_weight: float = setting(
        default=0.0, low=0.0, high=1000.0, source="design choice: length alone"
    )
    """Extra cost of a metre at an obstacle, in metres in the open; 0 for length alone."""
    desired_clearance: float = setting(
        default=0.5, unit="m", low=0.01, high=100.0, source="half the width of a door"
    )
    """Clearance from which on a metre costs no more."""

    def better(self, free: Space, path: Array, rng: np.random.Generator) -> Array | str:
        """A straightened path; the generator is not used."""
        short = shortcut(path, free, self.obstacle_weight, self.desired_clearance)
        return short if len(short) < len(path) else "no point of it can be left out"


@settings
class SmoothCurve(Refiner):
    """What the refiners that draw a smooth curve share."""

    tolerance: float = setting(default=0.005, unit="m", low=1e-6, high=1.0, source="design choice")
    """Largest distance from the curve to its polyline."""
    spacing: float = setting(
        default=2.0, unit="m", low=1e-2, source="design choice: rooms and doors of buildings"
    )
    """Largest distance of knots at first."""
    rounds: int = setting(default=16, low=0, high=40, source="design choice: 2 m halved to 30 um")
    """How often knots are added where the curve is blocked."""

    through = staticmethod(pchip)

    def better(self, free: Space, path: Array, rng: np.random.Generator) -> Array | str:
        """A smooth path; the generator is not used."""
        return smooth_curve(
            free.arrays, path, self.through, self.tolerance, self.spacing, self.rounds
        )


@settings
class Pchip(SmoothCurve):
    """A curve that never overshoots its knots: the first paper's (PCHIP), with exact edges."""


@settings
class Spline(SmoothCurve):
    """A natural cubic spline, smoother than PCHIP and farther off its knots, with exact edges."""

    through = staticmethod(spline)


@settings
class Woa(PathShortening, Refiner):
    """A swarm of paths near the path, as in the thesis's global variant; never longer."""

    def better(self, free: Space, path: Array, rng: np.random.Generator) -> Array | str:
        """A shorter path."""
        shorter = self.shorten(free.arrays, path, stream(rng))
        gained = path_length(shorter) < path_length(path) - 1e-9  # beyond rounding
        return shorter if gained else "no shorter path was found near it"


@settings
class Clearance(Refiner):
    """Pushes the path off obstacles to a comfortable distance, where there is space."""

    obstacle_weight: float = setting(default=10.0, low=0.0, high=1000.0, source="design choice")
    """Extra cost of a metre at an obstacle, in metres in the open."""
    desired_clearance: float = setting(
        default=0.5, unit="m", low=0.01, high=100.0, source="half the width of a door"
    )
    """Clearance from which on a metre costs no more."""
    spacing: float = setting(default=0.5, unit="m", low=0.01, source="design choice")
    """Distance of the points that are moved."""
    sweeps: int = setting(
        default=20, low=1, source="measurement: cost within 0.5 % of that after 80"
    )
    """Passes over all points."""

    def better(self, free: Space, path: Array, rng: np.random.Generator) -> Array | str:
        """A path with more clearance; the generator is not used."""
        arrays, points = free.arrays, resample(path, self.spacing)
        if blocked_edges(arrays, points).any():  # along slanted walls, rounding may block some
            points = path
        points = push_off_walls(
            arrays,
            points,
            self.obstacle_weight,
            self.desired_clearance,
            0.25 * self.desired_clearance,
            self.sweeps,
        )
        points = shortcut(points, free, self.obstacle_weight, self.desired_clearance)
        before, after = (
            path_cost(arrays, way, self.obstacle_weight, self.desired_clearance)
            for way in (path, points)
        )
        return points if after < before else "there is no cheaper path near it"
