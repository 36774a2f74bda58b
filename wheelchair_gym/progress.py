"""What a person sees while kernels are compiled, which happens once on a machine."""

from __future__ import annotations

import sys
import time
from typing import Any

from numba.core import event

_PATIENCE = 1.0  # s of compiling before anything is said
_OURS = ("wheelchair_gym", "planners", "agents")


class CompileProgress(event.Listener):
    """A line on standard error that names the kernel at work; in a log, one line in all."""

    def __init__(self) -> None:
        self._depth = 0
        self._begun = 0.0
        self._said = False

    def on_start(self, event: Any) -> None:
        """A kernel is about to be compiled, perhaps on behalf of another."""
        function = event.data["dispatcher"].py_func
        if function.__module__.partition(".")[0] not in _OURS:
            return
        if self._depth == 0:
            self._begun = time.perf_counter()
        self._depth += 1
        if time.perf_counter() - self._begun < _PATIENCE:
            return
        place = f"{function.__module__.rpartition('.')[2]}.{function.__name__}"
        if sys.stderr.isatty():
            sys.stderr.write(f"\r\033[Kcompiling, once on this machine: {place}")
            sys.stderr.flush()
        elif not self._said:
            print("compiling, once on this machine; this takes up to a minute", file=sys.stderr)
        self._said = True

    def on_end(self, event: Any) -> None:
        """A kernel has been compiled."""
        function = event.data["dispatcher"].py_func
        if function.__module__.partition(".")[0] not in _OURS:
            return
        self._depth -= 1
        if self._depth == 0 and self._said and sys.stderr.isatty():
            sys.stderr.write("\r\033[K")
            sys.stderr.flush()


_progress = CompileProgress()


def watch() -> None:
    """Show progress whenever this process compiles a kernel of ours."""
    event.register("numba:compile", _progress)  # type: ignore[no-untyped-call]
