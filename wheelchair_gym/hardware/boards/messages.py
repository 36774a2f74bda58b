"""What host and boards tell each other: messages in SI units, and the names of bits and numbers."""

from __future__ import annotations

import enum
from typing import NamedTuple


class CommandFlag(enum.IntFlag):
    """How a command is to be carried out."""

    PROTECTIVE = 0x01  # brake at the protective rate, exempt from jerk


class Mode(enum.IntEnum):
    """Who drives."""

    STOPPED = 0  # drivers off, brakes on; a person must re-arm
    HOST = 1
    MANUAL = 2  # the joystick at the board
    STOPPING = 3  # on the way to rest, under control
    READY = 4  # drivers off, brakes on; the next command drives


class Fault(enum.IntFlag):
    """What the drive board has latched until a person re-arms it."""

    RESET = 0x0001
    EMERGENCY_STOP = 0x0002
    LINK = 0x0004  # no command for longer than `latch`
    STALL = 0x0008  # a wheel is driven and no counts come: stuck, or blind
    DIRECTION = 0x0010  # a wheel turns against its motor
    ENCODER = 0x0020  # steps that no encoder can make
    OVER_SPEED = 0x0040
    UNDER_VOLTAGE = 0x0080
    DRIVER = 0x0100  # a motor driver reports a fault, Hall sensors among them
    STORE = 0x0200  # EEPROM unreadable: parameters are the defaults, until a host stores them
    RUNAWAY = 0x0400  # a wheel turns faster than its aim, or does not come to rest
    BRAKE = 0x0800  # the closed brakes have slipped repeatedly
    IMPLAUSIBLE = 0x1000  # motor voltage and measured speed do not fit together


class Switch(enum.IntFlag):
    """What is pressed or pulled at the drive board."""

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
    """What came of an ultrasonic firing."""

    ECHO = 0
    NO_ECHO = 1
    SILENT = 2  # the sensor does not answer
    UNTRIED = 3


class Status(enum.IntEnum):
    """A board's answer."""

    DONE = 0
    UNKNOWN = 1
    OUT_OF_RANGE = 2
    MOVING = 3  # only at rest, with the drivers off
    CAUSE_STANDS = 4  # of a fault (STORE: none was stored yet), or the freewheel lever
    NOT_AT_ZERO = 5  # needs a fresh command of zero
    OTHER_FAULTS = 6
    BUSY = 7


class Board(enum.IntEnum):
    """Which board speaks."""

    DRIVE_BOARD = 1
    RANGE_BOARD = 2


class Command(NamedTuple):
    """Host to drive board: the target twist, and a sign of life."""

    v: float  # m/s
    w: float  # rad/s
    flags: int = 0  # CommandFlag


class Rearm(NamedTuple):
    """Host to drive board: a person has seen to these faults."""

    faults: int  # Fault


class Get(NamedTuple):
    """Host to board: tell me a parameter."""

    number: int


class Set(NamedTuple):
    """Host to board: change a parameter; only at rest."""

    number: int
    value: float


class Save(NamedTuple):
    """Host to board: keep all parameters in EEPROM."""


class Identify(NamedTuple):
    """Host to board: who are you?"""


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
    lost: int  # bytes and frames dropped for want of room


class Range(NamedTuple):
    """One ultrasonic's last firing."""

    range: float  # m
    age: float  # s since it fired; 65.535 or more, or never, reads 65.535
    status: int  # RangeStatus


class Ranges(NamedTuple):
    """Range board to host, after each firing."""

    stamp: float  # s since the board's reset
    bad: int
    ranges: tuple[Range, ...]  # eight, in the order of mounting


class Parameter(NamedTuple):
    """Board to host: the answer to Get and Set."""

    number: int
    status: int  # Status
    value: float
    low: float
    high: float


class Answer(NamedTuple):
    """Board to host: the answer to Rearm and Save, and to what it cannot understand."""

    kind: int
    sequence: int
    status: int  # Status


class Identity(NamedTuple):
    """Board to host: the answer to Identify; sent once after a reset, too."""

    board: int  # Board
    parameters: int
    cause: int  # of the reset: MCUSR; 1 power, 2 reset pin, 4 brown-out, 8 watchdog timer
    stored: int  # 1: EEPROM holds parameters that a host has stored


class Unknown(NamedTuple):
    """A good frame of a kind or size that this version does not know."""

    kind: int
    payload: bytes


Message = (
    Command
    | Rearm
    | Get
    | Set
    | Save
    | Identify
    | Odometry
    | Ranges
    | Parameter
    | Answer
    | Identity
    | Unknown
)
