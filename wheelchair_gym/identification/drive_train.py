"""Motors, resistance and slope from duty, voltage and counts of a drive.

Along the heading a chair of mass m on wheels of radius r obeys

    M dv/dt = k U - 2 (k K / r) v - F s(v) - m g sin(slope) cos(heading - downhill),

with M = m + 2 I / r^2 (I: inertia of rotor and wheel), U the sum of both motors' voltages, k =
gain K / (R r), and s(v) the sign of the speed, smooth about rest. About the vertical axis the same
holds with the difference of the voltages; only straight drives are used. A log shows k / M, K / r,
F / M and the slope. It does not show mass, gain and resistance apart: that takes scales.

Each term is multiplied by a function that vanishes, with its slope, at both ends of a window, and
integrated by parts (modulating functions; Shinbrot 1957, On the Analysis of Linear and Nonlinear
Systems, Transactions ASME 79). So speeds and accelerations are never differenced from counts: the
equation of a window is linear in the unknowns, and only travel and voltage enter.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.base.arrays import Array
from wheelchair_gym.engine import GRAVITY
from wheelchair_gym.identification.logs import DriveLog

_PULL = slice(3, 5)  # places of the pull in an array of values
_WINDOW, _EVERY = 1.0, 0.1  # s: of a window, and between the starts of two
_PERIOD = 0.02  # s: travel and voltage are sampled anew
_SLOWEST = 0.02  # m/s: in windows with slower moments, brakes or dry friction may hold
_STRAIGHT = 0.08  # rad/s: in arcs, casters drag otherwise, and the mass ahead of the axle pushes
_CREEP = 0.05  # m/s: as in `sim.drive_train`
_BLOCK = 30  # windows that are drawn together
_DRAWS = 400
_MIN_WINDOWS = 60


class DriveTrain(NamedTuple):
    """Push, damping, drag, and pull along x and y; and how certain they are."""

    values: Array  # (5,) m/s2 per V; 1/s; m/s2; m/s2; m/s2
    covariance: Array  # (5, 5)


def fit_drive_train(
    log: DriveLog, scale: float, path: Array, max_volts: float, rng: np.random.Generator
) -> DriveTrain:
    """Find push, damping, drag and pull of a chair.

    Args:
        log: with voltages.
        scale: true travel over that of the log.
        path: (n, 3) poses at the reports of the wheels.
        max_volts: greatest difference [V] of a motor's voltage and its back-EMF; above it the
            driver limits its current, and a window is not used.
        rng: of the bootstrap.

    Raises:
        ValueError: the log has no voltages, or too little of it is driven.
    """
    if not np.isfinite(log.volts).any():
        raise ValueError("duty and voltage of the motors were not recorded")
    times = np.arange(log.stamps[0], log.stamps[-1], _PERIOD)
    way = np.interp(times, log.stamps, scale * log.travel.mean(axis=1))
    volts = np.interp(times, log.stamps, log.volts.sum(axis=1))
    yaw = np.interp(times, log.stamps, path[:, 2])
    n = round(_WINDOW / _PERIOD)
    share = np.arange(n + 1) / n
    bump = np.sin(np.pi * share) ** 4
    slope = 4.0 * np.pi / _WINDOW * np.sin(np.pi * share) ** 3 * np.cos(np.pi * share)
    bend = (np.pi / _WINDOW) ** 2 * (
        12.0 * np.sin(np.pi * share) ** 2 * np.cos(np.pi * share) ** 2 - 4.0 * bump
    )
    smooth = np.convolve(np.gradient(way, _PERIOD), np.ones(5) / 5.0, "same")  # for signs alone
    turn = np.convolve(np.gradient(yaw, _PERIOD), np.ones(5) / 5.0, "same")
    sign = smooth / np.sqrt(smooth**2 + _CREEP**2)
    rows, right = [], []
    for start in range(0, len(way) - n, round(_EVERY / _PERIOD)):
        at = slice(start, start + n + 1)
        bent = np.abs(turn[at]).max() > _STRAIGHT
        if bent or np.abs(smooth[at]).min() < _SLOWEST or np.abs(volts[at]).max() > max_volts:
            continue
        distance = way[at] - way[start]
        along = np.cos(yaw[at]), np.sin(yaw[at])
        rows.append([
            bump @ volts[at], slope @ distance, -(bump @ sign[at]),
            *(bump @ part for part in along),
        ])  # fmt: skip
        right.append(bend @ distance)
    if len(rows) < _MIN_WINDOWS:
        raise ValueError(
            f"it drives straight for {len(rows) * _EVERY:.0f} s without a stop; expected "
            f"{_MIN_WINDOWS * _EVERY:.0f} s, with changes of speed, also backwards"
        )
    matrix, target = np.array(rows), np.array(right)
    blocks = np.arange(len(rows)) // _BLOCK
    values = _solve(matrix, target, np.ones(len(rows)))
    count = int(blocks[-1]) + 1
    drawn = [rng.integers(0, count, count) for _ in range(_DRAWS)]
    often = [np.bincount(each, minlength=count)[blocks] for each in drawn]
    draws = np.array([_solve(matrix, target, each) for each in often])
    return DriveTrain(values, np.cov(draws.T))


def _solve(matrix: Array, target: Array, counts: NDArray[Any]) -> Array:
    """Least squares of windows that count several times."""
    weights = np.sqrt(counts)
    found = np.linalg.lstsq(weights[:, None] * matrix, weights * target, rcond=None)[0]
    return np.asarray(found, np.float64)


def slope_of(train: DriveTrain, share: float) -> tuple[float, float, float]:
    """Slope [rad], its deviation, and the direction in which it falls, in the frame of the path.

    `share` is M / m: gravity moves the rotors, too.
    """
    x, y = train.values[_PULL]
    pull = float(np.hypot(x, y))
    deviation = float(np.sqrt(max(np.linalg.eigvalsh(train.covariance[_PULL, _PULL]))))
    per = share / GRAVITY
    return pull * per, deviation * per, float(np.arctan2(y, x))
