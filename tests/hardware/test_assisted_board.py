"""The drive board while a person drives by its joystick, with or without the host's help."""

import numpy as np
import pytest

from tests.hardware.bench import Bench, ibus
from wheelchair_gym.hardware.boards import protocol

STEP = 0.005  # s
HELPED = protocol.CommandFlag.ASSISTED
HELD = protocol.JoystickFlag.FRESH | protocol.JoystickFlag.HELD


def hand(bench, seconds, ahead=0.0, held=True, manual=False, host=None):
    """Time with a hand at the joystick; the host asks for a speed, or is silent."""
    bench.target = None if host is None else (host, 0.0, HELPED)
    bench.by_hand(seconds, ahead=ahead, manual=manual, held=held)


def driving(bench):
    """The host drives at 0.5 m/s while the stick is pushed."""
    bench.start()
    hand(bench, 0.1, host=0.0)
    hand(bench, 3.0, ahead=1.0, host=0.5)
    assert bench.speeds[0] == pytest.approx(0.5, abs=0.01)
    assert bench.odometry().mode == protocol.Mode.HOST


STOPS = {"centred": {"host": 0.5}, "host silent": {"ahead": 1.0}}


@pytest.mark.parametrize("name", STOPS)
def test_the_hand_stops_it_at_every_command_of_the_host(bench, name):
    driving(bench)
    hand(bench, 0.02, **STOPS[name])
    before = bench.odometry().v
    hand(bench, 0.3, **STOPS[name])
    assert bench.odometry().v < before - 0.01
    hand(bench, 1.7, **STOPS[name])
    assert max(map(abs, bench.speeds)) < 0.01


class History:
    """A model of the interlock, by the frames of the stick since the last break."""

    def __init__(self):
        self.frames, self.heard, self.manual, self.freed = [], -1.0, False, 0.0

    def tell(self, now, ahead, held, manual):
        if not held or manual != self.manual or now - self.heard >= 0.2:
            self.frames = []
        self.heard, self.manual = now, manual
        self.frames += [(held, ahead == 0.0)]

    def free(self, now):
        free = now - self.heard < 0.2 and (True, True) in self.frames
        self.freed = now if free else self.freed
        return free


@pytest.mark.parametrize("manual", [True, False])
def test_nothing_moves_before_the_centre_was_seen_with_the_switch_held(firmware, manual):
    """The interlock, against its model: 40 random histories of stick, switches and radio."""
    moved, stood = 0, 0
    for seed in range(40):
        rng, bench, model = np.random.default_rng(seed), Bench(firmware), History()
        bench.start(seconds=0.02).target = (0.5, 0.0, HELPED)
        for _ in range(15):
            ahead, held = float(rng.choice((0.0, 0.0, 0.6, -1.0))), bool(rng.random() < 0.7)
            heard, by_hand = rng.random() < 0.9, manual != bool(rng.random() < 0.1)
            if rng.random() < 0.1:  # a stop, and a host that re-arms at any stick position
                bench.switches, bench.target = protocol.Switch.STOP_PRESSED, (0.0, 0.0, HELPED)
                hold(bench, model, 0.6, heard, ahead, held, by_hand)
                bench.switches = 0
                hold(bench, model, 0.02, heard, ahead, held, by_hand)
                faults = bench.odometry().faults
                if bench.rearm() == protocol.Status.DONE and faults:
                    model.frames = []
                bench.target = (0.5, 0.0, HELPED)
            for free, fast in hold(
                bench, model, rng.uniform(0.01, 0.5), heard, ahead, held, by_hand
            ):
                moved += free and fast
                stood += not free and ahead != 0.0 and held
    assert min(moved, stood) > 1000, (moved, stood)


def hold(bench, model, seconds, heard, ahead, held, manual):
    """Hold a stick so; whether it may move the chair, and whether it does, each 10 ms."""
    seen = []
    for _ in range(round(seconds / 0.01)):
        before = bench.odometry()
        if heard:
            model.tell(bench.now * 1e-3, ahead, held, manual)
            bench.stick(ibus(ahead, 0.0, manual, held))
        for _ in range(2):
            bench.run(STEP)
            now, free = bench.odometry(), model.free(bench.now * 1e-3)
            assert free or abs(now.v) <= abs(before.v), (bench.now, before.v, now.v)
            assert now.v == 0.0 or bench.now * 1e-3 - model.freed < 0.5
            if before.faults and not now.faults:  # re-armed by the stick
                model.frames = []
            before = now
        seen.append((free, now.v != 0.0))
    return seen


def test_a_person_goes_on_by_hand_after_the_host_has_died(bench):
    driving(bench)
    hand(bench, 2.5, ahead=1.0)
    assert bench.odometry().faults == protocol.Fault.LINK
    hand(bench, 0.1, manual=True, held=False)
    hand(bench, 0.2, ahead=1.0, manual=True)
    assert bench.odometry().mode == protocol.Mode.STOPPED  # not re-armed with the stick pushed
    hand(bench, 0.1, manual=True, held=False)
    hand(bench, 0.1, manual=True)
    assert bench.odometry().mode == protocol.Mode.MANUAL
    hand(bench, 3.0, ahead=1.0, manual=True)
    assert bench.speeds[0] == pytest.approx(0.4, abs=0.01)


def test_the_host_is_told_of_the_stick(bench):
    bench.start()
    bench.stick(ibus(0.5, -0.25, held=True))
    told = bench.joystick()
    # Past the dead zone of 25 of 500.
    assert told.forward == pytest.approx(225 / 475, abs=1e-4)
    assert told.left == pytest.approx(-100 / 475, abs=1e-4)
    assert (told.flags, told.age) == (HELD | protocol.JoystickFlag.MUST_CENTRE, 0.0)
    bench.stick(ibus(held=True))
    assert bench.joystick().flags == HELD
    bench.run(0.5)
    assert not bench.joystick().flags & protocol.JoystickFlag.FRESH
    assert bench.joystick().age == 0.255
