"""Two drives side by side are those that `compare` and the recordings know."""

from __future__ import annotations

import pytest

from agents.evaluation.compare import Suite, compare
from tests.agents.studio.served import START, messages, send, serving

STATE = 11  # numbers of a state


@pytest.fixture(scope="module")
def served(tmp_path_factory):
    """A studio beside a run of `compare`."""
    with serving(tmp_path_factory.mktemp("compare")) as one:
        small = Suite("small", ("straight", "a_star+window"), ("clutter",), 1, video=False)
        one.results = compare(small, one.studio.runs / "small", progress=False)
        yield one


def tracks(socket, count=2):
    """The next tracks, by side."""
    found = [messages(socket, "track") for _ in range(count)]
    return {track["side"]: track for track in found}


def test_a_run_is_driven_again_as_it_was(served):
    with served.socket("compare") as socket:
        assert messages(socket, "sources")["runs"] == ["small"]
        send(socket, "choose", run="small")
        run = messages(socket, "run")
        assert run["policies"] == ["straight", "a_star+window"]
        assert run["episodes"] == [["clutter", 0]]
        send(socket, "run", run="small", scene="clutter", seed=0, left="straight",
             right="a_star+window")  # fmt: skip
        found = tracks(socket)
    for side, policy in (("left", "straight"), ("right", "a_star+window")):
        (record,) = (one for one in served.results["records"] if one["policy"] == policy)
        figures = found[side]["figures"]
        assert figures["outcome"] == record["outcome"]
        assert figures["time"] == pytest.approx(record["time"], abs=1e-3)
        assert figures["clearance_min"] == pytest.approx(record["clearance_min"], abs=1e-4)
        assert {len(state) for state in found[side]["states"]} == {STATE}
        contacts = [event for event in found[side]["events"] if event[1] == "contact"]
        assert bool(contacts) == (record["outcome"] == "collision")


def test_a_persons_drive_with_and_without_help(served):
    with served.socket("compare") as socket:
        send(socket, "pair", place="scene:doorway", seed=1, driver="novice", left="direct",
             right="slide")  # fmt: skip
        found = tracks(socket)
    left, right = found["left"], found["right"]
    assert left["states"][0] == right["states"][0]  # one episode
    assert not any(kind in ("help", "shield") for _, kind, _ in left["events"])
    assert any(kind == "help" for _, kind, _ in right["events"])
    assert left["world"]["walls"] == right["world"]["walls"]


def test_a_recording_is_shown_as_it_was_driven(served):
    with served.socket() as socket:
        send(socket, "start", **START | {"assist": "slide"})
        messages(socket, "world")
        for _ in range(12):
            send(socket, "stick", forward=0.7, left=0.3, by="touch")
            messages(socket, "picture")
        send(socket, "stop")
        ended = messages(socket, "ended")
    with served.socket("compare") as socket:
        names = messages(socket, "sources")["recordings"]
        (name,) = (name for name in names if name.endswith(ended["file"]))
        send(socket, "open", side="right", name=name, episode=0)
        track = tracks(socket, 1)["right"]
        assert track["figures"]["outcome"] == "stopped"
        for key in ("time", "length", "clearance_min", "energy"):
            assert track["figures"][key] == pytest.approx(ended[key], abs=1e-4)
        send(socket, "open", side="left", name=name, episode=7)
        assert "episode 7" in messages(socket, "error")["text"]


@pytest.mark.parametrize(
    "name", ["../x.mcap", "/etc/passwd", "", "small/results.json", "link.mcap"]
)
def test_only_listed_files_are_opened(served, name):
    (served.studio.runs / "x.mcap").write_bytes(b"no recording")
    link = served.studio.runs / "link.mcap"
    if not link.is_symlink():
        link.symlink_to(served.studio.runs / "x.mcap")
    with served.socket("compare") as socket:
        listed = messages(socket, "sources")
        assert "x.mcap" in listed["recordings"]
        assert "link.mcap" not in listed["recordings"]
        send(socket, "open", side="left", name=name, episode=0)
        assert "open.name" in messages(socket, "error")["text"]
        send(socket, "choose", run=name)
        assert "expected one of the list" in messages(socket, "error")["text"]
        send(socket, "open", side="left", name="x.mcap", episode=0)
        assert "x.mcap" in messages(socket, "error")["text"]


def test_unknown_names_are_refused_with_one_sentence(served):
    with served.socket("compare") as socket:
        asked = {"place": "scene:empty", "seed": 0, "driver": "nobody", "left": "straight",
                 "right": "os:system"}  # fmt: skip
        for change in ({}, {"driver": "os:system"}, {"driver": "novice"}, {"place": "x"}):
            send(socket, "pair", **{**asked, **change})
            assert "expected" in messages(socket, "error")["text"]
        (served.studio.runs / "small" / "results.json").write_text("[]")
        send(socket, "choose", run="small")
        assert "results of `wheelchair compare`" in messages(socket, "error")["text"]
