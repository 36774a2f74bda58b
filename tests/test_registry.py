"""Other people's code: named by module:Class or by an entry point, and refused in one line."""

import importlib.metadata
import json
import math
import sys

import numpy as np
import pytest

from agents.control import FOLLOWERS, make_follower
from agents.evaluation.evaluate import drive_episode, episode_key, evaluate
from agents.evaluation.runs import run_key, source_digest
from agents.policies import make_policy
from planners import make_planner
from wheelchair_gym.base.registry import Registry, imported, places_in
from wheelchair_gym.base.settings import InputError
from wheelchair_gym.envs import NavigationEnv, NavigationVectorEnv
from wheelchair_gym.scenes import make_scene
from wheelchair_gym.task.rewards import make_reward

SOURCE = """
import numpy as np
from planners import Plan, Status
from wheelchair_gym.scenes.arena import EmptyRoom
from wheelchair_gym.types import Command

class Policy:
    def __init__(self, speed=0.3):
        self.speed = speed
    def reset(self, mission):
        self.steps = 0
    def act(self, reading):
        self.steps += 1
        return Command(np.array([self.speed, 0.0]))

class Planner:
    def plan(self, problem, rng, deadline=None):
        return Plan(Status.SOLVED, np.array([problem.start[:2], problem.goal[:2]]))

class Follower:
    def twist(self, now):
        return np.array([0.2, 0.0])

class Scene:
    def sample(self, rng, footprint=None):
        return EmptyRoom().sample(rng)

def reward(terms, sensed, action):
    return terms.progress - 0.1 * action[0] - 0.01 * sensed.clearance

def not_a_number(terms, sensed, action):
    return "much"

def python_only(terms, sensed, action):
    import os
    return float(len(os.sep))

class Bare(Policy):
    def act(self, reading):
        return np.zeros(2)

class List(Planner):
    def plan(self, problem, rng, deadline=None):
        return [problem.start, problem.goal]

class Lost(Policy):
    def act(self, reading):
        if reading.stamp > 0.15:
            raise KeyError("goal")
        return Policy.act(self, reading)

class Never(Policy):
    def reset(self, mission):
        raise KeyError("map")
"""


@pytest.fixture
def theirs(tmp_path, monkeypatch):
    """The name of somebody's module in the working folder."""
    name = f"theirs_{tmp_path.name.replace('-', '_')}"
    (tmp_path / f"{name}.py").write_text(SOURCE)
    (tmp_path / "broken.py").write_text("def f(:\n")
    monkeypatch.chdir(tmp_path)
    before = list(sys.path)
    yield name
    sys.path[:] = before
    imported.cache_clear()
    source_digest.cache_clear()
    for module in (name, "broken"):
        sys.modules.pop(module, None)


def test_every_kind_is_made_by_its_place(theirs):
    policy = make_policy({"name": f"{theirs}:Policy", "speed": 0.1})
    assert policy.speed == 0.1
    assert make_policy(f"{theirs}:Policy") is not make_policy(f"{theirs}:Policy")
    assert hasattr(make_planner(f"{theirs}:Planner"), "plan")
    assert hasattr(make_follower({"name": f"{theirs}:Follower"}).make(), "twist")
    assert make_scene(f"{theirs}:Scene").sample(np.random.default_rng(0)).walls.shape[1] == 4
    assert make_reward(f"{theirs}:reward") is not None
    driver = make_policy(f"{theirs}:Planner+{theirs}:Follower")
    assert driver.config.planner["name"] == f"{theirs}:Planner"


@pytest.mark.parametrize(
    ("spec", "words"),
    [
        ("{0}:Polcy", "did you mean Policy"),
        ("nowhere_at_all:Policy", "cannot be imported"),
        ("broken:f", "SyntaxError"),
        ({"name": "{0}:Policy", "sped": 1}, "'sped'; did you mean speed"),
        ("{0}:Policy+window", "has no method plan"),
        ("a_star+{0}:Policy", "no method make or twist"),
        (
            {"name": "a_star+window", "planner": {"name": "lattice"}},
            r"a_star\+window\.planner\.name is 'lattice'; expected 'a_star', or none",
        ),
        ({"name": "a_star+window", "follower": {"name": "dwa"}}, r"follower\.name is 'dwa'"),
        ({"name": "ppo_goal", "weights": "ppo_rear"}, "weights is 'ppo_rear'; expected 'ppo_goal'"),
        ({"name": "a.zip", "file": "b.zip"}, r"file is 'b\.zip'; expected 'a\.zip'"),
    ],
)
def test_what_cannot_be_made_is_refused_in_one_line(theirs, spec, words):
    spec = json.loads(json.dumps(spec).replace("{0}", theirs))
    with pytest.raises(InputError, match=words):
        make_policy(spec)


def test_workers_drive_other_peoples_policies_and_their_code_is_part_of_the_key(theirs, tmp_path):
    def drive():
        return evaluate(
            [f"{theirs}:Policy", f"{theirs}:Planner+window"], [f"{theirs}:Scene"], [0],
            folder=tmp_path / "runs", jobs=2, progress=False,
        )  # fmt: skip

    outcomes = [record["outcome"] for record in drive()]
    assert len(outcomes) == 2
    assert outcomes[1] == "success"
    key = episode_key(f"{theirs}:Policy", "empty", 0, {})
    (tmp_path / f"{theirs}.py").write_text(SOURCE + "\n# another version\n")
    source_digest.cache_clear()
    assert episode_key(f"{theirs}:Policy", "empty", 0, {}) != key


def test_what_is_no_command_or_plan_is_said(theirs):
    env = NavigationEnv("empty")
    for policy, words in ((f"{theirs}:Bare", "a Command"), (f"{theirs}:List+window", "a Plan")):
        with pytest.raises(InputError, match=f"expected {words}"):
            drive_episode(env, make_policy(policy), 0)


def test_an_error_in_a_policy_ends_with_the_policy_and_the_step(theirs):
    for policy, note in (
        ("Lost", "policy Lost: its act failed in step 2, 0.2 s after the start"),
        ("Never", "policy Never: its reset failed"),
    ):
        env = NavigationEnv("empty")
        with pytest.raises(KeyError) as raised:
            drive_episode(env, make_policy(f"{theirs}:{policy}"), 0)
        assert raised.value.__notes__ == [note]


def test_a_label_of_settings_in_a_file_is_no_place():
    for label in ("planners.json:fast", "nowhere.json:fast", "no_such_module_at_all:Class"):
        assert run_key("planner", label) == run_key("planner", label)


def test_an_entry_point_is_a_name(theirs, monkeypatch):
    point = importlib.metadata.EntryPoint("steady", f"{theirs}:Follower", FOLLOWERS.group)

    def points(group):
        return [point] if group == FOLLOWERS.group else []

    monkeypatch.setattr("wheelchair_gym.base.registry.entry_points", points)
    added = Registry("follower", {"a": "math:sin"}, FOLLOWERS.group, ("make", "twist"))
    assert list(added) == ["steady", "a"]
    assert hasattr(added.make("steady").make(), "twist")
    assert places_in({"follower": "steady"}) == {f"{theirs}:Follower"}


def test_a_reward_is_the_same_in_every_row(theirs):
    settings = {"scene": "clutter", "reward": f"{theirs}:reward", "beams": 16}
    single = NavigationEnv(**settings)
    for mode in ("NextStep", "SameStep"):
        many = NavigationVectorEnv(2, autoreset_mode=mode, **settings)
        single.reset(seed=1)
        many.reset(seed=0)
        rng = np.random.default_rng(0)
        over = False
        while not over:
            actions = rng.uniform(-1, 1, (2, 2)).astype(np.float32)
            _, reward, terminated, truncated, _ = single.step(actions[1])
            assert many.step(actions)[1][1] == reward
            over = terminated or truncated
        if mode == "NextStep":
            assert many.step(actions)[1][1] == 0.0  # it begins the next episode


def test_a_reward_that_is_none_is_refused(theirs):
    for name, words in (("not_a_number", "finite number"), ("absent", "has no absent")):
        with pytest.raises(InputError, match=words):
            NavigationEnv(reward=f"{theirs}:{name}")
    assert math.isfinite(NavigationEnv(reward=f"{theirs}:python_only").reset(seed=0)[1]["time"])
    with pytest.raises(InputError, match="numba cannot compile"):
        NavigationVectorEnv(2, reward=f"{theirs}:python_only")
