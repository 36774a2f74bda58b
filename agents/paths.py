"""What a path is worth: length, smoothness and clearance."""

from __future__ import annotations

import math

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray

from planners.exact import SpaceArrays, clearance
from planners.types import Problem
from wheelchair_gym.geometry import path_length
from wheelchair_gym.kernel import borrowing_kernel

Array = NDArray[np.float64]

SPACING = 0.1  # m between the points of a path whose clearances are averaged


def turning(path: ArrayLike) -> float:
    """Mean absolute angle [rad] between successive legs of a path (n, 2); 0 for a single leg."""
    legs = np.diff(_apart(path), axis=0)
    if len(legs) < 2:
        return 0.0
    cross = legs[:-1, 0] * legs[1:, 1] - legs[:-1, 1] * legs[1:, 0]
    return float(np.abs(np.arctan2(cross, (legs[:-1] * legs[1:]).sum(axis=1))).mean())


def printed_turning(path: ArrayLike) -> float:
    """Smoothness f1 as the paper on RRT-WOA prints it, its (1)-(5): less is called smoother.

    A is a leg, B the way to the point after it; the paper takes (A^2 + B^2) / (2 A B) for the
    cosine of an angle, though it lacks the third side of the law of cosines, and its mean over
    the legs.
    """
    points = _apart(path)
    if len(points) < 3:
        return 0.0
    A = np.hypot(*(points[1:-1] - points[:-2]).T)
    B = np.maximum(np.hypot(*(points[2:] - points[:-2]).T), 1e-12)
    return float(((A * A + B * B) / (2.0 * A * B)).sum() / (len(points) - 1))


def _apart(path: ArrayLike) -> Array:
    """The points (n, 2) of a path without those that repeat the one before."""
    points = np.asarray(path, dtype=np.float64)[:, :2]
    kept: Array = points[np.append(True, (np.diff(points, axis=0) != 0.0).any(axis=1))]
    return kept


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
