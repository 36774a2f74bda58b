"""Every example runs as its docstring says."""

from __future__ import annotations

import runpy
import sys

import pytest

from tests.conftest import ROOT

EXAMPLES = {
    "own_robot": ["--steps", "32", "--episodes", "1"],
    "pixel_observations": ["--steps", "32", "--episodes", "1"],
}
# What an example prints, among other things.
PRINTED = {
    "own_robot": ("laser: (82,)", "ultrasonic: (4,)", "arrives in 100%", "trained"),
    "pixel_observations": ("(3, 84, 84)", "reward"),
}


def test_every_example_is_run():
    assert {path.stem for path in (ROOT / "examples").glob("*.py")} == set(EXAMPLES)


@pytest.mark.parametrize("name", EXAMPLES)
def test_an_example_runs(name, monkeypatch, capsys):
    path = str(ROOT / "examples" / f"{name}.py")
    monkeypatch.setattr(sys, "argv", [path, *EXAMPLES[name]])
    runpy.run_path(path, run_name="__main__")
    said = capsys.readouterr().out
    for text in PRINTED[name]:
        assert text in said
