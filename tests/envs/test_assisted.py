"""Laws of environments in which a person drives: the assistant sees its stick and not its goal."""

import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

from agents.policies import GymPolicy, make_policy
from tests.conftest import at_start, long_but, steps_of
from tests.copies import differences
from tests.envs.test_vector import NEXT, SAME, compare
from tests.laws.test_addresses import Told
from wheelchair_gym.base.settings import InputError, dump, load
from wheelchair_gym.envs import EnvSettings, NavigationEnv, NavigationVectorEnv
from wheelchair_gym.people.assistance import COMPILED
from wheelchair_gym.people.drivers import DRIVERS

SMALL = {"scene": "clutter", "beams": 32, "split": "test"}
BANK = {"scene": "clutter", "beams": 32, "bank": {"size": 4, "turnover": 0.5}}
SHORT = {"task": {"time_base": 4.0, "time_factor": 0.0}}


# Drivers of each interface, with a hand that trembles, a narrowed view and changing intentions.
SOME = (
    "bci", "essential_tremor", "head_array", "hemineglect", "keyboard", "scanning", "sip_and_puff",
    "wavering",
)  # fmt: skip


@pytest.mark.parametrize("name", long_but(DRIVERS, SOME))
def test_each_row_is_a_single_env_for_every_driver(name):
    settings = {**BANK, "driver": name, "shield": True, "assistant": "shield", "randomize": True}
    assert compare(NEXT, 2, n=3, steps=50, config=SHORT, **settings) >= 3


def test_a_reset_by_mask_begins_the_person_anew():
    env = NavigationVectorEnv(2, driver="expert", autoreset_mode=AutoresetMode.DISABLED, **SMALL)
    observation, _ = env.reset(seed=1)
    for _ in range(8):
        observation, *_ = env.step(observation["stick"][:, :2])
    assert observation["stick"].any(axis=1).all()
    observation, _ = env.reset(options={"reset_mask": np.array([True, False])})
    assert not observation["stick"][0].any()
    assert observation["stick"][1].any()


def test_the_goal_and_the_way_are_not_observed():
    env = NavigationEnv(**SMALL, driver="expert")
    assert not {"goal", "path", "privileged", "privileged_path"} & set(env.observation_space.spaces)
    assert env.observation_space["stick"].shape == (11,)
    assert "goal" in NavigationEnv(**SMALL).observation_space.spaces
    assert "stick" not in NavigationEnv(**SMALL).observation_space.spaces


def test_two_goals_and_one_stick_give_one_observation(monkeypatch):
    """Nothing reveals the person's goal if the person asks for the same motion."""
    from dataclasses import replace

    env = NavigationEnv(**SMALL, driver={"name": "expert", "perception": {"reaction": 2.0}})
    env.reset(seed=3)
    episode, seen = env.episode, []
    for goal in (episode.goal, episode.start + np.array([0.0, 0.9, 0.0])):
        env.reset(seed=3, options={"episode": replace(episode, goal=goal)})
        seen.append([env.step(np.array([0.1, 0.2]))[0] for _ in range(10)])
    assert not list(differences(*seen))


def test_the_stick_is_observed_with_its_history():
    env = NavigationEnv(**SMALL, driver="expert")
    observation, _ = env.reset(seed=0)
    before = [np.zeros(2)] * 4
    for observation, *_ in steps_of(env, np.array([0.2, 0.0]), 20):
        stick = env.reading.stick
        now = np.array([stick.forward, stick.left])
        expected = np.concatenate([now, [stick.latched], *before]).astype(np.float32)
        assert np.array_equal(observation["stick"], expected)
        before = [now, *before[:3]]
    assert any(each.any() for each in before)


def test_to_do_as_the_stick_says_is_no_disagreement():
    env = NavigationEnv(**SMALL, driver="expert")
    observation, _ = env.reset(seed=0)
    for _ in range(15):
        observation, _, _, _, info = env.step(np.array(env.task.stick[:2]))
        assert info["reward_terms"]["disagreement"] == 0.0
    assert observation["stick"].any()
    stick = env.task.stick
    _, _, _, _, info = env.step(np.zeros(2))
    weights = env.settings.task.reward
    expected = weights.disagreement * np.hypot(max(0, stick.forward), stick.left) * 0.1
    assert info["reward_terms"]["disagreement"] == pytest.approx(expected)


@pytest.mark.parametrize("assistant", long_but(COMPILED, ("slide", "shared_dwa")))
def test_each_row_is_a_single_env_with_an_assistant(assistant):
    """Each row with residuals, through resets, with each way to end an episode."""
    for mode in (NEXT, SAME):
        settings = {**BANK, "driver": "novice", "shield": True, "assistant": assistant}
        assert compare(mode, 2, n=3, steps=50, config=SHORT, **settings) >= 3


@pytest.mark.parametrize("assistant", COMPILED)
def test_a_drive_is_that_of_the_policy(assistant):
    """The policy `assisted` and the setting `assistant` give the same drive, to the bit."""
    settings = {"scene": "clutter", "driver": "novice", "shield": True}
    held, other = NavigationEnv(**settings, assistant=assistant), NavigationEnv(**settings)
    policy = GymPolicy(make_policy({"name": "assisted", "assist": assistant}), other)
    seen = [env.reset(seed=7)[0] for env in (held, other)]
    policy.reset()
    for _ in range(120):
        action = policy.act(seen[1])
        ours, theirs = held.step(np.zeros(2)), other.step(action)
        assert not list(differences(ours, theirs))
        assert held.reading.action == other.reading.action
        seen[1] = theirs[0]
        if theirs[2] or theirs[3]:
            break
    other.reset(seed=0)
    other.step(np.array([5.0, -3.0]))
    assert other.reading.action == (1.0, -1.0)


def test_a_residual_is_added_to_the_assistant_and_rest_stays_rest():
    env = at_start(NavigationEnv(**SMALL, driver="expert", assistant="shield"))
    for _ in range(20):
        stick = env.task.stick
        env.step(np.array([-1.0, 0.5]))
        forward, left = env.reading.action
        if stick.forward == stick.left == 0.0:
            assert forward == left == 0.0
        elif stick.forward > 0.0:
            assert forward == pytest.approx(max(0.0, stick.forward - 0.375))
            assert left > stick.left
    assert env.task.stick.forward > 0.0


def test_a_localized_chair_has_a_person_too():
    env = at_start(NavigationEnv("floor_plan", driver="expert", pose_source="mcl"))
    for _ in range(12):
        env.step(np.array(env.task.stick[:2]))
    assert env.task.stick.forward > 0.0


def test_a_person_needs_a_simulated_chair():
    with pytest.raises(InputError, match="needs the simulated chair"):
        NavigationEnv(**SMALL, driver="expert", chair=Told(None, None))


PEOPLE = ["novice", "sip_and_puff", {"name": "expert", "hand": {"tremor": 0.2}}]


def test_each_episode_draws_one_of_several_people():
    """Rows are single environments, all people drive, and each drives as if alone."""
    ends = compare(SAME, 2, n=4, steps=90, config=SHORT, driver=PEOPLE, randomize=True, **BANK)
    assert ends >= 8
    several, drawn = NavigationEnv(**SMALL, driver=PEOPLE), set()
    for seed in range(12):
        several.reset(seed=seed)
        person = several.drivers.driver
        drawn.add(several.drivers.people.index(person))
        assert several.labels["interface"] == person.interface.kind
        if seed < 3:
            alone = at_start(NavigationEnv(**SMALL, driver=person), seed)
            for _ in range(30):
                ours, theirs = several.step(np.zeros(2)), alone.step(np.zeros(2))
                assert not list(differences(ours, theirs))
    assert drawn == {0, 1, 2}
    stored = load(EnvSettings, dump(several.settings), "env")
    assert stored == several.settings
