"""What ROS messages say, as rosbridge writes them: checked, in our units and types.

Every function raises KeyError, TypeError or ValueError where a message is not what it should be; a
ValueError's text says what was expected.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.maps import FREE, OCCUPIED, UNKNOWN, OccupancyGrid
from wheelchair_gym.sensors.settings import LaserSettings

Array = NDArray[np.float64]

_ASKEW = 0.3  # rad: roll or pitch beyond is not a chair on a floor
_LATEST = 1 << 32  # s: ROS keeps 32 bits
_NEAR = 1e-3  # rad: angles that are rounded to float32 are the same


def stamp(header: Mapping[str, Any]) -> float:
    """When a message was made [s], by its maker's clock; NaN if it does not say."""
    return seconds(header["stamp"]) or math.nan


def seconds(time: Mapping[str, Any]) -> float:
    """A builtin_interfaces/Time [s]."""
    second = time["secs"] if "secs" in time else time["sec"]  # ROS 1 and 2
    part = time["nsecs"] if "nsecs" in time else time["nanosec"]
    if not (0 <= second < _LATEST and 0 <= part < 1e9):  # false of NaN, too
        raise ValueError(
            f"is stamped {second!r:.20} s, {part!r:.20} ns; expected 0 to {_LATEST} s and < 1e9 ns"
        )
    return float(second) + 1e-9 * float(part)


def _finite(*values: Any) -> tuple[float, ...]:
    numbers = tuple(float(value) for value in values)
    if not all(map(math.isfinite, numbers)):
        raise ValueError(f"holds {values}; expected finite numbers")
    return numbers


def _yaw(turned: Mapping[str, Any]) -> float:
    x, y, z, w = _finite(*(turned[name] for name in "xyzw"))
    if abs(math.sqrt(x * x + y * y + z * z + w * w) - 1.0) > 0.01:
        raise ValueError("holds a quaternion whose norm is not 1")
    if math.acos(max(-1.0, 1.0 - 2.0 * (x * x + y * y))) > _ASKEW:
        raise ValueError("says that the chair is not upright; expected a turn about z")
    return math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))


def _pose(place: Mapping[str, Any], turned: Mapping[str, Any]) -> Array:
    x, y = _finite(place["x"], place["y"])
    return np.array([x, y, _yaw(turned)])


def scan(message: Mapping[str, Any], laser: LaserSettings, silent: float) -> NDArray[np.float32]:
    """Ranges (beams,) [m] of a sensor_msgs/LaserScan, as in `Reading.laser`.

    Args:
        message: as it came.
        laser: what the settings say of it; another number or fan of beams is an error.
        silent: what a beam that is null stands for: JSON can neither say NaN nor infinity.

    A scan of nulls alone is an error: no echo anywhere and a broken sensor look alike in it.
    """
    ranges = np.array(message["ranges"], dtype=np.float64)  # None becomes NaN
    if ranges.shape != (laser.beams,):
        raise ValueError(f"has {ranges.size} ranges; expected {laser.beams} (laser.beams)")
    first, step = _finite(message["angle_min"], message["angle_increment"])
    begin, fan = first + 0.5 * laser.fov, step * (laser.beams - 1)
    if abs(fan - laser.fov) > abs(step) + _NEAR or abs(begin) > abs(step) + _NEAR:
        raise ValueError(
            f"looks from {math.degrees(first):.1f} over {math.degrees(fan):.1f} deg; expected "
            f"{math.degrees(-0.5 * laser.fov):.1f} over {math.degrees(laser.fov):.1f} (laser.fov)"
        )
    nearest, farthest = _finite(message["range_min"], message["range_max"])
    null = np.array([value is None for value in message["ranges"]])
    if null.all():
        raise ValueError("has no range that is a number: JSON cannot say what its sensor meant")
    out = np.where(ranges > min(farthest, laser.reach), np.inf, ranges)
    out = np.where(ranges < nearest, -np.inf, out)
    out = np.where(ranges == 0.0, np.nan, out)  # drivers older than REP-117: an error
    return np.where(null, silent, out).astype(np.float32)


def odometry(message: Mapping[str, Any]) -> tuple[Array, Array]:
    """Pose (3,) [m, m, rad] and twist (2,) [m/s, rad/s] of a nav_msgs/Odometry."""
    placed, twist = message["pose"]["pose"], message["twist"]["twist"]
    pose = _pose(placed["position"], placed["orientation"])
    return pose, np.array(_finite(twist["linear"]["x"], twist["angular"]["z"]))


def transforms(message: Mapping[str, Any]) -> list[tuple[str, str, Array]]:
    """Parent, child and pose (3,) of each transform of a tf2_msgs/TFMessage.

    One that cannot be read costs itself only, unless there is no other.
    """
    found: list[tuple[str, str, Array]] = []
    broken: Exception | None = None
    for edge in message["transforms"]:
        try:
            parent, child = str(edge["header"]["frame_id"]), str(edge["child_frame_id"])
            move = edge["transform"]
            pose = _pose(move["translation"], move["rotation"])
        except ValueError:  # a camera on its side is of no interest; one that matters is missed
            continue
        except (KeyError, TypeError) as error:
            broken = error
            continue
        found.append((parent.lstrip("/"), child.lstrip("/"), pose))
    if broken is not None and not found:
        raise broken
    return found


def distance(message: Mapping[str, Any], silent: float) -> float:
    """The range [m] of a sensor_msgs/Range, as in `Reading.ultrasonic` (REP-117).

    Args:
        message: as it came.
        silent: what a range that is null stands for, see `scan`.
    """
    value = message["range"]
    if value is None:
        return silent
    if math.isnan(value):
        return math.nan
    nearest, farthest = _finite(message["min_range"], message["max_range"])
    return math.inf if value > farthest else -math.inf if value < nearest else float(value)


def voltage(message: Mapping[str, Any]) -> float:
    """The voltage [V] of a sensor_msgs/BatteryState."""
    return _finite(message["voltage"])[0]


def grid(message: Mapping[str, Any], free: int, occupied: int) -> OccupancyGrid:
    """The map of a nav_msgs/OccupancyGrid.

    Args:
        message: as it came.
        free: up to so many percent a cell is free.
        occupied: from so many percent on a cell is occupied.
    """
    info = message["info"]
    rows, cols = int(info["height"]), int(info["width"])
    told = np.array(message["data"], dtype=np.int16)
    if rows < 1 or cols < 1 or told.shape != (rows * cols,):
        raise ValueError(f"has {told.size} cells; expected {rows} x {cols}, some at least")
    if told.min() < -1 or told.max() > 100:
        raise ValueError("has cells beyond -1 to 100")
    cells = np.full(told.shape, UNKNOWN, np.int8)
    cells[(told >= 0) & (told <= free)] = FREE
    cells[told >= occupied] = OCCUPIED
    x, y, yaw = _pose(info["origin"]["position"], info["origin"]["orientation"]).tolist()
    return OccupancyGrid(cells.reshape(rows, cols), _finite(info["resolution"])[0], (x, y, yaw))
