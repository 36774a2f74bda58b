"""Settings of the real chair: where its boards and its laser are, and how old data may be."""

from typing import Any

from wheelchair_gym.base.settings import InputError, setting, settings
from wheelchair_gym.hardware.joystick import JoystickSettings
from wheelchair_gym.safety.settings import StaleSettings
from wheelchair_gym.sensors.settings import SensorSettings

BOARD_RANGERS = 8, 10  # ultrasonics that the range board serves: the first eight, or all
REST_SPEED = 0.05  # m/s, rad/s below which the chair is at rest
_SHIELD = "the shield's limit"
_STALE = StaleSettings()  # of the shield: the host's limits are the same by default


@settings
class HostLimits:
    """Limits of age, delay and clock drift, beyond which the chair is stopped."""

    scan: float = setting(default=_STALE.laser, unit="s", low=0.01, source=_SHIELD)
    """Maximum age of a laser scan."""
    odometry: float = setting(default=_STALE.odometry, unit="s", low=0.01, source=_SHIELD)
    """Maximum age of the odometry."""
    latency: float = setting(default=0.1, unit="s", low=0.01)
    """Maximum time that scans and odometry may be under way, by round trips and time stamps."""
    pose: float = setting(default=0.5, unit="s", low=0.01)
    """Maximum age of a pose on the map."""
    ultrasonic: float = setting(default=_STALE.ultrasonic, unit="s", low=0.01, source=_SHIELD)
    """Maximum age of an ultrasonic range."""
    command_timeout: float = setting(default=0.5, unit="s", low=0.0, source="twist_mux (ROS)")
    """Time for which a command stays valid beyond its control period."""
    clock_drift: float = setting(
        default=2e-4, unit="s/s", low=0.0, high=0.1, source="two quartz clocks, 100 ppm each"
    )
    """Maximum drift between the host's clock and that of a board or another computer."""
    ready_timeout: float = setting(default=5.0, unit="s", low=0.1)
    """Time for which a reset waits for fresh data and for the chair to come to rest."""


@settings
class HardwareSettings:
    """Addresses of the boards and the laser, and limits of the drive.

    The geometry is that of the environment (sections `chair` and `sensors`). At reset the boards'
    parameters and the laser's own specification must agree with it.
    """

    drive_port: str = setting(default="/dev/ttyACM0", source="Linux: the first USB serial port")
    """Serial port of the drive board, or any URL of pyserial."""
    range_port: str = setting(default="/dev/ttyACM1", source="Linux: the second USB serial port")
    """Serial port of the range board; empty: there is none."""
    laser_port: str = setting(default="tcp://192.168.0.10:10940", source="UST-10LX as delivered")
    """Address or serial port of the laser."""
    more_laser_ports: tuple[str, ...] = setting(default=())
    """Addresses of further lasers, in the order of sensors.more_lasers."""
    dry_run: bool = setting(default=False)
    """Send no command, and only read what boards and laser send."""
    rearm_timeout: float = setting(default=120.0, unit="s", low=0.0)
    """Time for which a reset waits for a person to re-arm the chair."""
    battery_full: float = setting(
        default=60.0, unit="V", low=5.0, high=100.0, source="measured with a multimeter"
    )
    """Battery voltage at the full scale of the drive board's converter (docs/chair/build.md)."""
    duty_limit: float = setting(
        default=0.95, low=0.5, high=1.0, source="2.5 us of each 50 us recharge bootstrapped drivers"
    )
    """Maximum duty cycle of the motors; 1 for drivers with a charge pump."""
    # The resonator of an Arduino Mega drifts by 0.5 %.
    limits: HostLimits = HostLimits(clock_drift=0.006)
    joystick: JoystickSettings = JoystickSettings()


@settings
class TwinSettings:
    """The emulated boards of a simulated chair, in this process and in simulated time."""

    plant: Any = setting(default=None)
    """The chair as it is, where it differs from what its computer believes: a file, or sections."""


def check_boards(sensors: SensorSettings) -> None:
    """Refuse sensors other than those that the boards serve.

    Raises:
        InputError: there is no laser, or the range board does not serve this number of
            ultrasonics.
    """
    if not sensors.lasers:
        raise InputError("sensors.laser.beams is 0; a real chair has a laser")
    if (mounted := len(sensors.ultrasonic.mounted)) not in BOARD_RANGERS:
        raise InputError(
            f"sensors.ultrasonic.mounted has {mounted} rangers; the range board serves "
            f"{' or '.join(map(str, BOARD_RANGERS))}"
        )
