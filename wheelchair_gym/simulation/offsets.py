"""Where Munk2D keeps the fields of its structs: found at import, by marks set through its API."""

from __future__ import annotations

import ctypes
from typing import Any, NamedTuple

import numpy as np
import pymunk
from pymunk._chipmunk_cffi import ffi

PIN = ">=7.3,<7.4"
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


class ShapeOffsets(NamedTuple):
    """Where the fields of cpSegmentShape (ends, normal) and cpCircleShape stand, in doubles.

    Then where a quadrangle's corners and normals begin (x, y, nx, ny of each) in a cpPolyShape, and
    what all shapes have: friction, and the group whose members never touch each other.
    """

    ax: int
    ay: int
    bx: int
    by: int
    nx: int
    ny: int
    cx: int
    cy: int
    radius: int
    corners: int
    friction: int
    group: int


def pointer(thing: Any) -> np.uint64:
    """The address of a cffi pointer."""
    return np.uint64(int(ffi.cast("uintptr_t", thing)))


def _places(thing: Any, doubles: int, marks: dict[str, float], begin: int = 0) -> dict[str, int]:
    """Where the marks stand in a struct, counted in doubles: the first place of each.

    Copies that Munk2D keeps of a value stand behind it, but for what it begins with.
    """
    raw = np.frombuffer(ctypes.string_at(int(pointer(thing)), 8 * doubles))
    found = {name: begin + np.flatnonzero(raw[begin:] == value) for name, value in marks.items()}
    missing = [name for name, places in found.items() if not len(places)]
    if missing:
        raise ImportError(
            f"pymunk {pymunk.version}: Munk2D has no {', '.join(missing)} where expected; "
            f"this release reads pymunk {PIN}"
        )
    return {name: int(places[0]) for name, places in found.items()}


def _find_offsets() -> Offsets:
    m = _MARKS
    body = pymunk.Body(m["mass"], m["moment"])
    body.position, body.velocity, body.force = (
        (m["x"], m["y"]),
        (m["vx"], m["vy"]),
        (m["fx"], m["fy"]),
    )
    body.angle, body.angular_velocity, body.torque = m["angle"], m["w"], m["torque"]
    return Offsets(**_places(body._body, BODY_DOUBLES, m))


def _find_shape_offsets() -> ShapeOffsets:
    static = pymunk.Body(body_type=pymunk.Body.STATIC)
    ends = {"ax": 1234.5, "ay": -777.25, "bx": 1237.5, "by": -773.25}  # 3, 4, 5: an exact normal
    segment = pymunk.Segment(static, (ends["ax"], ends["ay"]), (ends["bx"], ends["by"]), 0.0)
    normal = segment.normal
    disc = {"cx": 55.5, "cy": -66.25, "radius": 8.8125}
    circle = pymunk.Circle(static, disc["radius"], (disc["cx"], disc["cy"]))
    own = _places(segment._shape, SEGMENT_DOUBLES, {**ends, "nx": normal.x, "ny": normal.y})
    # What all shapes have comes first, a copy of the disc's place among it.
    own |= _places(circle._shape, CIRCLE_DOUBLES, disc, own["ax"])
    box = pymunk.Poly(static, [(-61.5, -43.25), (61.5, -43.25), (61.5, 43.25), (-61.5, 43.25)])
    corner = _places(box._shape, POLY_DOUBLES, {"x": -61.5, "y": -43.25, "ny": -1.0})
    box.friction = 0.34375
    mark = np.frombuffer(np.int64(0x2B67_0001_7A3C_9D15).tobytes())[0]  # no number but this one
    box.filter = pymunk.ShapeFilter(group=0x2B67_0001_7A3C_9D15)
    common = _places(box._shape, POLY_DOUBLES, {"friction": box.friction, "group": float(mark)})
    return ShapeOffsets(**own, corners=corner["x"], **common)


def _find_counter() -> int:
    """Where a cpSpace counts the shapes that it was ever given, in words."""
    space, body = pymunk.Space(), pymunk.Body(1.0, 1.0)
    space.add(body)
    told = []
    for _ in range(4):
        raw = ctypes.string_at(int(pointer(space._space)), 8 * SPACE_WORDS)
        told.append(np.frombuffer(raw, np.int64))
        space.add(pymunk.Circle(body, 1.0))
    rises = np.flatnonzero((np.diff(told, axis=0) == 1).all(axis=0))
    if len(rises) != 1:
        raise ImportError(
            f"pymunk {pymunk.version}: Munk2D's space has no counter of shapes where expected; "
            f"this release reads pymunk {PIN}"
        )
    return int(rises[0])


OFFSETS = _find_offsets()
SHAPE = _find_shape_offsets()
COUNTER = _find_counter()
