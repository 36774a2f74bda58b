"""Laws of encoders, dead reckoning and pose sources."""

import math

import numpy as np
import pytest

from tests.sim.worlds import box, drive_for, drives, exact_chair, placed
from wheelchair_gym.geometry.planar import wrap_angle
from wheelchair_gym.sensors.settings import ModelledPose, OdometrySettings, SensorSettings
from wheelchair_gym.sim.chair import SimulatedChair


def wander(chair, steps, seed=0):
    """Random driving; yields readings and truths."""
    rng = np.random.default_rng(seed)
    twist = np.zeros(2)
    for k in range(steps):
        if k % 8 == 0:
            twist = rng.uniform((-0.3, -0.8), (0.8, 0.8))
        yield chair.drive(twist), chair.truth


def test_without_errors_dead_reckoning_holds_to_the_encoder_quantum():
    sensors = SensorSettings(noise=False, pose_source="odometry")
    chair = placed(SimulatedChair(sensors=sensors), box(50))
    for reading, truth in wander(chair, 300):
        gap = reading.pose - truth.pose
        assert np.hypot(*gap[:2]) < 0.01
        assert abs(wrap_angle(gap[2])) < 0.005


def test_twist_errs_by_at_most_a_count_in_a_period():
    chair = placed(exact_chair(), box(50))
    quantum = 1 / 4346 / 0.1
    reading = drive_for(chair, np.array([0.5, 0.0]), 60)
    assert reading.twist[0] == pytest.approx(chair.truth.twist[0], abs=2 * quantum)
    counts = reading.twist[0] / quantum
    assert 2 * counts == pytest.approx(round(2 * counts), abs=1e-6)


def test_systematic_errors_lie_within_their_bounds_and_differ_by_episode():
    chair = SimulatedChair()
    e_d, e_b = [], []
    for key in range(300):
        chair.reset(box(50), key)
        p = chair.parameters[0]
        e_d.append(p["radius_right"] / p["radius_left"] - 1)
        e_b.append(p["track"] / p["nominal_track"] - 1)
    for errors, bound in ((e_d, 0.005), (e_b, 0.01)):
        assert np.abs(errors).max() <= bound * 1.005
        assert np.std(errors) == pytest.approx(bound / math.sqrt(3), rel=0.1)


def test_variance_grows_with_the_way():
    """1 mm2 per metre of each wheel: over 5 m straight, the way errs by sqrt(5/2) mm."""
    only = OdometrySettings(diameter_error=0.0, track_error=0.0, variance=1e-4)
    sensors = SensorSettings(odometry=only, pose_source="odometry")
    chair = SimulatedChair(sensors=sensors)
    errors = []
    for key in range(60):
        chair.reset(box(50), key)
        reading = drive_for(chair, np.array([0.8, 0.0]), 80)
        errors.append(reading.pose[0] - chair.truth.pose[0])
    way = chair.truth.distance
    assert np.std(errors) == pytest.approx(math.sqrt(0.5 * 1e-4 * way), rel=0.3)


def test_modelled_pose_has_its_deviation_correlation_and_clip():
    model = ModelledPose(position=0.03, heading=math.radians(1), time=2.0)
    chair = SimulatedChair(sensors=SensorSettings(pose_source="modelled", modelled=model))
    errors = []
    for key in range(40):
        reading = chair.reset(box(50), key)
        rows = [reading.pose - chair.truth.pose]
        for reading in drives(chair, np.zeros(2), 100):
            rows.append(reading.pose - chair.truth.pose)
        errors.append(rows)
    e = np.array(errors)  # (40, 101, 3)
    assert e[..., :2].std() == pytest.approx(0.03, rel=0.1)
    assert e[..., 2].std() == pytest.approx(math.radians(1), rel=0.15)
    assert np.abs(e[..., :2]).max() <= 0.10
    assert np.abs(e[..., 2]).max() <= math.radians(3)
    after = (e[:, :-20, :2] * e[:, 20:, :2]).mean() / e[..., :2].var()
    assert after == pytest.approx(math.exp(-1), abs=0.12)


def test_truth_is_the_truth():
    chair = placed(SimulatedChair(sensors=SensorSettings(pose_source="truth")), box(50), 3)
    for reading, truth in wander(chair, 50):
        assert reading.pose == pytest.approx(truth.pose, abs=1e-12)


def test_mass_friction_and_gain_are_drawn_within_their_bounds():
    chair = exact_chair(randomize=True)
    rows = []
    for key in range(200):
        chair.reset(box(), key)
        rows.append(chair.parameters[0][["mass", "friction", "gain"]].tolist())
    low, high = np.min(rows, 0), np.max(rows, 0)
    assert (low >= (100, 0.5, 0.9)).all()
    assert (high <= (180, 0.9, 1.1)).all()
    assert (high - low > 0.9 * np.array((80, 0.4, 0.2))).all()
