"""Twist and wheels, the odometric model and the chair's limits.

A differential drive: v = (v_R + v_L) / 2 and w = (v_R - v_L) / track.
A twist is (v, w) [m/s, rad/s].
"""

import dataclasses
import math
from collections.abc import Callable
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.base.arrays import Array
from wheelchair_gym.base.settings import InputError, setting, settings
from wheelchair_gym.compiled.kernel import borrowing_kernel, kernel

_THERE = 1e-12  # m/s, rad/s: an approach that is this near has arrived; the rest is rounding


@borrowing_kernel
def twist_of_action(
    a_v: float, a_w: float, forward: float, backward: float, turn: float
) -> tuple[float, float]:
    """The twist [m/s, rad/s] that an action asks for; beyond [-1, 1] it is clipped."""
    a_v = 1.0 if a_v > 1.0 else -1.0 if a_v < -1.0 else a_v
    a_w = 1.0 if a_w > 1.0 else -1.0 if a_w < -1.0 else a_w
    return a_v * (forward if a_v > 0.0 else backward), a_w * turn


@borrowing_kernel
def action_of_twist(
    v: float, w: float, forward: float, backward: float, turn: float
) -> tuple[float, float]:
    """The action in [-1, 1] that asks for a twist [m/s, rad/s], clipped to the limits."""
    full = forward if v > 0.0 else backward
    a_v, a_w = (v / full if full > 0.0 else 0.0), w / turn
    a_v = 1.0 if a_v > 1.0 else -1.0 if a_v < -1.0 else a_v
    return a_v, 1.0 if a_w > 1.0 else -1.0 if a_w < -1.0 else a_w


def numbers_of(action: Any) -> tuple[float, float]:
    """The two numbers of an action (2,).

    Raises:
        InputError: it is not two finite numbers.
    """
    try:
        array = np.asarray(action)
        a_v, a_w = array.tolist() if array.dtype.kind in "biuf" else (math.nan, math.nan)
        finite = math.isfinite(a_v) and math.isfinite(a_w)
    except (TypeError, ValueError):
        finite = False
    if not finite:
        raise InputError(f"action is {action!r}; expected two finite numbers in [-1, 1]")
    return float(a_v), float(a_w)


_kernels: Any = twist_of_action, action_of_twist
_InPython = Callable[..., tuple[float, float]]  # faster than calling compiled code
_twist_in_python: _InPython = _kernels[0].py_func
_action_in_python: _InPython = _kernels[1].py_func


@settings
class Limits:
    """Limits of the chair's motion; protective braking is exempt from comfort limits."""

    forward: float = setting(
        default=0.8, unit="m/s", low=0.05, high=2.0, source="indoors people drive far below maximum"
    )
    """Largest speed forward."""
    backward: float = setting(
        default=0.3, unit="m/s", low=0.0, high=2.0, source="design choice: no sensor looks back"
    )
    """Largest speed backward."""
    turn: float = setting(
        default=1.0, unit="rad/s", low=0.05, high=4.0, source="common indoor powered chairs"
    )
    """Largest turn rate."""
    acceleration: float = setting(default=0.5, unit="m/s2", low=0.05, high=5.0, source="comfort")
    """Largest acceleration away from rest."""
    deceleration: float = setting(default=0.8, unit="m/s2", low=0.05, high=5.0, source="comfort")
    """Largest deceleration towards rest."""
    protective: float = setting(
        default=1.5, unit="m/s2", low=0.05, high=5.0, source="above comfort, within the tyres' grip"
    )
    """Deceleration of a protective stop, which is exempt from jerk."""
    turn_acceleration: float = setting(
        default=1.5, unit="rad/s2", low=0.05, high=10.0, source="comfort"
    )
    """Largest turn acceleration."""
    jerk: float = setting(
        default=1.0, unit="m/s3", low=0.1, high=100.0, source="comfort grows worse with jerk"
    )
    """Largest change of acceleration per second."""
    turn_jerk: float = setting(
        default=6.0, unit="rad/s3", low=0.1, high=100.0, source="full turn acceleration in 0.25 s"
    )
    """Largest change of turn acceleration per second."""

    @property
    def record(self) -> Any:
        """A record of LIMITS with the fields above, as kernels take it."""
        return np.array(dataclasses.astuple(self), LIMITS)[()]

    def twist(self, action: NDArray[np.floating]) -> Array:
        """The target twist (2,) [m/s, rad/s] that an action (2,) in [-1, 1] asks for.

        Raises:
            InputError: the action is not two finite numbers.
        """
        return np.array(self.twist_of(*numbers_of(action)))

    def twist_of(self, a_v: float, a_w: float) -> tuple[float, float]:
        """The target twist [m/s, rad/s] of an action's two numbers."""
        return _twist_in_python(a_v, a_w, self.forward, self.backward, self.turn)

    def action(self, twist: NDArray[np.floating]) -> Array:
        """The action (2,) in [-1, 1] that asks for a twist (2,), clipped to the limits."""
        limits = self.forward, self.backward, self.turn
        return np.array(_action_in_python(float(twist[0]), float(twist[1]), *limits))


LIMITS: Final = np.dtype([(f.name, "f8") for f in dataclasses.fields(Limits)], align=True)


@settings
class DriveGeometry:
    """The two drive wheels, as the chair's computer believes them to be."""

    track: float = setting(default=0.54, unit="m", low=0.1, source="common hub motors")
    """Distance between the two drive wheels."""
    wheel_radius: float = setting(default=0.165, unit="m", low=0.02, high=1.0, source="hub motors")
    """Radius of the drive wheels."""
    counts_per_metre: float = setting(
        default=4346.0, unit="1/m", low=1.0, source="encoder of the prototype"
    )
    """Encoder counts per metre of a wheel's path, of the mean wheel."""
    wheel_ratio: float = setting(
        default=1.0, low=0.8, high=1.25, source="equal tyres; `wheelchair fit` measures it"
    )
    """Diameter of the right wheel over that of the left one."""

    @property
    def wheel_shares(self) -> tuple[float, float]:
        """Radii of the left and the right wheel over their mean, `wheel_radius`."""
        return 2.0 / (1.0 + self.wheel_ratio), 2.0 * self.wheel_ratio / (1.0 + self.wheel_ratio)


@kernel
def wheels_of_twist(v: float, w: float, track: float) -> tuple[float, float]:
    """Rim speeds (left, right) [m/s] of a twist."""
    return v - 0.5 * track * w, v + 0.5 * track * w


@kernel
def twist_of_wheels(left: float, right: float, track: float) -> tuple[float, float]:
    """Twist (v, w) of the rim speeds [m/s]."""
    return 0.5 * (left + right), (right - left) / track


@kernel
def corner_speed(v: float, w: float, ahead: float, aside: float) -> float:
    """Speed [m/s] of the faster of two corners so far ahead (or behind) and aside [m]."""
    return math.hypot(abs(v) + abs(w) * aside, abs(w) * ahead)


@kernel
def odometric_step(
    x: float, y: float, yaw: float, distance: float, turn: float
) -> tuple[float, float, float]:
    """The pose after a distance [m] driven while turning [rad]: the thesis, (2.15)-(2.17).

    The distance lies along the mean heading, which is exact to second order in the turn.
    """
    middle = yaw + 0.5 * turn
    return x + distance * math.cos(middle), y + distance * math.sin(middle), yaw + turn


@kernel
def arc_step(
    x: float, y: float, yaw: float, v: float, w: float, t: float
) -> tuple[float, float, float]:
    """The pose after driving a twist for t seconds: the exact arc."""
    half = 0.5 * w * t
    chord = v * t * (math.sin(half) / half if abs(half) > 1e-9 else 1.0)
    return x + chord * math.cos(yaw + half), y + chord * math.sin(yaw + half), yaw + w * t


STOP_RAMP_FACTOR = 1.47  # times the protective rate falls the set point, as on the drive board
_NARROWEST = 0.1  # m, of tracks


@borrowing_kernel
def brake(v: float, w: float, slower: float, track: float) -> tuple[float, float]:
    """A twist (v, w) [m/s, rad/s] a moment on in a protective stop, which keeps its curve.

    The faster of v and of the wheels' difference has fallen by `slower` [m/s].
    """
    fastest = max(abs(v), abs(w) * max(track, _NARROWEST))
    kept = 1.0 - slower / fastest if fastest > slower else 0.0
    return kept * v, kept * w


@kernel
def approach(
    speed: float, slope: float, target: float, up: float, down: float, jerk: float, dt: float
) -> tuple[float, float]:
    """Move a speed towards its target within limits of acceleration and jerk.

    Args:
        speed: now [m/s or rad/s].
        slope: its present rate of change.
        target: to be reached.
        up: largest rate away from zero.
        down: largest rate towards zero.
        jerk: largest change of the rate per second.
        dt: time step [s].

    Returns:
        The speed and its rate of change after the step.
    """
    gap = target - speed
    if gap == 0.0 and slope == 0.0:
        return target, 0.0
    braking = speed != 0.0 and (speed > 0.0) != (gap > 0.0)
    limit = down if braking else up
    # The rate from which jerk can still bring the slope to zero when the target is reached.
    final = math.sqrt(2.0 * jerk * abs(gap) + 0.25 * jerk * jerk * dt * dt) - 0.5 * jerk * dt
    wanted = math.copysign(min(limit, final, abs(gap) / dt), gap)
    change = min(jerk * dt, max(-jerk * dt, wanted - slope))
    slope = slope + change
    after = speed + slope * dt
    there = (target - after) * gap <= 0.0 or abs(target - after) < _THERE
    if there and abs(slope) <= 2.0 * jerk * dt:
        return target, 0.0
    return after, slope


@kernel
def approach_twist(
    v: float,
    v_rate: float,
    w: float,
    w_rate: float,
    to_v: float,
    to_w: float,
    limits: Any,
    dt: float,
) -> tuple[float, float, float, float]:
    """Move speed and turn, each with its rate of change, towards a target twist.

    Args:
        v: speed now [m/s].
        v_rate: its rate of change [m/s2].
        w: turn now [rad/s].
        w_rate: its rate of change [rad/s2].
        to_v: target speed [m/s].
        to_w: target turn [rad/s].
        limits: a record of LIMITS.
        dt: time step [s].

    Returns:
        Speed, its rate, turn and its rate after the step.
    """
    up, down = limits.acceleration, limits.deceleration
    v, v_rate = approach(v, v_rate, to_v, up, down, limits.jerk, dt)
    turn = limits.turn_acceleration
    w, w_rate = approach(w, w_rate, to_w, turn, turn, limits.turn_jerk, dt)
    return v, v_rate, w, w_rate


@kernel
def clip_to_limits(v: float, w: float, limits: Any) -> tuple[float, float]:
    """A twist [m/s, rad/s] clipped to a record of LIMITS; zero if it is not finite."""
    if not (math.isfinite(v) and math.isfinite(w)):
        return 0.0, 0.0
    v = min(limits.forward, max(-limits.backward, v))
    return v, min(limits.turn, max(-limits.turn, w))


@kernel
def peak_speed(speed: float, slope: float, jerk: float) -> float:
    """The largest speed [m/s or rad/s] while jerk brings the rate of change to zero."""
    return abs(speed) + 0.5 * slope * slope / jerk
