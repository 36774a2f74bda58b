"""ROS 2 messages of a chair, its sensors and its map, as dictionaries of their fields.

rosbridge sends them as JSON; `serialized` makes CDR of them, for bags and DDS, by the definitions
of Jazzy: standard messages are the same from Humble on. Omitted fields are zero or empty. Frames
are those of REP-105: map -> odom -> base_link -> laser, ultrasonic_0, ...
Add a topic to `TOPICS`, which bags use, too, and to `connect` and `_publish` in agents/robot.py.
"""

import math
import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict
from functools import cache
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wheelchair_gym.base.arrays import Array
from wheelchair_gym.base.errors import InputError, imports, shorten
from wheelchair_gym.geometry.planar import map_to_odom
from wheelchair_gym.maps import OccupancyGrid
from wheelchair_gym.sensors.settings import LaserSettings, UltrasonicSettings

Message = dict[str, Any]
NANO: Final = 1_000_000_000
_UNMEASURED = 1e6  # variance of what is not measured, as drivers of planar robots have it
INFO, WARNING = 20, 30  # levels of rcl_interfaces/Log


def time(now: int) -> Message:
    """A builtin_interfaces/Time of an instant [ns]."""
    return {"sec": now // NANO, "nanosec": now % NANO}


def header(now: int, frame: str) -> Message:
    """A std_msgs/Header."""
    return {"stamp": time(now), "frame_id": frame}


def clock(now: int) -> Message:
    """A rosgraph_msgs/Clock."""
    return {"clock": time(now)}


def _vector(x: float, y: float, z: float = 0.0) -> Message:
    return {"x": float(x), "y": float(y), "z": float(z)}


def _quaternion(yaw: float) -> Message:
    return {"x": 0.0, "y": 0.0, "z": math.sin(0.5 * yaw), "w": math.cos(0.5 * yaw)}


def pose(where: Iterable[float]) -> Message:
    """A geometry_msgs/Pose of a pose (3,)."""
    x, y, yaw = where
    return {"position": _vector(x, y), "orientation": _quaternion(yaw)}


def pose_stamped(now: int, where: Iterable[float], frame: str = "map") -> Message:
    """A geometry_msgs/PoseStamped of a pose (3,) on the map."""
    return {"header": header(now, frame), "pose": pose(where)}


def poses(now: int, rows: ArrayLike) -> Message:
    """A geometry_msgs/PoseArray of poses (n, 3) on the map."""
    found = [pose(row) for row in np.asarray(rows, np.float64).tolist()]
    return {"header": header(now, "map"), "poses": found}


def path(now: int, points: ArrayLike) -> Message:
    """A nav_msgs/Path of points (n, 2 or 3) on the map, each with its heading to the next one."""
    places = np.asarray(points, np.float64)[:, :2]
    steps = np.diff(places, axis=0, append=places[-1:])
    yaws = np.arctan2(steps[:, 1], steps[:, 0])
    yaws[-1:] = yaws[max(0, len(yaws) - 2) :][:1]
    found = [pose_stamped(now, row) for row in np.column_stack([places, yaws]).tolist()]
    return {"header": header(now, "map"), "poses": found}


def transform(now: int, parent: str, child: str, where: Iterable[float]) -> Message:
    """A geometry_msgs/TransformStamped."""
    x, y, yaw = where
    return {
        "header": header(now, parent),
        "child_frame_id": child,
        "transform": {"translation": _vector(x, y), "rotation": _quaternion(yaw)},
    }


def frames(now: int, where: Array | None, odometry: Array) -> Message:
    """A tf2_msgs/TFMessage: odom -> base_link, and map -> odom if there is an estimate (3,)."""
    edges = [transform(now, "odom", "base_link", odometry)]
    if where is not None:
        edges.insert(0, transform(now, "map", "odom", map_to_odom(where, odometry)))
    return {"transforms": edges}


def scanner_name(number: int, first: str) -> str:
    """The topic or the frame of a scanner: /scan, /scan_1, ... or laser, laser_1, ..."""
    return f"{first}_{number}" if number else first


def mounts(
    now: int, lasers: Iterable[LaserSettings], rangers: UltrasonicSettings | None = None
) -> Message:
    """A tf2_msgs/TFMessage: base_link -> each scanner, and each ultrasonic."""
    places = {
        scanner_name(k, "laser"): (laser.x, laser.y, laser.yaw) for k, laser in enumerate(lasers)
    }
    for k, one in enumerate(rangers.mounted if rangers else ()):
        places[f"ultrasonic_{k}"] = (one.x, one.y, one.yaw)
    return {"transforms": [transform(now, "base_link", *place) for place in places.items()]}


def grid(now: int, map_: OccupancyGrid) -> Message:
    """A nav_msgs/OccupancyGrid: 0 free, 100 occupied, -1 unknown."""
    rows, columns = map_.shape
    info = {
        "map_load_time": time(now), "resolution": map_.resolution, "width": columns,
        "height": rows, "origin": pose(map_.origin),
    }  # fmt: skip
    return {"header": header(now, "map"), "info": info, "data": map_.cells.ravel()}


def scan(now: int, laser: LaserSettings, ranges: NDArray[np.float32], number: int = 0) -> Message:
    """A sensor_msgs/LaserScan of a scanner; REP-117: +inf no echo, -inf too near, NaN invalid."""
    half = 0.5 * laser.fov
    return {
        "header": header(now, scanner_name(number, "laser")),
        "angle_min": -half,
        "angle_max": half,
        "angle_increment": laser.fov / (laser.beams - 1),
        "range_min": laser.range_min,
        "range_max": laser.reach,
        "ranges": ranges,
    }


def distances(
    now: int, rangers: UltrasonicSettings, ranges: NDArray[np.float32], ages: NDArray[np.float32]
) -> dict[str, Message]:
    """A sensor_msgs/Range of each ultrasonic that has fired, by its topic, as old as it is."""
    found = {}
    values = zip(rangers.models, ranges.tolist(), ages.tolist(), strict=False)
    for k, (model, value, age) in enumerate(values):
        if not math.isfinite(age):
            continue
        found[f"/ultrasonic_{k}"] = {
            "header": header(max(0, now - round(age * NANO)), f"ultrasonic_{k}"),
            "radiation_type": 0,
            "field_of_view": model.field_of_view,
            "min_range": model.range_min,
            "max_range": model.reach,
            "range": value,
        }
    return found


def _covariance(size: int, known: Array, *axes: int) -> list[float]:
    """Return a covariance (size, size) as a list; unmeasured axes have a large variance."""
    covariance = np.diag(np.full(size, _UNMEASURED))
    covariance[np.ix_(axes, axes)] = known
    return covariance.ravel().tolist()


def odometry(
    now: int, where: Array, speed: Array, spread: tuple[Array, Array] | None = None
) -> Message:
    """A nav_msgs/Odometry of the odometry's pose (3,) and the twist (2,).

    `spread`: covariances (3, 3) and (2, 2) of both; None: zeros, which say that they are unknown.
    """
    of_pose = of_twist = [0.0] * 36
    if spread is not None:
        of_pose, of_twist = _covariance(6, spread[0], 0, 1, 5), _covariance(6, spread[1], 0, 5)
    return {
        "header": header(now, "odom"),
        "child_frame_id": "base_link",
        "pose": {"pose": pose(where), "covariance": of_pose},
        "twist": {"twist": twist(*speed.tolist()), "covariance": of_twist},
    }


def imu(now: int, turn: float, variance: float) -> Message:
    """A sensor_msgs/Imu of the turn rate [rad/s]; a covariance of -1 marks unmeasured fields."""
    return {
        "header": header(now, "base_link"),
        "orientation": _quaternion(0.0),
        "orientation_covariance": [-1.0] + [0.0] * 8,
        "angular_velocity": _vector(0.0, 0.0, turn),
        "angular_velocity_covariance": _covariance(3, np.array(variance), 2),
        "linear_acceleration": _vector(0.0, 0.0),
        "linear_acceleration_covariance": [-1.0] + [0.0] * 8,
    }


def battery(now: int, voltage: float) -> Message:
    """A sensor_msgs/BatteryState; what is not measured is NaN."""
    unknown = ("temperature", "current", "charge", "capacity", "design_capacity", "percentage")
    state = {"header": header(now, "base_link"), "voltage": voltage, "present": True}
    return state | dict.fromkeys(unknown, math.nan)


def twist(v: float, w: float) -> Message:
    """A geometry_msgs/Twist."""
    return {"linear": _vector(v, 0.0), "angular": _vector(0.0, 0.0, w)}


def twist_stamped(now: int, v: float, w: float, frame: str = "base_link") -> Message:
    """A geometry_msgs/TwistStamped."""
    return {"header": header(now, frame), "twist": twist(v, w)}


def actors(now: int, shapes: tuple[Array, Array]) -> Message:
    """A visualization_msgs/MarkerArray of actors' discs (n, 3) and segments (m, 4) [m]."""
    discs, segments = shapes
    orange = {"r": 0.9, "g": 0.5, "b": 0.2, "a": 0.9}
    common = {"header": header(now, "map"), "ns": "actors", "color": orange}
    markers: list[Message] = [common | {"action": 3}]  # deletes those of before
    for k, (x, y, r) in enumerate(discs.tolist()):
        cylinder = {"id": k, "type": 3, "pose": pose((x, y, 0.0))}
        markers.append(common | cylinder | {"scale": _vector(2.0 * r, 2.0 * r, 0.1)})
    if len(segments):
        points = [_vector(x, y) for x, y in segments.reshape(-1, 2).tolist()]
        lines = {"id": len(discs), "type": 5, "pose": pose((0.0, 0.0, 0.0)), "points": points}
        markers.append(common | lines | {"scale": _vector(0.03, 0.0)})
    return {"markers": markers}


def footprint(now: int, corners: Array) -> Message:
    """A geometry_msgs/PolygonStamped of the chair's outline (4, 2), in its own frame."""
    points = [_vector(x, y) for x, y in corners.tolist()]
    return {"header": header(now, "base_link"), "polygon": {"points": points}}


class Namespace:
    """The prefix of a robot's topics, services and frames.

    /tf, /tf_static, /clock and the frame map have none: several robots share them.

    Args:
        name: of the robot; empty: no prefix.

    Raises:
        InputError: it is no name for ROS.
    """

    def __init__(self, name: str) -> None:
        self._name = name
        if name and not re.fullmatch(r"[A-Za-z](_?[A-Za-z0-9])*", name):
            raise InputError(
                f"namespace {shorten(name)}: expected a name such as robot1: letters, digits and "
                "single underscores, a letter first"
            )

    def of(self, topic: str) -> str:
        """Return the name of a topic or a service in the namespace."""
        shared = not self._name or topic in ("/tf", "/tf_static", "/clock")
        return topic if shared else f"/{self._name}{topic}"

    def within(self, message: Any) -> Any:
        """Return a message, or a part of one, with its frames in the namespace."""
        if not self._name or not isinstance(message, (dict, list)):
            return message
        if isinstance(message, list):
            return [self.within(one) for one in message]
        framed = {
            key: f"{self._name}/{message[key]}"
            for key in ("frame_id", "child_frame_id")
            if message.get(key, "map") != "map"
        }
        return {key: self.within(value) for key, value in message.items()} | framed


class Topic(NamedTuple):
    """Type and maker of a topic's messages; `latched`: late subscribers get the last message."""

    type: str
    make: Callable[..., Message]  # of an instant [ns] and content
    latched: bool = False

    def messages(self, topic: str, now: int, *content: Any) -> dict[str, Message]:
        """Make the messages of a topic, by their topics: one, or one for each ultrasonic."""
        made = self.make(now, *content)
        return made if self.make is distances else {topic: made}


# Topics of the chair as a robot; further scanners are /scan_1, ..., ultrasonics /ultrasonic_0, ...
TOPICS: Final[dict[str, Topic]] = {
    "/clock": Topic("rosgraph_msgs/msg/Clock", clock),
    "/tf": Topic("tf2_msgs/msg/TFMessage", frames),
    "/tf_static": Topic("tf2_msgs/msg/TFMessage", mounts, latched=True),
    "/map": Topic("nav_msgs/msg/OccupancyGrid", grid, latched=True),
    "/scan": Topic("sensor_msgs/msg/LaserScan", scan),
    "/ultrasonic": Topic("sensor_msgs/msg/Range", distances),
    "/odom": Topic("nav_msgs/msg/Odometry", odometry),
    "/imu": Topic("sensor_msgs/msg/Imu", imu),
    "/battery_state": Topic("sensor_msgs/msg/BatteryState", battery),
    "/goal_pose": Topic("geometry_msgs/msg/PoseStamped", pose_stamped, latched=True),
    "/footprint": Topic("geometry_msgs/msg/PolygonStamped", footprint, latched=True),
}


def general(topic: str) -> str:
    """Return the name in `TOPICS` of a topic, which may have a number."""
    name, _, number = topic.rpartition("_")
    return name if number.isdigit() else topic


@cache
def typestore() -> Any:
    """The definitions of messages, as a typestore of rosbags.

    Raises:
        InputError: the extra 'ros' is not installed.
    """
    with imports("messages of ROS 2 need", "ros"):
        from rosbags.typesys import Stores, get_typestore
    return get_typestore(Stores.ROS2_JAZZY)


@cache
def _maker(kind: str) -> Callable[[Mapping[str, Any]], Any]:
    """A function that makes messages of a type of dictionaries; what they lack is zero or empty."""
    store = typestore()
    makers = {name: _field(*definition) for name, definition in store.fielddefs[kind][1]}
    cls = store.types[kind]
    return lambda values: cls(**{name: make(values.get(name)) for name, make in makers.items()})


def _field(node: Any, definition: Any) -> Callable[[Any], Any]:
    """A function that makes a field of a value, or of None."""
    from rosbags.interfaces import Nodetype

    if node == Nodetype.NAME:
        make = _maker(definition)
        return lambda value: make(value or {})
    if node == Nodetype.BASE:
        of: Any = {"string": str, "bool": bool}.get(definition[0])
        of = of or (float if definition[0].startswith("float") else int)
        return lambda value: of() if value is None else of(value)
    (inner, name), length = definition
    if inner == Nodetype.BASE and name[0] != "string":
        dtype = np.dtype("uint8" if name[0] in ("byte", "char") else name[0])
        return lambda value: (
            np.zeros(length, dtype) if value is None else np.ascontiguousarray(value, dtype)
        )
    each = _field(inner, name)
    return lambda value: [each(item) for item in value or ()]


def serialized(kind: str, message: Mapping[str, Any]) -> Any:
    """A message of a type as CDR."""
    return typestore().serialize_cdr(_maker(kind)(message), kind)


def deserialized(kind: str, data: bytes) -> dict[str, Any]:
    """A message of a type, of CDR; for damaged bytes, rosbags raises whatever it raises."""
    return asdict(typestore().deserialize_cdr(data, kind))
