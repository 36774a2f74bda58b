"""Both ends of rosbridge v2: a ROS system's topics as JSON over a WebSocket.

roslibpy (2.1, MIT, maintained) implements this protocol, too, but is not safe with a person in the
chair: its default transport runs Twisted's reactor, which cannot run twice in one process
(roslibpy#56); it reconnects by itself, so that a chair would go on after a lost link; it silently
drops messages that it cannot read; and its `publish` only queues, so that it is unknown whether a
stop command was sent. Here a message has been sent when `publish` returns, an unreadable message
ends the link, and a lost link stays lost.

The server serves a robot's topics to any number of clients, and takes commands. It speaks what
roslibpy, roslibjs and this package's own client use: subscribe, unsubscribe, advertise,
unadvertise, publish, call_service, also of /rosapi/topics; status for what it does not understand.
As rosbridge_server does, it sends null for NaN and +inf. Of -inf, a range too near, it makes a
range below every `range_min`, so that no client takes an obstacle for free space.
"""

import hmac
import json
import logging
import socket
import ssl
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.base.errors import load_extra, shorten
from wheelchair_gym.base.files import read_text
from wheelchair_gym.base.settings import InputError
from wheelchair_gym.hardware.ros.settings import RosbridgeSettings
from wheelchair_gym.hardware.ros.sockets import TurnsSocket, limit_sending

_LOG = logging.getLogger(__name__)
_PING = 1.0  # s between two pings; the connection is closed when an answer takes as long
_MAX_MESSAGE = 128 << 20  # bytes: a map of 30 million cells

Callback = Callable[[str, Any, float], None]
Service = Callable[[Mapping[str, Any]], dict[str, Any]]


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
            context.sslsocket_class = TurnsSocket
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
        load_extra("websockets.sync")
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
            limit_sending(plug)
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
        except Exception as error:  # whatever a message leads to
            why = f"it broke ({str(error) or repr(error)})"
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
        elif operation == "call_service" and (name := str(content.get("service"))) in self.services:
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


_MAX_MESSAGES = 1000  # a second from one client: more is an error of the client, which is cut off
_MAX_BYTES = 1 << 20  # of a client's message
_CLIENT_PING = 2.0  # s between two pings; a client that does not answer for as long is cut off
_TOO_NEAR = -1.0  # m, for -inf
_DEFAULT_QUEUE = 10  # messages of a topic that wait for a client that does not say how many may


def strict(value: Any) -> Any:
    """Return a message as JSON can hold it: lists, null for NaN and +inf, -1 for -inf."""
    if isinstance(value, dict):
        return {key: strict(item) for key, item in value.items()}
    if isinstance(value, list):
        return [strict(item) for item in value]
    if isinstance(value, np.ndarray):
        listed = rounded(value)
        for k in np.flatnonzero(~np.isfinite(value)):
            listed[k] = strict(listed[k])
        return listed
    if not isinstance(value, float) or np.isfinite(value):
        return value
    return _TOO_NEAR if value < 0.0 else None


class _Client:
    """A connection, what it has subscribed to, and the messages that wait for it."""

    def __init__(self, connection: Any) -> None:
        self.connection = connection
        self.topics: dict[str, tuple[int, float]] = {}  # queue's length, least interval [s]
        self._sent_at: dict[str, float] = {}
        self._waiting: deque[tuple[str, str]] = deque()
        self._changed = threading.Condition()
        self.closed = False

    def put(self, topic: str, text: str, latched: bool = False) -> None:
        """Queue a message of a topic; the oldest of its topic is dropped if there are many."""
        queue, interval = self.topics.get(topic, (_DEFAULT_QUEUE, 0.0))
        now = time.monotonic()
        if not latched and now - self._sent_at.get(topic, -1e9) < interval:
            return
        self._sent_at[topic] = now
        with self._changed:
            same = [one for one in self._waiting if one[0] == topic]
            if topic and len(same) >= queue:
                self._waiting.remove(same[0])
            self._waiting.append((topic, text))
            self._changed.notify()

    def send_all(self) -> None:
        """Send what waits until the connection is closed; runs in a thread."""
        with suppress(Exception):  # the connection has ended; its reader reports that
            while True:
                with self._changed:
                    self._changed.wait_for(lambda: self._waiting or self.closed)
                    if self.closed:
                        return
                    _, text = self._waiting.popleft()
                self.connection.send(text)

    def end(self) -> None:
        """End the thread that sends."""
        with self._changed:
            self.closed = True
            self._changed.notify()


class RosbridgeServer:
    """Serves from when it is made until `close`.

    Args:
        host: address to listen at; other machines reach it only if it is none of this machine's
            own.
        port: TCP port; 0: a free one.
        on_message: is called in a thread with topic, message and client; returns what is wrong
            with the message, or nothing.
        on_leave: is called in a thread with a client that is gone.
        token: that clients must send (Authorization: Bearer TOKEN); empty: none.
        certificate: PEM file with a key and a certificate for TLS; None: no TLS.

    Attributes:
        listens: topics that clients may publish, with the types that they may have.
        services: by name.
        url: ws://HOST:PORT or wss://HOST:PORT.
        lost: why no more clients are accepted, in a line; empty while they are.

    Raises:
        InputError: the extra 'ros' is not installed, the port is taken, or the file is no
            certificate.
    """

    def __init__(
        self,
        host: str,
        port: int,
        on_message: Callable[[str, Any, object], str],
        on_leave: Callable[[object], object] = lambda client: None,
        token: str = "",
        certificate: str | Path | None = None,
    ) -> None:
        load_extra("websockets.sync")
        from websockets.sync.server import serve

        self.listens: dict[str, tuple[str, ...]] = {}
        self.services: dict[str, Service] = {"/rosapi/topics": self._list_topics}
        self._types: dict[str, str] = {}
        self._on_message, self._on_leave, self._token = on_message, on_leave, token
        self._clients: list[_Client] = []
        self._latched: dict[str, str] = {}
        self._topics: dict[str, bool] = {}  # topic: whether late subscribers get its last message
        self._lock, self._closed, self.lost = threading.Lock(), False, ""
        context = None
        if certificate is not None:
            context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
            context.sslsocket_class = TurnsSocket
            try:
                context.load_cert_chain(certificate)
            except (OSError, ssl.SSLError) as error:
                raise InputError(
                    f"{certificate}: expected a PEM file with a key and a certificate "
                    f"({error.strerror or error})"
                ) from None
        try:
            self._server = serve(
                self._serve, host, port, compression=None, max_size=_MAX_BYTES, ssl=context,
                process_request=self._admit, ping_interval=_CLIENT_PING, ping_timeout=_CLIENT_PING,
                close_timeout=_PING,
                logger=logging.getLogger(f"{__name__}.websockets"),
            )  # fmt: skip
        except (OSError, OverflowError) as error:
            why = getattr(error, "strerror", None) or error
            raise InputError(f"{host}:{port}: cannot be served ({why})") from None
        logging.getLogger(f"{__name__}.websockets").setLevel(logging.CRITICAL)
        name = f"[{host}]" if ":" in host else host
        port = self._server.socket.getsockname()[1]
        self.url = f"{'ws' if context is None else 'wss'}://{name}:{port}"
        self.port: int = port
        if not is_local(host) and not (token and context):
            lacks = " and ".join(["no token"] * (not token) + ["no TLS"] * (context is None))
            _LOG.warning("%s: %s: whoever reaches it can read and command the chair", host, lacks)
        self._thread = threading.Thread(target=self._accept, daemon=True)
        self._thread.start()

    def advertise(self, topic: str, kind: str, latch: bool = False) -> None:
        """Announce a topic; the last message of a latched one goes to late subscribers, too."""
        self._topics[topic], self._types[topic] = latch, kind

    def serve(self, name: str, kind: str, service: Service) -> None:
        """Offer a service: a function of its arguments, which is called in a client's thread."""
        self.services[name] = service

    def publish(self, topic: str, message: Any) -> None:
        """Send a message to all who have subscribed to its topic."""
        if not self._topics[topic] and not any(topic in one.topics for one in self._clients):
            return
        text = json.dumps(
            {"op": "publish", "topic": topic, "msg": strict(message)}, allow_nan=False
        )
        with self._lock:
            if self._topics[topic]:
                self._latched[topic] = text
            for client in self._clients:  # those who subscribed meanwhile, too
                if topic in client.topics:
                    client.put(topic, text)

    def close(self) -> None:
        """Close all connections; may be called again."""
        self._closed = True
        closers = [threading.Thread(target=one.connection.close) for one in self._clients]
        for closer in closers:
            closer.start()
        for closer in closers:
            closer.join()
        self._server.shutdown()
        self._thread.join()

    def _accept(self) -> None:
        """Accept clients until `close`, or until this machine has no room for one more."""
        self._server.serve_forever()
        self.lost = "" if self._closed else "it accepts no more clients"

    def _admit(self, connection: Any, request: Any) -> Any:
        """Refuse clients without the token, and web pages where there is none.

        A browser names the page's origin, and lets every page connect to servers of this machine.
        """
        given = request.headers.get("Authorization", "").encode()
        if self._token and not hmac.compare_digest(given, f"Bearer {self._token}".encode()):
            return connection.respond(401, "expected the header Authorization: Bearer TOKEN\n")
        origin = request.headers.get("Origin")
        if origin is not None and not self._token:
            return connection.respond(403, f"a page of {origin} may not connect; set a token\n")
        return None

    def _serve(self, connection: Any) -> None:
        limit_sending(connection.socket)
        client = _Client(connection)
        with self._lock:
            self._clients = [*self._clients, client]
        sender = threading.Thread(target=client.send_all, daemon=True)
        sender.start()
        begun, count = time.monotonic(), 0
        try:
            for text in connection:
                now, count = time.monotonic(), count + 1
                if now - begun >= 1.0:
                    begun, count = now, 0
                if count > _MAX_MESSAGES:
                    _LOG.warning("a client sends over %d messages/s: cut off", _MAX_MESSAGES)
                    connection.close(1008, "too many messages")
                    break
                if why := self._take(client, text):
                    status = {"op": "status", "level": "error", "msg": why}
                    client.put("", json.dumps(status))
        except Exception as error:  # whatever a client sends or breaks concerns it alone
            _LOG.debug("a client is gone: %s", error)
        finally:
            with self._lock:
                self._clients = [one for one in self._clients if one is not client]
            client.end()
            self._on_leave(client)

    def _take(self, client: _Client, text: str | bytes) -> str:
        """Obey a message; returns what is wrong with it, or nothing."""
        try:
            content = json.loads(text)
            operation, topic = content["op"], str(content.get("topic", ""))
        except (ValueError, TypeError, KeyError, AttributeError, RecursionError):
            return "expected a JSON object with the key op"
        if "topic" in content and not topic.startswith("/"):
            return f"{shorten(topic)}: expected the name of a topic that begins with /"
        if operation == "subscribe":
            return self._subscribe(client, topic, content)
        if operation in ("advertise", "publish") and topic not in self.listens:
            return f"nothing listens to {topic}; expected {', '.join(self.listens)}"
        if operation == "publish":
            return self._on_message(topic, content.get("msg"), client)
        if operation == "unsubscribe":
            client.topics.pop(topic, None)
        elif operation == "advertise":
            kind = str(content.get("type", "")).replace("/msg/", "/")
            if kind not in self.listens[topic]:
                return f"{topic}: type {kind}; expected {' or '.join(self.listens[topic])}"
        elif operation == "call_service":
            self._call(client, content)
        elif operation not in ("unadvertise", "set_level"):
            return f"{operation!r} is not supported"
        return ""

    def _subscribe(self, client: _Client, topic: str, content: Mapping[str, Any]) -> str:
        if content.get("compression", "none") not in ("none", None):
            return f"{topic}: compression {content['compression']!r}; expected none"
        try:
            queue = max(1, int(content.get("queue_length") or _DEFAULT_QUEUE))
            interval = 1e-3 * max(0.0, float(content.get("throttle_rate") or 0.0))
        except (TypeError, ValueError, OverflowError):
            return f"{topic}: expected numbers for queue_length and throttle_rate"
        with self._lock:
            client.topics = {**client.topics, topic: (queue, interval)}
            if topic in self._latched:
                client.put(topic, self._latched[topic], latched=True)
        known = topic in self._topics or not self._topics  # they are announced a little later
        return "" if known else f"{topic} is not published; there are {', '.join(self._topics)}"

    def _list_topics(self, arguments: Mapping[str, Any]) -> dict[str, Any]:
        """Return the answer of rosapi/srv/Topics."""
        topics = self._types | {topic: kinds[0] for topic, kinds in self.listens.items()}
        return {"topics": [*topics], "types": [*topics.values()]}

    def _call(self, client: _Client, content: Mapping[str, Any]) -> None:
        name = str(content.get("service", ""))
        values: Any
        if (service := self.services.get(name)) is None:
            done, values = False, f"{name} is not served; expected {', '.join(self.services)}"
        else:
            done, values = True, service(content.get("args") or {})
        answer = {"op": "service_response", "service": name, "values": values, "result": done}
        if "id" in content:
            answer["id"] = content["id"]
        client.put("", json.dumps(answer))
