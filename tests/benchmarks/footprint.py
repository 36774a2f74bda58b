"""Planning for the chair's outline: what is feasible, what is solved, how long, how fast.

`python -m tests.benchmarks.footprint [problems] [barn] [depot]`: the stored footprint problems, the
BARN worlds and random pose pairs in the depot map; each path is judged by shapely.
A path that is valid proves that there is one: the oracle is asked where none was found.
The outline may touch (margin 0); starts and goals are those of the oracle's grid. The first plan in
a map makes what depends on the map alone: both times are given.
"""

from __future__ import annotations

import json
import math
import os
import sys
import time
from pathlib import Path

import numpy as np
import shapely

from planners import Problem, Space, make_planner
from planners.judge import sweep_faults
from tests.conftest import ROOT
from tests.planners.footprints import read
from tests.planners.oracle import Oracle
from wheelchair_gym.config import dump
from wheelchair_gym.geometry import Footprint, polygon_edges, to_world
from wheelchair_gym.maps import bottleneck, read_map
from wheelchair_gym.scenes.barn import Barn

SHARED = Path(os.environ.get("WHEELCHAIR_SHARED", ROOT.parent / "shared"))
PAIRS, SEED = 100, 0
REPEATS = 3


def planned(problem, footprint):
    """One row: status, length, faults, and the times [ms] of the first and of later plans."""
    planner = make_planner({"name": "lattice", "footprint": dump(footprint)})
    rng = np.random.default_rng(SEED)
    first, later = [], []
    for _ in range(REPEATS):
        space = Space(problem.space.solid, problem.space.bounds)
        space.arrays  # noqa: B018  every planner needs them
        fresh = Problem(space, problem.start, problem.goal, footprint.half_width, problem.name)
        for times in (first, later):
            begun = time.perf_counter()
            plan = planner.plan(fresh, rng)
            times.append(1e3 * (time.perf_counter() - begun))
    faults = []
    if len(plan.path):
        space = problem.space
        faults = sweep_faults(plan.path, footprint.corners, space.solid, space.bounds)
    return {
        "name": problem.name, "status": str(plan.status), "length_m": plan.length,
        "faults": faults, "first_ms": min(first), "later_ms": min(later), **plan.counters,
    }  # fmt: skip


def _valid(row):
    return row["status"] == "solved" and not row["faults"]


def problems():
    """Rows of the stored problems."""
    for case in read():
        verdict = case.verdict
        row = planned(case.problem, case.footprint)
        yield row | {"feasible": verdict.feasible, "ratio": row["length_m"] / verdict.upper}


def barn():
    """Rows of the BARN worlds, with the narrowest place's margin."""
    footprint, path = Footprint(), SHARED / "maps" / "barn_60.json"
    for world in json.loads(path.read_text()):
        scene = Barn(path=str(path), world=world["world"])
        episode = scene.sample(np.random.default_rng(SEED))
        space = Space.from_walls(episode.walls, episode.discs, episode.map.bounds)
        oracle = Oracle([], episode.discs, space.solid, space.bounds, footprint, episode.start)
        start = oracle.snapped(episode.start)
        goal = oracle.snapped(episode.goal)[:2]
        row = planned(Problem(space, start, goal, name=episode.name), footprint)
        widest = bottleneck(episode.map, start[:2], goal)
        yield row | {
            "feasible": _valid(row) or oracle.feasible(start, goal),
            "margin_cm": 100.0 * (widest - footprint.half_width),
        }


def depot():
    """Rows of random pose pairs in the depot; goals have headings."""
    footprint = Footprint()
    grid = read_map(SHARED / "maps" / "depot.yaml")
    space = Space.from_grid(grid, unknown_is_solid=True)
    rings = [np.asarray(ring.coords)[:-1] for part in getattr(space.solid, "geoms", [space.solid])
             for ring in (part.exterior, *part.interiors)]  # fmt: skip
    edges = np.vstack([polygon_edges(ring) for ring in rings])
    oracle = Oracle(edges, [], space.solid, space.bounds, footprint)
    shapely.prepare(space.free)
    rng = np.random.default_rng(SEED)

    def drawn():
        """A pose of the oracle's grid at which the outline stands free."""
        while True:
            low, high = space.bounds[:2], space.bounds[2:]
            pose = oracle.snapped([*rng.uniform(low, high), rng.uniform(0.0, math.tau)])
            if space.free.covers(shapely.Polygon(to_world(footprint.corners, pose))):
                return pose

    for k in range(PAIRS):
        ends = drawn(), drawn()
        row = planned(Problem(space, *ends, name=f"depot_{k}"), footprint)
        yield row | {"feasible": _valid(row) or oracle.feasible(*ends)}


def main() -> None:
    """Print a table on standard error and JSON on standard output."""
    results = {}
    for part in sys.argv[1:] or ["problems", "barn", "depot"]:
        rows = []
        for row in {"problems": problems, "barn": barn, "depot": depot}[part]():
            rows.append(row)
            more = "".join(f"  {k} {row[k]:.2f}" for k in ("ratio", "margin_cm") if k in row)
            print(
                f"{row['name']:22s} feasible {row['feasible']!s:5}  {row['status']:14s}"
                f" {row['length_m']:7.2f} m  {row['first_ms']:8.1f} {row['later_ms']:8.1f} ms"
                f"  {row.get('iterations', 0):6d} poses{more}  {' '.join(row['faults'])}",
                file=sys.stderr, flush=True,
            )  # fmt: skip
        able = [row for row in rows if row["feasible"]]
        solved = [row for row in able if _valid(row)]
        other = sum(row["status"] == "solved" for row in rows if not row["feasible"])
        print(
            f"{part}: {len(rows)}, feasible {len(able)}, of these solved and valid {len(solved)};"
            f" of the others solved {other}",
            file=sys.stderr,
        )
        for key in ("first_ms", "later_ms"):
            times = [row[key] for row in solved]
            print(f"  {key}: median {np.median(times):.1f}, p95 {np.quantile(times, 0.95):.1f}",
                  file=sys.stderr)  # fmt: skip
        results[part] = rows
    print(json.dumps({"planner": dump(make_planner("lattice")), "seed": SEED, **results}, indent=1))


if __name__ == "__main__":
    main()
