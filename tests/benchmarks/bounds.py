"""Trials of faults: the worst of each figure beside its bound, as a table and as JSON.

A trial gives figures: name -> (measured, bound), where a bound of None is none. Figures whose name
begins with `min_` have lower bounds.
"""

import argparse
import json
import sys
from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Any

Figures = Mapping[str, tuple[float, float | None]]
Trial = Callable[[str, int], Figures]  # of a case, by number


def summary(trials: Sequence[Figures]) -> dict[str, dict[str, Any]]:
    """Return the worst of each figure beside its bound, and whether all kept to it."""
    rows = {}
    for key in dict.fromkeys(key for figures in trials for key in figures):
        low = key.startswith("min_")
        worst = float((min if low else max)(of[key][0] for of in trials if key in of))
        bound = next(of[key][1] for of in trials if key in of)
        kept = bound is None or bool(worst >= bound if low else worst <= bound)
        bound = None if bound is None else round(float(bound), 3)
        rows[key] = {"worst": round(worst, 3), "bound": bound, "kept": kept}
    return rows


def tried(trial: Trial, name: str, number: int) -> Figures:
    """Make a trial; an error in it counts as a bound that was passed, and the others go on."""
    try:
        return trial(name, number)
    except (AssertionError, RuntimeError) as error:
        print(f"{name}, trial {number}: {error!r}", file=sys.stderr, flush=True)
        return {"errors": (1, 0)}


def measure(cases: Collection[str], trial: Trial, doc: str) -> int:
    """Make the trials that the command line asks for; the exit code says if bounds were kept."""
    parser, names = argparse.ArgumentParser(description=doc), ", ".join(map(repr, cases))
    parser.add_argument("trials", type=int, nargs="?", default=100)
    parser.add_argument("cases", nargs="*", metavar="case", help=names.replace("%", "%%"))
    given = parser.parse_intermixed_args()
    for name in given.cases:
        if name not in cases:
            parser.error(f"{name!r} is no case; expected any of {names}")
    if given.trials < 1:
        parser.error(f"{given.trials} trials; expected at least 1")
    chosen, report = given.cases or list(cases), {}
    print("| case | figure | worst | bound |\n| --- | --- | --- | --- |", flush=True)
    for name in chosen:
        print(f"case {len(report) + 1} of {len(chosen)}: {name}", file=sys.stderr, flush=True)
        report[name] = summary([tried(trial, name, number) for number in range(given.trials)])
        for key, row in report[name].items():
            mark = "" if row["kept"] else " **passed**"
            print(f"| {name} | {key} | {row['worst']:g} | {row['bound']}{mark} |", flush=True)
    print(json.dumps({"trials": given.trials, "cases": report}, indent=1))
    return 0 if all(row["kept"] for rows in report.values() for row in rows.values()) else 1
