"""The range board's mind, run natively: who fires when, what an echo means, how old it is."""

import ctypes
import itertools

import pytest

from tests.hardware.native import Part
from wheelchair_gym.hardware.boards.parameters import RANGE_PARAMETERS
from wheelchair_gym.hardware.boards.protocol import Range, Ranges, RangeStatus
from wheelchair_gym.sensors.settings import Ultrasonic, UltrasonicSettings

SOUND = 343.0  # m/s
NARROW, WIDE = range(4), range(4, 10)


class Ranging(Part):
    """Host build of the firmware: each millisecond the firing sensor hears the given flight."""

    NEW = "ranging_new"

    def __init__(self, native):
        super().__init__(native)
        self.fired = []

    def mount(self, rangers):
        """Set the number of rangers; the parameters come first in its state."""
        values = ctypes.c_float * len(RANGE_PARAMETERS)
        values.from_address(self.pointer.value)[RANGE_PARAMETERS.index("n_rangers")] = rangers

    def run(self, milliseconds, flight):
        for _ in range(milliseconds):
            who = self.library.ranging_run(self.pointer, self.now, int(flight))
            if who >= 0:
                self.fired.append((self.now, who))
            self.now += 1

    def tell(self) -> Ranges:
        return self.told(self.library.ranging_say)


@pytest.fixture
def ranging(firmware):
    return Ranging(firmware)


def flight(metres):
    return round(2e6 * metres / SOUND)


@pytest.mark.parametrize("mounted", [UltrasonicSettings().mounted, (Ultrasonic(),) * 10])
def test_one_fires_at_a_time_in_the_order_of_the_simulated_chair(ranging, mounted):
    order = UltrasonicSettings(mounted).firing_order
    ranging.mount(len(order))
    ranging.run(1300, flight(1.0))
    times, who = zip(*ranging.fired, strict=True)
    assert who[: 2 * len(order)] == 2 * order
    assert {b - a for a, b in itertools.pairwise(times)} == {60}
    if len(order) == 8:  # neither neighbours nor the same model follow each other
        assert all((a in NARROW) != (b in NARROW) for a, b in itertools.pairwise(who))
    assert {one.status for one in ranging.tell().ranges[: len(order)]} == {RangeStatus.ECHO}


@pytest.mark.parametrize(
    ("metres", "narrow", "wide"),
    [
        (1.0, 1.0, 1.0),
        (3.999, 3.999, 3.999),
        (4.01, None, 4.01),
        (5.99, None, 5.99),
        (6.01, None, None),
        (0.01, 0.02, 0.03),
        (0.0, None, None),
        (0.019 * SOUND, None, None),  # 38 ms
    ],
)
def test_a_flight_becomes_a_range(ranging, metres, narrow, wide):
    ranging.mount(10)
    ranging.run(700, flight(metres))
    for which, told in enumerate(ranging.tell().ranges):
        expected = narrow if which in NARROW else wide
        if expected is None:
            assert (told.range, told.status) == (65.535, RangeStatus.NO_ECHO)
        else:
            assert (told.range, told.status) == (
                pytest.approx(expected, abs=1e-3),
                RangeStatus.ECHO,
            )


def test_what_never_fired_and_what_is_silent_is_said_so(ranging):
    ranging.run(1, flight(1.0))
    told = ranging.tell().ranges
    assert [one.status for one in told] == [RangeStatus.ECHO] + 9 * [RangeStatus.UNTRIED]
    assert told[1].age == 65.535
    ranging.run(600, -1)
    told = ranging.tell().ranges
    assert {one.status for one in told[:8]} == {RangeStatus.SILENT}
    assert all(one.age <= 0.48 for one in told[:8])
    assert told[8:] == 2 * (Range(0.0, 65.535, RangeStatus.UNTRIED),)  # the board has eight
