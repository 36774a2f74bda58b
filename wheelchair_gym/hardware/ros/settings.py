"""Settings of a chair that runs under ROS."""

from __future__ import annotations

from typing import Literal

from wheelchair_gym.config import InputError, setting, settings
from wheelchair_gym.hardware.ros.rosbridge import Link
from wheelchair_gym.hardware.settings import HostLimits
from wheelchair_gym.sensors.settings import RANGERS


@settings
class RosSettings:
    """Topics, frames and limits of a chair under ROS; defaults as the thesis's chair has them."""

    host: str = setting(default="localhost", source="where rosbridge_server runs")
    port: int = setting(default=9090, source="rosbridge_server", low=1, high=65535)
    scan: str = setting(default="/scan", source="thesis: urg_node")
    odometry: str = setting(default="/ARDUINO1/Odom", source="thesis: first microcontroller")
    velocity: str = setting(default="/ARDUINO1/Velocity", source="thesis: navigation_node")
    map: str = setting(default="/map", source="thesis: gmapping_node")
    tf: str = setting(default="/tf", source="thesis: gmapping_node and tf_transform_node")
    tf_static: str = setting(default="/tf_static", source="ROS")
    ultrasonic: tuple[str, ...] = setting(
        default=(), source="sensor_msgs/Range, as sensors.ultrasonic.mounted; the thesis names none"
    )
    battery: str = setting(default="", source="sensor_msgs/BatteryState; the thesis names none")
    map_frame: str = setting(default="map", source="REP-105")
    base_frame: str = setting(default="base_link", source="REP-105, thesis")
    null: Literal["invalid", "no echo"] = setting(
        default="no echo", source="a null range: rosbridge writes so for +inf, which is no echo "
        "(REP-117), and for NaN: drivers that say NaN often (urg_node) need 'invalid'",
    )  # fmt: skip
    clock: str = setting(default="/clock", source="ROS: simulated time")
    use_sim_time: bool = setting(
        default=False, source="ROS: stamps, ages and periods are by clock, not by real time"
    )
    stall: float = setting(
        default=2.0, unit="s", source="of real time that clock may stand still", low=0.1
    )
    free: int = setting(default=25, unit="%", source="map_saver", low=0, high=100)
    occupied: int = setting(default=65, unit="%", source="map_saver", low=0, high=100)
    limits: HostLimits = HostLimits()
    mount: float = setting(
        default=0.05, unit="m, rad", source="most that tf and sensors.laser may differ", low=0.0
    )
    link: Link = Link()

    def __post_init__(self) -> None:
        if self.ultrasonic and len(self.ultrasonic) != RANGERS:
            raise InputError(
                f"RosSettings.ultrasonic has {len(self.ultrasonic)} topics; expected {RANGERS}, "
                "or none"
            )
        if self.occupied <= self.free:
            raise InputError(f"RosSettings.occupied is {self.occupied}; expected above free")
