"""Sockets of rosbridge's two ends: none waits for ever, and TLS bears a thread for each direction.

OpenSSL cannot read and write one connection at once (openssl#20446), yet neither Python nor
websockets prevents it (cpython#151508): of 500 connections between our two ends, 10 failed, each
because the server's session tickets arrived while the client sent its request.
"""

import selectors
import socket
import ssl
import struct
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from typing import Any, TypeVar

_PATIENCE = 1  # s for which the other end may take no data before it is cut off
_LOOK = 0.1  # s between two looks at whether another thread has closed the socket

T = TypeVar("T")


def limit_sending(plain: socket.socket) -> None:
    """Make a socket without TLS give up, with an OSError, when the other end takes no data."""
    plain.setsockopt(socket.SOL_SOCKET, socket.SO_SNDTIMEO, struct.pack("ll", _PATIENCE, 0))


class TurnsSocket(ssl.SSLSocket):
    """A TLS socket whose threads read and write in turns; none waits while it has its turn.

    Raises:
        TimeoutError: the other end takes no data.
    """

    _turn: threading.Lock

    def __new__(cls, *args: Any, **kwargs: Any) -> "TurnsSocket":
        """Make the lock, which SSLSocket needs before it could be made in __init__."""
        made = super().__new__(cls, *args, **kwargs)
        made._turn = threading.Lock()
        return made

    def settimeout(self, value: float | None) -> None:
        """Set how long the TLS handshake may take [s]; None: for ever."""
        with self._turn:
            super().settimeout(value)

    def accept(self) -> tuple[ssl.SSLSocket, Any]:
        """Wait for a connection, and return it and its address; broken ones are passed over."""
        while True:
            with suppress(ConnectionError):  # reset before it was accepted
                return self._in_turns(super().accept, float("inf"))

    def shutdown(self, how: int) -> None:
        """End the connection; what is being sent then fails, and never goes unencrypted."""
        with self._turn:
            super().shutdown(how)

    def close(self) -> None:
        """Close the socket, between two turns."""
        with self._turn:
            super().close()

    def recv(self, buflen: int = 1024, flags: int = 0) -> bytes:
        """Wait for data; returns at most `buflen` bytes, none at the end of the connection."""
        return self._in_turns(lambda: super(TurnsSocket, self).recv(buflen, flags), float("inf"))

    def send(self, data: Any, flags: int = 0) -> int:
        """Send what the other end takes; returns the number of bytes."""
        return self._in_turns(lambda: super(TurnsSocket, self).send(data, flags), _PATIENCE)

    def _in_turns(self, act: Callable[[], T], patience: float) -> T:
        end = time.monotonic() + patience
        while True:
            late = time.monotonic() > end  # this is then the last try
            with self._turn:
                timeout = self.gettimeout()
                super().settimeout(0.0)
                try:
                    return act()
                except (ssl.SSLWantReadError, BlockingIOError):
                    awaited = selectors.EVENT_READ
                except ssl.SSLWantWriteError:
                    awaited = selectors.EVENT_WRITE
                finally:
                    super().settimeout(timeout)
            if late:
                raise TimeoutError("the other end takes no data")
            # A socket that is closed cannot be waited for, and the next turn raises an OSError.
            with suppress(ValueError), selectors.DefaultSelector() as selector:
                selector.register(self, awaited)
                selector.select(_LOOK)
