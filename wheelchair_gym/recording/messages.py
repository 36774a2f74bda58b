"""Foxglove's typed messages of a chair, its sensors and its map, for viewers.

They are made of the ROS 2 messages of a bag, with the same frames: map -> odom -> base_link ->
laser, ultrasonic_0, ...; the pose source sets the first transform, odometry changes the second, and
the mounts are static.
"""

import math
from collections.abc import Callable, Iterable, Mapping
from functools import cache
from typing import Any, Final

import numpy as np
from foxglove import channels
from foxglove import messages as m
from numpy.typing import ArrayLike, NDArray

from wheelchair_gym.base.arrays import Array
from wheelchair_gym.hardware.ros import make_messages as ros
from wheelchair_gym.recording.write_bags import topic_of
from wheelchair_gym.rendering.palette import CHAIR, NARROW, PERSON, TRAIL, WIDE, Colour
from wheelchair_gym.sensors.settings import SCANNERS, UltrasonicSettings

_ARC = 9  # points on the arc of a cone
_TRIANGLES = [corner for k in range(1, _ARC) for corner in (0, k, k + 1)]  # of a cone
_LINE = 0.03  # m: thickness of lines
# Foxglove's classes of the parts of ROS messages that have these fields.
_PARTS: Final[dict[tuple[str, ...], Callable[..., Any]]] = {
    ("sec", "nanosec"): lambda sec, nanosec: m.Timestamp(sec, nanosec),
    ("x", "y", "z"): m.Vector3,
    ("x", "y", "z", "w"): m.Quaternion,
    ("position", "orientation"): m.Pose,
}


def _part(value: Any) -> Any:
    """Convert a part of a ROS message to Foxglove's class."""
    if not isinstance(value, dict):
        return value
    return _PARTS[tuple(value)](**{name: _part(item) for name, item in value.items()})


def _head(header: ros.Message) -> dict[str, Any]:
    """Return time and frame of a std_msgs/Header."""
    return {"timestamp": _part(header["stamp"]), "frame_id": header["frame_id"]}


def _edge(message: ros.Message) -> Any:
    """Convert a geometry_msgs/TransformStamped."""
    head = _head(message["header"])
    parent, child = head.pop("frame_id"), message["child_frame_id"]
    ends = {"parent_frame_id": parent, "child_frame_id": child}
    moved = {name: _part(part) for name, part in message["transform"].items()}
    return m.FrameTransform(**head, **ends, **moved)


def _colour(colour: Colour, alpha: float = 1.0) -> Any:
    r, g, b = (value / 255.0 for value in colour)
    return m.Color(r=r, g=g, b=b, a=alpha)


def _points(points: Iterable[ros.Message]) -> list[Any]:
    return [m.Point3(**point) for point in points]


# The fields of Foxglove's classes in a ROS message; time and frame are those of its header.
_FIELDS: Final[dict[Any, Callable[[ros.Message], dict[str, Any]]]] = {
    m.PoseInFrame: lambda one: {"pose": one["pose"]},
    m.PosesInFrame: lambda one: {"poses": [_part(each["pose"]) for each in one["poses"]]},
    m.FrameTransforms: lambda one: {"transforms": [_edge(each) for each in one["transforms"]]},
    m.LaserScan: lambda one: {
        "pose": ros.pose((0.0, 0.0, 0.0)), "start_angle": one["angle_min"],
        "end_angle": one["angle_max"], "ranges": one["ranges"].tolist(),
    },
    m.Odometry: lambda one: {
        "body_frame_id": one["child_frame_id"], "pose": one["pose"]["pose"],
        **{f"{name}_velocity": part for name, part in one["twist"]["twist"].items()},
    },
    m.Grid: lambda one: {  # 0 free, 100 occupied, -1 unknown
        "pose": one["info"]["origin"], "data": one["data"].tobytes(), "cell_stride": 1,
        "row_stride": one["info"]["width"], "column_count": one["info"]["width"],
        "cell_size": m.Vector2(x=one["info"]["resolution"], y=one["info"]["resolution"]),
        "fields": _packed(["occupancy"], 1, m.PackedElementFieldNumericType.Int8),
    },
    m.Log: lambda one: {
        "timestamp": one["stamp"], "message": one["msg"], "name": one["name"],
        "level": m.LogLevel.Warning if one["level"] == ros.WARNING else m.LogLevel.Info,
    },
    m.CompressedImage: lambda one: {"data": one["data"].tobytes(), "format": one["format"]},
}  # fmt: skip


def _packed(names: Iterable[str], size: int, kind: Any) -> list[Any]:
    """Describe the numbers of a packed element, each of a size [bytes] and a kind."""
    return [
        m.PackedElementField(name=name, offset=size * k, type=kind) for k, name in enumerate(names)
    ]


def _line(head: Mapping[str, Any], name: str, points: list[Any], colour: Colour, kind: Any) -> Any:
    line = m.LinePrimitive(type=kind, thickness=_LINE, points=points, color=_colour(colour))
    entity = m.SceneEntity(**head, id=name, frame_locked=True, lines=[line])
    return m.SceneUpdate(entities=[entity])


def _footprint(message: ros.Message) -> Any:
    points, kind = _points(message["polygon"]["points"]), m.LinePrimitiveLineType.LineLoop
    return _line(_head(message["header"]), "footprint", points, CHAIR, kind)


def _trail(now: int, places: ArrayLike) -> Any:
    """Draw the trajectory so far (n, 2) on the map."""
    points = [m.Point3(x=x, y=y, z=0.0) for x, y in np.array(places, np.float64).tolist()]
    head = _head(ros.header(now, "map"))
    return _line(head, "trail", points, TRAIL, m.LinePrimitiveLineType.LineStrip)


def _actors(message: ros.Message) -> Any:
    """Draw discs as cylinders and segments as lines."""
    first, *shapes = message["markers"]
    cylinders, lines = [], []
    for one in shapes:
        common = {"pose": _part(one["pose"]), "color": _colour(PERSON, 0.9)}
        if "points" in one:
            kind, points = m.LinePrimitiveLineType.LineList, _points(one["points"])
            lines.append(m.LinePrimitive(type=kind, thickness=_LINE, points=points, **common))
        else:
            size = _part(one["scale"])
            cylinders.append(
                m.CylinderPrimitive(size=size, bottom_scale=1.0, top_scale=1.0, **common)
            )
    entity = m.SceneEntity(**_head(first["header"]), id="actors", cylinders=cylinders, lines=lines)
    return m.SceneUpdate(entities=[entity])


@cache
def _fan(cone: float) -> list[tuple[float, float]]:
    """The tip of a cone of an angle [rad], and points on its arc at distance 1."""
    angles = np.linspace(-0.5 * cone, 0.5 * cone, _ARC).tolist()
    return [(0.0, 0.0), *((math.cos(angle), math.sin(angle)) for angle in angles)]


def _cones(
    now: int, rangers: UltrasonicSettings, ranges: NDArray[np.float32], ages: NDArray[np.float32]
) -> Any:
    """Draw the ultrasonics' ranges as cones in their frames: paler with age, palest without echo.

    No cone is drawn of a range that is invalid (NaN) or too near (-inf). Values beyond the mounted
    rangers are left out.
    """
    found = []
    values = zip(rangers.mounted, rangers.models, ranges.tolist(), ages.tolist(), strict=False)
    for k, (one, model, value, age) in enumerate(values):
        fans = []
        if value > 0.0:
            far = min(value, model.reach)
            corners = [m.Point3(x=far * x, y=far * y, z=0.0) for x, y in _fan(model.field_of_view)]
            alpha = max(0.1, 0.5 - 0.4 * age) if value < math.inf else 0.05
            colour = _colour(NARROW if one.model == "narrow" else WIDE, alpha)
            fans = [m.TriangleListPrimitive(points=corners, color=colour, indices=_TRIANGLES)]
        name, said = f"ultrasonic_{k}", {"range": value, "age": age}
        metadata = [m.KeyValuePair(key=key, value=f"{v:.3f}") for key, v in said.items()]
        found.append(
            m.SceneEntity(
                **_head(ros.header(now, name)), id=name, frame_locked=True, triangles=fans,
                metadata=metadata,
            )
        )  # fmt: skip
    return m.SceneUpdate(entities=found)


def _particles(now: int, poses: Array) -> Any:
    """Make a cloud of possible poses (n, 3) on the map: points with a yaw."""
    return m.PointCloud(
        **_head(ros.header(now, "map")), pose=_part(ros.pose((0.0, 0.0, 0.0))), point_stride=12,
        fields=_packed(("x", "y", "yaw"), 4, m.PackedElementFieldNumericType.Float32),
        data=np.ascontiguousarray(poses, "<f4").tobytes(),
    )  # fmt: skip


def _of(topic: str, kind: Any) -> Callable[..., Any]:
    """Return a function that makes a message of an instant [ns] and a topic's content."""
    of = topic_of(topic)
    assert of is not None

    def make(now: int, *content: Any) -> Any:
        message = of.make(now, *content)
        if kind not in _FIELDS:
            return kind(message)
        head = _head(message["header"]) if "header" in message else {}
        return kind(**head, **{name: _part(v) for name, v in _FIELDS[kind](message).items()})

    return make


_MARKS, _POSE = channels.SceneUpdateChannel, channels.PoseInFrameChannel
_POSES, _EDGES = channels.PosesInFrameChannel, channels.FrameTransformsChannel
_SCANS = [ros.scanner_name(k, "/scan") for k in range(SCANNERS)]
# Topic: its channel, and what makes its messages of an instant [ns] and content.
TYPED: Final[dict[str, tuple[Any, Callable[..., Any]]]] = {
    "/map": (channels.GridChannel, _of("/map", m.Grid)),
    **{topic: (_EDGES, _of(topic, m.FrameTransforms)) for topic in ("/tf", "/tf_static")},
    **{topic: (channels.LaserScanChannel, _of(topic, m.LaserScan)) for topic in _SCANS},
    "/ultrasonic": (_MARKS, _cones),
    "/odometry": (channels.OdometryChannel, _of("/odometry", m.Odometry)),
    **{topic: (_POSES, _of("/path", m.PosesInFrame)) for topic in ("/path", "/lookahead")},
    "/rollout": (_POSES, _of("/rollout", m.PosesInFrame)),
    **{topic: (_POSE, _of(topic, m.PoseInFrame)) for topic in ("/goal", "/pose", "/truth")},
    "/particles": (channels.PointCloudChannel, _particles),
    "/actors": (_MARKS, _of("/actors", _actors)),
    "/footprint": (_MARKS, _of("/footprint", _footprint)),
    "/trail": (_MARKS, _trail),
    "/note": (channels.LogChannel, _of("/note", m.Log)),
    "/image": (channels.CompressedImageChannel, _of("/image", m.CompressedImage)),
}
