"""Compile on a second core, and no kernel twice; show that kernels are compiled.

Processes share the folder of compiled kernels. A kernel is compiled under a lock of its own; a
process that finds it locked waits and loads the result. So a helper process can compile the
kernels that are needed next while its parent compiles those needed now, and workers that start
together share the work. Locks are taken in the order of calls, which has no cycles, and end with
their process.
"""

import atexit
import contextlib
import os
import pickle
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from types import CodeType
from typing import IO, Any

_LOG_PAUSE = 10.0  # s of compiling between two lines where they are kept, as in a log
_SILENCE = 0.5  # s of compiling before the first of these lines


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
        self._due = _SILENCE  # s of compiling until the next line of a log

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
        if waited >= _SILENCE:
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


try:
    import fcntl
except ImportError:  # no such locks on Windows: a kernel may be compiled twice there
    fcntl = None  # type: ignore[assignment]

_PATIENCE = 120.0  # s that a kernel is waited for; the slowest compiles in some 15 s
_PAUSE = 0.02  # s between two looks at a lock
_HELPER = "WHEELCHAIR_COMPILE_HELPER"  # set in a helper's environment: it starts no helpers
# A helper does its work if it gets the lock. It ends when its parent closes the pipe, or ends.
_HELP = """
import fcntl, os, pickle, sys, threading
path, lock = pickle.load(sys.stdin.buffer)
held = open(lock, "ab")
try:
    fcntl.flock(held, fcntl.LOCK_EX | fcntl.LOCK_NB)
except BlockingIOError:
    sys.exit()
sys.path[:] = path
work, arguments = pickle.load(sys.stdin.buffer)
def end_with_parent():
    sys.stdin.buffer.read()
    os._exit(0)
threading.Thread(target=end_with_parent, daemon=True).start()
os.nice(1)
work(*arguments)
os._exit(0)
"""
_helpers: list[subprocess.Popen[bytes]] = []
_held: set[Path] = set()  # locks that this process holds


@contextlib.contextmanager
def locked(path: Path) -> Iterator[None]:
    """Hold the lock of a file that is made where it is absent; wait while another holds it.

    It waits for a limited time: a process that hangs with the lock does not stop the others, which
    then do the work themselves.
    """
    if fcntl is None or path in _held:  # held: a kernel that calls itself with other types
        yield
        return
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("ab") as file:
        begun = time.monotonic()
        while not _take(file) and time.monotonic() - begun < _PATIENCE:
            progress.wait(time.monotonic() - begun)
            time.sleep(_PAUSE)
        _held.add(path)
        try:
            yield
        finally:
            _held.remove(path)


def _take(file: IO[bytes]) -> bool:
    """Take the lock of a file, and return whether nobody else holds it, as far as can be known."""
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:  # another one: a file system without locks
        return not isinstance(error, BlockingIOError)
    return True


def compile_beside(kernel: Any, work: Callable[..., object], *arguments: Any) -> None:
    """Start a helper process that compiles kernels by doing some work.

    The helper is a fresh interpreter, and its work has no other effect: this process then loads the
    kernels instead of compiling them. No helper starts if the kernel is compiled already, if there
    is only one core, or if another process has a helper for the same work.

    Args:
        kernel: one that the work compiles.
        work: a function of a module, which the helper imports; what it raises is ignored.
        arguments: of the work; they are pickled.
    """
    if (
        not sys.platform.startswith("linux")
        or _HELPER in os.environ
        or len(os.sched_getaffinity(0)) < 2
        or kernel.is_compiled
    ):
        return
    lock = f"{kernel.lock}.{work.__name__}"
    try:
        told = pickle.dumps((sys.path, lock)) + pickle.dumps((work, arguments))
    except (pickle.PicklingError, AttributeError, TypeError):
        return  # a user's planner that cannot be pickled: this process compiles alone
    Path(lock).parent.mkdir(parents=True, exist_ok=True)
    helper = subprocess.Popen(
        [sys.executable, "-c", _HELP],
        stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        env=os.environ | {_HELPER: "1"},
    )  # fmt: skip
    _helpers.append(helper)
    assert helper.stdin is not None
    with contextlib.suppress(BrokenPipeError):  # the lock was taken
        helper.stdin.write(told)
        helper.stdin.flush()


@atexit.register
def _end_helpers() -> None:
    for helper in _helpers:
        helper.kill()
        helper.wait()
