"""The firmware's pure part as a native library."""

import ctypes as c
from pathlib import Path

from wheelchair_gym.hardware.boards.protocol import Receiver, encode


class Native:
    """Functions of native.c; bytes in, bytes out."""

    def __init__(self, path: Path) -> None:
        self.library = lib = c.CDLL(str(path))
        for name in ("receiver_new", "drive_new", "ranging_new", "receiver_body"):
            getattr(lib, name).restype = c.c_void_p
        for name in ("table_name", "table_text"):
            getattr(lib, name).restype = c.c_char_p
        lib.drive_run.argtypes = [c.c_void_p, c.c_uint32, c.c_uint16, c.c_int32, c.c_int32]
        lib.drive_run.argtypes += [c.c_uint8, c.c_uint8, c.c_float, c.c_void_p, c.c_void_p]
        lib.drive_restore.restype = c.c_bool

    def tables(self):
        """The tables of protocol.h: name -> (kind, rows of words)."""
        index, tables = 0, {}
        while name := self.library.table_name(index):
            rows = [row.split(" ") for row in self.library.table_text(index).decode().splitlines()]
            tables[name.decode()] = self.library.table_kind(index), rows
            index += 1
        return tables

    def frame(self, kind: int, sequence: int, payload: bytes) -> bytes:
        out = c.create_string_buffer(256)
        size = self.library.frame_of(kind, sequence, payload, len(payload), out)
        return out.raw[:size]


class Part:
    """A part of the firmware; `NEW` is the function that makes one."""

    now = 0  # ms

    def __init__(self, native: Native) -> None:
        self.library = native.library
        self.pointer = c.c_void_p(getattr(self.library, self.NEW)())

    def told(self, say):
        """The message that a function of the firmware says now."""
        out = c.create_string_buffer(256)
        size = say(self.pointer, self.now, out)
        (frame,) = Receiver().feed(out.raw[:size])
        return frame.message

    def __del__(self) -> None:
        self.library.free_it(self.pointer)


class NativeReceiver(Part):
    NEW = "receiver_new"

    def feed(self, data: bytes) -> list[bytes]:
        out = c.create_string_buffer(2 * len(data) + 1)
        size = self.library.receive_all(self.pointer, data, len(data), out)
        bodies, at = [], 0
        while at < size:
            end = at + 1 + out.raw[at]
            bodies.append(out.raw[at + 1 : end])
            at = end
        return bodies

    @property
    def bad(self) -> int:
        return self.library.receiver_bad(self.pointer)


class NativeDrive(Part):
    """The drive board's mind, without a board: time, counts and switches are given."""

    NEW = "drive_new"

    def __init__(self, native: Native) -> None:
        super().__init__(native)
        self.inbox = NativeReceiver(native)
        self.counts, self.illegal = [0, 0], 0
        self.switches, self.battery = 0, 38.0
        self.duty, self.enable, self.release = (0.0, 0.0), False, False
        self._receiver, self._sequence = Receiver(), 0

    def send(self, message) -> list:
        self._sequence += 1
        data, out = encode(message, self._sequence), c.create_string_buffer(4096)
        inbox = self.inbox.pointer
        size = self.library.drive_hear(self.pointer, inbox, data, len(data), self.now, out)
        return [frame.message for frame in self._receiver.feed(out.raw[:size])]

    def step(self, period: int = 5) -> None:
        """Run the control once, `period` milliseconds after the last run."""
        self.now += period
        duty, pins = (c.c_float * 2)(), c.c_uint8()
        given = self.now, 1000 * period, *self.counts, self.illegal & 0xFF, self.switches
        self.library.drive_run(self.pointer, *given, self.battery, duty, c.byref(pins))
        self.duty = tuple(duty)
        self.enable, self.release = bool(pins.value & 1), bool(pins.value & 2)

    def odometry(self):
        return self.told(self.library.drive_say)

    def joystick(self):
        return self.told(self.library.drive_say_joystick)

    def stick(self, data: bytes) -> None:
        self.library.drive_stick(self.pointer, data, len(data), self.now)
