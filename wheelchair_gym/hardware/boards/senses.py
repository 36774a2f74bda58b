"""What boards and laser say of the chair: the newest of each, and what is missing."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.hardware.boards.dead_reckoning import WheelOdometry
from wheelchair_gym.hardware.boards.link import Link
from wheelchair_gym.hardware.boards.monitor import SUPPORTED, MonitorServer, status_rows
from wheelchair_gym.hardware.boards.parameters import DRIVE_PARAMETERS, RANGE_PARAMETERS
from wheelchair_gym.hardware.boards.ports import Port, is_device, open_port
from wheelchair_gym.hardware.boards.protocol import (
    STRIPS,
    Answer,
    Fault,
    Get,
    Identity,
    Mode,
    Odometry,
    Parameter,
    Ranges,
    RangeStatus,
)
from wheelchair_gym.hardware.clock_sync import Latest
from wheelchair_gym.hardware.laser.hokuyo import Hokuyo, TimedScan, open_laser
from wheelchair_gym.hardware.settings import HardwareSettings
from wheelchair_gym.kinematics import DriveGeometry
from wheelchair_gym.sensors.settings import RANGERS, SensorSettings

Array = NDArray[np.float64]
Floats = NDArray[np.float32]

_FAN = 0.01  # rad that the laser's fan may differ from its settings
_AGREE = 1e-4  # share that a parameter may differ: boards keep 32 bits


class BoardSensors:
    """The lines to the boards and the laser, and the newest that came of each.

    Args:
        settings: where they are, how old they may be.
        sensors: what a scan must look like.
        geometry: of the wheels.
        now: the time [s].
        opener: makes the boards' ports.
        laser_opener: makes the laser's.

    Attributes:
        drive: line to the drive board.
        range: line to the range board, None where there is none.
        laser: the laser.
        odometer: dead reckoning since this was made.
        pressed: strips that were since this was last cleared.
        identities: what each board said of itself, by its name.
        answers: what each answered last.
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
        self.laser = Hokuyo(settings.laser_port, sensors.laser.reach, now, laser_opener)
        self.odometer = WheelOdometry(geometry, settings.limits.odometry)
        self.pressed = False
        self.identities: dict[str, Identity] = {}
        self.answers: dict[str, Answer] = {}
        self._told: dict[str, dict[int, Parameter]] = {"drive": {}, "range": {}}
        drift = settings.limits.clock_drift
        self._odometry, self._ranges, self._scan = Latest(drift), Latest(drift), Latest(drift)
        self._stamp = -math.inf
        self._feed: MonitorServer | None = None
        self._offers = SUPPORTED and is_device(settings.drive_port)

    def clear(self) -> None:
        """Nothing was heard; where the wheels have come stays known."""
        for newest in (self._odometry, self._ranges, self._scan):
            newest.clear()
        self.pressed = False

    def poll(self) -> None:
        """Take in what has come, and tell those that watch; never waits."""
        for frame in self.drive.poll():
            self._take("drive", frame.message)
        for frame in self.range.poll() if self.range else ():
            self._take("range", frame.message)
        for scan in self.laser.poll():
            self._scan.update(scan, scan.stamp, scan.received_at)
        if self._offers and self.drive.connected:
            self._tell(self._now())

    def _tell(self, now: float) -> None:
        """What the chair says, to those that watch: the port is ours alone."""
        if self._feed is None:
            try:
                self._feed = MonitorServer(self.settings.drive_port)
            except OSError:  # nobody can watch: no reason not to drive
                self._offers = False
                return
        self._feed.publish(now, lambda: status_rows(self, now))

    def _take(self, board: str, message: Any) -> None:
        now = self._now()
        if isinstance(message, Odometry):
            if message.stamp < self._stamp:
                self.odometer.restart()
                self._told["drive"] = {}  # it may hold others now
            self._stamp = message.stamp
            self._odometry.update(message, message.stamp, now - self.settings.odometry_latency)
            self.odometer.update(message, self._odometry.message.measured_at)
            self.pressed |= bool(message.switches & STRIPS)
        elif isinstance(message, Ranges):
            self._ranges.update(message, message.stamp, now)
        elif isinstance(message, Parameter):
            self._told[board][message.number] = message
        elif isinstance(message, Identity):
            self.identities[board] = message
        elif isinstance(message, Answer):
            self.answers[board] = message

    @property
    def odometry(self) -> Odometry:
        """What the drive board said last; there must have been something."""
        told: Odometry = self._odometry.message.value
        return told

    @property
    def ranges_message(self) -> Ranges:
        """What the range board said last; there must have been something."""
        told: Ranges = self._ranges.message.value
        return told

    def stamp_of(self, name: str) -> float:
        """When the newest of odometry, scan or ultrasonic was made [s]; -inf before the first."""
        newest = {"odometry": self._odometry, "scan": self._scan, "ultrasonic": self._ranges}
        return newest[name].message.measured_at

    def ages(self, now: float) -> dict[str, float]:
        """How old the newest of each is [s]; +inf before the first."""
        ages = {"odometry": self._odometry.age(now), "scan": self._scan.age(now)}
        return ages | ({"ultrasonic": self._ranges.age(now)} if self.range else {})

    def stale(self, now: float) -> str:
        """Which of what the chair is driven by is too old or missing; empty: nothing."""
        limits, ages = self.settings.limits, self.ages(now)
        if ages["odometry"] > limits.odometry:
            return _quiet("the drive board", self.drive.error or self.drive.mismatch)
        if ages["scan"] > limits.scan:
            return _quiet("the laser", self.laser.error)
        if self.range and ages["ultrasonic"] > limits.ultrasonic:
            return _quiet("the range board", self.range.error or self.range.mismatch)
        return ""

    def stale_ultrasonic(self, now: float) -> str:
        """Which ultrasonic has not been heard lately; empty: none."""
        old = self.ranges(now)[2] if self.range else np.zeros(RANGERS)
        late = np.flatnonzero(~(old <= self.settings.limits.ultrasonic))
        return f"ultrasonic {late[0]} is silent" if len(late) else ""

    def moving(self) -> str:
        """That the chair moves; empty: it stands."""
        told, still = self.odometry, self.settings.limits.rest_speed
        if max(abs(told.speed_left), abs(told.speed_right)) <= still:
            return ""
        return f"it does not come to rest ({told.speed_left:.2f}, {told.speed_right:.2f} m/s)"

    def stopped(self) -> str:
        """Why the drive board stands and needs a person; empty: it does not."""
        told = self.odometry
        if told.mode != Mode.STOPPED:
            return ""
        why = Fault(told.faults).name or "not armed"
        return f"the drive board has stopped ({why}); a person must re-arm it"

    def laser_mismatch(self) -> str:
        """That the laser's fan is not that of the settings; empty: it is."""
        specs, laser = self.laser.specs, self.sensors.laser
        if specs is None:
            return "the laser has not said what it is"
        first, last = specs.angles[[0, -1]].tolist()
        half = 0.5 * laser.fov
        if specs.beams == laser.beams and max(abs(first + half), abs(last - half)) < _FAN:
            return ""
        return (
            f"the laser {specs.model} has {specs.beams} beams from {math.degrees(first):.1f} to "
            f"{math.degrees(last):.1f} deg; sensors.laser says {laser.beams} over "
            f"{math.degrees(laser.fov):.1f} deg"
        )

    def parameter_mismatch(self, board: str, wanted: dict[str, float]) -> str:
        """That a board holds another parameter than is wanted; empty: all agree.

        One that is not known yet is asked for, and named.
        """
        link = self.drive if board == "drive" else self.range
        if link is None:
            return ""
        names = DRIVE_PARAMETERS if board == "drive" else RANGE_PARAMETERS
        for name, value in wanted.items():
            number = names.index(name)
            told = self._told[board].get(number)
            if told is None:
                link.send(Get(number))
                return f"the {board} board does not tell its {name}"
            if not math.isclose(told.value, value, rel_tol=_AGREE, abs_tol=1e-6):
                said = f"the {board} board's {name} is {told.value:.6g}; expected {value:.6g}"
                return said + self.out_of_bounds(board, name, value)
        return ""

    def out_of_bounds(self, board: str, name: str, value: float) -> str:
        """That a board's own bounds of a parameter forbid a value; empty: they do not, so far."""
        told = self._told[board].get(
            (DRIVE_PARAMETERS if board == "drive" else RANGE_PARAMETERS).index(name)
        )
        if told is None or told.low <= value <= told.high:
            return ""
        return f", which it refuses: it takes {told.low:g} to {told.high:g}"

    def forget_parameters(self) -> None:
        """What parameters the boards hold is not known any longer."""
        self._told = {"drive": {}, "range": {}}

    def ranges(self, now: float) -> tuple[Floats, Floats, Floats]:
        """Laser, ultrasonics and their ages; what is too old is invalid."""
        limits, ages = self.settings.limits, self.ages(now)
        laser = np.full(self.sensors.laser.beams, np.nan, np.float32)
        if ages["scan"] <= limits.scan:
            newest: TimedScan = self._scan.message.value
            if len(newest.scan.ranges) == len(laser):
                laser = newest.scan.ranges.copy()
                # An echo nearer than the sensor can see is none.
                laser[laser < self.sensors.laser.range_min] = np.nan
        sonar = np.full(RANGERS, np.nan, np.float32)
        old = np.full(RANGERS, np.inf, np.float32)
        if self.range and math.isfinite(self._ranges.message.measured_at):
            told: Ranges = self._ranges.message.value
            for k, one in enumerate(told.ranges):
                old[k] = ages["ultrasonic"] + one.age
                if old[k] <= limits.ultrasonic:
                    sonar[k] = _RANGE_OF.get(one.status, one.range)
        return laser, sonar, old

    def close(self) -> None:
        """Let the lines go for good."""
        for line in (self.drive, self.range, self.laser):
            if line is not None:
                line.close()
        if self._feed is not None:
            self._feed.close()
        self._feed, self._offers = None, False


_RANGE_OF: dict[int, float] = {
    RangeStatus.NO_ECHO: math.inf, RangeStatus.SILENT: math.nan, RangeStatus.UNTRIED: math.nan
}  # fmt: skip


def _quiet(who: str, why: str) -> str:
    return f"{who} is silent" + (f" ({why})" if why else "")
