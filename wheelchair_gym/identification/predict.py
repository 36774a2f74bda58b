"""How far a simulation is from a drive: it drives the same commands, and windows are compared.

The reference is the path of the drive's own wheels by the values that `kinematics` finds in this
drive, and its scans; no setting of the simulated chair enters it.
"""

import dataclasses
import math
from collections.abc import Sequence
from typing import Any, Final, NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from wheelchair_gym.base.arrays import Array
from wheelchair_gym.base.errors import InputError
from wheelchair_gym.geometry.planar import relative_pose, to_world, wrap_angle
from wheelchair_gym.identification.fit import find_kinematics
from wheelchair_gym.identification.kinematics import DELAY, poses_at, wheel_path
from wheelchair_gym.identification.logs import Drive, DriveLog, log_of_reports
from wheelchair_gym.perception.occupancy import read_scan
from wheelchair_gym.sensors.settings import (
    LaserSettings,
    OdometrySettings,
    SensorSettings,
    UltrasonicSettings,
)
from wheelchair_gym.sim.chair import SimulatedChair
from wheelchair_gym.sim.randomization import JointRandomization, exactly
from wheelchair_gym.sim.settings import ChairSettings, PhysicsSettings
from wheelchair_gym.types import Episode

HORIZONS: Final = (1.0, 2.0, 5.0)  # s
_EVERY = 0.5  # s between the starts of two windows
_MOTOR: Final = ("torque_constant", "gain", "resistance", "current_limit")  # no board sets them
_BLIND: Final = SensorSettings(
    laser=LaserSettings(beams=0), ultrasonic=UltrasonicSettings(mounted=()),
    odometry=OdometrySettings(diameter_error=0.0, track_error=0.0, variance=0.0),
    pose_source="odometry",
)  # fmt: skip


class Prediction(NamedTuple):
    """Errors of a simulation after some seconds; pairs are the median and the 95th percentile."""

    seconds: float
    windows: int
    position: tuple[float, float]  # m
    heading: tuple[float, float]  # rad
    speed: tuple[float, float]  # m/s, of the wheels, as the board measures them
    volts: tuple[float, float]  # V at the motors
    scan: tuple[float, float]  # m from a point of the last scan to the nearest one of the first


def plant_for(chair: ChairSettings, boards: ChairSettings) -> ChairSettings:
    """Settings of a simulated chair whose boards believe other settings than those of its body.

    Args:
        chair: wheels, body and motors as they are.
        boards: those that the boards' control and counts were set up with.
    """
    true, believed = chair.drive, boards.drive
    ratio = true.wheel_ratio / believed.wheel_ratio
    errors = {
        "odometry.scale_error": believed.counts_per_metre / true.counts_per_metre - 1.0,
        "odometry.diameter_error": 2.0 * (ratio - 1.0) / (ratio + 1.0),
        "odometry.track_error": true.track / believed.track - 1.0,
    }
    motor = {name: getattr(chair.motor, name) for name in _MOTOR}
    motor["feed_constant"] = boards.motor.believed_constant
    return dataclasses.replace(
        boards, body=chair.body, battery=chair.battery, randomize=False,
        motor=dataclasses.replace(boards.motor, **motor),
        randomization=exactly(errors), joint=JointRandomization(), command_delay=0.0,
    )  # fmt: skip


def simulate(log: DriveLog, chair: ChairSettings, boards: ChairSettings) -> tuple[DriveLog, Array]:
    """Drive a simulated chair by the commands of a log, on a free and level floor.

    Returns:
        Its log, without scans, and its true poses (n, 3) at the reports.
    """
    period = 1.0 / boards.motor.control_rate  # of commands, too
    physics = PhysicsSettings(step=period / math.ceil(period / PhysicsSettings().step - 1e-9))
    simulated = SimulatedChair(plant_for(chair, boards), _BLIND, physics, period)
    nowhere: Any = None
    simulated.reset(Episode(nowhere, np.zeros(3), np.zeros(3)), 0)
    times = np.arange(log.stamps[0], log.stamps[-1], period)
    at = np.searchsorted(log.commands[:, 0], times + 0.5 * period) - 1
    wheels, poses = [simulated.wheels], [simulated.truth.pose]
    for twist in np.where(at[:, None] < 0, 0.0, log.commands[at, 1:]):
        simulated.drive(twist)
        wheels.append(simulated.wheels)
        poses.append(simulated.truth.pose)
    told = log_of_reports(np.concatenate(wheels), (), (), _BLIND, boards.drive)
    return told._replace(stamps=told.stamps + log.stamps[0]), np.array(poses)


def predict(
    drive: Drive, simulations: Sequence[tuple[ChairSettings, SensorSettings]]
) -> list[list[Prediction]]:
    """Errors of simulated chairs that drive as a recorded one was told to, by horizon.

    Args:
        drive: a log with the settings that its boards had.
        simulations: settings of each; the mount of its first scanner places the scans.

    Raises:
        InputError: see `check_commands`, or the log lacks what `fit` needs, too.
    """
    log = drive.log
    check_commands(drive)
    found = find_kinematics(
        drive.name, log, drive.chair.drive, drive.sensors.laser, np.random.default_rng(0)
    )
    path, times = wheel_path(log, found.values), log.scan_stamps - found.values[DELAY]
    predictions = []
    for chair, sensors in simulations:
        told, poses = simulate(log, chair, drive.chair)
        scans = log.ranges - np.float32(sensors.laser.offset)
        points = [read_scan(sensors.laser, scan).echoes for scan in scans]
        predictions.append([
            _compared(log, path, told, poses, times, points, seconds) for seconds in HORIZONS
        ])  # fmt: skip
    return predictions


def check_commands(drive: Drive) -> None:
    """Refuse a drive that cannot be simulated.

    Raises:
        InputError: it has no commands, or is too short for the longest of HORIZONS.
    """
    log = drive.log
    if not len(log.commands):
        raise InputError(f"{drive.name}: expected the commands of the drive; record it anew")
    if log.scan_stamps[-1] - log.scan_stamps[0] < 2.0 * HORIZONS[-1]:
        raise InputError(f"{drive.name}: expected scans of {2.0 * HORIZONS[-1]:g} s or more")


def _compared(
    log: DriveLog, path: Array, told: DriveLog, poses: Array, times: Array, points: list[Array],
    seconds: float,
) -> Prediction:  # fmt: skip
    """Compare windows between two scans, made at `times` (m,), with those of a simulation."""
    end = min(times[-1], log.stamps[-1]) - seconds
    starts = np.arange(max(times[0], log.stamps[0]), end, _EVERY)
    first = np.searchsorted(times, starts)
    last = np.searchsorted(times, times[first] + seconds)
    first, last = first[last < len(times)], last[last < len(times)]
    moved, predicted = (
        relative_pose(poses_at(of, at, times[first]), poses_at(of, at, times[last]))
        for of, at in ((log, path), (told, poses))
    )
    off = predicted - moved

    def at_ends(of: DriveLog, values: Array) -> Array:
        ends = [np.interp(times[last], of.stamps, values[:, k]) for k in range(2)]
        return np.concatenate(ends)

    scans = [
        np.median(cKDTree(points[k]).query(to_world(points[j], step))[0])
        for k, j, step in zip(first, last, predicted, strict=True)
        if len(points[k]) and len(points[j])
    ]
    return Prediction(
        seconds, len(first), _spread(np.hypot(off[:, 0], off[:, 1])),
        _spread(wrap_angle(off[:, 2])),
        _spread(at_ends(told, told.speeds) - at_ends(log, log.speeds)),
        _spread(at_ends(told, told.volts) - at_ends(log, log.volts)), _spread(np.array(scans)),
    )  # fmt: skip


def _spread(errors: Array) -> tuple[float, float]:
    """Median and 95th percentile of their sizes; NaN without any."""
    sizes = np.abs(errors[np.isfinite(errors)])
    if not len(sizes):
        return np.nan, np.nan
    return float(np.median(sizes)), float(np.percentile(sizes, 95.0))
