"""IR-SIM in the same world, for comparison (extra `peers`)."""

from __future__ import annotations

import contextlib
import io
import os
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
import shapely
import yaml

from wheelchair_gym.envs import EnvSettings
from wheelchair_gym.types import Episode


def wall_loops(walls: np.ndarray[Any, Any]) -> list[list[list[float]]]:
    """Walls (n, 4) as the longest possible polylines."""
    merged = shapely.line_merge(
        shapely.MultiLineString(np.asarray(walls).reshape(-1, 2, 2).tolist())
    )
    return [np.array(line.coords).tolist() for line in getattr(merged, "geoms", [merged])]


def irsim_world(settings: EnvSettings, episode: Episode) -> dict[str, Any]:
    """IR-SIM's description of an episode: the same walls, chair and laser."""
    chair, laser = settings.chair, settings.sensors.laser
    x0, y0, x1, y1 = episode.map.bounds
    return {
        "world": {
            "height": y1 - y0,
            "width": x1 - x0,
            "offset": [x0, y0],
            "step_time": 1.0 / settings.rate,
            "sample_time": 1.0 / settings.rate,
            "collision_mode": "stop",
        },
        "robot": [
            {
                "kinematics": {"name": "diff"},
                "shape": {
                    "name": "rectangle",
                    "length": chair.footprint.front + chair.footprint.rear,
                    "width": 2 * chair.footprint.half_width,
                },
                "state": [float(value) for value in episode.start],
                "vel_max": [chair.limits.forward, chair.limits.turn],
                "vel_min": [-chair.limits.backward, -chair.limits.turn],
                "sensors": [
                    {
                        "name": "lidar2d",
                        "range_min": 0.0,
                        "range_max": laser.reach,
                        "angle_range": laser.fov,
                        "number": laser.beams,
                        "noise": settings.sensors.noise,
                        "std": laser.sigma,
                    }
                ],
            }
        ],
        "obstacle": [
            {"shape": {"name": "linestring", "vertices": loop}, "state": [0, 0, 0]}
            for loop in wall_loops(episode.walls)
        ],
    }


def irsim_rate(settings: EnvSettings, episode: Episode, seconds: float) -> float:
    """Steps per second of IR-SIM with a scan at each, driven by uniform actions.

    Args:
        settings: of our environment.
        episode: its world.
        seconds: duration of the measurement.

    Raises:
        ImportError: it is not installed.
    """
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        os.environ.setdefault("MPLBACKEND", "Agg")
        import irsim
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "world.yaml"
        path.write_text(yaml.safe_dump(irsim_world(settings, episode)))
        env = irsim.make(str(path), display=False, disable_all_plot=True, log_level="ERROR")
    rng = np.random.default_rng(0)
    limits = settings.chair.limits
    twists = rng.uniform((-limits.backward, -limits.turn), (limits.forward, limits.turn), (64, 2))
    env.step(twists[0].reshape(2, 1))
    done, begun = 0, time.perf_counter()
    while time.perf_counter() - begun < seconds:
        env.step(twists[done % 64].reshape(2, 1))
        env.get_lidar_scan()
        if env.robot.collision:
            env.reset()
        done += 1
    spent = time.perf_counter() - begun
    env.end()
    return done / spent
