"""Recorded drives of a person: judged again, and driven again with another assistant."""

from __future__ import annotations

import json

import pytest

from agents.cli import main
from agents.people.recorded_stick import open_loop
from tests.conftest import refusal
from wheelchair_gym.recording.replay import read_recording
from wheelchair_gym.types import Stick

DRIVE = ["simulate", "--scene", "clutter", "--seed", "4", "--driver", "weak_left"]


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    file = tmp_path_factory.mktemp("drives") / "drive.mcap"
    assert main([*DRIVE, "--assist", "vfh", "--record", str(file)]) == 0
    return file


@pytest.fixture(scope="module")
def episode(recorded):
    (episode,) = read_recording(recorded)
    return episode


def test_stick_interface_and_assistant_are_in_the_recording(episode):
    assert episode.has_person
    assert episode.labels == {"assistant": "vfh", "interface": "stick"}
    assert episode.seed == 4
    assert episode.settings.driver["hand"]["leftward"] == 0.4
    sticks = [state.reading.stick for state in episode.states]
    assert sticks[0] == Stick(0.0, 0.0, False)
    assert max(stick.forward for stick in sticks) > 0.3


def test_the_same_assistant_answers_the_same_to_the_bit(recorded, episode, capsys):
    figures = open_loop(episode, "vfh")
    assert figures["same_answers"]
    assert (figures["difference_share"], figures["difference_size"]) == (0.0, 0.0)
    assert figures["recorded"] == figures["other"]
    assert main(["replay", str(recorded), "--assist", "vfh"]) == 0
    said = capsys.readouterr().out
    assert "the same rewards" in said
    assert "the same, to the bit" in said


def test_another_assistant_answers_beside_the_recorded_one(episode, recorded, tmp_path):
    file = tmp_path / "replay.json"
    assert main(["replay", str(recorded), "--assist", "slide", "--json", str(file)]) == 0
    (record,) = json.loads(file.read_text())
    assert record["same"]
    assert not record["same_answers"]
    assert 0.0 < record["difference_share"] < 1.0
    start, end = record["longest"]
    assert 0.0 <= start < end <= episode.states[-1].reading.stamp + 1e-9
    # The bare stick changes nothing; it differs from the recording as much as that did from it.
    bare = open_loop(episode, "direct")
    assert bare["other"]["intervention_share"] == 0.0 < bare["difference_share"]
    assert bare["difference_share"] == bare["recorded"]["intervention_share"]


def test_what_is_missing_is_said_in_a_line(tmp_path, capsys):
    file = tmp_path / "drive.mcap"
    words = ["simulate", "--scene", "empty", "--policy", "straight", "--record", str(file)]
    assert main(words) == 0
    capsys.readouterr()
    assert "a person drives" in refusal(["replay", file, "--assist", "vfh"], capsys)
