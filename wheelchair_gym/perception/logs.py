"""Logs in BreezySLAM's format: encoders and scans of a real robot, one line a scan.

A line holds the time [us], the ticks of the left and right wheel in columns 2 and 3 (counted from
0), and from column 24 on the ranges [mm] from right to left. The robot of its examples (Mines
ParisTech) carries a URG-04LX.
"""

import math
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.base.arrays import Array
from wheelchair_gym.base.files import read_text
from wheelchair_gym.base.settings import InputError
from wheelchair_gym.geometry.kinematics import odometric_step, twist_of_wheels
from wheelchair_gym.geometry.planar import relative_pose, wrap_angle
from wheelchair_gym.sensors.settings import LaserSettings

# Of BreezySLAM's MinesRover: radius of a wheel and distance between the wheels [m], encoder ticks
# per turn of a wheel, and columns of the left and right wheel's ticks and of the first range.
_RADIUS, TRACK, _TICKS, _LEFT, _RIGHT, _RANGES = 0.077, 0.330, 2000, 2, 3, 24
_MAXIMUM = 5.0  # m/s: rim speed above which a line is rejected
_WIDTHS = (1 << 16, 1 << 32)  # ticks after which counters of 16 and 32 bits begin again
PER_TICK = 2.0 * math.pi * _RADIUS / _TICKS  # m
# URG-04LX: 240 deg, below 20 mm stand error codes; mounted as in BreezySLAM.
LASER = LaserSettings(
    x=0.145,
    beams=682,
    fov=math.radians(681 * 360.0 / 1024.0),
    reach=5.6,
    range_min=0.02,
    sigma=0.03,
    dropout=0.0,
    bias=0.0,
)
_COLUMNS = _RANGES + LASER.beams

_NONE: Mapping[str, int] = MappingProxyType({})


class SensorLog(NamedTuple):
    """Odometry and scans that a robot recorded, and the lines that were skipped."""

    stamps: Array  # (n,) s since the first line
    increments: Array  # (n, 3) m, m, rad: driven since the line before, in the frame there
    ranges: NDArray[np.float32]  # (n, beams) m; NaN where invalid
    skipped: Mapping[str, int]  # reason -> lines

    @property
    def odometry(self) -> Array:
        """Dead-reckoned poses (n, 3) [m, m, rad], from the origin."""
        x, y, yaw = 0.0, 0.0, 0.0
        poses = np.empty((len(self.stamps), 3))
        for k, (dx, dy, turn) in enumerate(self.increments):
            c, s = math.cos(yaw), math.sin(yaw)
            x, y, yaw = x + c * dx - s * dy, y + s * dx + c * dy, yaw + turn
            poses[k] = x, y, yaw
        return poses


def log_of_poses(
    stamps: Array, poses: Array, ranges: NDArray[np.float32], skipped: Mapping[str, int] = _NONE
) -> SensorLog:
    """A log of the odometry's poses (n, 3) at each scan.

    Stamps and poses are rounded to 1e-9 s, m and rad: ROS keeps no more of a time, and its
    quaternion not the last bit of a heading. A recording and its ROS 2 bag then give the same log.
    """
    stamps, poses = np.round(stamps, 9), np.array(poses)
    poses[:, 2] = wrap_angle(poses[:, 2])
    poses = np.round(poses, 9)
    increments = relative_pose(np.concatenate([poses[:1], poses[:-1]]), poses)
    return SensorLog(np.round(stamps - stamps[0], 9), increments, ranges, skipped)


def _numbers(line: str) -> Array | str:
    """The values of a line, or the reason why it is skipped."""
    fields = line.split()
    if len(fields) < _COLUMNS:
        return "truncated"
    try:
        values = np.array(fields, dtype=np.float64)
    except ValueError:
        return "not a number"
    values = values[:_COLUMNS]
    return values if np.isfinite(values).all() else "not finite"


def _unwrapped(moved: float, bound: float) -> float:
    """Return a wheel's distance [m] without the wrap of its counter, if only that explains it."""
    turns = (s * w * PER_TICK for w in _WIDTHS for s in (-1, 1) if w * PER_TICK > 2.0 * bound)
    return next((moved + turn for turn in turns if abs(moved + turn) <= bound < abs(moved)), moved)


def read_log(path: str | Path) -> SensorLog:
    """Read a log; a bad line is skipped, counted and given a reason.

    The wrap of a counter of 16 or 32 bits is undone.

    Raises:
        InputError: the file cannot be read, holds no good line, or its ticks leap and stay there.
    """
    skipped: Counter[str] = Counter()
    stamps, increments, scans = [], [], []
    last: tuple[float, float, float] | None = None
    leapt: tuple[float, float, float] | None = None  # the line before, if its ticks leapt
    for number, line in enumerate(read_text(path, "log").splitlines(), 1):
        if not line.strip():
            continue
        values = _numbers(line)
        if isinstance(values, str):
            skipped[values] += 1
            continue
        time = float(values[0]) * 1e-6
        left = float(values[_LEFT]) * PER_TICK
        right = float(values[_RIGHT]) * PER_TICK
        if last is not None:
            period = time - last[0]
            if period <= 0.0:
                skipped["time goes back"] += 1
                continue
            bound = _MAXIMUM * period
            moved = [_unwrapped(wheel, bound) for wheel in (left - last[1], right - last[2])]
            if leapt is not None and time > leapt[0]:
                since = max(abs(left - leapt[1]), abs(right - leapt[2]))
                if since / (time - leapt[0]) < max(map(abs, moved)) / period:
                    raise InputError(
                        f"{path}, line {number - 1}: the wheels' ticks leap by "
                        f"{max(map(abs, moved)):.2f} m and stay there; expected counters that are "
                        "never reset (cut the log there)"
                    )
            if max(map(abs, moved)) > bound:
                skipped["ticks leap"] += 1
                leapt = (time, left, right)
                continue
            distance, turn = twist_of_wheels(moved[0], moved[1], TRACK)
            increments.append(odometric_step(0.0, 0.0, 0.0, distance, turn))
        else:
            increments.append((0.0, 0.0, 0.0))
        ranges = values[_RANGES:] * 1e-3
        scans.append(np.where(ranges < LASER.range_min, np.nan, ranges).astype(np.float32))
        last, leapt = (time, left, right), None
        stamps.append(time)
    if not stamps:
        why = ", ".join(f"{count} {reason}" for reason, count in skipped.items()) or "it is empty"
        raise InputError(
            f"{path}: no line is a scan ({why}); expected {_COLUMNS} numbers a line: time [us], "
            f"ticks in columns {_LEFT} and {_RIGHT}, {LASER.beams} "
            f"ranges [mm] from column {_RANGES}"
        )
    seconds = np.array(stamps) - stamps[0]
    return SensorLog(seconds, np.array(increments), np.stack(scans), dict(skipped))
