"""Compiling on a second core, and no kernel twice: what several processes owe each other.

Processes share the folder of compiled kernels. A kernel is compiled under a lock of its own; who
finds it locked waits and loads what the other has made. So a helper can compile what will soon be
needed while its parent compiles what is needed now, and workers that start together share the
work. Locks are taken in the order of calls, which has no cycles, and end with their process.
"""

from __future__ import annotations

import atexit
import contextlib
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import IO, Any

from wheelchair_gym.compiled.compile_time import no_collection
from wheelchair_gym.compiled.progress import progress

try:
    import fcntl
except ImportError:  # no such locks on Windows: a kernel may be compiled twice there
    fcntl = None  # type: ignore[assignment]

_PATIENCE = 120.0  # s that a kernel is waited for; the slowest compiles in some 15 s
_PAUSE = 0.02  # s between two looks at a lock
_helpers: set[int] = set()  # ids of this process's helpers
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
    """Whether the lock of a file could be taken at once."""
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True


def compile_once(dispatcher: Any) -> None:
    """Let a dispatcher with a cache compile under a lock, and look into its cache again first."""
    cache, compiler = dispatcher._cache, dispatcher._compiler
    compile_now, save = compiler.compile, cache.save_overload
    lock = Path(f"{cache._cache_file._index_path}.lock")

    def compile_or_load(args: Any, return_type: Any) -> Any:
        with locked(lock), no_collection():
            result = cache.load_overload(args, dispatcher.targetctx)
            if result is None:
                result = compile_now(args, return_type)
                save(args, result)
            else:
                dispatcher.targetctx.insert_user_function(
                    result.entry_point, result.fndesc, [result.library]
                )
        return result

    compiler.compile = compile_or_load
    cache.save_overload = lambda args, result: None  # it was saved before the lock was released


def are_compiled(kernels: Iterable[Any]) -> bool:
    """Whether kernels are compiled, in this process or in the folder of compiled kernels."""
    return all(kernel.overloads or kernel._cache._cache_file._load_index() for kernel in kernels)


def compile_beside(kernels: Iterable[Any], work: Callable[[], object]) -> None:
    """Let a helper process do some work for the sake of the kernels that it compiles.

    The helper is a copy of this process; nothing that the work does is seen here, but this
    process loads the kernels instead of compiling them. Nothing happens where they are compiled
    already, where there is one core, or where other threads run, which a copy would lack.

    Args:
        kernels: some that the work compiles.
        work: takes no arguments; what it raises is ignored.
    """
    if (
        not sys.platform.startswith("linux")
        or progress.parent is not None
        or threading.active_count() > 1
        or len(os.sched_getaffinity(0)) < 2
        or are_compiled(kernels)
    ):
        return
    sys.stdout.flush()
    sys.stderr.flush()
    parent = os.getpid()
    helper = os.fork()
    if helper:
        _helpers.add(helper)
        return
    try:
        progress.parent = parent
        silence = os.open(os.devnull, os.O_RDWR)
        for stream in range(3):
            os.dup2(silence, stream)
        os.nice(1)
        work()
    finally:
        os._exit(0)


@atexit.register
def _end_helpers() -> None:
    for helper in _helpers:
        with contextlib.suppress(OSError):
            if os.waitpid(helper, os.WNOHANG) == (0, 0):
                os.kill(helper, signal.SIGKILL)
                os.waitpid(helper, 0)
