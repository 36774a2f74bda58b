"""Writes a rosbag2: standard ROS 2 messages in an MCAP file, with its metadata.yaml.

The bag holds what a robot publishes, and, as text in std_msgs/String, what `wheelchair replay`
needs. The metadata is version 8, which every distribution from Humble on reads.
"""

import contextlib
import itertools
import logging
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np

from wheelchair_gym.base.errors import imports
from wheelchair_gym.base.files import write_error
from wheelchair_gym.hardware.ros import make_messages as ros
from wheelchair_gym.recording.topics import BATTERY, COMMAND
from wheelchair_gym.rendering.video import jpeg

PREFIX: Final = "/wheelchair"  # of the topics that `replay` reads
_BEGIN = ros.NANO  # stamp of a recording's first message: for tf2, a stamp of 0 means the newest
_VERSION: Any = 8
_LOG = logging.getLogger(__name__)


def _note(now: int, source: str, text: str, warning: bool = False) -> ros.Message:
    """Make a rcl_interfaces/Log."""
    return {
        "stamp": ros.time(now), "level": ros.WARNING if warning else ros.INFO, "name": source,
        "msg": text,
    }  # fmt: skip


def _image(now: int, *picture: Any) -> ros.Message:
    """Make a sensor_msgs/CompressedImage of a picture and its quality."""
    data = np.frombuffer(jpeg(*picture), np.uint8)
    return {"header": ros.header(now, "map"), "format": "jpeg", "data": data}


_TOPICS: Final = ros.TOPICS | {
    "/cmd_vel": ros.Topic("geometry_msgs/msg/TwistStamped", ros.twist_stamped),
    "/plan": ros.Topic("nav_msgs/msg/Path", ros.path),
    "/rollout": ros.Topic("nav_msgs/msg/Path", ros.path),
    "/trail": ros.Topic("nav_msgs/msg/Path", ros.path),
    "/pose": ros.Topic("geometry_msgs/msg/PoseStamped", ros.pose_stamped),
    "/ground_truth": ros.Topic("geometry_msgs/msg/PoseStamped", ros.pose_stamped),
    "/particle_cloud": ros.Topic("geometry_msgs/msg/PoseArray", ros.poses),
    "/actors": ros.Topic("visualization_msgs/msg/MarkerArray", ros.actors),
    "/rosout": ros.Topic("rcl_interfaces/msg/Log", _note),
    "/image/compressed": ros.Topic("sensor_msgs/msg/CompressedImage", _image),
}
# Topics of a recording that have other names in a bag.
_NAMES: Final = {
    "/odometry": "/odom", "/path": "/plan", "/goal": "/goal_pose", "/truth": "/ground_truth",
    "/particles": "/particle_cloud", "/note": "/rosout", "/image": "/image/compressed",
}  # fmt: skip


def topic_of(topic: str) -> ros.Topic | None:
    """Return how a bag holds a topic of a recording; None: as JSON, or not at all."""
    return _TOPICS.get(ros.general(_NAMES.get(topic, topic)))


class RosBag:
    """A rosbag2 that the messages of a recording are written to.

    Args:
        file: the bag's folder, also as FOLDER.mcap; if it exists, a number is added to its name.

    Attributes:
        path: the MCAP file in that folder.
        error: why no more is written; empty: all is.

    Raises:
        InputError: the extra 'ros' is not installed, or the folder cannot be made.
    """

    def __init__(self, file: str | Path) -> None:
        with imports("messages of ROS 2 need", "ros"):
            from rosbags.rosbag2 import StoragePlugin, Writer, WriterError

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
        self.path, self.error = folder / f"{folder.name}.mcap", ""
        self._topics: dict[str, Any] = {}
        self._clock, self._closed = -1, False

    def send(self, now: int, topic: str, *content: Any) -> None:
        """Send a message of an instant [ns] from 0; the bag begins at 1 s, and lacks /lookahead."""
        now += _BEGIN
        if (of := topic_of(topic)) is not None:
            for name, message in of.messages(_NAMES.get(topic, topic), now, *content).items():
                self._write(name, now, message)

    def write(self, now: int, topic: str, values: Mapping[str, Any], text: str) -> None:
        """Send the values of a topic with JSON content, which is given as text, too."""
        if self._clock != now:
            self._clock = now
            self.send(now, "/clock")
        self._write(PREFIX + topic, now + _BEGIN, {"data": text})
        if topic == COMMAND:
            self.send(now, "/cmd_vel", values["v"], values["w"])
        elif topic == BATTERY:
            self.send(now, "/battery_state", values["voltage"])

    def close(self) -> None:
        """Complete the bag; may be called again."""
        if not self._closed and not self.error:
            try:
                self._bag.close()
            except OSError as error:
                self._end(error)
        self._closed = True

    def _write(self, topic: str, stamp: int, message: ros.Message) -> None:
        if self.error:
            return
        of = topic_of(topic)
        kind = "std_msgs/msg/String" if of is None else of.type
        try:
            if topic not in self._topics:
                latched = of is not None and of.latched
                self._topics[topic] = self._bag.add_connection(
                    topic, kind, typestore=ros.typestore(), offered_qos_profiles=[_qos(latched)]
                )
            self._bag.write(self._topics[topic], stamp, ros.serialized(kind, message))
        except OSError as error:
            self._end(error)

    def _end(self, error: OSError) -> None:
        self.error = error.strerror or str(error)
        with contextlib.suppress(OSError):
            self._bag.storage.abort()


def _qos(latched: bool) -> Any:
    """Return a publisher's QoS: reliable, and the last message to late subscribers if latched."""
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
