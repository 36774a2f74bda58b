"""A Hokuyo laser at a TCP port or a serial line, which is reopened when it is silent."""

import contextlib
import math
import os
import select
import socket
import time
from collections.abc import Callable
from typing import NamedTuple

from wheelchair_gym.base.errors import load_extra
from wheelchair_gym.base.settings import InputError
from wheelchair_gym.hardware.boards.ports import Port, open_port
from wheelchair_gym.hardware.connection import Reconnecting
from wheelchair_gym.hardware.laser import scip

PORT = 10940  # of TCP
ANSWER_WITHIN = 1.0  # s without an answer or a scan, after which the laser is reopened
_CHUNK = 65536
_TCP = "tcp://"


class TcpPort:
    """A TCP connection as a port: it connects in the background, and never waits.

    The host should be an address: the lookup of a name may take long.

    Raises:
        OSError: the address cannot be resolved, or the connection fails at once.
    """

    def __init__(self, host: str, port: int) -> None:
        family, kind, protocol, _, address = socket.getaddrinfo(
            host, port, type=socket.SOCK_STREAM
        )[0]
        self._socket = socket.socket(family, kind, protocol)
        self._socket.setblocking(False)
        self._unsent = b""
        with contextlib.suppress(BlockingIOError):
            self._socket.connect(address)

    def read_all(self) -> bytes:
        """All bytes that have come, without waiting."""
        readable, writable, _ = select.select([self._socket], [self._socket], [], 0)
        if writable:
            if error := self._socket.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR):
                raise OSError(error, f"connection failed, {os.strerror(error)}")
            self._flush()
        data = self._socket.recv(_CHUNK) if readable else b""
        if readable and not data:
            raise OSError("the connection was closed")
        return data

    def write(self, data: bytes) -> int:
        """Send bytes, as soon as there is room for them."""
        self._unsent += data
        _, writable, _ = select.select([], [self._socket], [], 0)
        if writable:
            self._flush()
        return len(data)

    def close(self) -> None:
        """Close the connection."""
        self._socket.close()

    def _flush(self) -> None:
        if self._unsent:
            with contextlib.suppress(BlockingIOError):
                self._unsent = self._unsent[self._socket.send(self._unsent) :]


def open_laser(url: str) -> Port:
    """Open tcp://HOST[:PORT], or anything that `open_port` opens.

    Raises:
        OSError: it cannot be opened.
        InputError: the URL is malformed.
    """
    if not url.startswith(_TCP):
        return open_port(url)
    host, _, port = url.removeprefix(_TCP).rstrip("/").partition(":")
    if not host or not (port or "0").isdecimal() or int(port or PORT) > 65_535:
        raise InputError(f"{url!r} is no laser; expected tcp://HOST:PORT or a serial device")
    return TcpPort(host, int(port or PORT))


class TimedScan(NamedTuple):
    """A scan, and when it was received."""

    scan: scip.Scan
    stamp: float  # s of the sensor's clock, which does not wrap here
    received_at: float  # s of the host's clock


class Hokuyo(Reconnecting[Port]):
    """A laser that streams scans; a failure is data, not an exception.

    Args:
        url: tcp://HOST:PORT or a serial device.
        reach: ranges beyond it count as no echo [m].
        clock: seconds that never decrease.
        opener: makes the port.

    Attributes:
        specs: the sensor's specification, None until it is known.
        scans: that it has sent since this was made.
        bad: replies refused since then.
        compared: when its clock was asked for [s], and its answer [s]; None: it was not.

    Raises:
        InputError: pyserial is needed, and not installed.
    """

    def __init__(
        self,
        url: str = f"tcp://192.168.0.10:{PORT}",
        reach: float = 10.0,
        clock: Callable[[], float] = time.monotonic,
        opener: Callable[[str], Port] = open_laser,
    ) -> None:
        if opener is open_laser and not url.startswith(_TCP):
            load_extra("serial")
        super().__init__(lambda: opener(url))
        self.url, self.reach = url, reach
        self.specs: scip.Specs | None = None
        self._clock = clock
        self._parser = scip.ScipParser()
        self.scans = self.bad = self._bad_before = 0
        self._asked = ""  # the last request
        self._since = 0.0  # s, of the last request or scan
        self.compared: tuple[float, float] | None = None
        self._compared_at = -math.inf
        self._turns, self._last = 0, 0  # wraps of the sensor's clock, and its last time stamp

    def poll(self) -> list[TimedScan]:
        """The scans that have come; never waits."""
        scans: list[TimedScan] = []
        port = self.get(self._clock())
        try:
            while port is not None and (data := port.read_all()):
                for reply in self._parser.feed(data):
                    self._handle(port, reply, scans)
            if port is not None and self._clock() - self._since > ANSWER_WITHIN:
                self._lose(f"no answer to {self._asked} for {ANSWER_WITHIN:g} s")
        except (OSError, InputError) as error:
            self._lose(str(error))
        self.bad = self._bad_before + self._parser.bad
        return scans

    def compare_clocks(self, after: float) -> None:
        """Ask for its time again, so long [s] after the last answer; scans pause meanwhile."""
        port, now = self.connection, self._clock()
        if port is not None and not self.error and now - self._compared_at > after:
            with contextlib.suppress(OSError):  # the next poll notices
                self._ask(port, "QT")

    def close(self) -> None:
        """Switch the laser off and close it for good."""
        if self.connection is not None:
            with contextlib.suppress(OSError):
                self.connection.write(b"QT\n")
        super().close()

    def _lose(self, why: str) -> None:
        """Close the connection, which has failed for a reason."""
        self.lose(why if self.url in why else f"{self.url}: {why}")

    def _begin(self, port: Port) -> None:
        self._bad_before, self._parser = self.bad, scip.ScipParser()
        self.error = "does not stream yet"
        port.write(b"\n")  # ends what may have been sent in part
        self._ask(port, "SCIP2.0")  # sensors that always use SCIP 2 refuse it

    def _ask(self, port: Port, request: str) -> None:
        self._asked, self._since = request, self._clock()
        port.write(request.encode("ascii") + b"\n")

    def _handle(self, port: Port, reply: scip.Reply, scans: list[TimedScan]) -> None:
        if reply.echo != self._asked:
            return  # to an earlier request, or of a stream that has not stopped yet
        if reply.status == scip.STREAMING:
            self._take(reply, scans)
            return
        command = self._asked[:2]
        if command in ("SC", "QT"):  # old sensors may refuse either
            self._ask(port, "QT" if command == "SC" else "PP")
        elif command == "PP" and reply.status == scip.OK:
            self.specs = scip.specs_of(reply)
            self._ask(port, "TM0")
        elif command == "TM":  # sensors without it refuse it
            self._take_time(reply)
            following = {"TM0": "TM1", "TM1": "TM2"} if reply.status == scip.OK else {}
            self._ask(port, following.get(self._asked, "BM"))
        elif command == "BM" and reply.status in (scip.OK, scip.DONE_ALREADY):
            assert self.specs is not None
            self._ask(port, f"MD{self.specs.first:04d}{self.specs.last:04d}01000")
        elif command == "MD" and reply.status == scip.OK:
            self._since = self._clock()
        elif command == "MD" and reply.status == scip.LASER_OFF:
            self._ask(port, "BM")
        else:
            raise OSError(f"{self._asked} was refused with status {reply.status}")

    def _take_time(self, reply: scip.Reply) -> None:
        """Take the answer to TM1, the sensor's time."""
        stamp = scip.decode_numbers(reply.lines[0], 4) if reply.lines else None
        if self._asked == "TM1" and reply.status == scip.OK and stamp is not None and len(stamp):
            self._compared_at = self._clock()
            self.compared = self._since, self._seconds(int(stamp[0]))

    def _seconds(self, stamp: int) -> float:
        """The sensor's time [s], which does not wrap, of a stamp [ms]."""
        if stamp < self._last - scip.STAMP_WRAP // 2:
            self._turns += 1
        self._last = stamp
        return (self._turns * scip.STAMP_WRAP + stamp) * 1e-3

    def _take(self, reply: scip.Reply, scans: list[TimedScan]) -> None:
        assert self.specs is not None
        scan = scip.scan_of(reply, min(self.reach, self.specs.farthest * 1e-3))
        if scan is None:
            self._parser.bad += 1
            return
        self._since, self.error = self._clock(), ""
        self.scans += 1
        scans.append(TimedScan(scan, self._seconds(scan.stamp), self._since))
