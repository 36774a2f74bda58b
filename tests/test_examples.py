"""Every example runs as its docstring says."""

import runpy
import sys

import pytest

from tests.conftest import ROOT

# The arguments of each example, and what it then prints.
EXAMPLES = {
    "assisted": ([], "assisted:HalfTurns"),
    "level_replay": (["--steps", "60", "--chairs", "8", "--worlds", "8"], "hard levels:"),
    "onnx_on_the_chair": (["--out", "{folder}"], "onnx         seed 0: success"),
    "own_robot": (["--steps", "32", "--episodes", "1"], "arrives in 100%"),
    "own_scene": ([], "arrived: True"),
    "outline_plan": ([], "without whales"),
    "participants": (["--out", "{folder}", "--people", "2"], "shared - no help"),
    "people": (["--seconds", "5"], "has a trolley"),
    "pixel_observations": (["--steps", "32", "--episodes", "1"], "(3, 84, 84)"),
    "ppo_in_one_file": (["2"], "update 1: reward a step"),
    "ros_pure_pursuit": ([], ""),  # which tests/hardware/test_robot.py runs with a robot
    "tracks": ([], "person "),
    "train_sb3": (["--frames", "1024", "--episodes", "1", "--out", "{folder}"], "of 1 arrived"),
}
LONGEST = 60  # lines


def test_every_example_is_run_and_short():
    found = {path.stem: path.read_text() for path in (ROOT / "examples").glob("*.py")}
    assert set(found) == set(EXAMPLES)
    assert max(text.count("\n") for text in found.values()) <= LONGEST


@pytest.mark.parametrize("name", [name for name, (_, said) in EXAMPLES.items() if said])
def test_an_example_runs(name, monkeypatch, capsys, tmp_path):
    arguments, said = EXAMPLES[name]
    path = ROOT / "examples" / f"{name}.py"
    monkeypatch.syspath_prepend(path.parent)
    monkeypatch.setattr(sys, "argv", [str(path), *(a.format(folder=tmp_path) for a in arguments)])
    runpy.run_path(str(path), run_name="__main__")
    assert said in capsys.readouterr().out
