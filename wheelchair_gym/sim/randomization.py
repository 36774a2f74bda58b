"""Sensor errors and delays that are drawn anew for each episode: one table of settings.

Each row names a quantity and the distribution of its value. Draws depend on the episode's key
alone, so that a row of the vector environment draws as the single environment does.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any, Final, Literal, get_args

import numpy as np

from wheelchair_gym.base.settings import InputError, setting, settings
from wheelchair_gym.compiled.kernel import borrowing_kernel
from wheelchair_gym.compiled.random import RANDOMIZATION, normal, uniform

RandomizedName = Literal[
    "laser.sigma", "laser.bias", "laser.dropout", "laser.x_error", "laser.y_error",
    "laser.yaw_error", "ultrasonic.sigma", "odometry.diameter_error", "odometry.track_error",
    "odometry.variance", "command_delay",
]  # fmt: skip
RANDOMIZED: Final = get_args(RandomizedName)
(
    LASER_SIGMA, LASER_BIAS, LASER_DROPOUT, LASER_X, LASER_Y, LASER_YAW, SONAR_SIGMA, DIAMETER,
    TRACK, VARIANCE, DELAY,
) = range(len(RANDOMIZED))  # fmt: skip
_FARTHEST = 3.46  # deviations: `compiled.random.normal` draws no farther
_EACH = 64  # draws that a row may take: one for each scanner or ranger

# Values of each quantity: drawn ones beyond are clipped, bounds of a distribution beyond refused.
_BOUNDS: Final = dict.fromkeys(RANDOMIZED, (0.0, 1.0))
_BOUNDS["laser.x_error"] = _BOUNDS["laser.y_error"] = (-1.0, 1.0)
_BOUNDS["laser.yaw_error"] = (-math.pi, math.pi)
_BOUNDS["odometry.diameter_error"] = _BOUNDS["odometry.track_error"] = (0.0, 0.2)

DRAW = np.dtype(
    [
        ("distribution", "i8"),  # 0: not drawn, 1: uniform, 2: normal
        ("first", "f8"),  # lower bound, or mean
        ("second", "f8"),  # upper bound, or standard deviation
        ("low", "f8"),  # of the values
        ("high", "f8"),
    ],
    align=True,
)


@settings
class Randomization:
    """One quantity that is drawn for each episode, and its distribution.

    `laser.sigma`, `laser.bias` [m], `laser.dropout`, `ultrasonic.sigma` [m],
    `odometry.diameter_error`, `odometry.track_error`, `odometry.variance` [m2/m] and
    `command_delay` [s] take the place of the setting of that name; scanners and ultrasonics draw
    one each. `laser.x_error`, `laser.y_error` [m] and `laser.yaw_error` [rad] are how far each
    scanner is mounted from where its settings say, which is what the chair believes.
    """

    quantity: RandomizedName = setting(default="laser.sigma")
    """The quantity that is drawn."""
    distribution: Literal["uniform", "normal"] = setting(default="uniform")
    """uniform: between low and high; normal: of a mean and a standard deviation, cut at 3.46
    deviations and at the bounds of the quantity."""
    low: float = setting(default=0.0, unit="of the quantity")
    """Lower bound of a uniform distribution."""
    high: float = setting(default=0.0, unit="of the quantity")
    """Upper bound of a uniform distribution."""
    mean: float = setting(default=0.0, unit="of the quantity")
    """Mean of a normal distribution."""
    std: float = setting(default=0.0, unit="of the quantity", low=0.0)
    """Standard deviation of a normal distribution."""

    def __post_init__(self) -> None:
        (minimum, maximum), where = _BOUNDS[self.quantity], f"randomization of {self.quantity}"
        within, other, names = [self.low, self.high], [self.mean, self.std], "mean and std"
        if self.distribution == "normal":
            within, other, names = [self.mean], within, "low and high"
        if any(other):
            raise InputError(f"{where}: {names} are not of a {self.distribution} distribution")
        if self.distribution == "uniform" and self.low > self.high:
            raise InputError(f"{where}: low is {self.low:g}, above high, {self.high:g}")
        if not all(minimum <= value <= maximum for value in within):
            raise InputError(
                f"{where}: expected values from {minimum:g} to {maximum:g}, not "
                f"{' and '.join(f'{value:g}' for value in within)}"
            )

    @property
    def maximum(self) -> float:
        """The greatest value that is drawn."""
        top = self.high if self.distribution == "uniform" else self.mean + _FARTHEST * self.std
        return min(top, _BOUNDS[self.quantity][1])


def check_randomization(rows: Iterable[Randomization]) -> None:
    """Refuse a quantity that two rows name.

    Raises:
        InputError: the first one that is named again.
    """
    seen = set()
    for row in rows:
        if row.quantity in seen:
            raise InputError(f"randomization names {row.quantity} twice")
        seen.add(row.quantity)


def draws_of(rows: Iterable[Randomization], noise: bool) -> np.ndarray[Any, np.dtype[np.void]]:
    """The table as DRAW (len(RANDOMIZED),); without noise, sensors are not drawn."""
    draws = np.zeros(len(RANDOMIZED), DRAW)
    for row in rows:
        if not (noise or row.quantity == "command_delay"):
            continue
        is_uniform = row.distribution == "uniform"
        numbers = (1, row.low, row.high) if is_uniform else (2, row.mean, row.std)
        draws[RANDOMIZED.index(row.quantity)] = (*numbers, *_BOUNDS[row.quantity])
    return draws


@borrowing_kernel
def drawn(p: Any, key: np.uint64, which: int, item: int, present: float) -> float:
    """The value of a quantity of one item in this episode; `present` where it is not drawn."""
    draw = p.draws[which]
    if draw.distribution == 0:
        return present
    index = _EACH * which + item
    if draw.distribution == 1:
        share = uniform(key, 0, RANDOMIZATION, index)
        value = draw.first + (draw.second - draw.first) * share
    else:
        value = draw.first + draw.second * normal(key, 0, RANDOMIZATION, index)
    return float(min(draw.high, max(draw.low, value)))


@borrowing_kernel
def randomize_sensors(p: Any, key: np.uint64) -> None:
    """Draw the sensor errors and the delay of one episode."""
    for k in range(p.laser_sigma.shape[0]):
        p.laser_sigma[k] = drawn(p, key, LASER_SIGMA, k, p.laser_sigma[k])
        p.laser_bias[k] = drawn(p, key, LASER_BIAS, k, p.laser_bias[k])
        p.laser_dropout[k] = drawn(p, key, LASER_DROPOUT, k, p.laser_dropout[k])
        for axis in range(3):
            p.laser_mount[k, axis] += drawn(p, key, LASER_X + axis, k, 0.0)
    for k in range(p.ranger_sigma.shape[0]):
        p.ranger_sigma[k] = drawn(p, key, SONAR_SIGMA, k, p.ranger_sigma[k])
    p.diameter_error = drawn(p, key, DIAMETER, 0, p.diameter_error)
    p.track_error = drawn(p, key, TRACK, 0, p.track_error)
    p.wheel_variance = drawn(p, key, VARIANCE, 0, p.wheel_variance)
    p.delay = round(drawn(p, key, DELAY, 0, p.delay * p.dt) / p.dt)
