"""Laws of a chair's own set of sensors: several scanners, and fewer ultrasonics than eight."""

import dataclasses
import math

import numpy as np
import pytest

from tests.sim.worlds import cluttered, placed
from wheelchair_gym.envs.settings import env_settings
from wheelchair_gym.sensors import settings
from wheelchair_gym.sim.chair import SimulatedChair
from wheelchair_gym.sim.state import FAULTS

FRONT = settings.LaserSettings(beams=271)
BACK = settings.LaserSettings(x=-0.28, yaw=math.pi, beams=181, fov=math.radians(180.0), reach=6.0)
CAMERA = settings.LaserSettings(x=0.6, beams=9, fov=math.radians(60.0), reach=3.0, range_min=0.2)
THREE = settings.SensorSettings(laser=FRONT, more_lasers=(BACK, CAMERA))
ALL = env_settings(None, model="rear_ultrasonics").sensors.ultrasonic.mounted
TWISTS = [np.array([0.4, 0.3]), np.array([0.2, -0.5]), np.array([-0.2, 0.1])]


def readings(sensors, key=5, seed=2):
    """The readings of a short drive among clutter."""
    chair = SimulatedChair(sensors=sensors)
    found = [chair.reset(cluttered(seed), key)]
    return found + [chair.drive(twist) for twist in TWISTS * 5]


def some(mounted):
    """Return sensors with the first n ultrasonics of the chair with ten."""
    return settings.SensorSettings(ultrasonic=settings.UltrasonicSettings(mounted=ALL[:mounted]))


def test_a_reading_holds_the_scans_one_after_another():
    assert THREE.beams == 271 + 181 + 9
    assert [(at.start, at.stop) for at in THREE.slices] == [(0, 271), (271, 452), (452, 461)]
    assert THREE.directions.shape == (461, 2)
    assert np.allclose(THREE.directions[271 + 90], (-1.0, 0.0))


def test_each_scanner_ranges_as_if_it_were_the_only_one():
    exact = dataclasses.replace(THREE, noise=False)
    together = readings(exact)
    for laser, at in zip(exact.lasers, exact.slices, strict=True):
        alone = readings(dataclasses.replace(exact, laser=laser, more_lasers=()))
        for one, other in zip(together, alone, strict=True):
            assert np.array_equal(one.laser[at], other.laser)


def test_further_scanners_leave_the_first_as_it_is_and_share_no_draw():
    together = readings(THREE)
    alone = readings(dataclasses.replace(THREE, more_lasers=()))
    for one, other in zip(together, alone, strict=True):
        assert np.array_equal(one.laser[:271], other.laser)
        assert np.array_equal(one.ultrasonic, other.ultrasonic)
    twice = readings(dataclasses.replace(THREE, more_lasers=(FRONT,)))[-1].laser.reshape(2, -1)
    errors = np.diff(twice, axis=0)[np.isfinite(twice).all(axis=0)[None]]
    assert np.std(errors) > 0.5 * FRONT.sigma


def test_of_several_scanners_one_fails():
    sensors = dataclasses.replace(THREE, faults=settings.FaultSettings(share=1.0, onset=(0.1, 0.1)))
    failed = set()
    for key in range(40):
        chair = placed(SimulatedChair(sensors=sensors), cluttered(2), key)
        for twist in TWISTS:
            reading = chair.drive(twist)
        dark = [bool(np.isnan(reading.laser[at]).all()) for at in sensors.slices]
        assert sum(dark) <= 1
        failed.update(np.flatnonzero(dark).tolist())
    assert failed == {0, 1, 2}


@pytest.mark.parametrize("mounted", [0, 1, 3, 8, 10])
def test_columns_of_unmounted_ultrasonics_are_invalid(mounted):
    for reading in readings(some(mounted)):
        assert reading.ultrasonic.shape == reading.age.shape == (max(8, mounted),)
        assert not np.isnan(reading.ultrasonic[:mounted]).any()
        assert np.isfinite(reading.age[:mounted]).all()
        assert np.isnan(reading.ultrasonic[mounted:]).all()
        assert (reading.age[mounted:] == math.inf).all()


@pytest.mark.parametrize("mounted", [1, 3, 10])
def test_the_mounted_ones_fire_in_their_turn(mounted):
    chair = placed(SimulatedChair(sensors=some(mounted)), cluttered(2), 5)
    for _ in range(30):
        age = chair.drive(TWISTS[0]).age[:mounted]
        assert age.max() < 0.06 * mounted


@pytest.mark.parametrize(("laser", "rangers"), [(True, False), (False, True), (False, False)])
def test_sensors_that_it_does_not_have_do_not_fail(laser, rangers):
    sensors = settings.SensorSettings(
        laser=settings.LaserSettings(beams=31 if laser else 0),
        ultrasonic=settings.UltrasonicSettings(mounted=ALL if rangers else ()),
        faults=settings.FaultSettings(share=1.0),
    )
    chair, kinds = SimulatedChair(sensors=sensors), set()
    for key in range(120):
        chair.reset(cluttered(2), key)
        kinds.add(FAULTS[int(chair.state["fault"][0])])
    present = {"laser": laser, "ultrasonic": rangers, "odometry": True}
    assert kinds == {name for name in FAULTS if present.get(name.split(" ")[0])}


def test_a_chair_without_a_laser_has_no_ranges_of_one():
    sensors = settings.SensorSettings(laser=settings.LaserSettings(beams=0))
    assert sensors.lasers == sensors.slices == ()
    assert readings(sensors)[-1].laser.shape == (0,)
