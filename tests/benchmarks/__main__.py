"""How fast worlds are drawn and planners plan on this machine: `make bench`."""

from __future__ import annotations

import json
import platform
import statistics
import sys
import time

import numpy as np

import wheelchair_gym
from planners import PLANNERS, Problem, Space, make_planner
from wheelchair_gym.geometry import Footprint
from wheelchair_gym.maps import geodesic
from wheelchair_gym.scenes import make_scene

SCENE, SEEDS, REPEATS, WORLDS = "floor_plan", range(5), 5, 200


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


def plan_milliseconds(name: str) -> dict[str, float]:
    """Median time and mean length over floor plans, clearance 0.36 m, one seed each."""
    times, lengths = [], []
    for seed in SEEDS:
        episode = make_scene(SCENE).sample(np.random.default_rng((seed, 0)))
        space = Space.from_walls(episode.walls, episode.discs, episode.map.bounds)
        problem = Problem(space, episode.start, episode.goal[:2], 0.36)
        planner = make_planner(name)
        for _ in range(2):  # the first one compiles, and grows the obstacles
            begun = time.perf_counter()
            plan = planner.plan(problem, np.random.default_rng(seed))
            spent = time.perf_counter() - begun
        times.append(1e3 * spent)
        if plan.status == "solved":
            lengths.append(plan.length)
    return {
        "median_ms": statistics.median(times),
        "solved": len(lengths),
        "length_m": statistics.fmean(lengths) if lengths else float("nan"),
    }


def main() -> None:
    """Print a table on standard error and JSON on standard output."""
    results = {
        "version": wheelchair_gym.__version__,
        "machine": f"{platform.machine()}, Python {platform.python_version()}",
        "world": world_milliseconds(),
        "planners": {},
    }
    world = results["world"]
    print(
        f"a world, scene {SCENE}, and its geodesic, seeds 0 to {WORLDS - 1}:"
        f"  mean {world['mean_ms']:.2f} ms  p95 {world['p95_ms']:.2f} ms",
        file=sys.stderr,
    )
    print(f"planners, scene {SCENE}, seeds {list(SEEDS)}, clearance 0.36 m:", file=sys.stderr)
    for name in PLANNERS:
        row = results["planners"][name] = plan_milliseconds(name)
        print(
            f"  {name:20s} {row['median_ms']:9.2f} ms  {row['solved']} of {len(SEEDS)} solved"
            f"  {row['length_m']:7.2f} m",
            file=sys.stderr,
        )
    json.dump(results, sys.stdout, indent=2)
    print()


if __name__ == "__main__":
    main()
