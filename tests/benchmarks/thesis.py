"""The thesis's three planners with its figure 3.1's settings, on five maps after its descriptions.

`python -m tests.benchmarks.thesis [runs]`: seeds 0 to runs - 1 on each map, 100 without it, on one
core. Times are the whole call's, wall clock, compiled before. The thesis's own figures (its table
3.1: an i3 at 3 GHz, C++, the means of its five maps) stand below; its maps were never published.
"""

from __future__ import annotations

import json
import platform
import sys
import time
from typing import Any

import numpy as np

from agents.metrics import wilson
from planners import Planner, Problem, Space, Status, make_planner
from planners.trees.rrt import RrtStar
from planners.trees.whales import RrtStarWoaGlobal, RrtStarWoaLocal
from tests.benchmarks.swarms import say, spread
from wheelchair_gym.scenes import make_scene

PUBLISHED = {  # s, m, nodes
    "rrt_star": (0.026, 35.268, 409.258),
    "rrt_star_woa_local": (1.440, 27.132, 167.378),
    "rrt_star_woa_global": (0.072, 30.656, 410.598),
}
THESIS: dict[str, Planner] = {
    "rrt_star": RrtStar.thesis(),
    "rrt_star_woa_local": RrtStarWoaLocal.thesis(),
    "rrt_star_woa_global": RrtStarWoaGlobal.thesis(),
}
# What the registry offers where a one-directional tree is slow or fails, and the optimum.
OTHERS = {name: make_planner(name) for name in ("rrt_connect", "visibility")}


def measure(problem: Problem, planner: Planner, runs: int) -> dict[str, Any]:
    """Times, lengths and nodes of the runs that found a path, and how many did."""
    planner.plan(problem, np.random.default_rng(0))
    times, lengths, nodes = [], [], []
    for seed in range(runs):
        rng = np.random.default_rng(seed)
        begun = time.perf_counter()
        plan = planner.plan(problem, rng)
        times.append(1e3 * (time.perf_counter() - begun))
        if plan.status is Status.SOLVED:
            lengths.append(plan.length)
            nodes.append(float(plan.counters["nodes"]))
    low, high = wilson(len(lengths), runs)
    return {
        "solved": len(lengths),
        "interval": (low, high),
        "ms": spread(times) | {"median": float(np.median(times)), "most": max(times)},
        "length_m": spread(lengths),
        "nodes": spread(nodes),
    }


def main(runs: int) -> None:
    """Measure all, and print a table (standard error) and JSON (standard output)."""
    rows = []
    for number in range(1, 6):
        episode = make_scene(f"thesis_{number}").sample(np.random.default_rng(0))
        space = Space.from_walls(episode.walls, episode.discs, episode.map.bounds)
        problem = Problem(space, episode.start[:2], episode.goal[:2])
        for name, planner in (THESIS | OTHERS).items():
            row = {"map": number, "planner": name, **measure(problem, planner, runs)}
            rows.append(row)
            t, length, n = row["ms"], row["length_m"], row["nodes"]
            low, high = row["interval"]
            say(
                f"map {number}  {name:20s} {t['mean']:7.2f} +- {t['half']:5.2f} ms"
                f" (median {t['median']:6.2f}, most {t['most']:7.2f})  {length['mean']:6.2f} +-"
                f" {length['half']:4.2f} m  {n['mean']:6.1f} +- {n['half']:5.1f} nodes"
                f"  solved {row['solved']} of {runs} ({100 * low:.1f} to {100 * high:.1f} %)"
            )
    for name, (seconds, metres, count) in PUBLISHED.items():
        mine = [row for row in rows if row["planner"] == name]
        means = [np.mean([row[key]["mean"] for row in mine]) for key in ("ms", "length_m", "nodes")]
        say(
            f"five maps  {name:20s} {means[0]:7.2f} ms  {means[1]:6.2f} m  {means[2]:6.1f} nodes;"
            f" published {1e3 * seconds:.0f} ms  {metres} m  {count} nodes"
        )
    settings = {
        "runs": runs,
        "machine": f"{platform.machine()}, Python {platform.python_version()}",
        "published": PUBLISHED,
    }
    print(json.dumps({**settings, "rows": rows}, indent=2))


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 100)
