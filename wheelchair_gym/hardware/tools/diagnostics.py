"""What a technician looks at: is all there, does all answer, how often, how late."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from wheelchair_gym.hardware.boards.link import Link
from wheelchair_gym.hardware.boards.monitor import flag_names
from wheelchair_gym.hardware.boards.ports import silent_advice
from wheelchair_gym.hardware.boards.protocol import (
    Board,
    Command,
    Fault,
    Identify,
    Mode,
    RangeStatus,
    Switch,
)
from wheelchair_gym.hardware.boards.senses import BoardSensors
from wheelchair_gym.hardware.control_loop import Clock

POLL_PERIOD = 0.005  # s between two looks at the lines
WATCH = 3.0  # s that all is watched for rates
PATIENCE = 3.0  # s for the first word of each
LATE = 0.03  # s from a command to the odometry that tells of it: its period of 20 ms, and the line
RATES = {"odometry": 50.0, "ultrasonic": 1.0 / 0.06, "scan": 40.0}  # Hz
AMISS = 0.1  # share by which a rate may be off
SEEN = 0.3  # least share of beams with an echo: else the laser looks into nothing, or is covered
_WHO = {"odometry": "drive board", "ultrasonic": "range board", "scan": "laser"}


class Finding(NamedTuple):
    """One line of the technician's table."""

    part: str
    what: str
    found: str
    good: bool
    advice: str = ""  # what to look at where it is not good


Press = Callable[[str], None]


class Diagnostics:
    """Looks a chair over, at rest; it sends no command but zero, and needs no re-arm.

    Args:
        senses: the lines.
        clock: whose time it is.
        wanted: parameters by board, see `HardwareChair.wanted`.
    """

    def __init__(
        self, senses: BoardSensors, clock: Clock, wanted: dict[str, dict[str, float]]
    ) -> None:
        self.senses, self.clock, self.wanted = senses, clock, wanted

    def run(self, ask: Press | None = None, patience: float = 30.0) -> list[Finding]:
        """All findings, in the order in which a technician mends them.

        Args:
            ask: tells a person what to do (the emergency stop is pressed and let go); None: it is
                not tried.
            patience: s that the person has for it.
        """
        heard = self._wait(lambda: not self._missing(), PATIENCE)
        found = [self._line(name) for name in self._parts()]
        if "odometry" in self._missing():
            return found
        found += self._identities()
        found += self._rates()
        if heard or "odometry" not in self._missing():
            found += self._drive()
        if self.senses.range and "ultrasonic" not in self._missing():
            found += self._rangers()
        if "scan" not in self._missing():
            found += self._laser()
        if ask is not None:
            found += self._emergency_stop(ask, patience)
        return found

    def _parts(self) -> list[str]:
        return ["odometry", *(["ultrasonic"] if self.senses.range else []), "scan"]

    def _missing(self) -> list[str]:
        ages = self.senses.ages(self.clock.now())
        return [name for name in self._parts() if not math.isfinite(ages[name])]

    def _wait(self, true: Callable[[], bool], seconds: float) -> bool:
        end = self.clock.now() + seconds
        while self.clock.now() < end:
            self.senses.poll()
            if true():
                return True
            self.clock.wait(self.clock.now() + POLL_PERIOD)
        return False

    def _line(self, name: str) -> Finding:
        own, senses = self.senses.settings, self.senses
        url = {"odometry": own.drive_port, "ultrasonic": own.range_port, "scan": own.laser_port}[
            name
        ]
        lines = {"odometry": senses.drive, "ultrasonic": senses.range, "scan": senses.laser}
        line = lines[name]
        why = "" if line is None else line.error
        mismatch = line.mismatch if isinstance(line, Link) else ""
        silent = name in self._missing()
        found = (why or mismatch or "open, but silent") if silent else "open"
        if line is senses.laser:
            advice = "its cable, its power, its address"
        else:  # what is known of a port that cannot be opened says itself what to do
            advice = "" if why or mismatch else silent_advice()
        return Finding(
            _WHO[name], "line", found if found.startswith(url) else f"{url}: {found}",
            not silent, advice,
        )  # fmt: skip

    def _identities(self) -> list[Finding]:
        found = []
        for name, link, board in (
            ("drive", self.senses.drive, Board.DRIVE_BOARD),
            ("range", self.senses.range, Board.RANGE_BOARD),
        ):
            if link is None or (name == "range" and "ultrasonic" in self._missing()):
                continue
            link.send(Identify())
            self._wait(lambda n=name: n in self.senses.identities, 0.5)  # type: ignore[misc]
            told = self.senses.identities.get(name)
            if told is None:
                found.append(Finding(f"{name} board", "firmware", "tells nothing", False, "flash"))
                continue
            text = f"{told.parameters} parameters, reset cause 0x{told.cause:02x}"
            text += ", stored" if told.stored else ", defaults"
            good = told.board == board
            swapped = "" if good else "it is the other board: swap the two devices in the config"
            found.append(Finding(f"{name} board", "firmware", text, good, swapped))
            wanted = self.wanted[name]
            self._wait(lambda n=name, w=wanted: not self._unsure(n, w), 3.0)  # type: ignore[misc]
            differs = self.senses.parameter_mismatch(name, wanted)
            found.append(
                Finding(
                    f"{name} board", "parameters", differs or "as the config says", not differs,
                    "wheelchair hardware setup",
                )
            )  # fmt: skip
        return found

    def _unsure(self, name: str, wanted: dict[str, float]) -> bool:
        """Whether parameters are still asked for."""
        return "does not tell" in self.senses.parameter_mismatch(name, wanted)

    def _rates(self) -> list[Finding]:
        senses, counts = self.senses, dict.fromkeys(self._parts(), 0)
        latest: dict[str, float] = {}
        late, sequence, sent = [], None, 0.0
        begun = self.clock.now()
        while self.clock.now() - begun < WATCH:
            if sequence is None:
                sequence, sent = senses.drive.send(Command(0.0, 0.0)), self.clock.now()
            senses.poll()
            now = self.clock.now()
            for name, age in senses.ages(now).items():
                if math.isfinite(age) and latest.get(name) != (stamp := senses.stamp_of(name)):
                    latest[name] = stamp
                    counts[name] += 1
            if math.isfinite(senses.ages(now)["odometry"]) and senses.odometry.echo == sequence:
                late.append(now - sent)
                sequence = None
            self.clock.wait(now + POLL_PERIOD)
        found = []
        for name, count in counts.items():
            if name in self._missing():
                continue
            rate, right = count / WATCH, RATES[name]
            good = abs(rate - right) <= AMISS * right
            found.append(
                Finding(
                    _WHO[name], "rate", f"{rate:.1f} Hz, expected {right:.1f}", good,
                    "a busy computer or USB hub; a wrong device",
                )
            )  # fmt: skip
        p99 = float(np.quantile(late, 0.99)) if late else math.inf
        found.append(
            Finding(
                "drive board", "answer to a command", f"{1e3 * p99:.0f} ms (99 % of {len(late)})",
                p99 <= LATE + POLL_PERIOD, "USB latency timer, a busy computer",
            )
        )  # fmt: skip
        bad = senses.drive.statistics.bad + (senses.range.statistics.bad if senses.range else 0)
        found.append(Finding("both boards", "frames refused", str(bad), bad == 0, "cable, ground"))
        return found

    def _drive(self) -> list[Finding]:
        told, empty = self.senses.odometry, self.wanted["drive"]["under_voltage"]
        faults, switches = Fault(told.faults), Switch(told.switches)
        standing = faults & ~(Fault.RESET | Fault.LINK | Fault.STORE)
        return [
            Finding(
                "battery", "voltage", f"{told.battery:.1f} V, empty at {empty:g}",
                told.battery > empty, "charge it; divider of A0",
            ),
            Finding(
                "drive board", "state", f"{Mode(told.mode).name}, faults {flag_names(faults)}",
                not standing, "see 'How it stops' in the README",
            ),
            Finding(
                "switches", "pressed", flag_names(switches), not switches,
                "what is named, or its broken wire",
            ),
        ]  # fmt: skip

    def _rangers(self) -> list[Finding]:
        found = []
        self._wait(lambda: False, 0.6)  # each has fired
        for k, one in enumerate(self.senses.ranges_message.ranges):
            status = RangeStatus(one.status)
            text = f"{one.range:.2f} m" if status == RangeStatus.ECHO else status.name.lower()
            good = status in (RangeStatus.ECHO, RangeStatus.NO_ECHO)
            found.append(Finding(f"ultrasonic {k}", "range", text, good, "its plug, its address"))
        return found

    def _laser(self) -> list[Finding]:
        specs, misfit = self.senses.laser.specs, self.senses.laser_mismatch()
        laser, _, _ = self.senses.ranges(self.clock.now())
        share = float(np.isfinite(laser).mean())
        model = "unknown" if specs is None else specs.model
        return [
            Finding("laser", "fan", misfit or f"{model}: as the config says", not misfit, "config"),
            Finding(
                "laser", "beams with an echo", f"{share:.0%}", share >= SEEN,
                "its window; or nothing stands within reach",
            ),
        ]  # fmt: skip

    def _emergency_stop(self, ask: Press, patience: float) -> list[Finding]:
        def pressed() -> bool:
            return bool(self.senses.odometry.switches & Switch.STOP_PRESSED)

        ask("press the emergency stop")
        down = self._wait(pressed, patience)
        latched = down and self._wait(
            lambda: bool(self.senses.odometry.faults & Fault.EMERGENCY_STOP), 0.2
        )
        if down:
            ask("let it go")
        up = down and self._wait(lambda: not pressed(), patience)
        still = up and self.senses.odometry.mode == Mode.STOPPED
        said = "seen, latched, let go" if still and latched else "pressed" if down else "not seen"
        return [
            Finding(
                "emergency stop", "second contact", said, bool(still and latched),
                "contact at pin 37, closed to ground when let go",
            )
        ]  # fmt: skip
