"""Laws of the way to stable-baselines3, and of level replay, by the equations of its paper."""

from collections import Counter

import cv2
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

from agents.learning.folder import add_ended_episodes
from agents.learning.level_replay import LevelReplay, LevelScores
from agents.learning.sb3 import DrawCurve, SB3VecEnv
from wheelchair_gym.base.settings import InputError
from wheelchair_gym.envs import NavigationEnv, NavigationVectorEnv

SETTINGS = {
    "scene": "clutter",
    "beams": 16,
    "bank": 4,
    "config": {"task": {"time_base": 2.0, "time_factor": 0.0}},
}


def chairs(n, **settings):
    mode = AutoresetMode.SAME_STEP
    return SB3VecEnv(NavigationVectorEnv(n, autoreset_mode=mode, **(settings or SETTINGS)))


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
    many = chairs(1, scene="empty", beams=8, max_episode_steps=steps)
    many.seed(5)
    many.reset()
    sums = Counter()
    for _ in range(steps):
        _, _, dones, infos = many.step(np.array([[1.0, 0.0]]))
        add_ended_episodes(sums, infos, dones)
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
    with pytest.raises(ValueError, match="autoreset_mode is NextStep; expected a vector"):
        SB3VecEnv(NavigationVectorEnv(2, **SETTINGS))


def test_a_curve_is_drawn_while_it_trains(tmp_path):
    curve = DrawCurve(tmp_path / "a" / "curve.png", window=5)
    curve.locals, curve.num_timesteps = {"dones": np.array([True, False]), "infos": [{}, {}]}, 0
    for frames, success in ((2, True), (4, False), (6, True)):
        curve.locals["infos"][0]["is_success"], curve.num_timesteps = success, frames
        assert curve._on_step()
    assert curve.points == [(2, 1.0), (4, 0.5), (6, pytest.approx(2 / 3))]
    assert cv2.imread(str(tmp_path / "a" / "curve.png")) is not None


@pytest.mark.parametrize("guidance", ["geodesic", "poses"])
def test_scaled_observations_are_of_order_1_and_the_same_everywhere(guidance):
    """Each number is that of an unscaled one times a factor; a row is as a single environment."""
    task = {"side_clearance": True, "heading": True, "trail": [1.0]}
    told = {"scene": "clutter", "beams": 16, "guidance": guidance, "config": {"task": task}}
    plain, scaled = NavigationEnv(**told), NavigationEnv(**told, scaled=True)
    rows = NavigationVectorEnv(2, **told, scaled=True)
    (raw, _), (seen, _), (begun, _) = (env.reset(seed=3) for env in (plain, scaled, rows))
    for _ in range(20):
        by = {"laser": 0.2, "ultrasonic": 0.2, "goal": [0.2, 1.0, 1.0, 1.0, 1.0], "twist": 1.0}
        for key, factor in by.items():
            assert seen[key] == pytest.approx(raw[key] * np.float32(factor), rel=1e-6)
        assert scaled.observation_space.contains(seen)
        for key, value in seen.items():
            assert np.abs(value).max() < 5.0
            assert np.array_equal(begun[key][0], value)
        action = np.array([0.5, 0.2], np.float32)
        raw, seen = plain.step(action)[0], scaled.step(action)[0]
        begun = rows.step(np.stack([action, action]))[0]


def test_levels_are_drawn_by_rank_and_by_age():
    replay = LevelReplay(beta=0.5, rho=0.25)
    levels = LevelScores(4, replay)
    assert np.allclose(levels.weights(), 0.25)  # all are unseen
    levels.update(np.array([0, 1, 1]), np.array([3.0, 1.0, 0.0]))
    assert levels.scores.tolist() == [3.0, 0.5, np.inf, np.inf]
    levels.update(np.array([2, 3]), np.array([9.0, 1.0]))
    by_rank = np.array([1 / 4, 1 / 16, 1.0, 1 / 9])  # of ranks 2, 4, 1, 3
    expected = 0.75 * by_rank / by_rank.sum() + 0.25 * np.array([0.5, 0.5, 0.0, 0.0])
    assert np.allclose(levels.weights(), expected)
    levels.replace(np.array([1]))
    assert levels.weights()[1] > levels.weights()[3]


def test_scores_of_worlds_that_no_bank_holds_are_refused():
    levels = LevelScores(3)
    with pytest.raises(InputError, match="expected 0 to 2"):
        levels.update(np.array([-1, 1]), np.ones(2))  # -1: a world of no bank
    with pytest.raises(InputError, match="expected 0 to 2"):
        levels.replace(np.array([-1]))
    with pytest.raises(InputError, match="expected no NaN"):
        levels.update(np.array([0, 1]), np.array([1.0, np.nan]))
    assert np.allclose(levels.weights(), 1 / 3)  # nothing has changed
