"""How the board's speed control answers a step: for gains of a chair that nobody has tuned."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.hardware.chair import HardwareChair
from wheelchair_gym.kinematics import twist_of_wheels
from wheelchair_gym.types import Episode

Array = NDArray[np.float64]

LOOK = 0.005  # s between two looks at the lines
BEFORE, AFTER = 0.2, 1.5  # s that are recorded of standing still, and of coming to rest
SETTLED = 0.05  # share of the step within which a speed counts as settled
# Parameter of the drive board -> field of MotorSettings.
GAINS = {"kp": "kp", "ki": "ki", "kd": "kd", "ka": "ka", "smoothing": "filter_time"}


@dataclass(frozen=True)
class Step:
    """A recorded step.

    Attributes:
        times: (n,) s.
        asked: (n,) set point in the middle of the axle or at the turn [m/s or rad/s].
        done: (n,) what the wheels did.
        duties: (n, 2).
        size: of the step.
        ended: s, when it was taken back.
    """

    times: Array
    set_point: Array
    measured: Array
    duties: Array
    size: float
    duration: float

    @property
    def figures(self) -> dict[str, float]:
        """Lag behind the set point [s], overshoot [share], error at the end and RMS, settling [s].

        The set point rises within the chair's limits of acceleration and jerk: what counts is how
        the wheels follow it.
        """
        up = (self.times >= 0.0) & (self.times < self.duration)
        t, asked, done = (
            self.times[up],
            self.set_point[up] / self.size,
            self.measured[up] / self.size,
        )
        last = t > self.duration - 0.3
        off = np.flatnonzero(np.abs(done - 1.0) > SETTLED)
        return {
            "lag_s": _crossing(t, done) - _crossing(t, asked),
            "overshoot": float(max(0.0, done.max() - 1.0)),
            "end_error": float(abs(done[last].mean() - 1.0)) if last.any() else math.nan,
            "rms_error": float(np.sqrt(np.mean((done - asked) ** 2))),
            "settled_s": float(t[off[-1]]) if len(off) else 0.0,
        }


def _crossing(times: Array, values: Array) -> float:
    """When half of the step is done [s]."""
    past = np.flatnonzero(values >= 0.5)
    return float(times[past[0]]) if len(past) else math.nan


def step_response(
    chair: HardwareChair, episode: Episode, size: float, seconds: float, turn: bool = False
) -> Step:
    """Drive a step and record it; a person re-arms first. The way ahead must be free.

    Args:
        chair: any.
        episode: is not looked at by a real chair.
        size: of the step [m/s, or rad/s where it turns].
        seconds: it is held.
        turn: it turns in place.

    Raises:
        InputError: the chair does not get ready.
        ValueError: it was stopped under way, by what the text says.
    """
    chair.reset(episode, 0)
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
            clock.wait(min(until, clock.now() + LOOK))
            stamp = chair.senses.stamp_of("odometry")
            if stamp > seen:
                seen, told = stamp, chair.senses.odometry
                v, w = twist_of_wheels(told.speed_left, told.speed_right, chair.chair.drive.track)
                now, asked = (w, told.w) if turn else (v, told.v)
                rows.append((stamp - begun, asked, now, told.duty_left, told.duty_right))
    table = np.array(rows)
    return Step(table[:, 0], table[:, 1], table[:, 2], table[:, 3:], size, seconds)
