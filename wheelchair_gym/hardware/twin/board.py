"""One emulated board: firmware on simavr, run to exact cycles, with its pins and its EEPROM."""

from __future__ import annotations

import ctypes as c
from collections.abc import Callable, Mapping
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.config import InputError
from wheelchair_gym.hardware.boards.parameters import DRIVE_PARAMETERS, RANGE_PARAMETERS
from wheelchair_gym.hardware.boards.protocol import (
    Answer,
    Identify,
    Identity,
    Message,
    Parameter,
    Receiver,
    Save,
    Set,
    Status,
    encode,
)
from wheelchair_gym.hardware.twin.build import build_target
from wheelchair_gym.types import NotCopyable

FREQUENCY = 16_000_000  # Hz
CRASHED = 5  # simavr's cpu_Crashed

_READ = 4096  # bytes read at once
_SIGNATURES: dict[str, tuple[Any, list[Any]]] = {
    "board_new": (c.c_void_p, [c.c_char_p, c.c_char_p, c.c_uint32, c.c_void_p]),
    "board_free": (None, []),
    "board_run": (c.c_int, [c.c_uint64]),
    "board_cycle": (c.c_uint64, []),
    "board_resets": (c.c_uint32, []),
    "board_overruns": (c.c_uint32, []),
    "board_reset": (None, []),
    "board_hang": (None, []),
    "board_write": (None, [c.c_uint8, c.c_char_p, c.c_uint32]),
    "board_read": (c.c_uint32, [c.c_void_p, c.c_uint32]),
    "board_pin": (None, [c.c_char, c.c_uint8, c.c_uint8]),
    "board_turn": (None, [c.c_char, c.c_uint8, c.c_double, c.c_double, c.c_uint64]),
    "board_voltage": (None, [c.c_uint8, c.c_uint32]),
    "board_peek": (c.c_uint8, [c.c_uint16]),
    "board_eeprom": (None, [c.c_uint16, c.c_void_p, c.c_uint16, c.c_uint8]),
    "board_on_ping": (None, [c.c_void_p]),
    "board_pulse_sonar": (None, [c.c_char, c.c_uint8, c.c_char, c.c_uint8]),
    "board_bus_sonar": (None, [c.c_uint8]),
    "board_watch": (None, [c.c_uint8]),
    "board_waited": (c.c_uint32, [c.c_uint8, c.c_void_p]),
    "board_note": (None, [c.c_char, c.c_uint8]),
    "board_notes": (c.c_uint32, [c.c_void_p, c.c_uint32]),
}
_PING = c.CFUNCTYPE(c.c_int32, c.c_uint8, c.c_uint64)


@cache
def _library() -> c.CDLL:
    library = c.CDLL(str(build_target("libemulator.so")))
    for name, (result, arguments) in _SIGNATURES.items():
        function = getattr(library, name)
        function.restype = result
        function.argtypes = arguments if name == "board_new" else [c.c_void_p, *arguments]
    return library


class EmulatedBoard(NotCopyable):
    """A microcontroller that runs a firmware; time passes only in `run`.

    Args:
        mcu: simavr's name of the chip.
        target: the firmware's target in its Makefile, such as drive.elf.
        bauds: rates of the serial lines 0 and 1 [1/s]; 0 where there is none.

    Raises:
        InputError: the firmware or the emulator cannot be built or loaded.
    """

    def __init__(self, mcu: str, target: str, bauds: tuple[int, int]) -> None:
        self._library = _library()
        rates = (c.c_uint32 * 2)(*bauds)
        elf = str(build_target(target)).encode()
        self._board = self._library.board_new(mcu.encode(), elf, FREQUENCY, rates)
        if not self._board:
            raise InputError(f"{target} cannot be run on an emulated {mcu}")
        self._room = c.create_string_buffer(_READ)
        self._ping: Any = None

    def run(self, cycle: int) -> None:
        """Run until a cycle since power-on; at most one instruction beyond.

        Raises:
            RuntimeError: the firmware crashed, such as by a jump to nowhere.
        """
        if self._library.board_run(self._board, cycle) == CRASHED:
            raise RuntimeError(f"the firmware crashed at cycle {self.cycle}")

    @property
    def cycle(self) -> int:
        """Cycles since power-on."""
        return int(self._library.board_cycle(self._board))

    @property
    def resets(self) -> int:
        """Resets since it was made: by its watchdog timer, or by `reset`."""
        return int(self._library.board_resets(self._board))

    @property
    def overruns(self) -> int:
        """Bytes that a serial line lost, for nobody took them in time."""
        return int(self._library.board_overruns(self._board))

    def reset(self) -> None:
        """Start anew, as after power-off; EEPROM stays."""
        self._library.board_reset(self._board)

    def hang(self) -> None:
        """Let the program run in a circle where it stands, until its watchdog timer resets it."""
        self._library.board_hang(self._board)

    def write(self, data: bytes, line: int = 0) -> None:
        """Put bytes on the wire of a serial line; they arrive at its rate."""
        self._library.board_write(self._board, line, data, len(data))

    def read(self) -> bytes:
        """What the board has said since the last call."""
        parts = []
        while count := self._library.board_read(self._board, self._room, _READ):
            parts.append(self._room.raw[:count])
        return b"".join(parts)

    def set_pin(self, port: str, bit: int, high: bool) -> None:
        """Drive an input pin from outside."""
        self._library.board_pin(self._board, port.encode(), bit, int(high))

    def rotate_encoder(self, port: str, bit: int, start: float, end: float, until: int) -> None:
        """Turn a quadrature encoder on pins (bit, bit + 1) evenly until a cycle [counts]."""
        self._library.board_turn(self._board, port.encode(), bit, start, end, until)

    def set_voltage(self, channel: int, volts: float) -> None:
        """Set the voltage at an analogue input [V]."""
        self._library.board_voltage(self._board, channel, round(volts * 1000.0))

    def read_memory(self, address: int) -> int:
        """A byte of data memory: register or RAM."""
        return int(self._library.board_peek(self._board, address))

    def read_word(self, address: int) -> int:
        """Two bytes of data memory."""
        return self.read_memory(address) | self.read_memory(address + 1) << 8

    def eeprom(self, size: int, offset: int = 0) -> bytes:
        """What EEPROM holds."""
        room = c.create_string_buffer(size)
        self._library.board_eeprom(self._board, offset, room, size, 0)
        return room.raw

    def set_eeprom(self, data: bytes, offset: int = 0) -> None:
        """Change what EEPROM holds."""
        room = c.create_string_buffer(data, len(data))
        self._library.board_eeprom(self._board, offset, room, len(data), 1)

    def on_ping(self, ping: Callable[[int, int], int]) -> None:
        """Ask for the flight of each shot: ping(sonar, cycle) -> us, 0 no echo, -1 silent.

        128 is added to the number of an I2C sonar that is only asked whether it is there.
        """
        self._ping = _PING(ping)
        self._library.board_on_ping(self._board, c.cast(self._ping, c.c_void_p))

    def add_pulse_sonar(self, trigger: tuple[str, int], echo: tuple[str, int]) -> None:
        """Wire the next HC-SR04."""
        ends = (trigger[0].encode(), trigger[1], echo[0].encode(), echo[1])
        self._library.board_pulse_sonar(self._board, *ends)

    def add_bus_sonar(self, address: int) -> None:
        """Wire the next SRF08."""
        self._library.board_bus_sonar(self._board, address)

    def watch_interrupt(self, vector: int) -> None:
        """Measure from now on how long an interrupt waits."""
        self._library.board_watch(self._board, vector)

    def interrupt_latency(self, vector: int) -> tuple[int, int]:
        """The longest wait of a watched interrupt [cycles], and how many were served."""
        count = c.c_uint32()
        return int(self._library.board_waited(self._board, vector, c.byref(count))), count.value

    def watch_pin(self, port: str, bit: int) -> None:
        """Note from now on when a pin changes."""
        self._library.board_note(self._board, port.encode(), bit)

    def pin_changes(self) -> NDArray[np.uint64]:
        """Cycles (n,) of the changes of the noted pin since the last call; the last 4,096."""
        cycles = np.empty(4096, np.uint64)
        count = self._library.board_notes(self._board, cycles.ctypes.data, len(cycles))
        return cycles[:count]

    def close(self) -> None:
        """Let the board go."""
        if self._board:
            self._library.board_free(self._board)
            self._board = None


_BOOT = FREQUENCY // 10  # cycles
_ANSWER = FREQUENCY // 100
_SAVED = FREQUENCY  # a byte of EEPROM each control run of 5 ms, at most 32 parameters of 4
_SIZE = 256  # bytes: more than the largest store
_NAMES = {"drive.elf": DRIVE_PARAMETERS, "range.elf": RANGE_PARAMETERS}


def stored_parameters(
    mcu: str, target: str, bauds: tuple[int, int], wanted: Mapping[str, float]
) -> bytes:
    """What EEPROM holds once a host has written these parameters and stored them.

    Args:
        mcu: see `EmulatedBoard`.
        target: see `EmulatedBoard`.
        bauds: see `EmulatedBoard`.
        wanted: values by name; the others keep the board's own defaults.

    Raises:
        InputError: the board refuses a value.
    """
    return _stored(mcu, target, bauds, tuple(wanted.items()))


@cache
def _stored(
    mcu: str, target: str, bauds: tuple[int, int], wanted: tuple[tuple[str, float], ...]
) -> bytes:
    board = EmulatedBoard(mcu, target, bauds)
    board.run(_BOOT)
    for name, value in wanted:
        told = _asked(board, Set(_NAMES[target].index(name), value), Parameter)
        if not isinstance(told, Parameter) or told.status != Status.DONE:
            raise InputError(f"the board refuses {name} = {value:g}")
    _asked(board, Save(), Answer)
    board.run(board.cycle + _SAVED)
    told = _asked(board, Identify(), Identity)
    if not isinstance(told, Identity) or not told.stored:
        raise InputError("the board does not keep its parameters")
    kept = board.eeprom(_SIZE)
    board.close()
    return kept


def _asked(board: EmulatedBoard, message: Message, kind: type) -> Message | None:
    """The answer to a message."""
    receiver = Receiver()
    board.read()
    board.write(b"\0" + encode(message, 0))
    board.run(board.cycle + _ANSWER)
    heard = [frame.message for frame in receiver.feed(board.read())]
    return next((told for told in heard if isinstance(told, kind)), None)
