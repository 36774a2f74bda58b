"""Folder of an experiment: its protocol with amendments, and the records of its participants.

A participant's records and recordings are in a folder of their own. The records are a chain of JSON
lines, each with the checksum of the last: a line reaches the disk completely or not at all, and is
never written again. The file is locked while it is open to be written: a participant has one
writer. A deleted participant leaves a tombstone, so that the number is not used again.
"""

import errno
import hashlib
import json
import os
import re
import shutil
import sys
from collections.abc import Iterator
from contextlib import closing, suppress
from pathlib import Path
from typing import IO, Any, Final

from agents.evaluation.provenance import now, write_json
from agents.people.protocol import Protocol
from agents.studio import PageError
from wheelchair_gym.base.files import parse_json, read_bytes, write_error
from wheelchair_gym.base.settings import InputError, dump, load, read, read_json

PROTOCOL, STEPS, TOMBSTONE = "protocol.json", "steps.jsonl", "deleted_{:04d}.json"
DATA, WIDE, ATTEMPTS, DICTIONARY, PAGE = (
    "data.csv", "wide.csv", "attempts.csv", "dictionary.csv", "report.html",
)  # fmt: skip
LARGEST = 9999  # number of a participant
# Texts of a protocol, which an amendment may correct.
_TEXTS: Final = re.compile(r"title|consent|.*\.text|questionnaires\..*\.(statements\.\d+|low|high)")


def current_protocol(folder: Path) -> Protocol:
    """Read the protocol of a folder, with the texts of its latest amendment.

    Raises:
        InputError: it is no folder of an experiment, or a file in it is damaged.
    """
    if not (folder / PROTOCOL).exists():
        raise InputError(f"{folder}: no folder of an experiment; expected {PROTOCOL} in it")
    amendments = sorted(folder.glob("amendment_*.json"))
    if not amendments:
        return read(Protocol, folder / PROTOCOL)
    content = read_json(amendments[-1])
    if not isinstance(content, dict) or "protocol" not in content:
        raise InputError(f"{amendments[-1]}: expected at, changed and protocol")
    return load(Protocol, content["protocol"], amendments[-1].name)


def claim(folder: Path, protocol: Protocol) -> str:
    """Write the protocol to its folder, or an amendment of its texts; return its SHA-256 checksum.

    Raises:
        InputError: the folder belongs to another experiment.
    """
    if not (folder / PROTOCOL).exists():
        write_json(folder / PROTOCOL, dump(protocol))
    elif (before := current_protocol(folder)) != protocol:
        changed = list(_changes(dump(before), dump(protocol)))
        for key in changed:
            if not _TEXTS.fullmatch(key):
                raise InputError(
                    f"{folder} holds data of another protocol: {key} differs, and only texts can "
                    "be amended; expected another folder (--out)"
                )
        number = len(list(folder.glob("amendment_*.json"))) + 1
        content = {"at": now(), "changed": changed, "protocol": dump(protocol)}
        write_json(folder / f"amendment_{number:03d}.json", content)
    return hashlib.sha256(json.dumps(dump(protocol), sort_keys=True).encode()).hexdigest()


def _changes(before: Any, after: Any, name: str = "") -> Iterator[str]:
    """Yield the names of the values that differ; lists of other lengths differ as a whole."""
    if isinstance(before, list | tuple) and isinstance(after, list | tuple):
        before, after = dict(enumerate(before)), dict(enumerate(after))
    if isinstance(before, dict) and isinstance(after, dict) and set(before) == set(after):
        for key, value in before.items():
            yield from _changes(value, after[key], f"{name}.{key}" if name else str(key))
    elif before != after:
        yield name


def folder_of(folder: Path, participant: int) -> Path:
    """Return the folder of a participant.

    Raises:
        InputError: the number is none, or was deleted.
    """
    if not 1 <= participant <= LARGEST:
        raise InputError(f"participant {participant}: expected a number from 1 to {LARGEST}")
    if (folder / TOMBSTONE.format(participant)).exists():
        raise PageError("deleted", number=participant)
    return folder / f"participant_{participant:04d}"


def delete(folder: Path, participant: int) -> int:
    """Delete everything of a participant, leave a tombstone, and return the number of files.

    Tables and reports of the folder hold the participant's figures, so they are deleted, too.

    Raises:
        InputError: there is nothing of the participant, it is behind a link, or their session is
            open.
    """
    current_protocol(folder)
    tombstone = folder / TOMBSTONE.format(participant)
    own = folder / f"participant_{participant:04d}"
    if links := [path for path in (own, *own.rglob("*")) if path.is_symlink()]:
        raise InputError(f"{links[0]} is a link; expected the data themselves in its place")
    files = [path for path in own.rglob("*") if not path.is_dir()]
    if not any(path.stat().st_size for path in files):
        raise InputError(f"{folder} holds nothing of participant {participant}")
    exports = [folder / name for name in (DATA, WIDE, ATTEMPTS, PAGE)]
    files = [*(path for path in exports if path.exists()), *files]  # first: so it can be resumed
    with closing(Chain(own / STEPS)):  # nobody writes, nor after it: a session sees the tombstone
        if not tombstone.exists():  # it was interrupted
            write_json(tombstone, {"participant": participant, "at": now(), "files": len(files)})
    for path in files:
        path.unlink()
    shutil.rmtree(own)
    return len(files)


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
            is_there = os.path.samefile(path, self._file.fileno())
        except OSError:
            is_there = False
        if not is_there:  # another program has it open, or has removed it without records
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

    def close(self, empty: bool = False) -> None:
        """Close the file, and release its lock; one without records is removed with its folder."""
        if empty and not self._file.closed:
            with suppress(OSError):  # Windows keeps a file that is open, and `delete` ignores it
                self.path.unlink()
                self.path.parent.rmdir()
        self._file.close()
