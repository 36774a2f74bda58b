"""What a chair says, read-only, from the program that holds its ports to those that watch."""

from __future__ import annotations

import contextlib
import json
import os
import socket
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

Rows = list[tuple[str, str]]

OFFERED = hasattr(socket, "AF_UNIX") and hasattr(os, "getuid")  # not on every system
INTERVAL = 0.5  # s between two tables
_PATIENCE = 3.0  # s for a table: its owner has ended, or hangs
_WATCHERS = 8


def place_of(device: str) -> Path:
    """The Unix socket at which the owner of a device is heard; its folder is this user's own."""
    runtime = os.environ.get("XDG_RUNTIME_DIR") or f"/run/user/{os.getuid()}"
    name = f"wheelchair_gym-{os.getuid()}"
    folder = Path(runtime if os.path.isdir(runtime) else tempfile.gettempdir()) / name
    return folder / (os.path.realpath(device).strip("/").replace("/", "-") + ".sock")


class Feed:
    """Tables for whoever watches; what nobody reads is dropped.

    Args:
        device: that is held; nobody else may hold it.

    Raises:
        OSError: there is no place for the socket.
    """

    def __init__(self, device: str) -> None:
        self.place = place_of(device)
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

    def pump(self, now: float, rows: Callable[[], Rows]) -> None:
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


def watch(device: str) -> Iterator[Rows] | None:
    """The tables of a device's owner until it ends; None where no owner offers any."""
    if not OFFERED:
        return None
    line = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    line.settimeout(_PATIENCE)
    try:
        line.connect(str(place_of(device)))
    except OSError:
        line.close()
        return None
    return _tables(line)


def _tables(line: socket.socket) -> Iterator[Rows]:
    with line, line.makefile("rb") as stream, contextlib.suppress(OSError, ValueError):
        for text in stream:
            yield [(str(name), str(value)) for name, value in json.loads(text)]
