"""Recordings of the studio hold who drove and how, as those of every person do."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

from agents.cli import main
from agents.people.recorded_stick import session_of
from agents.studio.catalogue import places
from agents.studio.drive import Drive, Order
from tests.conftest import long_but, refusal
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
    assert main(["replay", str(file), "--assist", "slide"]) == 0
    said = capsys.readouterr().out
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
    out = tmp_path / "fit.json"
    assert main(["fit-driver", str(file), "--repeats", "2", "--json", str(out)]) == 0
    found = json.loads(out.read_text())["fitted"]
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
    """An assistant that fits no chair."""

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
    """A drive of 12 s."""
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
