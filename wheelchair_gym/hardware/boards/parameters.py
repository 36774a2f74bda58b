"""Parameters of the boards: names in the boards' order, and the values that a chair's settings ask.

Defaults and bounds live in the firmware (protocol.h), which tells them on request.
"""

from __future__ import annotations

from dataclasses import fields

from wheelchair_gym.hardware.settings import HardwareSettings
from wheelchair_gym.physics.settings import ChairSettings
from wheelchair_gym.sensors.settings import SensorSettings, UltrasonicSettings

DRIVE_PARAMETERS = (
    "track",
    "counts_per_metre",
    "forward",
    "backward",
    "turn",
    "acceleration",
    "deceleration",
    "protective",
    "turn_acceleration",
    "jerk",
    "turn_jerk",
    "stop",
    "feed",
    "kp",
    "ki",
    "kd",
    "ka",
    "smoothing",
    "timeout",
    "latch",
    "missing",
    "over_speed",
    "under_voltage",
    "battery_full",
    "manual",
    "creep",
    "half_width",
    "runaway",
    "load",
    "hold",
    "park",
    "slip",
    "duty_limit",
)
RANGE_PARAMETERS = ("interval", "sound", "narrow_reach", "wide_reach", "narrow_blind", "wide_blind")


_MISSING, _COUNTS = 0.01, 3.0  # m; counts of coarse encoders, which tell of a way in jumps


def drive_parameters(chair: ChairSettings) -> dict[str, float]:
    """What the drive board must hold for a chair; its other parameters are the board's own."""
    drive, limits, motor = chair.drive, chair.limits, chair.motor
    values = {field.name: float(getattr(limits, field.name)) for field in fields(limits)}
    # The chair is to slow at this rate; so that it does, the board's set point falls faster.
    del values["protective"]
    values |= {"track": drive.track, "counts_per_metre": drive.counts_per_metre}
    values |= {name: float(getattr(motor, name)) for name in ("kp", "ki", "kd", "ka")}
    values["smoothing"] = motor.filter_time
    values["feed"] = motor.torque_constant / drive.wheel_radius
    values["under_voltage"] = chair.battery.empty_voltage
    values["missing"] = max(_MISSING, _COUNTS / drive.counts_per_metre)
    values["half_width"] = chair.footprint.half_width
    return values


def range_parameters(rangers: UltrasonicSettings) -> dict[str, float]:
    """What the range board must hold for a chair's ultrasonics."""
    values = {"interval": rangers.interval}
    for name, model in (("narrow", rangers.narrow), ("wide", rangers.wide)):
        values |= {f"{name}_reach": model.reach, f"{name}_blind": model.range_min}
    return values


def board_parameters(
    chair: ChairSettings, sensors: SensorSettings, hardware: HardwareSettings
) -> dict[str, dict[str, float]]:
    """What the boards must hold for a chair, by the name of the board."""
    drive = drive_parameters(chair)
    drive |= {name: getattr(hardware, name) for name in ("battery_full", "duty_limit")}
    return {"drive": drive, "range": range_parameters(sensors.ultrasonic)}
