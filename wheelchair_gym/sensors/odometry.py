"""Encoders, dead reckoning with its covariance, and the pose that a chair believes in.

Systematic errors come from the chair itself: its wheels and track differ from what it believes them
to be. What is added here grows with the way: variance in proportion to each wheel's distance.
"""

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from wheelchair_gym.base.arrays import Array
from wheelchair_gym.compiled.kernel import borrowing_kernel
from wheelchair_gym.compiled.random import POSE, WHEELS, normal
from wheelchair_gym.geometry.kinematics import (
    DriveGeometry,
    odometric_step,
    twist_of_wheels,
    wheels_of_twist,
)
from wheelchair_gym.geometry.planar import wrap
from wheelchair_gym.sensors.settings import POSE_SOURCES, SensorSettings

TRUTH, ODOMETRY, MODELLED = map(POSE_SOURCES.index, ("truth", "odometry", "modelled"))


@borrowing_kernel
def update_pose_estimate(state: Any, p: Any, keep: float) -> None:
    """Set the pose the chair believes in; `keep` is the share of the last error that remains."""
    fresh = math.sqrt(1.0 - keep * keep)
    for i in range(3):
        if p.pose_source == TRUTH:
            state.estimated_pose[i] = state.pose[i]
        elif p.pose_source == ODOMETRY:
            state.estimated_pose[i] = state.odometry[i]
        else:
            draw = fresh * p.pose_sigma[i] * normal(state.key, state.step, POSE, i)
            error = keep * state.pose_error[i] + draw
            state.pose_error[i] = min(p.pose_max[i], max(-p.pose_max[i], error))
            state.estimated_pose[i] = state.pose[i] + state.pose_error[i]
    state.estimated_pose[2] = wrap(state.estimated_pose[2])


@borrowing_kernel
def update_odometry(state: Any, p: Any) -> None:
    """One reading of the encoders: twist, dead-reckoned pose, and the pose source's pose."""
    distances = (0.0, 0.0)
    for i in range(2):
        counts = math.floor(state.turned[i] * p.nominal_radius * p.counts_per_metre)
        way = (counts - state.measured_counts[i]) / p.counts_per_metre * p.wheel_share[i]
        state.measured_counts[i] = counts
        distances = (way, distances[1]) if i == 0 else (distances[0], way)
    period = p.dt * p.substeps
    v, w = twist_of_wheels(distances[0] / period, distances[1] / period, p.nominal_track)
    state.measured_twist[0], state.measured_twist[1] = v, w
    noise_l = normal(state.key, state.step, WHEELS, 0)
    noise_r = normal(state.key, state.step, WHEELS, 1)
    left = distances[0] + math.sqrt(p.wheel_variance * abs(distances[0])) * noise_l
    right = distances[1] + math.sqrt(p.wheel_variance * abs(distances[1])) * noise_r
    way, turn = twist_of_wheels(left, right, p.nominal_track)
    x, y, yaw = odometric_step(state.odometry[0], state.odometry[1], state.odometry[2], way, turn)
    state.odometry[0], state.odometry[1], state.odometry[2] = x, y, wrap(yaw)
    keep = math.exp(-period / p.pose_time) if p.pose_source == MODELLED else 0.0
    update_pose_estimate(state, p, keep)


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
