"""Worlds in pymunk: one Space for each chair, furnished anew at each reset.

A Space keeps more than its shapes: contact caches, the order of the broad phase. The canonical
entry leaves none of it: the chair goes far away, all walls and discs are taken out and the next
ones put in, in order; one step, and the chair stands at its start. What follows is then the same
to the bit as in a Space made for this episode alone, and costs no Python.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pymunk
from numpy.typing import NDArray

from wheelchair_gym.address import address_of, integers_at, table_at
from wheelchair_gym.geometry import Footprint
from wheelchair_gym.kernel import borrowing_kernel
from wheelchair_gym.simulation.engine import (
    add_shape,
    place,
    pointer,
    remove_shape,
    set_circle,
    set_segment,
    step_space,
    weigh,
)

Array = NDArray[np.float64]

WORLD = np.dtype(
    [
        ("space", "u8"),  # addresses of the cpSpace, of the chair's cpBody,
        ("body", "u8"),
        ("segments", "u8"),  # and of the addresses of spare cpSegmentShapes and cpCircleShapes
        ("circles", "u8"),
        ("walls_in", "i8"),  # how many of these are in the Space
        ("discs_in", "i8"),
        ("walls", "u8"),  # addresses of the walls (n, 4) and discs (m, 3) of this episode [m]
        ("discs", "u8"),
        ("n_walls", "i8"),
        ("n_discs", "i8"),
    ],
    align=True,
)

_FAR = 1e4  # m: where no wall is
_SLOP = 1e-4  # m: overlap that contacts leave
_BIAS = 1e-4  # share of a remaining overlap after one second: pushed out within a few steps
_SPARE = 1.25  # of shapes made at once: the next world may be a little larger


@borrowing_kernel
def furnish(engine: Any, world: Any) -> None:
    """Take all walls and discs out of a world's Space and put this episode's in, in order."""
    segments = integers_at(world.segments, max(world.walls_in, world.n_walls))
    circles = integers_at(world.circles, max(world.discs_in, world.n_discs))
    for k in range(world.walls_in):
        remove_shape(engine.remove, world.space, np.uint64(segments[k]))
    for k in range(world.discs_in):
        remove_shape(engine.remove, world.space, np.uint64(circles[k]))
    walls = table_at(world.walls, world.n_walls, 4)
    discs = table_at(world.discs, world.n_discs, 3)
    for k in range(world.n_walls):
        shape = np.uint64(segments[k])
        set_segment(shape, walls[k, 0], walls[k, 1], walls[k, 2], walls[k, 3])
        add_shape(engine.add, world.space, shape)
    for k in range(world.n_discs):
        shape = np.uint64(circles[k])
        set_circle(shape, discs[k, 0], discs[k, 1], discs[k, 2])
        add_shape(engine.add, world.space, shape)
    world.walls_in, world.discs_in = world.n_walls, world.n_discs


@borrowing_kernel
def enter(engine: Any, world: Any, p: Any, x: float, y: float, yaw: float) -> None:
    """Canonical entry: a furnished world whose chair stands at a pose [m, m, rad], at rest."""
    weigh(world.body, p.mass, p.moment)
    place(engine, world.space, world.body, _FAR, _FAR, 0.0)
    furnish(engine, world)
    step_space(engine.step, world.space, p.dt)
    c, s = math.cos(yaw), math.sin(yaw)
    place(engine, world.space, world.body, x + p.centre * c, y + p.centre * s, yaw)


class World:
    """A pymunk Space with one body of the chair's outline, and shapes in store for any walls.

    The body's position is its centre of mass, `centre` metres ahead of the drive axle.

    Args:
        footprint: the chair's outline.
        centre: of mass, ahead of the axle [m].
        friction: of the outline on walls.
        rows: (1,) the record of WORLD that points here.
    """

    def __init__(
        self, footprint: Footprint, centre: float, friction: float, rows: NDArray[np.void]
    ) -> None:
        self.space = pymunk.Space()
        self.space.collision_slop = _SLOP
        self.space.collision_bias = _BIAS
        self.body = pymunk.Body(1.0, 1.0)
        outline = pymunk.Poly(self.body, [(x - centre, y) for x, y in footprint.corners])
        outline.friction = self._friction = friction
        self.space.add(self.body, outline)
        self._segments: list[pymunk.Shape] = []
        self._circles: list[pymunk.Shape] = []
        self._addresses: list[NDArray[np.uint64]] = [np.empty(0, np.uint64)] * 2
        self._rows = rows
        rows["space"], rows["body"] = pointer(self.space._space), pointer(self.body._body)

    def make_room(self, walls: int, discs: int) -> None:
        """Have shapes in store for so many walls and discs, ahead of a `furnish`."""
        static = self.space.static_body
        short = walls - len(self._segments), discs - len(self._circles)
        if short[0] > 0:
            count = round(_SPARE * walls) - len(self._segments)
            self._segments += [pymunk.Segment(static, (0, 0), (1, 0), 0.0) for _ in range(count)]
            self._store("segments", 0, self._segments, count)
        if short[1] > 0:
            count = round(_SPARE * discs) - len(self._circles)
            self._circles += [pymunk.Circle(static, 1.0) for _ in range(count)]
            self._store("circles", 1, self._circles, count)

    def _store(self, name: str, which: int, shapes: list[pymunk.Shape], new: int) -> None:
        for shape in shapes[-new:]:
            shape.friction = self._friction
        fresh = np.array([pointer(shape._shape) for shape in shapes[-new:]], np.uint64)
        self._addresses[which] = np.concatenate([self._addresses[which], fresh])
        self._rows[name] = address_of(self._addresses[which])
