"""Several scenes as one: each world is drawn from one of them."""

from __future__ import annotations

from typing import Any

import numpy as np

from wheelchair_gym.config import InputError, setting, settings
from wheelchair_gym.geometry import Footprint
from wheelchair_gym.scenes.poses import FOOTPRINT
from wheelchair_gym.types import Episode


@settings
class Mixture:
    """Worlds of several scenes, each drawn with its share."""

    scenes: tuple[Any, ...] = setting(
        default=("floor_plan", "clutter"), source="names, or mappings with a name"
    )
    weights: tuple[float, ...] = setting(
        default=(0.6, 0.4), source="of worlds; they need not sum to 1", low=0.0
    )

    def __post_init__(self) -> None:
        if not self.scenes or len(self.scenes) != len(self.weights) or sum(self.weights) <= 0.0:
            raise InputError(
                f"Mixture.weights is {self.weights}; expected one for each of {len(self.scenes)} "
                "scenes (1 at least), not all 0"
            )
        from wheelchair_gym.scenes import make_scene

        object.__setattr__(self, "_made", tuple(make_scene(scene) for scene in self.scenes))

    def sample(self, rng: np.random.Generator, footprint: Footprint = FOOTPRINT) -> Episode:
        """Draw a scene, and a world of it for a chair of this footprint."""
        shares = np.array(self.weights)
        which = int(rng.choice(len(shares), p=shares / shares.sum()))
        made: Any = vars(self)["_made"]
        episode: Episode = made[which].sample(rng, footprint)
        return episode
