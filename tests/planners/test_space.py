"""The exact kernels against shapely, degenerate maps included."""

import itertools
import math

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from planners.collision.inflation import inflated_boundary
from planners.collision.solids import union
from planners.collision.space import Space, clearance, edge_free, point_free
from wheelchair_gym.maps import OCCUPIED, OccupancyGrid

BOUNDS = (0.0, 0.0, 8.0, 8.0)
LATTICE = st.integers(-1, 9).map(float)
WHOLE = st.integers(1, 4)
FINE = st.integers(-64, 9 * 64).map(lambda k: k / 64)


@st.composite
def solids(draw, coordinate, side=WHOLE, most=6, flat=0.0):
    """A few overlapping, touching, nested rectangles and triangles that are not flat."""
    found = []
    for _ in range(draw(st.integers(0, most))):
        if draw(st.booleans()):
            x, y = draw(coordinate), draw(coordinate)
            w, h = draw(side), draw(side)
            found.append([(x, y), (x + w, y), (x + w, y + h), (x, y + h)])
        else:
            corners = draw(st.lists(st.tuples(coordinate, coordinate), min_size=3, max_size=3))
            (ax, ay), (bx, by), (cx, cy) = corners
            if abs((bx - ax) * (cy - ay) - (by - ay) * (cx - ax)) > flat:
                found.append(corners)
    return found


def agrees(space, points, edges):
    """Compare with shapely's answers on the same free polygons."""
    arrays, free = space.arrays, space.free
    for point in points:
        at = shapely.Point(point)
        covered = free.covers(at)
        assert point_free(arrays, *point) == covered, (point, free.wkt)
        expected = at.distance(free.boundary) if covered else 0.0
        assert clearance(arrays, *point) == pytest.approx(expected, abs=1e-9)
    for a, b in edges:
        way = shapely.LineString([a, b]) if a != b else shapely.Point(a)
        assert edge_free(arrays, *a, *b) == free.covers(way), (a, b, free.wkt)
        assert edge_free(arrays, *b, *a) == edge_free(arrays, *a, *b)


@settings(max_examples=120, deadline=None)
@given(solids(LATTICE), st.lists(st.tuples(LATTICE, LATTICE), min_size=4, max_size=8))
def test_lattice_maps_agree_with_shapely(polygons, points):
    # Unions of lattice rectangles have lattice corners, where shapely's answers are exact too;
    # of slanted sides only the first is kept, for where two cross, shapely rounds.
    straight = [p for p in polygons if len(p) == 4]
    slanted = [p for p in polygons if len(p) == 3][:1]
    space = Space(union(straight or slanted), BOUNDS)
    agrees(space, points, [(a, b) for a in points for b in points])


@settings(max_examples=60, deadline=None)
@given(solids(FINE), st.lists(st.tuples(FINE, FINE), min_size=4, max_size=6))
def test_any_maps_agree_with_shapely(polygons, points):
    space = Space(union(polygons), BOUNDS)
    # Clear of doubt: shapely rounds where sides cross, so leave what only nearly touches to it.
    edges = [(a, b) for a in points for b in points]
    arrays, free = space.arrays, space.free
    for a, b in edges:
        way = shapely.LineString([a, b]) if a != b else shapely.Point(a)
        if edge_free(arrays, *a, *b):
            assert shapely.difference(way, free.buffer(1e-9)).length == 0.0
        else:
            assert not free.buffer(-1e-9).covers(way)


@settings(max_examples=40, deadline=None)
@given(solids(FINE), st.lists(st.tuples(FINE, FINE), min_size=4, max_size=4), st.floats(0.01, 1.5))
def test_inflation_is_never_too_small_and_hardly_too_large(polygons, points, radius):
    space = Space(union(polygons), BOUNDS)
    grown = space.inflated(radius)
    assert grown is space.inflated(radius)
    if not grown.free.is_empty:
        corners = shapely.points(shapely.get_coordinates(grown.free))
        minimum = radius - 1e-12
        assert (shapely.distance(corners, space.solid) >= minimum).all() or space.solid.is_empty
        boundary = shapely.distance(grown.free.boundary, space.solid)
        assert space.solid.is_empty or boundary >= minimum
    for point in points:
        gap = clearance(space.arrays, *point)
        if point_free(grown.arrays, *point):
            assert gap >= radius - 1e-12
        elif point_free(space.arrays, *point):  # too large by at most the corners of its arcs
            assert gap <= radius / math.cos(math.pi / 16) + 1e-6


@settings(max_examples=40, deadline=None)
@given(
    st.integers(0, 2**32),
    st.integers(2, 30),
    st.sampled_from([0.02, 0.1, 0.3, 0.6]),
    st.sampled_from([0.05, 0.1, 0.25, 0.35, 0.1234]),  # many are whole numbers of cells
)
def test_erosion_of_rasters_agrees_with_unions(seed, side, share, radius):
    cells = (np.random.default_rng(seed).random((side, side)) < share).astype(np.int8)
    space = Space.from_grid(OccupancyGrid(OCCUPIED * cells, 0.05))
    edges = inflated_boundary(space.arrays, radius)
    bounds = np.array(space.bounds) + radius * np.array([1, 1, -1, -1])
    left = Space(None, bounds, edges=edges)
    assert len(left.mesh.across) >= 0  # loops that cross nowhere
    if bounds[0] >= bounds[2] or left.free.is_empty or space.solid.is_empty:
        return
    assert shapely.distance(left.free.boundary, space.solid) >= radius - 1e-12
    wide = shapely.box(*space.bounds).buffer(-1.021 * radius, join_style="mitre")
    sure = shapely.difference(wide, shapely.buffer(space.solid, 1.021 * radius, quad_segs=32))
    assert shapely.difference(sure, left.free).area < 1e-12


def test_what_kernels_cannot_fit_together_is_united(monkeypatch):
    squares, points = [(2, 2, 4, 4), (4, 4, 6, 6)], np.random.default_rng(0).uniform(0, 8, (200, 2))
    quick = Space.from_rectangles(squares, BOUNDS).inflated(0.5)
    crossed = np.array([(1, 1, 7, 7), (7, 7, 7, 1), (7, 1, 1, 7), (1, 7, 1, 1)], dtype=float)
    monkeypatch.setattr(
        "planners.collision.space.inflated_boundary", lambda arrays, radius: crossed
    )
    united = Space.from_rectangles(squares, BOUNDS).inflated(0.5)
    assert quick.bounds == united.bounds
    assert shapely.area(quick.free) == pytest.approx(shapely.area(united.free), abs=0.01)
    for x, y in points:
        assert point_free(quick.arrays, x, y) == point_free(united.arrays, x, y)


SQUARES = [[(2, 2), (4, 2), (4, 4), (2, 4)], [(4, 4), (6, 4), (6, 6), (4, 6)]]


def test_nan_is_not_free():
    arrays = Space(union(SQUARES), BOUNDS).arrays
    assert not point_free(arrays, math.nan, 1.0)
    assert not edge_free(arrays, 1.0, 1.0, math.nan, 1.0)


def raster(cells):
    """An occupancy grid of unit cells that are solid where `cells` (rows, columns) says so."""
    return OccupancyGrid(OCCUPIED * np.asarray(cells, dtype=np.int8), 1.0)


@pytest.mark.parametrize(
    "cells",
    [
        np.indices((6, 6)).sum(axis=0) % 2,  # checkerboard
        np.eye(6, dtype=int),  # touching diagonally
        np.zeros((5, 7), dtype=int),
        np.ones((4, 4), dtype=int),
        np.pad(np.ones((1, 1), dtype=int), 2),  # a single cell
        np.pad(np.zeros((2, 2), dtype=int), 1, constant_values=1),  # a closed box
        np.random.default_rng(0).integers(0, 2, (9, 9)),
        (np.random.default_rng(1).random((20, 20)) < 0.3).astype(int),
    ],
)
def test_grids_are_what_their_cells_say(cells):
    space = Space.from_grid(raster(cells))
    arrays = space.arrays
    for (i, j), solid in np.ndenumerate(cells):
        assert point_free(arrays, j + 0.5, i + 0.5) == (solid == 0)
    rng = np.random.default_rng(2)
    points = [tuple(map(float, p)) for p in rng.integers(0, 2 * cells.shape[1] + 1, (40, 2)) / 2]
    agrees(space, points, list(itertools.pairwise(points)))


def test_discs_are_wholly_solid():
    space = Space.from_walls(np.empty((0, 4)), [(4.0, 4.0, 1.5)], BOUNDS)
    angles = np.linspace(0, 2 * math.pi, 400)
    for angle in angles:
        x, y = 4 + 1.4999 * math.cos(angle), 4 + 1.4999 * math.sin(angle)
        assert not point_free(space.arrays, x, y)
        assert point_free(space.arrays, 4 + (x - 4) * 1.01, 4 + (y - 4) * 1.01)


def test_a_hole_runs_against_the_loop_around_it():
    def loop(low, high, turn=1):
        corners = [(low, low), (high, low), (high, high), (low, high)][::turn]
        return [(*a, *b) for a, b in zip(corners, corners[1:] + corners[:1], strict=True)]

    def free(*loops):
        arrays = Space.from_walls(np.vstack(loops), np.empty((0, 3)), BOUNDS).arrays
        return [point_free(arrays, x, 4.0) for x in (0.5, 1.5, 2.5, 4.0)]

    assert free(loop(1, 7), loop(2, 6, -1), loop(3, 5)) == [True, False, True, False]
    assert free(loop(1, 7), loop(2, 6), loop(3, 5)) == [True, False, False, False]
    assert free(loop(1, 7, -1)) == [True, False, False, False]


@pytest.mark.parametrize("radius", [-0.1, math.nan, math.inf])
def test_impossible_radius_is_an_error(radius):
    with pytest.raises(ValueError, match="radius"):
        Space(union(SQUARES), BOUNDS).inflated(radius)
