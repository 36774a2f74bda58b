"""A corridor of cylinders, drawn at random."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.config import InputError, setting, settings
from wheelchair_gym.geometry import Footprint
from wheelchair_gym.maps import geodesic
from wheelchair_gym.scenes.arena import make_arena, poses_along
from wheelchair_gym.scenes.poses import FOOTPRINT
from wheelchair_gym.types import Episode

Array = NDArray[np.float64]

_TRIES = 50  # corridors drawn before the settings are called impossible
_PLACES = 10  # drawn for one cylinder before it is left out
_CLUSTERED = 0.4  # share of cylinders beside another: clusters block more than single ones
_OVERLAP = 0.9  # of the sum of radii: how far apart cylinders of a cluster stand
_RUN = 1.4  # m, without cylinders, ahead of the start and before the goal
_ENDS = 1.2  # m, from start and goal to the end walls


@settings
class Clutter:
    """Random cylinders between two walls; the goal lies straight ahead, as in BARN's worlds.

    Solvable for a disc of the chair's inscribed radius and a margin.
    """

    length: float = setting(
        default=10.0, unit="m", source="start to goal: BARN", low=4.0, high=50.0
    )
    width: float = setting(default=4.5, unit="m", source="BARN's corridor", low=1.5, high=30.0)
    density: float = setting(default=0.4, unit="1/m2", source="cylinders", low=0.0, high=5.0)
    radius: tuple[float, float] = setting(
        default=(0.075, 0.25), unit="m", source="from BARN's cylinders up", low=0.03, high=1.0
    )
    min_gap: float = setting(
        default=0.9, unit="m", source="between cylinders that do not overlap", low=0.0, high=3.0
    )
    passage_margin: float = setting(
        default=0.10, unit="m", source="beyond half the chair's width", low=0.0, high=0.5
    )

    def __post_init__(self) -> None:
        if self.radius[0] > self.radius[1]:
            raise InputError(f"Clutter.radius is {self.radius}; expected from, to")

    def _discs(self, rng: np.random.Generator) -> Array:
        """Cylinders (m, 3), each alone or overlapping others, with gaps as set."""
        low, high = _ENDS + _RUN, _ENDS + self.length - _RUN
        discs = np.empty((0, 3))
        for _ in range(round(self.density * (high - low) * self.width)):
            for _ in range(_PLACES):
                radius = rng.uniform(*self.radius)
                if len(discs) and rng.random() < _CLUSTERED:
                    x, y, r = discs[rng.integers(len(discs))]
                    angle = rng.uniform(-math.pi, math.pi)
                    x, y = (
                        x + _OVERLAP * (r + radius) * math.cos(angle),
                        y + _OVERLAP * (r + radius) * math.sin(angle),
                    )
                else:
                    x, y = rng.uniform(low, high), rng.uniform(0.0, self.width)
                gaps = np.hypot(discs[:, 0] - x, discs[:, 1] - y) - discs[:, 2] - radius
                gaps = np.append(gaps, [y - radius, self.width - y - radius])
                if low <= x <= high and ((gaps <= 0.0) | (gaps >= self.min_gap)).all():
                    discs = np.vstack([discs, (x, y, radius)])
                    break
        return discs

    def sample(self, rng: np.random.Generator, footprint: Footprint = FOOTPRINT) -> Episode:
        """Draw corridors until one can be passed by a chair of this footprint.

        Raises:
            InputError: fifty could not.
        """
        start, goal = poses_along((_ENDS, self.width / 2), (_ENDS + self.length, self.width / 2))
        for _ in range(_TRIES):
            discs = self._discs(rng)
            ground = make_arena((0.0, 0.0, self.length + 2 * _ENDS, self.width), discs=discs)
            ways = geodesic(ground.map, goal, footprint.half_width + self.passage_margin)
            if np.isfinite(ways.at(start[:2])):
                return Episode(ground.map, start, goal, ground.walls, discs, name="clutter")
        raise InputError(
            f"Clutter: none of {_TRIES} corridors could be passed by {footprint} with {self}"
        )
