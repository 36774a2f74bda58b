"""Laws of the shield on chairs with other sensors: what only a further scanner sees stops them."""

import dataclasses
import math

import numpy as np
import pytest

from tests.safety.test_shield import begin, drive
from tests.sim.worlds import box
from wheelchair_gym.envs.settings import env_settings
from wheelchair_gym.safety import Shield
from wheelchair_gym.safety.grid import place_of_cell
from wheelchair_gym.safety.state import CELL
from wheelchair_gym.sensors import settings
from wheelchair_gym.sim.chair import SimulatedChair

BACK = settings.LaserSettings(x=-0.28, yaw=math.pi, beams=181, fov=math.radians(180.0), reach=6.0)
CAMERA = settings.LaserSettings(x=-0.28, yaw=math.pi, beams=17, fov=math.radians(80.0), reach=3.0)
FREE = settings.LaserSettings(x=-0.28, yaw=math.pi, beams=271, shows_free=True)
NONE = settings.UltrasonicSettings(mounted=())
FRONT_ONLY = settings.SensorSettings(ultrasonic=NONE)
TEN = env_settings(None, model="rear_ultrasonics").sensors
BACKWARD = np.array([-0.3, 0.0])


def with_more(*lasers, **others):
    return settings.SensorSettings(ultrasonic=NONE, more_lasers=lasers, **others)


def reverse(sensors, twist=BACKWARD, seconds=20.0, **others):
    """Ask for one twist from near the rear wall, in a room; chair, shield, reasons."""
    trace, chair, shield = drive((-3.5, 0.0, 0.0), twist, seconds, sensors=sensors, **others)
    return chair, shield, [decision.reason for decision, _ in trace]


def changed(reading, beams, ranges):
    """The reading with other ranges of some beams."""
    laser = reading.laser.copy()
    laser[beams] = ranges
    return reading._replace(laser=laser)


@pytest.mark.parametrize("key", [3, 4, 5])
@pytest.mark.parametrize(
    ("sensors", "blind", "nearest"),
    [
        (with_more(BACK), False, 0.15),
        (with_more(CAMERA), False, 0.15),
        (dataclasses.replace(TEN, more_lasers=()), False, 0.3),
        (TEN, True, 0.3),
    ],
    ids=["scanner", "camera", "ultrasonics", "ultrasonics beside a blind scanner"],
)
def test_a_wall_that_only_rear_sensors_see_or_hear_stops_it(sensors, blind, nearest, key):
    behind = sensors.slices[1] if blind else []
    chair, _, reasons = reverse(
        sensors, key=key, told=lambda _, reading: changed(reading, behind, np.inf)
    )
    assert not chair.truth.touched
    assert chair.truth.clearance < nearest
    assert reasons[-1] == "obstacle"


@pytest.mark.parametrize("sensors", [FRONT_ONLY, settings.SensorSettings()])
def test_without_rear_sensors_it_meets_the_wall(sensors):
    """The laws above are about these: unseen space only slows the chair."""
    chair, _, reasons = reverse(sensors)
    assert chair.truth.touched
    assert "obstacle" not in reasons


@pytest.mark.parametrize("aside", [-0.25, 0.0, 0.2])
def test_a_post_that_one_beam_meets_stops_it(aside):
    chair, _, _ = reverse(with_more(BACK), discs=(-4.4, aside, 0.01))
    assert not chair.truth.touched
    assert chair.truth.pose[0] > -4.4 + 0.28


def test_what_leaves_the_view_of_its_scanner_is_remembered():
    """A post enters the blind corner beside a narrow fan; the chair turns, then reverses."""
    sensors = with_more(dataclasses.replace(CAMERA, beams=41))
    asked = [(0.0, 0.6)] * 15 + [BACKWARD] * 60
    post = (-0.75, 0.0, 0.03)
    _, chair, _ = drive((0.0, 0.0, 0.0), asked.__getitem__, 7.5, sensors=sensors, discs=post)
    assert not chair.truth.touched


def test_it_leaves_when_the_thing_behind_has_gone():
    """Its scanner sees beyond where a post was: the chair may reverse again."""
    post = box(5.0, discs=(-0.42, 0.0, 0.05))
    chair, shield, reading = begin(post, 3, sensors=with_more(BACK))
    for _ in range(20):
        reading = chair.drive(shield.filter(BACKWARD, reading))
    assert shield.decision.reason == "obstacle"
    reading = chair.reset(box(5.0), 3)._replace(stamp=reading.stamp)
    for _ in range(30):
        given = shield.filter(BACKWARD, reading)
        reading = chair.drive(given)._replace(stamp=reading.stamp + 0.1)
    assert chair.truth.twist[0] < -0.05


@pytest.mark.parametrize("covered", [False, True])
def test_a_rear_scanner_that_loses_its_echoes_forgets_nothing(covered):
    """A sticker on its window, before a post behind the chair."""
    sensors = with_more(BACK)
    sector = slice(1081 + 60, 1081 + 121)

    def told(k, reading):
        return changed(reading, sector, np.inf) if covered and k > 15 else reading

    chair, _, reasons = reverse(sensors, seconds=10.0, discs=(-4.3, 0.0, 0.05), told=told)
    assert reasons[-1] == "obstacle"
    assert not chair.truth.touched


TURN = np.array([0.0, 0.8])


@pytest.mark.parametrize("shows_free", [True, False])
def test_it_turns_fast_over_floor_that_a_rear_scanner_shows_free(shows_free):
    sensors = with_more(dataclasses.replace(FREE, shows_free=shows_free))
    trace, _, _ = drive((0.0, 0.0, 0.0), TURN, 3.0, sensors=sensors)
    fastest = max(truth.twist[1] for _, truth in trace)  # at first, it has not seen beside it
    assert (fastest > 0.7) == shows_free
    assert (fastest < 0.25) == (not shows_free)


@pytest.mark.parametrize("shows_free", [True, False])
def test_a_rear_scanner_that_shows_what_is_free_sees_who_comes_from_behind(shows_free):
    sensors = with_more(dataclasses.replace(FREE, shows_free=shows_free))
    chair, shield = SimulatedChair(sensors=sensors), Shield(sensors=sensors)
    for k in range(12):  # at 1 m/s
        disc = -2.2 + 0.1 * k, 0.0, 0.25
        reading = chair.reset(box(5.0, discs=disc), k)._replace(stamp=0.1 * k)
        shield.filter(np.zeros(2), reading)
    state = shield.state[0]
    marks = state["marks"][: state["n_marks"]]
    assert (len(marks) > 3) == shows_free
    # Those of its earlier positions were dropped.
    assert (np.abs(np.hypot(marks["x"] - disc[0], marks["y"]) - disc[2]) < 0.08).all()


@pytest.mark.parametrize("what", ["blind", "frozen", "short"])
def test_a_rear_scanner_that_tells_nothing_shows_nothing_free(what):
    """It hears no echo, or repeats its scan, or does not reach so far as corners do."""
    sensors = with_more(dataclasses.replace(FREE, reach=0.5 if what == "short" else FREE.reach))
    at, (chair, shield, reading) = sensors.slices[1], begin(box(5.0), 3, sensors=sensors)
    for k in range(12):
        if k == 6:
            kept = reading.laser[at].copy()
        if k > 6 and what != "short":
            reading = changed(reading, at, np.inf if what == "blind" else kept)
        reading = chair.drive(shield.filter(0.1 * TURN, reading))
    state = shield.state[0]
    behind = math.floor(-1.2 / CELL)  # along x
    seen = state["seen"][[int(place_of_cell.py_func(behind + k, 0)) for k in (0, 1)]]
    fresh = state["stamp"] - 0.25
    assert (seen < fresh).all()
    assert (seen > 0.0).any() == (what != "short")


def test_a_person_who_stands_behind_does_not_count_as_moving():
    sensors = with_more(FREE)
    _, _, reasons = reverse(sensors, TURN, seconds=6.0, discs=(-4.35, 0.3, 0.1))
    assert "moving" not in reasons


@pytest.mark.parametrize("what", ["silent", "frozen"])
def test_a_rear_scanner_that_fails_stops_the_chair(what):
    sensors = with_more(BACK)
    at, last = sensors.slices[1], []

    def told(k, reading):
        if k == 10:
            last.append(reading.laser[at].copy())
        return reading if k < 10 else changed(reading, at, np.nan if what == "silent" else last[0])

    _, shield, _ = reverse(sensors, (-0.1, 0.3), seconds=3.0, told=told)
    assert shield.latched == f"laser {what}"


def test_a_scanner_that_sees_nothing_is_no_fault():
    camera = dataclasses.replace(CAMERA, reach=0.5, range_min=0.05)
    _, shield, reasons = reverse(with_more(camera), np.array([0.3, 0.0]), seconds=4.0)
    assert shield.latched == ""
    assert set(reasons) <= {"", "unseen", "obstacle"}


@pytest.mark.parametrize("mounted", [0, 2, 10])
def test_unmounted_ultrasonics_raise_no_fault(mounted):
    ultrasonic = settings.UltrasonicSettings(mounted=TEN.ultrasonic.mounted[:mounted])
    chair, shield, _ = reverse(
        settings.SensorSettings(ultrasonic=ultrasonic), np.array([0.4, 0.1]), 8.0
    )
    assert shield.latched == ""
    assert chair.truth.distance > 1.0


@pytest.mark.parametrize("key", range(6))
def test_it_hits_nothing_behind_while_sensors_fail(key):
    faults = settings.FaultSettings(share=1.0, onset=(0.5, 2.0))
    chair, _, _ = reverse(with_more(BACK, faults=faults), key=key, seconds=12.0)
    assert chair.truth.approach_speed * chair.truth.at_fault <= 0.05
