"""Messages between host and boards, and their frames, as bytes; protocol.h has the same tables.

A frame is COBS(version, kind, sequence, payload, CRC-32), ended by a zero byte. Messages hold SI
units; the step of each number on the wire is in its layout.
"""

import enum
import math
import struct
import zlib
from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar


class CommandFlag(enum.IntFlag):
    """State of a command's execution."""

    PROTECTIVE = 0x01  # brake at the protective rate, exempt from jerk
    # A person drives by the board's joystick, and the host helps: the chair is at rest while the
    # dead-man switch is let go, the stick is centred or the joystick is silent.
    ASSISTED = 0x02


class JoystickFlag(enum.IntFlag):
    """The state of the joystick at the drive board."""

    FRESH = 0x01  # its receiver was heard within 0.2 s
    HELD = 0x02  # its dead-man switch
    MUST_CENTRE = 0x04  # nothing is driven before the stick was at its centre


class Mode(enum.IntEnum):
    """Mode of the drive board: the source of the chair's commands, if any."""

    STOPPED = 0  # drivers off, brakes on; a person must re-arm
    HOST = 1
    MANUAL = 2  # the joystick at the board
    STOPPING = 3  # a controlled stop
    READY = 4  # drivers off, brakes on; the next command drives


class Fault(enum.IntFlag):
    """Faults that the drive board latches until a person re-arms it."""

    RESET = 0x0001
    EMERGENCY_STOP = 0x0002
    LINK = 0x0004  # no command for longer than `latch`
    STALL = 0x0008  # a wheel is driven and no counts come: blocked, or without encoder
    DIRECTION = 0x0010  # a wheel turns against its motor
    ENCODER = 0x0020  # impossible steps
    OVER_SPEED = 0x0040
    UNDER_VOLTAGE = 0x0080
    DRIVER = 0x0100  # a motor driver reports a fault, Hall sensors among them
    STORE = 0x0200  # EEPROM unreadable: parameters are defaults until a host saves them
    RUNAWAY = 0x0400  # a wheel turns faster than its set point, or does not come to rest
    BRAKE = 0x0800  # the closed brakes have slipped repeatedly
    IMPLAUSIBLE = 0x1000  # motor voltage and measured speed do not fit together
    OVERRUN = 0x2000  # the control came too late, once or repeatedly
    LEVER = 0x4000  # the freewheel lever was lifted while the board had the chair


class Switch(enum.IntFlag):
    """Switches at the drive board."""

    STOP_PRESSED = 0x01
    FRONT = 0x02
    REAR = 0x04
    LEFT = 0x08
    RIGHT = 0x10
    FREEWHEEL = 0x20
    DRIVER_LEFT = 0x40
    DRIVER_RIGHT = 0x80


STRIPS = Switch.FRONT | Switch.REAR | Switch.LEFT | Switch.RIGHT


class RangeStatus(enum.IntEnum):
    """The result of an ultrasonic's firing."""

    ECHO = 0
    NO_ECHO = 1
    SILENT = 2  # the sensor does not answer
    UNTRIED = 3  # it has not fired yet, or the board has no such ranger


class Status(enum.IntEnum):
    """A board's answer."""

    DONE = 0
    UNKNOWN = 1
    OUT_OF_RANGE = 2
    MOVING = 3  # the request needs rest, with the drivers off
    CAUSE_STANDS = 4  # of a fault (STORE: nothing was saved yet), or the freewheel lever
    NOT_AT_ZERO = 5  # the request needs a fresh command of zero
    OTHER_FAULTS = 6
    BUSY = 7


class Board(enum.IntEnum):
    """The board that sends."""

    DRIVE_BOARD = 1
    RANGE_BOARD = 2


VERSION = 3
BAUD = 500_000  # 1/s: exact on a 16 MHz AVR
RANGERS = 10
PAYLOAD_MAX = 56
_HEAD, _CRC = 3, 4
BODY_MAX = _HEAD + PAYLOAD_MAX + _CRC
ENCODED_MAX = BODY_MAX + 1


class Layout(NamedTuple):
    """The wire format of a message: a code of `struct` and the value of one step, per field."""

    kind: int
    message: type[Any]
    codes: str
    steps: tuple[float, ...]


LAYOUTS: list[Layout] = []
MessageClass = TypeVar("MessageClass", bound=type[Any])


def _layout(kind: int, codes: str, **steps: float) -> Callable[[MessageClass], MessageClass]:
    """Declare the wire format of a message; fields without a step have 1."""

    def declare(message: MessageClass) -> MessageClass:
        wire_steps = tuple(steps.get(name, 1.0) for name in message._fields)
        LAYOUTS.append(Layout(kind, message, "<" + codes, wire_steps))
        return message

    return declare


@_layout(0x01, "hhB", v=1e-4, w=1e-4)
class Command(NamedTuple):
    """Host to drive board: the target twist; it also shows that the host works."""

    v: float  # m/s
    w: float  # rad/s
    flags: int = 0  # CommandFlag


@_layout(0x02, "H")
class Rearm(NamedTuple):
    """Host to drive board: a person has removed the causes of these faults."""

    faults: int  # Fault


@_layout(0x03, "B")
class Get(NamedTuple):
    """Host to board: request a parameter."""

    number: int


@_layout(0x04, "Bf")
class Set(NamedTuple):
    """Host to board: change a parameter; only at rest."""

    number: int
    value: float


@_layout(0x05, "")
class Save(NamedTuple):
    """Host to board: save all parameters in EEPROM."""


@_layout(0x06, "")
class Identify(NamedTuple):
    """Host to board: request an Identity."""


@_layout(
    0x81,
    "IiihhhhhhHBHBBBHB",
    **dict.fromkeys(("stamp", "battery", "age"), 1e-3),
    **dict.fromkeys(("speed_left", "speed_right", "v", "w", "duty_left", "duty_right"), 1e-4),
)
class Odometry(NamedTuple):
    """Drive board to host, 50 Hz."""

    stamp: float  # s since the board's reset
    left: int  # encoder counts
    right: int
    speed_left: float  # m/s, low-passed, at the rims
    speed_right: float
    v: float  # m/s: the set point, after limits
    w: float  # rad/s
    duty_left: float
    duty_right: float
    battery: float  # V
    mode: int  # Mode
    faults: int  # Fault
    switches: int  # Switch, any since the last odometry
    echo: int  # sequence of the last command accepted
    age: float  # s, of that command; 0.255 or more reads 0.255
    bad: int  # frames refused since reset
    lost: int  # bytes and frames dropped for lack of buffer space


class Range(NamedTuple):
    """One ultrasonic's last firing."""

    range: float  # m
    age: float  # s since it fired; 65.535 or more, or never, reads 65.535
    status: int  # RangeStatus


@_layout(0x82, "IH" + RANGERS * "HHB", stamp=1e-3)
class Ranges(NamedTuple):
    """Range board to host, after each firing."""

    stamp: float  # s since the board's reset
    bad: int
    ranges: tuple[Range, ...]  # RANGERS, in the order of mounting


@_layout(0x83, "BBfff")
class Parameter(NamedTuple):
    """Board to host: the answer to Get and Set."""

    number: int
    status: int  # Status
    value: float
    low: float
    high: float


@_layout(0x84, "BBB")
class Answer(NamedTuple):
    """Board to host: the answer to Rearm and Save, and to unknown messages."""

    kind: int
    sequence: int
    status: int  # Status


@_layout(0x85, "BBBB")
class Identity(NamedTuple):
    """Board to host: the answer to Identify; sent once after a reset, too."""

    board: int  # Board
    parameters: int
    cause: int  # of the reset: MCUSR; 1 power, 2 reset pin, 4 brown-out, 8 watchdog timer
    stored: int  # 1: EEPROM holds parameters that a host has saved


@_layout(0x86, "hhBB", forward=1e-4, left=1e-4, age=1e-3)
class Joystick(NamedTuple):
    """Drive board to host, after each Odometry, once its joystick's receiver was heard."""

    forward: float  # deflection past the dead zone, -1 to 1
    left: float
    flags: int  # JoystickFlag
    age: float  # s, of its last frame; 0.255 or more reads 0.255


class Unknown(NamedTuple):
    """A valid frame of an unknown kind or size."""

    kind: int
    payload: bytes


Message = tuple[Any, ...]  # one of these

_BY_KIND = {layout.kind: layout for layout in LAYOUTS}
_BY_TYPE = {layout.message: layout for layout in LAYOUTS}
_RANGE_STEPS = (1e-3, 1e-3, 1.0)
_FLOAT_MAX = 3.4028234663852886e38  # of a float of 32 bits


def _to_wire(value: float, step: float, code: str, where: str) -> float:
    if code == "f":
        if math.isfinite(value) and abs(value) > _FLOAT_MAX:
            raise ValueError(f"{where} is {value}; it must be at most {_FLOAT_MAX:.3g}")
        return float(value)
    if not math.isfinite(value):
        raise ValueError(f"{where} is {value}; expected a finite number")
    number = round(value / step)
    bits = 8 * struct.calcsize("<" + code)
    low, high = (-(1 << bits - 1), (1 << bits - 1) - 1) if code.islower() else (0, (1 << bits) - 1)
    if not low <= number <= high:
        raise ValueError(f"{where} is {value}; it must be {low * step:g} to {high * step:g}")
    return number


def _of_wire(number: float, step: float) -> float:
    return number if step == 1.0 else number * step


def payload_of(message: Message) -> tuple[int, bytes]:
    """Return kind and payload of a message.

    Raises:
        ValueError: a value is not finite or does not fit its field.
    """
    if isinstance(message, Unknown):
        return message.kind, message.payload
    layout = _BY_TYPE[type(message)]
    values: list[Any] = list(message)
    steps, names = list(layout.steps), list(layout.message._fields)
    if isinstance(message, Ranges):
        values[2:] = [value for one in message.ranges for value in one]
        steps[2:], names[2:] = list(_RANGE_STEPS) * RANGERS, list(Range._fields) * RANGERS
    name = layout.message.__name__
    zipped = zip(values, steps, layout.codes[1:], names, strict=True)
    wire = [_to_wire(value, step, code, f"{name}.{field}") for value, step, code, field in zipped]
    return layout.kind, struct.pack(layout.codes, *wire)


def message_of(kind: int, payload: bytes) -> Message:
    """Return the message of a payload; `Unknown` for an unknown kind or size."""
    layout = _BY_KIND.get(kind)
    if layout is None or struct.calcsize(layout.codes) != len(payload):
        return Unknown(kind, payload)
    wire = struct.unpack(layout.codes, payload)
    if layout.message is Ranges:
        rows = [wire[k : k + 3] for k in range(2, len(wire), 3)]
        ranges = tuple(Range._make(map(_of_wire, row, _RANGE_STEPS)) for row in rows)
        return Ranges(_of_wire(wire[0], layout.steps[0]), wire[1], ranges)
    message: Message = layout.message._make(map(_of_wire, wire, layout.steps))
    return message


def cobs_encode(body: bytes) -> bytes:
    """Consistent Overhead Byte Stuffing (Cheshire and Baker, 1999) of less than 254 bytes.

    The closing zero byte is included.
    """
    return b"".join(bytes((len(part) + 1,)) + part for part in body.split(b"\0")) + b"\0"


def cobs_decode(encoded: bytes) -> bytes | None:
    """Return the bytes that were encoded, without the closing zero byte; None if it is not COBS."""
    parts, at, end = [], 0, len(encoded)
    while at < end:
        block = encoded[at]
        if block == 0 or at + block > end:
            return None
        parts.append(encoded[at + 1 : at + block])
        at += block
    return b"\0".join(parts)


def encode(message: Message, sequence: int) -> bytes:
    """Encode a message as a frame.

    Raises:
        ValueError: a value is not finite or does not fit its field.
    """
    kind, payload = payload_of(message)
    body = bytes((VERSION, kind, sequence & 0xFF)) + payload
    return cobs_encode(body + zlib.crc32(body).to_bytes(_CRC, "little"))


class Frame(NamedTuple):
    """A valid frame."""

    sequence: int
    message: Message


class Receiver:
    """Makes frames of a stream of bytes, cut anywhere, and counts invalid ones.

    Attributes:
        bad: frames refused, for their form, checksum or version.
        other: version of the last valid frame if it is another one; None: it is not.
    """

    def __init__(self) -> None:
        self.bad = 0
        self.other: int | None = None
        self._bytes = bytearray()

    def feed(self, data: bytes) -> list[Frame]:
        """Return the frames that these bytes complete."""
        *ends, rest = data.split(b"\0")
        checked = []
        for end in ends:
            self._take(end)
            if self._bytes:
                checked.append(self._check(bytes(self._bytes)))
                self._bytes.clear()
        self._take(rest)
        frames = [frame for frame in checked if frame is not None]
        self.bad += len(checked) - len(frames)
        return frames

    def _take(self, data: bytes) -> None:
        # One byte more than a frame can have shows that it is none.
        self._bytes += data[: ENCODED_MAX + 1 - len(self._bytes)]

    def _check(self, encoded: bytes) -> Frame | None:
        if len(encoded) > ENCODED_MAX:
            return None
        body = cobs_decode(encoded)
        if body is None or len(body) < _HEAD + _CRC:
            return None
        if zlib.crc32(body[:-_CRC]) != int.from_bytes(body[-_CRC:], "little"):
            return None
        self.other = None if body[0] == VERSION else body[0]
        if self.other is not None:
            return None
        return Frame(body[2], message_of(body[1], body[_HEAD:-_CRC]))
