"""Errors, delays and properties of the chair that are drawn anew for each episode.

Each row names a quantity and the distribution of its value; one joint row draws quantities that
depend on each other. Draws depend on the episode's key alone, so that a row of the vector
environment draws as the single environment does.
"""

import math
from collections.abc import Iterable, Mapping
from typing import Any, Final, Literal, get_args

import numpy as np

from wheelchair_gym.base.arrays import Array
from wheelchair_gym.base.settings import InputError, setting, settings
from wheelchair_gym.compiled.address import read_record
from wheelchair_gym.compiled.kernel import borrowing_kernel
from wheelchair_gym.compiled.random import PARAMETERS, RANDOMIZATION, normal, uniform
from wheelchair_gym.engine import GRAVITY

RandomizedName = Literal[
    "laser.sigma", "laser.bias", "laser.dropout", "laser.x_error", "laser.y_error",
    "laser.yaw_error", "ultrasonic.sigma", "odometry.diameter_error", "odometry.track_error",
    "odometry.variance", "command_delay", "laser.offset_error", "odometry.scale_error", "body.mass",
    "body.rolling_resistance", "body.caster_drag", "motor.gain", "motor.resistance",
    "physics.slope",
]  # fmt: skip
RANDOMIZED: Final = get_args(RandomizedName)
(
    LASER_SIGMA, LASER_BIAS, LASER_DROPOUT, LASER_X, LASER_Y, LASER_YAW, SONAR_SIGMA, DIAMETER,
    TRACK, VARIANCE, DELAY, LASER_OFFSET, SCALE, MASS, ROLLING, DRAG, GAIN, RESISTANCE, SLOPE,
) = range(len(RANDOMIZED))  # fmt: skip
_FARTHEST = 3.46  # deviations: `compiled.random.normal` draws no farther
_EACH = 64  # draws that a row may take: one for each scanner or ranger
JOINED = 12  # most quantities of the joint row
_JOINT_DRAWS = 1 << 20  # number of its first draw
_SENSING = "laser.", "ultrasonic.", "odometry."  # quantities of sensors

# Values of each quantity: drawn ones beyond are clipped, bounds of a distribution beyond refused.
_BOUNDS: Final[dict[str, tuple[float, float]]] = {
    **dict.fromkeys(RANDOMIZED, (0.0, 1.0)),
    **dict.fromkeys(("laser.x_error", "laser.y_error", "laser.offset_error"), (-1.0, 1.0)),
    "laser.yaw_error": (-math.pi, math.pi),
    **{f"odometry.{name}_error": (-0.2, 0.2) for name in ("diameter", "track", "scale")},
    "body.mass": (20.0, 400.0), "motor.gain": (0.1, 10.0), "motor.resistance": (0.01, 100.0),
    "physics.slope": (-0.3, 0.3),
}  # fmt: skip

DRAW = read_record("DRAW", globals())[0]


@settings
class Randomization:
    """One quantity that is drawn for each episode, and its distribution.

    `laser.sigma`, `laser.bias` [m], `laser.dropout`, `ultrasonic.sigma` [m], `odometry.variance`
    [m2/m], `command_delay` [s], `body.mass` [kg], `body.rolling_resistance`, `body.caster_drag`,
    `motor.gain`, `motor.resistance` [ohm] and `physics.slope` [rad] take the place of the setting
    of that name; scanners and ultrasonics draw one each.

    The others are errors of what the chair believes, with their sign: `laser.x_error`,
    `laser.y_error`, `laser.offset_error` [m] and `laser.yaw_error` [rad] of each scanner, and the
    relative errors of odometry. `odometry.diameter_error` is the difference of the wheels'
    diameters (right minus left), `odometry.scale_error` that of their mean, `odometry.track_error`
    that of the track.
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
    def bounds(self) -> tuple[float, float]:
        """The least and the greatest value that is drawn."""
        reach, (low, high) = _FARTHEST * self.std, _BOUNDS[self.quantity]
        if self.distribution == "uniform":
            return max(low, self.low), min(high, self.high)
        return max(low, self.mean - reach), min(high, self.mean + reach)


def exactly(values: Mapping[str, float]) -> tuple[Randomization, ...]:
    """Rows that can only draw these values of quantities; other names are left out."""
    return tuple(
        Randomization(name, low=values[name], high=values[name])
        for name in RANDOMIZED
        if name in values
    )


@settings
class JointRandomization:
    """Quantities that are drawn together, from a normal distribution with a covariance.

    So quantities of which a log shows only a combination keep that combination. Of several
    scanners or ultrasonics the first one is drawn. Values are cut at the bounds of each quantity.
    """

    quantities: tuple[RandomizedName, ...] = setting(default=())
    """Quantities that are drawn; see `Randomization`."""
    mean: tuple[float, ...] = setting(default=(), unit="of each quantity")
    """Mean of each quantity."""
    covariance: tuple[tuple[float, ...], ...] = setting(default=(), unit="of the quantities")
    """Covariance of the quantities, a row each."""

    def __post_init__(self) -> None:
        n, rows = len(self.quantities), self.covariance
        if n > JOINED:
            raise InputError(f"joint row: {n} quantities; expected at most {JOINED}")
        if len(self.mean) != n or [len(row) for row in rows] != n * [n]:
            raise InputError(f"joint row: expected {n} means and a covariance of {n} x {n}")
        covariance = np.array(rows, np.float64)
        if n and not np.allclose(covariance, covariance.T, rtol=1e-9, atol=0.0):
            raise InputError("joint row: the covariance is not symmetric")
        if n and (np.diag(covariance) < 0.0).any():
            raise InputError("joint row: the covariance has a negative variance")
        if n and np.linalg.eigvalsh(_correlation(covariance)).min() < -1e-9:
            raise InputError("joint row: the covariance is not positive semidefinite")
        for name, mean in zip(self.quantities, self.mean, strict=True):
            low, high = _BOUNDS[name]
            if not low <= mean <= high:
                raise InputError(f"joint row: mean of {name}: expected {low:g} to {high:g}")

    @property
    def factor(self) -> Array:
        """Matrix A (n, n) of which A A^T is the covariance."""
        covariance = np.array(self.covariance, np.float64)
        values, vectors = np.linalg.eigh(_correlation(covariance))
        scale = np.sqrt(np.diag(covariance))
        factor: Array = scale[:, None] * vectors * np.sqrt(np.maximum(values, 0.0))
        return factor

    def bounds(self, quantity: RandomizedName) -> tuple[float, float]:
        """The least and the greatest value of one of the quantities."""
        k, (low, high) = self.quantities.index(quantity), _BOUNDS[quantity]
        reach = _FARTHEST * float(np.abs(self.factor[k]).sum())
        return max(low, self.mean[k] - reach), min(high, self.mean[k] + reach)


def _correlation(covariance: Array) -> Array:
    """The covariance (n, n) of quantities in units of their deviations."""
    scale = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    scale[scale == 0.0] = 1.0
    correlation: Array = covariance / np.outer(scale, scale)
    return correlation


def draws_of(
    rows: Iterable[Randomization], joint: JointRandomization, noise: bool
) -> np.ndarray[Any, np.dtype[np.void]]:
    """The table as DRAW (len(RANDOMIZED),); without noise, sensors are not drawn."""
    draws = np.zeros(len(RANDOMIZED), DRAW)
    found: list[tuple[RandomizedName, tuple[float, ...]]] = [
        (row.quantity, (1, 0, row.low, row.high))
        if row.distribution == "uniform"
        else (row.quantity, (2, 0, row.mean, row.std))
        for row in rows
    ]
    for k, (name, mean) in enumerate(zip(joint.quantities, joint.mean, strict=True)):
        found.append((name, (3, k, mean, 0.0)))
    for name, numbers in found:
        if noise or not name.startswith(_SENSING):
            draws[RANDOMIZED.index(name)] = (*numbers, *_BOUNDS[name])
    return draws


def factor_of(joint: JointRandomization) -> Array:
    """The factor of the joint row, in the corner of zeros (JOINED, JOINED)."""
    factor, n = np.zeros((JOINED, JOINED)), len(joint.quantities)
    if n:
        factor[:n, :n] = joint.factor
    return factor


@borrowing_kernel
def drawn(p: Any, key: np.uint64, which: int, item: int, present: float) -> float:
    """The value of a quantity of one item in this episode; `present` where it is not drawn."""
    draw = p.draws[which]
    if draw.distribution == 0 or (draw.distribution == 3 and item > 0):
        return present
    index = _EACH * which + item
    if draw.distribution == 1:
        share = uniform(key, 0, RANDOMIZATION, index)
        value = draw.first + (draw.second - draw.first) * share
    elif draw.distribution == 2:
        value = draw.first + draw.second * normal(key, 0, RANDOMIZATION, index)
    else:
        value = draw.first
        for j in range(JOINED):
            share = p.joint_factor[draw.row, j]
            if share != 0.0:
                value += share * normal(key, 0, RANDOMIZATION, _JOINT_DRAWS + j)
    return float(min(draw.high, max(draw.low, value)))


@borrowing_kernel
def _uniform_between(low: float, high: float, key: np.uint64, index: int) -> float:
    """A number between two bounds, drawn from an episode's key."""
    return low + (high - low) * uniform(key, 0, PARAMETERS, index)


@borrowing_kernel
def randomize_parameters(p: Any, key: np.uint64) -> None:
    """Draw what is random about the chair of one episode: errors of sensors, delay and body."""
    for k in range(p.laser_sigma.shape[0]):
        p.laser_sigma[k] = drawn(p, key, LASER_SIGMA, k, p.laser_sigma[k])
        p.laser_bias[k] = drawn(p, key, LASER_BIAS, k, p.laser_bias[k])
        p.laser_dropout[k] = drawn(p, key, LASER_DROPOUT, k, p.laser_dropout[k])
        p.laser_offset[k] += drawn(p, key, LASER_OFFSET, k, 0.0)
        for axis in range(3):
            p.laser_mount[k, axis] += drawn(p, key, LASER_X + axis, k, 0.0)
    for k in range(p.ranger_sigma.shape[0]):
        p.ranger_sigma[k] = drawn(p, key, SONAR_SIGMA, k, p.ranger_sigma[k])
    p.wheel_variance = drawn(p, key, VARIANCE, 0, p.wheel_variance)
    p.delay = round(drawn(p, key, DELAY, 0, p.delay * p.dt) / p.dt)
    p.mass = _uniform_between(p.mass_range[0], p.mass_range[1], key, 0)
    p.friction = _uniform_between(p.friction_range[0], p.friction_range[1], key, 1)
    p.gain = _uniform_between(p.gain_range[0], p.gain_range[1], key, 2)
    p.gain *= drawn(p, key, GAIN, 0, p.motor.gain)
    p.mass = drawn(p, key, MASS, 0, p.mass)
    body, motor = p.body, p.motor
    body.rolling_resistance = drawn(p, key, ROLLING, 0, body.rolling_resistance)
    body.caster_drag = drawn(p, key, DRAG, 0, body.caster_drag)
    motor.resistance = drawn(p, key, RESISTANCE, 0, motor.resistance)
    p.slope = drawn(p, key, SLOPE, 0, p.slope)
    along = GRAVITY * math.sin(p.slope)
    p.pull[0], p.pull[1] = along * math.cos(p.downhill), along * math.sin(p.downhill)
    p.moment = p.mass * p.body.radius_of_gyration**2
    e_d = drawn(p, key, DIAMETER, 0, p.diameter_error * _uniform_between(-1.0, 1.0, key, 3))
    e_b = drawn(p, key, TRACK, 0, p.track_error * _uniform_between(-1.0, 1.0, key, 4))
    scale = 1.0 + drawn(p, key, SCALE, 0, 0.0)
    p.track = p.nominal_track * (1.0 + e_b)
    p.radius_left = p.nominal_radius * (1.0 - 0.5 * e_d) * (scale * p.wheel_share[0])
    p.radius_right = p.nominal_radius * (1.0 + 0.5 * e_d) * (scale * p.wheel_share[1])
