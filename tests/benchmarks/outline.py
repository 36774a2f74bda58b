"""Planners for the chair's outline under the same deadlines: first path, cost, success, validity.

`python -m tests.benchmarks.outline --out FILE.jsonl [--worlds 30] [--sets ...]`: the
lattice, RRT*-WOA in SE(2) with and without whales, and OMPL's planners (extra `peers`) with the
same connections, exact test and cost. Every path is judged by shapely. Problems are those of
`python -m tests.benchmarks.lattice`. Seconds are those of the process, deadlines too: others
do not count. Rows that the file has already are kept, and what is missing is run.
"""

import argparse
import time
from itertools import product
from pathlib import Path

import numpy as np

import wheelchair_gym.compiled.clock
from agents.evaluation.runs import compute, run_key, source_digest
from agents.evaluation.statistics import wilson
from planners import make_planner
from planners.judge import sweep_faults
from tests.benchmarks.lattice import FIRST, HOME, drawn, sets, unseen
from tests.planners.footprints import path_cost, path_gaps
from wheelchair_gym.base.settings import dump

DEADLINES = (0.05, 0.2, 1.0)  # s
LONGEST = 5.0  # s: for a first path
LATTICE = make_planner("lattice")
SAME_COST = {name: getattr(LATTICE, name) for name in ("obstacle_weight", "pivot_speed_ratio")}
ENDLESS = {"iterations": 10_000_000, "improvement": 10_000_000, **SAME_COST}
OMPL = "tests.benchmarks.ompl_footprint:OmplFootprint"
ENTRANTS = {
    "lattice": {"name": "lattice", "improvement": 10_000_000},
    "se2_rrt_star_woa": {"name": "se2_rrt_star_woa", **ENDLESS},
    "without whales": {"name": "se2_rrt_star_woa", **ENDLESS, "local_share": 0.0},
    **{f"OMPL {name}": {"name": OMPL, "algorithm": name, "limit": LONGEST}
       for name in ("RRTConnect", "RRTstar", "InformedRRTstar", "BITstar")},
}  # fmt: skip


def planned(problem, footprint, settings):
    """The first path, and what there is at each deadline."""
    clearance = max(problem.clearance, footprint.half_width)
    row = {}
    for deadline in (None, *DEADLINES):
        first = {}
        if deadline is None and "algorithm" not in settings:  # OMPL ends at its first path anyway
            first = {"improvement": 0}
        planner = make_planner({**settings, "footprint": dump(footprint), **first})
        fresh = unseen(problem, clearance)
        begun = time.process_time()
        plan = planner.plan(fresh, np.random.default_rng(0), LONGEST if first else deadline)
        took = time.process_time() - begun
        found = {"status": str(plan.status), "s": took}
        if len(plan.path):
            margin = max(0.0, clearance - footprint.half_width)
            faults = sweep_faults(
                plan.path, footprint.corners, problem.space.solid, problem.space.bounds
            )
            gap = path_gaps(plan.path, problem.space, footprint).min()
            motion = planner.motion_cost(footprint, planner.limits, 0.0)
            found |= {"cost": path_cost(plan.path, motion, problem.space, footprint),
                      "faults": len(faults), "short": max(0.0, margin - gap)}  # fmt: skip
        row["first" if deadline is None else f"{deadline:g}"] = found
    return row


def summary(rows, names):
    """A line of a table for each planner; costs beside the best of all after the last deadline."""
    last = f"{DEADLINES[-1]:g}"
    cases = sorted({case for case, _ in rows})
    solved = {name: {case for case in cases if "cost" in rows[case, name][last]} for name in names}
    anybody = set.union(*solved.values())
    best = {case: min(rows[case, name][last].get("cost", np.inf) for name in names)
            for case in anybody}  # fmt: skip
    for name in names:
        line = []
        for key in map("{:g}".format, DEADLINES):
            found = {case: rows[case, name][key] for case in anybody}
            found = {case: one["cost"] / best[case] for case, one in found.items() if "cost" in one}
            low, high = wilson(len(found), len(anybody))
            ratio = np.exp(np.mean(np.log(list(found.values())))) if found else np.nan
            line.append(f"{len(found)} ({100 * low:.0f} to {100 * high:.0f} %), {ratio:.3f}")
        first = [rows[case, name]["first"] for case in anybody]
        first = [1e3 * one["s"] for one in first if "cost" in one] or [np.nan]
        every = [one for case in cases for one in rows[case, name].values() if "cost" in one]
        bad = sum(one["faults"] > 0 for one in every)
        print(f"| {name} | {np.median(first):.0f}, {np.quantile(first, 0.9):.0f} ms | "
              + " | ".join(line) + f" | {bad} of {len(every)} |")  # fmt: skip


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--worlds", type=int, default=30, help="of each scene")
    parser.add_argument("--sets", default="homes,barn_60,problems")
    parser.add_argument("--out", type=Path, required=True, help="where rows are kept")
    given = parser.parse_args()
    wheelchair_gym.compiled.clock.perf_counter = time.process_time  # the planners' clock
    for settings in ENTRANTS.values():  # compiles
        planned(*next(drawn([HOME], [FIRST])), settings)
    for chosen, problems in sets(given.worlds, given.sets):
        jobs, places = {}, {}
        for (problem, footprint), (name, settings) in product(problems, ENTRANTS.items()):
            case = f"{problem.name} {problem.clearance:.3f}"
            key = run_key(source_digest(), chosen, case, settings)
            jobs[key], places[key] = (problem, footprint, settings), (case, name)
        rows = compute(jobs, lambda job: planned(*job), given.out)
        print(f"{chosen}: first path (median, 90 %), solved and cost at each deadline, invalid")
        summary({places[key]: row for key, row in rows.items()}, list(ENTRANTS))


if __name__ == "__main__":
    main()
