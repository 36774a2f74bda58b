"""What a person sees while kernels are compiled, which happens once on a machine."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable
from types import FunctionType
from typing import Any

from numba.core import event

_LOG_PAUSE = 10.0  # s of compiling between two lines where they are kept, as in a log
_PATIENCE = 0.5  # s of compiling before the first of these lines
_OURS = ("wheelchair_gym", "planners", "agents")


def called_by(dispatcher: Any) -> dict[Callable[..., Any], Any]:
    """The kernel and all kernels that it calls, directly or not: function -> dispatcher."""
    found: dict[Callable[..., Any], Any] = {}
    waiting = [dispatcher]
    while waiting:
        kernel = waiting.pop()
        function = kernel.py_func
        if function in found:
            continue
        found[function] = kernel
        names = (function.__globals__.get(name) for name in function.__code__.co_names)
        waiting += [value for value in names if hasattr(value, "source_digest") and _is_ours(value)]
    return found


def kernels_of(function: Callable[..., Any]) -> list[Any]:
    """The kernels that a function of Python calls by name, itself or by other functions of ours."""
    found: list[Any] = []
    waiting: list[Any] = [function]
    seen = {function}
    while waiting:
        caller = waiting.pop()
        for name in caller.__code__.co_names:
            value = caller.__globals__.get(name)
            if hasattr(value, "source_digest") and _is_ours(value):
                found.append(value)
            elif isinstance(value, FunctionType) and value not in seen and _is_from_us(value):
                seen.add(value)
                waiting.append(value)
    return found


def _is_ours(dispatcher: Any) -> bool:
    function = getattr(dispatcher, "py_func", None)
    return function is not None and _is_from_us(function)


def _is_from_us(function: Any) -> bool:
    return function.__module__.partition(".")[0] in _OURS


class CompileProgress(event.Listener):
    """Prints on standard error which kernel is compiled, and how many were so far.

    On a terminal one line that changes; in a log one line after half a second of compiling, and
    one every ten seconds. The number needed is not known before they are called.
    """

    def __init__(self) -> None:
        self.parent: int | None = None  # of a helper process, which prints nothing and ends with it
        self._compiled: set[Callable[..., Any]] = set()
        self._begun: list[float] = []  # s, of each compilation at work, the outermost first
        self._spent = 0.0  # s compiled before the outermost one at work
        self._due = _PATIENCE  # s of compiling until the next line of a log

    def on_start(self, event: Any) -> None:
        """A kernel is about to be compiled, perhaps on behalf of another."""
        dispatcher = event.data["dispatcher"]
        function = dispatcher.py_func
        if self.parent not in (None, os.getppid()):
            os._exit(0)
        if not _is_ours(dispatcher):
            return
        now = time.perf_counter()
        self._begun.append(now)
        self._compiled.add(function)
        line = f"compiling kernel {len(self._compiled)}, once on this machine"
        spent = self._spent + now - self._begun[0]
        place = f"{function.__module__.rpartition('.')[2]}.{function.__name__}"
        self._write(f"{line}: {place}", f"{line}; {spent:.0f} s so far", spent)

    def on_end(self, event: Any) -> None:
        """A kernel has been compiled."""
        if not _is_ours(event.data["dispatcher"]) or not self._begun:
            return
        begun = self._begun.pop()
        if not self._begun:
            self._spent += time.perf_counter() - begun
            self._write("")

    def wait(self, waited: float) -> None:
        """Another process compiles the kernel that is needed; waited: for so long already [s]."""
        if waited >= _PATIENCE:
            line = f"compiling, once on this machine: {waited:.0f} s of waiting for another process"
            self._write(line, line, self._spent + waited)

    def _write(self, shown: str, line: str = "", spent: float = 0.0) -> None:
        """Write to a terminal; or a line to a log, if it is due after so many seconds."""
        if self.parent is None and sys.stderr.isatty():
            print(f"\r\033[K{shown}", end="", file=sys.stderr, flush=True)
        elif self.parent is None and line and spent >= self._due:
            print(line, file=sys.stderr, flush=True)
            self._due = spent + _LOG_PAUSE


progress = CompileProgress()


def watch() -> None:
    """Show progress whenever this process compiles a kernel of ours."""
    event.register("numba:compile", progress)  # type: ignore[no-untyped-call]
