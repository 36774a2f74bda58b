"""What a path is worth: length, smoothness and clearance."""

from __future__ import annotations

import math

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray

from planners.collision.polygon_tests import SpaceArrays, clearance
from planners.problem import Problem
from planners.swarm import path_cost
from wheelchair_gym.compiled.kernel import borrowing_kernel
from wheelchair_gym.geometry import path_length, without_repeats

Array = NDArray[np.float64]

SPACING = 0.1  # m between the points of a path whose clearances are averaged


def turning(path: ArrayLike) -> float:
    """Mean absolute angle [rad] between successive legs of a path (n, 2); 0 for a single leg."""
    points = _apart(path)
    return path_cost.mean_turning(points, len(points))


def printed_turning(path: ArrayLike) -> float:
    """Smoothness f1 as the paper on RRT-WOA prints it, its (1)-(5): less is called smoother."""
    points = _apart(path)
    return path_cost.printed_turning(points, len(points)) if len(points) > 1 else 0.0


def backing(path: ArrayLike) -> float:
    """Way in reverse [m] along a path (n, 3); 0 where it has no headings."""
    points = np.asarray(path, dtype=np.float64)
    if points.shape[1] < 3:
        return 0.0
    steps, yaw = np.diff(points[:, :2], axis=0), points[:-1, 2]
    along = steps[:, 0] * np.cos(yaw) + steps[:, 1] * np.sin(yaw)
    return float(np.maximum(0.0, -along).sum())


def _apart(path: ArrayLike) -> Array:
    """The points (n, 2) of a path without those that repeat the one before."""
    return without_repeats(np.asarray(path, dtype=np.float64)[:, :2])


@borrowing_kernel
def _clearances(arrays: SpaceArrays, points: Array, out: Array) -> None:
    for i in range(points.shape[0]):
        out[i] = clearance(arrays, points[i, 0], points[i, 1])


def path_figures(path: ArrayLike, problem: Problem) -> dict[str, float | None]:
    """Length [m], smoothness and clearances [m] of a path (n, 2 or 3); None where infinite.

    Clearances are those of the path's points, from obstacles and from the map's border: the least
    of all, and the mean along the way.
    """
    points = np.asarray(path, dtype=np.float64)[:, :2]
    line = shapely.LineString(points)
    way = np.append(np.arange(0.0, line.length, SPACING), line.length)
    along = shapely.get_coordinates(shapely.line_interpolate_point(line, way))
    gaps = np.empty(len(along))
    _clearances(problem.space.arrays, along, gaps)
    figures = {
        "length_m": path_length(points),
        "turning_rad": turning(points),
        "printed_turning": printed_turning(points),
        "clearance_min_m": float(shapely.distance(line, shapely.boundary(problem.space.free))),
        "clearance_mean_m": float(gaps.mean()),
    }
    return {key: value if math.isfinite(value) else None for key, value in figures.items()}
