"""Covariances of the simulated odometry, for filters such as robot_localization."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from wheelchair_gym.arrays import Array
from wheelchair_gym.kinematics import DriveGeometry, wheels_of_twist
from wheelchair_gym.sensors.settings import SensorSettings


class OdometryCovariance:
    """Covariance of a simulated chair's odometry, by the errors that the simulator draws.

    Wheel diameters and track are off by uniform errors that last for an episode, each wheel's path
    errs as a random walk (`OdometrySettings`), and encoders count whole ticks. Dead reckoning is
    unbounded, and so is the covariance of its pose: it grows from the start of the episode.

    Args:
        drive: track and encoders.
        sensors: errors of the odometry; none without noise.
        period: of control [s].
    """

    def __init__(self, drive: DriveGeometry, sensors: SensorSettings, period: float) -> None:
        errors, self._period, self._track = sensors.odometry, period, drive.track
        scale = 1.0 if sensors.noise else 0.0
        self._walk = scale * errors.variance
        self._tick = 1.0 / drive.counts_per_metre
        drawn = scale * np.array([errors.diameter_error, errors.track_error])
        self._state = np.diag([0.0, 0.0, 0.0, *(drawn**2 / 3.0)])  # of pose and drawn errors

    def update(self, yaw: float, twist: ArrayLike) -> tuple[Array, Array]:
        """Advance by a control period with a heading [rad] and a measured twist (2,) [m/s, rad/s].

        Returns:
            Covariances of x, y and yaw (3, 3) in the frame odom, and of the twist (2, 2).
        """
        v, w = np.asarray(twist).tolist()
        c, s, track, period = math.cos(yaw), math.sin(yaw), self._track, self._period
        ahead = np.array([[c, 0.0], [s, 0.0], [0.0, 1.0]])  # of a way and a turn
        drawn = np.array([[-0.25 * track * w, 0.0], [-v / track, w]])  # twist by the drawn errors
        step = np.eye(5)
        step[:2, 2] = -s * v * period, c * v * period
        step[:3, 3:] = ahead @ drawn * period
        wheels = ahead @ np.array([[0.5, 0.5], [-1.0 / track, 1.0 / track]])
        walks = self._walk * period * np.abs(wheels_of_twist(v, w, track))
        self._state = step @ self._state @ step.T
        self._state[:3, :3] += wheels @ np.diag(walks) @ wheels.T
        # An encoder's count is cut to whole ticks, and a speed is the difference of two counts.
        tick = np.array([0.5, 0.5, 2.0 / track**2]) * self._tick**2 / 12.0
        of_twist = drawn @ self._state[3:, 3:] @ drawn.T + np.diag(2.0 * tick[1:] / period**2)
        return self._state[:3, :3] + np.diag(tick), of_twist
