"""Surveys: maps built from a recorded log, and how well scans kept out of them lie on them."""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from wheelchair_gym.geometry import to_world
from wheelchair_gym.localization.logs import SensorLog
from wheelchair_gym.localization.occupancy import MappingSettings, OccupancyMap, read_scan
from wheelchair_gym.localization.slam import Slam, SlamSettings
from wheelchair_gym.maps import OCCUPIED, OccupancyGrid
from wheelchair_gym.sensors.settings import LaserSettings

Array = NDArray[np.float64]

HOLD = 10  # of so many scans, one is kept out of the map


@dataclass(frozen=True)
class Survey:
    """A map, the way driven, and how well they agree with scans that the map has not seen."""

    name: str
    grid: OccupancyGrid
    trail: Array  # (scans, 3) m, m, rad
    residuals: Array  # (n,) m: from each held-out beam's end to the nearest occupied cell's centre
    speed: float  # times real time

    @property
    def figures(self) -> dict[str, Any]:
        """The figures as JSON takes them."""
        some = len(self.residuals) > 0
        return {
            "name": self.name,
            "residual_median": float(np.median(self.residuals)) if some else None,
            "residual_mean": float(self.residuals.mean()) if some else None,
            "beams": len(self.residuals),
            "occupied_cells": int((self.grid.cells == OCCUPIED).sum()),
            "real_time_factor": self.speed if math.isfinite(self.speed) else None,
        }

    @property
    def line(self) -> str:
        """The figures as people read them."""
        of = self.figures
        if of["residual_median"] is None:
            told = "no residual: nothing occupied, or no held-out echo"
        else:
            told = (
                f"median {100 * of['residual_median']:.2f} cm, "
                f"mean {100 * of['residual_mean']:.2f} cm"
            )
        return (
            f"{self.name:<22}{told}; {of['occupied_cells']} cells occupied; "
            f"{self.speed:.0f} x real time"
        )


def held_out(scan: int) -> bool:
    """Whether a scan is kept out of the maps."""
    return scan % HOLD == HOLD - 1


def progress(total: int, shown: bool, unit: str = "scan") -> Any:
    """A bar on standard error."""
    from tqdm import tqdm

    return tqdm(total=total, unit=unit, disable=not shown or not sys.stderr.isatty())


def _residuals(log: SensorLog, laser: LaserSettings, grid: OccupancyGrid, trail: Array) -> Array:
    solid = np.argwhere(grid.cells == OCCUPIED)
    ends = [
        to_world(read_scan(laser, log.ranges[k], 0.0).echoes, trail[k])
        for k in range(len(log.stamps))
        if held_out(k)
    ]
    if not len(solid) or not ends:
        return np.empty(0)
    away: Array = cKDTree(grid.to_world(solid)).query(np.concatenate(ends))[0]
    return away


def _surveyed(
    name: str,
    log: SensorLog,
    laser: LaserSettings,
    grid: OccupancyGrid,
    trail: Array,
    seconds: float,
) -> Survey:
    speed = float(log.stamps[-1]) / seconds
    return Survey(name, grid, trail, _residuals(log, laser, grid, trail), speed)


def by_odometry(log: SensorLog, laser: LaserSettings, mapping: MappingSettings) -> Survey:
    """The map that dead reckoning gives.

    Raises:
        InputError: the log has no scan to map.
    """
    trail = log.odometry
    OccupancyMap(mapping).integrate(read_scan(laser, log.ranges[0], mapping.free_range), trail[0])
    known = OccupancyMap(mapping)
    begun = time.perf_counter()
    for k, (pose, ranges) in enumerate(zip(trail, log.ranges, strict=True)):
        if not held_out(k):
            known.integrate(read_scan(laser, ranges, mapping.free_range), pose)
    seconds = time.perf_counter() - begun
    return _surveyed("odometry only", log, laser, known.to_grid(), trail, seconds)


def by_slam(
    log: SensorLog,
    laser: LaserSettings,
    own: SlamSettings,
    seed: int,
    tell: Callable[[Slam], object] = lambda slam: None,
) -> Survey:
    """The map that SLAM gives; held-out scans are matched with it, and never added to it.

    Args:
        log: what was recorded.
        laser: what recorded it.
        own: settings of the SLAM.
        seed: of its draws.
        tell: called after each scan.

    Raises:
        InputError: the log has no scan to map.
    """
    told = enumerate(zip(log.increments, log.ranges, strict=True))
    Slam(laser, own).update(np.zeros(3), np.full(laser.beams, laser.reach))  # compiles
    slam = Slam(laser, own, seed)
    seconds = 0.0
    for k, (increment, ranges) in told:
        begun = time.perf_counter()
        slam.update(increment, ranges, learn=not held_out(k))
        seconds += time.perf_counter() - begun
        tell(slam)
    many = own.particles > 1
    name = f"SLAM, {own.particles} particles" if many else "scan matching"
    return _surveyed(name, log, laser, slam.map, slam.trajectory, seconds)
