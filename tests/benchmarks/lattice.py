"""Lattice planner: time to a path, its quality by then, and failures.

`python -m tests.benchmarks.lattice [--worlds 100] [--sets barn,homes]`: drawn BARN
worlds and the 60 of the benchmark, homes, doors and the stored footprint problems, each in a map
that the planner has not seen. A world is asked for the clearance that a policy begins with (wide),
and for 1 cm beside the chair (narrow). Seconds are those of the process, deadlines too: other
programs do not count.
"""

import argparse
import json
import time
from pathlib import Path

import numpy as np

import wheelchair_gym.compiled.clock
from planners import Problem, Space, make_planner
from tests.conftest import SHARED
from tests.planners.footprints import path_cost, path_gaps, read
from wheelchair_gym.base.settings import dump
from wheelchair_gym.geometry.outline import Footprint
from wheelchair_gym.maps import bottleneck
from wheelchair_gym.scenes import make_scene

DEADLINES = (0.05, 0.1, 1.0)  # s
FIRST = 1_000_000  # far from the seeds that are reported
HOME = {"name": "floor_plan", "kind": "home", "door_width": [0.9, 1.1],
        "corridor_width": [1.1, 1.6]}  # fmt: skip
DOORS = [{"name": "doorway", "door_width": door, "corridor_width": corridor}
         for door in (1.0, 0.95, 0.9, 0.85, 0.8) for corridor in (1.2, 1.05, 0.9)]  # fmt: skip
ASKED = (0.40, 0.36, 0.32, 0.28)  # m: by `agents.policies.search.Search.widest`


def drawn(scenes, seeds):
    """Problems of scenes, and the footprint: with the policy's clearance, and with 1 cm."""
    footprint = Footprint()
    for scene in scenes:
        for seed in seeds:
            episode = make_scene(scene).sample(np.random.default_rng(seed))
            start, goal = episode.start, episode.goal[:2]
            space = Space.from_grid(episode.map)
            maximum = bottleneck(episode.map, start[:2], goal) + 0.5 * episode.map.resolution
            wide = next((asked for asked in ASKED if asked <= maximum), ASKED[-1])
            for clearance in sorted({wide, footprint.half_width + 0.01}):
                yield Problem(space, start, goal, clearance, f"{episode.name}_{seed}"), footprint


def sets(worlds, names):
    """Problems by name of their set, of the sets whose names are given between commas."""
    known = str(SHARED / "maps" / "barn_60.json")
    numbers = [world["world"] for world in json.loads(Path(known).read_text())]
    seeds = range(FIRST, FIRST + worlds)
    every = {
        "barn": drawn(["barn"], seeds),
        "barn_60": drawn([{"name": "barn", "path": known, "world": n} for n in numbers], [0]),
        "homes": drawn([HOME], seeds),
        "doors": drawn(DOORS, seeds[: max(1, worlds // 15)]),
        "problems": ((case.problem, case.footprint) for case in read()),
    }
    return [(name, every[name]) for name in every if name in names.split(",")]


def seconds(path, planner):
    """Time [s] of a path of poses at the chair's limits, with stops to change the direction."""
    motion = planner.motion_cost(planner.footprint, planner.limits, 0.0)
    motion = motion._replace(backward=planner.limits.backward)
    return path_cost(path, motion)


def unseen(problem, clearance):
    """Return the problem in a map that no planner has seen, with a clearance [m]."""
    space = Space(problem.space._solid, problem.space.bounds, (), problem.space._edges)
    space.arrays  # noqa: B018  every planner needs them
    return Problem(space, problem.start, problem.goal, clearance, problem.name)


def planned(problem, footprint):
    """One row: the plan without a deadline, and what there is at each deadline."""
    planner = make_planner({"name": "lattice", "footprint": dump(footprint)})
    rng = np.random.default_rng(0)
    clearance = max(problem.clearance, footprint.half_width)

    def once(deadline=None):
        fresh = unseen(problem, clearance)
        begun = time.process_time()
        plan = planner.plan(fresh, rng, deadline)
        took = time.process_time() - begun
        begun = time.process_time()
        if deadline is None:
            planner.plan(fresh, rng)
        return plan, took, time.process_time() - begun

    plan, took, later = once()
    row = {"name": problem.name, "clearance": clearance, "status": str(plan.status),
           "note": plan.note, "ms": 1e3 * took, "later_ms": 1e3 * later, "s": None,
           "poses": plan.counters.get("iterations", 0)}  # fmt: skip
    if len(plan.path):
        margin = max(0.0, clearance - footprint.half_width)
        gap = path_gaps(plan.path, problem.space, footprint).min()
        row |= {"s": seconds(plan.path, planner), "short": max(0.0, margin - gap)}
    for deadline in DEADLINES:
        plan, took, _ = once(deadline)
        row[f"{deadline:g}"] = seconds(plan.path, planner) if len(plan.path) else None
        row[f"{deadline:g}_status"], row[f"{deadline:g}_ms"] = str(plan.status), 1e3 * took
    return row


def summary(rows):
    found = [row for row in rows if row["status"] == "solved"]
    failed = [row for row in rows if row["status"] != "solved"]
    line = {"asked": len(rows), "found": len(found)}
    for key in ("ms", "later_ms", "s"):
        values = [row[key] for row in found] or [np.nan]
        line |= {f"{key}_{q}": round(float(np.quantile(values, q / 100)), 2) for q in (50, 95)}
    for deadline in DEADLINES:
        by = [row[f"{deadline:g}"] for row in found]
        line[f"by_{deadline:g}"] = round(100 * np.mean([b is not None for b in by]), 1)
        ratio = [b / row["s"] for b, row in zip(by, found, strict=True) if b and row["s"]]
        line[f"ratio_{deadline:g}"] = round(float(np.mean(ratio)), 4) if ratio else None
    line["proven"] = sum(row["status"] != "exhausted" for row in failed)
    line["complete"] = sum(row["status"] == "exhausted" and bool(row["note"]) for row in failed)
    line["given_up"] = len(failed) - line["proven"] - line["complete"]
    line["failed_ms"] = round(float(np.median([row["ms"] for row in failed] or [0.0])), 1)
    line["failed_ms_max"] = round(max([row["ms"] for row in failed] or [0.0]), 1)
    line["late_ms"] = round(max(row["0.05_ms"] for row in rows), 1)
    return line


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--worlds", type=int, default=100, help="of each scene")
    parser.add_argument("--sets", default="barn,barn_60,homes,doors,problems")
    given = parser.parse_args()
    wheelchair_gym.compiled.clock.perf_counter = time.process_time  # the planners' clock
    planned(*next(drawn(DOORS, [FIRST])))  # compiles
    for name, problems in sets(given.worlds, given.sets):
        rows = [planned(*one) for one in problems]
        for asked in ("wide", "narrow") if name != "problems" else ("all",):
            minimum = [row for row in rows if asked == "all" or
                     (row["clearance"] < 0.325) == (asked == "narrow")]  # fmt: skip
            if minimum:
                print(name, asked, json.dumps(summary(minimum)), flush=True)


if __name__ == "__main__":
    main()
