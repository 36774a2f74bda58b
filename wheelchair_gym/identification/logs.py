"""Logs of drives, as identification takes them: recordings, ROS 2 bags, BreezySLAM's files."""

import dataclasses
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.base.arrays import Array
from wheelchair_gym.base.errors import InputError
from wheelchair_gym.geometry.kinematics import DriveGeometry
from wheelchair_gym.perception import logs
from wheelchair_gym.recording.read_bags import bag_log, is_bag, is_ours
from wheelchair_gym.recording.replay import RecordedEpisode, read_recording
from wheelchair_gym.sensors.settings import SensorSettings
from wheelchair_gym.sim.settings import ChairSettings

_LEAP = 0.5  # m between two reports of a wheel: its counter began anew


class Scans(NamedTuple):
    """Scans of one scanner."""

    stamps: Array  # (m,) s
    ranges: NDArray[np.float32]  # (m, beams) m, raw: the config's offset is not subtracted


class DriveLog(NamedTuple):
    """Wheels and scans of a drive, in the time of one clock."""

    stamps: Array  # (n,) s, of the reports about the wheels
    travel: Array  # (n, 2) m, of the left and right wheel since the first, by the config's counts
    speeds: Array  # (n, 2) m/s of the wheels, as the board measures them; NaN where unknown
    volts: Array  # (n, 2) V at the motors: duty times battery; NaN where unknown
    commands: Array  # (k, 3) s, m/s, rad/s: from when on the board had each command; () if unknown
    scan_stamps: Array  # (m,) s, of the first scanner
    ranges: NDArray[np.float32]  # (m, beams) m, raw, likewise
    more: tuple[Scans, ...] = ()  # of further scanners, where they were recorded


def log_of_reports(
    wheels: NDArray[np.void], scan_stamps: Any, readings: Any, sensors: SensorSettings,
    drive: DriveGeometry,
) -> DriveLog:  # fmt: skip
    """The log of a drive from reports (n,) of WHEELS, with the sensors and wheels of the config.

    Stamps are (m, scanners) [s], readings (m, beams of all scanners) [m] without the offsets of the
    config.
    """
    at = np.unique(wheels["stamp"], return_index=True)[1]
    rows: Any = wheels[at]
    acting = rows["duties"] * rows["voltage"][:, None]
    volts = np.stack(
        [np.interp(rows["stamp"], rows["duty_stamp"], acting[:, k]) for k in range(2)], axis=1
    )
    travel = (rows["counts"] - rows["counts"][0]) / drive.counts_per_metre
    twists = rows["command"]
    new = np.append(True, np.any(twists[1:] != twists[:-1], axis=1))
    commands = np.column_stack([rows["stamp"] - rows["age"], twists])[new]
    scans = [Scans(np.empty(0), np.empty((0, 0), np.float32))] if not sensors.lasers else []
    for k, (laser, beams) in enumerate(zip(sensors.lasers, sensors.slices, strict=True)):
        stamps, once = np.unique(np.asarray(scan_stamps)[:, k], return_index=True)
        scans.append(Scans(stamps, np.asarray(readings)[once, beams] + np.float32(laser.offset)))
    first, *more = scans
    return DriveLog(
        rows["stamp"], travel, rows["speeds"], volts, commands, first.stamps, first.ranges,
        tuple(more),
    )  # fmt: skip


class Drive(NamedTuple):
    """A log and the settings that it was recorded with."""

    name: str
    log: DriveLog
    chair: ChairSettings
    sensors: SensorSettings


def _of_recording(file: str | Path, recorded: RecordedEpisode) -> Drive:
    """The log of an episode of a recording."""
    settings = recorded.settings
    drive = settings.chair.drive
    if not settings.sensors.laser.beams:
        raise InputError(f"{file}: expected the scans of a laser; the chair has none")
    if not recorded.wheels or not sum(len(each["reports"]) for each in recorded.wheels):
        raise InputError(f"{file}: expected reports about the wheels (/wheels); record it anew")
    wheels = np.concatenate([each["reports"] for each in recorded.wheels])
    leaps = np.abs(np.diff(wheels["counts"], axis=0)).max(initial=0) / drive.counts_per_metre
    if leaps > _LEAP:
        raise InputError(f"{file}: the wheels' counts leap by {leaps:.1f} m; cut the log there")
    if (n := len(recorded.wheels)) != (k := len(recorded.states)):
        raise InputError(f"{file}: expected a message of /wheels with each reading; {n} with {k}")
    stamps = [each["scans"] for each in recorded.wheels]
    readings = [state.reading.laser for state in recorded.states]
    log = log_of_reports(wheels, stamps, readings, settings.sensors, drive)
    return Drive(f"{file}, episode {recorded.number}", log, settings.chair, settings.sensors)


def _of_odometry(log: logs.SensorLog, track: float) -> DriveLog:
    """The log of odometry at the scans, by the track that its robot believed in [m]."""
    forward, turn = log.increments[:, 0], log.increments[:, 2]
    distance = forward / np.maximum(np.cos(0.5 * turn), 0.5)
    ways = np.stack([distance - 0.5 * track * turn, distance + 0.5 * track * turn], axis=1)
    travel = np.cumsum(ways, axis=0)
    unknown = np.full_like(travel, np.nan)
    return DriveLog(
        log.stamps, travel - travel[0], unknown, unknown, np.empty((0, 3)), log.stamps, log.ranges
    )


def read_drives(file: str | Path, chair: ChairSettings, sensors: SensorSettings) -> list[Drive]:
    """Drives of a recording, of a ROS 2 bag of any robot, or of a log of BreezySLAM (.dat).

    Args:
        file: the log.
        chair: of a robot whose log has no settings; the odometry of a bag was made with its track.
        sensors: likewise; the scanner is that of the log.

    Raises:
        InputError: the file cannot be read, or lacks wheels or scans.
    """
    if Path(file).suffix == ".dat":
        found, laser = logs.read_log(file), logs.LASER
        drive = dataclasses.replace(chair.drive, track=logs.TRACK)
        chair = dataclasses.replace(chair, drive=drive)
    elif is_bag(file) and not is_ours(file):
        found, laser = bag_log(file)
    else:
        return [_of_recording(file, recorded) for recorded in read_recording(file)]
    log = _of_odometry(found, chair.drive.track)
    return [Drive(str(file), log, chair, dataclasses.replace(sensors, laser=laser))]
