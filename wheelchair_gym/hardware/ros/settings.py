"""Settings of a chair that runs under ROS, and of the rosbridge connection to it."""

from typing import Literal

from wheelchair_gym.base.settings import InputError, setting, settings
from wheelchair_gym.hardware.settings import HostLimits
from wheelchair_gym.sensors.settings import RANGERS

_THESIS = "the thesis's ROS graph"


@settings
class RosbridgeSettings:
    """The WebSocket connection to rosbridge_server."""

    connect_timeout: float = setting(default=3.0, unit="s", low=0.1)
    """Time to wait for the connection."""
    tls: bool = setting(default=False)
    """Encrypt the connection (wss), and check the other side's certificate."""
    ca_file: str = setting(default="")
    """PEM file of the authority that has signed that certificate; empty: the system's."""
    token_file: str = setting(default="")
    """File with the token that is sent as `Authorization: Bearer TOKEN`, for a proxy in front of
    rosbridge_server, which itself knows no tokens; empty: none."""


@settings
class RosSettings:
    """Topics, frames and limits of a chair under ROS; the defaults are those of the thesis."""

    host: str = setting(default="localhost")
    """Host of rosbridge_server."""
    port: int = setting(default=9090, low=1, high=65535, source="rosbridge_server's default")
    """TCP port of rosbridge_server."""
    scan: str = setting(default="/scan", source=_THESIS)
    """Topic of the laser scan."""
    more_scans: tuple[str, ...] = setting(default=(), source="the thesis has one laser")
    """Topics of further lasers, in the order of sensors.more_lasers."""
    odometry: str = setting(default="/ARDUINO1/Odom", source=_THESIS)
    """Topic of the odometry."""
    velocity: str = setting(default="/ARDUINO1/Velocity", source=_THESIS)
    """Topic of the commanded twist."""
    stamped: bool = setting(default=False, source="the thesis; nav2 until Jazzy")
    """The commanded twist is a TwistStamped, as nav2 expects from Kilted on, and no Twist."""
    map: str = setting(default="/map", source=_THESIS)
    """Topic of the map."""
    tf: str = setting(default="/tf", source=_THESIS)
    """Topic of the moving transforms."""
    tf_static: str = setting(default="/tf_static", source="ROS")
    """Topic of the static transforms."""
    ultrasonic: tuple[str, ...] = setting(default=(), source="the thesis has no such topics")
    """Topics of type sensor_msgs/Range, in the order of sensors.ultrasonic.mounted."""
    battery: str = setting(default="", source="the thesis has no such topic")
    """Topic of type sensor_msgs/BatteryState; empty: there is none."""
    map_frame: str = setting(default="map", source="REP-105")
    """Frame of the map."""
    base_frame: str = setting(default="base_link", source="REP-105")
    """Frame of the chair."""
    null_range: Literal["invalid", "no echo"] = setting(default="no echo", source="REP-117")
    """Meaning of a null range: rosbridge writes null for +inf, -inf and NaN. Drivers that send NaN
    (urg_node) or -inf need 'invalid'."""
    clock_error: float = setting(default=0.0, unit="s", low=0.0)
    """Maximum difference of the robot's clock and this computer's, where both are synchronized
    (NTP, PTP): time stamps then show a constant latency of the network. 0: they are not."""
    clock: str = setting(default="/clock", source="ROS")
    """Topic of the simulated time."""
    use_sim_time: bool = setting(default=False, source="ROS")
    """Measure ages and control periods by the simulated time."""
    clock_timeout: float = setting(default=2.0, unit="s", low=0.1)
    """Real time for which the simulated time may stand still."""
    limits: HostLimits = HostLimits()
    link: RosbridgeSettings = RosbridgeSettings()

    def __post_init__(self) -> None:
        if (n := len(self.ultrasonic)) > RANGERS:
            raise InputError(f"RosSettings.ultrasonic has {n} topics; expected at most {RANGERS}")
