"""The chair's state as a table, for the terminal and for programs that watch.

The program that holds the ports sends the table, read-only, over a Unix socket of the same user.
"""

from __future__ import annotations

import contextlib
import json
import math
import os
import socket
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from wheelchair_gym.hardware.boards.protocol import Fault, Mode, Switch

if TYPE_CHECKING:
    from wheelchair_gym.hardware.boards.senses import BoardSensors


def flag_names(flags: Fault | Switch) -> str:
    """What is set, by name."""
    return flags.name or "none"


def status_rows(senses: BoardSensors, now: float) -> list[tuple[str, str]]:
    """What a chair says now, as rows of name and value."""
    ages, rows = senses.ages(now), []
    for name, link in (("drive board", senses.drive), ("range board", senses.range)):
        if link is not None:
            s = link.statistics
            state = (
                link.error
                or link.mismatch
                or f"{s.received} frames, {s.bad} refused, {s.missed} missed"
            )
            rows.append((name, state))
    laser = senses.laser
    rows.append(("laser", laser.error or f"{laser.statistics.scans} scans"))
    rows.append(("ages", "  ".join(f"{name} {1e3 * age:.0f} ms" for name, age in ages.items())))
    if math.isfinite(ages["odometry"]):
        told = senses.odometry
        pose, _ = senses.odometer.at(now)
        rows += [
            ("mode", f"{Mode(told.mode).name}, faults {flag_names(Fault(told.faults))}"),
            ("switches", flag_names(Switch(told.switches))),
            ("set point", f"{told.v:.3f} m/s  {told.w:.3f} rad/s"),
            ("wheels", f"{told.speed_left:.3f}  {told.speed_right:.3f} m/s"),
            ("duties", f"{told.duty_left:.2f}  {told.duty_right:.2f}"),
            ("odometry", f"{pose[0]:.3f} m  {pose[1]:.3f} m  {math.degrees(pose[2]):.1f} deg"),
            ("battery", f"{told.battery:.1f} V"),
        ]
    ranges, sonar, old = senses.ranges(now)
    if np.isfinite(ranges).any():
        nearest = int(np.nanargmin(np.where(np.isfinite(ranges), ranges, np.inf)))
        bearing = math.degrees(senses.sensors.laser.fov * (nearest / (len(ranges) - 1) - 0.5))
        rows.append(("nearest echo", f"{ranges[nearest]:.2f} m at {bearing:.0f} deg"))
    told_sonar = (f"{r:.2f} ({a:.1f} s)" for r, a in zip(sonar, old, strict=True))
    rows.append(("ultrasonics", "  ".join(told_sonar)))
    return rows


Rows = list[tuple[str, str]]

SUPPORTED = hasattr(socket, "AF_UNIX") and hasattr(os, "getuid")  # not on every system
INTERVAL = 0.5  # s between two tables
_PATIENCE = 3.0  # s for a table: its owner has ended, or hangs
_WATCHERS = 8


def socket_path(device: str) -> Path:
    """The Unix socket at which the owner of a device is heard; its folder is this user's own."""
    runtime = os.environ.get("XDG_RUNTIME_DIR") or f"/run/user/{os.getuid()}"
    name = f"wheelchair_gym-{os.getuid()}"
    folder = Path(runtime if os.path.isdir(runtime) else tempfile.gettempdir()) / name
    return folder / (os.path.realpath(device).strip("/").replace("/", "-") + ".sock")


class MonitorServer:
    """Tables for whoever watches; what nobody reads is dropped.

    Args:
        device: that is held; nobody else may hold it.

    Raises:
        OSError: there is no place for the socket.
    """

    def __init__(self, device: str) -> None:
        self.place = socket_path(device)
        self.place.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        if self.place.parent.stat().st_uid != os.getuid():
            raise OSError(f"{self.place.parent} is another user's")
        self.place.unlink(missing_ok=True)  # of an owner that was killed
        self._listener = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        try:
            self._listener.bind(str(self.place))
            self._listener.listen(_WATCHERS)
        except OSError:
            self._listener.close()
            raise
        self._listener.setblocking(False)
        self._watchers: list[socket.socket] = []
        self._last = -INTERVAL

    def publish(self, now: float, rows: Callable[[], Rows]) -> None:
        """Tell all that watch, where it is time [s]; never waits."""
        if now - self._last < INTERVAL:
            return
        self._last = now
        with contextlib.suppress(OSError):
            while len(self._watchers) < _WATCHERS:
                watcher, _ = self._listener.accept()
                watcher.setblocking(False)
                self._watchers.append(watcher)
        if not self._watchers:
            return
        line = json.dumps(rows()).encode() + b"\n"
        for watcher in list(self._watchers):
            try:
                if watcher.send(line) < len(line):
                    raise OSError("it does not read")
            except OSError:
                self._watchers.remove(watcher)
                watcher.close()

    def close(self) -> None:
        """Hang up."""
        for end in (self._listener, *self._watchers):
            end.close()
        with contextlib.suppress(OSError):
            self.place.unlink()


def subscribe(device: str) -> Iterator[Rows] | None:
    """The tables of a device's owner until it ends; None where no owner offers any."""
    if not SUPPORTED:
        return None
    line = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    line.settimeout(_PATIENCE)
    try:
        line.connect(str(socket_path(device)))
    except OSError:
        line.close()
        return None
    return _tables(line)


def _tables(line: socket.socket) -> Iterator[Rows]:
    with line, line.makefile("rb") as stream, contextlib.suppress(OSError, ValueError):
        for text in stream:
            yield [(str(name), str(value)) for name, value in json.loads(text)]
