"""Newest data of boards and laser, what is missing, and odometry extrapolated to any instant."""

import math
from collections import deque
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.base.arrays import Array, Floats
from wheelchair_gym.base.errors import InputError
from wheelchair_gym.geometry.kinematics import DriveGeometry, odometric_step, twist_of_wheels
from wheelchair_gym.geometry.planar import compose, wrap_angle
from wheelchair_gym.hardware.boards import protocol
from wheelchair_gym.hardware.boards.link import Link
from wheelchair_gym.hardware.boards.parameters import ParameterTable
from wheelchair_gym.hardware.boards.ports import Port, open_port
from wheelchair_gym.hardware.connection import Latest
from wheelchair_gym.hardware.control_loop import Clock, wait_until
from wheelchair_gym.hardware.laser.hokuyo import Hokuyo, TimedScan, open_laser
from wheelchair_gym.hardware.settings import REST_SPEED, HardwareSettings
from wheelchair_gym.sensors.settings import SensorSettings
from wheelchair_gym.types import Episode

_WRAP = 1 << 32  # counts
# As plain Python: a few calls per second need no compiled code.
_step: Any = odometric_step
_twist: Any = twist_of_wheels


def _advanced(pose: Array, travel: Array, track: float) -> Array:
    """A pose (3,) after both wheels have rolled (2,) [m]."""
    x, y, yaw = _step.py_func(*pose.tolist(), *_twist.py_func(*travel.tolist(), track))
    return np.array([x, y, float(wrap_angle(yaw))])


class WheelOdometry:
    """The pose by the wheels since it was made.

    Odometry may be some hundredths of a second old when it is used: it is extrapolated by the
    wheels' speeds, for at most `maximum` [s].
    """

    def __init__(self, geometry: DriveGeometry, maximum: float) -> None:
        self._geometry, self._maximum = geometry, maximum
        self._pose, self._travel = np.zeros(3), np.zeros(2)
        self._shares = np.array(geometry.wheel_shares)
        self._speeds = np.zeros(2)
        self._counts: tuple[int, int] | None = None
        self._made = 0.0

    def restart(self) -> None:
        """The board has restarted its counters: what it counted in between is lost."""
        self._counts = None

    def update(self, odometry: protocol.Odometry, made: float) -> None:
        """Take odometry that was made at a time [s]."""
        counts = odometry.left, odometry.right
        if self._counts is not None:
            steps = (np.subtract(counts, self._counts) + _WRAP // 2) % _WRAP - _WRAP // 2
            travel = steps / self._geometry.counts_per_metre * self._shares
            self._pose = _advanced(self._pose, travel, self._geometry.track)
            self._travel = self._travel + travel
        self._counts, self._made = counts, made
        self._speeds = np.array([odometry.speed_left, odometry.speed_right]) * self._shares

    def at(self, now: float) -> tuple[Array, Array]:
        """Pose (3,) and travel (2,) [m] of the left and the right wheel, at a time [s]."""
        more = self._speeds * min(self._maximum, max(0.0, now - self._made))
        return _advanced(self._pose, more, self._geometry.track), self._travel + more

    def twist(self, travel: Array, seconds: float) -> Array:
        """The mean twist (2,) of wheels that travel (2,) [m] in a time [s]."""
        return np.array(_twist.py_func(*(travel / seconds).tolist(), self._geometry.track))


class OdometryLocalizer:
    """The pose by odometry alone; see `perception.localized_chair.Localizer`."""

    built_map = None

    def begin(self, episode: Episode, key: int) -> None:
        """Start at an episode's start; nothing is random."""
        self._pose = np.array(episode.start, np.float64)

    def update(self, increment: Array, ranges: NDArray[np.float32]) -> Array:
        """The pose (3,) after an increment (3,) of the odometry; ranges are ignored."""
        self._pose = compose(self._pose, increment)
        return self._pose

    @property
    def poses(self) -> Array:
        """The one pose (1, 3)."""
        return self._pose[None]


_ODOMETRY_LATENCY = 0.004  # s from the counts on the board to the host, at least: on the twin
_AGE_MAX = 0.255  # s: a command may be older than its age says
_LASER_DRIFT = 2e-4  # s/s: of two quartz clocks
_COMPARED = 60.0  # s after which a reset compares the laser's clock again
_KEPT = 500  # reports of odometry: 10 s
POLL_PERIOD = 0.005  # s between two reads of the lines: a quarter of the odometry's period
LASERS = ("laser", "second laser", "third laser", "fourth laser")
_FAN = 0.01  # rad: maximum difference between the laser's fan and its settings
_BOARDS = {protocol.Board.DRIVE_BOARD: "drive", protocol.Board.RANGE_BOARD: "range"}
_SENDERS = {protocol.Odometry: "drive", protocol.Joystick: "drive", protocol.Ranges: "range"}
_RANGE_OF = {
    int(protocol.RangeStatus.NO_ECHO): math.inf,
    int(protocol.RangeStatus.SILENT): math.nan,
    int(protocol.RangeStatus.UNTRIED): math.nan,
}


class BoardSensors:
    """The lines to the boards and the laser, and the newest message of each.

    Args:
        settings: ports, and how old data may be.
        sensors: what a scan must look like.
        geometry: of the wheels.
        now: the time [s].
        opener: makes the boards' ports.
        laser_opener: makes the laser's.

    Attributes:
        drive: line to the drive board.
        range: line to the range board, None where there is none.
        lasers: all of them, in the order of `SensorSettings.lasers`.
        scans: the name of each one's data.
        odometer: dead reckoning since this was made.
        pressed: bumper strips were pressed since this was last cleared.
        wheels: odometry since this was last cleared, and when each was made [s].
        identities: how each board identified itself, by its name.
        answers: the last answer of each board.
        parameters: what each board has reported of its parameters.
    """

    def __init__(
        self,
        settings: HardwareSettings,
        sensors: SensorSettings,
        geometry: DriveGeometry,
        now: Callable[[], float],
        opener: Callable[[str], Port] = open_port,
        laser_opener: Callable[[str], Port] = open_laser,
    ) -> None:
        self.settings, self.sensors, self._now = settings, sensors, now
        self.drive = Link(settings.drive_port, now, opener)
        self.range = Link(settings.range_port, now, opener) if settings.range_port else None
        ports = settings.laser_port, *settings.more_laser_ports
        if len(ports) != len(sensors.lasers):
            raise InputError(
                f"hardware.more_laser_ports has {len(ports) - 1} addresses; expected "
                f"{len(sensors.lasers) - 1}, one of each of sensors.more_lasers"
            )
        pairs = zip(ports, sensors.lasers, strict=True)
        self.lasers = [Hokuyo(port, one.reach, now, laser_opener) for port, one in pairs]
        self.scans = [f"scan_{k}" if k else "scan" for k in range(len(ports))]
        self.odometer = WheelOdometry(geometry, settings.limits.odometry)
        self.pressed = False
        self.wheels: deque[tuple[protocol.Odometry, float]] = deque(maxlen=_KEPT)
        self.identities: dict[str, protocol.Identity] = {}
        self.answers: dict[str, protocol.Answer] = {}
        lines = {"drive": self.drive, "range": self.range}
        self.parameters = {board: ParameterTable(board, line) for board, line in lines.items()}
        drift = settings.limits.clock_drift
        self._newest = {"odometry": Latest(drift), "ultrasonic": Latest(drift)}
        self._newest |= {name: Latest(_LASER_DRIFT) for name in self.scans}
        self._joystick: tuple[protocol.Joystick, float] | None = None  # and when it came [s]
        self._stamps = dict.fromkeys(lines, -math.inf)  # s, of each board's last data

    def clear(self) -> None:
        """Forget all data; the wheels' odometry goes on."""
        for newest in self._newest.values():
            newest.clear()
        for laser in self.lasers:
            laser.compare_clocks(_COMPARED)
        self._joystick = None
        self.pressed = False
        self.answers.clear()

    def poll(self) -> None:
        """Read what has come; never waits."""
        for board, table in self.parameters.items():
            for frame in table.link.poll() if table.link else ():
                self._take(board, table, frame.message)
        for name, laser in zip(self.scans, self.lasers, strict=True):
            newest = self._newest[name]
            for scan in laser.poll():
                newest.update(scan, scan.stamp, scan.received_at)
                if (compared := laser.compared) is not None:
                    newest.clock.answered(*compared)
                    laser.compared = None

    def wait_for(self, clock: Clock, condition: Callable[[], bool], timeout: float) -> bool:
        """Read the lines until a condition holds; returns whether it does in time [s]."""

        def missing() -> str:
            self.poll()
            return "" if condition() else "missing"

        return not wait_until(clock, missing, timeout, interval=POLL_PERIOD)

    def _take(self, board: str, table: ParameterTable, message: Any) -> None:
        now, identity = self._now(), isinstance(message, protocol.Identity)
        sender = _BOARDS.get(message.board) if identity else _SENDERS.get(type(message), board)
        assert table.link is not None
        table.link.other_board |= sender != board
        if table.link.other_board:
            return
        stamp = getattr(message, "stamp", math.inf)
        if (restarted := stamp < self._stamps[board]) or identity:
            table.reported.clear()  # it may be an exchanged board, with other parameters
        if stamp < math.inf:
            self._stamps[board] = stamp
        if isinstance(message, protocol.Odometry):
            if restarted:
                self.odometer.restart()
            newest = self._newest["odometry"]
            newest.update(message, message.stamp, now - _ODOMETRY_LATENCY)
            sent = self.drive.sent_at.get(message.echo)
            if sent is not None and message.age < _AGE_MAX:
                newest.clock.answered(sent, message.stamp - message.age)
            self.odometer.update(message, newest.message.measured_at)
            self.wheels.append((message, newest.message.measured_at))
            self.pressed |= bool(message.switches & protocol.STRIPS)
        elif isinstance(message, protocol.Ranges):
            self._newest["ultrasonic"].update(message, message.stamp, now)
        elif isinstance(message, protocol.Joystick):
            self._joystick = message, now
        elif isinstance(message, protocol.Parameter):
            table.update(message)
        elif identity:
            self.identities[board] = message
        elif isinstance(message, protocol.Answer):
            self.answers[board] = message

    @property
    def odometry(self) -> protocol.Odometry:
        """The drive board's last odometry; there must have been one."""
        odometry: protocol.Odometry = self._newest["odometry"].message.value
        return odometry

    def joystick(self, now: float) -> protocol.Joystick | None:
        """The drive board's joystick; None: the board has not reported one lately."""
        if self._joystick is None or now - self._joystick[1] > self.settings.limits.odometry:
            return None
        return self._joystick[0]

    @property
    def ranges_message(self) -> protocol.Ranges:
        """The range board's last ranges; there must have been some."""
        ranges: protocol.Ranges = self._newest["ultrasonic"].message.value
        return ranges

    def stamp_of(self, name: str) -> float:
        """When the newest of a name of `ages` was made [s]; -inf before the first."""
        return self._newest[name].message.measured_at

    def ages(self, now: float) -> dict[str, float]:
        """Age [s] of the newest of each; +inf before the first."""
        ages = {name: newest.age(now) for name, newest in self._newest.items()}
        if not self.range:
            del ages["ultrasonic"]
        return ages

    def stale(self, now: float) -> str:
        """Data that driving needs and that are too old or missing; empty: none."""
        limits, ages = self.settings.limits, self.ages(now)
        if ages["odometry"] > limits.odometry:
            return _silent("the drive board", self.drive.error or self.drive.mismatch)
        for name, laser, who in zip(self.scans, self.lasers, LASERS, strict=False):
            if ages[name] > limits.scan:
                return _silent(f"the {who}", laser.error)
        if self.range and ages["ultrasonic"] > limits.ultrasonic:
            return _silent("the range board", self.range.error or self.range.mismatch)
        for name, who in zip(("odometry", *self.scans), ("drive board", *LASERS), strict=False):
            if (latency := self._newest[name].clock.latency) > limits.latency:
                return (
                    f"the {who} is late: its data may be {latency:.2f} s old when they come, "
                    f"at most {limits.latency:g} s are allowed"
                )
        return ""

    def stale_ultrasonic(self, now: float) -> str:
        """Name of a silent ultrasonic; empty: none."""
        if not self.range:
            return ""
        old = self.ranges(now)[2][: len(self.sensors.ultrasonic.mounted)]
        late = np.flatnonzero(~(old <= self.settings.limits.ultrasonic))
        return f"ultrasonic {late[0]} is silent" if len(late) else ""

    def moving(self) -> str:
        """That the chair moves; empty: it is at rest."""
        left, right = self.odometry.speed_left, self.odometry.speed_right
        if max(abs(left), abs(right)) <= REST_SPEED:
            return ""
        return f"it does not come to rest ({left:.2f}, {right:.2f} m/s)"

    def stopped(self) -> str:
        """Why the drive board has stopped until a person re-arms it; empty: it has not."""
        faults = self.odometry.faults  # an armed board has none
        if self.odometry.mode != protocol.Mode.STOPPED and not faults:
            return ""
        why, deaf = protocol.Fault(faults).name or "not armed", self.drive.error
        stopped = f"the drive board has stopped ({why}); a person must re-arm it"
        return f"{stopped} ({deaf})" if deaf else stopped

    def laser_mismatch(self, k: int) -> str:
        """That the k-th laser's fan is not that of the settings; empty: it is."""
        specs, laser = self.lasers[k].specs, self.sensors.lasers[k]
        if specs is None:
            return f"the {LASERS[k]} has not reported its specification"
        first, last = specs.angles[[0, -1]].tolist()
        half = 0.5 * laser.fov
        if specs.beams == laser.beams and max(abs(first + half), abs(last - half)) < _FAN:
            return ""
        setting = f"sensors.more_lasers[{k - 1}]" if k else "sensors.laser"
        return (
            f"the {LASERS[k]} {specs.model} has {specs.beams} beams from "
            f"{math.degrees(first):.1f} to {math.degrees(last):.1f} deg; {setting} says "
            f"{laser.beams} over {math.degrees(laser.fov):.1f} deg"
        )

    def ranges(self, now: float) -> tuple[Floats, Floats, Floats]:
        """Lasers, ultrasonics and their ages; what is too old is invalid."""
        limits, ages = self.settings.limits, self.ages(now)
        found = np.full(self.sensors.beams, np.nan, np.float32)
        each = zip(self.scans, self.sensors.lasers, self.sensors.slices, strict=True)
        for name, laser, part in each:
            newest: TimedScan = self._newest[name].message.value
            if ages[name] <= limits.scan and len(newest.scan.ranges) == laser.beams:
                ranges = newest.scan.ranges - np.float32(laser.offset)
                found[part] = np.where(ranges < laser.range_min, -np.inf, ranges)  # as in REP-117
        rangers = self.sensors.ultrasonic
        sonar = np.full(rangers.columns, np.nan, np.float32)
        old = np.full(rangers.columns, np.inf, np.float32)
        if self.range and math.isfinite(ages["ultrasonic"]):
            for k, one in enumerate(self.ranges_message.ranges[: len(rangers.mounted)]):
                old[k] = ages["ultrasonic"] + one.age
                if old[k] <= limits.ultrasonic:
                    sonar[k] = _RANGE_OF.get(one.status, one.range)
        return found, sonar, old

    def close(self) -> None:
        """Close the lines for good."""
        for line in (self.drive, self.range, *self.lasers):
            if line is not None:
                line.close()


def _silent(who: str, why: str) -> str:
    return f"{who} is silent" + (f" ({why})" if why else "")
