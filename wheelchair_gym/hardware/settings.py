"""Settings of the real chair: boards, laser, and how old, how late and how long things may be."""

from __future__ import annotations

from wheelchair_gym.config import setting, settings
from wheelchair_gym.hardware.joystick import JoystickSettings
from wheelchair_gym.safety.settings import StaleSettings

_STALE = StaleSettings()  # of the shield: the host's limits are the same unless they are set


@settings
class HostLimits:
    """Beyond these the chair is told to stand."""

    scan: float = setting(
        default=_STALE.laser, unit="s", source="oldest of the laser: shield.stale", low=0.01
    )
    odometry: float = setting(
        default=_STALE.odometry, unit="s", source="oldest of the encoders: shield.stale", low=0.01
    )
    pose: float = setting(default=0.5, unit="s", source="oldest of the localiser", low=0.01)
    ultrasonic: float = setting(
        default=_STALE.ultrasonic, unit="s", source="oldest of each: shield.stale", low=0.01
    )
    hold: float = setting(
        default=0.5, unit="s", source="twist_mux: a command counts so long beyond its period",
        low=0.0,
    )  # fmt: skip
    drift: float = setting(
        default=1e-3, source="s per s that two clocks may part", low=0.0, high=0.1
    )
    patience: float = setting(default=5.0, unit="s", source="for fresh data at reset", low=0.1)
    still: float = setting(
        default=0.05, unit="m/s, rad/s", source="a chair at reset stands", low=0.001
    )


@settings
class HardwareSettings:
    """Where boards and laser are, and how often they are spoken to.

    The geometry is that of the environment (sections chair and sensors); at reset the boards'
    parameters and the laser's own specification must agree with it.
    """

    drive: str = setting(default="/dev/ttyACM0", source="drive board; any URL of pyserial")
    range: str = setting(default="/dev/ttyACM1", source="range board; empty: none")
    laser: str = setting(
        default="tcp://192.168.0.10:10940", source="UST-10LX as delivered; or a serial device"
    )
    repeat: float = setting(
        default=0.02, unit="s", source="commands go out so often; the board stops after 0.2 s",
        low=0.005, high=0.1,
    )  # fmt: skip
    look: float = setting(
        default=0.005, unit="s", source="between two looks at the lines", low=0.001, high=0.05
    )
    flight: float = setting(
        default=0.004, unit="s", source="least from counts to host: a run of control, 51 bytes; "
        "measured on the twin", low=0.0, high=0.05,
    )  # fmt: skip
    dry: bool = setting(default=False, source="true: no command is sent, it is only listened to")
    rearm: float = setting(
        default=120.0, unit="s", source="that reset waits for a person to re-arm", low=0.0
    )
    battery_full: float = setting(
        default=60.0, unit="V", low=5.0, high=100.0,
        source="battery at the drive board's full scale; measured with a multimeter, docs/build.md",
    )  # fmt: skip
    duty_limit: float = setting(
        default=0.95, low=0.5, high=1.0,
        source="2.5 us of 50 us recharge bootstrapped drivers; 1 for drivers with a charge pump",
    )  # fmt: skip
    limits: HostLimits = HostLimits(drift=0.006)  # resonator of an Arduino Mega: 0.5 %
    joystick: JoystickSettings = JoystickSettings()
