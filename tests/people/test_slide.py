"""The program of `slide` is solved exactly, and its constraints are those of the geometry."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from wheelchair_gym.geometry.kinematics import arc_step
from wheelchair_gym.geometry.outline import Footprint, signed_gap
from wheelchair_gym.people.assistance.slide import nearest_twist, write_constraints

OUTLINE = Footprint().array
numbers = st.floats(-1.0, 1.0, allow_nan=False)


@settings(max_examples=200, deadline=None)
@given(
    st.lists(st.tuples(numbers, numbers, st.floats(0.0, 1.0)), min_size=1, max_size=8),
    st.tuples(numbers, numbers),
    st.floats(0.1, 3.0),
)
def test_no_point_that_fits_is_nearer(rows, asked, weight):
    rows = np.array(rows)
    v, w = nearest_twist(rows, len(rows), asked, (1.0, weight))
    assert (rows[:, :2] @ (v, w) <= rows[:, 2] + 1e-6).all()
    cost = (v - asked[0]) ** 2 + weight * (w - asked[1]) ** 2
    grid = np.stack(np.meshgrid(*2 * [np.linspace(-1.2, 1.2, 61)]), -1).reshape(-1, 2)
    fits = (grid @ rows[:, :2].T <= rows[:, 2]).all(axis=1)
    costs = ((grid - asked) ** 2 @ (1.0, weight))[fits]
    assert cost <= costs.min(initial=math.inf) + 1e-9


@pytest.mark.parametrize("point", [(1.2, 0.1), (1.0, 0.9), (0.2, 0.7), (-0.6, -0.5), (0.5, -0.5)])
@pytest.mark.parametrize("twist", [(0.5, 0.0), (0.0, 0.8), (-0.2, 0.4), (0.4, -0.7)])
def test_a_constraint_is_the_rate_at_which_the_distance_shrinks(point, twist):
    points, rows = np.array([point]), np.empty((1, 3))
    assert write_constraints(points, OUTLINE, 0.0, 0.2, rows) == 1
    step = 1e-6
    before = signed_gap(points, len(points), OUTLINE, 0.0, 0.0, 0.0)
    after = signed_gap(points, len(points), OUTLINE, *arc_step(0.0, 0.0, 0.0, *twist, step))
    assert rows[0, :2] @ twist == pytest.approx((before - after) / step, abs=1e-4)


@given(st.floats(0.0, 1.4), st.floats(0.0, 0.1))
def test_the_chair_stops_within_the_distance(distance, margin):
    rows = np.empty((1, 3))
    points = np.array([[OUTLINE[0] + distance, 0.0]])
    write_constraints(points, OUTLINE, margin, 0.2, rows)
    speed = rows[0, 2]
    assert speed >= 0.0
    room = max(0.0, distance - margin)
    assert speed * 0.2 + speed**2 / (2 * 0.6) == pytest.approx(room, abs=1e-9)
