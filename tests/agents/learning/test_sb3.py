"""Laws of the way to stable-baselines3: what it learns from is what the chairs did."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

from agents.learning import curves
from agents.learning.sb3 import SB3VecEnv
from wheelchair_gym.base.settings import InputError
from wheelchair_gym.envs import NavigationEnv, NavigationVectorEnv

SETTINGS = {
    "scene": "clutter",
    "beams": 16,
    "bank": 4,
    "config": {"task": {"time_base": 2.0, "time_factor": 0.0}},
}


def chairs(n):
    mode = AutoresetMode.SAME_STEP
    return SB3VecEnv(NavigationVectorEnv(n, autoreset_mode=mode, **SETTINGS))


def test_ends_of_episodes_are_told_as_single_envs_tell_them():
    n, seed = 3, 5
    many, singles = chairs(n), [NavigationEnv(**SETTINGS) for _ in range(n)]
    many.seed(seed)
    first = many.reset()
    for i, env in enumerate(singles):
        assert np.array_equal(env.reset(seed=seed + i)[0]["laser"], first["laser"][i])
    rng = np.random.default_rng(0)
    returns, lengths, ends, timeouts = np.zeros(n), np.zeros(n, int), 0, 0
    for _ in range(60):
        actions = rng.uniform(-1, 1, (n, 2)).astype(np.float32)
        observations, rewards, dones, infos = many.step(actions)
        for i, env in enumerate(singles):
            observation, reward, terminated, truncated, info = env.step(actions[i])
            returns[i] += reward
            lengths[i] += 1
            assert rewards[i] == np.float32(reward)
            assert dones[i] == (terminated or truncated)
            if not dones[i]:
                assert infos[i] == {}
                continue
            ends += 1
            timeouts += truncated
            for key, value in observation.items():
                assert np.array_equal(infos[i]["terminal_observation"][key], value)
            assert infos[i]["TimeLimit.truncated"] == truncated
            assert infos[i]["is_success"] == info["is_success"]
            assert infos[i]["episode"]["r"] == pytest.approx(returns[i])
            assert infos[i]["episode"]["l"] == lengths[i]
            returns[i], lengths[i] = 0.0, 0
            observation, _ = env.reset()
            assert np.array_equal(observations["laser"][i], observation["laser"])
    assert ends >= 6
    assert timeouts >= 1


def test_a_crash_at_the_last_step_allowed_is_no_truncation():
    """Otherwise a learner would count on what comes after the crash."""
    single = NavigationEnv(scene="empty", beams=8)
    single.reset(seed=5)
    steps, over = 0, False
    while not over:
        _, _, over, truncated, info = single.step(np.array([1.0, 0.0]))
        steps += 1
        assert not truncated
    assert info["bumped"]
    many = SB3VecEnv(
        NavigationVectorEnv(
            1, "empty", beams=8, max_episode_steps=steps, autoreset_mode=AutoresetMode.SAME_STEP
        )
    )
    many.seed(5)
    many.reset()
    sums = Counter()
    for _ in range(steps):
        _, _, dones, infos = many.step(np.array([[1.0, 0.0]]))
        curves.add_ended_episodes(sums, infos, dones)
    assert dones.all()
    assert infos[0]["TimeLimit.truncated"] is False
    assert (sums["episodes"], sums["timeout"]) == (1, 0)


def test_options_are_those_of_the_vector_environment():
    many = chairs(2)
    row = {"reset_mask": np.array([True, False])}
    for options in ({"foo": 1}, [{"foo": 1}, {}], row):
        many.set_options(options)
        with pytest.raises(InputError, match=r"foo|same for all|reset_mask"):
            many.reset()
        many.reset()  # options are of one reset


def test_chairs_that_begin_in_the_step_after_are_refused():
    with pytest.raises(ValueError, match="autoreset_mode is NextStep; expected SameStep"):
        SB3VecEnv(NavigationVectorEnv(2, **SETTINGS))
