"""Worlds in pymunk: one Space each, with its walls, discs and the chair."""

from __future__ import annotations

import numpy as np
import pymunk
from numpy.typing import NDArray

from wheelchair_gym.geometry import Footprint
from wheelchair_gym.simulation.engine import pointer

Array = NDArray[np.float64]

_FAR = (1e4, 1e4)  # m: where no wall is
_SLOP = 1e-4  # m: overlap that contacts leave
_BIAS = 1e-4  # share of a remaining overlap after one second: pushed out within a few steps


class World:
    """A pymunk Space with static walls and discs, and one body of the chair's outline.

    The body's position is its centre of mass, `centre` metres ahead of the drive axle.
    """

    def __init__(
        self, walls: Array, discs: Array, footprint: Footprint, centre: float, friction: float
    ) -> None:
        self.space = pymunk.Space()
        self.space.collision_slop = _SLOP
        self.space.collision_bias = _BIAS
        static = self.space.static_body
        shapes: list[pymunk.Shape] = [
            pymunk.Segment(static, (x0, y0), (x1, y1), 0.0) for x0, y0, x1, y1 in walls.tolist()
        ]
        shapes += [pymunk.Circle(static, radius, (x, y)) for x, y, radius in discs.tolist()]
        self.body = pymunk.Body(1.0, 1.0)
        self.outline = pymunk.Poly(self.body, [(x - centre, y) for x, y in footprint.corners])
        for shape in [*shapes, self.outline]:
            shape.friction = friction
        self.space.add(self.body, self.outline, *shapes)
        self.centre = centre
        self.addresses = pointer(self.space._space), pointer(self.body._body)

    def enter(self, pose: Array, mass: float, moment: float, dt: float) -> None:
        """Put the chair at a pose (3,) at rest, so that what follows does not depend on the past.

        Canonical entry: far away at rest, one step, then the start at rest. It clears the contacts
        and the order of the broad phase that a used Space keeps.
        """
        self.body.mass, self.body.moment = mass, moment
        self._place(_FAR, 0.0)
        self.space.step(dt)
        x, y, yaw = pose.tolist()
        ahead = self.centre * np.array([np.cos(yaw), np.sin(yaw)])
        self._place((x + float(ahead[0]), y + float(ahead[1])), yaw)

    def _place(self, position: tuple[float, float], angle: float) -> None:
        body = self.body
        body.position, body.angle = position, angle
        body.velocity, body.angular_velocity = (0.0, 0.0), 0.0
        body.force, body.torque = (0.0, 0.0), 0.0
        self.space.reindex_shapes_for_body(body)
