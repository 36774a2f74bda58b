"""The technician's tools from the command line, over devices in real time."""

import dataclasses
import io
import json
import re
import threading
import time
from contextlib import closing, contextmanager, nullcontext
from itertools import chain, repeat
from types import SimpleNamespace
from unittest.mock import Mock

import pytest

from agents.cli import hardware, main
from tests.conftest import output_of, put, refusal, until
from tests.identification.drives import room
from tests.sim.worlds import box
from wheelchair_gym.base.errors import InputError
from wheelchair_gym.envs.settings import env_settings
from wheelchair_gym.hardware import joystick
from wheelchair_gym.hardware.boards.senses import BoardSensors
from wheelchair_gym.hardware.chair import HardwareChair
from wheelchair_gym.safety.stops import BY_HAND
from wheelchair_gym.sim.chair import SimulatedChair
from wheelchair_gym.sim.randomization import exactly

pytest.importorskip("serial", reason="pip install 'wheelchair_gym[hardware]'")


@contextmanager
def repeated(act, seconds):
    """Act in a thread of its own, again after so long each time, while the context lasts."""
    ended = threading.Event()

    def each():
        while not ended.wait(seconds):
            act()

    thread = threading.Thread(target=each)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()


@pytest.mark.realtime
def test_tools_work_over_devices(served, tmp_path, capsys):
    """Run the tools; simulated time tests their findings, since a busy machine is late here."""
    file = tmp_path / "check.json"
    saved = output_of(["hardware", "setup", "--config", served.config], capsys)
    assert saved.count("saved") == 2
    words = ["hardware", "check", "--config", str(served.config), "--no-person"]
    assert main([*words, "--json", str(file)]) in (0, 1)
    said = capsys.readouterr().out
    findings = json.loads(file.read_text())["findings"]
    assert len(said.splitlines()) >= len(findings) > 15
    lines = [one for one in findings if one["what"] in ("line", "firmware", "parameters", "fan")]
    assert all(one["good"] for one in lines)
    monitor = ["hardware", "monitor", "--config", served.config, "--seconds", "1"]
    assert "battery" in output_of(monitor, capsys)


@pytest.mark.realtime
def test_a_tool_names_the_program_that_has_the_port_and_blames_no_cable(served, capsys):
    settings = env_settings(str(served.config))
    own = settings.hardware
    senses = BoardSensors(own, settings.sensors, settings.chair.drive, time.monotonic)
    with closing(senses), repeated(senses.poll, 0.005):
        assert until(lambda: senses.drive.connection is not None)
        assert main(["hardware", "check", "--config", str(served.config), "--no-person"]) == 1
        said = capsys.readouterr().out
        assert f"{own.drive_port} is in use by this very program" in said
        assert "cable" not in said.split("range board")[0]


def test_monitor_asks_before_it_resets_a_board(tmp_path, monkeypatch, capsys):
    ports = {"drive_port": "/dev/null", "range_port": "/dev/null"}
    config = put(tmp_path / "config.json", {"hardware": ports})
    words = ["hardware", "monitor", "--config", str(config), "--seconds", "0.1"]
    monkeypatch.setattr("sys.stdin", io.StringIO(""))
    said = refusal(words, capsys)
    assert "/dev/null" in said
    assert "--yes" in said
    assert main([*words, "--yes"]) == 0


class Driven(SimulatedChair):
    """A simulated chair with other wheels and laser, which a person drives by hand at first."""

    by_hand, bumped = 300.0, False  # s

    def __init__(self, settings, episode):
        errors = {"odometry.scale_error": 0.008, "odometry.track_error": 0.02,
                  "laser.x_error": 0.03, "laser.offset_error": 0.02}  # fmt: skip
        chair = dataclasses.replace(settings.chair, randomization=exactly(errors))
        sensors = dataclasses.replace(settings.sensors, pose_source="odometry")
        super().__init__(chair, sensors, settings.physics, 0.1)
        self.room = episode

    def reset(self, episode, key):
        return super().reset(self.room, 5)._replace(halted=BY_HAND)

    def drive(self, twist, protective=False):
        reading = super().drive(twist, protective)
        halted = BY_HAND if reading.stamp < self.by_hand else ""
        return reading._replace(halted=halted, bumped=self.bumped)


def test_calibration_drives_fits_and_writes(tmp_path, monkeypatch, capsys):
    """It writes the chair's own values; without --write it says that the config is off."""
    config, saved = put(tmp_path / "chair.json", {"model": "thesis"}), {}
    words = ["hardware", "calibrate", "--config", str(config)]
    monkeypatch.setattr(hardware, "_chair", lambda settings: Driven(settings, box(1.5)))
    assert main(words) == 1
    assert "expected free floor from -1 to 2 m ahead" in capsys.readouterr().err
    monkeypatch.setattr(hardware, "_chair", lambda settings: Driven(settings, room()))
    monkeypatch.setattr(hardware, "_boards", lambda settings: nullcontext((None, None)))
    monkeypatch.setattr(hardware, "_save", lambda *words, **more: saved.update(words[3]))
    assert main(words) == 1
    said = capsys.readouterr().out
    assert re.search("OFF +track", said)
    assert "not written" in said
    assert json.loads(config.read_text()) == {"model": "thesis"}
    monkeypatch.setattr(Driven, "bumped", True)
    assert main(words) == 1
    assert "a bumper was pressed before the drive began" in capsys.readouterr().err
    monkeypatch.setattr(Driven, "by_hand", 1.0)
    monkeypatch.setattr(Driven, "bumped", False)
    record = str(tmp_path / "drive.mcap")
    assert main([*words, "--write", "--record", record]) == 0
    found = env_settings(str(config))
    drive, laser = found.chair.drive, found.sensors.laser
    assert drive.counts_per_metre == pytest.approx(4346.0 / 1.008, rel=1e-3)
    assert drive.track == pytest.approx(0.54 * 1.02, abs=1e-3)
    assert laser.x == pytest.approx(0.69, abs=3e-3)
    assert laser.offset == pytest.approx(0.02, abs=6e-3)
    assert saved["track"] == drive.track
    assert saved["feed"] == pytest.approx(3.7 / 0.165 / 1.008, rel=0.03)
    simulate = ["replay", record, "--simulate", "--bar", "0.01"]
    capsys.readouterr()
    assert "need --simulate" in refusal(["replay", record, "--bar", "0.01"], capsys)
    assert "--picture: expected without" in refusal([*simulate, "--picture", "a.png"], capsys)
    assert main([*simulate, "--config", str(config)]) == 0
    assert main(["fit", record, "--hold", record, "--out", str(tmp_path / "fit")]) == 0
    told = json.loads((tmp_path / "fit" / "fit.json").read_text())
    before, fitted = (told["predictions"][k]["position_95"] for k in (2, 5))
    assert before > 0.01 > 5.0 * fitted
    assert "A chair, fitted" in (tmp_path / "fit" / "report.html").read_text()
    capsys.readouterr()
    assert "has 1, from 0" in refusal([*simulate, "--episode", "1"], capsys)


def no_stick(looks=0):
    """A device that is not there, or is taken away after n looks."""
    away = OSError("no joystick: plug it in")
    axis = SimpleNamespace(value=0, min=-1, max=1)
    return Mock(
        absinfo=lambda _axis: axis,
        active_keys=list,
        read=Mock(side_effect=chain(repeat((), looks), repeat(away))),
    )


@pytest.mark.realtime
@pytest.mark.parametrize("looks", [0, 5])
def test_drive_without_a_joystick_says_what_it_waits_for_and_ends(
    served, monkeypatch, capsys, looks
):
    """At the start, and where it is taken away under way."""
    devices, reset = [no_stick(looks)], HardwareChair.reset

    def opener(_own):
        if not devices or not looks:
            raise OSError("no joystick: plug it in")
        return devices.pop()

    def armed(chair, *words):
        with repeated(lambda: chair.waiting_for and chair.rearm(), 0.05):  # by a person
            return reset(chair, *words)

    monkeypatch.setattr(hardware, "load_extra", lambda package: None)
    monkeypatch.setattr(joystick.Joystick.__init__, "__defaults__", (lambda: None, opener))
    monkeypatch.setattr(HardwareChair, "reset", armed)
    words = ["hardware", "drive", "--config", str(served.config), "--timeout", "0.5"]
    assert main(words) == (1 if looks else 2)
    said = capsys.readouterr().err
    assert "no joystick: plug it in" in said.strip().splitlines()[-1]
    assert "0.5 s" in said.strip().splitlines()[-1]
    assert ("waits 0.5 s for a joystick" in said) == (not looks)


def test_re_arming_before_there_is_a_chair_does_nothing(tmp_path, monkeypatch, capsys):
    device, own = no_stick(), joystick.JoystickSettings()
    press = SimpleNamespace(type=joystick.EV_KEY, code=own.rearm_button, value=1)
    device.read = lambda: [press]
    monkeypatch.setattr(hardware, "load_extra", lambda package: None)
    monkeypatch.setattr(joystick.Joystick.__init__, "__defaults__", (None, lambda _own: device))
    monkeypatch.setattr(hardware, "_chair", Mock(side_effect=InputError("it is away")))
    config = put(tmp_path / "config.json", {})
    assert "it is away" in refusal(["hardware", "drive", "--config", config], capsys)
