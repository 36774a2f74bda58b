"""The recipes of 'How to add to it': each adds its thing to a copy by the listed edits alone."""

import re
import shutil
import subprocess
import sys

import pytest
import yaml

from tests.conftest import ROOT

PAGE = (ROOT / "docs" / "concepts" / "architecture.md").read_text()
RECIPES = yaml.safe_load((ROOT / "tests" / "recipes.yaml").read_text())
CHECK = """
import numpy as np
from agents.people import make_assistant
from agents.policies import make_policy
from wheelchair_gym.envs import NavigationEnv
from wheelchair_gym.types import Stick

standing = {"task": {"reward": {"standing": -1.0}}}
env = NavigationEnv(scene="bollards", config=standing, render_mode="rgb_array")
env.reset(seed=0)
for step in range(1, 11):
    observation, reward, *_, info = env.step(np.array([0.0, 0.5 * (step > 1)]))
    terms = info["reward_terms"]
    assert abs(sum(terms.values()) - reward) < 1e-12
    assert terms["standing"] == -0.1 * (env.reading.twist[0] == 0.0)
    assert observation in env.observation_space
    assert abs(observation["clock"][0] - 0.1 * step) < 1e-6
    assert info["charge"] > 0.0 and info["gave_up"] is False
    assert 0.0 < abs(env.reading.gyro - info["twist"][1]) < 0.0346
assert env.chair.truth.actor_poses.tolist() == [[0.5, 0.5, 0.0]]
assert env.render().shape[2] == 3
policy = make_policy("straight+standing")
policy.reset(env.mission)
assert not policy.act(env.reading).twist.any()
assert NavigationEnv(scene="empty", driver="calm").reset(seed=0)[0]["stick"].shape == (11,)
assistant = make_assistant("halving")
assistant.reset(env.mission)
assert 0.0 < assistant.assist(Stick(1.0, 0.0, False), env.reading, None)[0] < 0.8
print("all there")
"""


@pytest.mark.parametrize("what", RECIPES)
def test_the_page_names_every_file_that_a_recipe_edits(what):
    """Of a file in a folder that the row names, its own name is free. Each edit has its place."""
    (row,) = re.findall(rf"^\| {re.escape(what)} \|.*$", PAGE, re.M)
    for path in RECIPES[what]:
        folder, name = path.rsplit("/", 1)
        assert f"{name}`" in row or f"`{folder}/`" in row, path
        text = (ROOT / path).read_text() if (ROOT / path).exists() else ""
        for edit in RECIPES[what][path]:
            assert edit.get("before", edit.get("replace", "")) in text, edit


@pytest.mark.long
def test_the_recipes_add_what_they_say(tmp_path):
    for package in ("wheelchair_gym", "planners", "agents", "configs"):
        shutil.copytree(
            ROOT / package, tmp_path / package, ignore=shutil.ignore_patterns("*.nb?", "*.pyc")
        )
    for edits in RECIPES.values():
        for path, insertions in edits.items():
            file = tmp_path / path
            text = file.read_text() if file.exists() else ""
            for edit in insertions:
                old = edit.get("before", edit.get("replace", ""))
                assert old in text, (path, edit)
                new = edit["add"] + old if "add" in edit else edit.get("by") or edit["write"]
                text = text.replace(old, new, 1) if old else new
            file.write_text(text)
    ran = subprocess.run(
        [sys.executable, "-c", CHECK], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert ran.stdout.endswith("all there\n"), ran.stderr[-2000:]
