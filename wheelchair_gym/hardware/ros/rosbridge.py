"""One rosbridge v2 link: a ROS system's topics as JSON over a WebSocket.

roslibpy (2.1, MIT, maintained) implements this protocol, too, but is not safe with a person in the
chair: its default transport runs Twisted's reactor, which cannot run twice in one process
(roslibpy#56); it reconnects by itself, so that a chair would go on after a lost link; it silently
drops messages that it cannot read; and its `publish` only queues, so that it is unknown whether a
stop command was sent. Here a message has been sent when `publish` returns, an unreadable message
ends the link, and a lost link stays lost.
"""

from __future__ import annotations

import importlib
import json
import logging
import socket
import ssl
import threading
import time
from collections.abc import Callable, Mapping
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.base.files import read_text
from wheelchair_gym.base.settings import InputError
from wheelchair_gym.hardware.ros.settings import RosbridgeSettings

_LOG = logging.getLogger(__name__)
_PING = 1.0  # s between two pings; the connection is closed when an answer takes as long
_MAX_MESSAGE = 128 << 20  # bytes: a map of 30 million cells

Callback = Callable[[str, Any, float], None]
Service = Callable[[Mapping[str, Any]], dict[str, Any]]


def load_websockets() -> None:
    """Check that the package websockets is installed.

    Raises:
        InputError: the extra 'ros' is not installed.
    """
    try:
        importlib.import_module("websockets.sync.client")
    except ImportError:
        raise InputError("a chair under ROS needs: pip install 'wheelchair_gym[ros]'") from None


def is_local(host: str) -> bool:
    """Whether only this machine reaches a host."""
    return host == "localhost" or host.startswith("127.") or host == "::1"


def rounded(values: NDArray[Any]) -> list[Any]:
    """An array as a list; of float32, with digits to a tenth of a millimetre."""
    if values.dtype == np.float32:
        values = np.round(values.astype(np.float64), 4)
    return list(values.tolist())


def read_token(file: str | Path) -> str:
    """The token that a file holds.

    Raises:
        InputError: the file cannot be read, or is not one line of printable characters.
    """
    token = read_text(file, "yaml").strip()
    if not token or not token.isascii() or not token.isprintable() or " " in token:
        raise InputError(f"{file}: expected a token: one line of printable ASCII without spaces")
    return token


def _security(
    host: str, port: int, link: RosbridgeSettings
) -> tuple[ssl.SSLContext | None, dict[str, str]]:
    """The context of TLS and the headers of a connection; what is missing is said.

    Raises:
        InputError: a file cannot be read, or a token would go over a network unencrypted.
    """
    context = None
    if link.tls:
        try:
            context = ssl.create_default_context(cafile=link.ca_file or None)
        except (OSError, ssl.SSLError) as error:
            why = error.strerror or error
            raise InputError(f"ca_file {link.ca_file}: expected certificates ({why})") from None
    headers = {}
    if link.token_file:
        headers["Authorization"] = f"Bearer {read_token(link.token_file)}"
    if not is_local(host) and context is None:
        if headers:
            raise InputError(f"ros://{host}:{port}: a token needs tls, or this machine as its host")
        _LOG.warning(
            "ros://%s:%d: no TLS and no token: whoever is on the network can read and command the "
            "chair", host, port,
        )  # fmt: skip
    return context, headers


class Rosbridge:
    """A link that is open from when it is made until `close`, or until it is lost.

    Args:
        host: where rosbridge_server runs.
        port: of its WebSocket.
        on_message: called in a thread with topic, message and its arrival [s, `time.monotonic`].
        link: timeouts and sizes.

    Attributes:
        lost: why the link is lost, in a line; empty while it is open.
        closed: is set when the link is lost.
        farewell: a topic, and what makes the message that is published on it before the link is
            closed.

    Raises:
        InputError: the extra 'ros' is not installed, or no rosbridge answers there.
    """

    def __init__(self, host: str, port: int, on_message: Callback, link: RosbridgeSettings) -> None:
        load_websockets()
        from websockets.exceptions import ConnectionClosed, WebSocketException
        from websockets.sync.client import connect

        context, headers = _security(host, port, link)

        self._broken: tuple[type[Exception], ...] = (ConnectionClosed, EOFError, OSError)
        name = f"[{host}]" if ":" in host else host
        self.url = f"ros://{name}:{port}"
        self.lost, self.closed = "", threading.Event()
        self._write_lock = threading.RLock()
        self.farewell: tuple[str, Callable[[], Any]] | None = None
        self.services: dict[str, Service] = {}
        self._on_message, self._stack = on_message, ExitStack()
        try:
            plug = socket.create_connection((host, port), link.connect_timeout)
            self._socket = self._stack.enter_context(
                connect(
                    f"{'wss' if context else 'ws'}://{name}:{port}", sock=plug, ssl=context,
                    open_timeout=link.connect_timeout, close_timeout=_PING, ping_interval=_PING,
                    ping_timeout=_PING, max_size=_MAX_MESSAGE, compression=None,
                    additional_headers=headers,
                )
            )  # fmt: skip
        except (OSError, WebSocketException, EOFError) as error:
            why = " ".join((str(error) or type(error).__name__).split())
            raise InputError(f"{self.url}: no rosbridge answers there ({why})") from None
        self._thread = threading.Thread(target=self._listen, name=self.url, daemon=True)
        self._thread.start()

    def subscribe(self, topic: str, kind: str, queue: int = 1) -> None:
        """Subscribe to a topic of a type; the newest `queue` messages wait."""
        self._send({"op": "subscribe", "topic": topic, "type": kind, "queue_length": queue})

    def unsubscribe(self, topic: str) -> None:
        """Unsubscribe from a topic."""
        self._send({"op": "unsubscribe", "topic": topic})

    def advertise(self, topic: str, kind: str, latch: bool = False) -> None:
        """Announce messages of a type; late subscribers get the last one of a latched topic."""
        more = {"latch": True} if latch else {}
        self._send({"op": "advertise", "topic": topic, "type": kind} | more)

    def serve(self, name: str, kind: str, service: Service) -> None:
        """Offer a service: a function of its arguments, which is called in the link's thread."""
        self.services[name] = service
        self._send({"op": "advertise_service", "service": name, "type": kind})

    def publish(self, topic: str, message: Any) -> None:
        """Send a message; it is dropped where the link is lost."""
        self._send({"op": "publish", "topic": topic, "msg": message})

    def close(self) -> None:
        """Publish the farewell and close the link; may be called again."""
        self._end("closed")
        self._stack.close()
        if threading.current_thread() is not self._thread:
            self._thread.join()

    def _send(self, content: dict[str, Any]) -> None:
        with self._write_lock:  # nothing follows the farewell
            if self.lost:
                return
            try:
                # NaN and infinities go out as such, which rosbridge_server takes; it refuses null.
                self._socket.send(json.dumps(content, default=rounded))
            except self._broken as error:
                self._end(f"it broke ({error})")

    def _listen(self) -> None:
        why = "the other side closed it"
        try:
            while not self.lost:
                why = self._take(self._socket.recv(), time.monotonic())
                if why:
                    break
        except self._broken as error:
            why = f"it broke ({error})"
        self._end(why)
        with suppress(Exception):  # a broken socket may refuse to be closed
            self._stack.close()

    def _take(self, text: str | bytes, now: float) -> str:
        """Handle a message; returns why the link is unusable, or nothing."""
        if isinstance(text, bytes):
            return "it sends bytes; expected JSON"
        try:
            content = json.loads(text)  # NaN and Infinity, too, which rosbridge may write
        except (ValueError, RecursionError):
            return f"it sends what is not JSON: {text[:40]!r}"
        operation = content.get("op") if isinstance(content, dict) else None
        if operation == "publish" and isinstance(content.get("topic"), str):
            self._on_message(content["topic"], content.get("msg"), now)
        elif operation == "call_service" and content.get("service") in self.services:
            name = content["service"]
            answer = {"op": "service_response", "service": name, "result": True}
            values = self.services[name](content.get("args") or {})
            self._send(answer | {"id": content.get("id"), "values": values})
        elif operation == "status":
            if content.get("level") in ("error", "warning"):
                _LOG.warning("%s reports: %s", self.url, " ".join(str(content.get("msg")).split()))
        elif operation in ("fragment", "png", "cbor", "cbor-raw"):
            return f"it sends {operation!r}, which was not asked for"
        elif not isinstance(operation, str):
            return f"it sends what is no rosbridge message: {text[:40]!r}"
        return ""

    def _end(self, why: str) -> None:
        """Publish the farewell, and store why the link is lost; the first time only."""
        with self._write_lock:
            if not self.lost:
                self.lost = " ".join(why.split())
                if self.farewell is not None:
                    topic, make = self.farewell
                    last = {"op": "publish", "topic": topic, "msg": make()}
                    with suppress(Exception):  # the link may be the very thing that is broken
                        self._socket.send(json.dumps(last))
        self.closed.set()
