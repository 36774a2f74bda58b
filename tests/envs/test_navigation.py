"""Laws of the environments: Gymnasium's and SB3's contracts, repeatability, settings, ends."""

import hashlib
import subprocess
import sys
import warnings

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from stable_baselines3.common.env_checker import check_env as sb3_check_env

import wheelchair_gym
from tests.conftest import ROOT, steps_of
from wheelchair_gym.envs import NavigationEnv
from wheelchair_gym.scenes.arena import make_arena

IDS = ["wheelchair_gym/Navigation-v1", "wheelchair_gym/GuidedNavigation-v1"]


def room(start, goal):
    """An empty square room with its map."""
    return make_arena((-4.0, -4.0, 4.0, 4.0)).episode(np.array(start), np.array(goal), "room")


CHECKED = [
    *((name, {}) for name in IDS),
    ("wheelchair_gym/AssistedNavigation-v1", {"scene": "clutter", "beams": 32}),
    (IDS[0], {"config": str(ROOT / "examples" / "own_robot.json")}),
    (IDS[0], {"config": {"scene": "clutter", "sensors": {"laser": {"beams": 0}}}}),
]


@pytest.mark.parametrize(("env_id", "settings"), CHECKED)
def test_gymnasium_and_sb3_find_nothing_to_say(env_id, settings, monkeypatch):
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")  # check_env opens a window
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        env = gym.make(env_id, **settings)
        check_env(env.unwrapped)
        sb3_check_env(gym.make(env_id, **settings))


def digest_of(env_id, seed):
    """A fingerprint of everything that a run returns."""
    env = gym.make(env_id, split="test", pose_source="modelled", randomize=True)
    assert isinstance(env.unwrapped, NavigationEnv)
    h = hashlib.sha256()

    def take(observation, info):
        for value in observation.values():
            h.update(value.tobytes())
        for key in sorted(info):
            h.update(repr(info[key]).encode())

    take(*env.reset(seed=seed))
    rng = np.random.default_rng(seed)
    for _ in range(500):
        observation, reward, terminated, truncated, info = env.step(rng.uniform(-1, 1, 2))
        h.update(repr((reward, terminated, truncated)).encode())
        take(observation, info)
        if terminated or truncated:
            take(*env.reset())
    return h.hexdigest()


def digests():
    return [digest_of(env_id, seed) for env_id in IDS for seed in range(3)]


def test_same_seed_same_run_bit_for_bit_in_a_second_process_too():
    program = "from tests.envs.test_navigation import digests; print(digests())"
    command = [sys.executable, "-c", program]
    with subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, text=True) as other:
        here, again = digests(), digests()
        there = other.communicate()[0]
    assert here == again
    assert repr(here) == there.strip()
    assert len(set(here)) == 6


def test_arriving_bumping_and_running_out_of_time_end_an_episode():
    env = gym.make(IDS[0], noise=False).unwrapped
    ends = {}
    for name, start, goal, action in (
        ("arrived", (-2.0, 0.0, 0.0), (1.0, 0.0, 0.0), (1.0, 0.0)),
        ("bumped", (-2.0, 0.0, 0.0), (-3.0, 2.0, 0.0), (1.0, 0.0)),
        ("timeout", (-2.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0)),
    ):
        env.reset(seed=0, options={"episode": room(start, goal)})
        told = list(steps_of(env, np.array(action)))
        for _, reward, _, _, info in told:
            assert reward == pytest.approx(sum(info["reward_terms"].values()))
        terminated, truncated = told[-1][2:4]
        ends[name] = (terminated, truncated, info["is_success"], info["reward_terms"][name])
        if name == "timeout":
            limit = 30 + 3 * 3.0 / 0.8
            assert len(told) * 0.1 == pytest.approx(limit, abs=0.2)
        with pytest.raises(gym.error.ResetNeeded):
            env.step(np.array(action))
    assert ends["arrived"] == (True, False, True, 1.0)
    assert ends["bumped"] == (True, False, False, -2.0)
    assert ends["timeout"] == (False, True, False, -0.5)


def test_an_estimated_pose_must_be_nearer_before_it_says_arrived():
    """With errors of the pose, 'arrived' by estimate is arrival by truth."""
    truths = []
    env = gym.make(IDS[0], pose_source="modelled").unwrapped
    episode = room((-2.0, 0.0, 0.0), (1.0, 0.0, 0.0))
    for seed in range(20):
        env.reset(seed=seed, options={"episode": episode})
        *_, (*_, info) = steps_of(env, np.array([0.6, 0.0]))
        truths.append(info["is_success"])
    assert all(truths)


@pytest.mark.filterwarnings("ignore:.*render_modes:UserWarning")
@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"chair": object()}, r"chair is object; expected a wheelchair_gym Chair"),
        ({"config": {"unshielded": 0.3}, "chair": object()}, r"unshielded is 0.3; expected 0"),
        ({"render_mode": "ascii"}, "render_mode"),
    ],
)
def test_wrong_arguments_are_refused_by_name(arguments, message):
    with pytest.raises((wheelchair_gym.InputError, gym.error.Error), match=message):
        gym.make(IDS[0], **arguments).reset(seed=0)


def test_guidance_looks_along_its_path():
    """Points ahead lie on the path, at their distances, in the chair's frame."""

    def straight(task):
        return np.array([task.start[:2], task.goal[:2]])

    env = gym.make(IDS[1], guidance=straight, noise=False).unwrapped
    episode = room((-2.0, 1.0, np.pi / 2), (2.0, 1.0, 0.0))
    observation, _ = env.reset(seed=0, options={"episode": episode})
    ahead = np.array(env.settings.task.look_ahead)
    # The goal lies to the right of a chair that looks along +y.
    points = observation["path"].reshape(-1, 2)
    assert points == pytest.approx(np.column_stack([0 * ahead, -ahead]), abs=1e-6)
    assert observation["goal"] == pytest.approx([4.0, 0.0, -1.0], abs=1e-6)


def test_progress_sums_to_the_way_that_was_covered():
    env = gym.make(IDS[0], noise=False).unwrapped
    env.reset(seed=0, options={"episode": room((-2.0, 0.0, 0.0), (2.0, 0.0, 0.0))})
    total = 0.0
    for *_, info in steps_of(env, np.array([1.0, 0.0]), 40):
        total += info["reward_terms"]["progress"]
    assert total == pytest.approx(0.125 * (info["pose"][0] + 2.0), rel=0.02)


def test_what_a_shield_withholds_is_a_term_of_the_reward():
    """Straight at a wall: it costs once the shield slows the chair, and never without one."""
    task = {"reward": {"shield_intervention": -0.5}}
    world = {"episode": room((0.0, 0.0, 0.0), (3.9, 0.0, 0.0))}
    for shield in (True, False):
        env = gym.make(IDS[0], config={"task": task}, shield=shield, pose_source="truth")
        env.reset(seed=0, options=world)
        costs, taken = [], []
        for *_, info in steps_of(env, np.array([1.0, 0.2]), 60):
            costs.append(info["reward_terms"]["shield_intervention"])
            if shield:
                less = np.subtract(info["shield"]["asked"], info["shield"]["given"])
                taken.append(-0.5 * np.hypot(less[0] / 0.8, less[1] / 1.0))
        if shield:
            assert costs == pytest.approx(taken, abs=1e-12)
            assert min(costs) < -0.1
            assert max(costs) == 0.0
        else:
            assert not any(costs)
        env.close()


def test_a_share_of_episodes_is_driven_without_the_shield():
    env = gym.make(IDS[0], scene="empty", config={"unshielded": 0.3}, shield=True)
    bare = 0
    for seed in range(200):
        env.reset(seed=seed)
        *_, info = env.step(np.array([1.0, 0.0]))
        bare += not info["shield"]["asked"].any()
    env.close()
    assert 40 <= bare <= 80


def test_a_policy_may_see_whether_it_is_shielded_and_what_was_withheld():
    config = {"unshielded": 0.3, "task": {"shield_state": True}}
    env = gym.make(IDS[0], scene="clutter", config=config, shield=True)
    task, seen = env.unwrapped.task, {True: 0.0, False: 0.0}
    for seed in range(20):
        observation, _ = env.reset(seed=seed)
        assert observation["shield"][1:].tolist() == [0.0, 0.0]
        for observation, *_, info in steps_of(env, np.array([1.0, 0.3]), 40):
            guarded, *withheld = observation["shield"]
            told = info["shield"]
            assert guarded == task.is_shielded == told["asked"].any()
            less = (told["asked"] - told["given"]) / (task.limits.forward, task.limits.turn)
            assert withheld == pytest.approx(less, abs=1e-6)
            seen[task.is_shielded] = max(seen[task.is_shielded], abs(withheld[0]))
    env.close()
    assert seen[True] > 0.5
    assert seen[False] == 0.0
