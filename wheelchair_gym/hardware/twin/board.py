"""An emulated board: firmware built from source, and run on simavr to exact cycles; its cable.

No time passes in a cable: the owner of the twin runs it.
"""

from __future__ import annotations

import hashlib
import os
import re
import shutil
import subprocess
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import cffi
import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.base.settings import InputError
from wheelchair_gym.hardware.boards import protocol
from wheelchair_gym.hardware.boards.parameters import NAMES
from wheelchair_gym.types import NotCopyable

FIRMWARE = Path(__file__).resolve().parents[1] / "firmware"
_SIMAVR = Path("/usr/include/simavr/sim_avr.h")
# What each target needs to be built.
_NEEDS = {
    "drive.elf": ("make", "avr-gcc"),
    "range.elf": ("make", "avr-gcc"),
    "libemulator.so": ("make", "cc", "simavr"),
    "libfirmware.so": ("make", "cc"),
    "fuzz": ("make", "cc"),
}
TARGETS = ("libemulator.so", "drive.elf", "range.elf")  # of a twin


@cache
def _folder() -> Path:
    """Return the folder in which these sources are built: each state of the sources has its own."""
    folders = FIRMWARE, Path(__file__).resolve().parent
    files = sorted(path for folder in folders for path in folder.glob("*.[ch]"))
    content = b"\0".join(path.read_bytes() for path in [*files, FIRMWARE / "Makefile"])
    digest = hashlib.sha256(content).hexdigest()[:16]
    cache_home = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return cache_home / "wheelchair_gym" / f"firmware-{digest}"


def missing_tools(target: str) -> list[str]:
    """Tools that a target needs and that are not installed; none where it is built already."""
    if (_folder() / target).exists():
        return []
    there = {"simavr": _SIMAVR.exists()}
    return [need for need in _NEEDS[target] if not there.get(need, shutil.which(need))]


@cache
def build_target(target: str) -> Path:
    """The path of a target of the firmware's Makefile, built if need be.

    Raises:
        InputError: a compiler or the emulator's library is missing, or the build failed.
    """
    path = _folder() / target
    if path.exists():
        return path
    if lacks := missing_tools(target):
        raise InputError(f"{target} needs {' and '.join(lacks)}: run `make emulator`")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(
            f"{path.parent}: cannot be made ({error.strerror}); XDG_CACHE_HOME names another place"
        ) from None
    # Other processes may build the same target: each builds in a folder of its own, then moves it.
    with tempfile.TemporaryDirectory(dir=path.parent) as aside:
        command = ["make", "-s", "-C", str(FIRMWARE), f"BUILD={aside}", f"{aside}/{target}"]
        made = subprocess.run(command, capture_output=True, text=True, check=False)
        if made.returncode:
            lines = made.stderr.strip().splitlines()
            raise InputError(f"{target} was not built: {lines[0] if lines else made.returncode}")
        os.replace(Path(aside) / target, path)
    return path


FREQUENCY = 16_000_000  # Hz
CRASHED = 5  # simavr's cpu_Crashed

_READ = 4096  # bytes read at once


@cache
def _library() -> tuple[Any, Any]:
    """Return cffi's interface and the emulator's functions, as its source declares them."""
    ffi, source = cffi.FFI(), Path(__file__).with_name("emulator.c").read_text("utf-8")
    functions = re.findall(r"^EXPORT ([^{]*?)\s*\{", source, re.M)
    ffi.cdef(";\n".join(["typedef struct board board_t", *functions, ""]))
    return ffi, ffi.dlopen(str(build_target("libemulator.so")))


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
        self._ffi, self._library = _library()
        elf = str(build_target(target)).encode()
        self._board = self._library.board_new(mcu.encode(), elf, FREQUENCY, bauds)
        if not self._board:
            raise InputError(f"{target} cannot be run on an emulated {mcu}")
        self._buffer = self._ffi.new("uint8_t[]", _READ)
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

    def reset(self) -> None:
        """Restart, as after power-off; the EEPROM keeps its content."""
        self._library.board_reset(self._board)

    def hang(self) -> None:
        """Hang the program until its watchdog timer resets it."""
        self._library.board_hang(self._board)

    def write(self, data: bytes, line: int = 0) -> None:
        """Send bytes over a serial line; they arrive at its rate."""
        self._library.board_write(self._board, line, data, len(data))

    def read(self) -> bytes:
        """The bytes that the board has sent since the last call."""
        parts = []
        while count := self._library.board_read(self._board, self._buffer, _READ):
            parts.append(bytes(self._ffi.buffer(self._buffer, count)))
        return b"".join(parts)

    def set_pin(self, port: str, bit: int, high: bool) -> None:
        """Drive an input pin from outside."""
        self._library.board_pin(self._board, port.encode(), bit, int(high))

    def rotate_encoder(self, port: str, bit: int, start: float, end: float, until: int) -> None:
        """Turn a quadrature encoder on pins (bit, bit + 1) evenly until a cycle [counts]."""
        self._library.board_turn(self._board, port.encode(), bit, start, end, until)

    def read_memory(self, address: int) -> int:
        """A byte of data memory: register or RAM."""
        return int(self._library.board_peek(self._board, address))

    def read_word(self, address: int) -> int:
        """Two bytes of data memory."""
        return self.read_memory(address) | self.read_memory(address + 1) << 8

    def eeprom(self, size: int) -> bytes:
        """The content of the EEPROM."""
        content = self._ffi.new("uint8_t[]", size)
        self._library.board_eeprom(self._board, 0, content, size, 0)
        return bytes(self._ffi.buffer(content))

    def set_eeprom(self, data: bytes) -> None:
        """Change the content of the EEPROM."""
        self._library.board_eeprom(self._board, 0, data, len(data), 1)

    def on_ping(self, ping: Callable[[int, int], int]) -> None:
        """Set the source of echoes: ping(sonar, cycle) -> flight [us], 0 no echo, -1 silent.

        128 is added to the number of an I2C sonar that is only asked whether it is there.
        """
        self._ping = self._ffi.callback("int32_t(uint8_t, uint64_t)", ping)
        self._library.board_on_ping(self._board, self._ping)

    def call(self, name: str, *arguments: Any) -> Any:
        """Call another function of emulator.c on this board: `board_overruns` as "overruns".

        Some measure: bytes that a line lost, how long an interrupt waits, when a pin changes.
        Others set the voltage at an analogue input [mV], or wire the next HC-SR04 or SRF08.
        """
        return getattr(self._library, f"board_{name}")(self._board, *arguments)

    def pin_changes(self) -> NDArray[np.uint64]:
        """Cycles (n,) of the changes of the watched pin since the last call; the last 4,096."""
        cycles = np.empty(4096, np.uint64)
        room = self._ffi.from_buffer("uint64_t[]", cycles)
        count = self._library.board_notes(self._board, room, len(cycles))
        return cycles[:count]

    def close(self) -> None:
        """Free the board."""
        if self._board:
            self._library.board_free(self._board)
            self._board = None


@dataclass
class LineNoise:
    """Errors of a cable, in both directions."""

    corrupt: float = 0.0  # share of bytes replaced by random ones
    flip: float = 0.0  # share of bytes with one bit wrong
    drop: float = 0.0  # share of bytes that are lost
    burst: float = 0.0  # share of bytes at which 20 random ones begin


_BURST = 20


@dataclass
class SerialCable:
    """One board's cable, and the port at the host's end; bytes pass when the host reads and writes.

    Attributes:
        board: at the other end.
        rng: of the errors.
        noise: errors of the bytes.
        plugged: false: both ends receive nothing, and the host gets an error.
        resets_on_open: the board is reset when a host opens the port, as an Arduino is.
        log: bytes that the board has sent, without errors, while it is a list.
    """

    board: EmulatedBoard
    rng: np.random.Generator
    noise: LineNoise = field(default_factory=LineNoise)
    plugged: bool = True
    resets_on_open: bool = False
    log: list[bytes] | None = None

    def open(self) -> SerialCable:
        """The port that a host opens.

        Raises:
            OSError: the cable is unplugged.
        """
        self._check()
        if self.resets_on_open:
            self.board.reset()
        return self

    def write(self, data: bytes) -> int:
        """Send bytes from the host to the board."""
        self._check()
        self.board.write(self._with_noise(data))
        return len(data)

    def receive(self) -> bytes:
        """All bytes that the board has sent; none where the cable is unplugged."""
        data = self.board.read()
        if self.log is not None:
            self.log.append(data)
        return self._with_noise(data) if self.plugged else b""

    def read_all(self) -> bytes:
        """All bytes that the board has sent, for the host."""
        self._check()
        return self.receive()

    def close(self) -> None:
        """Close the port; the cable stays."""

    def _check(self) -> None:
        if not self.plugged:
            raise OSError("the board is unplugged")

    def _with_noise(self, data: bytes) -> bytes:
        noise = self.noise
        if not data or not (noise.corrupt or noise.flip or noise.drop or noise.burst):
            return data
        rng, n = self.rng, len(data)
        out = np.frombuffer(data, np.uint8).copy()
        changed = rng.random(n) < noise.corrupt
        for start in np.flatnonzero(rng.random(n) < noise.burst):
            changed[start : start + _BURST] = True
        out[changed] = rng.integers(0, 256, int(changed.sum()))
        flipped = rng.random(n) < noise.flip
        out[flipped] ^= np.uint8(1) << rng.integers(0, 8, int(flipped.sum()), dtype=np.uint8)
        return out[rng.random(n) >= noise.drop].tobytes()


_BOOT = FREQUENCY // 10  # cycles
_ANSWER = FREQUENCY // 100
_SAVED = FREQUENCY  # a byte of EEPROM each control run of 5 ms, at most 33 parameters of 4
_SIZE = 256  # bytes: more than the largest store


@cache
def stored_parameters(
    mcu: str, target: str, bauds: tuple[int, int], wanted: tuple[tuple[str, float], ...]
) -> bytes:
    """The EEPROM's content after a host has set parameters (name, value) and saved them.

    The board is that of `EmulatedBoard`; its other parameters keep their defaults.

    Raises:
        InputError: the board refuses a value.
    """
    board, names = EmulatedBoard(mcu, target, bauds), NAMES[target.removesuffix(".elf")]
    board.run(_BOOT)
    for name, value in wanted:
        answer = _request(board, protocol.Set(names.index(name), value), protocol.Parameter)
        if answer is None or answer.status != protocol.Status.DONE:
            raise InputError(f"the board refuses {name} = {value:g}")
    _request(board, protocol.Save(), protocol.Answer)
    board.run(board.cycle + _SAVED)
    identity = _request(board, protocol.Identify(), protocol.Identity)
    if identity is None or not identity.stored:
        raise InputError("the board does not keep its parameters")
    content = board.eeprom(_SIZE)
    board.close()
    return content


def _request(board: EmulatedBoard, message: protocol.Message, kind: type) -> Any:
    """The answer of a kind to a message, or None."""
    receiver = protocol.Receiver()
    board.read()
    board.write(b"\0" + protocol.encode(message, 0))
    board.run(board.cycle + _ANSWER)
    messages = [frame.message for frame in receiver.feed(board.read())]
    return next((answer for answer in messages if isinstance(answer, kind)), None)
