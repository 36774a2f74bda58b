"""A technician's diagnostics: which parts answer, how often, how late, and where they look."""

import functools
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from wheelchair_gym.base.arrays import Array
from wheelchair_gym.geometry.outline import Footprint
from wheelchair_gym.hardware.boards import protocol
from wheelchair_gym.hardware.boards.parameters import identify
from wheelchair_gym.hardware.boards.ports import silent_advice
from wheelchair_gym.hardware.boards.protocol import Fault, Mode, RangeStatus, Switch
from wheelchair_gym.hardware.boards.senses import LASERS, POLL_PERIOD, BoardSensors
from wheelchair_gym.hardware.control_loop import Clock
from wheelchair_gym.perception.occupancy import read_scan, wall_ahead


def flag_names(flags: Fault | Switch) -> str:
    """The names of the flags that are set."""
    return flags.name or "none"


def status_rows(senses: BoardSensors, now: float) -> list[tuple[str, str]]:
    """The chair's present state, as rows of name and value."""
    ages, rows = senses.ages(now), []
    for name, link in (("drive board", senses.drive), ("range board", senses.range)):
        if link is not None:
            s = link.statistics
            counts = f"{s.received} frames, {s.bad} refused, {s.missed} missed"
            rows.append((name, link.error or link.mismatch or counts))
    for laser, who in zip(senses.lasers, LASERS, strict=False):
        rows.append((who, laser.error or f"{laser.scans} scans"))
    rows.append(("ages", "  ".join(f"{name} {1e3 * age:.0f} ms" for name, age in ages.items())))
    if math.isfinite(ages["odometry"]):
        state = senses.odometry
        pose, _ = senses.odometer.at(now)
        rows += [
            ("mode", f"{Mode(state.mode).name}, faults {flag_names(Fault(state.faults))}"),
            ("switches", flag_names(Switch(state.switches))),
            ("set point", f"{state.v:.3f} m/s  {state.w:.3f} rad/s"),
            ("wheels", f"{state.speed_left:.3f}  {state.speed_right:.3f} m/s"),
            ("duties", f"{state.duty_left:.2f}  {state.duty_right:.2f}"),
            ("odometry", f"{pose[0]:.3f} m  {pose[1]:.3f} m  {math.degrees(pose[2]):.1f} deg"),
            ("battery", f"{state.battery:.1f} V"),
        ]
    ranges, sonar, old = senses.ranges(now)
    if np.isfinite(ranges).any():
        nearest = int(np.nanargmin(np.where(np.isfinite(ranges), ranges, np.inf)))
        x, y = senses.sensors.directions[nearest]
        bearing = math.degrees(math.atan2(y, x))
        rows.append(("nearest echo", f"{ranges[nearest]:.2f} m at {bearing:.0f} deg"))
    each = zip(senses.sensors.ultrasonic.mounted, sonar, old, strict=False)
    rows.append(("ultrasonics", "  ".join(f"{r:.2f} ({a:.1f} s)" for _, r, a in each)))
    return rows


WATCH = 3.0  # s for which rates are measured
PATIENCE = 3.0  # s for the first message of each part
ANSWER = 0.5  # s after which a command or its answer was lost
LATE = 0.03  # s from a command to odometry that echoes it: its period of 20 ms, and the line
ODOMETRY_RATE = 50.0  # Hz
TOLERANCE = 0.1  # maximum relative error of a rate, and at least one message in WATCH
ECHOES = 0.3  # least share of beams with an echo: with fewer, the laser may be covered
_BOARDS = {"drive": "odometry", "range": "ultrasonic"}


class Finding(NamedTuple):
    """One line of the technician's table."""

    part: str
    what: str
    found: str
    good: bool
    advice: str = ""  # what to look at where it is not good


class Diagnostics:
    """Checks a chair at rest; it sends no command but zero, and needs no re-arm.

    Args:
        senses: the lines.
        clock: real or simulated time.
        wanted: parameters by board, see `HardwareChair.parameters`.
    """

    def __init__(
        self, senses: BoardSensors, clock: Clock, wanted: dict[str, dict[str, float]]
    ) -> None:
        self.senses, self.clock, self.wanted = senses, clock, wanted
        self._links, self._parts = {"odometry": senses.drive}, {"odometry": "drive board"}
        if senses.range:
            self._links["ultrasonic"], self._parts["ultrasonic"] = senses.range, "range board"
        self._parts |= dict(zip(senses.scans, LASERS, strict=False))

    def run(
        self, ask: Callable[[str], None] | None = None, patience: float = 30.0
    ) -> list[Finding]:
        """All findings, in the order in which a technician repairs them.

        Args:
            ask: asks a person to press and release the emergency stop; None: it is not tested.
            patience: s that the person has for it.
        """
        self._wait(lambda: not self._missing(), PATIENCE)
        found = [self._line(name) for name in self._parts]
        if "odometry" in self._missing():
            return found
        found += [*self._identities(), *self._rates(), *self._drive()]
        if self.senses.range and "ultrasonic" not in self._missing():
            found += self._rangers()
        found += self._lasers()
        if ask is not None:
            found.append(self._emergency_stop(ask, patience))
        return found

    def _missing(self) -> list[str]:
        ages = self.senses.ages(self.clock.now())
        return [name for name in self._parts if not math.isfinite(ages[name])]

    def _wait(self, condition: Callable[[], bool], seconds: float) -> bool:
        return self.senses.wait_for(self.clock, condition, seconds)

    def _line(self, name: str) -> Finding:
        silent = name in self._missing()
        if name in self._links:
            url, why = self._links[name].url, self._links[name].error or self._links[name].mismatch
            advice = "" if why else silent_advice()  # the error of a port holds its own advice
        else:
            laser = self.senses.lasers[self.senses.scans.index(name)]
            url, why, advice = laser.url, laser.error, "its cable, power, address"
        found = (why or "open, but silent") if silent else "open"
        text = found if found.startswith(url) else f"{url}: {found}"
        return Finding(self._parts[name], "line", text, not silent, advice)

    def _identities(self) -> Iterator[Finding]:
        for name, data in _BOARDS.items():
            part = f"{name} board"
            if data not in self._links or data in self._missing():
                continue
            if not identify(self.senses, self.clock, name):
                yield Finding(part, "firmware", "does not identify itself", False, "flash")
                continue
            identity = self.senses.identities[name]
            text = f"{identity.parameters} parameters, reset cause 0x{identity.cause:02x}"
            text += ", stored" if identity.stored else ", defaults"
            yield Finding(part, "firmware", text, True)
            differs = self._mismatch(name)
            text, advice = differs or "as the config says", "wheelchair hardware setup"
            yield Finding(part, "parameters", text, not differs, advice)

    def _mismatch(self, board: str) -> str:
        """Differences of a board's parameters from the wanted ones, once all are reported."""
        table, wanted = self.senses.parameters[board], self.wanted[board]

        def complete() -> bool:
            differs = table.mismatch(wanted)  # requests what is missing
            return not differs or table.reported.keys() >= wanted.keys()

        self._wait(complete, 3.0)
        return table.mismatch(wanted)

    def _rates(self) -> Iterator[Finding]:
        senses, counts = self.senses, dict.fromkeys(self._parts, 0)
        latest = {name: senses.stamp_of(name) for name in counts}
        delays, sequence, sent, n_lost = [], None, 0.0, 0
        begun = self.clock.now()
        while self.clock.now() - begun < WATCH:
            if sequence is None:
                sequence, sent = senses.drive.send(protocol.Command(0.0, 0.0)), self.clock.now()
            senses.poll()
            now = self.clock.now()
            for name, before in latest.items():
                if before != (stamp := senses.stamp_of(name)):
                    latest[name] = stamp
                    counts[name] += 1
            if math.isfinite(senses.ages(now)["odometry"]) and senses.odometry.echo == sequence:
                delays.append(now - sent)
                sequence = None
            elif sequence is not None and now - sent > ANSWER:
                n_lost, sequence = n_lost + 1, None
            self.clock.wait(now + POLL_PERIOD)
        advice = "a busy computer or USB hub; a wrong device"
        rates = {"odometry": ODOMETRY_RATE, "ultrasonic": 1.0 / senses.sensors.ultrasonic.interval}
        each = zip(senses.scans, senses.lasers, strict=True)
        rates |= {name: laser.specs.rpm / 60.0 for name, laser in each if laser.specs}
        for name, count in counts.items():
            if name not in self._missing():
                rate, expected = count / WATCH, rates[name]
                good = abs(count - expected * WATCH) <= max(TOLERANCE * expected * WATCH, 1.0)
                text = f"{rate:.1f} Hz, expected {expected:.1f}"
                yield Finding(self._parts[name], "rate", text, good, advice)
        p99 = float(np.quantile(delays, 0.99)) if delays else math.inf
        text = f"{1e3 * p99:.0f} ms (99 % of {len(delays)}), {n_lost} without an answer"
        good = p99 <= LATE + POLL_PERIOD and not n_lost
        advice = "USB latency timer, a busy computer"
        yield Finding("drive board", "answer to a command", text, good, advice)
        bad = senses.drive.statistics.bad + (senses.range.statistics.bad if senses.range else 0)
        yield Finding("both boards", "frames refused", str(bad), bad == 0, "cable, ground")

    def _drive(self) -> Iterator[Finding]:
        state, empty = self.senses.odometry, self.wanted["drive"]["under_voltage"]
        faults, switches = Fault(state.faults), Switch(state.switches)
        serious = faults & ~(Fault.RESET | Fault.LINK | Fault.STORE | Fault.EMERGENCY_STOP)
        voltage = f"{state.battery:.1f} V, empty at {empty:g}"
        mode = f"{Mode(state.mode).name}, faults {flag_names(faults)}"
        charged, advice = state.battery > empty, "what is named, or its broken wire"
        yield Finding("battery", "voltage", voltage, charged, "charge it; divider of A0")
        yield Finding("drive board", "state", mode, not serious, "hardware/README.md: How it stops")
        yield Finding("switches", "pressed", flag_names(switches), not switches, advice)

    def _rangers(self) -> Iterator[Finding]:
        rangers = self.senses.sensors.ultrasonic
        n = len(rangers.mounted)
        self._wait(lambda: False, (n + 2) * rangers.interval)  # each has fired
        for k, one in enumerate(self.senses.ranges_message.ranges[:n]):
            status = RangeStatus(one.status)
            text = f"{one.range:.2f} m" if status == RangeStatus.ECHO else status.name.lower()
            good = status in (RangeStatus.ECHO, RangeStatus.NO_ECHO)
            yield Finding(f"ultrasonic {k}", "range", text, good, "its plug, its address")

    def _lasers(self) -> Iterator[Finding]:
        senses = self.senses
        ranges, _, _ = senses.ranges(self.clock.now())
        for k, name in enumerate(senses.scans):
            if name in self._missing():
                continue
            specs, mismatch = senses.lasers[k].specs, senses.laser_mismatch(k)
            share = float(np.isfinite(ranges[senses.sensors.slices[k]]).mean())
            fan = mismatch or f"{'unknown' if specs is None else specs.model}: as the config says"
            advice = "its window; or nothing stands within reach"
            yield Finding(LASERS[k], "fan", fan, not mismatch, "config")
            yield Finding(LASERS[k], "beams with an echo", f"{share:.0%}", share >= ECHOES, advice)

    def _emergency_stop(self, ask: Callable[[str], None], patience: float) -> Finding:
        def pressed() -> bool:
            return bool(self.senses.odometry.switches & Switch.STOP_PRESSED)

        def latched() -> bool:
            return bool(self.senses.odometry.faults & Fault.EMERGENCY_STOP)

        ask("press the emergency stop")
        down = self._wait(pressed, patience)
        good = down and self._wait(latched, 0.2)
        if down:
            ask("let it go")
            good &= self._wait(lambda: not pressed(), patience)
            good &= self.senses.odometry.mode == Mode.STOPPED
        text = "seen, latched, let go" if good else "pressed" if down else "not seen"
        advice = "contact at pin 37, closed to ground when let go"
        return Finding("emergency stop", "second contact", text, good, advice)


HAND, WALL = 0.3, 0.5  # m: of a hand from a sensor or corner, and of a wall from the front edge
CLEAR = 1.0  # m around the laser in which nothing but the hand stands
_HEARD = 0.5  # m: nearer echoes of ultrasonics are of the hand
_BY_EYE = 0.15  # m: a hand is held so exactly
_WALL_OFF, _WALL_TURNED = 0.05, math.radians(6.0)  # a wall is placed so exactly, with a rule
_HELD, _STILL = 1.0, 0.05  # s, m: a hand is held for this time within this distance


@dataclass(frozen=True)
class Orientation:
    """Asks a person for a hand before each sensor, then for a wall.

    No other check at rest finds a laser that is mounted upside down, turned or moved, or two
    ultrasonics whose plugs are exchanged: they send good data of another place.

    Args:
        senses: the lines.
        clock: real or simulated time.
        footprint: of the chair.
        ask: shows the person a request.
        patience: time that the person has for each request [s].
    """

    senses: BoardSensors
    clock: Clock
    footprint: Footprint
    ask: Callable[[str], None]
    patience: float = 30.0

    def run(self) -> list[Finding]:
        """Return the findings of all sensors that have sent data."""
        found, ages = [], self.senses.ages(self.clock.now())
        for k, name in enumerate(self.senses.scans):
            if math.isfinite(ages[name]):
                found += [self._laser_sees(k, "left", 1.0), self._laser_sees(k, "right", -1.0)]
        if math.isfinite(ages.get("ultrasonic", math.inf)):
            rangers = self.senses.sensors.ultrasonic.mounted
            found += [self._ranger_hears(k) for k in range(len(rangers))]
        return found + ([self._wall()] if math.isfinite(ages["scan"]) else [])

    def _laser_sees(self, k: int, side: str, sign: float) -> Finding:
        ahead = abs(self.senses.sensors.lasers[k].yaw) < 0.5 * math.pi
        outline = self.footprint
        x, y = outline.front if ahead else -outline.rear, sign * (outline.half_width + HAND)
        corner = f"{'front' if ahead else 'rear'} {side} corner"
        what = f"hold a hand {HAND:g} m {side} of the {corner}"
        seen = self._await(what, functools.partial(self._near, k))
        if seen is None:
            return _finding(LASERS[k], f"hand on the {side}", "not seen", False)
        good = math.hypot(seen[0] - x, seen[1] - y) <= _BY_EYE
        where = f"seen {_place(*seen)}; expected {_place(x, y)}"
        return _finding(LASERS[k], f"hand on the {side}", where, good)

    def _ranger_hears(self, k: int) -> Finding:
        one = self.senses.sensors.ultrasonic.mounted[k]
        what = f"hold a hand {HAND:g} m before ultrasonic {k} ({_place(one.x, one.y)})"
        heard = self._await(what, self._loudest)
        text = "not heard" if heard is None else f"heard by {heard[0]:.0f} at {heard[1]:.2f} m"
        return _finding(f"ultrasonic {k}", "hand", text, heard is not None and bool(heard[0] == k))

    def _wall(self) -> Finding:
        what = f"stand a flat wall or board square to the chair, {WALL:g} m before its front edge"
        seen = self._await(what, self._flat)
        if seen is None:
            return _finding("laser", "wall ahead", "not seen", False)
        far, turned = seen[0] - self.footprint.front, seen[1]
        good = bool(abs(far - WALL) <= _WALL_OFF and abs(turned) <= _WALL_TURNED)
        text = f"{far:.2f} m before the front edge, turned by {math.degrees(turned):.0f} deg"
        return _finding("laser", "wall ahead", text, good)

    def _await(self, what: str, look: Callable[[], Array | None]) -> Array | None:
        """Ask for something; return what was seen in one place for a while, None: nothing was."""
        if look != self._flat and look() is not None:
            self.ask(f"clear {CLEAR:g} m around the chair")
            if not self._wait(lambda: look() is None):
                return None  # what stands there could be taken for the hand
        self.ask(what)
        place, since = None, math.inf

        def held() -> bool:
            nonlocal place, since
            now, seen = self.clock.now(), look()
            if seen is None or place is None or float(np.abs(seen - place).max()) > _STILL:
                place, since = seen, now
            return place is not None and now - since >= _HELD

        return place if self._wait(held) else None

    def _wait(self, condition: Callable[[], bool]) -> bool:
        return self.senses.wait_for(self.clock, condition, self.patience)

    def _near(self, k: int) -> Array | None:
        """Return the k-th laser's nearest echo (2,) [m], in the chair's frame, if it is near."""
        sensors, (ranges, _, _) = self.senses.sensors, self.senses.ranges(self.clock.now())
        scan = read_scan(sensors.lasers[k], ranges[sensors.slices[k]])
        far = np.hypot(*(scan.echoes - scan.origin).T)
        return np.array(scan.echoes[far.argmin()]) if far.min(initial=math.inf) < CLEAR else None

    def _loudest(self) -> Array | None:
        """Return number and range [m] of the ultrasonic with the nearest echo, if it is near."""
        ranges = np.nan_to_num(self.senses.ranges(self.clock.now())[1], nan=math.inf)
        k = int(ranges.argmin())
        return np.array([k, ranges[k]]) if ranges[k] < _HEARD else None

    def _flat(self) -> Array | None:
        """Return distance [m] from the axle's centre and bearing [rad] of a near wall, if any."""
        laser, (ranges, _, _) = self.senses.sensors.laser, self.senses.ranges(self.clock.now())
        try:
            wall = wall_ahead(laser, ranges[: laser.beams])
        except ValueError:
            return None
        return np.array(wall) if wall.distance < self.footprint.front + 2.0 * WALL else None


def _place(x: float, y: float) -> str:
    """Describe a place in the chair's frame."""
    aside = f"{abs(y):.2f} m to the {'left' if y > 0.0 else 'right'}"
    return f"{abs(x):.2f} m {'ahead' if x >= 0.0 else 'behind'}, {aside}"


def _finding(part: str, what: str, text: str, good: bool) -> Finding:
    laser = "its mount: upside down, turned, moved? sensors.laser"
    return Finding(part, what, text, good, laser if part == "laser" else "its plug, its place")
