"""Maps that a chair builds, by driving or from a log, and how accurate they are.

A map of a scene is compared with the true world. Without one, scans that are held out of the map
are compared with it.
"""

import math
import sys
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
import shapely
from scipy.spatial import cKDTree
from tqdm import tqdm

from agents import is_interrupt
from agents.control.local_map import cells_at
from agents.policies import GymPolicy, Policy
from agents.watch import ignore
from planners.collision.space import Space
from wheelchair_gym.base.arrays import Array
from wheelchair_gym.base.settings import InputError
from wheelchair_gym.geometry.planar import to_world, wrap_angle
from wheelchair_gym.maps import FREE, OCCUPIED, OccupancyGrid, geodesic
from wheelchair_gym.perception.logs import SensorLog
from wheelchair_gym.perception.occupancy import MappingSettings, OccupancyMap, read_scan
from wheelchair_gym.perception.slam import Slam, SlamSettings
from wheelchair_gym.sensors.settings import LaserSettings
from wheelchair_gym.types import Episode

NO_TOLERANCE = 1e-9  # m: the goal is never reached, so that exploration goes on
_BLANK = OccupancyGrid(np.full((40, 40), FREE, np.int8), 0.1, (-2.0, -2.0, 0.0))
NOWHERE = Episode(_BLANK, np.zeros(3), np.array([1.0, 0.0, 0.0]), name="unknown")
HOLD = 10  # one of this many scans is held out of the map


@dataclass(frozen=True)
class MapQuality:
    """The accuracy of a map."""

    right: float  # share of known cells: free without anything solid at their centres, or occupied
    # with a true surface within a cell's diagonal
    wall_median: float  # m from an occupied cell's centre to the nearest true surface
    wall_p95: float  # m
    floor_seen: float  # share of the floor within reach of the chair's disc that is mapped as free


def map_quality(made: OccupancyGrid, episode: Episode, radius: float) -> MapQuality:
    """The accuracy of a map of an episode's world, in the same frame.

    Args:
        made: the map.
        episode: the world.
        radius: of a disc that fits into the chair [m].

    Raises:
        InputError: the map shows no wall, or no free cell.
    """
    free, solid = np.argwhere(made.cells == FREE), np.argwhere(made.cells == OCCUPIED)
    if not (len(free) and len(solid)):
        raise InputError("the map shows no wall, or nothing free; expected both")
    true_map = episode.map
    world = Space.from_map(true_map, episode.walls, episode.discs).solid
    shapely.prepare(world)
    wrong = shapely.contains_xy(world, made.to_world(free))
    off = shapely.distance(shapely.points(made.to_world(solid)), shapely.boundary(world))
    right = len(free) - wrong.sum() + (off <= made.resolution * np.sqrt(2.0)).sum()
    floor = np.argwhere(np.isfinite(geodesic(true_map, episode.start[:2], radius).field))
    return MapQuality(
        float(right / (len(free) + len(solid))),
        float(np.median(off)),
        float(np.percentile(off, 95)),
        float((cells_at(made, true_map.to_world(floor)) == FREE).mean()),
    )


@dataclass(frozen=True)
class DrivenMap:
    """The map from a drive through an unknown scene."""

    grid: OccupancyGrid
    estimated: Array  # (n, 3) m, m, rad
    true: Array  # (n, 3)
    seconds: float
    way: float  # m
    ended: str  # done, time, contact or stopped
    quality: MapQuality | None  # None where the truth is unknown: of a real chair

    @property
    def figures(self) -> dict[str, Any]:
        """The figures as JSON takes them."""
        drive = {"seconds": self.seconds, "way": self.way, "ended": self.ended}
        if self.quality is None:
            return drive
        off = self.estimated - self.true
        turn = wrap_angle(off[:, 2])
        return {
            **drive,
            "pose_rms_m": float(np.sqrt((off[:, :2] ** 2).sum(axis=1).mean())),
            "heading_rms_deg": float(np.degrees(np.sqrt((turn**2).mean()))),
            **asdict(self.quality),
        }


def map_by_driving(
    env: Any,
    policy: Policy,
    seed: int,
    seconds: float,
    each: Callable[[Any], object] = ignore,
    *,
    real: bool = False,
) -> DrivenMap:
    """Drive by a policy through a world while the chair builds a map of it.

    The drive ends when the policy is done, when time is up, at a contact or at Ctrl-C.

    Args:
        env: with the pose source `slam`.
        policy: ends the drive with a command that says it is done.
        seed: of the episode.
        seconds: limit of the drive.
        each: called with the environment at each step.
        real: a real chair: there is no scene, and the map begins where the chair is.
    """
    scene = NOWHERE
    if not real:
        env.unwrapped.reset(seed=seed)  # outside the recording
        scene = env.unwrapped.episode
    exploration = replace(scene, tolerance=NO_TOLERANCE, time_limit=seconds)
    observation, info = env.reset(seed=seed, options={"episode": exploration})
    task = env.unwrapped.task
    estimated, true = [info["pose_estimate"]], [info["pose"]]
    over, ended = False, "time"
    try:
        driver = GymPolicy(policy, env)
        driver.reset()
        while not over:
            each(env)
            action = driver.act(observation)
            if driver.command is not None and driver.command.done:
                ended = "done"
                break
            observation, _, bumped, late, info = env.step(action)
            estimated.append(info["pose_estimate"])
            true.append(info["pose"])
            over = bumped or late
            ended = "contact" if bumped else ended
    except (KeyboardInterrupt, SystemError) as error:
        if not is_interrupt(error):
            raise
        ended = "stopped"
    grid = task.map
    found = None if real else map_quality(grid, scene, task.footprint.half_width)
    return DrivenMap(
        grid, np.array(estimated), np.array(true), info["time"], info["distance"], ended, found
    )


@dataclass(frozen=True)
class LogMap:
    """The map from a log, and the deviation of held-out scans from it."""

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
        text = "no residual: nothing occupied, or no held-out echo"
        if (median := of["residual_median"]) is not None:
            text = f"median {100 * median:.2f} cm, mean {100 * of['residual_mean']:.2f} cm"
        return (
            f"{self.name:<22}{text}; {of['occupied_cells']} cells occupied; "
            f"{self.speed:.0f} x real time"
        )


def held_out(scan: int) -> bool:
    """Whether a scan is held out of the maps."""
    return scan % HOLD == HOLD - 1


def progress(total: int, enabled: bool, unit: str = "scan") -> Any:
    """A bar on standard error."""
    return tqdm(total=total, unit=unit, disable=not enabled or not sys.stderr.isatty())


def _log_map(
    name: str, log: SensorLog, laser: LaserSettings, grid: OccupancyGrid, trail: Array, spent: float
) -> LogMap:
    solid, residuals = np.argwhere(grid.cells == OCCUPIED), np.empty(0)
    held = filter(held_out, range(len(log.stamps)))
    ends = [to_world(read_scan(laser, log.ranges[k]).echoes, trail[k]) for k in held]
    if len(solid) and ends:
        residuals = cKDTree(grid.to_world(solid)).query(np.concatenate(ends))[0]
    return LogMap(name, grid, trail, residuals, float(log.stamps[-1]) / spent)


def by_odometry(log: SensorLog, laser: LaserSettings, mapping: MappingSettings) -> LogMap:
    """The map that dead reckoning gives.

    Raises:
        InputError: the log has no scan to map.
    """
    trail = log.odometry
    OccupancyMap(mapping).integrate(read_scan(laser, log.ranges[0]), trail[0])
    built = OccupancyMap(mapping)
    begun = time.perf_counter()
    for k, (pose, ranges) in enumerate(zip(trail, log.ranges, strict=True)):
        if not held_out(k):
            built.integrate(read_scan(laser, ranges), pose)
    seconds = time.perf_counter() - begun
    return _log_map("odometry only", log, laser, built.to_grid(), trail, seconds)


def by_slam(
    log: SensorLog,
    laser: LaserSettings,
    settings: SlamSettings,
    seed: int,
    each: Callable[[Slam], object] = ignore,
) -> LogMap:
    """The map that SLAM gives; held-out scans are matched with it, and never added to it.

    Args:
        log: the log.
        laser: its laser.
        settings: of the SLAM.
        seed: of its draws.
        each: called after each scan.

    Raises:
        InputError: the log has no scan to map.
    """
    Slam(laser, settings).update(np.zeros(3), np.full(laser.beams, laser.reach))  # compiles
    slam = Slam(laser, settings, seed)
    seconds = 0.0
    for k, (increment, ranges) in enumerate(zip(log.increments, log.ranges, strict=True)):
        begun = time.perf_counter()
        slam.update(increment, ranges, learn=not held_out(k))
        seconds += time.perf_counter() - begun
        each(slam)
    many = settings.particles > 1
    name = f"SLAM, {settings.particles} particles" if many else "scan matching"
    return _log_map(name, log, laser, slam.built_map(), slam.trajectory, seconds)
