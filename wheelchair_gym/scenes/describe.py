"""What a generator draws: the figures without which no success rate means anything."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from wheelchair_gym.maps import OCCUPIED, bottleneck, geodesic
from wheelchair_gym.scenes import FloorPlan, Scene
from wheelchair_gym.scenes.poses import FOOTPRINT, RADIUS


def measure(scene: Scene, seeds: Iterable[int]) -> dict[str, list[float]]:
    """Figures of the worlds drawn with these seeds, by name and unit.

    Doors and corridors are known of floor plans only. The bottleneck is the narrowest spot of the
    widest way, less half the chair's width; density is the share of the map that is occupied.
    """
    names = ("way [m]", "bottleneck margin [m]", "density", "walls", "discs", "start to goal [m]")
    table: dict[str, list[float]] = {name: [] for name in names}
    for seed in seeds:
        if isinstance(scene, FloorPlan):
            layout, episode = scene.storey(np.random.default_rng(seed))
            widths = [door.width for door in layout.doors if door.leaf]
            table.setdefault("door width [m]", []).extend(widths)
            table.setdefault("corridor width [m]", []).extend(layout.corridor_widths)
            table.setdefault("rooms", []).append(len(layout.rooms))
        else:
            episode = scene.sample(np.random.default_rng(seed))
        start, goal = episode.start[:2], episode.goal[:2]
        way = float(geodesic(episode.map, goal, RADIUS).at(start))
        margin = bottleneck(episode.map, start, goal) - FOOTPRINT.half_width
        density = float((episode.map.cells == OCCUPIED).mean())
        direct = float(np.hypot(*(goal - start)))
        row = (way, margin, density, len(episode.walls), len(episode.discs), direct)
        for name, value in zip(names, row, strict=True):
            table[name].append(float(value))
    return table
