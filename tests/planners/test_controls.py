"""Controls: what is rolled out is free by shapely, within the chair's limits, and arrives."""

import numpy as np
import pytest
import shapely

from planners.judge import sweep_faults
from planners.rrt_star_woa.control_generator import ControlGenerator
from planners.rrt_star_woa.rollout import STEP, rollout, time_to_cover
from tests.scenes.test_footprints import solid
from wheelchair_gym.geometry.kinematics import Limits
from wheelchair_gym.geometry.outline import Footprint

LIMITS, FOOTPRINT = Limits(), Footprint()
PATH = np.array([(0, 0), (3, 0), (3, 4), (6, 4.5), (9, 9)], dtype=float)
WALLS = np.array(
    [(-1, 1, 2, 1), (2, 1, 2, 5.5), (-1, -1, 4, -1), (4, -1, 4, 3), (4, 3, 7, 3), (2, 5.5, 5, 5.5)],
    dtype=float,
)
DISCS = np.array([(7.0, 7.6, 0.5)])
START = np.zeros(3)


def generate(generator, path=PATH, start=START, walls=WALLS, discs=DISCS, seed=0, twist=(0, 0)):
    rng = np.random.default_rng(seed)
    return generator.generate(path, start, walls, discs, FOOTPRINT, LIMITS, rng, twist)


def assert_clear(controls, walls, discs):
    """No outline on the way, nor between two poses of the way, touches anything, as is said."""
    assert controls.collision_free
    things, bounds = shapely.union_all(solid(walls, discs)), (-99.0, -99.0, 99.0, 99.0)
    assert not sweep_faults(controls.rollout, FOOTPRINT.corners, things, bounds, margin=2e-6)


@pytest.mark.parametrize("seed", range(3))
def test_a_path_is_driven_to_its_end_within_the_limits(seed):
    controls = generate(ControlGenerator(), seed=seed)
    assert controls.arrived
    assert np.hypot(*(controls.rollout[-1, :2] - PATH[-1])) == pytest.approx(controls.error)
    assert controls.error <= 0.1
    np.testing.assert_array_equal(controls.twists[-1], 0.0)
    assert_clear(controls, WALLS, DISCS)
    v, w = controls.twists.T
    assert v.max() <= LIMITS.forward + 1e-9
    assert v.min() >= -LIMITS.backward - 1e-9
    assert abs(w).max() <= LIMITS.turn + 1e-9
    steps = np.diff(controls.times)
    rate, turn = np.diff(v) / steps, np.diff(w) / steps
    assert abs(rate).max() <= max(LIMITS.acceleration, LIMITS.deceleration) + 1e-9
    assert (rate[v[:-1] >= 0] <= LIMITS.acceleration + 1e-9).all()
    assert abs(turn).max() <= LIMITS.turn_acceleration + 1e-9


def test_commands_reproduce_the_rollout_and_repeat():
    controls, again = (generate(ControlGenerator()) for _ in range(2))
    np.testing.assert_array_equal(controls.commands, again.commands)
    poses, twists, times = rollout(
        controls.commands, START, np.zeros(2), LIMITS.record, LIMITS.turn
    )
    np.testing.assert_array_equal(poses, controls.rollout)
    np.testing.assert_array_equal(twists, controls.twists)
    assert times[-1] == pytest.approx(controls.commands[:, 2].sum())
    np.testing.assert_array_equal(controls.twist_at(0.0), controls.commands[0, :2])
    np.testing.assert_array_equal(controls.twist_at(times[-1] + 1.0), 0.0)


def test_the_rollout_is_the_odometric_model():
    controls = generate(ControlGenerator())
    (x, y, yaw), (v, w) = controls.rollout.T, controls.twists.T
    steps = np.diff(controls.times)
    way, turn = 0.5 * (v[:-1] + v[1:]) * steps, 0.5 * (w[:-1] + w[1:]) * steps
    np.testing.assert_allclose(np.diff(yaw), turn, atol=1e-12)
    np.testing.assert_allclose(np.diff(x), way * np.cos(yaw[:-1] + turn / 2), atol=1e-12)
    np.testing.assert_allclose(np.diff(y), way * np.sin(yaw[:-1] + turn / 2), atol=1e-12)
    assert steps.max() <= STEP + 1e-12


@pytest.mark.parametrize("start", [(1.5, 0.1, 0.2), (3.0, 2.0, 1.2), (0.5, -0.2, -0.5)])
def test_a_moving_chair_is_taken_on_to_the_horizon(start):
    controls = generate(ControlGenerator(horizon=2.0), start=np.array(start), twist=(0.5, 0.1))
    assert controls.arrived
    np.testing.assert_array_equal(controls.rollout[0], start)
    np.testing.assert_array_equal(controls.twists[0], (0.5, 0.1))
    np.testing.assert_array_equal(controls.twists[-1], 0.0)
    assert_clear(controls, WALLS, DISCS)


def test_where_nothing_leads_on_the_chair_stops_and_says_so():
    wall = np.array([(2.0, -3.0, 2.0, 3.0)])
    path = np.array([(0.0, 0.0), (4.0, 0.0)])
    controls = generate(ControlGenerator(), path=path, walls=wall, twist=(0.5, 0.0))
    assert not controls.arrived
    assert_clear(controls, wall, DISCS)


def test_a_dead_end_is_left_backward():
    """Too narrow to turn in: the rectangle's diagonal is longer than the alley is wide."""
    walls = np.array([(-1, 0.45, 2, 0.45), (-1, -0.45, 2, -0.45), (2, -0.45, 2, 0.45)], dtype=float)
    path = np.array([(1.0, 0.0), (-2.5, 0.0)])
    start = np.array([1.0, 0.0, 0.0])
    controls = generate(ControlGenerator(), path=path, start=start, walls=walls)
    assert controls.arrived
    assert controls.twists[:, 0].min() < -0.1
    assert_clear(controls, walls, DISCS)


@pytest.mark.parametrize("path", [PATH, np.zeros((2, 2))])
def test_a_chair_in_contact_is_not_called_free(path):
    wall = np.array([(0.5, -3.0, 0.5, 3.0)])
    controls = generate(ControlGenerator(), path=path, walls=wall)
    assert not controls.collision_free
    assert not controls.arrived


@pytest.mark.parametrize("amount", [0.01, 0.1, 1.0, 5.0])
@pytest.mark.parametrize("speed", [0.1, 0.8])
def test_a_way_is_covered_from_rest_to_rest(amount, speed):
    a, d, j = LIMITS.acceleration, LIMITS.deceleration, LIMITS.jerk
    commands = np.array(
        [(speed, 0.0, time_to_cover(amount, speed, a, d, j, True, 0.0)), (0, 0, 4.0)]
    )
    poses, _, _ = rollout(commands, START, np.zeros(2), LIMITS.record, LIMITS.turn)
    assert poses[-1, 0] == pytest.approx(amount, abs=3e-3)
