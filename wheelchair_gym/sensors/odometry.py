"""Encoders, dead reckoning and the pose that a chair believes in.

Systematic errors come from the chair itself: its wheels and track differ from what it believes them
to be. What is added here grows with the way: variance in proportion to each wheel's distance.
"""

from __future__ import annotations

import math
from typing import Any

from wheelchair_gym.compiled.kernel import borrowing_kernel
from wheelchair_gym.geometry import wrap
from wheelchair_gym.kinematics import odometric_step, twist_of_wheels
from wheelchair_gym.random import POSE, WHEELS, normal
from wheelchair_gym.sensors.settings import POSE_SOURCES

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
        way = (counts - state.measured_counts[i]) / p.counts_per_metre
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
