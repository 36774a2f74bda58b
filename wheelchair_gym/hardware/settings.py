"""Settings of the real chair: where its boards and its laser are, and how old data may be."""

from __future__ import annotations

from wheelchair_gym.config import setting, settings
from wheelchair_gym.hardware.joystick import JoystickSettings
from wheelchair_gym.safety.settings import StaleSettings

_STALE = StaleSettings()  # of the shield: the host's limits are the same unless they are set


@settings
class HostLimits:
    """Limits of age, delay and clock drift; the chair is told to stop beyond them."""

    scan: float = setting(
        default=_STALE.laser, unit="s", low=0.01, doc="Maximum age of a laser scan.",
        source="the shield's limit",
    )  # fmt: skip
    odometry: float = setting(
        default=_STALE.odometry, unit="s", low=0.01, doc="Maximum age of the odometry.",
        source="the shield's limit",
    )  # fmt: skip
    pose: float = setting(
        default=0.5, unit="s", low=0.01, doc="Maximum age of a pose on the map.",
        source="design choice",
    )  # fmt: skip
    ultrasonic: float = setting(
        default=_STALE.ultrasonic, unit="s", low=0.01, doc="Maximum age of an ultrasonic range.",
        source="the shield's limit",
    )  # fmt: skip
    command_timeout: float = setting(
        default=0.5, unit="s", low=0.0, source="twist_mux (ROS), which uses 0.5 s",
        doc="How long a command stays valid beyond its control period.",
    )  # fmt: skip
    clock_drift: float = setting(
        default=1e-3, unit="s/s", low=0.0, high=0.1, source="design choice",
        doc="Maximum drift between the host's clock and that of a board or another computer.",
    )  # fmt: skip
    ready_timeout: float = setting(
        default=5.0, unit="s", low=0.1, source="design choice",
        doc="How long a reset waits for fresh data and for the chair to come to rest.",
    )  # fmt: skip
    rest_speed: float = setting(
        default=0.05, unit="m/s, rad/s", low=0.001, source="design choice",
        doc="The chair is at rest below this speed.",
    )  # fmt: skip


@settings
class HardwareSettings:
    """Where the boards and the laser are, and how often the host talks to them.

    The geometry is that of the environment (sections `chair` and `sensors`). At reset the boards'
    parameters and the laser's own specification must agree with it.
    """

    drive_port: str = setting(
        default="/dev/ttyACM0", doc="Serial port of the drive board, or any URL of pyserial.",
        source="Linux's name of the first USB serial port",
    )  # fmt: skip
    range_port: str = setting(
        default="/dev/ttyACM1", doc="Serial port of the range board; empty: there is none.",
        source="Linux's name of the second USB serial port",
    )  # fmt: skip
    laser_port: str = setting(
        default="tcp://192.168.0.10:10940", doc="Address or serial port of the laser.",
        source="Hokuyo UST-10LX as delivered",
    )  # fmt: skip
    command_period: float = setting(
        default=0.02, unit="s", low=0.005, high=0.1, doc="Time between two commands on the line.",
        source="a tenth of the drive board's timeout of 0.2 s",
    )  # fmt: skip
    poll_period: float = setting(
        default=0.005, unit="s", low=0.001, high=0.05, doc="Time between two reads of the ports.",
        source="a quarter of the odometry's period of 20 ms",
    )  # fmt: skip
    odometry_latency: float = setting(
        default=0.004, unit="s", low=0.0, high=0.05, source="measured on the twin",
        doc="Minimum delay from the encoder counts on the board to their arrival at the host.",
    )  # fmt: skip
    dry_run: bool = setting(
        default=False, doc="Send no command, and only read what boards and laser send.",
    )  # fmt: skip
    rearm_timeout: float = setting(
        default=120.0, unit="s", low=0.0, source="design choice",
        doc="How long a reset waits for a person to re-arm the chair.",
    )  # fmt: skip
    battery_full: float = setting(
        default=60.0, unit="V", low=5.0, high=100.0, source="measured with a multimeter",
        doc="Battery voltage at the full scale of the drive board's converter (docs/build.md).",
    )  # fmt: skip
    duty_limit: float = setting(
        default=0.95, low=0.5, high=1.0,
        doc="Maximum duty cycle of the motors; 1 for drivers with a charge pump.",
        source="design choice: 2.5 us of each 50 us recharge bootstrapped drivers",
    )  # fmt: skip
    # The resonator of an Arduino Mega drifts by 0.5 %.
    limits: HostLimits = HostLimits(clock_drift=0.006)
    joystick: JoystickSettings = JoystickSettings()  # fmt: skip
