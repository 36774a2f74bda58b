"""Foxglove's typed messages of a chair, its sensors and its map, for viewers.

Frames follow REP-105: map -> odom -> base_link -> laser, ultrasonic_0, ...; the pose source sets
the first transform, odometry changes the second, and the mounts are static.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from functools import cache
from typing import Any, Final

import numpy as np
from foxglove import channels
from foxglove import messages as m
from numpy.typing import ArrayLike, NDArray

from wheelchair_gym.arrays import Array
from wheelchair_gym.hardware.ros import make_messages as ros
from wheelchair_gym.maps import OccupancyGrid
from wheelchair_gym.rendering.palette import CHAIR, NARROW, PERSON, TRAIL, WIDE, Colour
from wheelchair_gym.rendering.video import jpeg
from wheelchair_gym.sensors.settings import SCANNERS, LaserSettings, UltrasonicSettings

_NANO = 1_000_000_000
_ARC = 9  # points on the arc of a cone
_TRIANGLES = [corner for k in range(1, _ARC) for corner in (0, k, k + 1)]  # of a cone
_LINE = 0.03  # m: thickness of lines


def _time(now: int) -> Any:
    return m.Timestamp(now // _NANO, now % _NANO)


def _pose_of(pose: ros.Message) -> Any:
    """A pose of a geometry_msgs/Pose."""
    place, turn = m.Vector3(**pose["position"]), m.Quaternion(**pose["orientation"])
    return m.Pose(position=place, orientation=turn)


def _pose(pose: Iterable[float]) -> Any:
    return _pose_of(ros.pose(pose))


def _colour(colour: Colour, alpha: float) -> Any:
    r, g, b = (value / 255.0 for value in colour)
    return m.Color(r=r, g=g, b=b, a=alpha)


def _points(points: ArrayLike) -> list[Any]:
    return [m.Point3(x=x, y=y, z=0.0) for x, y in np.asarray(points, np.float64)[:, :2].tolist()]


def pose_in_map(now: int, pose: Iterable[float]) -> Any:
    """A pose (3,) on the map."""
    return m.PoseInFrame(frame_id="map", timestamp=_time(now), pose=_pose(pose))


def poses_in_map(now: int, points: ArrayLike) -> Any:
    """Points (n, 2) on the map, each with its heading to the next one."""
    poses = [_pose_of(one["pose"]) for one in ros.path(now, points)["poses"]]
    return m.PosesInFrame(frame_id="map", timestamp=_time(now), poses=poses)


def _transforms(now: int, message: ros.Message) -> Any:
    """The transforms of a tf2_msgs/TFMessage."""
    tree = [
        m.FrameTransform(
            timestamp=_time(now),
            parent_frame_id=one["header"]["frame_id"],
            child_frame_id=one["child_frame_id"],
            translation=m.Vector3(**one["transform"]["translation"]),
            rotation=m.Quaternion(**one["transform"]["rotation"]),
        )
        for one in message["transforms"]
    ]
    return m.FrameTransforms(transforms=tree)


def grid(now: int, map_: OccupancyGrid) -> Any:
    """A map: 0 free, 100 occupied, -1 unknown."""
    kind = m.PackedElementFieldNumericType.Int8
    return m.Grid(
        frame_id="map",
        timestamp=_time(now),
        pose=_pose(map_.origin),
        column_count=map_.shape[1],
        cell_size=m.Vector2(x=map_.resolution, y=map_.resolution),
        row_stride=map_.shape[1],
        cell_stride=1,
        fields=[m.PackedElementField(name="occupancy", offset=0, type=kind)],
        data=map_.cells.tobytes(),
    )


def scan(now: int, laser: LaserSettings, ranges: NDArray[np.float32], number: int = 0) -> Any:
    """A sweep of a scanner, in its own frame."""
    half = 0.5 * laser.fov
    return m.LaserScan(
        frame_id=ros.scanner_name(number, "laser"),
        timestamp=_time(now),
        pose=_pose((0.0, 0.0, 0.0)),
        start_angle=-half,
        end_angle=half,
        ranges=ranges.astype(float).tolist(),
    )


@cache
def _fan(cone: float) -> list[tuple[float, float]]:
    """The tip of a cone of an angle [rad], and points on its arc at distance 1."""
    angles = np.linspace(-0.5 * cone, 0.5 * cone, _ARC).tolist()
    return [(0.0, 0.0), *((math.cos(angle), math.sin(angle)) for angle in angles)]


def cones(
    now: int, rangers: UltrasonicSettings, ranges: NDArray[np.float32], ages: NDArray[np.float32]
) -> Any:
    """The ultrasonics' ranges as cones in their frames: paler with age, palest without echo.

    No cone is drawn of a range that is invalid (NaN) or too near (-inf). Values beyond the mounted
    rangers are left out.
    """
    found = []
    values = zip(rangers.mounted, ranges.tolist(), ages.tolist(), strict=False)
    for k, (one, value, age) in enumerate(values):
        narrow = one.model == "narrow"
        model = rangers.narrow if narrow else rangers.wide
        fans = []
        if value > 0.0:
            echo = value < math.inf
            far = min(value, model.reach)
            corners = [m.Point3(x=far * x, y=far * y, z=0.0) for x, y in _fan(model.field_of_view)]
            alpha = max(0.1, 0.5 - 0.4 * age) if echo else 0.05
            colour = _colour(NARROW if narrow else WIDE, alpha)
            fans = [m.TriangleListPrimitive(points=corners, color=colour, indices=_TRIANGLES)]
        name = f"ultrasonic_{k}"
        metadata = {"range": value, "age": age}
        found.append(
            m.SceneEntity(
                timestamp=_time(now),
                frame_id=name,
                id=name,
                frame_locked=True,
                triangles=fans,
                metadata=[m.KeyValuePair(key=key, value=f"{v:.3f}") for key, v in metadata.items()],
            )
        )
    return m.SceneUpdate(entities=found)


def _line(now: int, frame: str, name: str, points: ArrayLike, colour: Colour, closed: bool) -> Any:
    kinds = m.LinePrimitiveLineType
    line = m.LinePrimitive(
        type=kinds.LineLoop if closed else kinds.LineStrip,
        thickness=_LINE,
        points=_points(points),
        color=_colour(colour, 1.0),
    )
    entity = m.SceneEntity(
        timestamp=_time(now), frame_id=frame, id=name, frame_locked=True, lines=[line]
    )
    return m.SceneUpdate(entities=[entity])


def footprint(now: int, corners: Array) -> Any:
    """The chair's outline (4, 2), in its own frame."""
    return _line(now, "base_link", "footprint", corners, CHAIR, True)


def trail(now: int, places: Sequence[Array] | Array) -> Any:
    """The trajectory so far (n, 2), on the map."""
    return _line(now, "map", "trail", np.array(places), TRAIL, False)


def actors(now: int, shapes: tuple[Array, Array]) -> Any:
    """Actors' discs (n, 3) and segments (m, 4) [m], as cylinders and lines."""
    discs, segments = shapes
    colour = _colour(PERSON, 0.9)
    cylinders = [
        m.CylinderPrimitive(
            pose=_pose((x, y, 0.0)),
            size=m.Vector3(x=2.0 * r, y=2.0 * r, z=0.1),
            bottom_scale=1.0,
            top_scale=1.0,
            color=colour,
        )
        for x, y, r in discs.tolist()
    ]
    lines = m.LinePrimitive(
        type=m.LinePrimitiveLineType.LineList,
        pose=_pose((0.0, 0.0, 0.0)),
        thickness=_LINE,
        points=_points(segments.reshape(-1, 2)),
        color=colour,
    )
    entity = m.SceneEntity(
        timestamp=_time(now), frame_id="map", id="actors", cylinders=cylinders,
        lines=[lines] if len(segments) else [],
    )  # fmt: skip
    return m.SceneUpdate(entities=[entity])


def odometry(now: int, pose: Array, twist: Array) -> Any:
    """The odometry's pose (3,) and the twist (2,)."""
    v, w = twist.tolist()
    return m.Odometry(
        timestamp=_time(now), frame_id="odom", body_frame_id="base_link", pose=_pose(pose),
        linear_velocity=m.Vector3(x=v, y=0.0, z=0.0), angular_velocity=m.Vector3(x=0.0, y=0.0, z=w),
    )  # fmt: skip


def particles(now: int, poses: Array) -> Any:
    """Possible poses (n, 3) on the map, as points with a yaw."""
    kind = m.PackedElementFieldNumericType.Float32
    named = [
        m.PackedElementField(name=name, offset=4 * k, type=kind)
        for k, name in enumerate(("x", "y", "yaw"))
    ]
    return m.PointCloud(
        timestamp=_time(now), frame_id="map", pose=_pose((0.0, 0.0, 0.0)), point_stride=12,
        fields=named, data=np.ascontiguousarray(poses, "<f4").tobytes(),
    )  # fmt: skip


def log_message(now: int, name: str, text: str, warning: bool = False) -> Any:
    """A log line of a part."""
    level = m.LogLevel.Warning if warning else m.LogLevel.Info
    return m.Log(timestamp=_time(now), level=level, message=text, name=name)


def image(now: int, picture: NDArray[np.uint8], quality: int) -> Any:
    """A picture (h, w, 3) RGB as JPEG."""
    data = jpeg(picture, quality)
    return m.CompressedImage(timestamp=_time(now), frame_id="map", data=data, format="jpeg")


# Topic: its channel, and what makes its messages of an instant [ns] and content.
TYPED: Final[dict[str, tuple[Any, Callable[..., Any]]]] = {
    "/map": (channels.GridChannel, grid),
    "/tf": (
        channels.FrameTransformsChannel,
        lambda now, *poses: _transforms(now, ros.frames(now, *poses)),
    ),
    "/tf_static": (
        channels.FrameTransformsChannel,
        lambda now, *sensors: _transforms(now, ros.mounts(now, *sensors)),
    ),
    **{ros.scanner_name(k, "/scan"): (channels.LaserScanChannel, scan) for k in range(SCANNERS)},
    "/ultrasonic": (channels.SceneUpdateChannel, cones),
    "/odometry": (channels.OdometryChannel, odometry),
    "/path": (channels.PosesInFrameChannel, poses_in_map),
    "/lookahead": (channels.PosesInFrameChannel, poses_in_map),
    "/goal": (channels.PoseInFrameChannel, pose_in_map),
    "/pose": (channels.PoseInFrameChannel, pose_in_map),
    "/truth": (channels.PoseInFrameChannel, pose_in_map),
    "/particles": (channels.PointCloudChannel, particles),
    "/actors": (channels.SceneUpdateChannel, actors),
    "/footprint": (channels.SceneUpdateChannel, footprint),
    "/trail": (channels.SceneUpdateChannel, trail),
    "/note": (channels.LogChannel, log_message),
    "/image": (channels.CompressedImageChannel, image),
}
