"""A technician's tools over the emulated boards: they find what is wrong, measure what is true."""

import dataclasses
import math

import numpy as np
import pytest

from tests.sim.worlds import box
from wheelchair_gym import InputError
from wheelchair_gym.envs.settings import env_settings
from wheelchair_gym.hardware.boards import parameters
from wheelchair_gym.hardware.boards.protocol import Command, Identify, Switch
from wheelchair_gym.hardware.tools.diagnostics import Diagnostics, Orientation, status_rows
from wheelchair_gym.perception.occupancy import fit_wall
from wheelchair_gym.sensors.settings import LaserSettings, SensorSettings, UltrasonicSettings


@pytest.fixture
def hosted(host):
    return host()


@pytest.fixture
def checker(hosted):
    hosted.clock.guards.clear()  # nobody else sends
    return Diagnostics(hosted.chair.senses, hosted.clock, hosted.chair.parameters)


def bad(findings):
    return {f"{one.part}: {one.what}" for one in findings if not one.good}


def test_a_whole_chair_is_found_whole(hosted, checker):
    """The emergency stop, too, which a person presses and lets go when asked."""

    def person(what):
        pressed = what.startswith("press")
        hosted.twin.faults.switches = Switch.STOP_PRESSED if pressed else Switch(0)

    findings = checker.run(person)
    assert bad(findings) == bad(checker.run()) == set()  # also while the stop is latched
    parts = {one.part for one in findings}
    assert {"drive board", "range board", "laser", "battery", "emergency stop"} <= parts
    assert {f"ultrasonic {k}" for k in range(8)} <= parts
    rates = {one.part: float(one.found.split()[0]) for one in findings if one.what == "rate"}
    assert rates == pytest.approx({"drive board": 50.0, "range board": 16.7, "laser": 40.0}, abs=1)


def lose_commands(link, answered=3):
    """Drop the commands of a link after the first ones."""
    send, left = link.send, [None] * answered
    link.send = lambda message: (
        send(message) if not isinstance(message, Command) or (left and not left.pop()) else 999
    )


BROKEN = {
    "deaf": (lambda h: lose_commands(h.chair.senses.drive), "drive board: answer to a command"),
    "cable": (lambda h: setattr(h.drive, "plugged", False), "drive board: line"),
    "laser": (lambda h: setattr(h.twin.laser, "plugged", False), "laser: line"),
    "range": (lambda h: setattr(h.range, "plugged", False), "range board: line"),
    "sonar": (lambda h: h.twin.faults.silent_ultrasonics.add(5), "ultrasonic 5: range"),
    "strip": (lambda h: setattr(h.twin.faults, "switches", Switch.LEFT), "switches: pressed"),
    "battery": (lambda h: setattr(h.twin.faults, "battery", 28.0), "battery: voltage"),
    "noise": (lambda h: setattr(h.drive.noise, "corrupt", 0.02), "both boards: frames refused"),
}


@pytest.mark.parametrize("name", BROKEN)
def test_what_is_broken_is_named(hosted, checker, name):
    strike, what = BROKEN[name]
    strike(hosted)
    found = bad(checker.run())
    assert what in found
    if name not in ("noise", "battery"):
        assert len(found) == 1


def test_an_emergency_stop_that_is_not_wired_is_found(checker):
    found = checker.run(lambda what: None, patience=0.5)
    assert bad(found) == {"emergency stop: second contact"}


class Helper:
    """A person who holds a hand or a wall where asked, before a chair that stands in a room."""

    def __init__(self, host, model="thesis", **real):
        sensors = env_settings(None, model=model, noise=False).sensors
        self.hosted = host(sensors=dataclasses.replace(sensors, **real))
        self.hosted.clock.guards.clear()
        self.senses, self.asked = self.hosted.chair.senses, []
        self.senses.sensors = sensors  # what the config says

    def hold(self, what):
        self.asked.append(what)
        wall, (x, y) = (), (9.0, 9.0)
        if "ultrasonic" in what:
            one = self.senses.sensors.ultrasonic.mounted[int(what.split("ultrasonic ")[1][0])]
            x, y = one.x + 0.3 * math.cos(one.yaw), one.y + 0.3 * math.sin(one.yaw)
        elif what.startswith("hold"):
            x, y = -0.3 if "rear" in what else 0.7, 0.61 if "left of" in what else -0.61
        elif what.startswith("stand"):
            wall = (1.2, -1.0, 1.2, 1.0)
        self.hosted.twin.reset(box(3.0, walls=wall, discs=(x, y, 0.04)), 0)

    def found(self):
        senses, clock, footprint = self.senses, self.hosted.clock, self.hosted.chair.chair.footprint
        assert senses.wait_for(
            clock, lambda: all(map(math.isfinite, senses.ages(clock.now()).values())), 3.0
        )
        found = Orientation(senses, clock, footprint, self.hold, 1.6).run()
        rangers = senses.sensors.ultrasonic.mounted
        assert len(found) == len(rangers) + 2 * len(senses.lasers) + 1
        return {f"{one.part}: {one.what}": one.found for one in found if not one.good}


SIDES = {"laser: hand on the left", "laser: hand on the right"}


@pytest.mark.parametrize(
    ("model", "hands"), [("thesis", 10), ("rear", 12), ("rear_ultrasonics", 14)]
)
def test_hands_before_all_sensors_are_seen_where_they_are(host, model, hands):
    helper = Helper(host, model)
    assert helper.found() == {}
    assert len([what for what in helper.asked if what.startswith("hold")]) == hands


def test_what_stands_there_already_is_not_taken_for_a_hand(host):
    helper = Helper(host)
    helper.hold("hold a hand left of")
    helper.hold = lambda what: None  # nobody clears the place, or holds anything
    found = helper.found()
    assert found["laser: hand on the left"] == "not seen"
    assert len(found) == 11


MOUNTED = {
    "upside down": ({}, SIDES),
    "half a turn": ({"laser": LaserSettings(yaw=math.pi)}, SIDES | {"laser: wall ahead"}),
    "20 cm back": ({"laser": LaserSettings(x=0.46)}, SIDES | {"laser: wall ahead"}),
    "10 cm back": ({"laser": LaserSettings(x=0.56)}, {"laser: wall ahead"}),
    "8 deg": ({"laser": LaserSettings(yaw=math.radians(8.0))}, {"laser: wall ahead"}),
    "20 cm aside": ({"laser": LaserSettings(y=0.2)}, SIDES),
}


@pytest.mark.parametrize("name", MOUNTED)
def test_a_laser_that_looks_elsewhere_is_found(host, name):
    real, wanted = MOUNTED[name]
    helper = Helper(host, **real)
    if name == "upside down":
        laser, scan = helper.hosted.twin.laser, helper.hosted.twin.laser._scan
        laser._scan = lambda turn: np.ascontiguousarray(scan(turn)[::-1])
    found = helper.found()
    assert found.keys() == wanted
    if name in ("upside down", "half a turn"):
        assert "to the right; expected 0.70 m ahead, 0.61 m to the left" in found[min(SIDES)]


def test_exchanged_and_covered_ultrasonics_are_found(host):
    helper = Helper(host)
    faults, ping = helper.hosted.twin.faults, helper.hosted.twin.plant.ping
    helper.hosted.twin.plant.ping = lambda k: ping({2: 3, 3: 2}.get(k, k))
    faults.stuck_ultrasonics[6] = 2.5
    found = helper.found()
    assert found.keys() == {f"ultrasonic {k}: hand" for k in (2, 3, 6)}
    assert found["ultrasonic 2: hand"].startswith("heard by 3 at 0.2")
    assert found["ultrasonic 6: hand"] == "not heard"


def test_another_fan_and_other_parameters_are_found(host):
    hosted = host(sensors=SensorSettings(laser=LaserSettings(beams=541), noise=False))
    hosted.clock.guards.clear()
    ten = env_settings(None, model="rear_ultrasonics").sensors.ultrasonic
    hosted.chair.senses.sensors = SensorSettings(ultrasonic=ten)
    wanted = {**hosted.chair.parameters, "drive": {**hosted.chair.parameters["drive"], "kp": 33.0}}
    wanted["range"] = parameters.range_parameters(ten)
    findings = Diagnostics(hosted.chair.senses, hosted.clock, wanted).run()
    assert bad(findings) == {
        "laser: fan", "laser: beams with an echo", "drive board: parameters",
        "range board: parameters", "ultrasonic 8: range", "ultrasonic 9: range",
    }  # fmt: skip
    assert "the range board's n_rangers is 8; expected 10" in [one.found for one in findings]
    senses, clock = hosted.chair.senses, hosted.clock
    assert parameters.set_parameters(senses, clock, "drive", wanted["drive"]) == {}
    assert parameters.save_parameters(senses, clock, "drive")
    hosted.twin.drive.reset()  # switched off at once
    clock.wait(clock.now() + 0.5)
    senses.poll()
    table = senses.parameters["drive"]
    assert not table.reported
    assert senses.wait_for(clock, lambda: not table.mismatch({"kp": 33.0}), 1.0)
    before = clock.now()
    refused = parameters.set_parameters(senses, clock, "drive", {"kp": 1e9, "ki": 120.0})
    assert refused == {
        "kp": "the drive board's kp is 33; expected 1e+09, which it refuses: it takes 0 to 400"
    }
    assert clock.now() - before < 0.5  # it is not asked again and again
    clock.call_every(lambda: hosted.twin.drive.set_eeprom(b"\xff"), 0.005, "worn EEPROM")
    assert not parameters.save_parameters(senses, clock, "drive")
    assert not senses.identities["drive"].stored


def test_exchanged_ports_are_named_and_nothing_is_written(hosted, checker):
    senses, wanted = hosted.chair.senses, hosted.chair.parameters["drive"]
    senses.drive, senses.range = senses.range, senses.drive
    for board, line in (("drive", senses.drive), ("range", senses.range)):
        senses.parameters[board].link = line
    line, sent = senses.drive.send, []
    senses.drive.send = lambda message: (sent.append(message), line(message))[1]
    why = "the other board is at this port: exchange hardware.drive_port and hardware.range_port"
    (said,) = set(parameters.set_parameters(senses, hosted.clock, "drive", wanted).values())
    assert said == f"the drive board takes no parameters (twin://range: {why})"
    assert {type(message) for message in sent} <= {Identify}
    found = Diagnostics(senses, hosted.clock, hosted.chair.parameters).run()
    assert [one.found for one in found if "board" in one.part] == [
        f"twin://range: {why}", f"twin://drive: {why}"
    ]  # fmt: skip
    with pytest.raises(InputError, match=f"the drive board is silent .twin://range: {why}"):
        hosted.chair.reset(None, 0)


def test_rates_are_those_of_the_settings_and_of_the_laser(host):
    rangers = UltrasonicSettings(interval=0.5)
    hosted = host(sensors=SensorSettings(ultrasonic=rangers, noise=False))
    hosted.clock.guards.clear()
    senses = hosted.chair.senses
    checker = Diagnostics(senses, hosted.clock, hosted.chair.parameters)
    assert bad(checker.run()) == set()
    laser = senses.lasers[0]
    laser.specs = laser.specs._replace(rpm=600)
    (rate,) = (one.found for one in checker.run() if not one.good)
    assert rate == "40.0 Hz, expected 10.0"


def test_all_is_told_live(hosted, checker):
    checker.run()
    rows = dict(status_rows(hosted.chair.senses, hosted.clock.now()))
    assert "STOPPED" in rows["mode"]
    assert rows["battery"].endswith("V")
    assert "m at" in rows["nearest echo"]


def seen(x, turned, noise=0.015, seed=0, gone=0.0):
    """Ten scans' echoes of a wall x ahead of the axle that is turned, some from something else."""
    rng = np.random.default_rng(seed)
    aside = np.tile(np.linspace(-0.2, 0.2, 97), 10)
    far = (x * math.cos(turned) - 0.66 * math.cos(turned)) / np.cos(aside - turned)
    far = far + rng.normal(0.0, noise, len(far))
    far[rng.random(len(far)) < gone] *= 0.5
    return np.stack([0.66 + far * np.cos(aside), far * np.sin(aside)], axis=1)


@pytest.mark.parametrize("turned", [-0.3, 0.0, 0.2])
def test_a_wall_is_where_it_is(turned):
    """To a millimetre or two in the laser's noise, with a chair leg before the wall."""
    wall = fit_wall(seen(3.0, turned, gone=0.1))
    assert wall.distance == pytest.approx(3.0 * math.cos(turned), abs=5e-3)
    assert wall.bearing == pytest.approx(turned, abs=0.01)


def test_what_is_no_wall_is_refused():
    with pytest.raises(ValueError, match="no wall ahead"):
        fit_wall(np.empty((0, 2)))
    with pytest.raises(ValueError, match="no flat wall"):
        fit_wall(seen(2.0, 0.0, noise=0.2))
    with pytest.raises(ValueError, match="no flat wall"):
        fit_wall(np.concatenate([seen(1.0, 0.0), seen(5.0, 0.0)]))
    with pytest.raises(ValueError, match="turned by"):
        fit_wall(seen(2.0, 0.8, noise=0.0))
