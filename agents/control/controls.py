"""The control generator as a follower: commands made anew from where the chair is."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from agents.control.follower import near_of
from agents.control.local_map import Surroundings
from agents.control.reference import Reference
from agents.control.rollout import Motion, stops_clear
from planners.controls.generator import ControlGenerator, Controls
from planners.swarm.woa import WhaleSettings
from wheelchair_gym.config import setting, settings
from wheelchair_gym.geometry import to_world
from wheelchair_gym.types import no_walls

Array = NDArray[np.float64]


@settings
class ControlsFollower:
    """Whales search commands (v, w, t) along the path's next metres; driven until the next search.

    The thesis generates commands for the whole path once; a chair whose pose errs has to do so
    again and again.
    """

    generator: ControlGenerator = ControlGenerator(
        whales=WhaleSettings(population=10, iterations=5), horizon=2.0, margin=0.06
    )
    seed: int = setting(default=0, low=0, source="of the whales, anew for every path")
    again: float = setting(default=0.5, unit="s", low=0.1, source="five control periods")
    margin: float = setting(default=0.04, unit="m", low=0.0, source="laser sigma 15 mm, 3 sigma")

    def make(self) -> GeneratedControls:
        """A follower at rest."""
        return GeneratedControls(self)


class GeneratedControls:
    """Drives the commands generated last."""

    def __init__(self, own: ControlsFollower) -> None:
        self.own = own
        self._rng = np.random.default_rng(own.seed)
        self._controls: Controls | None = None
        self._age = 0.0  # s since they were generated

    def twist(self, around: Surroundings, reference: Reference, chair: Motion) -> Array | None:
        """See `Follower.twist`."""
        self._age += chair.period
        twist = self._next(chair)
        if (
            self._age >= self.own.again
            or twist is None
            or not self._clear(twist, around, reference, chair)
        ):
            self._generate(around, reference, chair)
            twist = self._next(chair)
        return twist if twist is not None and self._clear(twist, around, reference, chair) else None

    def _next(self, chair: Motion) -> Array | None:
        """What is asked for in the middle of the coming period; None after the end."""
        controls = self._controls
        if controls is None or self._age >= controls.commands[:, 2].sum():
            return None
        return controls.twist_at(self._age + 0.5 * chair.period)

    def _clear(
        self, twist: Array, around: Surroundings, reference: Reference, chair: Motion
    ) -> bool:
        near = near_of(around, reference)
        hold = 2 * chair.period
        return bool(stops_clear(twist[0], twist[1], chair.body, near, hold, self.own.margin))

    def _generate(self, around: Surroundings, reference: Reference, chair: Motion) -> None:
        points = to_world(around.points[:, :2], around.pose)
        discs = np.column_stack([points, np.zeros(len(points))])
        path = reference.rows[reference.at :, :2]
        if len(path) < 2:
            path = np.concatenate([around.pose[None, :2], reference.rows[-1:, :2]])
        self._controls = self.own.generator.generate(
            path, around.pose, no_walls(), discs, chair.outline, chair.limits, self._rng,
            chair.state[[0, 2]],
        )  # fmt: skip
        self._age = 0.0
