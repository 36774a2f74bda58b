"""Compiled functions: one decorator, so that options and cache live in one place.

numba's own cache looks at the file of a function only: a kernel in one file keeps running an old
copy of a kernel that it calls in another. Here the stamp covers all kernels and constants that the
function's file imports, and what those depend on.
"""

import hashlib
from collections.abc import Callable, Iterable
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import Any, TypeVar, cast

import numba
import numpy as np
from numba.core.extending import _Intrinsic

from wheelchair_gym.compiled import linking

F = TypeVar("F", bound=Callable[..., Any])

as_int: Any = np.int64  # of a count or a field: numba compiles a kernel anew for each width

# No fast-math anywhere: results may not depend on how a loop was vectorised or inlined, since one
# chair and a batch of chairs must agree bit for bit. The numpy error model drops the check for
# division by zero, which is what stops vectorisation. Nothing calls kernels from C.
_OPTIONS: dict[str, Any] = {"error_model": "numpy", "nogil": True, "no_cfunc_wrapper": True}


@cache
def _file_digest(path: str) -> str:
    return hashlib.sha256(Path(path).read_bytes()).hexdigest()


def _is_plain(value: object) -> bool:
    """Whether a constant's text says all of its value."""
    if isinstance(value, tuple):
        return all(map(_is_plain, value))
    return isinstance(value, (int, float, str, np.generic, np.dtype))


def _is_other(value: object) -> bool:
    """Whether a kernel may freeze such a value in: neither a function nor a module."""
    return value is not None and not callable(value) and not isinstance(value, ModuleType)


def _digest(function: Callable[..., Any]) -> str:
    """Digest of the function's file, of what that imports, and of how kernels are compiled.

    All kernels and plain constants of the file count, also those that the function does not name:
    it may call a kernel that stands below it in the file, which is not defined yet.
    """
    code, names = function.__code__, function.__globals__
    parts = [_file_digest(path) for path in (code.co_filename, __file__, linking.__file__)]
    for name, value in names.items():
        if name.startswith("__"):
            continue
        if isinstance(value, _Intrinsic):
            parts.append(f"{name}={_file_digest(value._defn.__code__.co_filename)}")
        if hasattr(value, "source_digest"):
            parts.append(f"{name}={vars(value)['source_digest']}")
        elif isinstance(value, np.ndarray):
            parts.append(f"{name}={hashlib.sha256(value.tobytes()).hexdigest()}")
        elif isinstance(value, type) and issubclass(value, tuple):
            parts.append(f"{name}={getattr(value, '_fields', ())}")
        elif _is_plain(value) or (name in code.co_names and _is_other(value)):
            parts.append(f"{name}={value!r}")
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()


def _compiled(function: F, **options: Any) -> F:
    return cast(F, linking.Kernel(function, _digest(function), _OPTIONS | options))


def kernel(function: F) -> F:
    """Compile a pure function of numbers and arrays; import the kernels it calls by name."""
    return _compiled(function)


def borrowing_kernel(function: F) -> F:
    """Compile a function that makes no arrays: it borrows its own without counting references.

    Counting costs some 200 ns a call for a tuple of arrays, forty times the work of a small test.
    """
    return _compiled(function, _nrt=False)


def absorbed_kernel(function: F) -> F:
    """Compile a borrowing function that its callers absorb: passing many arrays costs time."""
    return _compiled(function, _nrt=False, forceinline=True)


def inlined(function: F) -> F:
    """Compile a small function that its callers absorb; for arithmetic inside the hottest loops."""
    return _compiled(function, inline="always")


def compile_part(function: Any, *values: Any) -> None:
    """Compile a kernel for others that call it with such values; nothing is run."""
    type_of: Any = numba.typeof
    function.get_call_template(tuple(type_of(value) for value in values), {})


def check_written(what: str, names: Iterable[str], function: Any) -> None:
    """Refuse fields of a table that the kernel which shall write them does not name.

    Raises:
        TypeError: the first such field.
    """
    for name in names:
        if name not in function.py_func.__code__.co_names:
            raise TypeError(f"{what} {name!r} is declared, and {function.__name__} never writes it")
