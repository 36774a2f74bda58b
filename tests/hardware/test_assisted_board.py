"""The drive board while a person drives by its joystick and the host helps: the hand goes first."""

from __future__ import annotations

import pytest

from tests.hardware.bench import Bench, ibus
from wheelchair_gym.hardware.boards.protocol import CommandFlag, Fault, JoystickFlag, Mode

STEP = 0.005  # s
HELPED = CommandFlag.ASSISTED
HELD = JoystickFlag.FRESH | JoystickFlag.HELD


@pytest.fixture
def bench(firmware):
    return Bench(firmware)


def hand(bench, seconds, ahead=0.0, held=True, manual=False, host=None):
    """Time with a hand at the joystick; the host asks for a speed, or is silent."""
    bench.target = None if host is None else (host, 0.0, HELPED)
    for _ in range(round(seconds / 0.01)):
        bench.stick(ibus(ahead, 0.0, manual, held))
        bench.run(0.01)


def fastest(bench):
    return max(map(abs, bench.speeds))


def driving(bench):
    """The host drives at 0.5 m/s while the stick is pushed."""
    bench.start()
    hand(bench, 0.1, host=0.0)
    hand(bench, 3.0, ahead=1.0, host=0.5)
    assert bench.speeds[0] == pytest.approx(0.5, abs=0.01)
    assert bench.odometry().mode == Mode.HOST
    return bench


STOPS = {
    "let go": {"ahead": 1.0, "held": False, "host": 0.5},
    "centred": {"host": 0.5},
    "manual": {"ahead": 1.0, "manual": True, "host": 0.5},
    "host silent": {"ahead": 1.0},
}


@pytest.mark.parametrize("name", STOPS)
def test_whatever_the_host_asks_for_the_hand_stops_it(bench, name):
    driving(bench)
    hand(bench, 0.02, **STOPS[name])
    before = bench.odometry().v
    hand(bench, 0.3, **STOPS[name])
    assert bench.odometry().v < before - 0.01
    hand(bench, 1.7, **STOPS[name])
    assert fastest(bench) < 0.01


def test_a_radio_that_falls_silent_stops_it(bench):
    driving(bench)
    bench.run(0.25 + 0.5 / 1.5 + 0.1)  # the host still asks for 0.5 m/s
    assert fastest(bench) < 0.01
    bench.run(1.0)
    assert fastest(bench) < 0.01


@pytest.mark.parametrize("stop", ["let go", "manual"])
def test_it_drives_again_from_the_centre_only(bench, stop):
    driving(bench)
    hand(bench, 0.02, **STOPS[stop])
    hand(bench, 2.0, ahead=1.0, host=0.5)
    assert fastest(bench) < 0.01
    assert bench.joystick().flags == HELD | JoystickFlag.MUST_CENTRE
    hand(bench, 0.05, host=0.0)
    assert bench.joystick().flags == HELD
    hand(bench, 2.0, ahead=1.0, host=0.5)
    assert bench.speeds[0] == pytest.approx(0.5, abs=0.01)


def test_a_person_goes_on_by_hand_after_the_host_has_died(bench):
    driving(bench)
    hand(bench, 2.5, ahead=1.0)
    assert bench.odometry().faults == Fault.LINK
    hand(bench, 0.1, manual=True, held=False)
    hand(bench, 0.1, manual=True)
    assert bench.odometry().mode == Mode.MANUAL
    hand(bench, 3.0, ahead=1.0, manual=True)
    assert bench.speeds[0] == pytest.approx(0.4, abs=0.01)


def test_the_host_is_told_of_the_stick(bench):
    bench.start()
    bench.stick(ibus(0.5, -0.25, held=True))
    told = bench.joystick()
    # Past the dead zone of 25 of 500.
    assert told.forward == pytest.approx(225 / 475, abs=1e-4)
    assert told.left == pytest.approx(-100 / 475, abs=1e-4)
    assert (told.flags, told.age) == (HELD, 0.0)
    bench.run(0.5)
    assert not bench.joystick().flags & JoystickFlag.FRESH
    assert bench.joystick().age == 0.255
