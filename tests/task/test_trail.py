"""Laws of the trail: it tells where a chair was, by way, in its own frame."""

import numpy as np
import pytest

from wheelchair_gym.envs import NavigationEnv
from wheelchair_gym.geometry.planar import to_frame
from wheelchair_gym.task.assessment import PROGRESS, TRAIL_POINTS
from wheelchair_gym.task.observations import TRAIL_SPACING, extend_trail, reset_trail, write_trail

OPEN = {"name": "empty", "size": (12.0, 12.0), "start": (6.0, 6.0, 0.0), "goal": (1.0, 1.0, 0.0)}


def seen(own, pose, ways):
    out = np.empty(2 * len(ways), np.float32)
    write_trail(own, np.array(pose), np.array(ways), out)
    return out.reshape(-1, 2)


def test_a_trail_follows_the_way_and_its_last_16_m():
    own = np.zeros(1, PROGRESS)[0]
    along = np.arange(0.0, 30.0, 0.16)
    poses = np.stack([4.0 * np.cos(along / 4.0), 4.0 * np.sin(along / 4.0), along / 4.0], axis=-1)
    reset_trail(own, poses[0])
    for k, pose in enumerate(poses):
        extend_trail(own, pose)
        ways = [0.0, 1.0, 5.0, 15.0]
        for way, place in zip(ways, seen(own, pose, ways), strict=True):
            ago = max(0.0, along[k] - way)
            was = [np.interp(ago, along, poses[:, i]) for i in range(2)]
            assert place == pytest.approx(to_frame(was, pose), abs=1.1 * TRAIL_SPACING)
    assert own["n_trail"] > TRAIL_POINTS


def test_a_pose_that_trembles_leaves_no_trail():
    own, rng = np.zeros(1, PROGRESS)[0], np.random.default_rng(0)
    reset_trail(own, np.zeros(3))
    for _ in range(1000):
        extend_trail(own, rng.normal(0.0, 0.03, 3))
    assert own["n_trail"] == 1


@pytest.mark.parametrize("jump", [np.nan, np.inf, 1e300, 100.0])
def test_a_pose_that_jumps_or_is_lost_ends_nothing(jump):
    own = np.zeros(1, PROGRESS)[0]
    reset_trail(own, np.zeros(3))
    extend_trail(own, np.array([jump, 0.0, 0.0]))
    assert own["n_trail"] <= TRAIL_POINTS + 1


def test_it_is_observed_and_begins_anew_with_each_episode():
    task = {"beams": 16, "trail": [1.0, 15.0]}
    env = NavigationEnv(scene=OPEN, config={"task": task})
    for seed in range(2):
        observation, _ = env.reset(seed=seed)
        assert observation["trail"] == pytest.approx(np.zeros(4))
        for _ in range(60):
            observation, *_, info = env.step(np.array([0.6, 0.6]))
        assert env.observation_space.contains(observation)
        near, far = observation["trail"].reshape(2, 2)
        assert np.hypot(*near) == pytest.approx(1.0, abs=0.3)
        start = to_frame(env.task.start[:2], info["pose"])
        assert far == pytest.approx(start, abs=0.3)
