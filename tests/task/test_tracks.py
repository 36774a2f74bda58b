"""Laws of tracks as they are observed: those of the tracker, the nearest first."""

import numpy as np
import pytest

from wheelchair_gym.envs import NavigationEnv
from wheelchair_gym.geometry.planar import to_frame
from wheelchair_gym.perception.tracker import Tracker
from wheelchair_gym.task.observations import TRACK_REACH, TRACK_SPEED

MAXIMUM = 4  # tracks that are observed
HALL = {
    "name": "crowd", "place": "hall", "hall_size": [8.0, 10.0], "furniture_density": 0.0,
    "people": {"density": [0.3, 0.3]},
}  # fmt: skip
CONFIG = {"scene": HALL, "rate": 5.0, "task": {"tracks": MAXIMUM, "beams": 64}}


def expected(tracks, pose):
    """The nearest confirmed tracks (4, 5), zeros after the last."""
    out = np.zeros((MAXIMUM, 5), np.float32)
    place = to_frame(tracks.place, pose)
    velocity = to_frame(tracks.velocity, np.array([0.0, 0.0, pose[2]]))
    far = np.hypot(*place.T)
    chosen = np.flatnonzero(tracks.confirmed & (far <= TRACK_REACH))
    chosen = chosen[np.argsort(far[chosen])][:MAXIMUM]
    rows = np.column_stack([np.ones(len(chosen)), place[chosen], velocity[chosen]])
    out[: len(chosen)] = rows
    out[:, 3:] = out[:, 3:].clip(-TRACK_SPEED, TRACK_SPEED)
    return out


def actions(count):
    rng = np.random.default_rng(1)
    return rng.uniform(-0.3, 0.6, (count, 2)).astype(np.float32)


def test_they_are_those_of_a_tracker_without_a_map():
    env = NavigationEnv(config=CONFIG)
    maximum = 0
    for seed in range(3):
        observation, _ = env.reset(seed=seed)
        tracker = Tracker(laser=env.settings.sensors.laser)
        for action in actions(40):
            reading = env.task.reading
            twist, laser = np.array(reading.twist), reading.laser
            tracks = tracker.update(laser, np.array(reading.pose), twist, reading.stamp)
            wanted = expected(tracks, np.array(reading.pose))
            assert observation["tracks"].reshape(MAXIMUM, 5) == pytest.approx(wanted, abs=1e-4)
            maximum = max(maximum, int(wanted[:, 0].sum()))
            assert env.observation_space.contains(observation)
            observation, _, terminated, truncated, _ = env.step(action)
            if terminated or truncated:
                break
    assert maximum == MAXIMUM
