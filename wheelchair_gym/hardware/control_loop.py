"""Parts of all real chairs: clocks, control periods, the guard, timeouts, the best estimate.

Time is an argument: real time, or that of a simulated world, in which nothing waits.
"""

import atexit
import contextlib
import logging
import math
import threading
import time
from collections.abc import Callable, Sequence
from typing import Protocol

import numpy as np

from wheelchair_gym.base.arrays import Array, Floats
from wheelchair_gym.base.settings import InputError
from wheelchair_gym.geometry.planar import relative_pose
from wheelchair_gym.perception.occupancy import read_scan
from wheelchair_gym.sensors.settings import LaserSettings
from wheelchair_gym.sim.settings import ChairSettings
from wheelchair_gym.types import Belief, Chair, NotCopyable, Reading, Truth

_LOG = logging.getLogger(__name__)
POLL_PERIOD = 0.01  # s between two checks of what arrives in other threads
QUIET = 1.0  # s of waiting before a person is informed
LATE = 0.01  # s: a control period that ends so much after its time is late
_MAX_CLEARANCE = 2.0  # m: upper bound of `Truth.clearance`


class Clock(Protocol):
    """Time, and what happens while it passes."""

    def now(self) -> float:
        """Seconds; they never decrease."""

    def wait(self, deadline: float, cancelled: threading.Event | None = None) -> None:
        """Wait until a deadline [s], or until the event is set."""

    def call_every(
        self, callback: Callable[[], object], interval: float, name: str
    ) -> Callable[[], None]:
        """Call a function at an interval [s] beside the caller; returns what ends that."""


class WallClock:
    """Real time; callbacks run in threads.

    A planner at work does not delay them: kernels release Python's lock.
    """

    def now(self) -> float:
        """See `Clock.now`."""
        return time.monotonic()

    def wait(self, deadline: float, cancelled: threading.Event | None = None) -> None:
        """See `Clock.wait`."""
        left = max(0.0, deadline - time.monotonic())
        if cancelled is None:
            time.sleep(left)
        else:
            cancelled.wait(left)

    def call_every(
        self, callback: Callable[[], object], interval: float, name: str
    ) -> Callable[[], None]:
        """See `Clock.call_every`."""
        done = threading.Event()

        def repeat() -> None:
            while not done.wait(interval):
                callback()

        thread = threading.Thread(target=repeat, name=f"{name} guard", daemon=True)
        thread.start()

        def end() -> None:
            done.set()
            if threading.current_thread() is not thread:
                thread.join()

        return end


def wait_until(
    clock: Clock,
    missing: Callable[[], str],
    timeout: float,
    cancelled: threading.Event | None = None,
    interval: float = POLL_PERIOD,
    on_wait: Callable[[str], object] = lambda why: None,
) -> str:
    """Wait until nothing is missing; returns what still is after the timeout [s].

    Args:
        clock: real or simulated time.
        missing: returns what is missing; empty: nothing.
        timeout: [s].
        cancelled: ends the wait, too.
        interval: between two checks [s].
        on_wait: is called with what is missing after a second, and whenever that changes, apart
            from the part in brackets.
    """
    begun, reported = clock.now(), ""
    while (why := missing()) and clock.now() < begun + timeout:
        what = why.partition(" (")[0]
        if what != reported and clock.now() - begun >= QUIET:
            reported = what
            on_wait(why)
        clock.wait(clock.now() + interval, cancelled)
    return why


def _nothing_known(odometry: Array) -> Truth:
    """The estimate at a pose (3,) of the odometry, before the first reading."""
    return Truth(odometry, np.zeros(2), _MAX_CLEARANCE, False, False, 0.0, 0.0)


class RealChair(NotCopyable, Chair):
    """The control periods of a real chair, its guard, and the best estimate of its state.

    Args:
        name: the chair, in messages.
        clock: real or simulated time.
        period: the control period [s].
        command_timeout: how long a command stays valid beyond its period [s].
        chair: its outline, and the limits to which commands are clipped.
        laser: the sensor whose echoes are measured against the outline.
    """

    _known = _nothing_known(np.zeros(3))

    def __init__(
        self, name: str, clock: Clock, period: float, command_timeout: float, chair: ChairSettings,
        laser: LaserSettings,
    ) -> None:  # fmt: skip
        self._name, self.clock, self.period, self.chair = name, clock, period, chair
        self._laser, self._timeout = laser, command_timeout
        self._lock = threading.RLock()  # held by the caller that commands
        self._valid_until, self._due, self._begun = -math.inf, 0.0, math.nan
        self._end_guard: Callable[[], None] = lambda: None
        self._started, self._odometry = False, np.zeros(3)
        self._late: list[tuple[float, float]] = []

    @property
    def late(self) -> Sequence[tuple[float, float]]:
        """See `Chair.late`; the first period is never late."""
        return self._late

    @property
    def truth(self) -> Truth:
        """The localizer's pose, the nearest echo, contacts at the bumpers; no energy."""
        return self._known

    @property
    def belief(self) -> Belief:
        """The pose by odometry."""
        return Belief(self._odometry)

    def set_localized_pose(self, pose: Array) -> None:
        """See `Chair.set_localized_pose`; a real chair takes the estimate for its true pose."""
        self._known = self._known._replace(pose=pose)

    def _begin(self, odometry: Array) -> None:
        """Begin an episode now, at a pose (3,) of the odometry."""
        self._due = self._begun = self.clock.now()
        self._late, self._started, self.latched = [], False, ""
        self._odometry, self._known = odometry, _nothing_known(odometry)

    def _end(self) -> None:
        """End the episode: no command is valid any longer."""
        self._begun, self._valid_until = math.nan, -math.inf

    def _start_guard(
        self, guard: Callable[[], object], stop: Callable[[], object], interval: float
    ) -> None:
        """Call `guard` at an interval [s] beside the policy, and `close` when the program ends.

        Where the guard fails, it is called again, and the chair stops by `stop` until its reset.
        """

        def watch() -> None:
            try:
                guard()
            except Exception as error:  # a chair under ROS has no other watchdog
                if not self.latched:
                    self.latched = f"the guard has failed ({error!r})"
                    _LOG.error("%s: %s", self._name, self.latched)
                with contextlib.suppress(Exception), self._lock:
                    stop()

        self._end_guard = self.clock.call_every(watch, interval, self._name)
        atexit.register(self.close)

    def _stop_guard(self) -> None:
        """End what `_start_guard` began; it may be called again."""
        self._end_guard()
        atexit.unregister(self.close)

    def _accept(self, twist: Array) -> tuple[float, float]:
        """A command (v, w) within the limits, which is valid from now on.

        Raises:
            ValueError: the twist is not two finite numbers, or no episode has begun.
        """
        v, w = twist.tolist()
        if not math.isfinite(v + w):
            raise ValueError(f"twist is ({v}, {w}); expected two finite numbers")
        if math.isnan(self._begun):
            raise ValueError("the chair was never reset, or it was closed")
        self._valid_until = self.clock.now() + self.period + self._timeout
        limits = self.chair.limits
        v = min(limits.forward, max(-limits.backward, v))
        return v, min(limits.turn, max(-limits.turn, w))

    def _wait_period(self, cancelled: threading.Event | None = None) -> None:
        """Wait for the end of the control period, or until the event is set.

        Periods end at multiples of the period; those that the policy missed are skipped. In the
        first, which the policy begins when it is ready, nothing is late.
        """
        due = self._due + self.period
        missed = math.floor((self.clock.now() - self._due) / self.period)
        self._due += self.period * (1 + max(0, missed))
        self.clock.wait(self._due, cancelled)
        now = self.clock.now()
        if self._started and now - due > LATE:
            self._late.append((now - self._begun, now - due))
        self._started = True

    @property
    def _expired(self) -> bool:
        """Whether the last command is no longer valid."""
        return self.clock.now() > self._valid_until

    def _require(
        self,
        missing: Callable[[], str],
        timeout: float,
        cancelled: threading.Event | None = None,
        on_wait: Callable[[str], object] = lambda why: None,
    ) -> None:
        """Wait as `wait_until` does.

        Raises:
            InputError: something is still missing after the timeout.
        """
        if why := wait_until(self.clock, missing, timeout, cancelled, on_wait=on_wait):
            raise InputError(f"{self._name}: {why}; waited {timeout:g} s")

    def _reading_of(
        self, odometry: Array, pose: Array, twist: Array, ranges: tuple[Floats, Floats, Floats],
        bumped: bool, battery: float, halted: str,
    ) -> Reading:  # fmt: skip
        """The reading of a control period that ends now; it updates the best estimate.

        `odometry` and `pose`, the estimate, are poses (3,); `ranges` are those of the laser, of the
        ultrasonics [m] and their ages [s]. For the others, see `Reading`.
        """
        before, laser = self._known, ranges[0]
        distance = before.distance + float(np.hypot(*relative_pose(self._odometry, odometry)[:2]))
        self._odometry, touched = odometry, before.touched or bumped
        self._known = Truth(pose, twist, self._clearance(laser), bumped, touched, distance, 0.0)
        stamp = self.clock.now() - self._begun
        return Reading(pose, twist, *ranges, bumped, battery, stamp, halted)

    def _clearance(self, laser: Floats) -> float:
        """Distance [m] from the outline to the nearest echo."""
        ends = read_scan(self._laser, laser[: self._laser.beams]).echoes
        front, rear, half = self.chair.footprint.array
        aside = np.maximum(np.abs(ends[:, 1]) - half, 0.0)
        ahead = np.maximum(np.maximum(ends[:, 0] - front, -rear - ends[:, 0]), 0.0)
        return float(np.hypot(ahead, aside).min(initial=_MAX_CLEARANCE))
