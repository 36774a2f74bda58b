"""Settings of a chair that runs under ROS, and of the rosbridge connection to it."""

from __future__ import annotations

from typing import Literal

from wheelchair_gym.config import InputError, setting, settings
from wheelchair_gym.hardware.settings import HostLimits
from wheelchair_gym.sensors.settings import RANGERS

_THESIS = "the thesis's ROS graph"


@settings
class RosbridgeSettings:
    """The WebSocket connection to rosbridge_server."""

    connect_timeout: float = setting(
        default=3.0, unit="s", low=0.1, doc="How long to wait for the connection.",
        source="design choice",
    )  # fmt: skip
    ping_interval: float = setting(
        default=1.0, unit="s", low=0.1, source="design choice",
        doc="Time between two pings; the connection is closed when an answer takes as long.",
    )  # fmt: skip
    max_message_size: int = setting(
        default=128 << 20, unit="bytes", low=1024, doc="Maximum size of a message.",
        source="a map of 30 million cells",
    )  # fmt: skip


@settings
class RosSettings:
    """Topics, frames and limits of a chair under ROS; the defaults are those of the thesis."""

    host: str = setting(default="localhost", doc="Host of rosbridge_server.")
    port: int = setting(
        default=9090, low=1, high=65535, doc="TCP port of rosbridge_server.",
        source="rosbridge_server's default",
    )  # fmt: skip
    scan: str = setting(default="/scan", doc="Topic of the laser scan.", source=_THESIS)
    odometry: str = setting(
        default="/ARDUINO1/Odom", doc="Topic of the odometry.", source=_THESIS
    )  # fmt: skip
    velocity: str = setting(
        default="/ARDUINO1/Velocity", doc="Topic of the commanded twist.", source=_THESIS
    )  # fmt: skip
    map: str = setting(default="/map", doc="Topic of the map.", source=_THESIS)
    tf: str = setting(default="/tf", doc="Topic of the moving transforms.", source=_THESIS)
    tf_static: str = setting(
        default="/tf_static", doc="Topic of the static transforms.", source="ROS"
    )  # fmt: skip
    ultrasonic: tuple[str, ...] = setting(
        default=(), source="the thesis has no such topics",
        doc="Topics of type sensor_msgs/Range, in the order of sensors.ultrasonic.mounted.",
    )  # fmt: skip
    battery: str = setting(
        default="", doc="Topic of type sensor_msgs/BatteryState; empty: there is none.",
        source="the thesis has no such topic",
    )  # fmt: skip
    map_frame: str = setting(default="map", doc="Frame of the map.", source="REP-105")
    base_frame: str = setting(default="base_link", doc="Frame of the chair.", source="REP-105")
    null_range: Literal["invalid", "no echo"] = setting(
        default="no echo", source="REP-117",
        doc="What a null range means: rosbridge writes null for +inf and for NaN. Drivers that "
        "send NaN often (urg_node) need 'invalid'.",
    )  # fmt: skip
    clock: str = setting(default="/clock", doc="Topic of the simulated time.", source="ROS")
    use_sim_time: bool = setting(
        default=False, doc="Measure ages and control periods by the simulated time.", source="ROS"
    )  # fmt: skip
    clock_timeout: float = setting(
        default=2.0, unit="s", low=0.1, source="design choice",
        doc="How long the simulated time may stand still, in real time.",
    )  # fmt: skip
    free_threshold: int = setting(
        default=25, unit="%", low=0, high=100, doc="Cells of the map up to this value are free.",
        source="map_saver",
    )  # fmt: skip
    occupied_threshold: int = setting(
        default=65, unit="%", low=0, high=100, source="map_saver",
        doc="Cells of the map from this value on are occupied.",
    )  # fmt: skip
    limits: HostLimits = HostLimits()
    mount_tolerance: float = setting(
        default=0.05, unit="m, rad", low=0.0, source="design choice",
        doc="Maximum difference between the laser's pose in tf and in sensors.laser.",
    )  # fmt: skip
    link: RosbridgeSettings = RosbridgeSettings()

    def __post_init__(self) -> None:
        if self.ultrasonic and len(self.ultrasonic) != RANGERS:
            raise InputError(
                f"RosSettings.ultrasonic has {len(self.ultrasonic)} topics; expected {RANGERS}, "
                "or none"
            )
        if self.occupied_threshold <= self.free_threshold:
            raise InputError(
                f"RosSettings.occupied_threshold is {self.occupied_threshold}; expected more than "
                f"free_threshold, {self.free_threshold}"
            )
