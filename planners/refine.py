"""Refinement: a valid path in, a valid path out that is shorter, smoother or less crowded.

`REFINERS` names them; a refiner is its settings. Where it can make nothing better that is free, the
plan stays as it is, and its note says why.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from time import perf_counter
from typing import Final, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from planners.collision.polygon_tests import SpaceArrays
from planners.problem import Plan, Problem, Status
from planners.smoothing.comfort import path_cost, push_off_walls, resample
from planners.smoothing.shortcut import shortcut
from planners.smoothing.smooth import blocked_edges, pchip, smooth_curve, spline
from planners.swarm.search import shorten_path
from planners.swarm.woa import WhaleSettings
from wheelchair_gym.config import setting, settings
from wheelchair_gym.geometry import path_length
from wheelchair_gym.random import stream

Array = NDArray[np.float64]


class Refiner(Protocol):
    """A frozen settings object that refines: same plan, same rng state, same answer."""

    def refine(self, plan: Plan | ArrayLike, problem: Problem, rng: np.random.Generator) -> Plan:
        """A better plan, or the same with a note that says why; headings are dropped."""
        ...


def _refined(
    plan: Plan | ArrayLike, problem: Problem, better: Callable[[SpaceArrays, Array], Array | str]
) -> Plan:
    """A plan, or a path (n, 2 or 3) [m], with a better path or with the reason against it."""
    began = perf_counter()
    given = plan if isinstance(plan, Plan) else Plan(Status.SOLVED, np.asarray(plan, np.float64))
    if given.status != Status.SOLVED:
        return replace(given, note=given.note or "there is no path to refine")
    path = np.ascontiguousarray(given.path[:, :2], dtype=np.float64)
    arrays = problem.free.arrays
    if not np.isfinite(path).all() or len(path) < 2 or blocked_edges(arrays, path).any():
        return replace(given, note="not refined: the path itself is not free")
    answer = better(arrays, path)
    if not isinstance(answer, str) and blocked_edges(arrays, answer).any():
        answer = "digits do not tell whether the new path is free"
    if isinstance(answer, str):
        return replace(given, note=f"not refined: {answer}")
    timings = {**given.timings, "refine_s": perf_counter() - began}
    return replace(given, path=answer, timings=timings, note="")


@settings
class Shortcut:
    """The cheapest way over the path's own points; never dearer."""

    obstacle_weight: float = setting(
        default=0.0, low=0.0, high=1000.0, source="design choice: length alone"
    )
    """Extra cost of a metre at an obstacle, in metres in the open; 0 for length alone."""
    desired_clearance: float = setting(
        default=0.5, unit="m", low=0.01, high=100.0, source="half the width of a door"
    )
    """Clearance from which on a metre costs no more."""

    def refine(self, plan: Plan | ArrayLike, problem: Problem, rng: np.random.Generator) -> Plan:
        """Straighten; the generator is not used."""

        def better(arrays: SpaceArrays, path: Array) -> Array | str:
            short = shortcut(path, problem.free, self.obstacle_weight, self.desired_clearance)
            return short if len(short) < len(path) else "no point of it can be left out"

        return _refined(plan, problem, better)


_TOLERANCE: Final = setting(
    default=0.005,
    doc="Largest distance from the curve to its polyline.",
    unit="m",
    source="design choice",
    low=1e-6,
    high=1.0,
)
_SPACING: Final = setting(
    default=2.0,
    doc="Largest distance of knots at first.",
    unit="m",
    source="design choice: rooms and doors of buildings",
    low=1e-2,
)
_ROUNDS: Final = setting(
    default=16,
    doc="How often knots are added where the curve is blocked.",
    source="design choice: 2 m halved to 30 um",
    low=0,
    high=40,
)


@settings
class Pchip:
    """A curve that never overshoots its knots: the first paper's (PCHIP), with exact edges."""

    tolerance: float = _TOLERANCE
    spacing: float = _SPACING
    rounds: int = _ROUNDS

    def refine(self, plan: Plan | ArrayLike, problem: Problem, rng: np.random.Generator) -> Plan:
        """Smooth; the generator is not used."""

        def better(arrays: SpaceArrays, path: Array) -> Array | str:
            return smooth_curve(arrays, path, pchip, self.tolerance, self.spacing, self.rounds)

        return _refined(plan, problem, better)


@settings
class Spline:
    """A natural cubic spline, smoother than PCHIP and farther off its knots, with exact edges."""

    tolerance: float = _TOLERANCE
    spacing: float = _SPACING
    rounds: int = _ROUNDS

    def refine(self, plan: Plan | ArrayLike, problem: Problem, rng: np.random.Generator) -> Plan:
        """Smooth; the generator is not used."""

        def better(arrays: SpaceArrays, path: Array) -> Array | str:
            return smooth_curve(arrays, path, spline, self.tolerance, self.spacing, self.rounds)

        return _refined(plan, problem, better)


@settings
class Woa:
    """A swarm of paths near the path, as in the thesis's global variant; never longer."""

    whales: WhaleSettings = setting(
        default=WhaleSettings(population=30, iterations=100), source="design choice"
    )
    """The swarm."""
    shortness_weight: float = setting(default=10.0, unit="1/m", low=0, source="thesis, figure 3.1")
    """Cost of length."""
    collision_free_weight: float = setting(
        default=1e4,
        low=0.0,
        source="design choice: above the length of any path, so that free paths lead",
    )
    """Cost of each blocked edge."""
    width_bound: float = setting(default=2.5, unit="m", low=0.0, source="thesis, figure 3.1")
    """Largest shift of a point in x."""
    height_bound: float = setting(default=2.5, unit="m", low=0.0, source="thesis, figure 3.1")
    """Largest shift of a point in y."""

    def refine(self, plan: Plan | ArrayLike, problem: Problem, rng: np.random.Generator) -> Plan:
        """Shorten."""

        def better(arrays: SpaceArrays, path: Array) -> Array | str:
            shorter = shorten_path(
                arrays,
                path,
                self.whales.parameters,
                self.shortness_weight,
                self.collision_free_weight,
                self.width_bound,
                self.height_bound,
                stream(rng),
            )
            gained = path_length(shorter) < path_length(path) - 1e-9  # beyond rounding
            return shorter if gained else "no shorter path was found near it"

        return _refined(plan, problem, better)


@settings
class Clearance:
    """Pushed off what is solid to a comfortable distance, where there is room."""

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

    def refine(self, plan: Plan | ArrayLike, problem: Problem, rng: np.random.Generator) -> Plan:
        """Push; the generator is not used."""

        def better(arrays: SpaceArrays, path: Array) -> Array | str:
            points = resample(path, self.spacing)
            if blocked_edges(arrays, points).any():  # along slanted walls, digits may forbid some
                points = path
            points = push_off_walls(
                arrays,
                points,
                self.obstacle_weight,
                self.desired_clearance,
                0.25 * self.desired_clearance,
                self.sweeps,
            )
            points = shortcut(points, problem.free, self.obstacle_weight, self.desired_clearance)
            before, after = (
                path_cost(arrays, way, self.obstacle_weight, self.desired_clearance)
                for way in (path, points)
            )
            return points if after < before else "there is no cheaper path near it"

        return _refined(plan, problem, better)
