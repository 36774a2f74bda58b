"""Scenes: settings that draw worlds, each a pure function of a random generator."""

from collections.abc import Mapping
from typing import Any, Final, Protocol

import numpy as np

from wheelchair_gym.base.registry import Registry, in_module
from wheelchair_gym.base.settings import InputError, setting, settings
from wheelchair_gym.geometry.outline import Footprint
from wheelchair_gym.scenes.arena import FOOTPRINT
from wheelchair_gym.types import Episode

_PLACE = "wheelchair_gym.scenes"
SCENES: Final = Registry(
    "scene",
    {
        **in_module(_PLACE, "Mixture"),
        **in_module(f"{_PLACE}.arena", "Clutter Doorway"),
        "empty": f"{_PLACE}.arena:EmptyRoom",
        **in_module(f"{_PLACE}.barn", "Barn"),
        **in_module(f"{_PLACE}.crowd", "Crowd People Temporary"),
        **in_module(f"{_PLACE}.floor_plan", "FloorPlan"),
        **in_module(f"{_PLACE}.map_file", "MapFile"),
        **in_module(f"{_PLACE}.published", "ChaoticPso DesignLab GreyWolf"),
        **in_module(f"{_PLACE}.skill", "Skill"),
        **{f"lab_{k}": f"{_PLACE}.published:Lab{k}" for k in range(1, 4)},
        **{f"thesis_{k}": f"{_PLACE}.published:ThesisMap{k}" for k in range(1, 6)},
    },
    group="wheelchair_gym.scenes",
    needs=("sample",),
)


class Scene(Protocol):
    """A frozen settings object that draws worlds: same rng state, same episode."""

    def sample(self, rng: np.random.Generator, footprint: Footprint = FOOTPRINT) -> Episode:
        """Draw a world, a start and a goal for a chair of this footprint.

        Raises:
            InputError: the settings leave no world that fits it.
        """


@settings
class Mixture:
    """Worlds of several scenes, each drawn with its share."""

    scenes: tuple[Any, ...] = setting(default=("floor_plan", "clutter"))
    """Scenes, as names or as objects with a name."""
    weights: tuple[float, ...] = setting(default=(0.6, 0.4), low=0.0)
    """Relative frequency of each scene; their sum is not restricted."""

    def __post_init__(self) -> None:
        if not self.scenes or len(self.scenes) != len(self.weights) or sum(self.weights) <= 0.0:
            raise InputError(
                f"Mixture.weights is {self.weights}; expected one for each of {len(self.scenes)} "
                "scenes (1 at least), not all 0"
            )
        object.__setattr__(self, "_made", tuple(make_scene(scene) for scene in self.scenes))

    def sample(self, rng: np.random.Generator, footprint: Footprint = FOOTPRINT) -> Episode:
        """Draw a scene, and a world of it for a chair of this footprint."""
        return self.draw_scene(rng).sample(rng, footprint)

    def draw_scene(self, rng: np.random.Generator) -> Scene:
        """Draw a scene, as `sample` does first."""
        scene: Scene = vars(self)["_made"][self.which(rng)]
        return scene

    def which(self, rng: np.random.Generator) -> int:
        """Draw the number of a scene, as `sample` does first."""
        weights = np.array(self.weights)
        return int(rng.choice(len(weights), p=weights / weights.sum()))


def make_scene(spec: str | Mapping[str, Any] | Scene) -> Scene:
    """A scene from its name, from a mapping {"name": ..., settings}, or as it is.

    Raises:
        InputError: the name is unknown, or a setting is wrong.
    """
    if hasattr(spec, "sample"):
        return spec
    scene: Scene = SCENES.make(spec)
    return scene
