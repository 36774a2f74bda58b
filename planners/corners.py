"""The convex corners of what is solid: a shortest path bends at them only, and only round them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from planners.mesh import NONE, Mesh, by_point, side_of
from wheelchair_gym.kernel import kernel

Array = NDArray[np.float64]
Index = NDArray[np.int64]


class Corners(NamedTuple):
    """The convex corners of what is solid; several may lie at one point."""

    place: Index  # (n,) points
    before: Index  # (n,) points: the corner before
    after: Index  # (n,) points
    first: Index  # (m + 1,) where each point's corners begin
    members: Index  # (n,) corners, point by point


@kernel
def convex_corners(mesh: Mesh, before: Array) -> Corners:
    """The convex corners of a boundary, given the corner (n, 2) before each segment."""
    n, m, points = mesh.begins.shape[0], mesh.points.shape[0], mesh.points
    first, arriving = np.empty(m + 1, np.int64), np.empty(n, np.int64)
    by_point(mesh.ends, first, arriving)
    corners, count = np.empty((n, 3), np.int64), 0
    for k in range(n):
        place, last = mesh.begins[k], NONE
        for i in range(first[place], first[place + 1]):
            p = mesh.begins[arriving[i]]
            if points[p, 0] == before[k, 0] and points[p, 1] == before[k, 1]:
                last = p
        if last != NONE and side_of(points, last, place, mesh.ends[k]) > 0.0:
            corners[count, 0], corners[count, 1], corners[count, 2] = place, last, mesh.ends[k]
            count += 1
    members = np.empty(count, np.int64)
    by_point(corners[:count, 0], first, members)
    return Corners(
        corners[:count, 0].copy(),
        corners[:count, 1].copy(),
        corners[:count, 2].copy(),
        first,
        members,
    )
