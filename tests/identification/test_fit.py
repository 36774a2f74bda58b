"""Laws of the fit: hidden chairs are found, and what a log does not show is said, never guessed."""

import dataclasses
import json
import math

import numpy as np
import pytest

from agents.cli import main
from tests.benchmarks import identification
from tests.benchmarks.identification import LIMITS
from tests.conftest import ROOT, refusal
from tests.identification.drives import CHAIR, SENSORS, drive, room, truth
from wheelchair_gym.base.errors import InputError
from wheelchair_gym.base.settings import load
from wheelchair_gym.identification.fit import MEASURED, fit, settings_of
from wheelchair_gym.identification.logs import Drive
from wheelchair_gym.identification.predict import HORIZONS, predict
from wheelchair_gym.sensors.settings import SensorSettings
from wheelchair_gym.sim.randomization import JointRandomization
from wheelchair_gym.sim.settings import ChairSettings

HIDDEN = {
    "delay": 0.04, "laser.sigma": 0.012, "laser.x_error": 0.03, "laser.y_error": -0.04,
    "laser.yaw_error": 0.04, "laser.offset_error": 0.025, "odometry.scale_error": 0.008,
    "odometry.diameter_error": -0.015, "odometry.track_error": 0.025, "body.mass": 190.0,
    "motor.gain": 0.85, "slope": math.radians(1.5), "downhill": 2.0, "command_delay": 0.06,
}  # fmt: skip
RELATIVE = {**identification.RELATIVE, "torque_constant": 0.02}


@pytest.fixture(scope="module")
def driven():
    return drive(HIDDEN)


@pytest.fixture(scope="module")
def found(driven):
    return fit([("drive", driven.log)], CHAIR, SENSORS)


def values(of):
    return {one.name: one.value for one in of.findings}


def test_a_hidden_chair_is_found(found):
    told, true = values(found), truth(HIDDEN)
    off = {name: abs(told[name] - true[name]) for name in true}
    assert {name: off[name] for name, most in LIMITS.items() if off[name] > most} == {}
    far = {name: off[name] / true[name] for name in RELATIVE}
    assert {name: far[name] for name, most in RELATIVE.items() if far[name] > most} == {}
    status = {one.name: one.status for one in found.findings}
    assert {status[name] for name in (*LIMITS, *RELATIVE)} == {"measured"}
    assert (status["gain"], status["friction"]) == ("combination only", "not seen")
    assert told["friction"] is None
    assert len(found.notes) == 1
    assert "slope of 1.5 deg, falling 115 deg" in found.notes[0]


def test_the_settings_that_are_written_are_the_chair(found):
    files = json.loads(json.dumps(settings_of(found)))
    chair = load(ChairSettings, files["chair.json"], "chair.json")
    sensors = load(SensorSettings, files["sensors.json"], "sensors.json")
    joint = load(JointRandomization, files["ranges.json"], "ranges.json")
    assert (chair, sensors, joint) == (found.chair, found.sensors, found.joint)
    told = values(found)
    assert chair.drive.counts_per_metre == pytest.approx(4346.0 / told["scale"])
    assert chair.motor.believed_constant == CHAIR.motor.torque_constant
    assert sensors.laser.offset == told["offset"]
    assert joint.mean == (0.0,) * 6
    dataclasses.replace(chair, joint=joint)  # they go together


def test_with_the_mass_on_scales_the_gain_is_measured(driven):
    known = fit([("drive", driven.log)], CHAIR, SENSORS, mass=190.0)
    gain = next(one for one in known.findings if one.name == "gain")
    assert gain.status == "measured"
    assert gain.value == pytest.approx(0.85, rel=0.02)


def test_a_log_that_is_mirrored_gives_the_mirrored_chair(driven, found):
    log = driven.log
    mirrored = log._replace(
        travel=log.travel[:, ::-1], volts=log.volts[:, ::-1], ranges=log.ranges[:, ::-1].copy()
    )
    told, plain = values(fit([("drive", mirrored)], CHAIR, SENSORS)), values(found)
    spread = {one.name: (one.high - one.low) / 4.0 for one in found.findings if one.value}
    for name in LIMITS:
        wanted = -plain[name] if name in ("y", "yaw") else plain[name]
        wanted = 1.0 / wanted if name == "wheel_ratio" else wanted
        assert told[name] == pytest.approx(wanted, abs=2.0 * spread[name]), name


def test_another_start_gives_the_same_chair(found):
    other = fit([("drive", drive(HIDDEN, room((0.6, -0.7, 1.57)), 7).log)], CHAIR, SENSORS)
    assert values(other)["friction"] is None
    spread = {one.name: (one.high - one.low) / 4.0 for one in found.findings if one.value}
    plain = values(found)
    for name in LIMITS:
        assert values(other)[name] == pytest.approx(plain[name], abs=5.0 * spread[name]), name


def test_a_level_floor_is_not_taken_for_a_slope():
    found = fit([("drive", drive({"odometry.scale_error": -0.005}).log)], CHAIR, SENSORS)
    assert found.notes == ()
    assert values(found)["scale"] == pytest.approx(0.995, abs=1e-3)


def test_what_is_not_seen_keeps_the_value_of_the_config(driven, monkeypatch):
    for name in ("y", "offset", "wheel_ratio"):
        monkeypatch.setitem(MEASURED, name, 1e-9)
    config = dataclasses.replace(SENSORS, laser=dataclasses.replace(SENSORS.laser, bias=0.004))
    told = fit([("drive", driven.log)], CHAIR, config)
    assert values(told)["y"] is values(told)["offset"] is None
    laser, before = told.sensors.laser, config.laser
    assert (laser.y, laser.offset, laser.bias) == (before.y, before.offset, before.bias)
    assert told.chair.drive.wheel_ratio == CHAIR.drive.wheel_ratio
    assert laser.x == values(told)["x"]


def test_wheels_that_count_in_other_units_give_the_same_chair(driven, found):
    log = driven.log._replace(travel=1.02 * driven.log.travel)
    told, plain = values(fit([("drive", log)], CHAIR, SENSORS)), values(found)
    assert told["scale"] == pytest.approx(plain["scale"] / 1.02, abs=2e-4)
    for name in ("wheel_ratio", "track", "x", "y", "yaw", "offset"):
        assert told[name] == pytest.approx(plain[name], abs=LIMITS[name]), name


@pytest.fixture(scope="module")
def held():
    level = {name: value for name, value in HIDDEN.items() if name != "slope"}
    log = drive(level, room((0.6, -0.7, 1.57)), 7).log
    return Drive("held", log, CHAIR, SENSORS)


def test_a_fitted_simulation_predicts_another_drive(held, found):
    """Also where the clock of the log began long before, and at another rate of the boards."""
    log, after = held.log, (found.chair, found.sensors)
    later = {name: getattr(log, name) + 100.0 for name in ("stamps", "scan_stamps")}
    later["commands"] = log.commands + np.array([100.0, 0.0, 0.0])
    before, fitted = predict(held, [(CHAIR, SENSORS), after])
    assert [one.seconds for one in fitted] == list(HORIZONS)
    assert fitted[-1].position[1] < 0.005
    assert before[-1].position[1] > 10.0 * fitted[-1].position[1]
    for key in ("heading", "scan", "volts"):
        assert getattr(before[-1], key)[1] > 1.5 * getattr(fitted[-1], key)[1], key
    again = predict(held._replace(log=log._replace(**later)), [after])[0][-1]
    assert again.position == pytest.approx(fitted[-1].position, abs=5e-4)
    assert again.windows == pytest.approx(fitted[-1].windows, abs=1)
    for rate in (60.0, 200.0):
        motor = dataclasses.replace(CHAIR.motor, control_rate=rate)
        faster = held._replace(chair=dataclasses.replace(CHAIR, motor=motor))
        assert predict(faster, [after])[0][-1].position[1] < 0.02, rate


def test_a_log_without_commands_is_not_simulated(held):
    log = held.log

    def predicted(**changes):
        return predict(held._replace(log=log._replace(**changes)), [(CHAIR, SENSORS)])[0]

    with pytest.raises(InputError, match="held: expected the commands of the drive"):
        predicted(commands=np.empty((0, 3)))
    with pytest.raises(InputError, match="held: expected scans of 10 s or more"):
        predicted(scan_stamps=log.scan_stamps[:90], ranges=log.ranges[:90])
    silent = predicted(scan_stamps=log.scan_stamps[:-40], ranges=log.ranges[:-40])
    assert silent[-1].windows > 200


def test_a_wall_at_a_measured_distance_shows_the_offset(held):
    log, distance = held.log, 3.1 + 0.7 - truth(HIDDEN)["x"]
    known = fit([("held", log)], CHAIR, SENSORS, wall=distance)
    offset = next(one for one in known.findings if one.name == "offset")
    assert offset.value == pytest.approx(0.025, abs=3e-3)
    assert offset.high - offset.low < 6e-3
    with pytest.raises(InputError, match=r"held: --wall 2: the wall ahead is 3\.1"):
        fit([("held", log)], CHAIR, SENSORS, wall=2.0)
    aside = log._replace(ranges=np.full_like(log.ranges, np.inf))
    with pytest.raises(InputError, match="sees no wall ahead"):
        fit([("held", aside)], CHAIR, SENSORS, wall=2.0)


def test_each_further_scanner_is_found():
    """The errors of mount and offset that are drawn are alike for all scanners."""
    content = json.loads((ROOT / "configs" / "chairs" / "rear.json").read_text())["sensors"]
    rear = load(SensorSettings, content, "rear.json")
    quiet = dataclasses.replace(rear.more_lasers[0], bias=0.0)
    sensors = dataclasses.replace(SENSORS, more_lasers=(quiet,))
    told = fit([("drive", drive(HIDDEN, sensors=sensors).log)], CHAIR, sensors)
    second = told.sensors.more_lasers[0]
    assert (second.x, second.y) == pytest.approx((quiet.x + 0.03, -0.04), abs=3e-3)
    assert second.yaw == pytest.approx(quiet.yaw + 0.04, abs=LIMITS["yaw"])
    assert second.offset == pytest.approx(0.025, abs=LIMITS["offset"])
    status = {one.name: one.status for one in told.findings}
    assert status["x of laser 1"] == status["delay of laser 1"] == "measured"
    assert "scale of laser 1" not in status


SHORT = {
    "stands": (((0.0, 0.0, 12.0),), "a turn to the left of 3 rad .it has 0.0., a turn to the"),
    "one way": (((0.3, 0.5, 25.0),), "lacks a turn to the right of 3 rad"),
    "on the spot": (((0.0, 0.6, 8.0), (0.0, -0.6, 8.0)), "lacks a drive of 3 m"),
    "short": (((0.4, 0.0, 4.0),), "40 scans|.it has 41."),
}


@pytest.mark.parametrize("name", SHORT)
def test_a_log_that_lacks_something_is_refused_with_what(name):
    program, message = SHORT[name]
    log = drive({}, program=program).log
    with pytest.raises(InputError, match=message):
        fit([("drive", log)], CHAIR, SENSORS)


def test_without_voltages_motors_are_not_seen(driven):
    log = driven.log._replace(volts=np.full_like(driven.log.volts, np.nan))
    found = fit([("bag", log)], CHAIR, SENSORS)
    told = values(found)
    assert told["gain"] is told["torque_constant"] is None
    assert "motors not seen: duty and voltage" in found.notes[0]
    assert found.chair.motor == CHAIR.motor
    assert told["track"] == pytest.approx(truth(HIDDEN)["track"], abs=1e-3)


def test_a_short_recording_is_refused_by_the_command(tmp_path, capsys):
    file = tmp_path / "drive.mcap"
    words = ["simulate", "--scene", "empty", "--policy", "random", "--record", str(file)]
    assert main(words) in (0, 1)
    capsys.readouterr()
    assert "drive.mcap, episode 0 lacks" in refusal(["fit", str(file)], capsys)
