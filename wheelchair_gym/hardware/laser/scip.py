"""SCIP 2.2, the language of Hokuyo's lasers: pure bytes in, replies and scans out.

A request is a line; a reply is its echo, a status of two characters with a checksum, data lines of
at most 64 characters with a checksum each, and an empty line (Hokuyo, 'Communication Protocol
Specification for SCIP 2.0 Standard').
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.config import InputError

DATA_LINE = 64  # characters of data in a line, at most
STAMP_WRAP = 1 << 24  # ms: a time stamp has four characters of six bits
ERRORS_UP_TO = 20  # mm: what is not longer is an error code
NO_ECHO_FROM = 65533  # mm: UST sensors say so of a beam that nothing answers
OK, DONE_ALREADY, STREAMING, LASER_OFF = "00", "02", "99", "10"
_REPLY_MOST = 1 << 16  # bytes; 1,081 ranges with intensity take 6,700

Floats = NDArray[np.float32]


def checksum(data: bytes) -> int:
    """The checksum character of a line."""
    return (sum(data) & 0x3F) + 0x30


def encode_number(value: int, characters: int) -> bytes:
    """A number as characters of six bits, the highest first."""
    return bytes((value >> 6 * k & 0x3F) + 0x30 for k in reversed(range(characters)))


def encode_numbers(values: NDArray[np.integer], characters: int) -> bytes:
    """Numbers (n,) as characters, one after another."""
    shifts = 6 * np.arange(characters - 1, -1, -1)
    digits = np.asarray(values, np.int64)[:, None] >> shifts & 0x3F  # (n, characters)
    return (digits + 0x30).astype(np.uint8).tobytes()


def decode_numbers(data: bytes, characters: int) -> NDArray[np.int64] | None:
    """The numbers of a run of characters; None if it holds something else."""
    digits = np.frombuffer(data, np.uint8).astype(np.int64) - 0x30
    if len(digits) % characters or (len(digits) and (digits.min() < 0 or digits.max() > 0x3F)):
        return None
    weights = 64 ** np.arange(characters - 1, -1, -1)
    numbers: NDArray[np.int64] = digits.reshape(-1, characters) @ weights
    return numbers


class Reply(NamedTuple):
    """One whole reply whose checksums agree."""

    echo: str  # the request
    status: str
    lines: tuple[bytes, ...]  # of data, without checksums


class ScipParser:
    """Takes bytes as they come, cut and joined anywhere; gives whole replies.

    Attributes:
        bad: replies refused, for want of form or checksum.
    """

    def __init__(self) -> None:
        self.bad = 0
        self._bytes = b""

    def feed(self, data: bytes) -> list[Reply]:
        """The replies that these bytes complete."""
        *wholes, self._bytes = (self._bytes + data).split(b"\n\n")
        if len(self._bytes) > _REPLY_MOST:  # no reply is so long: wait for the next one
            self._bytes, self.bad = b"", self.bad + 1
        replies = []
        for whole in wholes:
            if not whole.strip(b"\n"):
                continue
            reply = self._check(whole.lstrip(b"\n"))
            if reply is None:
                self.bad += 1
            else:
                replies.append(reply)
        return replies

    @staticmethod
    def _check(whole: bytes) -> Reply | None:
        echo, *rest = whole.split(b"\n")
        if not rest or not echo.isascii():
            return None
        if not 1 <= len(rest[0]) <= 3:
            return None
        # Old sensors answer SCIP2.0 and QT with a bare status.
        status, checked = rest[0][:2], rest if len(rest[0]) == 3 else rest[1:]
        for line in checked:
            if len(line) < 2 or len(line) > DATA_LINE + 1 or line[-1] != checksum(line[:-1]):
                return None
        if not status.isalnum():
            return None
        data = tuple(line[:-1] for line in rest[1:])
        return Reply(echo.decode("ascii"), status.decode("ascii"), data)


class Specs(NamedTuple):
    """What a sensor says of itself (PP)."""

    model: str
    nearest: float  # m
    farthest: float  # m
    steps_per_turn: int
    first: int  # step
    last: int
    front: int  # the step that looks ahead
    rate: float  # Hz

    @property
    def beams(self) -> int:
        """Ranges in a scan."""
        return self.last - self.first + 1

    @property
    def angles(self) -> NDArray[np.float64]:
        """Directions (beams,) [rad], counter-clockwise from ahead."""
        steps = np.arange(self.first, self.last + 1, dtype=np.float64) - self.front
        angles: NDArray[np.float64] = steps * (2.0 * math.pi / self.steps_per_turn)
        return angles


def specs_of(reply: Reply) -> Specs:
    """What the reply to PP says.

    Raises:
        InputError: an entry is missing or no number.
    """
    entries = {}
    for line in reply.lines:
        key, _, value = line.decode("ascii", "replace").rstrip(";").partition(":")
        entries[key] = value.rstrip(";")
    try:
        specs = Specs(
            entries["MODL"],
            int(entries["DMIN"]) * 1e-3,
            int(entries["DMAX"]) * 1e-3,
            int(entries["ARES"]),
            int(entries["AMIN"]),
            int(entries["AMAX"]),
            int(entries["AFRT"]),
            int(entries["SCAN"]) / 60.0,
        )
    except KeyError as error:
        raise InputError(f"laser: its specification lacks {error.args[0]}") from None
    except ValueError as error:
        raise InputError(f"laser: its specification holds no number: {error}") from None
    if not 0 <= specs.first < specs.last or specs.steps_per_turn < 1 or specs.rate <= 0.0:
        raise InputError(f"laser: its specification makes no sense: {specs}")
    return specs


class Scan(NamedTuple):
    """One turn of the laser; ranges as REP-117 has them."""

    stamp: int  # ms, of the sensor's clock, below STAMP_WRAP
    first: int  # step of the first range
    ranges: Floats  # (n,) m: +inf no echo, NaN invalid


def metres(millimetres: NDArray[np.integer], farthest: float) -> Floats:
    """Ranges [m] of what a sensor said [mm]: +inf beyond `farthest`, NaN for error codes."""
    ranges = millimetres.astype(np.float32) * np.float32(1e-3)
    ranges[ranges > np.float32(farthest)] = np.inf
    ranges[millimetres <= ERRORS_UP_TO] = np.nan
    return ranges


def scan_of(reply: Reply, farthest: float) -> Scan | None:
    """The scan of a reply to GD, GS, MD or MS; None if it holds none, or one that is not whole."""
    command = reply.echo[:2]
    if command not in ("GD", "GS", "MD", "MS") or reply.status not in (OK, STREAMING):
        return None
    if len(reply.lines) < 2 or len(reply.lines[0]) != 4:
        return None
    characters = 2 if command[1] == "S" else 3
    stamp = decode_numbers(reply.lines[0], 4)
    numbers = decode_numbers(b"".join(reply.lines[1:]), characters)
    fields = reply.echo[2:12]
    if stamp is None or numbers is None or not fields.isdecimal() or len(fields) < 10:
        return None
    first, last, cluster = int(fields[:4]), int(fields[4:8]), max(1, int(fields[8:10]))
    if len(numbers) != (last - first) // cluster + 1:
        return None
    return Scan(int(stamp[0]), first, metres(numbers, farthest))
