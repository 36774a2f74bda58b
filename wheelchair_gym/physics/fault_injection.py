"""Sensors that fail: what readings hold from then on. The truth does not change."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from wheelchair_gym.arrays import Floats
from wheelchair_gym.compiled.address import floats_at
from wheelchair_gym.compiled.kernel import borrowing_kernel
from wheelchair_gym.physics.state import FAULTS
from wheelchair_gym.random import FAULTS as CHANNEL
from wheelchair_gym.random import uniform
from wheelchair_gym.sensors.odometry import ODOMETRY
from wheelchair_gym.sensors.scanners import scanner_at

_KINDS = len(FAULTS) - 1
_NAN = np.float32(np.nan)
_LASER, _LASER_FROZEN, _SONAR, _SONAR_FROZEN, _ODOMETRY, _ODOMETRY_FROZEN = range(1, 7)


@borrowing_kernel
def draw_fault(state: Any, p: Any, suite: Any) -> None:
    """Draw which sensor fails in this episode, and from which reading on, by the key of the state.

    `state.fault` is 0 for none; `state.fault_step` is the control step of the first wrong reading.
    Of several scanners one fails. Sensors that the chair does not have are left out.
    """
    state.fault = 0
    if p.fault_share <= 0.0 or uniform(state.key, 0, CHANNEL, 0) >= p.fault_share:
        return
    no_laser, no_sonar = suite.n_scanners == 0, suite.rangers == 0
    kinds = _KINDS - (2 if no_laser else 0) - (2 if no_sonar else 0)
    fault = 1 + int(kinds * uniform(state.key, 0, CHANNEL, 1))
    fault += 2 if no_laser else 0
    state.fault = fault + (2 if no_sonar and fault >= _SONAR else 0)
    which = int(suite.n_scanners * uniform(state.key, 0, CHANNEL, 3))
    state.fault_beams[0] = state.fault_beams[1] = 0
    if not no_laser:
        laser = scanner_at(suite.scanners, suite.n_scanners, which)
        state.fault_beams[0] = laser.start
        state.fault_beams[1] = laser.start + laser.cosine.shape[0]
    window = p.fault_onset[1] - p.fault_onset[0]  # s
    begin = p.fault_onset[0] + window * uniform(state.key, 0, CHANNEL, 2)
    state.fault_step = max(1, math.ceil(begin / (p.dt * p.substeps)))


@borrowing_kernel
def apply_fault(state: Any, p: Any, kept: np.uint64, ranges: Floats, sensed: Any) -> None:
    """Replace parts of a reading by what failing sensors report.

    `kept` is the address of the ranges (beams,) that a frozen laser repeats.
    """
    if state.fault == 0 or state.step < state.fault_step - 1:
        return
    scan, rangers = floats_at(kept, ranges.shape[0]), state.frozen_ranges.shape[0]
    if state.step == state.fault_step - 1:  # the last that is right
        for k in range(ranges.shape[0]):
            scan[k] = ranges[k]
        for k in range(rangers):
            state.frozen_ranges[k], state.frozen_age[k] = sensed.ultrasonic[k], sensed.age[k]
        for k in range(2):
            state.frozen_twist[k] = sensed.twist[k]
        for k in range(3):
            state.frozen_pose[k] = sensed.pose[k]
        return
    fault = state.fault
    if fault in (_LASER, _LASER_FROZEN):
        for k in range(state.fault_beams[0], state.fault_beams[1]):
            ranges[k] = _NAN if fault == _LASER else scan[k]
    elif fault in (_SONAR, _SONAR_FROZEN):
        silent = np.float32((state.step - state.fault_step + 1) * p.substeps * p.dt)
        for k in range(rangers):
            sensed.ultrasonic[k] = state.frozen_ranges[k]
            sensed.age[k] = state.frozen_age[k] + (silent if fault == _SONAR else np.float32(0.0))
    else:
        for k in range(2):
            sensed.twist[k] = math.nan if fault == _ODOMETRY else state.frozen_twist[k]
        if p.pose_source == ODOMETRY:
            for k in range(3):
                sensed.pose[k] = state.frozen_pose[k]
