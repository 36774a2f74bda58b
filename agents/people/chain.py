"""Checksum chain of one participant's records: JSON lines, each with the checksum of the last.

A line reaches the disk completely or not at all, and is never written again. The file is locked
while it is open to be written: a participant has one writer.
"""

from __future__ import annotations

import errno
import hashlib
import json
import os
import sys
from contextlib import suppress
from pathlib import Path
from typing import IO, Any

from agents.evaluation.provenance import now
from agents.studio import PageError
from wheelchair_gym.base.files import parse_json, read_bytes, write_error
from wheelchair_gym.base.settings import InputError

if sys.platform == "win32":
    import msvcrt

    def _lock(file: IO[bytes]) -> None:
        file.seek(2**30)  # beyond what is read and written
        msvcrt.locking(file.fileno(), msvcrt.LK_NBLCK, 1)

else:
    import fcntl

    def _lock(file: IO[bytes]) -> None:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)


Record = dict[str, Any]
_FIRST = 64 * "0"  # checksum before the first line


def _checksum(previous: str, record: Record) -> str:
    text = json.dumps([previous, record], sort_keys=True, allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()


def read_chain(path: Path) -> tuple[list[Record], str, bytes]:
    """Read the records of a chain, the checksum of its last line, and a line that was cut short.

    Raises:
        InputError: the file cannot be read, or a line is damaged or was edited.
    """
    *lines, cut = read_bytes(path, "line").split(b"\n")
    records, last = [], _FIRST
    for number, line in enumerate(lines, 1):
        try:
            stored = parse_json(line, path)
            if stored["previous"] != last or not isinstance(stored["record"]["kind"], str):
                raise ValueError
            if stored["sha256"] != _checksum(last, stored["record"]):
                raise ValueError
        except (InputError, KeyError, TypeError, ValueError):
            raise InputError(
                f"{path}: line {number} is damaged or was edited; expected it as it was written, "
                "from a copy"
            ) from None
        records.append(stored["record"])
        last = stored["sha256"]
    return records, last, cut


class Chain:
    """A chain that is open to append records, locked; it and its folder are made where absent.

    Raises:
        InputError: it is open elsewhere, or cannot be written.
    """

    def __init__(self, path: Path) -> None:
        self.path, self._last = path, _FIRST
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._file = path.open("a+b", buffering=0)
        except OSError as error:
            raise write_error(path, error) from None
        try:
            _lock(self._file)
        except OSError:
            self.close()
            number = path.parent.name[-4:].lstrip("0")
            raise PageError("open_elsewhere", number=number) from None

    def read(self) -> list[Record]:
        """Return all records; a line that was cut short becomes a record with its text.

        Raises:
            InputError: see `read_chain`.
        """
        records, self._last, cut = read_chain(self.path)
        if cut:  # the power failed in mid-line: nobody was told that it is stored
            self._file.truncate(self.path.stat().st_size - len(cut))
            records.append(self.append("cut_line", text=cut.decode("utf-8", "replace")))
        return records

    def append(self, kind: str, /, **content: Any) -> Record:
        """Append a record of a kind, with the time (UTC), and return it once it is on the disk.

        Raises:
            InputError: it cannot be written; the chain is then as before.
        """
        record = {**content, "kind": kind, "at": now()}
        checksum = _checksum(self._last, record)
        line = json.dumps({"previous": self._last, "record": record, "sha256": checksum})
        size = self._file.seek(0, os.SEEK_END)
        try:
            if self._file.write(line.encode() + b"\n") <= len(line):  # ASCII
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            os.fsync(self._file.fileno())
        except OSError as error:
            with suppress(OSError):
                self._file.truncate(size)
            raise write_error(self.path, error) from None
        self._last = checksum
        return record

    def close(self) -> None:
        """Close the file, and release its lock."""
        self._file.close()
