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

from agents.evaluation.tables import templates
from wheelchair_gym.envs import EnvSettings
from wheelchair_gym.types import Episode


def wall_loops(walls: np.ndarray[Any, Any]) -> list[list[list[float]]]:
    """Walls (n, 4) as the longest possible polylines."""
    lines = np.asarray(walls).reshape(-1, 2, 2).tolist()
    merged = shapely.line_merge(shapely.MultiLineString(lines))
    return [np.array(line.coords).tolist() for line in getattr(merged, "geoms", [merged])]


def irsim_world(settings: EnvSettings, episode: Episode) -> str:
    """IR-SIM's description of an episode in YAML: the same walls, chair and laser."""
    template = templates().get_template("irsim.yaml")
    return template.render(settings=settings, episode=episode, loops=wall_loops(episode.walls))


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
        path.write_text(irsim_world(settings, episode))
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
