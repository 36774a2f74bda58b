"""The error of wrong input, and how messages show a value."""

from __future__ import annotations

import reprlib


class InputError(ValueError):
    """Something a person gave is wrong; its message is one line that says what and where."""


class ArgumentError(InputError, TypeError):
    """An unknown keyword argument; its message has the words of Python's own `TypeError`."""


_SHORT = reprlib.Repr()
_SHORT.maxstring = _SHORT.maxother = _SHORT.maxlong = 80


def shorten(value: object) -> str:
    """A value as an error message shows it: like `repr`, but never longer than about a line."""
    return _SHORT.repr(value)
