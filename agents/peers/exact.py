"""Our exact tests as other planners call them: thousands of times, from Python."""

from __future__ import annotations

from collections.abc import Callable
from typing import cast

import numba

from planners.collision import polygon_tests
from planners.collision.polygon_tests import SpaceArrays

EdgeTest = Callable[[float, float, float, float], bool]
PointTest = Callable[[float, float], bool]


def collision_tests(arrays: SpaceArrays) -> tuple[EdgeTest, PointTest]:
    """The tests of edges and of points on one map, which is frozen into them.

    To hand over a map's arrays takes nine microseconds a call, more than a test: it would slow
    others down for nothing. Compiling takes a second.
    """
    edge, point = polygon_tests.edge_free, polygon_tests.point_free

    @numba.njit(error_model="numpy")
    def edge_free(ax: float, ay: float, bx: float, by: float) -> bool:
        return edge(arrays, ax, ay, bx, by)

    @numba.njit(error_model="numpy")
    def point_free(x: float, y: float) -> bool:
        return point(arrays, x, y)

    edge_free(0.0, 0.0, 0.0, 0.0)
    point_free(0.0, 0.0)
    return cast(EdgeTest, edge_free), cast(PointTest, point_free)
