"""Laws of a joystick at the host, over devices that a test moves: held or standing."""

import termios
from collections import namedtuple
from types import SimpleNamespace
from unittest.mock import Mock

import numpy as np
import pytest

from tests.sim.worlds import box
from wheelchair_gym.geometry.kinematics import Limits
from wheelchair_gym.hardware import joystick
from wheelchair_gym.hardware.connection import RETRY, Reconnecting

OWN = joystick.JoystickSettings(device="fake")
Event = namedtuple("Event", "type code value")


class FakeDevice:
    def __init__(self, ahead=0.0):
        self.said, self.plugged, self.held = [], True, []
        self.tilt(ahead)
        self.said.clear()  # it was so before somebody listened

    def absinfo(self, axis):
        low, high = ((0, 255), (-32768, 32767))[axis]
        return SimpleNamespace(value=self.values[axis], min=low, max=high)

    def active_keys(self):
        return self.held

    def read(self):
        if not self.plugged:
            raise OSError(19, "No such device")
        if not self.said:
            raise BlockingIOError
        said, self.said = self.said, []
        return said

    def close(self):
        pass

    def press(self, code, value=1):
        self.said += [Event(joystick.EV_KEY, code, value), Event(joystick.EV_SYN, 0, 0)]

    def tilt(self, ahead=0.0, left=0.0):
        self.values = {1: round(-ahead * 32767), 0: round(127.5 - left * 127.5)}
        self.said += [Event(joystick.EV_ABS, *pair) for pair in self.values.items()] + [
            Event(joystick.EV_SYN, 0, 0)
        ]


class Seat:
    """A joystick whose device can be pulled and plugged in again."""

    def __init__(self, rearm=lambda: None):
        self.device, self.there, self.ahead = FakeDevice(), True, 0.0
        self.joystick = joystick.Joystick(OWN, rearm, self._open)

    def _open(self, own):
        if not self.there:
            raise OSError(2, "No such file or directory")
        self.device = FakeDevice(self.ahead)
        return self.device

    def ask(self, now=0.0):
        return self.joystick(now, Limits())


def test_it_drives_only_while_the_button_is_held():
    seat, limits = Seat(), Limits()
    assert seat.ask() is None
    seat.device.tilt(ahead=1.0)
    assert seat.ask() is None  # nobody holds the button
    seat.device.press(OWN.dead_man_button)
    assert not seat.ask().any()  # the stick was not at its centre
    seat.device.tilt()
    seat.device.tilt(ahead=1.0)
    np.testing.assert_allclose(seat.ask(), [OWN.speed_fraction * limits.forward, 0.0], atol=1e-3)
    seat.device.tilt(ahead=-1.0, left=1.0)
    want = [-OWN.speed_fraction * limits.backward, OWN.speed_fraction * limits.turn]
    np.testing.assert_allclose(seat.ask(), want, atol=1e-3)
    seat.device.tilt(ahead=0.5 * OWN.dead_zone)
    assert not seat.ask().any()
    seat.device.tilt(ahead=1.0)
    seat.device.press(OWN.dead_man_button, 2)  # repeated
    seat.device.press(OWN.release_button)  # it is not handed back while the button is held
    assert seat.ask().any()
    seat.device.press(OWN.dead_man_button, 0)
    assert not seat.ask().any()  # stands, and is still the person's
    seat.device.press(OWN.release_button)
    assert seat.ask() is None


def test_nothing_moves_before_the_centre_was_seen_with_the_button_held():
    """The interlock, against a model of its own: 100 random histories of fingers and cables."""
    moved = 0
    for seed in range(100):
        rng, seat, now, ahead, held = np.random.default_rng(seed), Seat(), 0.0, 0.0, False
        seat.ask()
        history = []  # (held, ahead) after each event; breaks are None
        for _ in range(60):
            for act in rng.choice(6, rng.integers(1, 4), p=[0.4, 0.25, 0.2, 0.05, 0.05, 0.05]):
                held = bool(act == 1) or (held and act in (0, 4))
                history += [None] if act in (1, 2, 3, 5) or (act == 4 and not ahead) else []
                if act == 0:
                    ahead = float(rng.choice((0.0, 0.0, 0.5, -1.0)))
                    seat.device.tilt(ahead, 0.5 * ahead)
                elif act in (1, 2):
                    seat.device.press(OWN.dead_man_button, int(held))
                elif act == 3:
                    seat.device.said.append(Event(joystick.EV_SYN, joystick.SYN_DROPPED, 0))
                    seat.ask(now)
                elif act == 4:
                    seat.device.press(OWN.rearm_button)
                else:  # its cable is pulled, and plugged in again with the stick where it is
                    seat.device.plugged = seat.there = False
                    seat.ask(now)
                    assert "No such" in seat.joystick.error
                    seat.there, seat.ahead, now = True, ahead, now + 2.0 * RETRY
                    seat.ask(now)
                    assert seat.joystick.error == ""
                history += [(held, ahead)]
            since = history[max((k for k, one in enumerate(history) if one is None), default=0) :]
            free = held and (True, 0.0) in since
            twist = seat.ask(now)
            if twist is not None:
                assert bool(twist.any()) == (free and ahead != 0.0), (seed, history)
                moved += bool(twist.any())
    assert moved > 300


def test_it_re_arms_with_sticks_at_rest_only():
    acts = []
    seat = Seat(lambda: acts.append(1))
    seat.ask()
    seat.device.tilt(ahead=0.5)
    seat.device.press(OWN.rearm_button)
    seat.ask()
    assert acts == []
    seat.device.tilt()
    seat.device.press(OWN.rearm_button)
    seat.ask()
    assert acts == [1]


def test_a_re_arm_that_reads_events_leaves_their_order():
    seat = Seat()
    seat.ask()
    seat.joystick._rearm = seat.ask
    device, dead_man = seat.device, OWN.dead_man_button
    said = [(OWN.rearm_button, 1), (dead_man, 1)], [(dead_man, 0)]
    batches = [[Event(joystick.EV_KEY, *each) for each in batch] for batch in said]
    device.read = lambda: batches.pop(0) if batches else FakeDevice.read(device)
    seat.ask()
    assert not seat.joystick._held


def test_a_button_that_nobody_saw_pressed_takes_control():
    """It is held while events are lost; pressed again, it drives."""
    seat = Seat()
    assert seat.ask() is None
    seat.device.held = [OWN.dead_man_button]
    seat.device.said = [Event(joystick.EV_SYN, joystick.SYN_DROPPED, 0)]
    seat.device.tilt(ahead=1.0)
    assert not seat.ask().any()


def test_a_joystick_that_is_pulled_while_another_thread_reads_it_is_centred():
    class Pulled(dict):
        def get(self, axis):
            seat.joystick._release()
            return super().get(axis)

    seat = Seat()
    seat.device.tilt(ahead=1.0)
    seat.ask()
    seat.joystick._axes = Pulled(seat.joystick._axes)
    assert not any(seat.joystick.stick(0.0)[0])


def test_whatever_an_opener_raises_is_a_lost_connection():
    device = Reconnecting(Mock(side_effect=termios.error(5, "gone")))
    assert device.get(10.0) is None
    assert "gone" in device.error


def test_a_hand_goes_before_the_policy(host):
    """It re-arms the chair at reset, takes it over while the laser is silent, and hands it back."""
    hosted = host(box(50.0))
    chair, hosted.minds = hosted.chair, False
    seat = Seat(chair.rearm)
    chair.joystick = seat.joystick
    hosted.clock.call_every(
        lambda: seat.device.press(OWN.rearm_button) if chair.waiting_for else None, 0.2, "person"
    )
    chair.reset(None, 0)
    assert hosted.drive_for(12).halted == ""
    seat.device.press(OWN.dead_man_button)
    assert "joystick" in hosted.drive_for(8).halted
    assert abs(hosted.twin.motion.speed) < 0.02
    hosted.twin.laser.silent = True
    seat.device.tilt(ahead=1.0)
    assert hosted.drive_for(15).halted
    assert hosted.twin.motion.speed > 0.3
    hosted.twin.laser.silent = False
    seat.device.press(OWN.dead_man_button, 0)
    seat.device.press(OWN.release_button)
    assert hosted.drive_for(35).halted == ""
    assert hosted.twin.motion.speed == pytest.approx(0.4, abs=0.01)
