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
    """The names of the flags that are set."""
    return flags.name or "none"


def status_rows(senses: BoardSensors, now: float) -> list[tuple[str, str]]:
    """The chair's present state, as rows of name and value."""
    ages, rows = senses.ages(now), []
    for name, link in (("drive board", senses.drive), ("range board", senses.range)):
        if link is not None:
            s = link.statistics
            text = (
                link.error
                or link.mismatch
                or f"{s.received} frames, {s.bad} refused, {s.missed} missed"
            )
            rows.append((name, text))
    laser = senses.laser
    rows.append(("laser", laser.error or f"{laser.statistics.scans} scans"))
    rows.append(("ages", "  ".join(f"{name} {1e3 * age:.0f} ms" for name, age in ages.items())))
    if math.isfinite(ages["odometry"]):
        state = senses.odometry
        pose, _ = senses.odometer.at(now)
        rows += [
            ("mode", f"{Mode(state.mode).name}, faults {flag_names(Fault(state.faults))}"),
            ("switches", flag_names(Switch(state.switches))),
            ("set point", f"{state.v:.3f} m/s  {state.w:.3f} rad/s"),
            ("wheels", f"{state.speed_left:.3f}  {state.speed_right:.3f} m/s"),
            ("duties", f"{state.duty_left:.2f}  {state.duty_right:.2f}"),
            ("odometry", f"{pose[0]:.3f} m  {pose[1]:.3f} m  {math.degrees(pose[2]):.1f} deg"),
            ("battery", f"{state.battery:.1f} V"),
        ]
    ranges, sonar, old = senses.ranges(now)
    if np.isfinite(ranges).any():
        nearest = int(np.nanargmin(np.where(np.isfinite(ranges), ranges, np.inf)))
        bearing = math.degrees(senses.sensors.laser.fov * (nearest / (len(ranges) - 1) - 0.5))
        rows.append(("nearest echo", f"{ranges[nearest]:.2f} m at {bearing:.0f} deg"))
    sonar_texts = (f"{r:.2f} ({a:.1f} s)" for r, a in zip(sonar, old, strict=True))
    rows.append(("ultrasonics", "  ".join(sonar_texts)))
    return rows


Rows = list[tuple[str, str]]

SUPPORTED = hasattr(socket, "AF_UNIX") and hasattr(os, "getuid")  # not on every system
INTERVAL = 0.5  # s between two tables
_PATIENCE = 3.0  # s for a table, after which its sender has ended, or hangs
_WATCHERS = 8


def socket_path(device: str) -> Path:
    """The Unix socket of the program that holds a device; its folder belongs to this user."""
    runtime = os.environ.get("XDG_RUNTIME_DIR") or f"/run/user/{os.getuid()}"
    name = f"wheelchair_gym-{os.getuid()}"
    folder = Path(runtime if os.path.isdir(runtime) else tempfile.gettempdir()) / name
    return folder / (os.path.realpath(device).strip("/").replace("/", "-") + ".sock")


class MonitorServer:
    """Sends tables to all watchers; what a watcher does not read is dropped.

    Args:
        device: that this program holds alone.

    Raises:
        OSError: the socket cannot be made.
    """

    def __init__(self, device: str) -> None:
        self.path = socket_path(device)
        self.path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        if self.path.parent.stat().st_uid != os.getuid():
            raise OSError(f"{self.path.parent} is another user's")
        self.path.unlink(missing_ok=True)  # left by a program that was killed
        self._listener = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        try:
            self._listener.bind(str(self.path))
            self._listener.listen(_WATCHERS)
        except OSError:
            self._listener.close()
            raise
        self._listener.setblocking(False)
        self._watchers: list[socket.socket] = []
        self._last = -INTERVAL

    def publish(self, now: float, rows: Callable[[], Rows]) -> None:
        """Send a table to all watchers if one is due at a time [s]; never waits."""
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
                    raise OSError("the watcher does not read")
            except OSError:
                self._watchers.remove(watcher)
                watcher.close()

    def close(self) -> None:
        """Close all connections."""
        for end in (self._listener, *self._watchers):
            end.close()
        with contextlib.suppress(OSError):
            self.path.unlink()


def subscribe(device: str) -> Iterator[Rows] | None:
    """The tables of the program that holds a device, until it ends; None: there is none."""
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
