"""Every example runs as its docstring says."""

from __future__ import annotations

import runpy
import sys

import pytest

from tests.conftest import ROOT

EXAMPLES = {"pixel_observations": ["--steps", "32", "--episodes", "1"]}


def test_every_example_is_run():
    assert {path.stem for path in (ROOT / "examples").glob("*.py")} == set(EXAMPLES)


@pytest.mark.parametrize("name", EXAMPLES)
def test_an_example_runs(name, monkeypatch, capsys):
    path = str(ROOT / "examples" / f"{name}.py")
    monkeypatch.setattr(sys, "argv", [path, *EXAMPLES[name]])
    runpy.run_path(path, run_name="__main__")
    said = capsys.readouterr().out
    assert "(3, 84, 84)" in said
    assert "reward" in said
