"""Show that kernels are compiled, which happens once on a machine."""

from __future__ import annotations

import contextlib
import sys
import time
from collections.abc import Callable, Iterator
from types import CodeType
from typing import Any

_LOG_PAUSE = 10.0  # s of compiling between two lines where they are kept, as in a log
_PATIENCE = 0.5  # s of compiling before the first of these lines


class CompileProgress:
    """Prints on standard error which kernel is compiled, and the number of those before it.

    On a terminal one line that changes; in a log one line after half a second of compiling, and
    one every ten seconds. The number needed is not known before they are called.

    Attributes:
        listener: called with the name of each kernel, and with "" when compiling pauses.
    """

    def __init__(self) -> None:
        self.listener: Callable[[str], object] | None = None
        self._compiled: set[CodeType] = set()
        self._depth = 0  # kernels at work, one on behalf of another
        self._begun = 0.0  # s: start of the outermost one
        self._spent = 0.0  # s compiled before it
        self._due = _PATIENCE  # s of compiling until the next line of a log

    @contextlib.contextmanager
    def compiling(self, function: Callable[..., Any]) -> Iterator[None]:
        """Show a kernel while it is compiled, perhaps on behalf of another."""
        now = time.perf_counter()
        if not self._depth:
            self._begun = now
        self._depth += 1
        self._compiled.add(function.__code__)
        line = f"compiling kernel {len(self._compiled)}, once on this machine"
        spent = self._spent + now - self._begun
        place = f"{function.__module__.rpartition('.')[2]}.{function.__name__}"
        self._write(f"{line}: {place}", f"{line}; {spent:.0f} s so far", spent)
        self._tell(function.__name__.strip("_"))
        try:
            yield
        finally:
            self._depth -= 1
            if not self._depth:
                self._spent += time.perf_counter() - self._begun
                self._write("")
                self._tell("")

    def wait(self, waited: float) -> None:
        """Show that another process compiles the kernel that is needed, for `waited` [s] now."""
        if waited >= _PATIENCE:
            line = f"compiling, once on this machine: {waited:.0f} s of waiting for another process"
            self._write(line, line, self._spent + waited)

    def _tell(self, name: str) -> None:
        if self.listener is not None:
            self.listener(name)

    def _write(self, shown: str, line: str = "", spent: float = 0.0) -> None:
        """Write to a terminal; or write a line to a log, if it is due after `spent` seconds."""
        if sys.stderr.isatty():
            print(f"\r\033[K{shown}", end="", file=sys.stderr, flush=True)
        elif line and spent >= self._due:
            print(line, file=sys.stderr, flush=True)
            self._due = spent + _LOG_PAUSE


progress = CompileProgress()
