"""Drives of simulated chairs whose settings are hidden, as logs."""

import dataclasses
from typing import Any, NamedTuple

import numpy as np

from wheelchair_gym.base.arrays import Array
from wheelchair_gym.geometry.planar import polygon_edges, to_world
from wheelchair_gym.identification.excite import PROGRAM
from wheelchair_gym.identification.logs import DriveLog, log_of_reports
from wheelchair_gym.sensors.settings import LaserSettings, OdometrySettings, SensorSettings
from wheelchair_gym.sim.chair import SimulatedChair
from wheelchair_gym.sim.randomization import exactly
from wheelchair_gym.sim.settings import WHEEL_INERTIA, BatterySettings, ChairSettings
from wheelchair_gym.sim.settings import PhysicsSettings as Physics
from wheelchair_gym.types import Episode

PERIOD, SCAN_EVERY = 0.02, 5  # s between two reports, and reports between two scans
LASER = LaserSettings(bias=0.0)
CHAIR, SENSORS = ChairSettings(), SensorSettings(laser=LASER)


class Driven(NamedTuple):
    """A log, and the true poses (n, 3) of the chair at its reports."""

    log: DriveLog
    poses: Array


def room(start: tuple[float, float, float] = (-0.6, -0.6, 0.0)) -> Episode:
    """A room of 7 m x 6 m with a niche, cupboards and two posts."""
    corners = [(-3.4, -3.0), (3.6, -3.0), (3.6, 2.2), (2.0, 2.2), (2.0, 3.1), (-3.4, 3.1)]
    walls = [polygon_edges(corners)]
    for x, y, a, b, turn in ((-2.8, -2.3, 0.4, 0.3, 0.3), (3.0, -1.0, 0.3, 0.5, 0.0),
                             (-2.9, 1.8, 0.25, 0.25, 0.6)):  # fmt: skip
        box = np.array([(-a, -b), (a, -b), (a, b), (-a, b)])
        walls.append(polygon_edges(to_world(box, (x, y, turn))))
    discs = np.array([(2.9, 0.9, 0.15), (-1.0, 2.7, 0.2)])
    nowhere: Any = None
    return Episode(nowhere, np.array(start), np.zeros(3), walls=np.vstack(walls), discs=discs)


def drive(hidden: dict[str, float], episode: Episode | None = None, key: int = 5,
          program: Any = PROGRAM, sensors: SensorSettings = SENSORS) -> Driven:  # fmt: skip
    """Drive a chair with hidden properties, as `tests.benchmarks.identification` names them."""
    battery = BatterySettings(initial_charge=hidden.get("charge", 0.9))
    odometry = OdometrySettings(diameter_error=0.0, track_error=0.0, variance=0.0)
    sensors = dataclasses.replace(sensors, odometry=odometry, pose_source="odometry")
    physics = Physics(0.002, hidden.get("slope", 0.0), hidden.get("downhill", 0.0))
    chair = SimulatedChair(
        ChairSettings(randomization=exactly(hidden), battery=battery), sensors, physics, PERIOD
    )
    reading = chair.reset(episode or room(), key)
    wheels, scans, stamps, poses = [chair.wheels], [reading.laser], [0.0], [chair.truth.pose]
    for v, w, seconds in program:
        for _ in range(round(seconds / PERIOD)):
            reading = chair.drive(np.array([v, w]))
            if len(wheels) % SCAN_EVERY == 0:
                scans.append(reading.laser)
                stamps.append(reading.stamp)
            wheels.append(chair.wheels)
            poses.append(chair.truth.pose)
    assert not chair.truth.touched
    late = np.array(stamps)[:, None] + np.full(len(sensors.lasers), hidden.get("delay", 0.0))
    log = log_of_reports(np.concatenate(wheels), late, scans, sensors, CHAIR.drive)
    return Driven(log, np.array(poses))


def truth(hidden: dict[str, float]) -> dict[str, float]:
    """True values, by the names of a fit's findings."""
    e, scale = hidden.get("odometry.diameter_error", 0.0), hidden.get("odometry.scale_error", 0.0)
    radius = CHAIR.drive.wheel_radius * (1.0 + scale)
    mass = hidden.get("body.mass", CHAIR.body.mass)
    gain = hidden.get("motor.gain", 1.0)
    return {
        "scale": 1.0 + scale,
        "wheel_ratio": (1.0 + 0.5 * e) / (1.0 - 0.5 * e),
        "track": CHAIR.drive.track * (1.0 + hidden.get("odometry.track_error", 0.0)),
        "x": LASER.x + hidden.get("laser.x_error", 0.0),
        "y": hidden.get("laser.y_error", 0.0),
        "yaw": hidden.get("laser.yaw_error", 0.0),
        "offset": hidden.get("laser.offset_error", 0.0),
        "delay": hidden.get("delay", 0.0),
        "sigma": hidden.get("laser.sigma", LASER.sigma),
        "gain/(R m)": gain / (mass + 2.0 * WHEEL_INERTIA / radius**2),
        "torque_constant": CHAIR.motor.torque_constant,
    }
