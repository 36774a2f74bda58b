"""Worlds and chairs that several tests drive in."""

from __future__ import annotations

from typing import Any

import numpy as np

from wheelchair_gym.sensing import SensorSettings
from wheelchair_gym.simulation import ChairSettings, PhysicsSettings, SimulatedChair
from wheelchair_gym.types import Episode


def box(half: float = 5.0, start: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Episode:
    """A square room of 2 x half, without a map."""
    h = half
    walls = np.array([(-h, -h, h, -h), (h, -h, h, h), (h, h, -h, h), (-h, h, -h, -h)])
    return Episode(map=None, start=np.array(start), goal=np.zeros(3), walls=walls)  # type: ignore[arg-type]


def cluttered(seed: int, start: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Episode:
    """A room with rotated boxes and round posts about a free middle."""
    rng = np.random.default_rng(seed)
    walls = [box(6.0).walls]
    while len(walls) < 12:
        x, y = rng.uniform(-5, 5, 2)
        if np.hypot(x, y) < 1.7:
            continue
        t, a, b = rng.uniform(0, np.pi), *rng.uniform(0.1, 0.5, 2)
        corners = np.array([(-a, -b), (a, -b), (a, b), (-a, b)])
        turn = np.array([(np.cos(t), np.sin(t)), (-np.sin(t), np.cos(t))])
        points = corners @ turn + (x, y)
        walls.append(np.hstack([points, np.roll(points, -1, axis=0)]))
    angles = rng.uniform(-np.pi, np.pi, 5)
    radii = rng.uniform(0.05, 0.3, 5)
    discs = np.column_stack([3 * np.cos(angles), 3 * np.sin(angles), radii])
    return Episode(
        map=None,  # type: ignore[arg-type]
        start=np.array(start),
        goal=np.zeros(3),
        walls=np.vstack(walls),
        discs=discs,
    )


def exact_chair(step: float = 0.01, **chair: Any) -> SimulatedChair:
    """A chair whose sensors and wheels do not err."""
    sensors = SensorSettings(noise=False)
    return SimulatedChair(ChairSettings(**chair), sensors, PhysicsSettings(step=step))
