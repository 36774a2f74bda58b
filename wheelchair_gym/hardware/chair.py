"""The real chair behind `Chair`: drive board, range board, laser.

    drive(twist) ──▶ guard ──▶ Command, 50 Hz ──▶ drive board      Odometry ─┐
                       ▲                                           Ranges   ─┼─▶ Reading
                       └── stale sensor, late policy, a person     Scan     ─┘

The guard sends and receives at its own rate, whatever the policy does. The drive board stops by
itself when commands stay away; only a person can re-arm it.
"""

import contextlib
import logging
import math
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.base.arrays import Array
from wheelchair_gym.geometry.kinematics import DriveGeometry, Limits
from wheelchair_gym.hardware.boards import protocol
from wheelchair_gym.hardware.boards.parameters import board_parameters
from wheelchair_gym.hardware.boards.protocol import Command, CommandFlag, Fault, Mode, Switch
from wheelchair_gym.hardware.boards.senses import POLL_PERIOD, BoardSensors
from wheelchair_gym.hardware.control_loop import Clock, RealChair, WallClock, wait_until
from wheelchair_gym.hardware.settings import HardwareSettings, check_boards
from wheelchair_gym.safety import stops
from wheelchair_gym.sensors.settings import SensorSettings
from wheelchair_gym.sim.settings import ChairSettings
from wheelchair_gym.types import WHEELS, Episode, Reading, Stick

_LOG = logging.getLogger(__name__)
STOP = Command(0.0, 0.0, CommandFlag.PROTECTIVE)
_ZERO = Command(0.0, 0.0)  # at rest, ready to be driven
_REARM = 2  # kind of the message, as an answer names it
_REFUSED: dict[int, str] = {
    protocol.Status.CAUSE_STANDS: "the cause of the drive board's stop is still present",
    protocol.Status.NOT_AT_ZERO: "the sticks are not centred",
    protocol.Status.OTHER_FAULTS: "the drive board has stopped for another fault meanwhile",
    protocol.Status.MOVING: "the chair is moving",
}
_FINAL_STOPS = 4  # stop commands at the end: noise may destroy one
_COMMAND_PERIOD = 0.02  # s between two commands: a tenth of the drive board's timeout of 0.2 s
# s: half a control period at 200 Hz, and until the motors are set and counts are taken
_ACTING = 0.0045
_FINE = 0.001  # s between two checks for the next odometry


def for_equal_wheels(command: Command, drive: DriveGeometry, speed: float) -> Command:
    """The command with which a board that assumes equal wheels drives a twist.

    `speed` [m/s] is the board's present set point: while it rises, so does the turn that unequal
    wheels ask for.
    """
    left, right = drive.wheel_shares
    if left == right:
        return command
    mean, unequal = 0.5 * (1.0 / left + 1.0 / right), 0.5 * (1.0 / right - 1.0 / left)
    v = mean * command.v + 0.5 * drive.track * unequal * command.w
    return command._replace(v=v, w=mean * command.w + 2.0 * unequal * speed / drive.track)


class HardwareChair(RealChair):
    """A chair behind its boards; see `Chair`. Readings hold dead-reckoned poses.

    Args:
        settings: ports of boards and laser, limits.
        sensors: where laser and ultrasonics are mounted, and the number of beams.
        chair: outline, wheels, limits; the boards' parameters must agree with it.
        period: the control period [s].
        clock: real or simulated time.
        senses: the connections; made from the settings where they are not given.

    Attributes:
        joystick: called with the time and the limits; returns the twist (2,) that a person at the
            host commands, or None while nobody does. It overrides every policy.
        person: returns why a person who drives with an assistant may not drive now; empty: it may,
            or there is none.
        assisted: a person drives by the joystick of the drive board, which then goes before every
            command (`CommandFlag.ASSISTED`).
        on_wait: called with a line when reset has to wait, for a person or for more than 1 s.
        commanded: the last command (2,) within the limits, whether or not it was sent.
    """

    needs_rearm = True

    def __init__(
        self,
        settings: HardwareSettings,
        sensors: SensorSettings,
        chair: ChairSettings,
        period: float,
        clock: Clock | None = None,
        senses: BoardSensors | None = None,
    ) -> None:
        check_boards(sensors)
        super().__init__(
            settings.drive_port, clock or WallClock(), period, settings.limits.command_timeout,
            chair, sensors.laser,
        )  # fmt: skip
        self.settings, self.sensors = settings, sensors
        self.senses = senses or BoardSensors(settings, sensors, chair.drive, self.clock.now)
        self.joystick: Callable[[float, Limits], Array | None] = lambda now, limits: None
        self.person: Callable[[], str] = lambda: ""
        self.assisted = False
        self.real_time = isinstance(self.clock, WallClock)
        self.on_wait: Callable[[str], object] = _LOG.warning
        self._on_rearm: list[Callable[[], object]] = []
        self._person_drives = False  # or has to re-arm it
        self._target, self._sent_at = STOP, -math.inf
        self.commanded = np.zeros(2)
        self._travel, self._read_at = np.zeros(2), 0.0  # of the last reading
        self._closed = False
        self._wheels: list[tuple[Any, ...]] = []
        self._start_guard(self._guard, partial(self._send, STOP), POLL_PERIOD)

    def reset(self, episode: Episode | None = None, key: int = 0) -> Reading:
        """Stop, stay in place, and wait for fresh data and for a person to re-arm the chair.

        Args:
            episode: ignored; see `Chair.reset`.
            key: ignored; nothing is random.

        Raises:
            InputError: a sensor stays silent, something does not agree with the settings, the chair
                does not come to rest, or nobody re-arms it.
        """
        timeout = self.settings.limits.ready_timeout
        with self._lock:
            if self._closed:
                raise ValueError("the chair was closed")
            self._end()
            self._send(_ZERO if self._is_stopped else STOP)
            self.senses.clear()
        self._await(self._not_ready, timeout)
        for board, wanted in self.parameters.items():
            self._await(partial(self.senses.parameters[board].mismatch, wanted), 2.0)
        with self._lock:
            self._send(_ZERO)
            self.waiting_for = "" if self.settings.dry_run else self.senses.stopped()
        if self.waiting_for:
            self.on_wait(f"{self.waiting_for}; waits {self.settings.rearm_timeout:g} s for that")
        try:
            if not self.settings.dry_run:
                self._require(self._not_armed, self.settings.rearm_timeout)
        finally:
            self.waiting_for = ""
        with self._lock:
            self.senses.clear()  # the clocks may have drifted apart meanwhile
        self._await(self._not_ready, timeout)
        self._synchronize()
        with self._lock:
            self._read_at = self.clock.now()
            odometry, self._travel = self.senses.odometer.at(self._read_at)
            self._begin(odometry)
            self.senses.pressed = False
            self.senses.wheels.clear()
            return self._reading(self._stop_reason(), np.zeros(2))

    def drive(self, twist: Array, protective: bool = False) -> Reading:
        """Command a twist (2,) [m/s, rad/s] or a protective stop, wait a period, and sense.

        Where something forbids it the chair stops at once, and `Reading.halted` says why.

        Raises:
            ValueError: the twist is not two finite numbers, or the chair was never reset.
        """
        why = self.command(twist, protective)
        self._wait_period()
        with self._lock:
            self.senses.poll()
            now, odometer = self.clock.now(), self.senses.odometer
            _, travel = odometer.at(now)
            measured = odometer.twist(travel - self._travel, max(now - self._read_at, 1e-3))
            self._travel, self._read_at = travel, now
            return self._reading(self._stop_reason() or why, measured)

    def command(self, twist: Array, protective: bool = False) -> str:
        """Command a twist (2,) [m/s, rad/s] or a protective stop, and return at once.

        Returns:
            Why the chair stops instead; empty: it drives.

        Raises:
            ValueError: the twist is not two finite numbers, or the chair was never reset.
        """
        with self._lock:
            v, w = self._accept(twist)
            self.senses.poll()
            why = self._stop_reason()
            self.commanded = np.array([v, w])
            self._send(STOP if why or protective else Command(v, w))
            return why

    def rearm(self) -> None:
        """See `Chair.rearm`."""
        with self._lock:
            if self._is_stopped and not self.settings.dry_run:
                self._send(_ZERO)  # the board requires a fresh command of zero
                self.senses.drive.send(protocol.Rearm(self.senses.odometry.faults))
        self._notify_rearmed()

    def add_rearm_callback(self, callback: Callable[[], object]) -> None:
        """See `Chair.add_rearm_callback`; called when a person returns the chair, too."""
        self._on_rearm.append(callback)

    def close(self) -> None:
        """Stop, and close the ports; may be called again."""
        with self._lock:
            if self._closed:
                return
            self._closed = True
            self._end()
            self.joystick = lambda now, limits: None  # nobody drives any longer
            with contextlib.suppress(Exception):  # the port may be the very thing that is broken
                for _ in range(_FINAL_STOPS):
                    self._send(STOP)
        self._stop_guard()
        self.senses.close()

    def stick(self, now: float) -> tuple[Stick, str]:
        """The stick of the drive board's joystick, and why it may not drive; empty: it may."""
        report = self.senses.joystick(now)
        if report is None:
            return Stick(0.0, 0.0, False), f"{stops.NO_STICK} (the drive board reports no joystick)"
        why = stops.NO_STICK if not report.flags & protocol.JoystickFlag.FRESH else ""
        why = why or (stops.NOT_HELD if not report.flags & protocol.JoystickFlag.HELD else "")
        why = why or (stops.OFF_CENTRE if report.flags & protocol.JoystickFlag.MUST_CENTRE else "")
        return Stick(report.forward, report.left, False), why

    @property
    def wheels(self) -> NDArray[np.void]:
        """See `Chair.wheels`: at 50 Hz."""
        return np.array(self._wheels, WHEELS)

    def _report_of(self, state: protocol.Odometry, made: float) -> tuple[Any, ...]:
        """A row of WHEELS of an odometry and of the time [s] when it was made."""
        pairs = ((state.left, state.right), (state.speed_left, state.speed_right),
                 (state.duty_left, state.duty_right))  # fmt: skip
        target = self._target
        driven = (state.v, state.w), (target.v, target.w)
        stamp = made - self._begun
        acting = stamp + _ACTING
        return stamp, *pairs, acting, state.battery, *driven, state.echo, state.age, state.stamp

    @property
    def scan_stamps(self) -> tuple[float, ...]:
        """See `Chair.scan_stamps`."""
        return tuple(self.senses.stamp_of(name) - self._begun for name in self.senses.scans)

    @property
    def board_parameters(self) -> dict[str, dict[str, float]]:
        """See `Chair.board_parameters`."""
        return {
            board: {name: held.value for name, held in table.reported.items()}
            for board, table in self.senses.parameters.items()
        }

    @property
    def report(self) -> dict[str, float | str]:
        """The drive board's last state: mode, faults, switches, counts, duties and set point."""
        with self._lock:
            if not math.isfinite(self.senses.stamp_of("odometry")):
                return {}
            state = self.senses.odometry
        names = ("left", "right", "duty_left", "duty_right", "v", "w")
        flags = {"faults": Fault(state.faults), "switches": Switch(state.switches)}
        return {
            "mode": Mode(state.mode).name,
            **{name: flag.name or "" for name, flag in flags.items()},
            **{name: getattr(state, name) for name in names},
        }

    @property
    def parameters(self) -> dict[str, dict[str, float]]:
        """The parameters that the boards must hold for this chair, by the name of the board."""
        return board_parameters(self.chair, self.sensors, self.settings)

    @property
    def _is_stopped(self) -> bool:
        """Whether the drive board is known to be stopped until a person re-arms it."""
        received = math.isfinite(self.senses.ages(0.0)["odometry"])
        return received and bool(self.senses.stopped())

    def _not_ready(self) -> str:
        now, senses = self.clock.now(), self.senses
        return (
            senses.stale(now)
            or senses.stale_ultrasonic(now)
            or next(filter(None, map(senses.laser_mismatch, range(len(senses.lasers)))), "")
            or senses.moving()
        )

    def _not_armed(self) -> str:
        """Why the board needs a person; a re-arm that it refuses is reported."""
        answer = self.senses.answers.pop("drive", None)
        if answer is not None and answer.kind == _REARM and answer.status in _REFUSED:
            self.on_wait(f"not re-armed: {_REFUSED[answer.status]}")
        return self.senses.stopped()

    def _synchronize(self) -> None:
        """Wait for the next odometry.

        Control periods then begin and end just after one, and before the board's next run: data is
        fresh, and commands take effect within milliseconds.
        """
        before = self.senses.stamp_of("odometry")

        def missing() -> str:
            with self._lock:
                self.senses.poll()
                same = self.senses.stamp_of("odometry") == before
                return "the drive board is silent" if same else ""

        wait_until(self.clock, missing, self.settings.limits.odometry, interval=_FINE)
        self.clock.wait(self.clock.now() + _FINE)  # some arrive a little later than others

    def _await(self, missing: Callable[[], str], timeout: float) -> None:
        """Wait until nothing is missing, and report what is; each look holds the lock."""

        def locked() -> str:
            with self._lock:
                return missing()

        self._require(
            locked, timeout, on_wait=lambda why: self.on_wait(f"{why}; waits {timeout:g} s for it")
        )

    def _stop_reason(self) -> str:
        """Why a policy may not drive the chair now; empty: it may."""
        if why := self.senses.stale(self.clock.now()):
            return why
        if self.settings.dry_run:
            return stops.DRY_RUN
        self.latched = self.latched or self.senses.stopped()
        if self.latched:
            return self.latched
        mode = self.senses.odometry.mode
        if mode == Mode.MANUAL or self._joystick_command() is not None:
            return stops.BY_HAND
        return stops.BROUGHT_TO_REST if mode == Mode.STOPPING else self.person()

    def _joystick_command(self) -> Command | None:
        """The command of a person at the host's joystick."""
        twist = self.joystick(self.clock.now(), self.chair.limits)
        return None if twist is None else Command(*twist.tolist()) if twist.any() else STOP

    def _send(self, target: Command) -> None:
        """Command a target from now on; the joystick overrides it."""
        self._target = target
        self._sent_at = self.clock.now()
        if self.assisted:
            target = target._replace(flags=target.flags | CommandFlag.ASSISTED)
        if not self.settings.dry_run:
            known = math.isfinite(self.senses.stamp_of("odometry"))
            target, drive = self._joystick_command() or target, self.chair.drive
            speed = self.senses.odometry.v if known else 0.0
            self.senses.drive.send(for_equal_wheels(target, drive, speed))

    def _guard(self) -> None:
        """Receive data, replace a command that is no longer valid by a stop, repeat the others."""
        with self._lock:
            if self._closed:
                return
            self.senses.poll()
            self._watch_person()
            now = self.clock.now()
            moves = self._target.v != 0.0 or self._target.w != 0.0
            if moves and (self._expired or self._stop_reason()):
                self._send(STOP)
            elif now - self._sent_at >= _COMMAND_PERIOD - 1e-9:
                self._send(self._target)

    def _watch_person(self) -> None:
        """Notice when a person re-arms the drive board or returns the chair to the host."""
        if not math.isfinite(self.senses.stamp_of("odometry")):
            return
        mode = self.senses.odometry.mode
        if mode in (Mode.STOPPED, Mode.MANUAL) or self._joystick_command() is not None:
            self._person_drives = True
        elif self._person_drives and mode == Mode.HOST:
            self._person_drives = False
            self._notify_rearmed()

    def _notify_rearmed(self) -> None:
        for callback in self._on_rearm:
            callback()

    def _reading(self, halted: str, twist: Array) -> Reading:
        now, senses = self.clock.now(), self.senses
        pose, _ = senses.odometer.at(now)
        ranges = senses.ranges(now)
        bumped, senses.pressed = senses.pressed, False
        self._wheels = [self._report_of(*report) for report in senses.wheels]
        senses.wheels.clear()
        return self._reading_of(pose, pose, twist, ranges, bumped, senses.odometry.battery, halted)
