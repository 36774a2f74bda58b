"""Shorter compiling: what numba does for every kernel and no kernel here needs.

None of this changes machine code that runs: an error's text is the only thing that differs.
"""

from __future__ import annotations

import contextlib
import functools
import gc
from collections.abc import Iterator
from typing import Any

import numba
from numba.core.target_extension import jit_registry, target_registry
from numba.core.targetconfig import ConfigStack, TargetConfig
from numba.core.types.functions import BaseFunction
from numba.extending import overload
from numba.np import arrayobj


@contextlib.contextmanager
def no_collection() -> Iterator[None]:
    """Do not look for unreachable cycles meanwhile: a seventh of compiling is such a search."""
    was = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was:
            gc.enable()


def _raise_shape_mismatch(source: Any, target: Any) -> None:
    """What kernels call where an array is assigned to a slice of another shape."""
    raise ValueError("cannot assign slice of incompatible shape")


@overload(_raise_shape_mismatch)
def _typed_shape_mismatch(source: Any, target: Any) -> Any:
    def raise_error(source: Any, target: Any) -> None:
        raise ValueError("cannot assign slice of incompatible shape")

    return raise_error


def _remember_call_types() -> None:
    """Let a function of numba's resolve the same types of arguments once, not at each call."""
    resolve: Any = BaseFunction.get_call_type
    flags_now: Any = ConfigStack.top_or_none

    @functools.wraps(resolve)
    def get_call_type(self: Any, context: Any, args: Any, kws: Any) -> Any:
        key = context, tuple(args), tuple(kws.items()), flags_now()
        known = self.__dict__.setdefault("_call_types", {})
        if key not in known:
            signature = resolve(self, context, args, kws)
            known[key] = signature, self._impl_keys[signature.args]
        signature, implementation = known[key]
        self._impl_keys[signature.args] = implementation
        return signature

    BaseFunction.get_call_type = get_call_type  # type: ignore[method-assign]


def _compare_flags_quickly() -> None:
    """Let equal flags be found equal before a default is asked for each that is not set."""
    options_differ: Any = TargetConfig.__eq__

    def same(self: Any, other: Any) -> Any:
        if self is other or (type(self) is type(other) and self._values == other._values):
            return True
        return options_differ(self, other)

    # numba's own is that of the names of all options, each time anew.
    hashes = functools.cache(lambda kind: hash(tuple(sorted(kind.options))))
    TargetConfig.__eq__ = same  # type: ignore[method-assign]
    TargetConfig.__hash__ = lambda self: int(hashes(type(self)))  # type: ignore[method-assign]


def install() -> None:
    """Let this process compile so from now on."""
    # numba's own writes both shapes into the message: more code than most kernels.
    arrayobj.raise_with_shape_context = _raise_shape_mismatch
    # Nothing calls from C what numba itself adds to a kernel.
    cpu = target_registry["cpu"]
    del jit_registry[cpu]
    jit_registry[cpu] = functools.partial(numba.jit, no_cfunc_wrapper=True)
    _remember_call_types()
    _compare_flags_quickly()
