"""Laws of the triangles that fill what is free, on degenerate maps as well."""

from fractions import Fraction

import numpy as np
import pytest
import shapely
from hypothesis import example, given, settings
from hypothesis import strategies as st

from planners import Space
from planners.collision.boundary import NONE, boundary
from planners.collision.solids import union
from planners.collision.triangulation import mesh
from tests.planners.test_space import BOUNDS, FINE, LATTICE, SQUARES, raster, solids


def assert_fills(space):
    """The triangles cover what is free, once, and know each other."""
    parts, free = space.mesh, space.free
    a, b, c = parts.points[parts.corners].transpose(1, 0, 2)
    areas = 0.5 * ((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0])
    # Exactly: of a triangle as flat as a rounding error the float may be 0.
    flat = parts.points[parts.corners[areas <= 1e-9]]
    for triangle in flat:
        (x0, y0), (x1, y1), (x2, y2) = ((Fraction(x), Fraction(y)) for x, y in triangle.tolist())
        assert (x1 - x0) * (y2 - y0) > (y1 - y0) * (x2 - x0)
    assert areas.sum() == pytest.approx(shapely.area(free), rel=1e-9, abs=1e-12)
    inside = shapely.points((a + b + c) / 3.0)
    assert (shapely.distance(inside, free) < 1e-9).all()
    assert (parts.across == NONE).sum() == len(space.arrays.segments)
    for t, k in np.argwhere(parts.across != NONE):
        other, side = divmod(parts.across[t, k], 3)
        assert parts.across[other, side] == 3 * t + k
        mine = parts.corners[t, [k, (k + 1) % 3]]
        assert (parts.corners[other, [(side + 1) % 3, side]] == mine).all()


@settings(max_examples=80, deadline=None)
@given(st.one_of(solids(LATTICE), solids(FINE)))
@example([[(2.0, 0.0), (3.0, 0.0), (3.0, 3.0), (2.0, 3.0)], [(0.0, 0.0), (-1.0, 1.0), (8.0, 7.0)]])
def test_triangles_fill_what_is_free(polygons):
    assert_fills(Space(union(polygons), BOUNDS))


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**32), st.integers(1, 12), st.floats(0.1, 0.9))
def test_triangles_fill_what_is_free_of_any_raster(seed, side, share):
    cells = np.random.default_rng(seed).random((side, side + 1)) < share
    assert_fills(Space.from_grid(raster(cells)))


def test_loops_that_cross_or_stay_open_are_refused():
    segments = Space(union(SQUARES), BOUNDS).arrays.segments
    with pytest.raises(ValueError, match="loops"):
        mesh(boundary(segments[:-1]))
    with pytest.raises(ValueError, match="loops"):
        mesh(boundary(segments[:, [2, 3, 0, 1]]))
