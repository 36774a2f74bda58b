"""The file of a recording: it never replaces another, and a full disk leaves it whole."""

from __future__ import annotations

import itertools
import os
import struct
from pathlib import Path

from wheelchair_gym.files import refused

_MAGIC = b"\x89MCAP0\r\n"
_HEAD = struct.Struct("<BQ")  # of a record: opcode, length
_DATA_END = 0x0F
# Ends a file without a summary: DataEnd and Footer of zeros (https://mcap.dev/spec).
_TAIL = _HEAD.pack(_DATA_END, 4) + bytes(4) + _HEAD.pack(0x02, 20) + bytes(20) + _MAGIC


class McapFile:
    """What a writer of MCAP writes to, from begin to end.

    After each record the file is ended, and the next one takes that end's place: a program that is
    killed leaves a whole file. Where the disk is full, or gone, what was written so far is made a
    whole file, and what comes later is dropped: `write` never fails.

    Args:
        path: of the file; where it exists a number is added to its name.

    Attributes:
        path: of the file that is written.
        error: why nothing is written any longer; empty: all is.

    Raises:
        InputError: it cannot be made.
    """

    def __init__(self, path: str | Path) -> None:
        first, self.error = Path(path), ""
        try:
            first.parent.mkdir(parents=True, exist_ok=True)
            if first.exists() and not first.is_file():
                raise IsADirectoryError(0, "it is no regular file")
            for k in itertools.count():
                self.path = first.with_stem(f"{first.stem}-{k}") if k else first
                try:
                    self._file = self.path.open("xb+", buffering=0)
                    break
                except FileExistsError:
                    continue
        except OSError as error:
            raise refused(first, error) from None
        self._at = 0
        self._left, self._head = len(_MAGIC), b""  # bytes of the record that is written
        self._ending = False

    def write(self, data: bytes | bytearray) -> int:
        """Take all of the data."""
        self._at += len(data)
        if self.error:
            return len(data)
        try:
            self._put(data)
            if self._whole(bytes(data)):
                self._put(_TAIL)
                self._file.seek(self._at)
        except OSError as error:
            self.error = error.strerror or str(error)
            self._mend()
        return len(data)

    def _put(self, data: bytes | bytearray) -> None:
        left = memoryview(data)
        while left:
            left = left[self._file.write(left) :]

    def _whole(self, data: bytes) -> bool:
        """Whether a record ends with this data, and more are to come."""
        while data:
            skipped = min(self._left, len(data))
            self._left, data = self._left - skipped, data[skipped:]
            if not self._left and data:
                taken = _HEAD.size - len(self._head)
                self._head, data = self._head + data[:taken], data[taken:]
                if len(self._head) == _HEAD.size:
                    opcode, self._left = _HEAD.unpack(self._head)
                    self._head, self._ending = b"", self._ending or opcode == _DATA_END
        return not (self._left or self._head or self._ending)

    def seek(self, offset: int, whence: int = 0) -> int:
        """Where it is: a writer that does not go back asks for no other place.

        Raises:
            OSError: it does go back.
        """
        if (offset, whence) not in ((0, os.SEEK_CUR), (self._at, os.SEEK_SET)):
            raise OSError("a recording is written from begin to end")
        return self._at

    def flush(self) -> None:
        """Nothing is held back."""

    def close(self) -> None:
        """No more is written."""
        self._file.close()

    def _mend(self) -> None:
        """End the file after its last whole record; without room for that, after an earlier one."""
        ends = self._ends()
        while ends:
            end = ends.pop()
            try:
                self._file.truncate(end)
                self._file.seek(end)
                if self._file.write(_TAIL) == len(_TAIL):
                    return
            except OSError:
                continue

    def _ends(self) -> list[int]:
        """Where whole records of data end, in their order."""
        size, at = self._file.seek(0, os.SEEK_END), len(_MAGIC)
        ends = []
        while at + _HEAD.size <= size:
            self._file.seek(at)
            opcode, length = _HEAD.unpack(self._file.read(_HEAD.size))
            at += _HEAD.size + length
            if opcode == _DATA_END or at > size:
                break
            ends.append(at)
        return ends
