"""Access to the studio: a token, the page's own origin, and a limit of the request rate.

A browser lets any page of the web send requests to this machine. So every request must name this
server as its host, come from no other page, and carry the token that only the person who started
the program knows.
"""

from __future__ import annotations

import hmac
import ipaddress
import secrets
import time
from contextlib import suppress
from functools import lru_cache
from http.cookies import CookieError, SimpleCookie
from typing import Any, Final
from urllib.parse import parse_qs, urlsplit

from starlette.datastructures import MutableHeaders
from starlette.responses import PlainTextResponse, RedirectResponse

MAX_BYTES: Final = 32 << 20  # of an upload, such as a map
_PER_SECOND, _BURST = 100.0, 400.0  # requests of one client
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
        self._bucket = lru_cache(_CLIENTS)(lambda client: Bucket(_PER_SECOND, _BURST))

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
