"""Statistics of the worlds that a scene draws: doors, corridors, density, bottlenecks."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from wheelchair_gym.geometry import path_length
from wheelchair_gym.maps import OCCUPIED, bottleneck, geodesic
from wheelchair_gym.physics.actors.records import ACTOR_KINDS, NOBODY, PEOPLE, PERSON
from wheelchair_gym.scenes import Scene
from wheelchair_gym.scenes.arena import Doorway
from wheelchair_gym.scenes.crowd import Crowd, Temporary, free_area
from wheelchair_gym.scenes.floor_plan import FloorPlan
from wheelchair_gym.scenes.layout import Building
from wheelchair_gym.scenes.poses import FOOTPRINT, passing_radius
from wheelchair_gym.types import Episode


def scene_statistics(scene: Scene, seeds: Iterable[int]) -> dict[str, list[float]]:
    """Figures of the worlds drawn with these seeds, by name and unit.

    Doors and corridors are known of buildings only. The bottleneck is the narrowest spot of the
    widest way, less half the chair's width; density is the share of the map that is occupied. What
    moves is told of scenes where anything does.
    """
    names = ("way [m]", "bottleneck margin [m]", "density", "walls", "discs", "start to goal [m]")
    table: dict[str, list[float]] = {name: [] for name in names}
    for seed in seeds:
        layout: Building | None = None
        if isinstance(scene, FloorPlan | Crowd | Temporary):
            layout, episode = scene.sample_building(np.random.default_rng(seed))
        else:
            episode = scene.sample(np.random.default_rng(seed))
        if layout is not None:
            widths = [door.width for door in layout.doors if door.leaf]
            table.setdefault("door width [m]", []).extend(widths)
            table.setdefault("corridor width [m]", []).extend(layout.corridor_widths)
            table.setdefault("rooms", []).append(len(layout.rooms))
        elif isinstance(scene, Doorway):
            table.setdefault("door width [m]", []).append(scene.door_width)
            table.setdefault("corridor width [m]", []).append(scene.corridor_width)
            table.setdefault("margin round the corner [m]", []).append(scene.margin)
        start, goal = episode.start[:2], episode.goal[:2]
        way = float(geodesic(episode.map, goal, passing_radius(FOOTPRINT)).at(start))
        margin = bottleneck(episode.map, start, goal) - FOOTPRINT.half_width
        density = float((episode.map.cells == OCCUPIED).mean())
        direct = float(np.hypot(*(goal - start)))
        row = (way, margin, density, len(episode.walls), len(episode.discs), direct)
        for name, value in zip(names, row, strict=True):
            table[name].append(float(value))
        if isinstance(scene, Crowd | Temporary):
            for name, values in _moving(episode).items():
                table.setdefault(name, []).extend(values)
    return {name: values for name, values in table.items() if name in names or any(values)}


def _moving(episode: Episode) -> dict[str, list[float]]:
    """Statistics of people, doors and obstacles of one world, by name and unit."""
    rows = episode.actors.rows
    of = {name: rows[rows["kind"] == kind] for kind, name in enumerate(ACTOR_KINDS)}
    people = of["person"]
    lengths = [
        path_length(episode.actors.route(int(k))) for k in np.flatnonzero(rows["kind"] == PERSON)
    ]
    avoids = people["avoids"]
    return {
        "people": [len(people)],
        "people per free m2": [len(people) / free_area(episode.map)],
        "people who pay no attention": [float((avoids == PEOPLE).sum())],
        "crossing cylinders": [float((avoids == NOBODY).sum())],
        "walking speed [m/s]": people["speed"].tolist(),
        "length of their routes [m]": lengths,
        "doors with a leaf": [len(of["door"])],
        "light furniture": [len(of["furniture"])],
        "obstacles that appear": [len(of["obstacle"])],
        "radius of these [m]": of["obstacle"]["size"][:, 0].tolist(),
        "stay of these [s]": of["obstacle"]["stay"].tolist(),
    }
