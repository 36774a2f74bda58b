"""Swarms on the worlds of two papers, and beside mealpy: figures with seeds and settings.

`python -m tests.benchmarks.swarms [p2] [r1] [race] [runs]`; without names all. `runs`: seeds 0 to
runs - 1, 100 without it. `race` needs mealpy, which the extra `peers` installs.
"""

from __future__ import annotations

import json
import math
import platform
import sys
import time
from dataclasses import replace
from typing import Any

import numpy as np

from agents.metrics import wilson
from planners import Problem, Space, make_planner
from planners.curves import curve
from planners.problems import read_problems
from planners.swarm.objectives import make_objective
from planners.swarm.peers import Mealpy
from planners.swarm.planner import SwarmPlanner
from tests.conftest import ROOT
from wheelchair_gym.config import InputError, dump
from wheelchair_gym.geometry import path_length
from wheelchair_gym.scenes.papers import CHAOTIC_PSO_DISCS, GREY_WOLF_DISCS, GREY_WOLF_GOALS

# Least lengths known [m], of 3 way points and violation 0 at 1.2 R.
P2_BEST = {"polyline": 11.404, "pchip": 11.410, "spline": 11.412}
# Shortest paths [m] round the discs themselves: tangents and arcs.
R1_BEST = {
    "5,20": 20.719,
    "15,5": 15.836,
    "12,12": 19.919,
    "15,22": 29.104,
    "20,20": 30.843,
    "10,2.5": 10.308,
}
# P2: straight line first, the others anywhere, cost of sampled points: as published.
P2_PUBLISHED = SwarmPlanner(
    objective={"name": "violation", "faithful": True},
    chordal=False,
    pieces=100,
    way_points=3,
    population=20,
    first="line",
    scatter="uniform",
)
# Ours: costs along the pieces, and a swarm that begins, and stays, near the straight line.
# Chosen on seeds 1000 to 1099.
P2_OURS = replace(
    P2_PUBLISHED, objective="violation", scatter="bow", width_bound=1.5, height_bound=1.5
)
R1_PUBLISHED = SwarmPlanner(
    objective={"name": "way_points", "faithful": True},
    chordal=False,
    way_points=13,
    population=150,
    iterations=150,
    cycle=150,
    first=None,
    scatter="uniform",
)
_FIXED = {"inertia": 0.9, "damping": 1.0, "own": 2.05, "best": 2.05, "speed": 0.16, "ramp": True}
R1_OPTIMIZERS: dict[str, dict[str, Any]] = {
    "PSO fixed": {"name": "pso", **_FIXED},
    "PSO+GWO fixed": {"name": "pso_gwo", "inertia": "fixed", "fixed": _FIXED},
    "PSO variable": {"name": "pso_variable", "ramp": True},
    "PSO+GWO adaptive": {"name": "pso_gwo", "adaptive": {"ramp": True}},
}
# Ours: exact legs, bowed paths to begin with, and particles that hear of their neighbours only.
# Chosen on seeds 0 to 11; seeds 100 to 199 gave the same.
R1_OURS = replace(
    R1_PUBLISHED,
    optimizer={
        "name": "pso_gwo",
        "adaptive": {"inertia": 0.7, "least_inertia": 0.1, "ring": 4},
    },
    objective="way_points",
    iterations=300,
    cycle=300,
    first="line",
    scatter="bow",
    width_bound=7.0,
    height_bound=7.0,
)


def say(*words: Any) -> None:
    """A line of the table, on standard error."""
    print(*words, file=sys.stderr, flush=True)


def spread(values: list[float]) -> dict[str, float]:
    """Mean, half the width of its 95 % interval, and least of what is finite."""
    finite = np.array([v for v in values if np.isfinite(v)])
    if not len(finite):
        return {"mean": math.nan, "half": math.nan, "least": math.nan}
    half = 1.96 * finite.std(ddof=1) / math.sqrt(len(finite)) if len(finite) > 1 else math.nan
    return {"mean": float(finite.mean()), "half": float(half), "least": float(finite.min())}


def nearest(line: np.ndarray, discs: Any) -> float:
    """How near a line's pieces (n, 2) come to centres of discs, as a part of the radius."""
    a, b = line[:-1, None], line[1:, None]  # (n, 1, 2)
    centres, radii = np.array(discs)[:, :2], np.array(discs)[:, 2]
    along, square = b - a, np.maximum(((b - a) ** 2).sum(axis=2), 1e-300)
    part = np.clip(((centres - a) * along).sum(axis=2) / square, 0.0, 1.0)
    return float(
        (np.hypot(*np.moveaxis(centres - a - part[..., None] * along, 2, 0)) / radii).min()
    )


def ground(size: float, discs: Any, start: Any, goal: Any) -> Problem:
    """A square of free ground with discs."""
    space = Space.from_walls(np.empty((0, 4)), discs, (0.0, 0.0, size, size))
    return Problem(space, np.array(start, dtype=float), np.array(goal, dtype=float))


def p2(runs: int) -> list[dict[str, Any]]:
    """P2's world: curves through three way points, within 0.5 % of the best known."""
    problem = ground(10.0, CHAOTIC_PSO_DISCS, (1, 1), (9, 9))
    rows = []
    say(f"P2, 100 iterations, population 20, seeds 0 to {runs - 1}; within 0.5 % at violation 0:")
    for settings, base in {"published": P2_PUBLISHED, "ours": P2_OURS}.items():
        for name, best in P2_BEST.items():
            for optimizer in ("pso_chaotic", "pso"):
                planner = replace(base, curve=name, optimizer=optimizer)
                lengths, hits, tried, found = [], 0, 0, []
                for seed in range(runs):
                    rng = np.random.default_rng(seed)
                    search = planner.search(planner.start(problem, None, rng), rng)
                    # The paper's answer is what costs least, ours the best valid path of all tried.
                    line = search.best if settings == "published" else search.line
                    points = np.repeat(line, 2, axis=0) if settings == "published" else line
                    free = len(line) and nearest(points, CHAOTIC_PSO_DISCS) >= 1.2 - 1e-9
                    lengths.append(path_length(line) if free else math.inf)
                    hits += lengths[-1] <= 1.005 * best
                    tried += search.cost <= 1.005 * best
                    found.append(search.found)
                row = {"settings": settings, "curve": name, "optimizer": optimizer, "hits": hits}
                row["hits_of_valid_paths_tried"] = tried
                row |= {"interval": wilson(hits, runs), "length_m": spread(lengths)}
                row |= {"violated": int(np.isinf(lengths).sum()), "iterations": spread(found)}
                rows.append(row)
                low, high = row["interval"]
                m = row["length_m"]
                say(
                    f"  {settings:9s} {name:8s} {optimizer:11s} {hits:3d} of {runs}"
                    f" (of valid paths tried {tried})"
                    f"  ({100 * low:.0f} to {100 * high:.0f} %)  mean {m['mean']:.4f} +- "
                    f"{m['half']:.4f}  least {m['least']:.4f} m, best known {best} m,"
                    f" violated {row['violated']}, last gain at {row['iterations']['mean']:.0f}"
                )
    return rows


def r1(runs: int) -> list[dict[str, Any]]:
    """R1's world: its four variants as printed, and ours with exact legs."""
    rows = []
    say(f"R1, as printed (150 + 150 iterations, population 150), seeds 0 to {runs - 1}:")
    for label, optimizer in R1_OPTIMIZERS.items():
        n = 300 if optimizer["name"] == "pso_gwo" else 150
        planner = replace(R1_PUBLISHED, optimizer=optimizer, iterations=n, cycle=n)
        for goal, optimum in R1_BEST.items():
            problem = ground(25.0, GREY_WOLF_DISCS, (0, 0), GREY_WOLF_GOALS[goal])
            losses, lengths, legs, splines = [], [], 0, 0
            for seed in range(runs):
                rng = np.random.default_rng(seed)
                search = planner.search(planner.start(problem, None, rng), rng)
                losses.append(search.least)
                lengths.append(path_length(search.way_points))
                legs += nearest(search.way_points, GREY_WOLF_DISCS) >= 1.0
                smooth = curve(search.way_points, "spline", 40, chordal=False)
                splines += nearest(smooth, GREY_WOLF_DISCS) >= 1.0
            row = {"variant": label, "goal": goal, "optimum_m": optimum, "loss": spread(losses)}
            row |= {"length_m": spread(lengths), "legs_valid": legs, "splines_valid": splines}
            rows.append(row)
            m = row["length_m"]
            say(
                f"  {label:17s} ({goal:6s}) length {m['mean']:6.2f} +- {m['half']:5.2f}  least"
                f" {m['least']:6.2f}  optimum {optimum:6.3f}  loss {row['loss']['mean']:5.2f}"
                f"  legs valid {legs}, spline valid {splines}"
            )
    say("R1, ours (300 iterations, population 150), exactly valid and within 3 % of the optimum:")
    for goal, optimum in R1_BEST.items():
        problem = ground(25.0, GREY_WOLF_DISCS, (0, 0), GREY_WOLF_GOALS[goal])
        lengths, hits = [], 0
        for seed in range(runs):
            plan = R1_OURS.plan(problem, np.random.default_rng(seed))
            free = plan.status == "solved" and nearest(plan.path, GREY_WOLF_DISCS) >= 1.0
            lengths.append(plan.length if free else math.inf)
            hits += lengths[-1] <= 1.03 * optimum
        row = {"variant": "ours", "goal": goal, "hits": hits, "interval": wilson(hits, runs)}
        row |= {"length_m": spread(lengths), "invalid": int(np.isinf(lengths).sum())}
        rows.append(row)
        m, (low, high) = row["length_m"], row["interval"]
        say(
            f"  ({goal:6s}) {hits:3d} of {runs}  ({100 * low:.0f} to {100 * high:.0f} %)"
            f"  mean {m['mean']:.3f} +- {m['half']:.3f}  least {m['least']:.3f}"
            f"  optimum {optimum} m, invalid {row['invalid']}"
        )
    return rows


def race() -> dict[str, float]:
    """Microseconds of CPU of a WOA iteration, population 10, 20 way points, beside mealpy's.

    Calls of a compiled cost from Python are dear, so mealpy is timed with a cost that is nothing,
    too: what it then takes is its own.
    """
    problems = read_problems(ROOT.parent / "shared" / "problems" / "planning.json")
    problem = next(p for p, _ in problems if p.name.startswith("clutter50"))
    base = SwarmPlanner(way_points=20, population=10, objective="length_free", optimizer="woa")
    first = make_planner(base.first).plan(problem, np.random.default_rng(0)).path
    start = base.start(problem, first, np.random.default_rng(0))
    peer = Mealpy()
    peer.search(start, make_objective("length_free").worth, 1, np.random.default_rng(0))
    import mealpy

    bounds = mealpy.FloatVar(lb=start.lower, ub=start.upper)
    task = {"obj_func": lambda x: 0.0, "bounds": bounds, "minmax": "min", "log_to": None}

    def ours(n: int) -> None:
        replace(base, iterations=n, cycle=n).search(start, np.random.default_rng(0))

    def theirs(n: int) -> None:
        peer.search(start, make_objective("length_free").worth, n, np.random.default_rng(0))

    def bare(n: int) -> None:
        mealpy.get_optimizer_by_class(peer.algorithm)(epoch=n, pop_size=10).solve(
            task, starting_solutions=list(start.population), seed=0
        )

    times: dict[str, list[float]] = {}
    for _ in range(5):
        for name, act, n in (
            ("ours", ours, 10_000),
            ("mealpy", theirs, 200),
            ("mealpy_alone", bare, 200),
        ):
            begun = time.process_time()
            act(n)
            times.setdefault(f"{name}_us", []).append(1e6 * (time.process_time() - begun) / n)
    best = {name: min(spent) for name, spent in times.items()}
    best |= {f"{k[:-3]}_ratio": v / best["ours_us"] for k, v in best.items() if k != "ours_us"}
    best["way_points"] = len(start.task.anchors)
    say(
        f"WOA on {problem.name}, population 10, {best['way_points']} way points, seed 0, least of"
        f" 5: ours {best['ours_us']:.1f} us of CPU an iteration; mealpy {best['mealpy_us']:.0f} us"
        f" ({best['mealpy_ratio']:.1f} x), with a cost of nothing {best['mealpy_alone_us']:.0f} us"
        f" ({best['mealpy_alone_ratio']:.1f} x)"
    )
    return best


def main() -> None:
    """Print tables on standard error and JSON on standard output."""
    numbers = [int(word) for word in sys.argv[1:] if word.isdigit()]
    names = [word for word in sys.argv[1:] if not word.isdigit()] or ["p2", "r1", "race"]
    runs = numbers[0] if numbers else 100
    results: dict[str, Any] = {
        "machine": f"{platform.machine()}, Python {platform.python_version()}",
        "seeds": [0, runs - 1],
        "settings": {
            "p2": {"published": dump(P2_PUBLISHED), "ours": dump(P2_OURS)},
            "r1": {"published": dump(R1_PUBLISHED), "ours": dump(R1_OURS)},
            "r1_optimizers": R1_OPTIMIZERS,
        },
    }
    if "p2" in names:
        results["p2"] = p2(runs)
    if "r1" in names:
        results["r1"] = r1(runs)
    if "race" in names:
        try:
            results["race"] = race()
        except InputError as error:
            say(error)
    json.dump(results, sys.stdout, indent=2)
    print()


if __name__ == "__main__":
    main()
