"""How fast worlds are drawn on this machine: `make bench`."""

from __future__ import annotations

import json
import platform
import sys
import time

import numpy as np

import wheelchair_gym
from wheelchair_gym.geometry import Footprint
from wheelchair_gym.maps import geodesic
from wheelchair_gym.scenes import make_scene

SCENE, REPEATS, WORLDS = "floor_plan", 5, 200


def world_milliseconds() -> dict[str, float]:
    """One floor plan and its geodesic, as an episode needs them: per seed the best of repeats."""
    scene, radius = make_scene(SCENE), Footprint().half_width + 0.05
    times = np.empty((REPEATS, WORLDS))
    for times_once in times:
        for seed in range(WORLDS):
            rng = np.random.default_rng((seed, 0))
            begun = time.perf_counter()
            episode = scene.sample(rng)
            geodesic(episode.map, episode.goal[:2], radius)
            times_once[seed] = 1e3 * (time.perf_counter() - begun)
    best = times.min(axis=0)
    return {"mean_ms": float(best.mean()), "p95_ms": float(np.quantile(best, 0.95))}


def main() -> None:
    """Print a table on standard error and JSON on standard output."""
    results = {
        "version": wheelchair_gym.__version__,
        "machine": f"{platform.machine()}, Python {platform.python_version()}",
        "world": world_milliseconds(),
    }
    world = results["world"]
    print(
        f"a world, scene {SCENE}, and its geodesic, seeds 0 to {WORLDS - 1}:"
        f"  mean {world['mean_ms']:.2f} ms  p95 {world['p95_ms']:.2f} ms",
        file=sys.stderr,
    )
    json.dump(results, sys.stdout, indent=2)
    print()


if __name__ == "__main__":
    main()
