"""Laws of many chairs at once: row i is the single env seeded with seed + i, bit for bit."""

from __future__ import annotations

import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

from wheelchair_gym.envs import NavigationEnv, NavigationVectorEnv

NEXT, SAME = AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP
QUICK = {"scene": {"name": "clutter"}, "beams": 64, "bank": {"size": 6, "turnover": 0.5}}
SHORT = {"task": {"time_base": 4.0, "time_factor": 0.0}}  # episodes of at most 40 steps


def flat(info):
    """The numbers of an info, reward terms among them."""
    return {
        **{name: value for name, value in info.items() if name != "reward_terms"},
        **{f"terms.{name}": value for name, value in info["reward_terms"].items()},
    }


def assert_same(row, n, batch, single):
    """Observation and info of one row of a batch are those of a single env."""
    (observations, infos), (observation, info) = batch, single
    for key, value in observation.items():
        assert value.dtype == observations[key].dtype == np.float32
        assert np.array_equal(value, observations[key][row]), key
    rows = flat(infos)
    for name, value in flat(info).items():
        assert np.array_equal(value, rows[name][row]), name
        assert rows[name].shape[0] == n


def compare(mode, threads, n, steps, seed=7, **settings):
    """Drive a batch and single envs with the same actions; returns how many episodes ended."""
    batch = NavigationVectorEnv(n, num_threads=threads, autoreset_mode=mode, **settings)
    singles = [NavigationEnv(**settings) for _ in range(n)]
    rng = np.random.default_rng(seed)
    observations, infos = batch.reset(seed=seed)
    for i, env in enumerate(singles):
        assert_same(i, n, (observations, infos), env.reset(seed=seed + i))
    over = np.zeros(n, bool)
    ends = 0
    for _ in range(steps):
        actions = rng.uniform(-1.3, 1.3, (n, 2)).astype(np.float32)
        actions[:, 0] = np.abs(actions[:, 0])
        observations, rewards, terminated, truncated, infos = batch.step(actions)
        for i, env in enumerate(singles):
            if over[i]:  # NEXT_STEP: this step only began the next episode
                assert (rewards[i], terminated[i], truncated[i]) == (0.0, False, False)
                assert_same(i, n, (observations, infos), env.reset())
                over[i] = False
                continue
            observation, *outcome, info = env.step(actions[i])
            assert outcome == [rewards[i], terminated[i], truncated[i]]
            if not (terminated[i] or truncated[i]):
                assert_same(i, n, (observations, infos), (observation, info))
                continue
            ends += 1
            if mode is NEXT:
                assert_same(i, n, (observations, infos), (observation, info))
                over[i] = True
            else:
                assert infos["_final_obs"][i]
                assert infos["_final_info"][i]
                final = infos["final_obs"], infos["final_info"]
                assert_same(i, n, final, (observation, info))
                assert_same(i, n, (observations, infos), env.reset())
    batch.close()
    return ends


@pytest.mark.parametrize("mode", [NEXT, SAME])
@pytest.mark.parametrize("threads", [1, 2])
def test_each_row_is_a_single_env(mode, threads):
    ends = compare(mode, threads, n=6, steps=150, config=SHORT, randomise=True, **QUICK)
    assert ends >= 20


def test_each_row_is_a_single_env_where_every_episode_has_its_own_world():
    settings = {"scene": "floor_plan", "pose_source": "modelled", "guidance": "geodesic"}
    assert compare(NEXT, 2, n=3, steps=60, config=SHORT, **settings) >= 3
