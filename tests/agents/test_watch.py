"""A watched run is the same run: a comparison's episodes, a survey, a replay."""

import pytest
from mcap.reader import make_reader

from agents.cli import main
from tests.conftest import output_of, refusal
from tests.perception.test_log import line, written
from wheelchair_gym.recording.replay import read_recording

SHORT = [
    "--scenes", "empty", "--policies", "straight", "--suite", "demo", "--no-video", "--quiet",
    "--jobs", "1",
]  # fmt: skip


def counts(file):
    with file.open("rb") as stream:
        summary = make_reader(stream, validate_crcs=True).get_summary()
    topics = {c.id: c.topic for c in summary.channels.values()}
    return {topics[k]: n for k, n in summary.statistics.channel_message_counts.items()}


@pytest.mark.parametrize(("form", "ending"), [("foxglove", ".mcap"), ("ros2", "")])
def test_a_comparison_records_every_episode_once(form, ending, tmp_path, capsys):
    out, folder = tmp_path / "out", tmp_path / "runs"
    arguments = ["compare", *SHORT, "--episodes", "2", "--out", str(out)]
    assert main(arguments) == 0  # stored already, but not recorded
    arguments += ["--record", str(folder), "--format", form]
    assert main(arguments) == 0
    files = sorted(folder.iterdir())
    assert [file.name for file in files] == [f"straight-empty-{k}{ending}" for k in range(2)]
    before = [file.stat().st_mtime_ns for file in files]
    assert main(arguments) == 0
    assert sorted(folder.iterdir()) == files
    assert [file.stat().st_mtime_ns for file in files] == before
    for file in files:
        assert "the same rewards" in output_of(["replay", file], capsys)


def test_viewers_look_on_at_one_episode(tmp_path, capsys):
    arguments = ["compare", *SHORT, "--out", str(tmp_path), "--live", "0"]
    said = refusal([*arguments, "--episodes", "2"], capsys)
    assert "--live shows a single episode; there are 2" in said
    assert main([*arguments, "--episodes", "1"]) == 0
    assert "ws://127.0.0.1:" in capsys.readouterr().err


def test_a_survey_is_recorded_with_its_growing_map(tmp_path, capsys):
    lines, file = [line(k) for k in range(60)], tmp_path / "map.mcap"
    log = written(tmp_path, lines)
    drive = ["map", "--log", str(log), "--particles", "2", "--quiet", "--record", str(file)]
    assert main([*drive, "--out", str(tmp_path / "map")]) == 0
    told = counts(file)
    assert told["/scan"] == told["/tf"] == told["/particles"] == told["/odometry"] == len(lines)
    assert 2 <= told["/map"] == told["/trail"] < len(lines)
    assert main([*drive, "--odometry-only"]) == 2


def test_a_replay_is_watched_like_a_drive(tmp_path, capsys):
    """A replay records the same content again, and its recording can be replayed."""
    first, again = tmp_path / "a.mcap", tmp_path / "b.mcap"
    drive = ["simulate", "--scene", "empty", "--policy", "straight", "--pose", "mcl"]
    assert main([*drive, "--record", str(first)]) == 0
    assert main(["replay", str(first), "--record", str(again), "--images", "1"]) == 0
    assert main(["replay", str(again)]) == 0
    assert capsys.readouterr().out.count("the same rewards") == 2
    told, retold = counts(first), counts(again)
    assert retold.pop("/image") >= 3
    assert told == retold
    moments = [
        [m for chapter in read_recording(file) for m in chapter.states] for file in (first, again)
    ]
    for one, other in zip(*moments, strict=True):
        assert (one.belief.particles == other.belief.particles).all()
        assert (one.belief.odometry == other.belief.odometry).all()
