"""The error of wrong input, and how messages show a value."""

import re
import reprlib
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from typing import Any


class InputError(ValueError):
    """Something a person gave is wrong; its message is one line that says what and where."""


class ArgumentError(InputError, TypeError):
    """An unknown keyword argument; its message has the words of Python's own `TypeError`."""


@contextmanager
def imports(what: str, extra: str) -> Iterator[None]:
    """Import packages of an extra, where something needs them.

    Raises:
        InputError: one is not installed; it says how to install it.
    """
    try:
        yield
    except ImportError:
        raise InputError(f"{what}: pip install 'wheelchair_gym[{extra}]'") from None


_PACKAGES = {  # what needs them, and the extra that has them
    "serial": ("boards at serial ports need", "hardware"),
    "evdev": ("a joystick needs", "hardware"),
    "websockets.sync": ("a chair under ROS needs", "ros"),
}


def load_extra(package: str) -> Any:
    """A package that only some need: pyserial, evdev or websockets, by the name of its import.

    Raises:
        InputError: see `imports`.
    """
    with imports(*_PACKAGES[package]):
        return import_module(package)


_SHORT = reprlib.Repr()
_SHORT.maxstring = _SHORT.maxother = _SHORT.maxlong = 80


def shorten(value: object) -> str:
    """A value as an error message shows it: like `repr`, but in one line, and not a long one."""
    return re.sub(r"\s*\n\s*", " ", _SHORT.repr(value))
