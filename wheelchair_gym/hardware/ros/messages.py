"""The content of ROS messages, as rosbridge writes them: checked, in our units and types.

Every function raises KeyError, TypeError or ValueError where a message is malformed; a ValueError's
text says what was expected.
"""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from wheelchair_gym.base.arrays import Array
from wheelchair_gym.maps import FREE, OCCUPIED, UNKNOWN, OccupancyGrid
from wheelchair_gym.sensors.settings import LaserSettings

_MAX_TILT = 0.3  # rad: maximum roll or pitch of a chair on a floor
_MAX_STAMP = 1 << 32  # s: ROS uses 32 bits
_MAX_BEAMS = 20_000
_FREE, _OCCUPIED = 25, 65  # %: cells of a map up to it, and from it on: map_saver


def stamp(header: Mapping[str, Any]) -> float:
    """When a message was made [s], by its maker's clock; NaN: unknown."""
    return seconds(header["stamp"]) or math.nan


def frame(message: Mapping[str, Any]) -> str:
    """Return the frame of a message with a header, without the slash that ROS 1 allows."""
    return str(message["header"]["frame_id"]).lstrip("/")


def seconds(time: Mapping[str, Any]) -> float:
    """A builtin_interfaces/Time [s]."""
    second = time["secs"] if "secs" in time else time["sec"]  # ROS 1 and 2
    part = time["nsecs"] if "nsecs" in time else time["nanosec"]
    if not (0 <= second < _MAX_STAMP and 0 <= part < 1e9):  # false of NaN, too
        raise ValueError(
            f"is stamped {second!r:.20} s, {part!r:.20} ns; expected 0 to {_MAX_STAMP} s and "
            "< 1e9 ns"
        )
    return float(second) + 1e-9 * float(part)


def _finite(*values: Any) -> tuple[float, ...]:
    numbers = tuple(float(value) for value in values)
    if not all(map(math.isfinite, numbers)):
        raise ValueError(f"holds {values}; expected finite numbers")
    return numbers


def _pose(message: Mapping[str, Any]) -> Array:
    """Return the pose (3,) of an upright geometry_msgs/Pose."""
    pose, upside_down = on_floor(_matrix(message["position"], message["orientation"]))
    if upside_down:
        raise ValueError("is upside down; expected a rotation about z")
    return pose


def scan(message: Mapping[str, Any], laser: LaserSettings, null: float) -> NDArray[np.float32]:
    """Ranges (beams,) [m] of a sensor_msgs/LaserScan, as in `Reading.laser` (REP-117).

    Beams may come in either order, in any number, and over a wider fan or the whole circle: each
    beam of the settings gets the smallest of the ranges next to it. A fan that is too small is an
    error.

    Args:
        message: as received.
        laser: its settings.
        null: the value of a null range: JSON has neither NaN nor infinity.

    A scan of nulls alone is an error: no echo anywhere looks like a broken sensor.
    """
    message = upright(message)
    ranges = np.array(message["ranges"], dtype=np.float64)  # None becomes NaN
    first, step = _finite(message["angle_min"], message["angle_increment"])
    nearest, farthest = float(message["range_min"]), float(message["range_max"])
    if ranges.ndim != 1 or not (math.isfinite(nearest) and farthest > nearest):
        raise ValueError(
            f"has ranges from {nearest:g} to {farthest:g} m; expected a list of numbers, and a "
            "maximum above the minimum"
        )
    missing = np.array([value is None for value in message["ranges"]])
    if missing.all():
        raise ValueError("has no range that is a number: JSON does not say why")
    out = np.where(ranges > min(farthest, laser.reach), np.inf, ranges)
    out = np.where(ranges < nearest, -np.inf, out)
    out = np.where(ranges == 0.0, np.nan, out)  # drivers older than REP-117: an error
    return _resampled(np.where(missing, null, out).astype(np.float32), first, step, laser)


def _resampled(
    ranges: NDArray[np.float32], first: float, step: float, laser: LaserSettings
) -> NDArray[np.float32]:
    """Ranges (beams,) at a laser's beams, of ranges (n,) from a first angle on, a step apart."""
    angles = first + step * np.arange(len(ranges))
    turn = 2.0 * np.pi / step  # steps of a whole turn
    ahead = np.mod((laser.angles - first) / step + 0.5, turn)  # of half a step before theirs
    near = ahead.astype(np.int64)
    if len(ranges) == laser.beams:  # rounded angles: an end may lie up to a step off
        near[near == laser.beams] -= 1
        near[(near > laser.beams) & (ahead > turn - 1.0)] = 0
    if not (near < len(ranges)).all():
        raise ValueError(
            f"looks from {math.degrees(first):.1f} over "
            f"{math.degrees(angles[-1] - first):.1f} deg; "
            f"expected {math.degrees(-0.5 * laser.fov):.1f} over {math.degrees(laser.fov):.1f} "
            "(laser.fov), or more"
        )
    out = ranges[near]
    spacing = laser.fov / (laser.beams - 1)
    mine = np.mod(angles + 0.5 * laser.fov + 0.5 * spacing, 2.0 * np.pi) / spacing
    kept = mine < laser.beams
    np.fmin.at(out, mine[kept].astype(np.int64), ranges[kept])  # of NaN and a number, the number
    return out


def odometry(message: Mapping[str, Any]) -> tuple[Array, Array]:
    """Pose (3,) [m, m, rad] and twist (2,) [m/s, rad/s] of a nav_msgs/Odometry."""
    twist = message["twist"]["twist"]
    speed = np.array(_finite(twist["linear"]["x"], twist["angular"]["z"]))
    return _pose(message["pose"]["pose"]), speed


def transforms(message: Mapping[str, Any]) -> list[tuple[str, str, Array]]:
    """Parent, child and homogeneous matrix (4, 4) of each transform of a tf2_msgs/TFMessage.

    A transform whose values are unusable is NaN, so that callers that need it can say so. One that
    is not made as its type says is skipped, unless there is no other.
    """
    found: list[tuple[str, str, Array]] = []
    broken: Exception | None = None
    for edge in message["transforms"]:
        try:
            parent, child = str(edge["header"]["frame_id"]), str(edge["child_frame_id"])
            matrix = _matrix(edge["transform"]["translation"], edge["transform"]["rotation"])
            found.append((parent.lstrip("/"), child.lstrip("/"), matrix))
        except (KeyError, TypeError) as error:
            broken = error
    if broken is not None and not found:
        raise broken
    return found


def _matrix(place: Mapping[str, Any], turn: Mapping[str, Any]) -> Array:
    """Return the homogeneous matrix (4, 4) of a position and a quaternion; NaN where unusable."""
    numbers = [*(place[axis] for axis in "xyz"), *(turn[axis] for axis in "xyzw")]
    values, matrix = np.array(numbers, dtype=np.float64), np.eye(4)
    if not np.isfinite(values).all() or abs(np.linalg.norm(values[3:]) - 1.0) > 0.01:
        return np.full((4, 4), np.nan)
    matrix[:3, :3], matrix[:3, 3] = Rotation.from_quat(values[3:]).as_matrix(), values[:3]
    return matrix


def way_up(edges: Mapping[str, tuple[str, Array]], frame: str) -> dict[str, Array]:
    """Return the matrix (4, 4) of a frame in itself and in all frames above it, upwards.

    Edges are parent and matrix of each frame; a cycle ends the way.
    """
    matrix = np.eye(4)
    found = {frame: matrix}
    while frame in edges and edges[frame][0] not in found:
        frame, edge = edges[frame]
        found[frame] = matrix = edge @ matrix
    return found


def on_floor(matrix: Array) -> tuple[Array, bool]:
    """Return the pose (3,) that a matrix (4, 4) has on the floor, and whether it is upside down.

    Raises:
        ValueError: the matrix is NaN, or neither upright nor upside down.
    """
    if not np.isfinite(matrix).all():
        raise ValueError("has a pose that is not finite, or whose quaternion's norm is not 1")
    up = float(matrix[2, 2])
    if abs(up) < math.cos(_MAX_TILT):
        tilt = math.degrees(math.acos(up))
        raise ValueError(f"is tilted by {tilt:.0f} deg; expected upright or upside down")
    yaw = math.atan2(matrix[1, 0], matrix[0, 0])
    return np.array([matrix[0, 3], matrix[1, 3], yaw]), up < 0.0


def upright(message: Mapping[str, Any], upside_down: bool = False) -> dict[str, Any]:
    """Return a scan as an upright laser gives it, with its beams counter-clockwise.

    Raises:
        ValueError: the scan has too few or too many ranges, or no step between their angles.
    """
    found, ranges = dict(message), message["ranges"]
    first, step = float(message["angle_min"]), float(message["angle_increment"])
    if not 2 <= len(ranges) <= _MAX_BEAMS or step == 0.0 or not math.isfinite(step):
        raise ValueError(
            f"has {len(ranges)} ranges; expected 2 to {_MAX_BEAMS}, with a step ({step:g} rad)"
        )
    if upside_down:
        first, step, found["angle_max"] = -first, -step, -message["angle_max"]
    if step < 0.0:
        found["angle_max"], found["ranges"] = first, ranges[::-1]
        first, step = first + step * (len(ranges) - 1), -step
    return found | {"angle_min": first, "angle_increment": step}


def distance(message: Mapping[str, Any], null: float) -> float:
    """The range [m] of a sensor_msgs/Range, as in `Reading.ultrasonic` (REP-117).

    Args:
        message: as received.
        null: the value of a null range, see `scan`.
    """
    value = message["range"]
    if value is None:
        return null
    if math.isnan(value):
        return math.nan
    nearest, farthest = _finite(message["min_range"], message["max_range"])
    return math.inf if value > farthest else -math.inf if value < nearest else float(value)


def voltage(message: Mapping[str, Any]) -> float:
    """The voltage [V] of a sensor_msgs/BatteryState."""
    return _finite(message["voltage"])[0]


def grid(message: Mapping[str, Any]) -> OccupancyGrid:
    """The map of a nav_msgs/OccupancyGrid."""
    info = message["info"]
    rows, cols = int(info["height"]), int(info["width"])
    values = np.array(message["data"], dtype=np.int16)
    if rows < 1 or cols < 1 or values.shape != (rows * cols,):
        raise ValueError(f"has {values.size} cells; expected {rows} x {cols}, at least one")
    if values.min() < -1 or values.max() > 100:
        raise ValueError("has cells beyond -1 to 100")
    cells = np.full(values.shape, UNKNOWN, np.int8)
    cells[(values >= 0) & (values <= _FREE)] = FREE
    cells[values >= _OCCUPIED] = OCCUPIED
    x, y, yaw = _pose(info["origin"]).tolist()
    return OccupancyGrid(cells.reshape(rows, cols), _finite(info["resolution"])[0], (x, y, yaw))
