"""SLAM: better than the wheels, the same for the same seed."""

from unittest.mock import patch

import numpy as np
import pytest

from agents.evaluation.evaluate import env_settings, make_env
from agents.policies import GymPolicy, make_policy
from tests.perception.rooms import LASER, away, ranges, tour
from wheelchair_gym.base.settings import InputError
from wheelchair_gym.geometry.planar import compose, relative_pose
from wheelchair_gym.maps import OCCUPIED, UNKNOWN
from wheelchair_gym.perception.occupancy import OccupancyMap
from wheelchair_gym.perception.slam import Slam, SlamSettings
from wheelchair_gym.sensors.settings import LaserSettings

# Odometry that drifts in the room: 5 % too far, and to the left.
MAPPING = {}  # settings of its map
DRIFT = np.array([1.05, 1.0, 1.0]), np.array([0.0, 0.0, 0.006])


def driven(particles, seed=0, learn=True):
    """A SLAM's poses, a drifting odometry's and the truth."""
    rng = np.random.default_rng(5)
    truth = np.concatenate([tour(90), np.add(tour(90)[::-1], (0, 0, np.pi))])
    settings = SlamSettings(particles=particles, **MAPPING)
    slam = Slam(LASER, settings, seed, truth[0])
    wheels, poses = [truth[0]], []
    for k in range(len(truth)):
        moved = relative_pose(truth[k - 1], truth[k]) * DRIFT[0] + DRIFT[1] if k else np.zeros(3)
        if k == 90:
            moved = np.array([0.0, 0.0, np.pi])  # it turns on the spot
        if k:
            wheels.append(compose(wheels[-1], moved))
        poses.append(slam.update(moved, ranges(truth[k], rng), learn or k < 90))
    return slam, np.array(poses), np.array(wheels), truth


@pytest.mark.parametrize("particles", [1, 8])
def test_a_drifting_chair_finds_itself_and_the_room(particles):
    slam, poses, wheels, truth = driven(particles)
    error = np.hypot(*(poses - truth)[:, :2].T)
    assert np.hypot(*(wheels - truth)[-1, :2]) > 0.4
    assert error.max() < 0.12
    assert np.sqrt((error**2).mean()) < 0.05
    assert np.degrees(np.abs(relative_pose(truth, poses)[:, 2])).mean() < 1.5
    grid = slam.built_map()
    solid = grid.to_world(np.argwhere(grid.cells == OCCUPIED))
    assert np.percentile(away(solid), 95) < 0.10
    assert slam.trajectory.shape == truth.shape
    np.testing.assert_allclose(slam.trajectory[-1], poses[-1], atol=1e-12)


def test_the_same_seed_is_the_same_run_and_another_seed_is_not():
    one, two, other = driven(6), driven(6), driven(6, seed=1)
    np.testing.assert_array_equal(one[1], two[1])
    np.testing.assert_array_equal(one[0].built_map().cells, two[0].built_map().cells)
    assert (one[1] != other[1]).any()


def test_memory_in_reserve_spares_the_map_to_grow_and_changes_nothing_else(monkeypatch):
    _, poses, _, _ = driven(8)
    monkeypatch.setitem(MAPPING, "reserve", 25.0)
    replace = OccupancyMap._replace
    with patch.object(OccupancyMap, "_replace", autospec=True, side_effect=replace) as grown:
        slam, others, _, _ = driven(8)
    assert grown.call_count == 2  # nothing, and all that it has in reserve
    np.testing.assert_allclose(poses, others, atol=0.02)
    assert min(slam.built_map().cells.shape) * slam.maps.settings.resolution < 40.0


def test_scans_that_are_not_to_be_learned_leave_the_map():
    short, long = driven(1, learn=False)[0], driven(1)[0]
    first = Slam(LASER, SlamSettings(particles=1), 0, tour(90)[0])
    assert (short.built_map().cells == OCCUPIED).sum() < (long.built_map().cells == OCCUPIED).sum()
    assert (first.built_map().cells == UNKNOWN).all()


def test_slam_beats_odometry_in_a_floor_plan_with_all_noise():
    env = make_env("floor_plan", env_settings(pose_source="odometry", config=None))
    observation, info = env.reset(seed=5)
    task, policy = env.unwrapped.task, GymPolicy(make_policy("a_star+window"), env)
    policy.reset()
    reading = task.reading
    slam = Slam(LaserSettings(), SlamSettings(particles=4), 0, reading.pose)
    poses = [slam.update(np.zeros(3), reading.laser)]
    wheels, truth = [reading.pose.copy()], [np.array(info["pose"])]
    ended = truncated = False
    while not (ended or truncated):
        observation, _, ended, truncated, info = env.step(policy.act(observation))
        reading = task.reading
        poses.append(slam.update(relative_pose(wheels[-1], reading.pose), reading.laser))
        wheels.append(reading.pose.copy())
        truth.append(np.array(info["pose"]))
    env.close()

    def rms(estimate):
        gap = relative_pose(np.array(truth), np.array(estimate))
        return np.sqrt((gap[:, :2] ** 2).sum(1).mean()), np.sqrt((gap[:, 2] ** 2).mean())

    (way, turn), (drift, twist) = rms(poses), rms(wheels)
    assert way < 0.5 * drift
    assert turn < 0.5 * twist
    assert way < 0.05
    assert np.degrees(turn) < 1.5


@pytest.mark.parametrize(
    "wrong",
    [
        lambda slam: slam.update((0, np.nan, 0), None),
        lambda slam: slam.update((0, 0), None),
        lambda slam: slam.update(np.zeros(3), np.ones(3)),
    ],
)
def test_misuse_is_named(wrong):
    slam = Slam(LASER, SlamSettings(particles=1))
    slam.update(np.zeros(3), ranges(tour()[0]))
    with pytest.raises(InputError):
        wrong(slam)
