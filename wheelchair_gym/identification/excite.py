"""A drive that shows wheels, motors and scanner: both ways, at all speeds, in 4 m x 4 m."""

from __future__ import annotations

import dataclasses
from typing import Final

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.base.arrays import Floats
from wheelchair_gym.geometry.kinematics import DriveGeometry
from wheelchair_gym.identification.logs import DriveLog, log_of_reports
from wheelchair_gym.perception.occupancy import read_scan
from wheelchair_gym.safety import Shield, ShieldSettings
from wheelchair_gym.sensors.settings import LaserSettings, SensorSettings
from wheelchair_gym.sim.settings import ChairSettings
from wheelchair_gym.types import Chair, Reading

_QUARTER, _FULL = 2.62, 7.9  # s of a quarter turn at 0.6 rad/s, of a full one at 0.8 rad/s


def _square(side: float) -> list[tuple[float, float, float]]:
    leg = [(0.4, 0.0, 3.0), (0.0, 0.0, 1.0), (0.0, side * 0.6, _QUARTER), (0.0, 0.0, 1.0)]
    return 4 * leg


# Twists [m/s, rad/s] and their durations [s]: standing, squares, circles and full turns both ways,
# fast and slow ahead and back.
PROGRAM: Final = (
    (0.0, 0.0, 3.0),
    *_square(1.0), *_square(-1.0),
    (0.3, 0.5, 12.6), (0.0, 0.0, 1.0), (0.3, -0.5, 12.6), (0.0, 0.0, 1.0),
    (0.0, 0.8, _FULL), (0.0, 0.0, 1.0), (0.0, -0.8, _FULL), (0.0, 0.0, 1.0),
    *2 * ((0.7, 0.0, 1.8), (0.0, 0.0, 1.5), (-0.3, 0.0, 4.2), (0.0, 0.0, 1.0)),
    (0.05, 0.0, 4.0), (0.0, 0.0, 1.0), (-0.05, 0.0, 4.0), (0.0, 0.0, 3.0),
)  # fmt: skip
DURATION: Final = sum(seconds for _, _, seconds in PROGRAM)  # s
# Floor that the program needs about the axle's centre at its start: from, to [m].
ROOM: Final = {"ahead": (-1.0, 2.0), "left": (-1.9, 1.9)}


def free_floor_shield(
    settings: ShieldSettings | None, chair: ChairSettings, sensors: SensorSettings, period: float
) -> Shield:
    """The shield of a drive on floor that a person has cleared.

    It allows full speed where nothing was seen yet, as behind the chair; it stops before obstacles.
    """
    limits = chair.limits
    free = dataclasses.replace(
        settings or ShieldSettings(), unseen_speed=max(limits.forward, limits.turn)
    )
    return Shield(free, chair, sensors, period=period)


def check_room(reading: Reading, laser: LaserSettings) -> None:
    """Refuse a place in which the program does not fit.

    Raises:
        ValueError: something stands within ROOM; the text says where.
    """
    echoes = read_scan(laser, reading.laser[: laser.beams]).echoes
    (back, front), (right, left) = ROOM["ahead"], ROOM["left"]
    x, y = echoes.T
    inside = (x > back) & (x < front) & (y > right) & (y < left)
    if inside.any():
        place = echoes[inside][np.argmin(np.hypot(x[inside], y[inside]))]
        raise ValueError(
            f"something stands {place[0]:.2f} m ahead and {place[1]:.2f} m to the left of the "
            f"axle; expected free floor from {back:g} to {front:g} m ahead and {right:g} to "
            f"{left:g} m to the left"
        )


def excite(
    chair: Chair, shield: Shield, drive: DriveGeometry, laser: LaserSettings, period: float,
    first: Reading,
) -> DriveLog:  # fmt: skip
    """Drive the program behind a shield, which may slow it, and return the log.

    Args:
        chair: after its reset.
        shield: likewise.
        drive: the wheels, as the chair's settings have them.
        laser: likewise.
        period: of control [s].
        first: the reading of the reset.

    Raises:
        ValueError: there is too little room, or the chair or the shield stopped the program.
    """
    check_room(first, laser)
    wheels: list[NDArray[np.void]] = [chair.wheels]
    stamps: list[float] = [chair.scan_stamps[0]]
    scans: list[Floats] = [first.laser[: laser.beams]]
    reading, due = first, 0.0
    for v, w, seconds in PROGRAM:
        due += seconds
        while reading.stamp < due - 0.5 * period:
            given = shield.filter(np.array([v, w]), reading)
            if reading.halted or shield.decision.protective:
                why = reading.halted or shield.decision.reason
                raise ValueError(f"after {reading.stamp:.0f} s the drive was stopped: {why}")
            reading = chair.drive(given, shield.decision.protective)
            wheels.append(chair.wheels)
            stamps.append(chair.scan_stamps[0])
            scans.append(reading.laser[: laser.beams])
    ranges = np.stack(scans) + np.float32(laser.offset)
    return log_of_reports(np.concatenate(wheels), np.array(stamps), ranges, drive)
