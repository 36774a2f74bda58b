"""Results of a planner benchmark: medians, shares with intervals, and the ranking."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from agents import read_data
from agents.benchmarks.entrants import Entrant
from agents.evaluation.statistics import share
from agents.evaluation.tables import Cell, Column, Table

Row = dict[str, Any]
Record = dict[str, Any]

COLD, FREE = "cold", "free"  # budgets without a deadline: the first call on a map, and later calls
ALL = "all"  # problems together
LATE_FACTOR = 1.25  # an answer after this multiple of the deadline does not count


def deadline_key(deadline: float) -> str:
    """The part of a key for a deadline."""
    return f"{deadline:g}s"


def is_valid(record: Record) -> bool:
    """Whether a run ended with a path without faults."""
    return record.get("length_m") is not None and record["faults"] == 0


def first_path_time(record: Record) -> float:
    """Time of the first path [s]; of the whole run where the planner does not report it."""
    reported = record.get("first_path_s")
    return float(record["wall_s"] if reported is None else reported)


def _median(values: Iterable[float | None]) -> float | None:
    given = [value for value in values if value is not None]
    return float(np.median(given)) if given else None


def summary_row(
    entrant: Entrant,
    problem: str,
    records: Sequence[Record],
    optima: Mapping[str, float | None],
    deadlines: Sequence[float],
) -> Row:
    """The figures of one entrant on one problem, or on all.

    Medians of times and path measures are over runs without a deadline that ended with a valid
    path. For a planner without deadlines a run counts at a deadline if it had ended by then.
    """

    def ratios(of: Iterable[Record]) -> float | None:
        lengths = ((record["length_m"], optima[record["problem"]]) for record in of)
        return _median(float(length / optimum) for length, optimum in lengths if optimum)

    free = [record for record in records if record["budget"] == FREE]
    good = [record for record in free if is_valid(record)]
    paths = [record for record in records if record.get("length_m") is not None]
    invalid = [record for record in paths if record["faults"]]
    crashed = [record for record in records if record["status"] == "crashed"]
    row: Row = {
        "planner": entrant.name,
        "package": entrant.package,
        "calls": list(entrant.calls),
        "problem": problem,
        "runs": len(free),
        "paths": len(paths),
        "invalid": len(invalid),
        "crashed": len(crashed),
        "why": next((str(r["why"]) for r in [*crashed, *invalid] if r.get("why")), None),
        **share("success", len(good), len(free)),
        "cold_s": _median(r["wall_s"] for r in records if r["budget"] == COLD and is_valid(r)),
        "first_path_s": _median(map(first_path_time, good)),
        "time_s": _median(record["wall_s"] for record in good),
        "cpu_s": _median(record["cpu_s"] for record in good),
        "ratio": ratios(good),
    }
    for key in ("nodes", "turning_rad", "printed_turning", "clearance_min_m", "clearance_mean_m"):
        row[key] = _median(record[key] for record in good)
    for deadline in deadlines:
        tried = [r for r in records if r["budget"] == (deadline if entrant.timed else FREE)]
        limit = deadline * (LATE_FACTOR if entrant.timed else 1.0)
        in_time = [record for record in tried if record["wall_s"] <= limit]
        done = [record for record in in_time if is_valid(record)]
        row |= share(f"success_{deadline_key(deadline)}", len(done), len(tried))
        row[f"ratio_{deadline_key(deadline)}"] = ratios(done)
        row[f"late_{deadline_key(deadline)}"] = len(tried) - len(in_time)
    return row


def summarise(
    entrants: Sequence[Entrant],
    optima: Mapping[str, float | None],
    records: Sequence[Record],
    deadlines: Sequence[float],
) -> list[Row]:
    """A row for each entrant on each problem of `optima`, and on all."""
    rows = []
    for problem in [ALL, *optima] if len(optima) > 1 else optima:
        for entrant in entrants:
            of = [
                record
                for record in records
                if record["planner"] == entrant.name and problem in (ALL, record["problem"])
            ]
            if any(record["budget"] == FREE for record in of):
                rows.append(summary_row(entrant, problem, of, optima, deadlines))
    return rows


def ranking(rows: Sequence[Row], deadline: float) -> list[Row]:
    """The planners at a deadline, ranked by problems solved, then by length.

    Hybrids, which call another planner, and planners with an invalid path are left out.
    """
    solved, ratio = (f"{name}_{deadline_key(deadline)}" for name in ("success", "ratio"))
    excluded = "calls", "invalid", "crashed"
    eligible = [
        row
        for row in rows
        if row["problem"] == rows[0]["problem"]
        and not any(row[key] for key in excluded)
        and row[ratio] is not None
    ]
    return sorted(eligible, key=lambda row: (-row[solved], row[ratio]))


def columns(deadlines: Sequence[float]) -> list[Column]:
    """The columns of the table, after the planner's."""
    every = [Column(**column) for column in read_data("planner_benchmark.yaml")["columns"]]
    first = next(k for k, column in enumerate(every) if "{deadline}" in column.key)
    timed = [
        column._replace(key=column.key.format(deadline=key), name=column.name.format(deadline=key))
        for key in map(deadline_key, deadlines)
        for column in every[first : first + 2]
    ]
    return [*every[:first], *timed, *every[first + 2 :]]


def terminal(rows: Sequence[Row], deadlines: Sequence[float]) -> str:
    """The main columns, with the last three deadlines, and the anytime ranking."""
    keys = list(read_data("planner_benchmark.yaml")["terminal"])
    keys += [f"ratio_{deadline_key(deadline)}" for deadline in deadlines[-3:]]
    return _text(rows, deadlines, [c for c in columns(deadlines) if c.key in keys], Table.text)


def markdown(rows: Sequence[Row], deadlines: Sequence[float]) -> str:
    """A table with all columns for each problem, and the anytime ranking."""
    return _text(rows, deadlines, columns(deadlines), Table.markdown)


def entrant_title(row: Row) -> str:
    """An entrant's name with remarks."""
    marks = []
    if row["calls"]:
        marks.append("hybrid: calls " + ", ".join(row["calls"]))
    if row["invalid"]:
        marks.append(f"INVALID: {row['invalid']} of {row['paths']} paths")
    if row["crashed"]:
        marks.append(f"CRASHED: {row['crashed']}")
    return str(row["planner"]) + (f" ({'; '.join(marks)})" if marks else "")


def _text(
    rows: Sequence[Row],
    deadlines: Sequence[float],
    heads: Sequence[Column],
    written: Callable[[Table], str],
) -> str:
    text = ""
    for problem in dict.fromkeys(row["problem"] for row in rows):
        body = [
            [Cell(entrant_title(row)), *(column.cell(row) for column in heads)]
            for row in rows
            if row["problem"] == problem
        ]
        table = Table("", [Column("planner", "planner", None), *heads], [body])
        text += (
            f"## {'all problems' if problem == ALL else problem}\n\n{written(table).rstrip()}\n\n"
        )
    for deadline in deadlines:
        ratio = f"ratio_{deadline_key(deadline)}"
        names = [f"{row['planner']} {row[ratio]:.4f}" for row in ranking(rows, deadline)]
        text += f"Anytime ranking at {deadline_key(deadline)}: {', '.join(names) or 'none'}\n"
    return text
