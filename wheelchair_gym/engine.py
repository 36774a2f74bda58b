"""Munk2D by address: its functions called from compiled code, its structs written in place.

Nothing of this reaches into what pymunk computes: it is the same library, the same structs and the
same functions, without the way through Python. Where Munk2D keeps the fields of its structs is
found at import, by marks set through its API. A self-test at import compares the two ways, and a
failure refuses to import.
"""

import ctypes
import math
from collections import namedtuple
from collections.abc import Callable
from typing import Any

import numpy as np
import pymunk
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic
from numpy.typing import NDArray
from pymunk._chipmunk_cffi import ffi, lib

from wheelchair_gym.compiled.address import doubles_at, integers_at, rows_of
from wheelchair_gym.compiled.kernel import borrowing_kernel, inlined

PIN = ">=7.3,<7.4"
GRAVITY = 9.81  # m/s2
BODY_DOUBLES = 40  # of cpBody, which hold everything looked for
SEGMENT_DOUBLES = 40  # of cpSegmentShape
CIRCLE_DOUBLES = 29  # of cpCircleShape
SPACE_WORDS = 40  # of cpSpace, that hold its counter
POLY_DOUBLES = 61  # of cpPolyShape with up to six corners

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


def address_of_struct(thing: Any) -> np.uint64:
    """Return the address of a cffi pointer."""
    return np.uint64(int(ffi.cast("uintptr_t", thing)))


def keep_until_exit(*things: Any) -> None:
    """Take the destructors of pymunk off cffi pointers: their memory goes with the process."""
    for thing in things:
        ffi.gc(thing, None)


def _field_offsets(
    thing: Any, doubles: int, marks: dict[str, float], begin: int = 0
) -> dict[str, int]:
    """Return the first offset of each mark in a struct from `begin` on, counted in doubles.

    Copies that Munk2D keeps of a value stand behind it, except those that a struct begins with.
    """
    raw = np.frombuffer(ctypes.string_at(int(address_of_struct(thing)), 8 * doubles))
    found = {name: begin + np.flatnonzero(raw[begin:] == value) for name, value in marks.items()}
    missing = [name for name, places in found.items() if not len(places)]
    if missing:
        raise ImportError(
            f"pymunk {pymunk.version}: Munk2D has no {', '.join(missing)} where expected; "
            f"this release reads pymunk {PIN}"
        )
    return {name: int(places[0]) for name, places in found.items()}


def _find_body() -> Any:
    """Return the record of a cpBody: the fields of `_MARKS`, where Munk2D keeps them."""
    m = _MARKS
    body = pymunk.Body(m["mass"], m["moment"])
    body.position, body.velocity = (m["x"], m["y"]), (m["vx"], m["vy"])
    body.force = m["fx"], m["fy"]
    body.angle, body.angular_velocity, body.torque = m["angle"], m["w"], m["torque"]
    places = _field_offsets(body._body, BODY_DOUBLES, m)
    offsets = [8 * place for place in places.values()]
    form: Any = {"names": [*places], "formats": len(places) * ["f8"], "offsets": offsets}
    return np.dtype(form | {"itemsize": 8 * BODY_DOUBLES}, align=True)


def _find_shape_offsets() -> Any:
    """Return the offsets of the fields of shapes, in doubles.

    Ends and normal in a cpSegmentShape, place and radius in a cpCircleShape, the first corner in a
    cpPolyShape (x, y, nx, ny of each), and in all of them the friction and the group, whose members
    never touch each other.
    """
    static = pymunk.Body(body_type=pymunk.Body.STATIC)
    ends = {"ax": 1234.5, "ay": -777.25, "bx": 1237.5, "by": -773.25}  # 3, 4, 5: an exact normal
    segment = pymunk.Segment(static, (ends["ax"], ends["ay"]), (ends["bx"], ends["by"]), 0.0)
    marks = {**ends, "nx": segment.normal.x, "ny": segment.normal.y}
    disc = {"cx": 55.5, "cy": -66.25, "radius": 8.8125}
    circle = pymunk.Circle(static, disc["radius"], (disc["cx"], disc["cy"]))
    found = _field_offsets(segment._shape, SEGMENT_DOUBLES, marks)
    # What all shapes have comes first, a copy of the disc's place among it.
    found |= _field_offsets(circle._shape, CIRCLE_DOUBLES, disc, found["ax"])
    box = pymunk.Poly(static, [(-61.5, -43.25), (61.5, -43.25), (61.5, 43.25), (-61.5, 43.25)])
    corner = _field_offsets(box._shape, POLY_DOUBLES, {"x": -61.5, "y": -43.25, "ny": -1.0})
    box.friction = 0.34375
    mark = np.frombuffer(np.int64(0x2B67_0001_7A3C_9D15).tobytes())[0]  # no number but this one
    box.filter = pymunk.ShapeFilter(group=0x2B67_0001_7A3C_9D15)
    common = _field_offsets(
        box._shape, POLY_DOUBLES, {"friction": box.friction, "group": float(mark)}
    )
    return _named("ShapeOffsets", found | common | {"corners": corner["x"]})


def _named(name: str, offsets: dict[str, int]) -> Any:
    """Make a named tuple, whose values kernels take as constants."""
    kind: Any = namedtuple
    return kind(name, offsets)(**offsets)


def _find_counter() -> int:
    """Return the offset [words] of a cpSpace's count of the shapes that it was ever given."""
    space, body = pymunk.Space(), pymunk.Body(1.0, 1.0)
    space.add(body)
    counts = []
    for _ in range(4):
        raw = ctypes.string_at(int(address_of_struct(space._space)), 8 * SPACE_WORDS)
        counts.append(np.frombuffer(raw, np.int64))
        space.add(pymunk.Circle(body, 1.0))
    rises = np.flatnonzero((np.diff(counts, axis=0) == 1).all(axis=0))
    if len(rises) != 1:
        raise ImportError(
            f"pymunk {pymunk.version}: Munk2D's space has no counter of shapes where expected; "
            f"this release reads pymunk {PIN}"
        )
    return int(rises[0])


BODY = _find_body()
SHAPE = _find_shape_offsets()
COUNTER = _find_counter()


UNIT_BOX = ((-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5))  # m, as `set_box` orders corners
TINY = 2.2250738585072014e-308  # what Munk2D adds to a length before it divides by it


_ADDRESS, _NUMBER = types.uint64, types.float64
_IN_C = {_ADDRESS: cgutils.voidptr_t, _NUMBER: ir.DoubleType(), types.void: ir.VoidType()}


def _call_in_c(result: Any, *arguments: Any) -> Any:
    """Type and make the call of a C function at an address.

    The address is an argument, not a global, so that numba caches. A pair of doubles by value is
    two of them.
    """

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        kind = ir.FunctionType(_IN_C[result], [_IN_C[each] for each in arguments])
        given = [
            builder.inttoptr(value, cgutils.voidptr_t) if each is _ADDRESS else value
            for each, value in zip(arguments, args[1:], strict=True)
        ]
        made = builder.call(builder.inttoptr(args[0], kind.as_pointer()), given)
        if result is types.void:
            return context.get_dummy_value()
        return builder.ptrtoint(made, ir.IntType(64))

    return result(_ADDRESS, *arguments), codegen


# Calls of void f(void*, double), of f(void*, void*), and of void *f(void*, double, ...). numba
# gives these the arguments that their callers see; mypy knows only how they are declared.
_call_double: Callable[..., None] = intrinsic(
    lambda typingctx, function, space, dt: _call_in_c(types.void, _ADDRESS, _NUMBER)
)
_call_pair: Callable[..., None] = intrinsic(
    lambda typingctx, function, one, other: _call_in_c(types.void, _ADDRESS, _ADDRESS)
)
_make: Callable[..., np.uint64] = intrinsic(
    lambda typingctx, function, body, a, b, c, d, e: _call_in_c(_ADDRESS, _ADDRESS, *5 * [_NUMBER])
)

_FUNCTIONS = {
    "step": "cpSpaceStep",
    "add": "cpSpaceAddShape",
    "remove": "cpSpaceRemoveShape",
    "add_body": "cpSpaceAddBody",
    "remove_body": "cpSpaceRemoveBody",
    "reindex": "cpSpaceReindexShapesForBody",
    "turn": "cpBodySetAngle",
    "new_segment": "cpSegmentShapeNew",
    "new_circle": "cpCircleShapeNew",
}
ENGINE = np.dtype([(name, "u8") for name in _FUNCTIONS])
_bodies_at = rows_of(BODY)


@inlined
def body_view(address: np.uint64) -> Any:
    """Return the cpBody at an address, a record of BODY, to read and write in place."""
    return _bodies_at(address, 1)[0]


@borrowing_kernel
def step_space(step: np.uint64, space: np.uint64, dt: float) -> None:
    """Advance a cpSpace by dt seconds: pymunk's own `Space.step`."""
    _call_double(step, space, dt)


@borrowing_kernel
def change_space(function: np.uint64, space: np.uint64, thing: np.uint64) -> None:
    """Add or remove a shape or a body, by the function that pymunk's Space calls for it."""
    _call_pair(function, space, thing)


@borrowing_kernel
def set_shape_counter(space: np.uint64, first: int) -> None:
    """Set the number that a cpSpace gives to its next shape; the ones after it count on.

    Where three things touch, the order in which Munk2D solves goes by these numbers: a Space that
    is used again has to give those that a new one would.
    """
    integers_at(space, SPACE_WORDS)[COUNTER] = first


@borrowing_kernel
def set_segment(shape: np.uint64, x0: float, y0: float, x1: float, y1: float) -> None:
    """Give a cpSegmentShape other ends [m], as if it had been made with them.

    Munk2D's own cpSegmentShapeSetEndpoints turns the normal round, which its contacts then miss.
    """
    fields = doubles_at(shape, SEGMENT_DOUBLES)
    fields[SHAPE.ax], fields[SHAPE.ay] = x0, y0
    fields[SHAPE.bx], fields[SHAPE.by] = x1, y1
    ex, ey = x1 - x0, y1 - y0
    scale = 1.0 / (math.sqrt(ex * ex + ey * ey) + TINY)
    fields[SHAPE.nx], fields[SHAPE.ny] = ey * scale, -ex * scale


@borrowing_kernel
def set_circle(shape: np.uint64, x: float, y: float, radius: float) -> None:
    """Give a cpCircleShape another place on its body and another radius [m]."""
    fields = doubles_at(shape, CIRCLE_DOUBLES)
    fields[SHAPE.cx], fields[SHAPE.cy], fields[SHAPE.radius] = x, y, radius


@borrowing_kernel
def new_shape(make: np.uint64, body: np.uint64, like: np.uint64) -> np.uint64:
    """Make a segment or circle shape of a body, with friction and filter of another shape.

    `make` is the address of Munk2D's function; ends, or radius and place, are yet to be set.
    """
    shape = _make(make, body, 1.0, 0.0, 0.0, 1.0, 0.0)
    fields, others = integers_at(shape, CIRCLE_DOUBLES), integers_at(like, CIRCLE_DOUBLES)
    fields[SHAPE.friction] = others[SHAPE.friction]
    fields[SHAPE.group] = others[SHAPE.group]
    fields[SHAPE.group + 1] = others[SHAPE.group + 1]  # categories and mask
    return shape


def free_shapes(*tables: NDArray[np.uint64]) -> None:
    """Take shapes out of their Spaces and free them; addresses of 0 are skipped."""
    for table in tables:
        for address in table[table != 0].tolist():
            shape = ffi.cast("cpShape *", address)
            if lib.cpShapeGetSpace(shape) != ffi.NULL:
                lib.cpSpaceRemoveShape(lib.cpShapeGetSpace(shape), shape)
            lib.cpShapeFree(shape)


@borrowing_kernel
def set_box(shape: np.uint64, rear: float, front: float, half: float) -> None:
    """Give a cpPolyShape of four corners, from rear right, other ends and half a width [m]."""
    fields = doubles_at(shape, POLY_DOUBLES)
    x0, y0 = rear, half
    for k in range(4):
        x, y = front if k == 1 or k == 2 else rear, half if k > 1 else -half
        ex, ey = x - x0, y - y0
        scale = 1.0 / (math.sqrt(ex * ex + ey * ey) + TINY)
        place = SHAPE.corners + 4 * k
        fields[place], fields[place + 1] = x, y
        fields[place + 2], fields[place + 3] = ey * scale, -ex * scale
        x0, y0 = x, y


@borrowing_kernel
def set_friction(shape: np.uint64, friction: float, group: int) -> None:
    """Give a shape its friction, and the group within which nothing touches; 0: none."""
    doubles_at(shape, CIRCLE_DOUBLES)[SHAPE.friction] = friction
    integers_at(shape, CIRCLE_DOUBLES)[SHAPE.group] = group


@borrowing_kernel
def place_body(
    engine: Any, space: np.uint64, body: np.uint64, x: float, y: float, angle: float
) -> None:
    """Put a body at rest at (x, y) [m] and an angle [rad], with no force on it."""
    fields = body_view(body)
    fields.x, fields.y = x, y
    fields.vx, fields.vy, fields.w = 0.0, 0.0, 0.0
    fields.fx, fields.fy, fields.torque = 0.0, 0.0, 0.0
    _call_double(engine.turn, body, angle)
    _call_pair(engine.reindex, space, body)


@borrowing_kernel
def turn_body(engine: Any, body: np.uint64) -> None:
    """Update the values that Munk2D derives from a body's place and angle."""
    _call_double(engine.turn, body, body_view(body).angle)


@inlined
def move_freely(body: np.uint64, dt: float) -> None:
    """Move a body that nothing touches as `step_space` does, to the bit, without its Space."""
    fields = body_view(body)
    fields.x += fields.vx * dt
    fields.y += fields.vy * dt
    fields.angle += fields.w * dt
    fields.vx += fields.fx * fields.mass_inverse * dt
    fields.vy += fields.fy * fields.mass_inverse * dt
    fields.w += fields.torque * fields.moment_inverse * dt
    fields.fx, fields.fy, fields.torque = 0.0, 0.0, 0.0


@borrowing_kernel
def set_mass(body: np.uint64, mass: float, moment: float) -> None:
    """Give a body its mass [kg] and its moment of inertia [kg m2]; infinite ones: kinematic."""
    fields = body_view(body)
    fields.mass, fields.mass_inverse = mass, 1.0 / mass
    fields.moment, fields.moment_inverse = moment, 1.0 / moment


@borrowing_kernel
def _pushed_by_address(
    engine: Any,
    space: np.uint64,
    body: np.uint64,
    wall: np.uint64,
    disc: np.uint64,
    other: np.uint64,
    box: np.uint64,
    n: int,
) -> float:
    fields, pushed = body_view(body), body_view(other)
    set_mass(body, 10.0, 2.0)
    set_mass(other, 3.0, 0.5)
    set_box(box, -0.1, 0.1, 0.15)
    set_friction(box, 0.25, 0)
    change_space(engine.add_body, space, other)
    change_space(engine.add, space, box)
    place_body(engine, space, other, 0.72, -0.1, 0.1)
    set_segment(wall, 1.0, -5.0, 1.0, 5.0)
    set_circle(disc, 0.8, 0.45, 0.2)
    for shape in (wall, disc):
        change_space(engine.add, space, shape)
        change_space(engine.remove, space, shape)
        change_space(engine.add, space, shape)
    place_body(engine, space, body, 0.1, -0.05, 0.2)
    for k in range(n):
        fields.fx = 40.0
        fields.torque = 3.0 * (k % 3)
        step_space(engine.step, space, 0.01)
    return float(fields.x + fields.y + fields.angle + pushed.x + pushed.y + pushed.angle)


def engine_record() -> NDArray[np.void]:
    """Return the addresses of Munk2D's functions (1,), a record of ENGINE."""
    addresses = (address_of_struct(ffi.addressof(lib, name)) for name in _FUNCTIONS.values())
    return np.array([tuple(addresses)], ENGINE)


def self_test() -> None:
    """Push a box against another, a wall and a disc both ways and compare.

    Raises:
        ImportError: compiled code and pymunk's API disagree.
    """
    ends = []
    for by_address in (True, False):
        space = pymunk.Space()
        static = space.static_body
        if by_address:
            body = pymunk.Body(1.0, 1.0)
            space.add(body, pymunk.Poly.create_box(body, (1.0, 0.6)))
            shapes = pymunk.Segment(static, (0, 0), (1, 1), 0.0), pymunk.Circle(static, 1.0)
            wall, disc = (address_of_struct(shape._shape) for shape in shapes)
            chair = address_of_struct(space._space), address_of_struct(body._body)
            other = pymunk.Body(1.0, 1.0)
            box = pymunk.Poly(other, UNIT_BOX)
            things = address_of_struct(other._body), address_of_struct(box._shape)
            ends.append(_pushed_by_address(engine_record()[0], *chair, wall, disc, *things, 60))
        else:
            body = pymunk.Body(10.0, 2.0)
            space.add(body, pymunk.Poly.create_box(body, (1.0, 0.6)))
            other = pymunk.Body(3.0, 0.5)
            box = pymunk.Poly(other, [(-0.1, -0.15), (0.1, -0.15), (0.1, 0.15), (-0.1, 0.15)])
            box.friction = 0.25
            space.add(other, box)
            other.position, other.angle = (0.72, -0.1), 0.1
            space.reindex_shapes_for_body(other)
            space.add(pymunk.Segment(static, (1.0, -5.0), (1.0, 5.0), 0.0))
            space.add(pymunk.Circle(static, 0.2, (0.8, 0.45)))
            body.position, body.angle = (0.1, -0.05), 0.2
            space.reindex_shapes_for_body(body)
            for k in range(60):
                body.force, body.torque = (40.0, 0.0), 3.0 * (k % 3)
                space.step(0.01)
            first = body.position.x + body.position.y + body.angle
            ends.append(first + other.position.x + other.position.y + other.angle)
    if ends[0] != ends[1]:
        raise ImportError(
            f"pymunk {pymunk.version}: stepping by address differs from its API by "
            f"{abs(ends[0] - ends[1]):g}; this release needs pymunk {PIN}"
        )


self_test()
