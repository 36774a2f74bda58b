"""The step response of the drive board's speed controller, for tuning its gains."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from wheelchair_gym.base.arrays import Array
from wheelchair_gym.geometry.kinematics import twist_of_wheels
from wheelchair_gym.hardware.boards.senses import POLL_PERIOD
from wheelchair_gym.hardware.chair import HardwareChair

BEFORE, AFTER = 0.2, 1.5  # s that are recorded at rest before the step, and after it
SETTLED = 0.05  # relative error of a speed that counts as settled
# Parameter of the drive board -> field of MotorSettings.
GAINS = {"kp": "kp", "ki": "ki", "kd": "kd", "ka": "ka", "smoothing": "filter_time"}


@dataclass(frozen=True)
class Step:
    """A recorded step of the speed [m/s] or of the turn rate [rad/s]."""

    times: Array  # (n,) s
    set_point: Array  # (n,)
    measured: Array  # (n,)
    duties: Array  # (n, 2)
    size: float
    duration: float  # s

    @property
    def figures(self) -> dict[str, float]:
        """Lag [s], relative overshoot, end error and RMS error, and settling time [s].

        They compare the wheels with the set point, which rises within the chair's limits of
        acceleration and jerk.
        """
        up = (self.times >= 0.0) & (self.times < self.duration)
        t, target = self.times[up], self.set_point[up] / self.size
        speed = self.measured[up] / self.size
        last = t > self.duration - 0.3
        off = np.flatnonzero(np.abs(speed - 1.0) > SETTLED)
        return {
            "lag_s": _crossing(t, speed) - _crossing(t, target),
            "overshoot": float(max(0.0, speed.max() - 1.0)),
            "end_error": float(abs(speed[last].mean() - 1.0)) if last.any() else math.nan,
            "rms_error": float(np.sqrt(np.mean((speed - target) ** 2))),
            "settled_s": float(t[off[-1]]) if len(off) else 0.0,
        }


def _crossing(times: Array, values: Array) -> float:
    """When half of the step is reached [s]."""
    past = np.flatnonzero(values >= 0.5)
    return float(times[past[0]]) if len(past) else math.nan


def step_response(chair: HardwareChair, size: float, seconds: float, turn: bool = False) -> Step:
    """Drive a step and record it, once a person has re-armed the chair; ahead must be free space.

    Args:
        chair: real, or the twin's.
        size: of the step [m/s, or rad/s].
        seconds: duration of the step.
        turn: the step is one of the turn rate.

    Raises:
        InputError: the chair does not get ready.
        ValueError: the chair stopped before the end; the text says why.
    """
    chair.reset()
    clock, rows = chair.clock, []
    begun = clock.now() + BEFORE
    target = np.array([0.0, size]) if turn else np.array([size, 0.0])
    seen = -math.inf
    for until, twist in (
        (begun, np.zeros(2)),
        (begun + seconds, target),
        (begun + seconds + AFTER, np.zeros(2)),
    ):
        while clock.now() < until - 1e-9:
            why = chair.command(twist)
            if why:
                raise ValueError(f"the step was not driven to its end: {why}")
            clock.wait(min(until, clock.now() + POLL_PERIOD))
            stamp = chair.senses.stamp_of("odometry")
            if stamp > seen:
                seen, state = stamp, chair.senses.odometry
                v, w = twist_of_wheels(state.speed_left, state.speed_right, chair.chair.drive.track)
                speed, set_point = (w, state.w) if turn else (v, state.v)
                rows.append((stamp - begun, set_point, speed, state.duty_left, state.duty_right))
    table = np.array(rows)
    return Step(table[:, 0], table[:, 1], table[:, 2], table[:, 3:], size, seconds)
