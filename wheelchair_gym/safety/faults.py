"""Detects sensor faults: sensors that are silent, repeat their data, or are blind.

A scan without echoes is accepted only without evidence against it: the previous scan predicts what
is still in view, and ultrasonics may measure what the laser misses.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.compiled.kernel import borrowing_kernel
from wheelchair_gym.geometry import wrap
from wheelchair_gym.safety.state import (
    BUMPED,
    ECHOES,
    LASER_BLIND,
    LASER_FROZEN,
    LASER_SILENT,
    ODOMETRY_FROZEN,
    ODOMETRY_SILENT,
    SONAR_FROZEN,
    SONAR_SILENT,
)

Array = NDArray[np.float64]
Floats = NDArray[np.float32]

_FACTOR = np.uint64(0x9E3779B97F4A7C15)
_STIRRED = 1e-3  # m or rad in a period: a chair that moves more sees something else
_ASKED_V, _ASKED_W = 0.1, 0.25  # m/s, rad/s: so told, wheels that count nothing are not believed
_OFF_V, _OFF_W = 0.25, 0.5  # m/s, rad/s: so far from what they are told, wheels are astray
_ASTRAY = 0.5  # s
_ROUND = 1e-6  # s
_FEW = 0.02  # share of the beams that should have an echo: with fewer the laser is taken for blind
_LEAST = 2  # of the beams kept that should have an echo, for that to be said
_EDGE = 0.3  # rad from the end of the fan: what moves may have left it since
_FAR = 1.0  # m: the same, of the laser's reach


@borrowing_kernel
def hash_value(value: float, salt: int) -> np.uint64:
    """A hash of a number, also of NaN and infinities."""
    # Whatever is invalid has a word of its own; the others are told apart to 2^-30 m.
    if value != value:
        word = np.uint64(1)
    elif value == math.inf:
        word = np.uint64(2)
    elif value == -math.inf:
        word = np.uint64(3)
    else:
        word = np.uint64(np.int64(value * 1073741824.0)) + np.uint64(4)
    return (word + np.uint64(salt)) * _FACTOR


@borrowing_kernel
def hash_floats(values: Floats, begin: np.uint64) -> np.uint64:
    """A hash of float32 numbers (n,), continued from another hash."""
    h = begin
    for k in range(values.shape[0]):
        word = hash_value(float(values[k]), k)
        h += (word ^ (word >> np.uint64(29))) * _FACTOR
    return h


@borrowing_kernel
def valid_share(laser: Floats) -> float:
    """Share of beams that are not invalid (NaN)."""
    valid = 0
    for k in range(laser.shape[0]):
        valid += laser[k] == laser[k]
    return float(valid / laser.shape[0])


@borrowing_kernel
def count_echoes(laser: Floats) -> int:
    """Number of beams with an echo, those that are too near to be measured included."""
    echoes = 0
    for k in range(laser.shape[0]):
        echoes += laser[k] < math.inf
    return echoes


@borrowing_kernel
def expected_echoes(g: Any, s: Any) -> int:
    """Number of an earlier scan's echoes that should be in view from the present pose."""
    half = -g.first - _EDGE
    cosine, sine = math.cos(s.pose[2]), math.sin(s.pose[2])
    x = s.pose[0] + cosine * g.mount[0] - sine * g.mount[1]
    y = s.pose[1] + sine * g.mount[0] + cosine * g.mount[1]
    yaw = s.echo_pose[2]
    old_x = s.echo_pose[0] + math.cos(yaw) * g.mount[0] - math.sin(yaw) * g.mount[1]
    old_y = s.echo_pose[1] + math.sin(yaw) * g.mount[0] + math.cos(yaw) * g.mount[1]
    yaw += g.mount[2]
    count = 0
    for k in range(ECHOES):
        if not g.nearest <= s.echo[k] < g.reach:
            continue
        beam = k * (g.beams - 1) // (ECHOES - 1)
        way = yaw + g.first + beam / g.per_angle
        dx = old_x + s.echo[k] * math.cos(way) - x
        dy = old_y + s.echo[k] * math.sin(way) - y
        far = math.hypot(dx, dy)
        bearing = wrap(math.atan2(dy, dx) - s.pose[2] - g.mount[2])
        count += g.nearest < far < g.reach - _FAR and abs(bearing) < half
    return count


@borrowing_kernel
def laser_is_blind(g: Any, s: Any, laser: Floats, echoes: int, dt: float) -> bool:
    """Whether scans have lacked echoes, against the evidence, for too long."""
    beams, should, heard = laser.shape[0], 0, 0
    if echoes < _FEW * beams:
        should = expected_echoes(g, s)
        for k in range(s.n_arc.shape[0]):
            heard += s.n_arc[k] > 0
    if should >= _LEAST and echoes * ECHOES < _FEW * should * beams:
        s.laser_blind += dt
    else:
        s.laser_blind = 0.0
        for k in range(ECHOES):
            s.echo[k] = laser[k * (beams - 1) // (ECHOES - 1)]
        for k in range(3):
            s.echo_pose[k] = s.pose[k]
    if heard > 0 and echoes == 0:
        s.laser_denied += dt
    else:
        s.laser_denied = 0.0
    blind = s.laser_blind > g.stale_laser + g.period + _ROUND
    denied = s.laser_denied > g.stale_ultrasonic + g.period + _ROUND
    return bool(blind or denied)


@borrowing_kernel
def check_sensors(
    g: Any, s: Any, pose: Array, twist: Array, laser: Floats, ultrasonic: Floats, age: Floats,
    bumped: bool, halted: bool, dt: float,
) -> bool:  # fmt: skip
    """Detect faults and latch them; returns whether the scan is new and trusted."""
    reason = 0
    finite = math.isfinite(twist[0] + twist[1])
    moves = not finite or abs(twist[0]) * dt > _STIRRED or abs(twist[1]) * dt > _STIRRED
    # laser
    half = 0.5
    if valid_share(laser) < half:
        s.laser_silent += dt
    else:
        s.laser_silent = 0.0
    now, echoes = hash_floats(laser, np.uint64(0)), count_echoes(laser)
    fresh = not s.begun or now != s.laser_hash or echoes == 0  # no noise tells empty scans apart
    valid = valid_share(laser) >= half
    if valid and laser_is_blind(g, s, laser, echoes, dt):
        reason = LASER_BLIND
    if fresh:
        s.laser_frozen = 0.0
    elif moves:
        s.laser_frozen += dt
    s.laser_hash = now
    # ultrasonics
    mounted = False
    for k in range(age.shape[0]):
        if age[k] == math.inf:  # never heard
            continue
        mounted = True
        if ultrasonic[k] == ultrasonic[k] and age[k] <= g.stale_ultrasonic:
            s.sonar_silent[k] = 0.0
        else:
            s.sonar_silent[k] += dt
        old = float(age[k]) if age[k] == age[k] else s.sonar_silent[k]
        if max(old, s.sonar_silent[k]) > g.stale_ultrasonic + _ROUND:
            reason = SONAR_SILENT
    now = hash_floats(age, hash_floats(ultrasonic, np.uint64(0)))
    if mounted and moves and s.begun and now == s.sonar_hash:
        s.sonar_frozen += dt
    else:
        s.sonar_frozen = 0.0
    s.sonar_hash = now
    if s.sonar_frozen > g.stale_ultrasonic + _ROUND:
        reason = SONAR_FROZEN
    if s.laser_frozen > g.stale_laser + _ROUND:
        reason = LASER_FROZEN
    if s.laser_silent > g.stale_laser + _ROUND:
        reason = LASER_SILENT
    # odometry
    same = s.begun and finite
    for k in range(3):
        same = same and pose[k] == s.told[k]
    for k in range(2):
        same = same and twist[k] == s.told[3 + k]
    still = twist[0] == 0.0 and twist[1] == 0.0
    told = abs(s.set[0]) > _ASKED_V or abs(s.set[2]) > _ASKED_W
    if finite:
        s.odometry_silent = 0.0
    else:
        s.odometry_silent += dt
    if not halted and ((same and not still) or (finite and still and told)):
        s.odometry_frozen += dt
    else:
        s.odometry_frozen = 0.0
    off = abs(twist[0] - s.set[0]) > _OFF_V or abs(twist[1] - s.set[2]) > _OFF_W
    if not halted and finite and off:
        s.astray += dt
    else:
        s.astray = 0.0
    if s.odometry_frozen > g.stale_odometry + _ROUND or s.astray > _ASTRAY:
        reason = ODOMETRY_FROZEN
    if s.odometry_silent > g.stale_odometry + _ROUND:
        reason = ODOMETRY_SILENT
    if bumped:
        reason = BUMPED
    if reason > 0:
        s.latched, s.rearmed = reason, False  # nobody re-arms what still fails
    for k in range(3):
        s.told[k] = pose[k]
    for k in range(2):
        s.told[3 + k] = twist[k]
    return fresh and s.laser_blind == 0.0  # a scan that is doubted clears nothing
