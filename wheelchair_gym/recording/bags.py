"""Records a drive as a rosbag2: standard ROS 2 messages in an MCAP file, with its metadata.yaml.

The bag holds what a robot publishes, and, as text in std_msgs/String, what `wheelchair replay`
needs. The metadata is version 8, which every distribution from Humble on reads.
"""

from __future__ import annotations

import contextlib
import itertools
import json
import logging
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np

from wheelchair_gym.config import InputError
from wheelchair_gym.files import write_error
from wheelchair_gym.hardware.ros import make_messages as ros
from wheelchair_gym.hardware.ros.cdr import EXTRA, serialized, typestore
from wheelchair_gym.recording.sink import Sink
from wheelchair_gym.recording.topics import BATTERY, COMMAND, FIELDS, write_fields
from wheelchair_gym.rendering.video import jpeg

PREFIX: Final = "/wheelchair"  # of the topics that `replay` reads
_BEGIN = ros.NANO  # stamp of a recording's first message: for tf2, a stamp of 0 means the newest
_VERSION: Any = 8
_LOG = logging.getLogger(__name__)


# Topic of a recording: topic of the bag, its type, and what makes a message of time and content.
_MADE: Final[dict[str, tuple[str, str, Callable[..., ros.Message]]]] = {
    "/map": ("/map", "nav_msgs/msg/OccupancyGrid", ros.grid),
    "/tf": ("/tf", "tf2_msgs/msg/TFMessage", ros.frames),
    "/tf_static": ("/tf_static", "tf2_msgs/msg/TFMessage", ros.mounts),
    "/odometry": ("/odom", "nav_msgs/msg/Odometry", ros.odometry),
    "/path": ("/plan", "nav_msgs/msg/Path", ros.path),
    "/trail": ("/trail", "nav_msgs/msg/Path", ros.path),
    "/goal": ("/goal_pose", "geometry_msgs/msg/PoseStamped", ros.pose_stamped),
    "/pose": ("/pose", "geometry_msgs/msg/PoseStamped", ros.pose_stamped),
    "/truth": ("/ground_truth", "geometry_msgs/msg/PoseStamped", ros.pose_stamped),
    "/particles": ("/particle_cloud", "geometry_msgs/msg/PoseArray", ros.poses),
    "/actors": ("/actors", "visualization_msgs/msg/MarkerArray", ros.actors),
    "/footprint": ("/footprint", "geometry_msgs/msg/PolygonStamped", ros.footprint),
}


class RosBag:
    """Writes the messages of a recording to a rosbag2, as `Sink` does to an MCAP file of our own.

    Args:
        file: the bag's folder, also as FOLDER.mcap; if it exists, a number is added to its name.
        viewers: gets all messages, too.

    Attributes:
        file: the MCAP file in that folder.
        now: time stamp of the messages [ns], from 0; in the bag from 1 s on.
        port: for viewers, or None.

    Raises:
        InputError: the extra 'ros' is not installed, or the folder cannot be made.
    """

    def __init__(self, file: str | Path, viewers: Sink | None = None) -> None:
        try:
            from rosbags.rosbag2 import StoragePlugin, Writer, WriterError
        except ImportError:
            raise InputError(EXTRA) from None

        first = Path(file)
        first = first.with_suffix("") if first.suffix == ".mcap" else first
        for k in itertools.count():
            folder = first.with_name(f"{first.name}-{k}") if k else first
            with contextlib.suppress(WriterError):  # it exists
                self._bag: Any = Writer(folder, version=_VERSION, storage_plugin=StoragePlugin.MCAP)
                try:
                    self._bag.open()
                except OSError as error:
                    raise write_error(folder, error) from None
                break
        if folder != first:
            _LOG.warning("%s exists; the recording is %s", first, folder)
        self.file, self.now, self._viewers = folder / f"{folder.name}.mcap", 0, viewers
        self.port = None if viewers is None else viewers.port
        self._topics: dict[str, Any] = {}
        self._clock, self._error, self._closed, self._reported = -1, "", False, False

    def send(self, topic: str, *content: Any) -> None:
        """Send a message of a topic of `recording.messages.TYPED`."""
        for name, kind, message in self._messages(topic, content):
            self._write(name, kind, message)
        if self._viewers is not None:
            self._viewers.now = self.now
            self._viewers.send(topic, *content)

    def write(self, topic: str, values: Mapping[str, Any], **more: Any) -> None:
        """Send values as JSON, see `recording.topics.FIELDS`, and more JSON content."""
        text = json.dumps(write_fields(FIELDS[topic], values) | more, allow_nan=False)
        if self._clock != self.now:
            self._clock = self.now
            self._write("/clock", "rosgraph_msgs/msg/Clock", ros.clock(self._stamp))
        self._write(PREFIX + topic, "std_msgs/msg/String", {"data": text})
        if topic == COMMAND:
            message = ros.twist_stamped(self._stamp, values["v"], values["w"])
            self._write("/cmd_vel", "geometry_msgs/msg/TwistStamped", message)
        elif topic == BATTERY:
            message = ros.battery(self._stamp, values["voltage"])
            self._write("/battery_state", "sensor_msgs/msg/BatteryState", message)
        if self._viewers is not None:
            self._viewers.now = self.now
            self._viewers.write(topic, values, **more)

    def new_error(self) -> str:
        """The error that has ended the bag early; reported once, then empty."""
        if self._reported or not self._error:
            return ""
        self._reported = True
        return f"{self.file}: {self._error}; the recording ends here"

    def close(self) -> None:
        """Complete the bag and disconnect viewers; may be called again."""
        if not self._closed and not self._error:
            try:
                self._bag.close()
            except OSError as error:
                self._end(error)
        self._closed = True
        if why := self.new_error():
            _LOG.warning("%s", why)
        if self._viewers is not None:
            self._viewers.close()

    @property
    def _stamp(self) -> int:
        return self.now + _BEGIN

    def _messages(
        self, topic: str, content: tuple[Any, ...]
    ) -> Iterator[tuple[str, str, ros.Message]]:
        """Topic, type and content of what the bag gets of a message; nothing of some."""
        now = self._stamp
        if topic in _MADE:
            name, kind, make = _MADE[topic]
            yield name, kind, make(now, *content)
        elif topic.startswith("/scan"):
            yield topic, "sensor_msgs/msg/LaserScan", ros.scan(now, *content)
        elif topic == "/ultrasonic":
            for name, message in ros.distances(now, *content).items():
                yield name, "sensor_msgs/msg/Range", message
        elif topic == "/note":
            source, text, *warning = content
            level = 30 if any(warning) else 20
            line = {"stamp": ros.time(now), "level": level, "name": source, "msg": text}
            yield "/rosout", "rcl_interfaces/msg/Log", line
        elif topic == "/image":
            picture = {
                "header": ros.header(now, "map"),
                "format": "jpeg",
                "data": np.frombuffer(jpeg(*content), np.uint8),
            }
            yield "/image/compressed", "sensor_msgs/msg/CompressedImage", picture

    def _write(self, topic: str, kind: str, message: ros.Message) -> None:
        if self._error:
            return
        try:
            if topic not in self._topics:
                latched = topic in ros.TOPICS and ros.TOPICS[topic].latched
                self._topics[topic] = self._bag.add_connection(
                    topic, kind, typestore=typestore(), offered_qos_profiles=[_qos(latched)]
                )
            self._bag.write(self._topics[topic], self._stamp, serialized(kind, message))
        except OSError as error:
            self._end(error)

    def _end(self, error: OSError) -> None:
        self._error = error.strerror or str(error)
        with contextlib.suppress(OSError):
            self._bag.storage.abort()


def _qos(latched: bool) -> Any:
    """What a publisher offers: reliable, and the last message to late subscribers if latched."""
    from rosbags import interfaces as qos

    forever = qos.QosTime(sec=9223372036, nsec=854775807)  # as rmw writes it
    durability = qos.QosDurability.TRANSIENT_LOCAL if latched else qos.QosDurability.VOLATILE
    return qos.Qos(
        history=qos.QosHistory.KEEP_LAST,
        depth=1 if latched else 10,
        reliability=qos.QosReliability.RELIABLE,
        durability=durability,
        deadline=forever,
        lifespan=forever,
        liveliness=qos.QosLiveliness.AUTOMATIC,
        liveliness_lease_duration=forever,
        avoid_ros_namespace_conventions=False,
    )
