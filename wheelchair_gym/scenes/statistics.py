"""Statistics of the worlds that a scene draws: doors, corridors, density, bottlenecks."""

from collections.abc import Iterable
from typing import Any

import numpy as np

from wheelchair_gym.actors import records
from wheelchair_gym.geometry.planar import path_length
from wheelchair_gym.maps import OCCUPIED, bottleneck, geodesic
from wheelchair_gym.scenes import Mixture, Scene, arena, crowd, floor_plan, pedestrians
from wheelchair_gym.types import Episode


def scene_statistics(scene: Scene, seeds: Iterable[int]) -> dict[str, list[float]]:
    """Figures of the worlds drawn with these seeds, by name and unit.

    Buildings have figures of doors and corridors, scenes with actors have figures of these. The
    bottleneck is half the width of the widest path at its narrowest point, less half the chair's
    width; density is the share of the map that is occupied.
    """
    table: dict[str, list[float]] = {}
    for seed in seeds:
        for name, values in _figures(scene, np.random.default_rng(seed)).items():
            table.setdefault(name, []).extend(np.atleast_1d(values).tolist())
    return {name: values for name, values in table.items() if any(values) or name in _ALWAYS}


_HABITS = (
    ("behaviour", records.BEHAVIOURS, records.WALKS),
    ("reaction", records.REACTIONS, records.REGULAR),
)
_ALWAYS = {"way [m]", "bottleneck margin [m]", "density", "walls", "discs", "start to goal [m]"}


def _figures(scene: Scene, rng: np.random.Generator) -> dict[str, Any]:
    """Figures of one world: numbers, or one number for each door, corridor, person ..."""
    while isinstance(scene, Mixture):
        scene = scene.draw_scene(rng)
    moves = isinstance(scene, crowd.Crowd | crowd.Temporary)
    layout = None
    if isinstance(scene, floor_plan.FloorPlan | crowd.Crowd | crowd.Temporary):
        layout, episode = scene.sample_building(rng)
    else:
        episode = scene.sample(rng)
    start, goal = episode.start[:2], episode.goal[:2]
    figures: dict[str, Any] = {
        "way [m]": geodesic(episode.map, goal, arena.passing_radius(arena.FOOTPRINT)).at(start),
        "bottleneck margin [m]": bottleneck(episode.map, start, goal) - arena.FOOTPRINT.half_width,
        "density": (episode.map.cells == OCCUPIED).mean(),
        "walls": len(episode.walls),
        "discs": len(episode.discs),
        "start to goal [m]": np.hypot(*(goal - start)),
    }
    if layout is not None:
        figures["door width [m]"] = layout.opening_widths[layout.is_door]
        figures["corridor width [m]"] = layout.corridor_widths
        figures["rooms"] = len(layout.rooms)
    elif isinstance(scene, arena.Doorway):
        figures["door width [m]"] = scene.door_width
        figures["corridor width [m]"] = scene.corridor_width
        figures["margin round the corner [m]"] = scene.margin()
    return figures | _actor_figures(episode) if moves or len(episode.actors) else figures


def _actor_figures(episode: Episode) -> dict[str, Any]:
    """Figures of people, doors and obstacles of one world."""
    rows = episode.actors.rows
    of = {name: rows[rows["kind"] == kind] for kind, name in enumerate(records.ACTOR_KINDS)}
    people, obstacles = of["person"], of["obstacle"]
    led = np.flatnonzero((rows["kind"] == records.PERSON) & (rows["leader"] > 0))
    routes = [episode.actors.route(int(k)) for k in np.flatnonzero(rows["kind"] == records.PERSON)]
    return {
        "people": len(people),
        "people per free m2": len(people) / pedestrians.free_area(episode.map),
        "people who pay no attention": (people["avoids"] == records.PEOPLE).sum(),
        "crossing cylinders": (people["avoids"] == records.NOBODY).sum(),
        "people in groups": len(np.union1d(led, led - rows["leader"][led])),
        "trolleys": (of["furniture"]["leader"] > 0).sum(),
        **{
            f"people: {name.replace('_', ' ')}": (people[column] == k).sum()
            for column, names, usual in _HABITS
            for k, name in enumerate(names)
            if k != usual
        },
        "walking speed [m/s]": people["speed"],
        "length of their routes [m]": [path_length(route) for route in routes],
        "doors with a leaf": len(of["door"]),
        "light furniture": (of["furniture"]["leader"] == 0).sum(),
        "obstacles that appear": len(obstacles),
        "radius of these [m]": obstacles["size"][:, 0],
        "stay of these [s]": obstacles["stay"],
    }
