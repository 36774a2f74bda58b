"""Laws of a joystick at the host, over devices that a test moves: held or standing."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pytest

from tests.hardware.hosted import Hosted
from tests.physics.worlds import box
from wheelchair_gym.config import InputError
from wheelchair_gym.hardware.connection import RETRY
from wheelchair_gym.hardware.joystick import (
    EV_ABS,
    EV_KEY,
    EV_SYN,
    SYN_DROPPED,
    Joystick,
    JoystickSettings,
)
from wheelchair_gym.kinematics import Limits

OWN = JoystickSettings(device="fake")
AHEAD = np.array([0.4, 0.0])


class Event(NamedTuple):
    type: int
    code: int
    value: int


class Info(NamedTuple):
    min: int
    max: int


class FakeDevice:
    def __init__(self):
        self.said, self.plugged = [], True

    def capabilities(self, absinfo):
        ranges = {0: (0, 255), 1: (-32768, 32767)}
        return {EV_ABS: [(code, Info(*ends)) for code, ends in ranges.items()]}

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
        self.said.append(Event(EV_KEY, code, value))

    def tilt(self, ahead=0.0, left=0.0):
        self.said.append(Event(EV_ABS, 1, round(-ahead * 32767)))
        self.said.append(Event(EV_ABS, 0, round(127.5 - left * 127.5)))


class Seat:
    """A joystick whose device can be pulled and plugged in again."""

    def __init__(self, rearm=lambda: None):
        self.device, self.there = FakeDevice(), True
        self.joystick = Joystick(OWN, rearm, self._open)

    def _open(self, own):
        if not self.there:
            raise OSError(2, "No such file or directory")
        self.device = FakeDevice()
        return self.device

    def ask(self, now=0.0):
        return self.joystick(now, Limits())


def test_it_drives_only_while_the_button_is_held():
    seat, limits = Seat(), Limits()
    assert seat.ask() is None
    seat.device.tilt(ahead=1.0)
    assert seat.ask() is None  # nobody holds the button
    seat.device.press(OWN.dead_man_button)
    np.testing.assert_allclose(seat.ask(), [OWN.speed_fraction * limits.forward, 0.0], atol=1e-3)
    seat.device.tilt(ahead=-1.0, left=1.0)
    want = [-OWN.speed_fraction * limits.backward, OWN.speed_fraction * limits.turn]
    np.testing.assert_allclose(seat.ask(), want, atol=1e-3)
    seat.device.tilt(ahead=0.5 * OWN.dead_zone)
    assert not seat.ask().any()
    seat.device.tilt(ahead=1.0)
    seat.device.press(OWN.dead_man_button, 2)  # repeated
    assert seat.ask().any()
    seat.device.press(OWN.dead_man_button, 0)
    assert not seat.ask().any()  # stands, and is still the person's
    seat.device.press(OWN.release_button)
    assert seat.ask() is None


def test_it_is_not_handed_back_while_the_button_is_held():
    seat = Seat()
    seat.ask()
    seat.device.press(OWN.dead_man_button)
    seat.device.press(OWN.release_button)
    assert seat.ask() is not None


@pytest.mark.parametrize("way", ["pulled", "dropped"])
def test_what_is_missed_stands(way):
    """Pulled, or events were lost: the chair stands until the button is pressed again."""
    seat = Seat()
    seat.ask()
    seat.device.tilt(ahead=1.0)
    seat.device.press(OWN.dead_man_button)
    assert seat.ask().any()
    if way == "dropped":
        seat.device.said.append(Event(EV_SYN, SYN_DROPPED, 0))
        assert not seat.ask().any()
    else:
        seat.device.plugged = seat.there = False
        assert not seat.ask(1.0).any()
        assert "No such" in seat.joystick.error
        assert not seat.ask(1.0 + RETRY).any()
        seat.there = True
        assert not seat.ask(1.0 + 2.0 * RETRY).any()
        assert seat.joystick.error == ""
    seat.device.tilt(ahead=1.0)
    assert not seat.ask(2.0).any()
    seat.device.press(OWN.dead_man_button)
    assert seat.ask(2.0).any()


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


@pytest.mark.parametrize("button", ["release_button", "assist_button"])
def test_buttons_must_differ(button):
    with pytest.raises(InputError, match="must differ"):
        JoystickSettings(**{button: OWN.dead_man_button})


def test_a_hand_goes_before_the_policy():
    """It re-arms the chair at reset, takes it over while the laser is silent, and hands it back."""
    pytest.importorskip("serial", reason="pip install 'wheelchair_gym[hardware]'")
    hosted = Hosted(box(50.0))
    chair, hosted.minds = hosted.chair, False
    seat = Seat(chair.rearm)
    chair.joystick = seat.joystick
    hosted.clock.call_every(
        lambda: seat.device.press(OWN.rearm_button) if chair.waiting_for else None, 0.2, "person"
    )
    chair.reset(None, 0)
    for _ in range(12):
        reading = chair.drive(AHEAD)
    assert reading.halted == ""
    seat.device.press(OWN.dead_man_button)
    for _ in range(8):
        reading = chair.drive(AHEAD)
    assert "joystick" in reading.halted
    assert abs(hosted.twin.motion.speed) < 0.02
    hosted.twin.laser.silent = True
    seat.device.tilt(ahead=1.0)
    for _ in range(15):
        reading = chair.drive(AHEAD)
    assert reading.halted
    assert hosted.twin.motion.speed > 0.3
    hosted.twin.laser.silent = False
    seat.device.press(OWN.dead_man_button, 0)
    seat.device.press(OWN.release_button)
    for _ in range(35):
        reading = chair.drive(AHEAD)
    assert reading.halted == ""
    assert hosted.twin.motion.speed == pytest.approx(0.4, abs=0.01)
    hosted.close()
