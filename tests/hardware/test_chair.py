"""Laws of the hardware chair over the emulated boards: paced, honest, and it always stops."""

import dataclasses
from unittest.mock import Mock

import numpy as np
import pytest

from tests.hardware.bench import ibus
from tests.hardware.hosted import AHEAD
from tests.sim.worlds import box, drives, step
from wheelchair_gym import InputError
from wheelchair_gym.envs.settings import env_settings
from wheelchair_gym.geometry.kinematics import DriveGeometry
from wheelchair_gym.geometry.outline import footprint_clearance
from wheelchair_gym.hardware.boards.protocol import Fault, Mode, Odometry, Rearm, Switch
from wheelchair_gym.hardware.boards.senses import WheelOdometry
from wheelchair_gym.hardware.registry import make_chair
from wheelchair_gym.hardware.tools.diagnostics import Diagnostics
from wheelchair_gym.hardware.twin.lockstep import IBUS_BAUD
from wheelchair_gym.safety import Shield
from wheelchair_gym.sensors.settings import LaserSettings, SensorSettings, UltrasonicSettings
from wheelchair_gym.sim.chair import SimulatedChair
from wheelchair_gym.sim.settings import ChairSettings

serial = pytest.importorskip("serial", reason="pip install 'wheelchair_gym[hardware]'")

STILL = np.zeros(2)
PERIOD = 0.1
MIN_DECELERATION = 1.5  # m/s2


@pytest.fixture
def hosted(host):
    return host(box(50.0))


def test_the_guard_uses_no_line_while_parameters_are_compared(hosted):
    """A line that both open, close and write at once breaks."""
    turns, table, chair = [], hosted.chair.senses.parameters["drive"], hosted.chair
    compare = table.mismatch
    table.mismatch = lambda wanted: turns.append(chair._lock._is_owned()) or compare(wanted)
    chair.reset(None, 0)
    assert set(turns) == {True}


def begun(hosted, periods=15, twist=AHEAD):
    hosted.chair.reset(None, 0)
    reading = hosted.drive_for(periods, twist)
    assert reading.halted == ""
    assert reading.twist[0] == pytest.approx(twist[0], abs=0.01)
    return hosted.chair


def speed(hosted):
    return abs(hosted.twin.motion.speed) + 0.27 * abs(hosted.twin.motion.turn)


def until_slower(hosted, seconds, less=0.02):
    """Advance time until the chair is slower, within `seconds`; the mean deceleration [m/s2]."""
    start, before = hosted.clock.now(), speed(hosted)
    while speed(hosted) > before - less:
        hosted.clock.wait(hosted.clock.now() + 0.001)
        assert hosted.clock.now() - start < seconds
    return before / (hosted.clock.now() - start)


def deceleration(hosted):
    """The mean one from here to rest [m/s2]."""
    return until_slower(hosted, 3.0, speed(hosted) - 2e-3)


def test_a_reading_is_what_the_world_is(hosted):
    """Pose and twist to a count a period, ranges to their resolution, with ages."""
    hosted.twin.reset(box(3.0), 0)
    chair = begun(hosted, 12, np.array([0.3, 0.2]))
    start = hosted.twin.plant.pose
    reading = chair.drive(np.array([0.3, 0.2]))
    end = hosted.twin.plant.pose
    np.testing.assert_allclose(reading.pose, end, atol=2e-3)
    np.testing.assert_allclose(
        reading.twist, [np.hypot(*(end - start)[:2]) / PERIOD, (end - start)[2] / PERIOD], atol=6e-3
    )
    reading = hosted.drive_for(10, STILL)
    true = hosted.twin.plant.scan(0)
    both = np.isfinite(true)
    assert both.mean() > 0.9
    np.testing.assert_allclose(reading.laser[both], true[both], atol=2e-3)
    assert reading.laser.shape == (1081,)
    assert (reading.age <= 0.55).all()
    assert np.isfinite(reading.ultrasonic).sum() >= 4
    assert reading.battery == pytest.approx(hosted.twin.motion.battery, abs=0.3)
    assert not reading.bumped
    outline, walls = chair.chair.footprint.array, box(3.0).walls
    gap = footprint_clearance(*hosted.twin.plant.pose, outline, walls, np.empty((0, 3)), 2.0)
    assert chair.truth.clearance == pytest.approx(gap, abs=0.01)
    assert chair.truth.distance > 0.3


def test_periods_end_at_deadlines(hosted):
    """A policy that takes part of each period does not stretch them; one that sleeps skips some."""
    chair = hosted.chair
    chair.reset(None, 0)
    begin = hosted.clock.now()
    for k in range(5):
        hosted.clock.wait(hosted.clock.now() + 0.06)
        assert chair.drive(np.zeros(2)).stamp == pytest.approx(PERIOD * (k + 1))
    hosted.clock.wait(begin + 0.85)
    assert chair.drive(np.zeros(2)).stamp == pytest.approx(0.9)


def test_reset_stops_and_waits_for_a_person_and_stays_where_it_is(hosted):
    """A chair that was armed already needs nobody; one that has stopped stands until it is."""
    chair = begun(hosted, 13)
    place = hosted.twin.plant.pose
    hosted.minds = False
    reading = chair.reset(box(1.0, (0.5, 0.5, 1.0)), 0)
    assert speed(hosted) < 0.05
    assert reading.stamp == 0.0
    assert np.hypot(*(hosted.twin.plant.pose - place)[:2]) < 0.1
    np.testing.assert_allclose(reading.pose, hosted.twin.plant.pose, atol=2e-3)
    assert chair.drive(AHEAD).halted == ""
    hosted.twin.faults.switches = Switch.STOP_PRESSED
    hosted.clock.wait(hosted.clock.now() + 1.0)
    hosted.twin.faults.switches = Switch(0)
    chair.settings = dataclasses.replace(chair.settings, rearm_timeout=3.0)
    before = hosted.clock.now()
    with pytest.raises(InputError, match=r"stopped \(EMERGENCY_STOP\); a person must re-arm"):
        chair.reset(None, 0)
    assert hosted.clock.now() - before >= 3.0
    assert chair.senses.odometry.mode == Mode.STOPPED
    with pytest.raises(ValueError, match="never reset"):
        chair.drive(AHEAD)
    hosted.minds = True
    assert chair.reset(None, 0).halted == ""


def test_reset_says_what_it_waits_for_and_why_a_re_arm_is_refused(hosted):
    """A silent laser, then the emergency stop, which is pressed still as a person re-arms."""
    chair, told = hosted.chair, []
    chair.on_wait = told.append
    hosted.twin.laser.silent = True
    with pytest.raises(InputError, match="the laser is silent"):
        chair.reset(None, 0)
    (line,) = told
    assert line.startswith("the laser is silent (")
    assert line.endswith("; waits 5 s for it")
    hosted.twin.laser.silent = False
    hosted.minds = False
    told.clear()
    hosted.twin.faults.switches = Switch.STOP_PRESSED
    acts = {
        1.0: chair.rearm,
        2.0: lambda: setattr(hosted.twin.faults, "switches", Switch(0)),
        3.0: chair.rearm,
    }
    begun = hosted.clock.now()

    def person():
        for due in [due for due in acts if hosted.clock.now() > begun + due]:
            acts.pop(due)()

    hosted.clock.call_every(person, 0.05, "person")
    chair.reset(None, 0)
    waits, refused = told
    assert "EMERGENCY_STOP" in waits
    assert waits.endswith("a person must re-arm it; waits 120 s for that")
    assert refused == "not re-armed: the cause of the drive board's stop is still present"
    assert hosted.clock.now() > begun + 3.0
    hosted.twin.faults.switches = Switch.STOP_PRESSED
    chair.drive(STILL)
    chair.rearm()  # refused in the episode: no news for the next reset
    chair.drive(STILL)
    hosted.twin.faults.switches = Switch(0)
    hosted.minds = True
    chair.reset(None, 0)
    assert len(told) == 3
    assert told[2].endswith("(EMERGENCY_STOP); a person must re-arm it; waits 120 s for that")


FULL = Mock(return_value=0)
# What breaks, why it stops, and within how many seconds it is slower by 0.02 m/s
FAULTS = {
    "drive's cable": (lambda h: setattr(h.drive, "plugged", False), "drive board is silent", 0.25),
    "drive's port takes no data": (
        lambda h: setattr(h.drive, "write", FULL),
        "(LINK); a person must re-arm it (twin://drive: it takes no", 0.25,
    ),
    "range's cable": (lambda h: setattr(h.range, "plugged", False), "range board is silent", 1.2),
    "laser's cable": (lambda h: setattr(h.twin.laser, "plugged", False), "unplugged", 0.35),
    "laser is silent": (lambda h: setattr(h.twin.laser, "silent", True), "laser is silent", 0.35),
    "emergency stop": (
        lambda h: setattr(h.twin.faults, "switches", Switch.STOP_PRESSED), "EMERGENCY_STOP", 0.05
    ),
    "drive board hangs": (lambda h: h.twin.drive.hang(), "RESET", 0.15),
}  # fmt: skip


@pytest.mark.parametrize("fault", FAULTS)
def test_it_stops_and_names_the_cause_of_every_fault(hosted, fault):
    """While the policy goes on asking; a latched stop lasts until a person and a reset end it."""
    chair = begun(hosted)
    strike, why, bound = FAULTS[fault]
    strike(hosted)
    start, slow, said = hosted.clock.now(), None, []
    for _ in range(20):
        said.append(chair.drive(AHEAD).halted)
        if slow is None and speed(hosted) < 0.38:
            slow = hosted.clock.now() - start
    assert speed(hosted) < 2e-3
    assert slow <= bound + PERIOD
    assert any(why in one for one in said)
    assert said[-1]
    assert chair.truth.distance < 0.4 * 1.5 + 0.4 * (bound + 0.5)


def test_the_second_laser_of_the_chair_rear_is_read_watched_and_stops_it(host):
    """It sees what the simulation's does; silent, it stops the chair; an obstacle behind, too."""
    sensors = env_settings(None, model="rear", noise=False).sensors
    world = box(3.0, (-1.5, 0.0, 0.0))
    hosted, simulated = host(world, sensors=sensors), SimulatedChair(sensors=sensors)
    chair, part = hosted.chair, sensors.slices[1]
    assert chair.settings.more_laser_ports == ("twin://laser_1",)
    seen, wanted = chair.reset(None, 0).laser[part], simulated.reset(world, 0).laser[part]
    assert np.abs(seen - wanted).max() < 2e-3  # whole millimetres, and the settling of the motors
    shield, reading, speeds = Shield(sensors=sensors), chair.reset(None, 0), []
    for _ in range(60):
        reading = step(chair, shield, (-0.3, 0.0), reading)
        speeds.append(-reading.twist[0])
    assert max(speeds) > 0.2
    assert not hosted.twin.bumper_steps
    assert hosted.twin.plant.pose[0] > -3.0 + 0.3
    hosted.twin.lasers[1].silent = True
    said = [chair.drive(AHEAD).halted for _ in range(5)]
    assert said[-1].startswith("the second laser is silent")


def test_a_chair_with_ten_ultrasonics_reads_all_and_names_a_silent_one(host):
    """The two at the back range as in the simulation, and stop it before what only they hear."""
    sensors = env_settings(None, model="rear_ultrasonics", noise=False).sensors
    sensors = dataclasses.replace(sensors, more_lasers=())
    world = box(3.0, (-2.0, 0.0, 0.0))
    hosted, simulated = host(world, sensors=sensors), SimulatedChair(sensors=sensors)
    chair, shield = hosted.chair, Shield(sensors=sensors)
    reading = chair.reset(None, 0)
    wanted = simulated.reset(world, 0).ultrasonic
    assert reading.ultrasonic.shape == reading.age.shape == (10,)
    assert np.isfinite(wanted[8:]).all()
    np.testing.assert_allclose(reading.ultrasonic, wanted, atol=3e-3)
    assert np.isfinite(reading.age).all()
    for _ in range(100):
        reading = step(chair, shield, (-0.3, 0.0), reading)
    assert shield.decision.reason == "obstacle"
    assert not hosted.twin.bumper_steps
    assert -3.0 + 0.3 < hosted.twin.plant.pose[0] < -2.3
    hosted.twin.faults.silent_ultrasonics.add(9)
    for _ in range(20):
        reading = chair.drive(shield.filter(np.zeros(2), reading))
    assert np.isnan(reading.ultrasonic).tolist() == [False] * 9 + [True]
    assert shield.latched == "ultrasonic silent"
    hosted.clock.guards.clear()
    found = Diagnostics(chair.senses, hosted.clock, chair.parameters).run()
    assert [one.part for one in found if not one.good] == ["ultrasonic 9"]


def test_a_laser_that_speaks_again_lets_it_go_on(hosted):
    chair = begun(hosted)
    hosted.twin.laser.silent = True
    readings = [chair.drive(AHEAD) for _ in range(5)]
    assert readings[-1].halted
    assert np.isnan(readings[-1].laser).all()
    hosted.drive_for(5)
    assert hosted.twin.braked  # and the drivers are off, as after any fault
    assert not hosted.twin.enabled
    hosted.twin.laser.silent = False
    said = [chair.drive(AHEAD).halted for _ in range(25)]
    assert said[-1] == ""
    assert speed(hosted) > 0.3


@pytest.mark.parametrize("delay", [150, 300, 900])
def test_a_laser_whose_scans_come_late_from_the_start_is_refused(hosted, delay):
    """Its stamps alone do not show it; a request for its time does, as long as it takes."""
    hosted.twin.laser.delay = delay
    with pytest.raises(
        InputError, match=r"the laser is (late: its data may be|silent \(does not stream yet\))"
    ):
        hosted.chair.reset(None, 0)
    assert speed(hosted) < 2e-3


@pytest.mark.parametrize("growth", [5, 20])
def test_a_laser_that_becomes_late_stops_it(hosted, growth):
    """The delay grows by 5 or 20 ms/s, in steps of 1 ms."""
    chair, said = begun(hosted), ""
    start = hosted.clock.now()
    while not said and hosted.clock.now() < start + 60.0:
        hosted.twin.laser.delay = round(growth * (hosted.clock.now() - start))
        said = chair.drive(AHEAD if hosted.clock.now() < start + 2.0 else STILL).halted
    assert said.startswith("the laser is late: its data may be 0.1")
    assert hosted.twin.laser.delay < 120
    hosted.twin.laser.delay = 0
    assert [chair.drive(AHEAD).halted for _ in range(30)][-1] == ""


@pytest.mark.parametrize(("seed", "maximum"), [(0, 12), (1, 3), (5, 3)])
def test_the_boards_do_not_outrun_the_set_point_for_long(host, seed, maximum):
    """Commands that change each period add up how the board's ramp differs from the shield's.

    They did for 18, 9 and 25 readings. A chair that speeds up to its command is no runaway.
    """
    hosted, shield = host(box(6.0)), Shield()
    rng, run, longest = np.random.default_rng(seed), 0, 0
    reading = hosted.chair.reset(None, 0)
    for _ in range(60):
        given = shield.filter(np.array([rng.choice((0.0, 0.4, 0.8)), 0.0]), reading)
        set_point = shield.state["setpoint"]["v"][0]
        reading = hosted.chair.drive(given, shield.decision.protective)
        run = run + 1 if reading.twist[0] > set_point + 0.03 else 0
        longest = max(longest, run)
    assert shield.latched == ""
    assert longest <= maximum


def test_a_re_armed_chair_stands_until_it_is_reset(hosted):
    """Nothing starts to move because a person re-arms it: the program must begin anew."""
    chair = begun(hosted)
    hosted.twin.faults.switches = Switch.STOP_PRESSED
    hosted.drive_for(12)
    hosted.twin.faults.switches = Switch(0)
    chair.drive(AHEAD)
    chair.rearm()
    for _ in range(5):
        assert "EMERGENCY_STOP" in chair.drive(AHEAD).halted
    assert chair.senses.odometry.mode == Mode.HOST
    assert speed(hosted) < 2e-3
    chair.reset(None, 0)
    assert chair.drive(AHEAD).halted == ""


def test_a_late_policy_does_not_drive_on(hosted):
    chair = begun(hosted)
    timeout = chair.settings.limits.command_timeout  # a command counts so long
    hosted.clock.wait(hosted.clock.now() + timeout)
    assert speed(hosted) == pytest.approx(0.4, abs=0.02)
    until_slower(hosted, PERIOD + 0.05)
    assert deceleration(hosted) >= MIN_DECELERATION
    assert chair.drive(AHEAD).halted == ""  # it goes on when told to


@pytest.mark.parametrize("fault", [Fault.BRAKE, Fault.LINK, Fault.UNDER_VOLTAGE, Fault.OVERRUN])
def test_a_chair_that_its_motors_hold_or_stop_is_named_and_re_armed(hosted, monkeypatch, fault):
    chair, sent = begun(hosted), []
    holds = chair.senses.odometry._replace(mode=Mode.STOPPING, faults=fault)
    monkeypatch.setattr(type(chair.senses), "odometry", holds)
    assert f"has stopped ({fault.name})" in chair.senses.stopped()
    chair.senses.drive.send = sent.append
    chair.rearm()
    assert Rearm(fault) in sent


def test_no_reset_without_a_person_while_a_fault_brings_the_chair_to_rest(hosted):
    chair = begun(hosted)
    chair.settings = dataclasses.replace(chair.settings, rearm_timeout=1.0)
    hosted.minds, hosted.twin.faults.battery = False, 20.0
    while not chair.drive(AHEAD).halted:
        pass
    with pytest.raises(InputError, match=r"stopped \(UNDER_VOLTAGE\); a person must re-arm"):
        chair.reset(None, 0)


def test_a_guard_that_fails_goes_on_and_stops_the_chair_until_a_reset(hosted, caplog):
    chair = begun(hosted)
    chair._watch_person = Mock(side_effect=[KeyError("/scan"), KeyError("/scan"), *[None] * 999])
    hosted.clock.wait(hosted.clock.now() + 0.02)
    assert "the guard has failed (KeyError('/scan'))" in chair.drive(AHEAD).halted
    assert deceleration(hosted) >= MIN_DECELERATION
    assert chair.drive(AHEAD).halted == chair.latched
    assert [one.getMessage() for one in caplog.records if one.levelname == "ERROR"] == [
        f"twin://drive: {chair.latched}"  # said once
    ]
    assert chair.reset(None, 0).halted == chair.drive(AHEAD).halted == ""


@pytest.mark.parametrize("way", ["close", "close by hand", "program killed"])
def test_every_way_out_stops_it(hosted, way):
    """A killed program says nothing any more: the board stops by itself."""
    chair = begun(hosted)
    if way != "program killed":
        if way == "close by hand":
            chair.joystick = lambda now, limits: AHEAD
        chair.close()
        chair.close()  # twice does no harm
        until_slower(hosted, 0.06)
        with pytest.raises(ValueError, match="closed"):
            chair.drive(AHEAD)
    else:
        hosted.clock.guards.clear()
        until_slower(hosted, 0.205 + 0.02)
    assert deceleration(hosted) >= MIN_DECELERATION


def test_the_joystick_at_the_board_goes_before_the_host(hosted):
    """It says so while a person drives, and goes on when the chair is handed back."""
    chair = begun(hosted)

    def stick(**state):
        hosted.twin.drive.write(ibus(**state), 1)

    assert IBUS_BAUD == 115_200
    person = {"manual": True, "held": True}
    hosted.clock.call_every(lambda: stick(**person), 0.02, "joystick")
    said = [chair.drive(AHEAD).halted for _ in range(12)]
    assert "joystick" in said[-1]
    assert speed(hosted) < 0.02  # its stick is at the centre
    person |= {"ahead": 0.5}
    chair.drive(AHEAD)
    assert "joystick" in [chair.drive(AHEAD).halted for _ in range(10)][-1]
    assert speed(hosted) > 0.1
    person |= {"ahead": 0.0, "manual": False}
    assert [chair.drive(AHEAD).halted for _ in range(20)][-1] == ""
    assert hosted.twin.motion.speed == pytest.approx(0.4, abs=0.01)


def test_a_strip_is_told_and_stops_it(host):
    """Into a wall: the board stops the chair, and the next reading says bumped."""
    hosted = host(box(1.2))
    chair = hosted.chair
    chair.reset(None, 0)
    assert any([reading.bumped for reading in drives(chair, AHEAD, 25)])
    assert chair.truth.touched
    assert speed(hosted) < 2e-3


def test_boards_and_laser_must_be_those_of_the_settings(host):
    for chair, sensors, why in (
        (None, SensorSettings(laser=LaserSettings(beams=541)), "has 541 beams"),
        (ChairSettings(drive=DriveGeometry(track=0.6)), None, "track is 0.54; expected 0.6"),
    ):
        hosted = host(sensors=sensors)
        hosted.chair.senses.sensors = SensorSettings()  # what the settings say
        hosted.chair.chair = chair or hosted.chair.chair
        with pytest.raises(InputError, match=why):
            hosted.chair.reset(None, 0)


@pytest.mark.parametrize("heard", [True, False])
def test_another_range_board_is_noticed_at_the_next_reset(host, heard):
    """Its parameters are the defaults; noise may swallow what it says after it was switched on."""
    rangers = UltrasonicSettings(interval=0.1)
    hosted = host(sensors=SensorSettings(ultrasonic=rangers, noise=False))
    chair = hosted.chair
    chair.reset(None, 0)
    hosted.twin.range.set_eeprom(b"\xff" * 256)
    hosted.twin.range.reset()
    hosted.clock.wait(hosted.clock.now() + 0.01)
    if not heard:
        hosted.range.board.read()
    hosted.clock.wait(hosted.clock.now() + 1.0)
    with pytest.raises(InputError, match=r"the range board's interval is 0.06; expected 0.1"):
        chair.reset(None, 0)


def test_a_chair_of_other_sizes_drives_by_its_own(host):
    """Its boards are set up once, keep it through a reset of theirs, and agree at reset."""
    hosted = host(box(50.0), ChairSettings(drive=DriveGeometry(track=0.6, counts_per_metre=3000.0)))
    hosted.chair.reset(None, 0)
    hosted.twin.drive.reset()
    hosted.clock.wait(hosted.clock.now() + 0.3)
    hosted.chair.reset(None, 0)
    reading = hosted.drive_for(15, np.array([0.3, 0.3]))
    assert hosted.twin.motion.speed == pytest.approx(0.3, abs=0.01)
    assert hosted.twin.motion.turn == pytest.approx(0.3, abs=0.02)
    np.testing.assert_allclose(reading.pose, hosted.twin.plant.pose, atol=3e-3)


def test_what_is_not_there_is_one_line():
    config = env_settings({"sensors": {"pose_source": "mcl"}})
    lines = {"drive_port": "twin://nobody", "range_port": "", "laser_port": "twin://nobody"}
    chair = make_chair({"name": "hardware", **lines, "limits": {"ready_timeout": 0.1}}, config)
    with pytest.raises(InputError, match="drive board is silent"):
        chair.reset(None, 0)
    chair.close()


def test_settings_of_the_file_stand_where_the_name_says_nothing():
    config = env_settings(
        {"sensors": {"pose_source": "odometry"}, "hardware": {"rearm_timeout": 7.0}}
    )
    chair = make_chair(
        {"name": "hardware", "drive_port": "twin://nobody", "range_port": ""}, config
    )
    inner = chair.chair
    inner.close()
    assert (inner.settings.rearm_timeout, inner.settings.drive_port) == (7.0, "twin://nobody")


def test_odometry_is_moved_on_and_survives_wraps_and_resets():
    """Any split of a way into messages gives its pose; counts wrap, and a board counts anew."""
    geometry = DriveGeometry()
    metre = round(geometry.counts_per_metre)
    odometer, zero = WheelOdometry(geometry, 0.1), Odometry(**dict.fromkeys(Odometry._fields, 0))
    high = (1 << 31) - metre // 2
    odometer.update(zero._replace(left=high, right=high), 0.0)
    wrapped = high + metre - (1 << 32)
    odometer.update(zero._replace(left=wrapped, right=wrapped), 0.02)
    np.testing.assert_allclose(odometer.at(0.02)[0], [1.0, 0.0, 0.0], atol=1e-3)
    odometer.restart()
    odometer.update(zero._replace(left=0, right=0, speed_left=0.5, speed_right=0.5), 0.04)
    pose, ways = odometer.at(0.06)
    np.testing.assert_allclose(pose, [1.01, 0.0, 0.0], atol=1e-3)
    np.testing.assert_allclose(ways, [1.01, 1.01], atol=1e-3)
    assert odometer.at(9.0)[0][0] == pytest.approx(1.05, abs=1e-3)  # never far
    np.testing.assert_allclose(
        odometer.twist(np.array([-0.027, 0.027]), 0.1), [0.0, 1.0], atol=1e-9
    )


def test_all_reports_about_the_wheels_are_kept_with_their_times(hosted):
    """At 50 Hz, by the host's clock; scans carry the time at which they were made."""
    chair, rows = begun(hosted), [hosted.chair.wheels]
    for reading in drives(chair, AHEAD, 20):
        rows.append(chair.wheels)
        assert len(rows[-1]) == 5
        assert 0.0 <= reading.stamp - chair.scan_stamps[0] < 0.05
    table = np.concatenate(rows)
    assert np.diff(table["stamp"]) == pytest.approx(0.02, abs=2e-3)
    assert np.diff(table["board_stamp"]) == pytest.approx(0.02, abs=2e-3)
    assert table["stamp"][-1] == pytest.approx(reading.stamp, abs=0.02)
    assert (np.diff(table["counts"], axis=0) >= 0).all()
    assert table["speeds"][-1] == pytest.approx(0.4, abs=0.02)
    assert (table["command"][-1] == AHEAD).all()
    assert table["age"].max() < 0.06
    assert chair.board_parameters["drive"]["counts_per_metre"] == 4346.0
