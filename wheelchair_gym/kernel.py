"""Compiled functions: one decorator, so that options and cache live in one place.

numba's own cache looks at the file of a function only: a kernel in one file keeps running an old
copy of a kernel that it calls in another. Here the stamp covers every kernel called, and every
constant frozen in, so an edit anywhere recompiles what depends on it and nothing else.
"""

from __future__ import annotations

import hashlib
import pickle
from collections.abc import Callable
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import Any, TypeVar, cast

import numba
import numpy as np
from numba import types

from wheelchair_gym import progress

progress.watch()

F = TypeVar("F", bound=Callable[..., Any])

whole: Any = np.int64  # of a count or a field: numba compiles a kernel anew for each width

# No fast-math anywhere: results may not depend on how a loop was vectorised or inlined, since one
# chair and a batch of chairs must agree bit for bit. The numpy error model drops the check for
# division by zero, which is what stops vectorisation. Nothing calls kernels from C.
_OPTIONS: dict[str, Any] = {
    "error_model": "numpy",
    "nogil": True,
    "cache": True,
    "no_cfunc_wrapper": True,
}


@cache
def _file_digest(path: str) -> str:
    return hashlib.sha256(Path(path).read_bytes()).hexdigest()


def _digest(function: Callable[..., Any]) -> str:
    """Digest of the function's file, of the kernels it calls and of the constants it freezes."""
    code = function.__code__
    parts = [_file_digest(code.co_filename)]
    for name in code.co_names:
        value = function.__globals__.get(name)
        if hasattr(value, "source_digest"):
            parts.append(str(vars(value)["source_digest"]))
        elif value is not None and not callable(value) and not isinstance(value, ModuleType):
            parts.append(f"{name}={value!r}")
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()


def _compiled(function: F, **options: Any) -> F:
    dispatcher = numba.njit(**_OPTIONS, **options)(function)
    dispatcher.source_digest = _digest(function)
    resolve = dispatcher.get_call_template

    def resolve_plain(args: Any, kws: Any) -> Any:
        # A constant argument would be compiled for its value: a dozen copies of one small kernel.
        return resolve(tuple(map(types.unliteral, args)), kws)

    dispatcher.get_call_template = resolve_plain
    index = dispatcher._cache._cache_file
    index._source_stamp, load = dispatcher.source_digest, index._load_index

    def load_index() -> Any:
        # It names the classes of arguments before its stamp is looked at: they may be gone since.
        try:
            return load()
        except (AttributeError, ImportError, EOFError, pickle.UnpicklingError):
            return {}

    index._load_index = load_index
    return cast(F, dispatcher)


def kernel(function: F) -> F:
    """Compile a pure function of numbers and arrays; import the kernels it calls by name."""
    return _compiled(function)


def borrowing_kernel(function: F) -> F:
    """Compile a function that makes no arrays: it borrows its own without counting references.

    Counting costs some 200 ns a call for a tuple of arrays, forty times a small test's own work.
    """
    return _compiled(function, _nrt=False)


def absorbed_kernel(function: F) -> F:
    """Compile a borrowing function that its callers absorb: passing many arrays costs time."""
    return _compiled(function, _nrt=False, forceinline=True)


def inlined(function: F) -> F:
    """Compile a small function that its callers absorb; for arithmetic inside the hottest loops."""
    return _compiled(function, inline="always")
