"""UMBmark: the track and the ratio of the wheels' diameters, from squares in both directions.

Borenstein and Feng (1996), Measurement and Correction of Systematic Odometry Errors in Mobile
Robots, IEEE Transactions on Robotics and Automation 12(6). Their closed form is for a perfect
square; here both errors are fitted (least squares) so that the odometry of the wheels' real travel
ends at the measured poses.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import least_squares

from wheelchair_gym.base.arrays import Array
from wheelchair_gym.compiled.kernel import kernel
from wheelchair_gym.geometry.kinematics import odometric_step, twist_of_wheels
from wheelchair_gym.geometry.planar import wrap_angle
from wheelchair_gym.hardware.chair import HardwareChair

SPEED, TURN = 0.3, 0.4  # m/s, rad/s: slow, so that nothing slips
DISTANCE, ANGLE = 0.01, 0.02  # m, rad: remainders at which a leg or a turn is done
GAIN = 2.0  # 1/s, of the heading on a leg and of the speed at its end
CREEP = 0.04  # m/s, rad/s: least speed towards the end of a leg or a turn
PATIENCE = 240.0  # s for a square
STANDS = 8  # control periods for which it stands after a leg or a turn


class Square(NamedTuple):
    """A driven square: travel (n, 2) [m] of the left and right wheel, and its measured end."""

    travel: Array
    measured: Array  # (2,) m, or (3,) with the heading [rad]


class Calibration(NamedTuple):
    """The result of squares."""

    track: float  # m, true
    ratio: float  # right wheel's diameter over the left's
    before: float  # m, root mean square error of the ends by the present odometry
    after: float  # m, the same with both values corrected


@kernel
def dead_reckon(travel: Array, track: float, ratio: float) -> tuple[float, float, float]:
    """The pose after travel (n, 2) [m] from (0, 0, 0), with a track [m] and a ratio of wheels."""
    x, y, yaw = 0.0, 0.0, 0.0
    left, right = 2.0 / (1.0 + ratio), 2.0 * ratio / (1.0 + ratio)
    for k in range(travel.shape[0]):
        distance, turn = twist_of_wheels(travel[k, 0] * left, travel[k, 1] * right, track)
        x, y, yaw = odometric_step(x, y, yaw, distance, turn)
    return x, y, yaw


def _error(square: Square, track: float, ratio: float) -> Array:
    """The error (2,) or (3,) of the odometry at the end of a square."""
    error: Array = np.array(dead_reckon(square.travel, track, ratio))[: len(square.measured)]
    error -= square.measured
    if len(error) == 3:
        error[2] = float(wrap_angle(error[2]))
    return error


def calibrate(squares: Sequence[Square], track: float) -> Calibration:
    """Track and ratio of the wheels.

    Args:
        squares: at least one in each direction.
        track: of the chair's odometry [m].

    Raises:
        ValueError: all squares have one direction, which does not separate the two errors.
    """
    turned = [dead_reckon(s.travel, track, 1.0)[2] for s in squares]
    if not (min(turned, default=0.0) < 0.0 < max(turned, default=0.0)):
        raise ValueError("calibration needs squares both ways")

    def errors(values: Any) -> Array:
        return np.concatenate([_error(s, track * values[0], values[1]) for s in squares])

    best = least_squares(errors, [1.0, 1.0], x_scale=[1e-3, 1e-3]).x

    def end_error(track: float, ratio: float) -> float:
        ends = [np.hypot(*_error(square, track, ratio)[:2]) for square in squares]
        return float(np.sqrt(np.mean(np.square(ends))))

    fitted = float(track * best[0]), float(best[1])
    return Calibration(*fitted, end_error(track, 1.0), end_error(*fitted))


def drive_square(
    chair: HardwareChair, side: float, left: bool, measure: Callable[[str], Array]
) -> Square:
    """Drive a square by odometry, once a person has re-armed the chair, and measure its end.

    Args:
        chair: with free space of the side's length ahead and beside it.
        side: [m].
        left: the corners turn left.
        measure: asks a person; returns the end's position (2,) or pose (3,) in the start's frame.

    Raises:
        InputError: the chair does not get ready.
        ValueError: the chair stopped before the end; the text says why.
    """
    reading = chair.reset()
    start, sign = reading.pose, 1.0 if left else -1.0
    travel = [chair.senses.odometer.at(chair.clock.now())[1]]

    def drive(v: float, w: float, periods: int = 1) -> Array:
        for _ in range(periods):
            reading = chair.drive(np.array([v, w]))
            if reading.halted:
                raise ValueError(f"the square was not driven to its end: {reading.halted}")
            if reading.stamp > PATIENCE:
                raise ValueError(f"the square took more than {PATIENCE:g} s")
            travel.append(chair.senses.odometer.at(chair.clock.now())[1])
        pose: Array = reading.pose
        return pose

    pose = start
    for leg in range(4):
        yaw = float(start[2]) + sign * leg * math.pi / 2.0
        ahead, corner = np.array([math.cos(yaw), math.sin(yaw)]), pose[:2]
        while (remaining := side - float((pose[:2] - corner) @ ahead)) > DISTANCE:
            speed = min(SPEED, max(CREEP, GAIN * remaining))
            pose = drive(speed, GAIN * float(wrap_angle(yaw - pose[2])))
        pose = drive(0.0, 0.0, STANDS)
        aim = yaw + sign * math.pi / 2.0
        while abs(off := float(wrap_angle(aim - pose[2]))) > ANGLE:
            pose = drive(0.0, math.copysign(min(TURN, max(CREEP, GAIN * abs(off))), off))
        pose = drive(0.0, 0.0, STANDS)
    end = measure(f"the square to the {'left' if left else 'right'} is done")
    return Square(np.diff(np.array(travel), axis=0), end)
