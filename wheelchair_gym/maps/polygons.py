"""From cells to polygons: dilate, follow contours, simplify."""

from __future__ import annotations

import math
from typing import NamedTuple

import cv2
import numpy as np

from wheelchair_gym.arrays import Array
from wheelchair_gym.geometry import signed_area
from wheelchair_gym.maps.grid import OccupancyGrid


class PolygonWithHoles(NamedTuple):
    """A solid region: its outer polygon (k, 2) and the polygons of its holes."""

    outer: Array
    holes: tuple[Array, ...] = ()


def occupied_polygons(
    grid: OccupancyGrid, *, dilate: float = 0.0, epsilon: float = 0.0
) -> list[PolygonWithHoles]:
    """Return the outlines of all that is occupied, grown and simplified.

    The outline follows cell edges, and cuts inner corners by half a cell: with epsilon 0 no solid
    point is lost. Regions that touch at a corner are one.

    Args:
        grid: the map.
        dilate: distance [cells] by which solid regions grow.
        epsilon: how far [cells] a simplified outline may leave the exact one (Douglas and Peucker).
            An obstacle that would become a line stays exact; such a hole is filled.

    Returns:
        outlines in the grid's frame [m], outer polygons counter-clockwise, holes clockwise.
    """
    reach = max(0.0, dilate)
    edge = math.ceil(reach) + 1  # room for growth beyond the grid
    rows, cols = grid.shape
    # On half cells, closed squares have lattice points as corners, so contours are cell edges.
    lattice = np.zeros((2 * (rows + 2 * edge) + 1, 2 * (cols + 2 * edge) + 1), dtype=np.uint8)
    lattice[2 * edge + 1 : -2 * edge : 2, 2 * edge + 1 : -2 * edge : 2] = grid.solid()
    lattice = np.asarray(cv2.dilate(lattice, np.ones((3, 3), dtype=np.uint8)), dtype=np.uint8)
    if reach > 0.0 and lattice.any():
        gap = cv2.distanceTransform(1 - lattice, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
        lattice = np.asarray(gap <= 2.0 * reach + 1e-4, dtype=np.uint8)
    contours, tree = cv2.findContours(lattice, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_SIMPLE)

    def polygon_of(k: int) -> Array:
        line = cv2.approxPolyDP(contours[k], 2.0 * epsilon, True)[:, 0]
        if len(line) < 3 and tree[0, k, 3] < 0:  # a thin obstacle stays as it is
            line = contours[k][:, 0]
        return grid.from_lattice(line / 2.0 - edge)

    found = []
    for k in range(len(contours)):
        if tree[0, k, 3] >= 0:  # a hole: taken with the region round it
            continue
        holes, hole = [], int(tree[0, k, 2])
        while hole >= 0:
            polygon = polygon_of(hole)
            if len(polygon) > 2:
                holes.append(_oriented(polygon, -1))
            hole = int(tree[0, hole, 0])
        found.append(PolygonWithHoles(_oriented(polygon_of(k), 1), tuple(holes)))
    return found


def _oriented(polygon: Array, sense: int) -> Array:
    """The polygon counter-clockwise (1) or clockwise (-1)."""
    return polygon if signed_area(polygon) * sense > 0.0 else polygon[::-1].copy()
