"""Messages of the page: what it may send, and `Outbox`, the queue of messages to the page.

The page sends JSON objects with a `type`. The types that each session accepts, and their fields,
stand in agents/data/messages.yaml; a message that does not fit is refused with one sentence that
says why.
"""

import asyncio
import json
import logging
import math
import queue
import threading
from collections import deque
from collections.abc import Callable, Iterable, Mapping
from functools import partial
from typing import Any, NamedTuple, TypeVar

import numpy as np

from agents import read_data
from agents.studio import PageError
from wheelchair_gym.base.errors import shorten
from wheelchair_gym.base.files import parse_json
from wheelchair_gym.base.settings import InputError

Message = dict[str, Any]
Entry = TypeVar("Entry")
_LOG = logging.getLogger(__name__)
IDLE = 0.1  # s between two looks whether a page is closed
_WAITING = 500  # messages that may wait for a page that does not take them; then it is cut off


class Field(NamedTuple):
    """A field of a message: its test, what it expects in words, and a conversion."""

    fits: Callable[[Any], bool]
    expected: str
    read: Callable[[Any], Any] = lambda value: value

    def check(self, value: Any, where: str) -> Any:
        """Return the value, converted.

        Raises:
            InputError: it does not fit.
        """
        if not self.fits(value):
            raise InputError(f"{where} is {shorten(value)}; expected {self.expected}")
        return self.read(value)


def _is_number(value: Any, low: float, high: float, whole: bool = False) -> bool:
    fine = isinstance(value, int if whole else int | float) and not isinstance(value, bool)
    return fine and low <= value <= high


def number(low: float, high: float, whole: bool = False) -> Field:
    """Accept a number within finite bounds."""
    expected = f"a {'whole ' if whole else ''}number from {low:g} to {high:g}"
    return Field(lambda x: _is_number(x, low, high, whole), expected, int if whole else float)


def text(longest: int = 200) -> Field:
    """Accept a text of limited length."""
    expected = f"a text of {longest} characters at most"
    return Field(lambda x: isinstance(x, str) and len(x) <= longest, expected)


def one_of(known: Iterable[str]) -> Field:
    """Accept one of some texts."""
    texts = tuple(known)
    return Field(lambda x: x in texts, ", ".join(texts))


def _list(maximum: int, item: Callable[[Any], bool], of: str, read: Any = list) -> Field:
    """Accept a list of a limited number of items."""
    return Field(
        lambda x: isinstance(x, list) and len(x) <= maximum and all(map(item, x)),
        f"at most {maximum} {of}", read,
    )  # fmt: skip


def points(width: int, maximum: int, far: float = 1e4) -> Field:
    """Accept a list of rows of numbers, such as points, poses or segments."""

    def fits(row: Any) -> bool:
        fine = isinstance(row, list) and len(row) == width
        return fine and all(_is_number(x, -far, far) for x in row)

    of = f"rows of {width} numbers up to {far:g}"
    return _list(maximum, fits, of, lambda rows: [list(map(float, row)) for row in rows])


def whole_numbers(maximum: int) -> Field:
    """Accept a list of whole numbers."""
    return _list(maximum, lambda x: _is_number(x, -math.inf, math.inf, True), "whole numbers")


def names(known: Iterable[str]) -> Field:
    """Accept a list of known texts, one at least."""
    texts = tuple(known)
    of = f"names, one at least, of {', '.join(texts)}"
    found = _list(len(texts), texts.__contains__, of)
    return found._replace(fits=lambda x: bool(x) and found.fits(x))


POINT = Field(lambda x: points(2, 1).fits([x]), "two numbers", lambda x: [float(x[0]), float(x[1])])
FLAG = Field(lambda x: isinstance(x, bool), "true or false")


def entry(table: Mapping[str, Entry], name: str, where: str) -> Entry:
    """Return the entry of a name in a table whose keys were offered to the page.

    Raises:
        InputError: there is none.
    """
    if name not in table:
        raise InputError(f"{where} is {name!r}; expected one of the list")
    return table[name]


Fields = Mapping[str, Mapping[str, Field]]
_KINDS: Mapping[str, Any] = {
    "flag": FLAG, "point": POINT, "text": text, "number": number, "points": points, "names": names,
    "whole": partial(number, whole=True), "whole_numbers": whole_numbers, "one_of": one_of,
}  # fmt: skip


def fields_of(page: str, **known: Any) -> Fields:
    """Read what each type of message of a page holds, from agents/data/messages.yaml.

    Args:
        page: its name.
        known: texts that a field may have, or a bound of it, by their name in the file.
    """

    def field(kind: Any) -> Field:
        name, *bounds = [kind] if isinstance(kind, str) else kind
        if name in known:
            return one_of(known[name])
        made: Any = _KINDS[name]
        given = (known.get(one, one) if isinstance(one, str) else one for one in bounds)
        return made if name in ("flag", "point") else made(*given)  # type: ignore[no-any-return]

    types = read_data("messages.yaml")[page].items()
    return {kind: {name: field(of) for name, of in fields.items()} for kind, fields in types}


def read_message(text: str, fields: Fields) -> Message:
    """Read a message of a page.

    Args:
        text: that the page sent.
        fields: what each type holds, by name.

    Raises:
        InputError: it is no JSON object, or its type or a field is not in the table.
    """
    content = parse_json(text, "message")
    if not isinstance(content, dict):
        raise InputError(f"message is {shorten(content)}; expected an object")
    kind = content.get("type")
    if not isinstance(kind, str) or kind not in fields:
        raise InputError(f"message.type is {shorten(kind)}; expected one of {', '.join(fields)}")
    expected = fields[kind]
    if set(content) != {"type", *expected}:
        raise InputError(
            f"message {kind} has {shorten(sorted(content))}; expected type, {', '.join(expected)}"
        )
    checked = {name: one.check(content[name], f"{kind}.{name}") for name, one in expected.items()}
    return {"type": kind, **checked}


def plain(value: Any) -> Any:
    """Return a value as JSON can hold it: arrays as lists, null for what is not finite."""
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        return plain(value.tolist())
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if isinstance(value, float):
        return round(value, 5) if math.isfinite(value) else None
    return value


class Outbox:
    """Queue of messages to one page; filled from any thread, emptied by the server's loop.

    A picture is a snapshot of the drive. Only the latest one is kept: a slow page sees fewer of
    them, and no old ones.
    """

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        self._loop, self._filled = loop, asyncio.Event()
        self._messages: deque[str] = deque()
        self._picture: bytes | None = None
        self.overflown = False

    def send(self, kind: str, /, **content: Any) -> None:
        """Queue a message of a type."""
        if len(self._messages) >= _WAITING:
            self.overflown = True
            return
        self._messages.append(json.dumps({"type": kind, **plain(content)}, allow_nan=False))
        self._wake()

    def refuse(self, error: Exception) -> None:
        """Queue the message of an error, with the key and values of its text, if it has one."""
        key, values = getattr(error, "key", ""), getattr(error, "values", {})
        self.send("error", text=str(error), key=key, values=values)

    def show(self, head: Message, ranges: bytes) -> None:
        """Queue a picture, in place of a waiting one: length of the head, head, laser ranges."""
        text = json.dumps(plain(head), separators=(",", ":")).encode()
        text += b" " * (-len(text) % 4)  # so that the ranges are aligned
        self._picture = len(text).to_bytes(4, "little") + text + ranges
        self._wake()

    def _wake(self) -> None:
        if not self._loop.is_closed():
            self._loop.call_soon_threadsafe(self._filled.set)

    async def take(self) -> str | bytes:
        """The next message, or else the latest picture."""
        while True:
            if self._messages:
                return self._messages.popleft()
            if self._picture is not None:
                picture, self._picture = self._picture, None
                return picture
            self._filled.clear()
            await self._filled.wait()


class PageSession:
    """Serves one page from when it is made until `close`: a thread handles its messages in order.

    The method `on_TYPE` takes the messages of a type; its errors are shown on the page.

    Args:
        outbox: of the page.
    """

    fields: Fields  # what the page may send

    def __init__(self, outbox: Outbox) -> None:
        self._out, self._closing = outbox, threading.Event()
        self._waiting: queue.Queue[Message] = queue.Queue(maxsize=100)
        self._thread = threading.Thread(target=self._run, daemon=True, name=type(self).__name__)
        self._thread.start()

    def receive(self, message: Message) -> None:
        """Take a message that `fields` allows.

        Raises:
            InputError: too many of them wait.
        """
        try:
            self._waiting.put_nowait(message)
        except queue.Full:
            raise PageError("try_again") from None

    def close(self) -> None:
        """End the thread, and what it is doing as soon as that can be ended."""
        self._closing.set()
        self._thread.join()

    def _run(self) -> None:
        while not self._closing.is_set():
            self._handle(IDLE)

    def _handle(self, patience: float) -> None:
        """Handle one message, if any comes in time [s]."""
        try:
            message = self._waiting.get(patience > 0.0, patience or None)
        except queue.Empty:
            return
        try:
            getattr(self, f"on_{message['type']}")(message)
        except InputError as error:
            self._out.refuse(error)
        except Exception as error:
            _LOG.exception("studio: %s failed", message["type"])
            text = f"{message['type']}: {type(error).__name__}: {error}"
            self._out.refuse(InputError(text))
