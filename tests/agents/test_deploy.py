"""Laws of a deployed policy: slow at first, honest about what happens, and never left driving."""

import io
import json
import os
import re
import signal
import threading
import time
from contextlib import closing
from types import SimpleNamespace
from unittest.mock import Mock

import gymnasium as gym
import numpy as np
import pytest
from mcap.reader import make_reader

from agents.cli import main
from agents.deploy import Capped, Deployment, deploy, listen_for_rearm, rearm, rehearse
from agents.policies import make_policy
from agents.watch import ignore
from tests.agents.cli.test_drive_command import rearm_by_hand
from tests.agents.fakes import PaperWorld, corridor
from tests.conftest import ROOT, json_of, long_but, put, until
from tests.hardware.hosted import Hosted
from tests.hardware.realtime import EPISODE, X, Y, serving
from tests.hardware.served import signals_kept
from wheelchair_gym.envs.settings import env_settings
from wheelchair_gym.hardware.boards.protocol import Switch
from wheelchair_gym.hardware.control_loop import RealChair
from wheelchair_gym.hardware.joystick import Joystick, JoystickSettings
from wheelchair_gym.hardware.registry import localized
from wheelchair_gym.hardware.twin.lockstep import JoystickState
from wheelchair_gym.maps import write_map
from wheelchair_gym.sensors.settings import LaserSettings
from wheelchair_gym.sim.settings import ChairSettings
from wheelchair_gym.types import Command

pytest.importorskip("serial", reason="pip install 'wheelchair_gym[hardware]'")


def test_a_cap_begins_low_rises_while_it_drives_and_keeps_the_arc():
    world = PaperWorld(corridor(), (1.0, 0.0, 0.0), (6.0, 0.0, 0.0))
    hasty, fast = Mock(), np.array([1.0, 0.5])  # full speed in a bend
    hasty.act.return_value = Command.from_action(fast, world.mission.limits)
    capped = Capped(hasty, Deployment(first=0.2, rise=0.5, maximum=0.6))
    capped.reset(world.mission)
    hasty.reset.assert_called_once_with(world.mission)
    twists = [capped.act(world.seen).twist for _ in range(20)]
    speeds = [float(v) for v, _ in twists]
    assert speeds[0] == pytest.approx(0.25)
    assert speeds == sorted(speeds)
    assert speeds[-1] == pytest.approx(0.6)
    for v, w in twists:
        assert w / v == pytest.approx(0.5 / 0.8)
    assert capped.act(world.seen._replace(halted="a reason")).twist[0] == pytest.approx(0.2)


class Drive:
    """A policy over the twin in simulated time, with its log."""

    def __init__(self, dry=False, each=ignore, shield=None, **own):
        self.settings = env_settings(
            str(ROOT / "configs" / "hardware.json"), pose_source="odometry", noise=False
        )
        s = self.settings
        self.hosted = Hosted(EPISODE, chair=s.chair, sensors=s.sensors, dry_run=dry)
        self.env = gym.make(
            "wheelchair_gym/Hardware-v1", config=s, chair=localized(self.hosted.chair, s),
            disable_env_checker=True, shield=shield,
        ).unwrapped  # fmt: skip
        self.log, self.each = [], each
        self.own = Deployment(**{"first": 0.2, "rise": 0.1, "patience": 2.0, **own})

    def run(self, dry=False):
        policy = make_policy("straight")
        try:
            with closing(self.env):
                return deploy(self.env, policy, EPISODE, self.own, self.log.append, dry, self.each)
        finally:
            self.end()

    def end(self):
        """Close the chair, which has come to rest, however its drive has ended."""
        clock = self.hosted.clock
        clock.wait(clock.now() + 0.7)
        assert abs(self.hosted.twin.motion.speed) < 2e-3
        self.hosted.close()


def at(stamp, act):
    """Does something once, when the episode is so old."""
    done = []

    def each(env):
        if not done and env.task.reading.stamp >= stamp:
            done.append(act())

    return each


def test_it_arrives_and_is_told_to_stop():
    drive = Drive()
    record = drive.run()
    assert record["outcome"] == "success"
    assert record["ended"] == ""
    assert np.hypot(*(drive.hosted.twin.plant.pose - EPISODE.goal)[:2]) < 0.3
    assert drive.log == []


ENDS = {
    "EMERGENCY_STOP": lambda twin: setattr(twin.faults, "switches", Switch.STOP_PRESSED),
    "the laser is silent": lambda twin: setattr(twin.laser, "silent", True),
}


@pytest.mark.parametrize("why", ENDS)
def test_a_stop_that_lasts_ends_it_and_says_so(why):
    drive = Drive()
    drive.each = at(1.5, lambda: ENDS[why](drive.hosted.twin))
    record = drive.run()
    assert record["outcome"] == "halted"
    assert why in record["ended"]
    assert why in drive.log[0]


def test_a_person_takes_it_and_gives_it_back():
    """However long the person drives; then the cap is low again."""
    drive = Drive()
    drive.each = by_the_board(drive, 1.5, 4.5, ahead=0.3)
    assert drive.run()["outcome"] == "success"
    stands, on = (line.split("s  ", 1)[1] for line in drive.log)
    assert stands.startswith("stands: a person drives it by the joystick; ")
    assert on == "goes on"


def between(begin, end, thing, name, value, other):
    """Gives a thing's attribute a value at one age of the episode, and another one at a later."""
    first, last = (
        at(stamp, lambda each=each: setattr(thing, name, each))
        for stamp, each in ((begin, value), (end, other))
    )
    return lambda env: [first(env), last(env)]


def silent_for(drive, begin, end):
    return between(begin, end, drive.hosted.twin.laser, "silent", True, False)


def by_the_board(drive, since, until, ahead=0.0):
    """A person takes the chair by the joystick at its board and hands it back."""
    stick = JoystickState(ahead, 0.0, True, True)
    return between(since, until, drive.hosted.twin.faults, "joystick", stick, JoystickState())


WAYS = ("Enter", "joystick at the host", "joystick at the board")


@pytest.mark.parametrize("way", long_but(WAYS, WAYS[2:]))
def test_a_latched_shield_is_told_and_goes_on_when_a_person_re_arms_it(way):
    """After one drop-out of the laser; nothing is said to go on while the shield stands."""
    drive = Drive(shield=True, patience=20.0)
    chair, shield = drive.hosted.chair, drive.env.shield
    acts = {
        "Enter": at(4.0, lambda: rearm(chair, shield)),
        "joystick at the host": at(4.0, chair.rearm),
        "joystick at the board": by_the_board(drive, 4.0, 4.5),
    }
    fails, latched = silent_for(drive, 1.5, 2.3), []

    def each(env):
        fails(env)
        acts[way](env)
        latched.append(env.shield.latched)

    drive.each = each
    record = drive.run()
    assert record["outcome"] == "success"
    assert 15 < latched.count("laser silent") < 40
    lines = [line.split("s  ", 1)[1] for line in drive.log]
    (told,) = [line for line in lines if line.startswith("stands: the shield has stopped it")]
    assert "laser silent; needs a re-arm by a person: check its plug" in told
    assert [k for k, line in enumerate(lines) if line == "goes on"] == [len(lines) - 1]
    assert float(drive.log[-1].split("s  ")[0]) > 3.9
    assert any("no longer: the laser is silent" in line for line in lines)


def test_a_latched_shield_that_nobody_re_arms_ends_it():
    drive = Drive(shield=True)
    drive.each = silent_for(drive, 1.5, 2.3)
    record = drive.run()
    assert record["outcome"] == "halted"
    assert record["ended"] == "the shield has stopped it: laser silent, for 2 s"
    assert not any("goes on" in line for line in drive.log)


def test_in_simulation_a_latched_shield_stands_until_time_is_up(tmp_path, capsys):
    """Nobody is there to re-arm it, and the command says why the chair stands."""
    faults = {"share": 1.0, "onset": [0.5, 1.0]}
    fails = {"sensors": {"faults": faults, "pose_source": "odometry"}}
    config = put(tmp_path / "fails.json", fails)
    words = ["simulate", "--scene", "empty", "--policy", "straight", "--config", config]
    answer = json_of([*words, "--seed", "1", "--shield", "on"], capsys)
    assert answer["outcome"] == "timeout"
    assert answer["stands"][0].startswith("the shield has stopped it: ")


def test_a_re_arm_while_the_cause_stands_is_refused_and_told():
    drive = Drive(shield=True, patience=3.0)
    fails = silent_for(drive, 1.5, 99.0)
    tries = at(3.0, lambda: rearm(drive.hosted.chair, drive.env.shield))
    drive.each = lambda env: [fails(env), tries(env)]
    assert drive.run()["outcome"] == "halted"
    assert any("not re-armed: laser silent, still; check its plug" in line for line in drive.log)


@pytest.mark.parametrize("terminal", [True, False])
def test_it_says_how_a_person_re_arms_it(terminal, monkeypatch, caplog):
    """The ways there are: no Enter where nobody is at a terminal, no joystick that is not there."""
    drive = Drive(shield=True)
    stdin = io.StringIO("")
    stdin.isatty = lambda: terminal
    monkeypatch.setattr("sys.stdin", stdin)
    joystick = JoystickSettings(device="/dev/input/event99")
    nobody = Mock(side_effect=OSError("no joystick at '/dev/input/event99'"))
    drive.hosted.chair.joystick = Joystick(joystick, drive.hosted.chair.rearm, nobody)
    listen_for_rearm(drive.env.chair, drive.env.shield)
    drive.env.reset(options={"episode": EPISODE})
    (line,) = [r.message for r in caplog.records if "a person must re-arm" in r.message]
    assert ("Enter here" in line) == terminal
    assert "button 314 of the host's joystick (no joystick at '/dev/input/event99')" in line
    assert "waits 120 s" in line
    drive.env.close()
    drive.end()


def test_an_exception_stops_it():
    drive = Drive()
    drive.each = at(1.5, Mock(side_effect=RuntimeError("a policy's mistake")))
    with pytest.raises(RuntimeError, match="mistake"):
        drive.run()


def test_a_dry_run_sends_no_command():
    drive = Drive(dry=True)
    chair, begun = drive.hosted.chair, drive.hosted.clock.now()
    sent = []
    send = chair.senses.drive.send
    chair.senses.drive.send = lambda message: sent.append(type(message).__name__) or send(message)
    resets, close = [], drive.hosted.close
    drive.hosted.close = lambda: resets.append(drive.hosted.twin.drive.resets) or close()
    drive.each = at(2.0, Mock(side_effect=KeyboardInterrupt))
    with pytest.raises(KeyboardInterrupt):
        drive.run(dry=True)
    assert set(sent) == {"Get"}
    assert drive.hosted.clock.now() > begun + 2.2  # 0.7 s of them at rest
    assert "v  0." in drive.log[-1]
    assert any("dry run" in line for line in drive.log)
    assert resets == [0]


def words_for(config, map_, record):
    words = ["deploy", "--config", str(config), "--map", str(map_), "--policy", "straight"]
    words += ["--start", f"{X},{Y},0", "--goal", f"{X + 2.0},{Y + 0.5}"]
    return [*words, "--record", str(record)]


def test_the_command_is_ended_by_a_signal(monkeypatch, tmp_path, capfd):
    """SIGTERM stops the chair, and what happened is on record."""
    begun, drive, record, file = time.time(), Drive(), tmp_path / "run.mcap", tmp_path / "map.yaml"
    write_map(EPISODE.map, file)
    monkeypatch.setattr("wheelchair_gym.hardware.registry.make_chair", lambda *_: drive.env.chair)
    twin, clock, sent = drive.hosted.twin, drive.hosted.clock, []

    def terminate():
        if twin.motion.speed > 0.1 and not sent:
            sent.append(True)
            os.kill(os.getpid(), signal.SIGTERM)

    clock.call_every(terminate, 0.1, "a signal")
    words = words_for(ROOT / "configs" / "hardware.json", file, record)
    words += ["--pose", "odometry", "--force-start"]  # the room has a twin place
    with signals_kept():
        assert main(words) == 130
    assert capfd.readouterr().err.splitlines()[-1] == "wheelchair: stopped"
    with record.open("rb") as stream:
        told = [*make_reader(stream).iter_messages(["/board"])]
    boards = [json.loads(message.data) for *_, message in told]
    assert len(boards) > 5
    assert {board["mode"] for board in boards} == {"HOST"}
    assert boards[-1]["left"] > boards[0]["left"] + 5
    assert boards[-1]["duty_left"] > 0.02
    assert all(begun <= board["wall"] <= time.time() for board in boards)
    assert {board["faults"] for board in boards} == {""}
    drive.end()


@pytest.mark.parametrize("turn", [0.0, 1.57])
def test_a_start_that_the_scan_does_not_fit_is_refused(turn, monkeypatch, tmp_path, capfd):
    """Here 1.5 m off, and turned; nothing is driven, and the line says where it may stand."""
    drive, file = Drive(), tmp_path / "map.yaml"
    write_map(EPISODE.map, file)
    monkeypatch.setattr("wheelchair_gym.hardware.registry.make_chair", lambda *_: drive.env.chair)
    words = words_for(ROOT / "configs" / "hardware.json", file, tmp_path / "run.mcap")
    words += ["--pose", "odometry", "--start", f"{X - 0.9},{Y + 1.2},{turn}"]
    place = drive.hosted.twin.plant.pose
    assert main(words) == 2
    line = capfd.readouterr().err.splitlines()[-1]
    assert line.startswith("wheelchair: the scan fits the map with 0.")
    assert re.search(r"it fits (1.00|0.9\d) at 3.0", line)
    assert "--force-start" in line
    assert np.hypot(*(drive.hosted.twin.plant.pose - place)[:2]) < 0.01
    drive.end()


@pytest.mark.realtime
@pytest.mark.long
def test_the_command_drives_over_devices(tmp_path, caplog, capfd):
    """In real time, as a person runs it, who re-arms it at the board's joystick."""
    with serving(tmp_path) as served, signals_kept():

        def hand():
            until(lambda: "a person must re-arm" in caplog.text)
            rearm_by_hand(served.twin.faults, JoystickState())
            until(lambda: served.twin.motion.speed > 0.1)
            os.kill(os.getpid(), signal.SIGTERM)

        threading.Thread(target=hand, daemon=True).start()
        words = [*words_for(served.config, served.map, tmp_path / "run.mcap"), "--force-start"]
        assert main(words) == 130
        assert "a person must re-arm" in caplog.text
        assert capfd.readouterr().err.splitlines()[-1] == "wheelchair: stopped"
        assert until(lambda: abs(served.twin.motion.speed) <= 2e-3)


def test_late_periods_are_counted_those_that_were_missed_as_a_whole_too():
    clock, chair = SimpleNamespace(time=100.0), ChairSettings()
    clock.now = lambda: clock.time  # it stands still unless it is told to move
    clock.wait = lambda deadline, _: setattr(clock, "time", max(clock.time, deadline))
    drive = {"reset": None, "drive": None}
    loop = type("Paced", (RealChair,), drive)("it", clock, 0.1, 0.2, chair, LaserSettings())
    loop._begin(np.zeros(3))
    for took in (0.25, 0.02, 0.09, 0.115, 0.02, 0.32, 0.05):  # s of thinking in each period
        clock.time += took
        loop._wait_period()
    stamps, delays = np.array(loop.late).T
    np.testing.assert_allclose(delays, [0.1, 0.3])  # the first may take as long as it likes
    np.testing.assert_allclose(stamps, [0.7, 1.2])
    loop._begin(np.zeros(3))
    assert len(loop.late) == 0


@pytest.mark.long
def test_rehearsals_compile_what_only_a_closed_way_needs():
    from planners.lattice import flood

    rehearse("lattice+window", {"beams": 64})
    assert flood._spread.signatures
