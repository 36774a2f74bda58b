"""The technician's tools from the command line, over devices in real time."""

from __future__ import annotations

import json

import pytest

from agents.cli import main
from agents.commands import hardware
from tests.conftest import ROOT
from tests.hardware.realtime import serving

pytest.importorskip("serial", reason="pip install 'wheelchair_gym[hardware]'")

CONFIG = str(ROOT / "configs" / "hardware.json")


@pytest.fixture
def served(tmp_path):
    with serving(tmp_path) as twin:
        yield twin


def test_tools_work_over_devices(served, tmp_path, capsys):
    """What they find is tested in simulated time: a busy machine is late here."""
    file = tmp_path / "check.json"
    assert main(["hardware", "setup", "--config", str(served.config)]) == 0
    assert capsys.readouterr().out.count("saved") == 2
    words = ["hardware", "check", "--config", str(served.config), "--no-person"]
    assert main([*words, "--json", str(file)]) in (0, 1)
    said = capsys.readouterr().out
    findings = json.loads(file.read_text())["findings"]
    assert len(said.splitlines()) >= len(findings) > 15
    lines = [one for one in findings if one["what"] in ("line", "firmware", "parameters", "fan")]
    assert all(one["good"] for one in lines)
    assert main(["hardware", "monitor", "--config", str(served.config), "--seconds", "2"]) == 0
    assert "battery" in capsys.readouterr().out


def test_a_person_says_where_it_stands(monkeypatch, capsys):
    monkeypatch.setattr("sys.stdin", iter(["what?\n", "\n", "0.03,-0.12\n"]))
    assert hardware._measured("done").tolist() == [0.03, -0.12]
    assert "expected two numbers" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "why"),
    [
        (["check", "--config", "nothing.json"], "nothing.json"),
        (["tune", "--config", CONFIG, "--set", "kq=1"], "expected one of kp"),
        (["tune", "--config", CONFIG, "--set", "kp"], "expected KEY=VALUE"),
        (["tune", "--config", CONFIG, "--set", "kp=-1"], "kp"),
        (["setup", "--config", CONFIG], "drive"),
    ],
)
def test_wrong_words_are_one_line(monkeypatch, capsys, words, why):
    monkeypatch.setattr("wheelchair_gym.hardware.setting_up.PATIENCE", 0.05)
    assert main(["hardware", *words]) == 2
    said = capsys.readouterr().err.strip().splitlines()
    assert len(said) == 1
    assert why in said[0]
