"""Scenes: settings that draw worlds, each a pure function of a random generator."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final, Protocol

import numpy as np

from wheelchair_gym.config import InputError, load, setting, settings
from wheelchair_gym.errors import shown
from wheelchair_gym.geometry import Footprint
from wheelchair_gym.scenes.arena import Clutter, Doorway, EmptyRoom
from wheelchair_gym.scenes.barn import Barn
from wheelchair_gym.scenes.crowd import Crowd, Temporary
from wheelchair_gym.scenes.floor_plan import FloorPlan
from wheelchair_gym.scenes.map_file import MapFile
from wheelchair_gym.scenes.poses import FOOTPRINT
from wheelchair_gym.scenes.published import LAB_MAPS, THESIS_MAPS, ChaoticPso, DesignLab, GreyWolf
from wheelchair_gym.types import Episode

__all__ = [
    "SCENES",
    "Barn",
    "ChaoticPso",
    "Clutter",
    "Crowd",
    "DesignLab",
    "Doorway",
    "EmptyRoom",
    "FloorPlan",
    "GreyWolf",
    "MapFile",
    "Mixture",
    "Scene",
    "Temporary",
    "make_scene",
]


class Scene(Protocol):
    """A frozen settings object that draws worlds: same rng state, same episode."""

    def sample(self, rng: np.random.Generator, footprint: Footprint = FOOTPRINT) -> Episode:
        """Draw a world, a start and a goal for a chair of this footprint.

        Raises:
            InputError: the settings leave no world that fits it.
        """
        ...


@settings
class Mixture:
    """Worlds of several scenes, each drawn with its share."""

    scenes: tuple[Any, ...] = setting(
        default=("floor_plan", "clutter"),
        doc="Scenes, as names or as objects with a name.",
        source="design choice",
    )
    weights: tuple[float, ...] = setting(
        default=(0.6, 0.4), low=0.0,
        doc="Relative frequency of each scene; their sum is not restricted.",
        source="design choice",
    )  # fmt: skip

    def __post_init__(self) -> None:
        if not self.scenes or len(self.scenes) != len(self.weights) or sum(self.weights) <= 0.0:
            raise InputError(
                f"Mixture.weights is {self.weights}; expected one for each of {len(self.scenes)} "
                "scenes (1 at least), not all 0"
            )
        object.__setattr__(self, "_made", tuple(make_scene(scene) for scene in self.scenes))

    def sample(self, rng: np.random.Generator, footprint: Footprint = FOOTPRINT) -> Episode:
        """Draw a scene, and a world of it for a chair of this footprint."""
        weights = np.array(self.weights)
        which = int(rng.choice(len(weights), p=weights / weights.sum()))
        made: Any = vars(self)["_made"]
        episode: Episode = made[which].sample(rng, footprint)
        return episode


SCENES: Final[dict[str, type[Scene]]] = {
    "floor_plan": FloorPlan,
    "clutter": Clutter,
    "crowd": Crowd,
    "temporary": Temporary,
    "doorway": Doorway,
    "empty": EmptyRoom,
    "mixture": Mixture,
    "map_file": MapFile,
    "barn": Barn,
    "chaotic_pso": ChaoticPso,
    "grey_wolf": GreyWolf,
    "design_lab": DesignLab,
    **LAB_MAPS,
    **THESIS_MAPS,
}


def make_scene(spec: str | Mapping[str, Any] | Scene) -> Scene:
    """A scene from its name, from a mapping {"name": ..., settings}, or as it is.

    Raises:
        InputError: the name is unknown, or a setting is not what it should be.
    """
    if isinstance(spec, str):
        spec = {"name": spec}
    if not isinstance(spec, Mapping):
        if not hasattr(spec, "sample"):
            raise InputError(
                f"scene is {shown(spec)}; expected a name, an object with a name or a scene"
            )
        return spec
    name = spec.get("name")
    if not isinstance(name, str) or name not in SCENES:
        raise InputError(f"scene.name is {shown(name)}; it must be one of {', '.join(SCENES)}")
    given = {key: value for key, value in spec.items() if key != "name"}
    return load(SCENES[name], given, f"scene {name}")
