"""Curves through points, beside scipy's."""

import numpy as np
import pytest
from scipy.interpolate import CubicSpline, PchipInterpolator

from planners.smoothing.curves import CURVES, curve

ORACLES = {"pchip": PchipInterpolator, "spline": CubicSpline}


@pytest.mark.parametrize("name", ORACLES)
@pytest.mark.parametrize("chordal", [False, True])
@pytest.mark.parametrize("n", [2, 3, 4, 5, 15])
def test_curves_are_those_of_scipy(name, chordal, n):
    for seed in range(20):
        points = np.random.default_rng(seed).uniform(0, 10, (n, 2)).round(seed % 3)
        points[1:] += np.arange(1, n)[:, None] * 1e-3  # apart
        gaps = np.hypot(*np.diff(points, axis=0).T) if chordal else np.ones(n - 1)
        knots = np.concatenate([[0.0], np.cumsum(gaps)])
        at = np.concatenate([knots[:-1, None] + gaps[:, None] * np.arange(7) / 7]).ravel()
        expected = ORACLES[name](knots, points)(np.append(at, knots[-1]))
        np.testing.assert_allclose(curve(points, name, 7, chordal), expected, atol=1e-9)


@pytest.mark.parametrize("name", CURVES)
def test_curves_pass_through_their_points_even_where_these_coincide(name):
    points = np.array([(0.0, 0.0), (1.0, 2.0), (1.0, 2.0), (4.0, 2.0), (5.0, 0.0)])
    for chordal in (False, True):
        line = curve(points, name, 10, chordal)
        assert np.isfinite(line).all()
        np.testing.assert_array_equal(line[::10], points)
