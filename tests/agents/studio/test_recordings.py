"""Recordings of drives: what they hold, and two of them, or two drives, side by side."""

import math

import numpy as np
import pytest

from agents.cli import main
from agents.evaluation.compare import Suite, compare
from agents.people.recorded_stick import session_of
from agents.studio.catalogue import places
from agents.studio.drive import Drive, Order
from tests.agents.studio.served import START, messages, send
from tests.conftest import json_of, long_but, output_of, refusal
from tests.hardware.conftest import build_twin
from wheelchair_gym.base.settings import InputError
from wheelchair_gym.envs import NavigationEnv
from wheelchair_gym.recording.replay import read_recording

PLACES = places()


def winding(t):
    """A deflection at a time [s]."""
    return 0.5 + 0.3 * math.sin(0.7 * t), 0.6 * math.sin(0.45 * t)


def circling(t):
    """The same, of narrow circles."""
    return 0.3 + 0.05 * math.sin(0.7 * t), 0.5 + 0.1 * math.sin(0.45 * t)


def driven(folder, seconds, change=lambda drive, k: None, by="gamepad", curve=winding, **order):
    """The file of a drive, as fast as it can be simulated."""
    order = {"assist": "slide", "hand": "none", "rate": 40, "place": "scene:clutter", **order}
    key = order.pop("place")
    drive = Drive(Order(key, PLACES[key], 3, file=folder / "drive.mcap", **order), folder)
    for k in range(round(seconds * order["rate"])):
        change(drive, k)
        t = k / order["rate"]
        drive.step(*curve(t), by)
    drive.close()
    return drive.file


def replays_the_same(file, capsys):
    said = output_of(["replay", file, "--assist", "slide"], capsys)
    assert all(part in said for part in ("the same rewards", "the same, to the bit"))


def test_an_assistant_answers_the_same(tmp_path, capsys):
    file = driven(tmp_path, 10.0)
    replays_the_same(file, capsys)
    (recorded,) = read_recording(file)
    assert recorded.labels == {"assistant": "slide", "interface": "gamepad"}
    assert recorded.changed == ()
    sticks = [state.reading.stick for state in recorded.states]
    assert sticks[0].forward == 0.0
    assert sticks[1].forward == pytest.approx(0.5 + 0.3 * math.sin(0.7 / 40))
    assert sticks[8].left == pytest.approx(0.6 * math.sin(0.45 * 0.2))


@pytest.mark.long
def test_a_hand_is_recovered_from_a_drive(tmp_path, capsys):
    file = driven(tmp_path, 45.0, curve=circling, hand="essential_tremor", place="scene:empty")
    assert session_of(read_recording(file)[0]).interface == "stick"
    found = json_of(["fit-driver", file, "--repeats", "2"], capsys)["fitted"]
    assert found["hand"]["tremor"] == pytest.approx(0.15, abs=0.02)
    assert found["hand"]["tremor_frequency"] == pytest.approx(6.0, abs=0.2)
    assert found["interface"]["dead_zone"] == pytest.approx(0.1, abs=0.002)


@pytest.mark.parametrize(
    ("order", "by", "interface"),
    [({}, "touch", "stick"), ({}, "keyboard", "switches"),
     ({"hand": "sip_and_puff"}, "keyboard", "switches"), ({"hand": "bci"}, "touch", "brain_")],
)  # fmt: skip
def test_what_a_person_holds_is_known(tmp_path, order, by, interface):
    (recorded,) = read_recording(driven(tmp_path, 2.0, by=by, sight="hemianopia", **order))
    assert session_of(recorded).interface.startswith(interface)
    assert recorded.labels["sight"] == "hemianopia"
    assert recorded.labels.get("hand", "none") == order.get("hand", "none")


def test_what_changes_in_mid_drive_is_known_and_not_fitted(tmp_path, capsys):
    def change(drive, k):
        if k == 20:
            drive.set_assistant("vfh")
        if k == 40:
            drive.set_hand("ataxia")

    file = driven(tmp_path, 2.0, change)
    (recorded,) = read_recording(file)
    assert recorded.labels == {"assistant": "slide", "interface": "gamepad"}
    assert recorded.changed == ("assistant", "hand", "interface")
    assert main(["replay", str(file)]) == 0
    capsys.readouterr()
    said = refusal(["fit-driver", file], capsys)
    assert "the hand and the interface changed in mid-drive" in said
    assert str(file) in said
    with pytest.raises(InputError, match="changed in mid-drive"):
        session_of(recorded)


class Unfit:
    def reset(self, mission):
        raise InputError("it fits no chair")

    def assist(self, stick, reading, map):
        raise AssertionError


def test_an_assistant_that_does_not_fit_leaves_the_one_of_before(tmp_path):
    def change(drive, k):
        if k == 20:
            with pytest.raises(InputError, match="fits no chair"):
                drive.set_assistant(f"{__name__}:Unfit")

    (recorded,) = read_recording(driven(tmp_path, 2.0, change))
    assert recorded.changed == ()
    assert recorded.labels["assistant"] == "slide"


def test_a_drive_that_was_never_begun_leaves_no_file(tmp_path):
    order = Order("scene:clutter", PLACES["scene:clutter"], 3, "slide", "none", 20)
    drive = Drive(order, tmp_path)
    drive.step(0.0, 0.0)
    drive.close()
    assert drive.file is None
    assert list(tmp_path.iterdir()) == []


def test_the_twin_is_driven_and_judged_the_same(tmp_path, capsys):
    """The boards' own firmware drives; it stands until the stick is pushed, and follows it."""
    pytest.importorskip("serial", reason="pip install 'wheelchair_gym[hardware]'")
    build_twin()
    heads = []
    watch = lambda drive, k: heads.append(drive.picture()[0])  # noqa: E731
    file = driven(tmp_path, 5.0, watch, place="twin:scene:clutter", rate=20)
    assert heads[0]["waits"]
    assert heads[40]["twist"][0] > 0.3
    assert heads[40]["stands"] == []
    believed, true = heads[-1]["believed"], heads[-1]["pose"]
    assert 1e-6 < np.hypot(*(believed - true)[:2]) < 0.05
    (recorded,) = read_recording(file)
    assert np.abs(recorded.states[-1].truth.twist).max() < 0.02  # it was let go
    replays_the_same(file, capsys)


def test_the_twin_is_offered_where_nobody_moves():
    twins = {key: place for key, place in PLACES.items() if place.twin}
    assert len(twins) >= 3
    for place in twins.values():
        env = NavigationEnv(place.scene, split="test")
        for seed in range(5):
            env.reset(seed=seed)
            assert not len(env.episode.actors)


@pytest.fixture(scope="module")
def circles(tmp_path_factory):
    return driven(tmp_path_factory.mktemp("circles"), 12.0, curve=circling, place="scene:empty")


@pytest.mark.parametrize("part", long_but([0.45, 0.8, 0.999], [0.8]))
def test_a_recording_that_was_cut_off_is_judged_as_far_as_it_goes(
    circles, tmp_path, part, capsys, caplog
):
    file, whole = tmp_path / "cut.mcap", circles.read_bytes()
    file.write_bytes(whole[: int(part * len(whole))])
    replays_the_same(file, capsys)
    assert f"{file}: the recording was cut off; what it holds is used" in caplog.text
    driven = len(read_recording(circles)[0].actions)
    assert 0 < len(read_recording(file)[0].actions) <= driven == 12 * 40


@pytest.fixture(scope="module")
def served(served):
    small = Suite("small", ("straight", "a_star+window"), ("clutter",), 1, video=False)
    served.results = compare(small, served.studio.runs / "small", progress=False)
    return served


def tracks(socket, count=2):
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
        assert {len(state) for state in found[side]["states"]} == {11}  # numbers
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
