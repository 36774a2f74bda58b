"""Sensors that fail: what readings hold from then on. The truth does not change."""

import math
from typing import Any

import numpy as np

from wheelchair_gym.base.arrays import Floats
from wheelchair_gym.compiled.address import floats_at
from wheelchair_gym.compiled.kernel import borrowing_kernel
from wheelchair_gym.compiled.random import FAULTS as CHANNEL
from wheelchair_gym.compiled.random import normal, uniform
from wheelchair_gym.sensors.laser import scanner_at
from wheelchair_gym.sensors.odometry import ODOMETRY
from wheelchair_gym.sim.state import DECEITS, FAULTS

_KINDS = len(FAULTS) - 1
_NAN, _INF = np.float32(np.nan), np.float32(np.inf)
_LASERS = 2 + len(DECEITS)  # kinds of the laser, which come first
(
    _SILENT, _FROZEN, _LATE, _REPEATS, _JITTERS, _STUCK, _BLIND, _MIRRORED, _TURNED, _MOVED,
    _SONAR, _SONAR_FROZEN, _ODOMETRY, _ODOMETRY_FROZEN,
) = range(1, _KINDS + 1)  # fmt: skip
PAST = 16  # scans that are kept
_MAX_DELAY = 1.0  # s of late scans, at most PAST - 1 scans
_RING = 2, 5  # scans that are repeated
_JITTER = 0.001, 0.010  # m
_NOISE = 0.015  # m of a mirror that stands
_SECTOR = math.radians(5.0), math.radians(60.0)
_TURN = math.radians(2.0), math.radians(180.0)
_SHIFT = 0.05, 0.50  # m
_SIZE, _PLACE, _BEAMS = 4, 5, 16  # draws of a fault's size, its place or direction, its beams


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
    kinds = _KINDS - (_LASERS if no_laser else 0) - (2 if no_sonar else 0)
    fault = 1 + int(kinds * uniform(state.key, 0, CHANNEL, 1))
    fault += _LASERS if no_laser else 0
    state.fault = fault + (2 if no_sonar and fault >= _SONAR else 0)
    state.fault_scanner = int(suite.n_scanners * uniform(state.key, 0, CHANNEL, 3))
    window = p.fault_onset[1] - p.fault_onset[0]  # s
    begin = p.fault_onset[0] + window * uniform(state.key, 0, CHANNEL, 2)
    state.fault_step = max(1, math.ceil(begin / (p.dt * p.substeps)))


@borrowing_kernel
def _drawn(state: Any, bounds: tuple[float, float]) -> float:
    """The size of a fault, between bounds."""
    return bounds[0] + (bounds[1] - bounds[0]) * uniform(state.key, 0, CHANNEL, _SIZE)


@borrowing_kernel
def _displace(state: Any, p: Any) -> None:
    """Turn or move the scanner that fails."""
    mount, place = p.laser_mount[state.fault_scanner], uniform(state.key, 0, CHANNEL, _PLACE)
    if state.fault == _TURNED:
        mount[2] += math.copysign(_drawn(state, _TURN), place - 0.5)
    elif state.fault == _MOVED:
        mount[0] += _drawn(state, _SHIFT) * math.cos(2.0 * math.pi * place)
        mount[1] += _drawn(state, _SHIFT) * math.sin(2.0 * math.pi * place)


@borrowing_kernel
def _deceive(state: Any, p: Any, one: Any, past: Floats, scan: Floats) -> None:
    """Replace the scan of a failing scanner; `past` holds earlier ones, one after another."""
    fault, last, beams = state.fault, state.fault_step - 1, scan.shape[0]
    place = uniform(state.key, 0, CHANNEL, _PLACE)
    if fault == _LATE:
        maximum = min(PAST - 1, round(_MAX_DELAY / (p.dt * p.substeps)))
        last = max(0, state.step - 1 - int(maximum * uniform(state.key, 0, CHANNEL, _SIZE)))
    elif fault == _REPEATS:
        ring = _RING[0] + int((_RING[1] - _RING[0] + 1) * uniform(state.key, 0, CHANNEL, _SIZE))
        last = max(0, last - (state.step - state.fault_step) % ring)
    if _FROZEN <= fault <= _STUCK:
        sigma, ahead = 0.0, scan[int(place * beams)]
        if fault >= _JITTERS:
            sigma = _drawn(state, _JITTER) if fault == _JITTERS else _NOISE
        for k in range(beams):
            noise = np.float32(normal(state.key, state.step, CHANNEL, _BEAMS + k))
            shown = ahead if fault == _STUCK else past[last % PAST * beams + k]
            scan[k] = shown + np.float32(sigma) * noise
    elif fault == _MIRRORED:
        for k in range(beams // 2):
            scan[k], scan[beams - 1 - k] = scan[beams - 1 - k], scan[k]
    else:
        half = 0.5 * _drawn(state, _SECTOR) * one.per_angle
        for k in range(beams):
            if fault == _SILENT:
                scan[k] = _NAN
            elif fault == _BLIND and abs(k - place * beams) < half:
                scan[k] = _INF


@borrowing_kernel
def apply_fault(
    state: Any, p: Any, suite: Any, kept: np.uint64, ranges: Floats, sensed: Any
) -> None:
    """Replace parts of a reading by what failing sensors report.

    `kept` is the address of memory for `PAST` scans of all beams.
    """
    fault, rangers = state.fault, state.frozen_ranges.shape[0]
    if fault == 0:
        return
    if fault <= _LASERS:
        one = scanner_at(suite.scanners, suite.n_scanners, state.fault_scanner)
        scan = ranges[one.start : one.start + one.cosine.shape[0]]
        past, beams = floats_at(kept, PAST * scan.shape[0]), scan.shape[0]
        if state.step < state.fault_step or fault == _LATE:
            for k in range(beams):
                past[state.step % PAST * beams + k] = scan[k]
        if state.step == state.fault_step - 1:
            _displace(state, p)
        elif state.step >= state.fault_step:
            _deceive(state, p, one, past, scan)
        return
    if state.step < state.fault_step - 1:
        return
    if state.step == state.fault_step - 1:  # the last that is right
        for k in range(rangers):
            state.frozen_ranges[k], state.frozen_age[k] = sensed.ultrasonic[k], sensed.age[k]
        for k in range(2):
            state.frozen_twist[k] = sensed.twist[k]
        for k in range(3):
            state.frozen_pose[k] = sensed.pose[k]
        return
    if fault in (_SONAR, _SONAR_FROZEN):
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
