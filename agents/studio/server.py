"""The studio's server: the page's files, recordings to take along, and a WebSocket for each page.

A browser lets any page of the web send requests to this machine. So `Guard` is in front of all:
every request must name this server as its host, come from no other page, and carry the token that
only the person who started the program knows. The request rate is limited. A page has one session,
which ends with its socket.
"""

import asyncio
import hmac
import ipaddress
import os
import re
import secrets
import socket
import sys
import time
from collections.abc import Mapping
from contextlib import suppress
from functools import cached_property, lru_cache
from http.cookies import CookieError, SimpleCookie
from pathlib import Path
from typing import Any, Final
from urllib.parse import parse_qs, urlsplit

import uvicorn
from starlette.applications import Starlette
from starlette.datastructures import MutableHeaders
from starlette.exceptions import HTTPException
from starlette.responses import (
    FileResponse,
    JSONResponse,
    PlainTextResponse,
    RedirectResponse,
    Response,
)
from starlette.routing import Mount, Route, WebSocketRoute
from starlette.staticfiles import StaticFiles
from uvicorn.protocols.http.h11_impl import H11Protocol

from agents.studio import PAGE, UPLOADS, page_texts
from agents.studio.experimenter import HOME, Desk
from agents.studio.messages import Outbox, read_message
from agents.studio.warm_up import WarmUp
from wheelchair_gym.base.files import atomic_write
from wheelchair_gym.base.settings import InputError
from wheelchair_gym.rendering.palette import style_sheet

MAX_BYTES: Final = 32 << 20  # of an upload, such as a map
_REQUESTS, _AT_ONCE = 100.0, 400.0  # of one client, each second
_CLIENTS = 256  # whose rates are remembered
_HEADERS: Final = {
    "content-security-policy":
    "default-src 'self'; img-src 'self' data: blob:; object-src 'none'; base-uri 'none'; "
    "form-action 'self'; frame-ancestors 'none'",
    "x-content-type-options": "nosniff", "referrer-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin", "cache-control": "no-store",
}  # fmt: skip


class Bucket:
    """Allows `per_second` events a second, and up to `burst` at once after a pause."""

    def __init__(self, per_second: float, burst: float) -> None:
        self._rate, self._burst = per_second, burst
        self._left, self._at = burst, time.monotonic()

    def take(self) -> bool:
        """Whether one more event is allowed now."""
        now = time.monotonic()
        self._left = min(self._burst, self._left + (now - self._at) * self._rate)
        self._at = now
        if self._left < 1.0:
            return False
        self._left -= 1.0
        return True


class Access:
    """Rules that refuse connections, with a reason.

    Args:
        token: that clients must know; empty: a new one is made.
        lan: other machines may come, by this machine's number.
        home: path below which the token counts.
    """

    def __init__(self, token: str = "", lan: bool = False, home: str = "/") -> None:
        self.token = token or secrets.token_urlsafe(18)
        self.lan, self.home = lan, home
        self._name = f"studio{home.strip('/')}"  # of the cookie, before the port
        self._bucket = lru_cache(_CLIENTS)(lambda client: Bucket(_REQUESTS, _AT_ONCE))

    def refusal(self, scope: Any) -> tuple[int, str]:
        """Status and reason of a refusal of an ASGI connection; (0, "") where it is let in."""
        headers = {name: value.decode("latin-1") for name, value in scope["headers"]}
        host, origin = headers.get(b"host", ""), headers.get(b"origin")
        if not self._is_own(host):
            return 403, f"{host[:80]!r} is no name of this server; use the address it printed"
        is_socket = scope["type"] == "websocket"
        if origin is None and (is_socket or scope["method"] not in ("GET", "HEAD")):
            return 403, "a request without an origin is refused"
        if origin is not None and origin != f"http://{host}":
            return 403, "a request from another page is refused"
        if not self._knows_token(scope, headers):
            return 403, "the token is missing or wrong; open the address that the program printed"
        client = (scope.get("client") or ("", 0))[0]
        if not self._bucket(client).take():
            return 429, "too many requests; wait a second"
        return 0, ""

    def gives_token(self, scope: Any) -> bool:
        """Whether the address itself carries the token."""
        given = parse_qs(scope["query_string"].decode("latin-1")).get("token", [""])[0]
        return _equal(given, self.token)

    def cookie(self, port: int) -> str:
        """The cookie that keeps the token out of the address; browsers share cookies of ports."""
        return f"{self._name}-{port}={self.token}; Path={self.home}; HttpOnly; SameSite=Strict"

    def _knows_token(self, scope: Any, headers: dict[bytes, str]) -> bool:
        cookies = SimpleCookie()
        with suppress(CookieError):
            cookies.load(headers.get(b"cookie", ""))
        name = f"{self._name}-{(scope.get('server') or ('', 0))[1]}"
        held = cookies[name].value if name in cookies else ""
        return _equal(held, self.token) or self.gives_token(scope)

    def _is_own(self, host: str) -> bool:
        """Whether a Host header names this machine: not by a name that others give it."""
        try:
            name = urlsplit(f"//{host}").hostname or ""
            return name == "localhost" or ipaddress.ip_address(name).is_loopback or self.lan
        except ValueError:
            return False


class Guard:
    """An ASGI application that lets an application see only what `Access` lets in.

    Args:
        app: an ASGI application.
        accesses: rules, each for the paths below its home; the first that fits counts.
    """

    def __init__(self, app: Any, *accesses: Access) -> None:
        self._app, self._accesses = app, accesses

    async def __call__(self, scope: Any, receive: Any, send: Any) -> None:
        """Serve a connection, or refuse it."""
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        path = scope["path"]
        access = next(one for one in self._accesses if path.startswith(one.home))
        status, reason = access.refusal(scope)
        if scope["type"] == "websocket":
            if status:  # before it is accepted: the browser gets 403
                await receive()
                await send({"type": "websocket.close", "code": 1008, "reason": reason})
            else:
                await self._app(scope, receive, send)
        elif status:
            headers = _HEADERS | {"connection": "close"}
            await PlainTextResponse(f"{reason}\n", status, headers)(scope, receive, send)
        elif path == access.home and access.gives_token(scope):
            headers = _HEADERS | {"set-cookie": access.cookie(scope["server"][1])}
            await RedirectResponse(access.home, 303, headers)(scope, receive, send)
        else:

            async def send_safe(message: Any) -> None:
                if message["type"] == "http.response.start":
                    MutableHeaders(scope=message).update(_HEADERS)
                await send(message)

            await self._app(scope, receive, send_safe)


def _equal(given: str, token: str) -> bool:
    return hmac.compare_digest(given.encode("utf-8", "replace"), token.encode())


PAGES: Final = ("drive", "plan", "compare", "study")
_MAX_PAGES = 8  # open at once
_MAX_MESSAGE = 1 << 20  # bytes
_PER_SECOND, _BURST = 150.0, 300.0  # messages of one page; a stick sends 20 to 60 a second
_PING, _PATIENCE = 10.0, 30.0  # s: a busy machine may answer late; a silent stick stops anyway
_BROKEN = 10  # messages that are no messages, after which a page is cut off
_MAX_CONNECTIONS, _MAX_WAITING = 64, 16  # open at once; of them, without a whole request yet
_HEAD_PATIENCE = 5.0  # s for the head of a connection's first request
_NAME = r'[^\x00-\x20./\\<>:"|?*][^\x00-\x1f/\\<>:"|?*]*'  # of a file, as any system has it
_MAP = re.compile(rf"{_NAME}\.(yaml|yml|pgm|png|jpg|jpeg|bmp|map|json)", re.IGNORECASE)
_FILE = re.compile(rf"{_NAME}\.(mcap|mp4|gif|yaml|png|json)")
_LONGEST = 200  # bytes of a file's name


class Studio:
    """All that pages share.

    Args:
        folder: where recordings, films and maps go.
        own_map: settings of the scene `map_file`, with a label.
        access: who may come.
        study: an experiment with participants (`agents.people.protocol.Protocol`), whose data
            go to the folder.
        runs: folder below which the page Compare finds recordings and runs; None: `folder`.
        warm_up: how far compiling is; None: a new one, not begun.
        model: chair of `configs/chairs` in all places, but not in a study; None: the default.
        locked: only the page Study can be reached.
    """

    def __init__(
        self, folder: Path, own_map: Mapping[str, Any] | None = None,
        access: Access | None = None, study: Any = None, runs: Path | None = None,
        warm_up: WarmUp | None = None, model: str | None = None, locked: bool = False,
    ) -> None:  # fmt: skip
        self.folder, self.access = folder, access or Access()
        self.experimenter = Access("", self.access.lan, HOME)
        self.desk = None if study is None else Desk(folder, study)
        self.pages = ("study",) if locked else PAGES
        self.runs = runs or folder
        self.warm_up = warm_up or WarmUp()
        self._own_map, self._model = own_map, model
        self._pages = 0

    def app(self) -> Any:
        """The ASGI application."""
        routes: list[Any] = [
            Route("/pages", lambda request: JSONResponse(self.pages)),
            Route("/texts.json", lambda request: JSONResponse(page_texts())),
            # The colours of pictures and reports, as properties of the page.
            Route("/theme.css", lambda request: Response(style_sheet(), media_type="text/css")),
            WebSocketRoute("/session/{page}", self._socket),
        ]
        if self.pages == PAGES:
            routes += [
                Route("/files/{name}", self._file),
                Route("/maps/{name}", self._upload, methods=["POST"]),
            ]
        if self.desk is not None:
            routes += self.desk.routes(_body)
        routes.append(Mount("/", StaticFiles(directory=PAGE, html=True)))
        return Guard(Starlette(routes=routes), self.experimenter, self.access)

    @cached_property
    def places(self) -> dict[str, Any]:
        """Places to drive in, by key."""
        from agents.studio.catalogue import places

        return places(self._own_map, self._model)

    async def _file(self, request: Any) -> Any:
        """A recording, a film or a map of the folder, by its bare name."""
        name = request.path_params["name"]
        path = self.folder / name
        if not _FILE.fullmatch(name) or path.is_symlink() or not path.is_file():
            return PlainTextResponse("there is no such file\n", 404)
        return FileResponse(path, filename=name)

    async def _upload(self, request: Any) -> Any:
        """Keep a map file that a page sends, for the message `load`."""
        name = request.path_params["name"]
        if not _MAP.fullmatch(name) or len(name.encode(errors="replace")) > _LONGEST:
            names = f"a name of {_LONGEST} bytes at most, ending in .yaml, .pgm, .png, .jpg, .bmp, "
            names += '.map or .json, without / \\ < > : " | ? * and no point or space at the begin'
            return PlainTextResponse(f"expected {names}\n", 400)
        content = await _body(request, MAX_BYTES)
        folder = self.folder / UPLOADS
        folder.mkdir(parents=True, exist_ok=True)
        with atomic_write(folder / name) as part:
            part.write_bytes(content)
        return PlainTextResponse("", 204)

    async def _socket(self, connection: Any) -> None:
        """Serve one page until it goes."""
        kind = connection.path_params["page"]
        if kind not in self.pages or self._pages >= _MAX_PAGES:
            await connection.close(1013 if kind in self.pages else 1008)
            return
        await connection.accept()
        self._pages += 1
        out = Outbox(asyncio.get_running_loop())
        session: Any = None
        tasks = [
            asyncio.create_task(_send_all(connection, out)),
            asyncio.create_task(self._report(out)),
        ]
        try:
            session = await asyncio.to_thread(make_session, kind, self, out)
            await _receive_all(connection, session, out)
        finally:
            for task in tasks:
                task.cancel()
            if session is not None:
                await asyncio.to_thread(session.close)
            self._pages -= 1

    async def _report(self, out: Outbox) -> None:
        """Send a page how far compiling is, when that changes."""
        last: Any = None
        while True:
            state = self.warm_up.state()
            if state["ready"]:
                state |= {"seconds": 0.0}
            if state != last:
                out.send("progress", **state)
                last = state
            await asyncio.sleep(0.25)


async def _body(request: Any, limit: int) -> bytes:
    """Read the body of a request of limited length [bytes]."""
    content = bytearray()
    async for chunk in request.stream():
        content += chunk
        if len(content) > limit:
            raise HTTPException(413, f"expected at most {limit:,} bytes")
    return bytes(content)


def make_session(page: str, studio: Studio, out: Outbox) -> Any:
    """Make the session of a page; what it needs is imported only now."""
    if page == "study":
        from agents.studio.study import StudySession

        return StudySession(studio.desk, out, studio.warm_up.ready)
    from agents.studio.catalogue import choices
    from agents.studio.plan_session import PlanSession
    from agents.studio.session import CompareSession, DriveSession

    places = studio.places
    shown = dict(places)  # another page may add a map meanwhile
    if page != "drive":  # worlds of the twin are the same as those without it
        shown = {key: place for key, place in shown.items() if not place.twin}
    out.send("choices", **choices(shown))
    if page == "drive":
        return DriveSession(places, studio.folder, out, studio.warm_up.ready)
    if page == "plan":
        return PlanSession(places, studio.folder, out)
    return CompareSession(places, studio.runs, out)


async def _send_all(connection: Any, out: Outbox) -> None:
    """Send what waits, until the page is gone or takes nothing any more."""
    while not out.overflown:
        item = await out.take()
        if isinstance(item, str):
            await connection.send_text(item)
        else:
            await connection.send_bytes(item)
    await connection.close(1013)


async def _receive_all(connection: Any, session: Any, out: Outbox) -> None:
    """Give a session what its page sends, until the page goes or misbehaves."""
    bucket, broken = Bucket(_PER_SECOND, _BURST), 0
    while True:
        event = await connection.receive()
        if event["type"] == "websocket.disconnect":
            return
        if not bucket.take():
            await connection.close(1008, "too many messages")
            return
        try:
            if event.get("text") is None:
                raise InputError("a message of bytes; expected text")
            session.receive(read_message(event["text"], session.fields))
        except InputError as error:
            broken += 1
            out.refuse(error)
            if broken > _BROKEN:
                await connection.close(1008, "too many broken messages")
                return


def listening_socket(host: str, port: int) -> socket.socket:
    """A bound socket.

    Raises:
        InputError: the port is taken, or the address is not this machine's.
    """
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    try:
        return socket.create_server((host, port), family=family, backlog=64)
    except OSError as error:
        why = os.strerror(error.errno or 0)
        raise InputError(
            f"port {port} of {host} cannot be used ({why}); choose another by --port"
        ) from None


def make_server(studio: Studio) -> Any:
    """A uvicorn server of the studio; `run(sockets=[...])` serves.

    A connection without a complete request is closed after some seconds, and the oldest of too many
    at once: strangers cannot keep others out. `Guard` closes the connections that it refuses.
    """
    waiting: dict[Any, asyncio.TimerHandle] = {}  # connections, and what will close each

    class Connection(H11Protocol):
        """A connection whose first request has to come soon."""

        def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
            super().connection_made(transport)
            waiting[self] = self.loop.call_later(_HEAD_PATIENCE, transport.abort)
            for oldest in list(waiting)[:-_MAX_WAITING]:
                oldest.transport.abort()

        def data_received(self, data: bytes) -> None:
            super().data_received(data)
            if self.scope is not None and self in waiting:
                waiting.pop(self).cancel()

        def connection_lost(self, exc: Exception | None) -> None:
            waiting.pop(self, None)
            super().connection_lost(exc)

    return uvicorn.Server(
        uvicorn.Config(
            studio.app(), log_level="warning", access_log=False, lifespan="off", http=Connection,
            ws_max_size=_MAX_MESSAGE, ws_ping_interval=_PING, ws_ping_timeout=_PATIENCE,
            limit_concurrency=_MAX_CONNECTIONS, timeout_graceful_shutdown=3, server_header=False,
            h11_max_incomplete_event_size=65536,
        )
    )  # fmt: skip


def serve(studio: Studio, port: int) -> None:
    """Serve until Ctrl-C, and print the address with its token.

    Raises:
        InputError: the port is taken.
    """
    host = "0.0.0.0" if studio.access.lan else "127.0.0.1"
    bound = listening_socket(host, port)
    number = bound.getsockname()[1]
    shown = _lan_address() if studio.access.lan else "127.0.0.1"
    page = "" if studio.desk is None else "#study"
    print(f"http://{shown}:{number}/?token={studio.access.token}{page}", flush=True)
    if studio.desk is not None:
        address = f"http://{shown}:{number}{HOME}?token={studio.experimenter.token}"
        print(f"experimenter, in another browser: {address}", flush=True)
    print("open this address in a browser; Ctrl-C ends the studio", file=sys.stderr)
    with bound:
        make_server(studio).run(sockets=[bound])


def _lan_address() -> str:
    """This machine's address on its network; no packet is sent."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect(("192.0.2.1", 9))  # of no machine (RFC 5737)
        except OSError:
            return "127.0.0.1"
        return str(probe.getsockname()[0])
