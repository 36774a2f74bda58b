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
import threading
import time
from collections.abc import Callable
from contextlib import ExitStack, suppress
from typing import Any

from wheelchair_gym.config import InputError
from wheelchair_gym.hardware.ros.settings import RosbridgeSettings

_LOG = logging.getLogger(__name__)

Callback = Callable[[str, Any, float], None]


def load_websockets() -> None:
    """Check that the package websockets is installed.

    Raises:
        InputError: the extra 'ros' is not installed.
    """
    try:
        importlib.import_module("websockets.sync.client")
    except ImportError:
        raise InputError("a chair under ROS needs: pip install 'wheelchair_gym[ros]'") from None


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
        farewell: a topic and a message that are published before the link is closed.

    Raises:
        InputError: the extra 'ros' is not installed, or no rosbridge answers there.
    """

    def __init__(self, host: str, port: int, on_message: Callback, link: RosbridgeSettings) -> None:
        load_websockets()
        from websockets.exceptions import ConnectionClosed, WebSocketException
        from websockets.sync.client import connect

        self._broken: tuple[type[Exception], ...] = (ConnectionClosed, EOFError, OSError)
        name, ping = f"[{host}]" if ":" in host else host, link.ping_interval
        self.url = f"ros://{name}:{port}"
        self.lost, self.closed = "", threading.Event()
        self._write_lock = threading.RLock()
        self.farewell: tuple[str, Any] | None = None
        self._on_message, self._stack = on_message, ExitStack()
        try:
            plug = socket.create_connection((host, port), link.connect_timeout)
            self._socket = self._stack.enter_context(
                connect(
                    f"ws://{name}:{port}", sock=plug, open_timeout=link.connect_timeout,
                    close_timeout=ping, ping_interval=ping, ping_timeout=ping,
                    max_size=link.max_message_size, compression=None,
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

    def advertise(self, topic: str, kind: str) -> None:
        """Announce that messages of a type will be published."""
        self._send({"op": "advertise", "topic": topic, "type": kind})

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
                self._socket.send(json.dumps(content, allow_nan=False))
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
                    topic, message = self.farewell
                    last = {"op": "publish", "topic": topic, "msg": message}
                    with suppress(Exception):  # the link may be the very thing that is broken
                        self._socket.send(json.dumps(last))
        self.closed.set()
