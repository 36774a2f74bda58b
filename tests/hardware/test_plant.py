"""A twin whose chair is another one than its computer believes."""

import dataclasses
import math

import numpy as np
import pytest

from wheelchair_gym.geometry.kinematics import DriveGeometry
from wheelchair_gym.hardware.boards.protocol import Command
from wheelchair_gym.hardware.chair import for_equal_wheels
from wheelchair_gym.hardware.twin.plant import Plant, PlantSettings
from wheelchair_gym.sensors.settings import SensorSettings
from wheelchair_gym.sim.settings import ChairSettings, PhysicsSettings

BELIEVED = PlantSettings(ChairSettings(), SensorSettings(noise=False), PhysicsSettings())
HIDDEN = {
    "chair": {"drive": {"wheel_ratio": 1.02}, "body": {"mass": 180.0}, "motor": {"gain": 0.8}},
    "sensors": {"laser": {"offset": 0.03}},
    "physics": {"slope": 0.02},
}


REAL = PlantSettings.read(HIDDEN, BELIEVED)


def test_a_hidden_chair_drives_otherwise_than_its_computer_believes(host):
    made = host(plant=Plant(*REAL), believed=BELIEVED[:2])
    reading = made.chair.reset()
    assert reading.laser[540] == pytest.approx(3.0 - 0.66 + 0.03, abs=2e-3)
    p = made.twin.plant.chair.parameters[0]
    assert (p["mass"], p["gain"]) == (180.0, 0.8)
    reading = made.drive_for(20, np.array([0.3, 0.0]))
    turned = made.twin.plant.pose[2]
    assert turned > 0.01 > abs(reading.pose[2])
    assert p["pull"] == pytest.approx([9.81 * math.sin(0.02), 0.0])


def test_a_host_that_knows_of_wheels_and_offset_drives_straight(host):
    laser = dataclasses.replace(BELIEVED.sensors.laser, offset=0.03)
    chair = dataclasses.replace(BELIEVED.chair, drive=DriveGeometry(wheel_ratio=1.02))
    sensors = dataclasses.replace(BELIEVED.sensors, laser=laser)
    made = host(plant=Plant(*REAL), believed=(chair, sensors))
    reading = made.chair.reset()
    assert reading.laser[540] == pytest.approx(3.0 - 0.66, abs=2e-3)
    reading = made.drive_for(20, np.array([0.3, 0.0]))
    assert abs(made.twin.plant.pose[2]) < 2e-3  # a tenth of what the wheels alone would turn
    assert np.abs(reading.pose - made.twin.plant.pose).max() < 5e-3


def test_the_command_for_unequal_wheels_turns_each_as_far():
    drive = DriveGeometry(track=0.5, wheel_ratio=1.1)
    sent = for_equal_wheels(Command(0.4, 0.2, 1), drive, 0.4)
    left, right = drive.wheel_shares
    assert sent.flags == 1
    assert (sent.v - 0.25 * sent.w) * left == pytest.approx(0.4 - 0.25 * 0.2)
    assert (sent.v + 0.25 * sent.w) * right == pytest.approx(0.4 + 0.25 * 0.2)
    assert for_equal_wheels(sent, DriveGeometry(), 0.4) is sent
