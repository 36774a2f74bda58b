"""UMBmark: squares driven both ways tell a chair's true track and how unequal its wheels are.

Borenstein and Feng (1996), Measurement and Correction of Systematic Odometry Errors in Mobile
Robots, IEEE Transactions on Robotics and Automation 12(6). Their closed form is for a perfect
square; here the ways that were really driven are reckoned anew, and the two errors are those with
which they end where the chair was found to stand (least squares), as their equations do.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from wheelchair_gym.compiled.kernel import kernel
from wheelchair_gym.geometry import wrap_angle
from wheelchair_gym.hardware.chair import HardwareChair
from wheelchair_gym.kinematics import odometric_step, twist_of_wheels
from wheelchair_gym.types import Episode

Array = NDArray[np.float64]
Found = Callable[[str], Array]  # asked for after a square; where the chair is (2,) or (3,)

SPEED, TURN = 0.3, 0.4  # m/s, rad/s: slow, so that nothing slips
NEAR, ALONG = 0.01, 0.02  # m, rad: a leg or a turn is done
GAIN = 2.0  # 1/s of heading on a leg; 1/s of the speed at its end
CREEP = 0.04  # m/s, rad/s: least speed towards the end of a leg or a turn
PATIENCE = 240.0  # s for a square


class Square(NamedTuple):
    """What the wheels did: (n, 2) ways [m] of left and right, and where it ended by measure."""

    ways: Array
    measured: Array  # (2,) m, or (3,) with the heading [rad]


class Calibration(NamedTuple):
    """What squares told."""

    track: float  # m, true
    ratio: float  # right wheel's diameter over the left's
    before: float  # m, root mean square of the ends' errors as the chair reckons
    after: float  # m, as it reckons with the two corrected


@kernel
def dead_reckon(ways: Array, track: float, ratio: float) -> tuple[float, float, float]:
    """The pose after ways (n, 2) [m] from (0, 0, 0), with a true track and ratio of wheels."""
    x, y, yaw = 0.0, 0.0, 0.0
    left, right = 2.0 / (1.0 + ratio), 2.0 * ratio / (1.0 + ratio)
    for k in range(ways.shape[0]):
        way, turn = twist_of_wheels(ways[k, 0] * left, ways[k, 1] * right, track)
        x, y, yaw = odometric_step(x, y, yaw, way, turn)
    return x, y, yaw


def _off(square: Square, track: float, ratio: float) -> Array:
    """How far reckoning ends from the measured pose (2,) or (3,)."""
    off: Array = np.array(dead_reckon(square.ways, track, ratio))[: len(square.measured)]
    off -= square.measured
    if len(off) == 3:
        off[2] = float(wrap_angle(off[2]))
    return off


def calibrate(squares: Sequence[Square], track: float) -> Calibration:
    """Track and ratio of the wheels.

    Args:
        squares: driven both ways, at least one each.
        track: that the chair believed [m].

    Raises:
        ValueError: all squares go the same way: the two errors look alike then.
    """
    turned = [dead_reckon(s.ways, track, 1.0)[2] for s in squares]
    if not (min(turned, default=0.0) < 0.0 < max(turned, default=0.0)):
        raise ValueError("calibration needs squares both ways")

    def off(values: Any) -> Array:
        return np.concatenate([_off(s, track * values[0], values[1]) for s in squares])

    best = least_squares(off, [1.0, 1.0], x_scale=[1e-3, 1e-3]).x
    ends = [[np.hypot(*_off(s, *by)[:2]) for s in squares] for by in (
        (track, 1.0), (track * best[0], best[1])
    )]  # fmt: skip
    before, after = (float(np.sqrt(np.mean(np.square(e)))) for e in ends)
    return Calibration(float(track * best[0]), float(best[1]), before, after)


def drive_square(
    chair: HardwareChair, episode: Episode, side: float, left: bool, found: Found
) -> Square:
    """Drive a square by odometry, and ask where it ended; a person re-arms first.

    Args:
        chair: stands with free room of the side's length ahead and beside it.
        episode: is not looked at by a real chair.
        side: [m].
        left: its corners turn left.
        found: tells the end's place in the frame of the start: x ahead, y left.

    Raises:
        InputError: the chair does not get ready.
        ValueError: it was stopped under way, by what the text says.
    """
    reading = chair.reset(episode, 0)
    start, sign = reading.pose, 1.0 if left else -1.0
    ways = [chair.senses.odometer.at(chair.clock.now())[1]]

    def drive(v: float, w: float) -> Array:
        reading = chair.drive(np.array([v, w]))
        if reading.halted:
            raise ValueError(f"the square was not driven to its end: {reading.halted}")
        if reading.stamp > PATIENCE:
            raise ValueError(f"the square took more than {PATIENCE:g} s")
        ways.append(chair.senses.odometer.at(chair.clock.now())[1])
        pose: Array = reading.pose
        return pose

    pose = start
    for leg in range(4):
        yaw = float(start[2]) + sign * leg * math.pi / 2.0
        ahead, corner = np.array([math.cos(yaw), math.sin(yaw)]), pose[:2]
        while (left_over := side - float((pose[:2] - corner) @ ahead)) > NEAR:
            speed = min(SPEED, max(CREEP, GAIN * left_over))
            pose = drive(speed, GAIN * float(wrap_angle(yaw - pose[2])))
        pose = _rest(drive, pose)
        aim = yaw + sign * math.pi / 2.0
        while abs(off := float(wrap_angle(aim - pose[2]))) > ALONG:
            pose = drive(0.0, math.copysign(min(TURN, max(CREEP, GAIN * abs(off))), off))
        pose = _rest(drive, pose)
    way = "left" if left else "right"
    return Square(np.diff(np.array(ways), axis=0), found(f"the square to the {way} is done"))


def _rest(drive: Callable[[float, float], Array], pose: Array) -> Array:
    """Stand; the pose then."""
    for _ in range(8):
        pose = drive(0.0, 0.0)
    return pose
