"""Laws of policies: they know a mission and readings, and only commands come out of them."""

import dataclasses

import numpy as np
import pytest

from agents.control import FOLLOWERS
from agents.learning.weights import shipped
from agents.policies import POLICIES, GymPolicy, make_policy
from planners import PLANNERS
from wheelchair_gym.envs import NavigationEnv
from wheelchair_gym.types import Command, Mission, Reading, Truth

STEPS = 15
# A policy that needs a window's keys, and families that stand here by their members.
SCRIPTED = sorted(set(POLICIES) - {"manual", "learned", "planned", "ros", "sb3"})
PLANNED = [f"a_star+{name}" for name in sorted(FOLLOWERS)]
POLICIES = [*SCRIPTED, *sorted(shipped()), *PLANNED, "lattice+window"]
NONSENSE = Truth(np.full(3, np.nan), np.full(2, np.nan), np.nan, True, True, np.nan, np.nan)


def environment(name, scene="crowd"):
    slam, model = name == "explore", "rear" if name == "ppo_rear" else "thesis"
    source, scene = ("slam", "empty") if slam else ("modelled", scene)
    return NavigationEnv(scene, pose_source=source, shield=True, bank=0, split="test", model=model)


def plain(value):
    """A copy of a mission, a reading or a command as nested lists, to compare to the bit."""
    if dataclasses.is_dataclass(value):
        fields = (f.name for f in dataclasses.fields(value) if f.name != "ways")  # a cache
        return [plain(getattr(value, name)) for name in fields]
    if isinstance(value, tuple | list):
        return [plain(item) for item in value]
    return (value.dtype.str, value.tobytes()) if isinstance(value, np.ndarray) else value


def driven(policy, env, steps=STEPS):
    """The mission, the readings and the commands of an episode's first steps."""
    env.reset(seed=3)
    mission, readings, commands = env.mission, [], []
    policy.reset(mission)
    for _ in range(steps):
        readings.append(env.reading)
        commands.append(policy.act(readings[-1]))
        _, _, terminated, truncated, _ = env.step(commands[-1].as_action(mission.limits))
        if terminated or truncated:
            break
    return mission, readings, commands


@pytest.fixture(scope="module", params=POLICIES)
def run(request):
    """A policy's name and its drive."""
    env = environment(request.param)
    yield request.param, *driven(make_policy(request.param), env)
    env.close()


def test_every_planner_and_follower_is_covered_by_one_class():
    kinds = {type(make_policy(f"{name}+window")) for name in PLANNERS}
    assert kinds == {type(make_policy(name)) for name in PLANNED}


def test_it_is_told_a_mission_and_readings_and_gives_commands(run):
    _, mission, readings, commands = run
    assert isinstance(mission, Mission)
    assert all(isinstance(reading, Reading) for reading in readings)
    assert all(isinstance(command, Command) for command in commands)
    for command in commands:
        assert command.twist.shape == (2,)
        assert np.isfinite(command.twist).all()
        assert np.abs(command.as_action(mission.limits)).max() <= 1.0
    with pytest.raises(dataclasses.FrozenInstanceError):
        mission.goal = np.zeros(3)


def test_it_changes_neither_mission_nor_reading(run):
    name, mission, readings, _ = run
    policy, before = make_policy(name), plain(mission)
    policy.reset(mission)
    assert plain(mission) == before
    for reading in readings:
        seen = plain(reading)
        policy.act(reading)
        assert plain(reading) == seen
        assert plain(mission) == before


def test_two_policies_that_share_a_mission_give_the_same_run_at_each_reset(run):
    """The commands of the first run were kept until its end: a policy must not change them."""
    name, mission, readings, commands = run
    both = make_policy(name), make_policy(name)
    for _ in range(2):
        for policy in both:
            policy.reset(mission)
        pairs = [[plain(policy.act(reading)) for policy in both] for reading in readings]
        assert [one for one, _ in pairs] == [other for _, other in pairs] == plain(commands)


@pytest.mark.parametrize("name", POLICIES)
def test_commands_do_not_depend_on_truth_and_info(name, monkeypatch):
    """The adapter drives it alike in a Gymnasium loop."""
    env = environment(name)
    honest = driven(make_policy(name), env)[2]
    observation, info = env.reset(seed=3)
    driver = GymPolicy(make_policy(name), env)
    monkeypatch.setattr(type(env.chair), "truth", NONSENSE)
    driver.reset()
    told = []
    for _ in honest:
        info.clear()
        for value in observation.values():
            value[:] = np.nan
        action = driver.act(observation)
        told.append(driver.command)
        assert env.shown.status == driver.command.shown.status
        observation, _, _, _, info = env.step(action)
    assert plain(told) == plain(honest)
    env.close()


def test_what_a_policy_shows_ends_with_its_episode():
    env = environment("lattice+window")
    env.reset(seed=3)
    driver = GymPolicy(make_policy("lattice+window"), env)
    driver.reset()
    driver.act({})
    assert env.shown is driver.command.shown
    assert len(env.shown.path) > 1
    env.reset(seed=4)
    assert env.shown.path is None
    assert not env.shown.status
