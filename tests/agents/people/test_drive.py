"""Laws of a person's drive with an assistant: the hand goes first; every failure stops it."""

import dataclasses
import threading
from types import SimpleNamespace
from unittest.mock import Mock

import gymnasium as gym
import numpy as np
import pytest

from agents.cli.arguments import spec
from agents.people import drive
from agents.people.recorded_stick import open_loop
from agents.policies import make_policy
from tests.conftest import at_start, until
from tests.hardware.hosted import Hosted
from tests.sim.worlds import box
from wheelchair_gym.envs.settings import env_settings
from wheelchair_gym.geometry.kinematics import Limits
from wheelchair_gym.hardware.boards.protocol import Mode, Switch
from wheelchair_gym.hardware.joystick import Joystick
from wheelchair_gym.hardware.registry import localized
from wheelchair_gym.hardware.twin.lockstep import JoystickState
from wheelchair_gym.recording.record import RecordEpisodes
from wheelchair_gym.recording.replay import read_recording, replay_env
from wheelchair_gym.safety.stops import BY_HAND, NO_STICK, NOT_HELD, OFF_CENTRE
from wheelchair_gym.types import Command, Stick

RATE = 20.0
HELD = JoystickState(dead_man=True)
PUSHED = JoystickState(forward=1.0, dead_man=True)
AHEAD = Command(np.array([0.5, 0.0]))


class Ride:
    """A person at the drive board's joystick, over emulated boards in simulated time.

    `hand` says what the person does at a time [s]: a JoystickState, or None for a silent radio.
    """

    def __init__(self, hand, policy=None, half=50.0, deadline=600.0, source=None, file=None):
        base = env_settings(None, pose_source="odometry", noise=False, rate=RATE)
        task = dataclasses.replace(base.task, bump_ends=False)
        config = dataclasses.replace(base, task=task)
        self.hosted = Hosted(box(half), sensors=config.sensors, period=1.0 / RATE)
        self.twin, chair = self.hosted.twin, self.hosted.chair
        self.assistant = drive.TimedAssistant(
            policy or make_policy({"name": "assisted", "assist": "slide"}), "mine", deadline
        )
        clock = self.hosted.clock
        self.stick = drive.PersonsStick(1.0, clock.now, lambda: self.assistant.fault)
        self.stick.source = source or chair
        chair.person, chair.assisted = self.stick.why, source is None
        self.env = gym.make(
            "wheelchair_gym/Hardware-v1", config=config, chair=localized(chair, config),
            person=self.stick, shield=True, disable_env_checker=True,
        ).unwrapped  # fmt: skip
        self.env.labels = {"assistant": "slide", "interface": "board"}
        if file is not None:
            self.env = RecordEpisodes(self.env, file)
        self.log, self.speeds, self.modes, self.hand = [], [], [], hand
        self.begun = None

    def now(self):
        return 0.0 if self.begun is None else self.hosted.clock.now() - self.begun

    def run(self, seconds, dies=lambda env: False):
        clock = self.hosted.clock

        def tick():
            self.twin.faults.joystick = self.hand(self.now())
            if self.begun is not None:
                self.speeds.append((self.now(), self.twin.motion.speed))

        clock.call_every(tick, 0.005, "hand")

        def each(env):
            if self.begun is None:
                self.begun = clock.now()
            self.modes.append(self.hosted.chair.report["mode"])
            return dies(env) or self.now() >= seconds

        try:
            return drive.drive_with_help(
                self.env, self.assistant, self.stick, drive.open_space(), self.log.append, each
            )
        finally:
            self.env.close()
            self.assistant.close()
            self.hosted.close()

    def speed(self, at):
        """True speed at a time [m/s]."""
        times, speeds = np.array(self.speeds).T
        return float(np.interp(at, times, speeds))


def test_an_assistant_drives_while_the_switch_is_held_and_the_stick_pushed():
    """Held, pushed; let go while pushed; held again while pushed; centred; pushed; let centre."""

    def hand(t):
        if t < 0.5 or 6.0 <= t < 6.5:
            return HELD
        if t < 3.0 or 5.0 <= t < 6.0 or 6.5 <= t < 9.0:
            return PUSHED
        return JoystickState(forward=1.0) if t < 5.0 else HELD

    ride = Ride(hand)
    record = ride.run(11.0)
    assert ride.speed(2.9) > 0.5
    assert abs(ride.speed(4.5)) < 0.01  # let go
    assert abs(ride.speed(6.4)) < 0.01  # held again off the centre
    assert ride.speed(8.9) > 0.5
    assert abs(ride.speed(11.0)) < 0.01
    log = "\n".join(ride.log)
    assert NOT_HELD in log
    assert OFF_CENTRE in log
    assert record["ended"] == ""
    assert record["length"] > 1.5
    assert record["time"] == pytest.approx((len(ride.modes) - 1) / RATE)
    assert record["agreement_angle"] < 0.1


def test_a_drive_on_the_chair_is_recorded_and_its_assistant_answers_the_same_again(tmp_path):
    ride = Ride(lambda t: HELD if t < 0.3 else PUSHED, half=2.0, file=tmp_path / "drive.mcap")
    ride.run(4.0)
    (recorded,) = read_recording(tmp_path / "drive.mcap")
    assert recorded.labels == {"assistant": "slide", "interface": "board"}
    assert recorded.states[60].reading.stick == Stick(1.0, 0.0, False)
    env = at_start(replay_env(recorded), None, options={"episode": recorded.episode})
    for action, verdict in zip(recorded.actions, recorded.verdicts, strict=True):
        _, reward, _, _, info = env.step(action)
        assert reward == verdict["reward"]
        assert info["reward_terms"] == verdict["terms"]
    figures = open_loop(recorded, "slide")
    assert figures["same_answers"]
    assert figures["recorded"]["intervention_share"] > 0.1


def test_an_assistant_keeps_the_chair_off_a_wall():
    ride = Ride(lambda t: HELD if t < 0.3 else PUSHED, half=2.5)
    record = ride.run(9.0)
    assert not ride.twin.bumper_steps
    assert ride.twin.plant.pose[0] > 0.8
    assert record["intervention_share"] > 0.1


def test_the_manual_switch_takes_the_chair_at_any_moment():
    def hand(t):
        stick = HELD if t < 0.3 or 3.5 <= t < 4.0 or t >= 8.0 else PUSHED
        return dataclasses.replace(stick, manual=2.0 <= t < 7.0)

    ride = Ride(hand)
    ride.run(9.0)
    assert ride.speed(1.9) > 0.5
    assert abs(ride.speed(3.4)) < 0.01  # taken over with the stick off its centre
    assert ride.speed(6.9) == pytest.approx(0.4, abs=0.02)  # the board's share, without the host
    assert abs(ride.speed(7.9)) < 0.02  # returned off the centre
    assert Mode.MANUAL.name in ride.modes
    assert BY_HAND in "\n".join(ride.log)


def by_hand_after_4_s(t):
    stick = HELD if t < 0.3 or 4.0 <= t < 4.5 else PUSHED
    return dataclasses.replace(stick, manual=t >= 4.0)


@pytest.mark.parametrize(
    "last",
    [ZeroDivisionError("nobody there"), Command(np.array([np.nan, 0.0]))],
    ids=["an error", "no number"],
)
def test_an_assistant_that_fails_stops_the_chair_which_a_person_drives_on_by_hand(last):
    ride = Ride(by_hand_after_4_s, Mock(act=Mock(side_effect=[*40 * [AHEAD], last])))
    ride.run(7.0)
    assert ride.speed(1.9) > 0.3
    assert abs(ride.speed(3.9)) < 0.01
    assert ride.speed(6.9) == pytest.approx(0.4, abs=0.02)
    (line,) = [line for line in ride.log if "mine has failed" in line]
    assert "Error" in line
    assert "by hand" in line


def test_an_assistant_that_is_late_stops_the_chair_until_the_stick_was_centred():
    def act(reading):
        if late.act.call_count == 40:  # once, until it is let go
            free.wait()
        return AHEAD

    def hand(t):
        if t > 4.0 and not free.is_set():
            free.set()
            assert until(lambda: not ride.assistant._answers.empty())
        return HELD if t < 0.3 or 8.0 <= t < 8.3 else PUSHED

    def each(env):
        ride.assistant.deadline = 0.01 if late.act.call_count == 39 else 600.0
        return False

    free, late = threading.Event(), Mock()
    late.act.side_effect = act
    ride = Ride(hand, late)
    ride.run(11.0, each)
    log = "\n".join(ride.log)
    assert "mine is late" in log
    assert OFF_CENTRE in log
    assert ride.speed(1.9) > 0.3
    assert abs(ride.speed(7.9)) < 0.01
    assert ride.speed(10.9) > 0.3


def test_a_radio_that_is_silent_stops_the_chair_and_a_lost_stop_button_ends_the_drive():
    ride = Ride(lambda t: HELD if t < 0.3 else PUSHED if t < 2.0 else None)
    ride.run(4.0)
    assert ride.speed(1.9) > 0.5
    assert abs(ride.speed(3.5)) < 0.01
    assert NO_STICK in "\n".join(ride.log)
    ride = Ride(lambda t: HELD if t < 0.3 else PUSHED)

    def stop():
        if ride.now() > 2.0:
            ride.twin.faults.switches = Switch.STOP_PRESSED

    ride.hosted.clock.call_every(stop, 0.05, "stop")
    record = ride.run(6.0)
    assert "EMERGENCY_STOP" in record["ended"]
    assert record["time"] < 3.0


def test_a_host_that_dies_leaves_a_chair_that_stops_and_that_a_person_drives_by_hand():
    """The board stops by itself, with the stick still pushed; its watchdog needs no host."""
    ride = Ride(by_hand_after_4_s)
    clock = ride.hosted.clock

    def die(env):
        if ride.now() < 2.0:
            return False
        clock.guards = [guard for guard in clock.guards if guard.call.__name__ == "tick"]
        clock.wait(ride.begun + 7.0)
        return True

    ride.run(9.0, die)
    assert ride.speed(2.0) > 0.5
    speeds = [v for t, v in ride.speeds if 2.2 < t < 3.9]
    assert speeds[-1] == pytest.approx(0.0, abs=0.01)
    rest = next(t for t, v in ride.speeds if t > 2.0 and abs(v) < 0.01)
    assert rest < 2.0 + 0.2 + 0.8 / 1.5 + 0.1
    assert ride.speed(6.9) == pytest.approx(0.4, abs=0.02)


def test_after_a_touch_the_person_drives_it_free_by_hand():
    """The strip stops it; by hand it backs off; returned, it drives on."""

    def hand(t):
        if 4.5 <= t < 9.0:
            stick = HELD if t < 5.0 or t > 8.0 else JoystickState(forward=-1.0, dead_man=True)
            return dataclasses.replace(stick, manual=True)
        return HELD if t < 0.3 or 9.0 <= t < 9.5 else PUSHED

    ride = Ride(hand, Mock(act=lambda reading: AHEAD))  # whatever is there

    def bump():
        ride.twin.faults.switches = Switch.FRONT if 2.0 < ride.now() < 6.5 else Switch(0)

    ride.hosted.clock.call_every(bump, 0.05, "bump")
    ride.run(12.0)
    assert abs(ride.speed(4.4)) < 0.01
    assert ride.speed(6.0) == pytest.approx(-0.1, abs=0.02)
    assert abs(ride.speed(8.9)) < 0.02
    assert ride.speed(11.9) > 0.3
    assert "bumped" in "\n".join(ride.log)


def test_a_stick_counts_once_it_was_centred():
    push, rest = (Stick(1.0, -0.5, False), ""), (Stick(0.0, 0.0, False), "")
    stick = drive.PersonsStick(0.5, lambda: 0.0, lambda: "")
    assert stick.read()[1] == NO_STICK
    given = iter([push, rest, push, (Stick(1.0, 0.0, False), NOT_HELD), push, rest, push])
    stick.source = SimpleNamespace(stick=lambda now: next(given))
    found = [stick.read() for _ in range(7)]
    assert [why for _, why in found] == [OFF_CENTRE, "", "", NOT_HELD, OFF_CENTRE, "", ""]
    assert [tuple(one)[:2] for one, _ in found if any(one)] == [(0.5, -0.25)] * 2


def test_no_assistant_adds_speed_or_moves_a_centred_stick():
    limits, rng = Limits(), np.random.default_rng(0)
    for _ in range(500):
        stick = Stick(*rng.uniform(-1.0, 1.0, 2) * rng.integers(0, 2, 2), False)
        v, w = drive.held_to_stick(rng.uniform(-2.0, 2.0, 2), stick, limits)
        asked, turn = limits.twist_of(stick.forward, stick.left)
        assert min(0.0, asked) <= v <= max(0.0, asked)
        if asked == turn == 0.0:
            assert (v, w) == (0.0, 0.0)


def test_keys_are_a_stick_while_they_are_read_and_the_window_is_looked_at(monkeypatch):
    pygame = pytest.importorskip("pygame")
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    monkeypatch.setenv("DISPLAY", ":0")
    acts = []
    keys = drive.Keyboard(0.5, lambda: acts.append(1))

    def post(kind, key=None):
        more = {} if key is None else {"key": key}
        pygame.event.post(pygame.event.Event(kind, **more))

    def read(now):
        keys.poll(now)
        return keys.stick(now)

    assert read(0.0) == (Stick(0.0, 0.0, False), "")
    post(pygame.KEYDOWN, pygame.K_UP)
    post(pygame.KEYDOWN, pygame.K_a)
    assert read(0.1) == (Stick(1.0, 1.0, False), "")
    post(pygame.KEYUP, pygame.K_a)
    assert keys._window.show(np.zeros((9, 9, 3), np.uint8))  # it leaves keys that are let go
    assert read(0.1) == (Stick(1.0, 0.0, False), "")
    post(pygame.KEYDOWN, pygame.K_LSHIFT)
    assert read(0.2)[0].forward == 0.4
    assert keys.stick(1.0) == (Stick(0.0, 0.0, False), NO_STICK)  # nobody reads them
    post(pygame.WINDOWFOCUSLOST)
    assert read(1.0) == (Stick(0.0, 0.0, False), "")
    assert keys(1.0, Limits()) is None
    post(pygame.KEYDOWN, pygame.K_m)
    post(pygame.KEYDOWN, pygame.K_DOWN)
    assert read(1.1)[1] == BY_HAND
    np.testing.assert_allclose(keys(1.1, Limits()), [-0.15, 0.0])
    assert not keys(2.0, Limits()).any()
    post(pygame.KEYDOWN, pygame.K_RETURN)
    post(pygame.KEYDOWN, pygame.K_q)
    keys.poll(2.0)
    assert acts == [1]
    assert not keys.open
    keys.close()


def test_a_gamepad_drives_with_help_while_its_button_is_held():
    """Its other button takes the chair without help, and keeps it until it is returned."""
    from tests.hardware.test_joystick import OWN, FakeDevice

    device = FakeDevice()
    pad = Joystick(OWN, opener=lambda own: device)
    ride = Ride(lambda t: None, source=pad)
    ride.hosted.chair.joystick = pad
    clock = [
        (0.0, (OWN.assist_button, 1)),
        (0.3, "push"),
        (2.5, (OWN.assist_button, 0)),
        (4.0, "centre", (OWN.dead_man_button, 1)),
        (4.3, "push"),
        (6.5, "centre", (OWN.dead_man_button, 0), (OWN.release_button, 1)),
        (7.0, (OWN.assist_button, 1)),
        (7.3, "push"),
    ]

    def fingers():
        while clock and ride.begun is not None and ride.now() >= clock[0][0]:
            for act in clock.pop(0)[1:]:
                if act == "push":
                    device.tilt(ahead=1.0)
                elif act == "centre":
                    device.tilt()
                else:
                    device.press(*act)

    ride.hosted.clock.call_every(fingers, 0.005, "fingers")
    ride.run(9.5)
    assert ride.speed(2.4) > 0.5
    assert abs(ride.speed(3.9)) < 0.01
    assert ride.speed(6.4) == pytest.approx(OWN.speed_fraction * 0.8, abs=0.02)  # by hand
    assert abs(ride.speed(7.2)) < 0.2
    assert ride.speed(9.4) > 0.5


def test_a_class_of_a_package_is_named_by_its_module(tmp_path, monkeypatch):
    """A dot in it makes no file of it; a file that is there is one."""
    assert spec("my_package.people:Somebody") == "my_package.people:Somebody"
    monkeypatch.chdir(tmp_path)
    (tmp_path / "people.txt").write_text('{"me": {"gain": 1}}')
    assert spec("people.txt:me") == {"name": "me", "gain": 1}
