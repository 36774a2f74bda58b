"""Laws of angles, frames, distances and actions."""

import cmath
import math

import numpy as np
import pytest
import shapely

from wheelchair_gym.base.settings import InputError
from wheelchair_gym.geometry import planar
from wheelchair_gym.geometry.kinematics import numbers_of
from wheelchair_gym.geometry.planar import wrap, wrap_angle


def test_angles_are_brought_below_pi():
    """Also one so little below -pi that a full turn more is rounded to pi."""
    angles = np.array([np.nextafter(-math.pi, -10.0), -math.pi, math.pi, 3.0, -7.0, 7.0, 1e9])
    for wrapped in (wrap_angle(angles), np.array([wrap(angle) for angle in angles])):
        assert ((wrapped >= -math.pi) & (wrapped < math.pi)).all()
        turns = (angles - wrapped) / math.tau
        assert turns == pytest.approx(np.rint(turns), abs=1e-6)


def test_frames_and_distances_are_those_of_complex_numbers_and_of_shapely():
    for pose, *corners in np.random.default_rng(0).uniform(-5.0, 5.0, (50, 4, 3)):
        a, b, _ = triangle = np.array(corners)[:, :2]
        there = complex(*pose[:2]) + complex(*a) * cmath.exp(1j * pose[2])
        assert complex(*planar.to_world(a, pose)) == pytest.approx(there)
        assert planar.to_frame([there.real, there.imag], pose) == pytest.approx(a)
        gap = shapely.LineString([a, b]).distance(shapely.Point(pose[:2]))
        assert planar.point_segment_distance(*pose[:2], *a, *b) == pytest.approx(gap)
        edges = np.hstack([triangle, triangle[[1, 2, 0]]])
        assert planar.polygon_edges(triangle).tolist() == edges.tolist()


@pytest.mark.parametrize(
    "action",
    ["12", b"ab", {0: 1, 1: 0}, ["0.5", "1"], [[0.1, 0.2]], 0.5, [0.1, math.inf], [[1], 2]],
)
def test_an_action_that_is_not_two_finite_numbers_is_refused(action):
    with pytest.raises(InputError, match="expected two finite numbers"):
        numbers_of(action)


def test_an_action_may_be_two_numbers_of_any_size_and_kind():
    for action in ([1e308, 1e308], (1, -1), np.array([0.5, 0.25], np.float32), [True, False]):
        assert numbers_of(action) == tuple(action)
        assert all(type(number) is float for number in numbers_of(action))
