"""Munk2D by address: its step, called from compiled code, on bodies read and written in place.

Nothing of this reaches into what pymunk computes: it is the same library, the same structs and the
same function, without the way through Python. Offsets are found at import by writing marker values
through pymunk's API; a self-test then compares the two ways, and a failure refuses to import.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from typing import Any, NamedTuple, cast

import numpy as np
import pymunk
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic
from numba.np.numpy_support import carray
from numpy.typing import NDArray
from pymunk._chipmunk_cffi import ffi, lib

from wheelchair_gym.kernel import kernel

PIN = ">=7.3,<7.4"
BODY_DOUBLES = 40  # of cpBody, which hold everything looked for

_MARKS = {
    "mass": 7.5,
    "mass_inverse": 1.0 / 7.5,
    "moment": 11.25,
    "moment_inverse": 1.0 / 11.25,
    "x": 1234.5,
    "y": -777.25,
    "vx": 3.125,
    "vy": -9.5,
    "fx": 55.5,
    "fy": -66.25,
    "angle": 0.71875,
    "w": -2.625,
    "torque": 8.8125,
}


class Offsets(NamedTuple):
    """Where the fields of cpBody stand, counted in doubles."""

    mass: int
    mass_inverse: int
    moment: int
    moment_inverse: int
    x: int
    y: int
    vx: int
    vy: int
    fx: int
    fy: int
    angle: int
    w: int
    torque: int


def pointer(thing: Any) -> np.uint64:
    """The address of a cffi pointer."""
    return np.uint64(int(ffi.cast("uintptr_t", thing)))


def _find_offsets() -> Offsets:
    m = _MARKS
    body = pymunk.Body(m["mass"], m["moment"])
    body.position, body.velocity, body.force = (
        (m["x"], m["y"]),
        (m["vx"], m["vy"]),
        (m["fx"], m["fy"]),
    )
    body.angle, body.angular_velocity, body.torque = m["angle"], m["w"], m["torque"]
    raw = np.frombuffer(ctypes.string_at(int(pointer(body._body)), 8 * BODY_DOUBLES))
    found = {name: np.flatnonzero(raw == value) for name, value in m.items()}
    missing = [name for name, places in found.items() if not len(places)]
    if missing:
        raise ImportError(
            f"pymunk {pymunk.version}: cpBody has no {', '.join(missing)} where expected; "
            f"this release reads pymunk {PIN}"
        )
    # The position stands twice: the second copy is the cached transform.
    return Offsets(**{name: int(places[0]) for name, places in found.items()})


@intrinsic
def _as_pointer(typingctx: Any, address: Any) -> Any:
    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return builder.inttoptr(args[0], cgutils.voidptr_t)

    return types.voidptr(address), codegen


@intrinsic
def _call(typingctx: Any, function: Any, space: Any, dt: Any) -> Any:
    """Call void f(void*, double) at an address: an argument, not a global, so that numba caches."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        kind = ir.FunctionType(ir.VoidType(), [cgutils.voidptr_t, ir.DoubleType()])
        target = builder.inttoptr(args[0], kind.as_pointer())
        builder.call(target, [builder.inttoptr(args[1], cgutils.voidptr_t), args[2]])
        return context.get_dummy_value()

    return types.void(types.uint64, types.uint64, types.float64), codegen


# numba gives these the arguments that their callers see; mypy knows only how they are declared.
_to_pointer = cast("Callable[..., Any]", _as_pointer)
_call_step = cast("Callable[..., None]", _call)
_view = cast("Callable[..., NDArray[np.float64]]", carray)

OFFSETS = _find_offsets()
STEP = pointer(ffi.addressof(lib, "cpSpaceStep"))
X, Y, VX, VY, FX, FY = (
    OFFSETS.x,
    OFFSETS.y,
    OFFSETS.vx,
    OFFSETS.vy,
    OFFSETS.fx,
    OFFSETS.fy,
)
ANGLE, W, TORQUE = OFFSETS.angle, OFFSETS.w, OFFSETS.torque


@kernel
def body_view(address: np.uint64) -> NDArray[np.float64]:
    """The fields of a cpBody at an address, to read and write in place."""
    return _view(_to_pointer(address), (BODY_DOUBLES,), np.float64)


@kernel
def step_space(step: np.uint64, space: np.uint64, dt: float) -> None:
    """Advance a cpSpace by dt seconds: pymunk's own `Space.step`."""
    _call_step(step, space, dt)


@kernel
def _push(step: np.uint64, space: np.uint64, body: np.uint64, n: int) -> float:
    fields = body_view(body)
    for k in range(n):
        fields[FX] = 40.0
        fields[TORQUE] = 3.0 * (k % 3)
        step_space(step, space, 0.01)
    return float(fields[X] + fields[Y] + fields[ANGLE])


def self_test() -> None:
    """Push a box into a wall both ways and compare.

    Raises:
        ImportError: compiled code and pymunk's API disagree.
    """
    ends = []
    for by_address in (True, False):
        space, body = pymunk.Space(), pymunk.Body(10.0, 2.0)
        wall = pymunk.Segment(space.static_body, (1.0, -5.0), (1.0, 5.0), 0.0)
        space.add(body, pymunk.Poly.create_box(body, (1.0, 0.6)), wall)
        if by_address:
            ends.append(_push(STEP, pointer(space._space), pointer(body._body), 60))
        else:
            for k in range(60):
                body.force, body.torque = (40.0, 0.0), 3.0 * (k % 3)
                space.step(0.01)
            ends.append(body.position.x + body.position.y + body.angle)
    if ends[0] != ends[1]:
        raise ImportError(
            f"pymunk {pymunk.version}: stepping by address differs from its API by "
            f"{abs(ends[0] - ends[1]):g}; this release needs pymunk {PIN}"
        )


self_test()
