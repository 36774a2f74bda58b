"""How fast worlds are drawn, chairs step and planners plan on this machine: `make bench`."""

from __future__ import annotations

import json
import platform
import statistics
import sys
import time

import gymnasium as gym
import numpy as np

import wheelchair_gym
from planners import PLANNERS, Problem, Space, make_planner
from wheelchair_gym.geometry import Footprint
from wheelchair_gym.maps import geodesic
from wheelchair_gym.scenes import make_scene

SCENE, SEEDS, STEPS, REPEATS, WORLDS = "floor_plan", range(5), 2000, 5, 200


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


def steps_per_second(beams: int) -> float:
    """Median over repeats of one environment driven by uniform actions, resets included."""
    env = gym.make("wheelchair_gym/Navigation-v0", beams=beams, disable_env_checker=True)
    rng = np.random.default_rng(0)
    actions = rng.uniform(-1, 1, (STEPS, 2)).astype(np.float32)
    env.reset(seed=0)
    env.step(actions[0])
    rates = []
    for _ in range(REPEATS):
        spent = 0.0
        for action in actions:
            begun = time.perf_counter()
            _, _, terminated, truncated, _ = env.step(action)
            spent += time.perf_counter() - begun
            if terminated or truncated:
                env.reset()
        rates.append(STEPS / spent)
    env.close()
    return statistics.median(rates)


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
        "world": world_milliseconds(),
        "env": {},
        "planners": {},
    }
    world = results["world"]
    print(
        f"a world, scene {SCENE}, and its geodesic, seeds 0 to {WORLDS - 1}:"
        f"  mean {world['mean_ms']:.2f} ms  p95 {world['p95_ms']:.2f} ms",
        file=sys.stderr,
    )
    print(f"one env, scene {SCENE}, 10 Hz, 10 physics steps, noise on:", file=sys.stderr)
    for beams in (1081, 181, 64):
        rate = results["env"][beams] = steps_per_second(beams)
        print(f"  {beams:5d} beams  {rate:10,.0f} steps/s without resets", file=sys.stderr)
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
