"""SCIP 2.2, the protocol of Hokuyo's lasers, for both ends: bytes to replies and scans, and back.

A request is a line; a reply is its echo, a status of two characters with a checksum, data lines of
at most 64 characters with a checksum each, and an empty line (Hokuyo, 'Communication Protocol
Specification for SCIP 2.0 Standard').
"""

import math
import re
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wheelchair_gym.base.arrays import Floats
from wheelchair_gym.base.settings import InputError

DATA_LINE = 64  # characters of data in a line, at most
STAMP_WRAP = 1 << 24  # ms: a time stamp has four characters of six bits
ERRORS_UP_TO = 20  # mm: numbers up to this are error codes
NO_ECHO_FROM = 65533  # mm: what UST sensors report of a beam without an echo
OK, DONE_ALREADY, STREAMING, LASER_OFF = "00", "02", "99", "10"
_REPLY_MAX = 1 << 16  # bytes; 1,081 ranges with intensity take 6,700


def checksum(data: bytes) -> int:
    """The checksum character of a line."""
    return (sum(data) & 0x3F) + 0x30


def encode_numbers(values: ArrayLike, characters: int) -> bytes:
    """Numbers (n,) as characters of six bits, the highest first, one number after another."""
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
    """A complete reply whose checksums agree."""

    echo: str  # the request
    status: str
    lines: tuple[bytes, ...]  # of data, without checksums

    def encode(self) -> bytes:
        """The reply as a sensor sends it."""
        lines = [self.status.encode("ascii"), *self.lines]
        checked = [line + bytes((checksum(line),)) for line in lines]
        return b"\n".join([self.echo.encode("ascii", "replace"), *checked, b"", b""])


class ScipParser:
    """Makes replies of a stream of bytes, cut and joined anywhere.

    Attributes:
        bad: replies refused, for their form or a checksum.
    """

    def __init__(self) -> None:
        self.bad = 0
        self._bytes = b""

    def feed(self, data: bytes) -> list[Reply]:
        """The replies that these bytes complete."""
        *parts, self._bytes = (self._bytes + data).split(b"\n\n")
        if len(self._bytes) > _REPLY_MAX:  # no reply is so long: wait for the next one
            self._bytes, self.bad = b"", self.bad + 1
        checked = [self._check(part.lstrip(b"\n")) for part in parts if part.strip(b"\n")]
        replies = [reply for reply in checked if reply is not None]
        self.bad += len(checked) - len(replies)
        return replies

    @staticmethod
    def _check(data: bytes) -> Reply | None:
        echo, *rest = data.split(b"\n")
        if not rest or not echo.isascii() or not 1 <= len(rest[0]) <= 3:
            return None
        # Old sensors answer SCIP2.0 and QT with a bare status.
        status, checked = rest[0][:2], rest if len(rest[0]) == 3 else rest[1:]
        for line in checked:
            if len(line) < 2 or len(line) > DATA_LINE + 1 or line[-1] != checksum(line[:-1]):
                return None
        if not status.isalnum():
            return None
        lines = tuple(line[:-1] for line in rest[1:])
        return Reply(echo.decode("ascii"), status.decode("ascii"), lines)


class Specs(NamedTuple):
    """A sensor's specification."""

    model: str
    nearest: int  # mm
    farthest: int  # mm
    steps_per_turn: int
    first: int  # step
    last: int
    front: int  # the step straight ahead
    rpm: int

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

    def encode(self) -> tuple[bytes, ...]:
        """The lines of the reply to PP."""
        return tuple(f"{key}:{value};".encode() for key, value in zip(_KEYS, self, strict=True))


_KEYS = ("MODL", "DMIN", "DMAX", "ARES", "AMIN", "AMAX", "AFRT", "SCAN")  # of Specs' fields


def specs_of(reply: Reply) -> Specs:
    """The specification in a reply to PP.

    Raises:
        InputError: an entry is missing or no number.
    """
    pairs = (line.decode("ascii", "replace").rstrip(";").partition(":") for line in reply.lines)
    entries = {key: value for key, _, value in pairs}
    try:
        specs = Specs(entries["MODL"], *(int(entries[key]) for key in _KEYS[1:]))
    except KeyError as error:
        raise InputError(f"laser: its specification lacks {error.args[0]}") from None
    except ValueError as error:
        raise InputError(f"laser: its specification holds no number: {error}") from None
    if not 0 <= specs.first < specs.last or specs.steps_per_turn < 1 or specs.rpm <= 0:
        raise InputError(f"laser: its specification makes no sense: {specs}")
    return specs


class Scan(NamedTuple):
    """One turn of the laser; ranges as in REP-117."""

    stamp: int  # ms, of the sensor's clock, below STAMP_WRAP
    ranges: Floats  # (n,) m: +inf no echo, NaN invalid


def metres(millimetres: NDArray[np.integer], farthest: float) -> Floats:
    """Ranges [m] of a sensor's numbers [mm]: +inf beyond `farthest`, NaN for error codes."""
    ranges = millimetres.astype(np.float32) * np.float32(1e-3)
    ranges[ranges > np.float32(farthest)] = np.inf
    ranges[millimetres <= ERRORS_UP_TO] = np.nan
    return ranges


def scan_steps(request: str) -> tuple[int, int] | None:
    """First and last step of a request for scans of all beams without end; None: it is none."""
    # Clusters of 01 beam, 0 scans left out, and 00 scans: no end.
    found = re.fullmatch(r"MD(?P<first>[0-9]{4})(?P<last>[0-9]{4})01000", request)
    return None if found is None else (int(found["first"]), int(found["last"]))


def encode_scan(
    request: str, millimetres: NDArray[np.integer], first_step: int, stamp: int
) -> bytes:
    """The reply that holds a scan, whose first range is that of a step, made at a stamp [ms]."""
    steps = scan_steps(request)
    assert steps is not None
    data = encode_numbers(millimetres[steps[0] - first_step : steps[1] - first_step + 1], 3)
    lines = [data[k : k + DATA_LINE] for k in range(0, len(data), DATA_LINE)]
    return Reply(request, STREAMING, (encode_numbers([stamp % STAMP_WRAP], 4), *lines)).encode()


def scan_of(reply: Reply, farthest: float) -> Scan | None:
    """The scan of a reply to MD; None if it holds none, or an incomplete one."""
    steps = scan_steps(reply.echo)
    if steps is None or reply.status != STREAMING:
        return None
    if len(reply.lines) < 2 or len(reply.lines[0]) != 4:
        return None
    stamp = decode_numbers(reply.lines[0], 4)
    numbers = decode_numbers(b"".join(reply.lines[1:]), 3)
    if stamp is None or numbers is None or len(numbers) != steps[1] - steps[0] + 1:
        return None
    return Scan(int(stamp[0]), metres(numbers, farthest))
