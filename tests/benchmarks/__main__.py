"""How fast the planners plan on this machine: `make bench`."""

from __future__ import annotations

import json
import platform
import statistics
import sys
import time

import numpy as np

import wheelchair_gym
from planners import PLANNERS, Problem, Space, make_planner
from wheelchair_gym.scenes import make_scene

SCENE, SEEDS = "floor_plan", range(5)


def plan_milliseconds(name: str) -> dict[str, float]:
    """Median time and mean length over floor plans, clearance 0.36 m, one seed each."""
    times, lengths = [], []
    for seed in SEEDS:
        episode = make_scene(SCENE).sample(np.random.default_rng((seed, 0)))
        space = Space.from_walls(episode.walls, episode.discs, episode.map.bounds)
        problem = Problem(space, episode.start, episode.goal, 0.36)
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
        "planners": {},
    }
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
