"""Gain of the whale variants over RRT*, and its cost, by swarm size and map."""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from agents.studies import evidence
from agents.studies.model import LENGTH, Results

BASELINE: Final = "rrt_star"
SHORTEST: Final = "visibility (shortest)"
ALL: Final = "all maps"


def gains(r: Results) -> list[dict[str, Any]]:
    """Return a row for each row of the study, with its gains over RRT* and its CPU time.

    A gain is the relative difference of mean lengths [%] over equal seeds, with its 95 % interval:
    [gain, low, high] for each map, and for all.
    """
    theirs, found = r.sample(BASELINE, LENGTH, True), []
    for row in r.study.rows:
        ours = r.sample(row.label, LENGTH, True)
        change = {}
        for name in (*ours, ALL):
            a, b = (of if name == ALL else {name: of[name]} for of in (ours, theirs))
            got = evidence.between(a, b, -1.0, 1.0, "", True)
            change[name] = [round(value, 2) for value in (got.effect, got.low, got.high)]
        times = np.concatenate([*r.sample(row.label, r.study.metric("time_s")).values()])
        solved, runs = r.solved(row.label)
        found.append({
            "row": row.label, "series": row.series, "x": row.x if row.series else None,
            "solved": solved, "runs": runs, "time_s": float(f"{times.mean():.3g}"), "gain": change,
        })  # fmt: skip
    return found
