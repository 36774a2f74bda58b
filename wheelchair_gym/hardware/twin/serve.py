"""The twin in real time: a pseudo-terminal for each board, a TCP port for the laser.

Any program for the real chair can use it unchanged. Typed lines inject faults: rows of `COMMANDS`
and cases of `_inject`.
"""

import contextlib
import math
import os
import select
import socket
import termios
import time
import tty
from collections.abc import Callable

import numpy as np

from wheelchair_gym.hardware.boards.protocol import Switch
from wheelchair_gym.hardware.twin.board import LineNoise, SerialCable
from wheelchair_gym.hardware.twin.laser import TwinLaser
from wheelchair_gym.hardware.twin.lockstep import Faults, JoystickState, Twin
from wheelchair_gym.hardware.twin.plant import Slope

SLICE = 0.005  # s of simulated time between two reads of the lines
LATE = 5.0  # s behind real time, up to which the simulation catches up
_CHUNK = 65536


class Terminal:
    """A pseudo-terminal at a cable; bytes that no host reads are dropped.

    Attributes:
        path: of the device that a host opens.
    """

    def __init__(self, wire: SerialCable) -> None:
        self.wire = wire
        self._near, far = os.openpty()
        tty.setraw(far)
        os.set_blocking(self._near, False)
        self.path = os.ttyname(far)
        os.close(far)  # so that the near end shows whether a host has it open
        self._poll = select.poll()
        self._poll.register(self._near, select.POLLIN)
        self._open = False

    def pump(self) -> None:
        """Pass bytes both ways; never waits."""
        hung_up = any(event & select.POLLHUP for _, event in self._poll.poll(0))
        before, self._open = self._open, not hung_up
        with contextlib.suppress(OSError):  # nothing to read, no host, or unplugged
            if self._open and not before:
                self.wire.open()
            self.wire.write(os.read(self._near, _CHUNK))
        data = self.wire.receive()
        if data and self._open:
            try:
                os.write(self._near, data)
            except BlockingIOError:  # the host does not read: the bytes are old
                self._flush()

    def _flush(self) -> None:
        """Drop the bytes that wait at the far end, unless a host has locked it."""
        with contextlib.suppress(OSError):
            far = os.open(self.path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
            termios.tcflush(far, termios.TCIFLUSH)
            os.close(far)

    def close(self) -> None:
        """Remove the device."""
        os.close(self._near)


class LaserServer:
    """A TCP port at a laser of the twin, for one host at a time; a newer one replaces the older."""

    def __init__(self, laser: TwinLaser, port: int) -> None:
        self._laser = laser
        self._listener = socket.create_server(("127.0.0.1", port))
        self._listener.setblocking(False)
        self._peer: socket.socket | None = None
        self._unsent = b""
        self.port = int(self._listener.getsockname()[1])

    def pump(self) -> None:
        """Pass bytes both ways; never waits."""
        with contextlib.suppress(BlockingIOError):
            peer, _ = self._listener.accept()
            peer.setblocking(False)
            self._disconnect()
            self._peer = peer
        if not self._laser.plugged:
            self._disconnect()
        if self._peer is None:
            return
        try:
            with contextlib.suppress(BlockingIOError):
                data = self._peer.recv(_CHUNK)
                if not data:
                    self._disconnect()
                    return
                self._laser.write(data)
            if not self._unsent:  # a host that does not read misses whole scans
                self._unsent = self._laser.read_all()
            with contextlib.suppress(BlockingIOError):
                self._unsent = self._unsent[self._peer.send(self._unsent) :]
        except OSError:
            self._disconnect()

    def _disconnect(self) -> None:
        if self._peer is not None:
            self._peer.close()
        self._peer, self._unsent = None, b""
        self._laser.close()

    def close(self) -> None:
        """Close the port."""
        self._disconnect()
        self._listener.close()


class ServedTwin:
    """A twin that runs in real time, behind devices.

    Args:
        twin: after its reset.
        port: of the laser, and the next ones of further lasers; 0 chooses them.

    Attributes:
        drive: terminal of the drive board.
        range: terminal of the range board.
        lasers: servers of the lasers.
        max_delay: the longest delay behind real time so far [s].

    Raises:
        OSError: no pseudo-terminal, or the port is taken.
    """

    def __init__(self, twin: Twin, port: int = 0) -> None:
        self.twin = twin
        self.lasers = [
            LaserServer(laser, port + k if port else 0) for k, laser in enumerate(twin.lasers)
        ]
        self.drive = Terminal(SerialCable(twin.drive, np.random.default_rng(0)))
        self.range = Terminal(SerialCable(twin.range, np.random.default_rng(1)))
        self._ends: list[Terminal | LaserServer] = [self.drive, self.range, *self.lasers]
        self.max_delay = 0.0

    def run(self, until: Callable[[], bool]) -> None:
        """Run in real time, with absolute deadlines, until `until` returns true."""
        due = time.monotonic()
        while not until():
            self.twin.run(SLICE)
            for end in self._ends:
                end.pump()
            due += SLICE
            late = time.monotonic() - due
            self.max_delay = max(self.max_delay, late)
            if late < 0.0:
                time.sleep(-late)
            elif late > LATE:  # the machine is too slow: so is the simulation
                due += late

    def close(self) -> None:
        """Remove the devices and the port; the twin stays."""
        for end in self._ends:
            end.close()


_SIDES = {"left": 0, "right": 1}
_SWITCHES = {
    "stop": Switch.STOP_PRESSED,
    "front": Switch.FRONT,
    "rear": Switch.REAR,
    "left": Switch.LEFT,
    "right": Switch.RIGHT,
    "lever": Switch.FREEWHEEL,
    "driver-left": Switch.DRIVER_LEFT,
    "driver-right": Switch.DRIVER_RIGHT,
}
_STICKS = {"free": JoystickState(manual=True), "back": JoystickState(), "silent": None}

COMMANDS = {  # name: its arguments
    "press": " | ".join(_SWITCHES),
    "release": " | ".join(_SWITCHES),
    "encoder": "left | right, lost | swapped",
    "block": "left | right",
    "driver": "left | right, DUTY (-1 to 1) at which it is stuck",
    "motor": "left | right, inverted; or both swapped",
    "brakes": "SHARE of their torque that is left",
    "slope": "DEGREES (0 to 20), and the DIRECTION in degrees in which the floor falls",
    "push": "NEWTONS (-1000 to 1000) along its heading",
    "push-switch": "held | free",
    "reset-on-open": "drive | range: opening its port resets the board",
    "battery": "VOLTS",
    "sonar": "0 to 7 (0 to 9 of ten), silent | METRES",
    "stick": "AHEAD ASIDE (-1 to 1, held) | free | back | silent",
    "assisted": "AHEAD ASIDE (-1 to 1, held): as stick, while the host helps",
    "unplug": "drive | range | laser | laser_1, which is the second one",
    "silence": "laser | laser_1",
    "noise": "SHARE of bytes that are corrupted",
    "hang": "drive | range",
    "power": "drive | range: off and on",
    "heal": "",
}


def _number(word: str, low: float, high: float) -> float:
    value = float(word)
    if not low <= value <= high:
        raise ValueError(word)
    return value


def _inject(served: ServedTwin, words: list[str]) -> None:
    """Carry out a command.

    Raises:
        KeyError, ValueError: it is malformed.
    """
    twin, faults = served.twin, served.twin.faults
    terminals = {"drive": served.drive, "range": served.range}
    boards = {"drive": twin.drive, "range": twin.range}
    lasers = {f"laser_{k}" if k else "laser": laser for k, laser in enumerate(twin.lasers)}
    rangers = {str(k): k for k in range(len(twin.plant.chair.sensors.ultrasonic.mounted))}
    match words:
        case ["press", switch]:
            faults.switches |= _SWITCHES[switch]
        case ["release", switch]:
            faults.switches &= ~_SWITCHES[switch]
        case ["encoder", side, "lost" | "swapped" as how]:
            broken = faults.disconnected_encoders if how == "lost" else faults.swapped_encoders
            broken[_SIDES[side]] = True
        case ["block", side]:
            k, (left, right) = _SIDES[side], faults.blocked_wheels
            faults.blocked_wheels = (left or k == 0, right or k == 1)
        case ["driver", side, duty]:
            faults.stuck_drivers[_SIDES[side]] = _number(duty, -1.0, 1.0)
        case ["motor", "both", "swapped"]:
            faults.swapped_motors = True
        case ["motor", side, "inverted"]:
            faults.inverted_motors[_SIDES[side]] = True
        case ["brakes", share]:
            faults.brake_fraction = _number(share, 0.0, 1.0)
        case ["slope", degrees, *direction] if len(direction) < 2:
            downhill = _number(direction[0], -360.0, 360.0) if direction else 0.0
            angle = math.radians(_number(degrees, 0.0, 20.0))
            faults.slope = Slope(angle, math.radians(downhill))
        case ["push", newtons]:
            faults.push_force = _number(newtons, -1000.0, 1000.0)
        case ["push-switch", "held" | "free" as state]:
            faults.push_switch = state == "held"
        case ["reset-on-open", board]:
            terminals[board].wire.resets_on_open = True
        case ["battery", volts]:
            faults.battery = _number(volts, 0.0, 60.0)
        case ["sonar", which, "silent"]:
            faults.silent_ultrasonics.add(rangers[which])
        case ["sonar", which, metres]:
            faults.stuck_ultrasonics[rangers[which]] = _number(metres, 0.0, 6.0)
        case ["stick", state]:
            faults.joystick = _STICKS[state]
        case ["stick" | "assisted" as who, ahead, aside]:
            forward, turn = _number(ahead, -1.0, 1.0), _number(aside, -1.0, 1.0)
            faults.joystick = JoystickState(forward, turn, manual=who == "stick", dead_man=True)
        case ["unplug", laser] if laser in lasers:
            lasers[laser].plugged = False
        case ["unplug", board]:
            terminals[board].wire.plugged = False
        case ["silence", laser]:
            lasers[laser].silent = True
        case ["noise", share]:
            for end in terminals.values():
                end.wire.noise = LineNoise(corrupt=_number(share, 0.0, 1.0))
        case ["hang", board]:
            boards[board].hang()
        case ["power", board]:
            boards[board].reset()
        case ["heal"]:
            twin.faults = Faults()
            for one in twin.lasers:
                one.plugged, one.silent = True, False
            for end in terminals.values():
                wire = end.wire
                wire.plugged, wire.noise, wire.resets_on_open = True, LineNoise(), False
        case _:
            raise ValueError(words)


def run_command(served: ServedTwin, line: str) -> str:
    """Carry out a line of words; return what to print."""
    words = line.split()
    if not words:
        return ""
    if words[0] not in COMMANDS:
        return "\n".join(f"{name} {arguments}".rstrip() for name, arguments in COMMANDS.items())
    try:
        _inject(served, words)
    except (KeyError, ValueError):
        return f"{line.strip()}: expected {words[0]} {COMMANDS[words[0]]}"
    return f"{line.strip()}: done"
