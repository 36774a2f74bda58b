"""Scans are compared with the wheels: a laser that deceives is found before it does harm."""

import dataclasses
import math

import numpy as np
import pytest

from tests.benchmarks.senses import (
    HARM,
    ONSET,
    PERIOD,
    SPEEDS,
    THINGS,
    Fault,
    blind,
    drive,
    late,
    plain,
    repeated,
    stuck,
    world,
)
from tests.safety.test_shield import begin
from tests.sim.worlds import box, placed, step
from wheelchair_gym.safety import Shield, ShieldSettings
from wheelchair_gym.scenes.arena import EmptyRoom
from wheelchair_gym.sensors.settings import LaserSettings, SensorSettings
from wheelchair_gym.sim.chair import SimulatedChair
from wheelchair_gym.sim.randomization import JointRandomization, exactly
from wheelchair_gym.sim.settings import ChairSettings


@pytest.mark.parametrize("thing", THINGS)
@pytest.mark.parametrize(
    "deceit",
    [late(0.3), late(1.0), repeated(3), repeated(1, 0.003), stuck],
    ids=["late", "very late", "ring", "jitter", "stuck"],
)
def test_a_laser_that_deceives_is_found_before_a_contact(deceit, thing):
    outcome = drive(Fault("", deceit), thing, SPEEDS[1], 0, 8.0)
    assert outcome.contact <= HARM
    assert outcome.reason in ("laser disagrees", "laser frozen")
    assert outcome.detected < ONSET + 3.0


@pytest.mark.parametrize("beams", [64, 181, 541, 1081])
@pytest.mark.parametrize("speed", SPEEDS)
@pytest.mark.parametrize("deceit", [repeated(3), repeated(1, 0.003)], ids=["ring", "jitter"])
def test_a_scan_that_repeats_is_doubted_where_only_a_pole_shows_motion(deceit, speed, beams):
    assert drive(Fault("", deceit), "passage", speed, 0, 16.0, beams).contact <= HARM


@pytest.mark.parametrize("half", [0.5, 0.9, 1.5, 3.0])
def test_in_a_passage_longer_than_the_laser_reaches_no_fresh_scan_is_doubted(half):
    """The place where its walls are lost from sight moves with the chair, as in repeated scans."""
    walls = [(-30.0, y, 30.0, y) for y in (half, -half)]
    chair, shield, reading = begin(box(40.0, (-15.0, 0.05, 0.01), walls), 2)
    for _ in range(200):
        _, y, yaw = chair.truth.pose
        reading = step(chair, shield, (0.8, -0.3 * y - 0.6 * yaw), reading)
        assert shield.decision.reason == ""


@pytest.mark.parametrize("delay", [0.06, 0.12, 0.2])
def test_a_short_delay_is_added_to_the_reaction_time(delay):
    assert all(drive(Fault("", late(delay)), "room", v, 0, 25.0).contact <= HARM for v in SPEEDS)


def test_a_delay_that_grows_is_followed():
    """By 10 ms/s; the lag of the latest changes of speed counts."""
    assert drive(Fault("", late(0.0, 0.01)), "room", 0.8, 1, 40.0).contact <= HARM


def test_the_set_point_follows_wheels_that_outrun_it_lastingly():
    _, shield, reading = begin(EmptyRoom().sample(np.random.default_rng(0)), 0)
    for k, followed in enumerate((False, False, True, True)):
        wheels, laser = np.array([0.2 - 0.001 * k, 0.0]), reading.laser + np.float32(0.001 * k)
        seen = reading._replace(twist=wheels, laser=laser, stamp=0.1 * k)
        shield.filter(np.array([0.05, 0.0]), seen)
        assert (shield.state["setpoint"]["v"][0] > 0.1) == followed


@pytest.mark.parametrize("command", [0.0, 0.05, 0.1, 0.2, 0.4])
@pytest.mark.parametrize("wheels", [-0.3, 0.8])
def test_wheels_that_do_not_do_what_is_asked_are_a_fault(command, wheels):
    """The set point follows wheels that outrun it, also the wrong way round: that hides nothing."""
    room = EmptyRoom(size=(40.0, 20.0)).sample(np.random.default_rng(0))
    chair, shield, reading = begin(room, 0)
    for _ in range(20):
        shield.filter(np.array([command, 0.0]), reading)
        if shield.latched:
            break
        reading = chair.drive(np.array([wheels, 0.0]))
    assert shield.latched == "odometry frozen"


@pytest.mark.parametrize("turned", [10.0, -20.0, 90.0, 180.0])
def test_a_laser_that_was_turned_is_found_within_a_second_of_motion(turned):
    laser = LaserSettings(yaw=math.radians(turned))
    outcome = drive(Fault("", plain, laser), "wall", 0.8, 0, 8.0)
    assert outcome.reason == "laser disagrees"
    assert outcome.detected < 2.5  # the chair needs a second for 0.4 m/s
    assert outcome.contact == 0.0


def pivot(laser=None, changed=lambda scan: scan, seconds=6.0):
    """The fault that is found in a turn on the spot, and the angle turned [rad]."""
    sensors = SensorSettings()
    chair = SimulatedChair(
        sensors=dataclasses.replace(sensors, laser=laser or sensors.laser), period=PERIOD
    )
    shield = Shield(ShieldSettings(unseen_speed=1.0), sensors=sensors, period=PERIOD)
    reading = chair.reset(world("column"), 0)
    for _ in range(round(seconds / PERIOD)):
        told = reading._replace(laser=changed(reading.laser))
        reading = chair.drive(shield.filter(np.array([0.0, 0.6]), told))
        if shield.latched:
            break
    assert np.isfinite(shield.state["keys"][0, 0]["offset"]).all()
    return shield.latched, abs(chair.truth.pose[2])


@pytest.mark.parametrize("place", [(0.46, 0.0), (0.66, 0.2), (0.66, -0.5)])
def test_a_laser_that_was_moved_is_found_in_a_turn(place):
    fault, turned = pivot(LaserSettings(x=place[0], y=place[1]))
    assert fault == "laser disagrees"
    assert turned < 0.8


def test_a_mirrored_laser_is_found_in_a_turn():
    fault, turned = pivot(changed=lambda scan: np.ascontiguousarray(scan[::-1]))
    assert fault == "laser disagrees"
    assert turned < 0.3
    assert pivot()[0] == ""


@pytest.mark.parametrize("bearing", [-60, 0, 30])
@pytest.mark.parametrize("width", [5, 20, 60])
def test_a_sector_without_echoes_erases_nothing(width, bearing):
    """A drop on the window."""
    fault = Fault("", blind(width, bearing, ONSET))
    for thing in THINGS:
        assert drive(fault, thing, SPEEDS[1], 0, 10.0).contact <= HARM, thing


def test_somebody_who_left_does_not_block_a_hall_for_ever():
    """Nothing stands behind them within the laser's reach."""
    wall = (-6.0, 3.0, 8.0, 3.0)
    chair, shield, reading = begin(box(40.0, walls=wall, discs=(2.5, 0.0, 0.25)), 1)
    for _ in range(60):
        reading = chair.drive(shield.filter(np.array([0.8, 0.0]), reading))
    assert shield.decision.reason == "obstacle"
    stamp, blocked = reading.stamp, 0
    alone = placed(SimulatedChair(), box(40.0, chair.truth.pose, wall), 1)
    for k in range(80):
        given = shield.filter(np.array([0.8, 0.0]), reading)
        reading = alone.drive(given)
        reading = reading._replace(stamp=stamp + 0.1 * (k + 1))
        blocked += alone.truth.twist[0] < 0.1
    assert 20 < blocked < 70
    assert shield.latched == ""


@pytest.mark.parametrize(
    ("ranger", "told", "fault"),
    [(0, np.inf, "deaf"), (1, np.inf, "deaf"), (1, 2.6, "deaf"), (0, 0.8, "frozen"),
     (6, 0.3, "frozen")],
)  # fmt: skip
def test_an_ultrasonic_that_tells_nothing_of_walls_is_found(ranger, told, fault):
    """It hears none, or repeats one range, up to its noise, wherever the chair is."""
    chair, shield, found, noise = SimulatedChair(), Shield(), [], np.random.default_rng(0)

    def failed(reading):
        ultrasonic = reading.ultrasonic.copy()
        if not math.isnan(ultrasonic[ranger]):
            ultrasonic[ranger] = told + noise.normal(0.0, 0.01)
        return reading._replace(ultrasonic=ultrasonic)

    for fails in (False, True):
        shield.reset()
        reading = chair.reset(box(3.0, (1.0, 0.0, 0.0)), 2)
        for k in range(500):
            twist = np.array([0.3 if k % 35 < 9 else -0.3, 0.5 if k > 300 else 0.0])
            reading = step(chair, shield, twist, failed(reading) if fails else reading)
        found.append(shield.latched)
    assert found == ["", f"ultrasonic {fault}"]
    for _ in range(20):  # at rest it cannot be heard again: a person decides
        shield.rearm()
        reading = step(chair, shield, np.zeros(2), failed(reading))
    assert shield.latched == ""


DRAWN = JointRandomization(("laser.x_error",), (0.01,), ((0.004**2,),))
# Settings of the laser, of the chair, and the least that they add to the margin [m].
ERRORS = {
    "bias": ({"bias": 0.02}, {}, 0.035),
    "sigma": ({"sigma": 0.06}, {}, 0.014),
    "both": ({"bias": 0.03, "sigma": 0.03}, {}, 0.06),
    "mount": ({}, {"laser.x_error": -0.05, "laser.y_error": 0.05, "laser.yaw_error": 0.05}, 0.1),
    "offset": ({}, {"laser.offset_error": 0.05}, 0.045),
    "noise": ({}, {"laser.sigma": 0.06}, 0.014),
    "joint": ({}, DRAWN, 0.022),
}


@pytest.mark.parametrize("name", ERRORS)
def test_every_error_of_the_laser_widens_the_margin(name):
    """A chair whose laser shows all ranges too long by two standard deviations stops in time."""
    laser, drawn, least = ERRORS[name]
    sensors = SensorSettings(laser=LaserSettings(**laser))
    settings = ChairSettings(randomization=exactly({} if drawn is DRAWN else drawn))
    if drawn is DRAWN:
        settings = ChairSettings(joint=drawn)
    chair, shield = SimulatedChair(settings, sensors), Shield(chair=settings, sensors=sensors)
    margin, plain = (one._constants.record["stop_margin"] for one in (shield, Shield()))
    assert margin - plain >= least
    reading = chair.reset(box(3.0, (0.0, 0.0, 0.3)), 0)
    for _ in range(80):
        far = reading.laser + np.float32(2.0 * sensors.laser.bias)
        reading = step(chair, shield, (0.8, 0.0), reading._replace(laser=far))
        assert chair.truth.approach_speed * chair.truth.at_fault <= HARM


def test_a_standing_mirror_is_found_before_the_chair_has_moved_far():
    for thing in THINGS:
        outcome = drive(Fault("", stuck), thing, SPEEDS[0], 1, 4.0)
        assert outcome.reason == "laser frozen"
        assert outcome.detected < ONSET + 0.5


def test_a_hall_without_echoes_is_no_fault():
    """The chair turns back to where it began, after another run among walls."""
    chair, shield = SimulatedChair(), Shield()
    for half, steps in ((3.0, 30), (60.0, 150)):
        reading = chair.reset(box(half, (0.0, 0.0, 0.0)), 1)
        shield.reset()
        for k in range(steps):
            twist = np.array([0.8, 0.0]) if k < 50 else np.array([0.0, 0.6])
            reading = chair.drive(shield.filter(twist, reading), shield.decision.protective)
            assert shield.latched == ""
            assert half < 9.0 or k < 20 or k > 50 or chair.truth.twist[0] > 0.3
