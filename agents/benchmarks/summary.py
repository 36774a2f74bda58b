"""What the runs of a planner benchmark say: medians, shares with intervals, and who leads."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from agents.benchmarks.cases import Case
from agents.benchmarks.entrants import Entrant
from agents.benchmarks.runs import COLD, FREE, Record
from agents.evaluation.metrics import wilson
from agents.evaluation.tables import Column, bounds_written, heading, written

Row = dict[str, Any]

ALL = "all"  # problems together
LATE_FACTOR = 1.25  # of a deadline that a planner was given: an answer that came later is none


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
    known = [value for value in values if value is not None]
    return float(np.median(known)) if known else None


def _share(hits: int, of: int, name: str) -> Row:
    low, high = wilson(hits, of)
    return {name: hits / of if of else None, f"{name}_low": low, f"{name}_high": high}


def _ratio(optima: Mapping[str, float | None]) -> Callable[[Record], float | None]:
    def ratio(record: Record) -> float | None:
        optimum = optima[record["problem"]]
        if not optimum:
            return None
        return float(record["length_m"] / optimum)

    return ratio


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
    ratio = _ratio(optima)
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
        **_share(len(good), len(free), "success"),
        "cold_s": _median(r["wall_s"] for r in records if r["budget"] == COLD and is_valid(r)),
        "first_path_s": _median(map(first_path_time, good)),
        "time_s": _median(record["wall_s"] for record in good),
        "cpu_s": _median(record["cpu_s"] for record in good),
        "ratio": _median(map(ratio, good)),
        "nodes": _median(record["nodes"] for record in good),
    }
    for key in ("turning_rad", "printed_turning", "clearance_min_m", "clearance_mean_m"):
        row[key] = _median(record[key] for record in good)
    for deadline in deadlines:
        tried = [r for r in records if r["budget"] == (deadline if entrant.timed else FREE)]
        limit = deadline * (LATE_FACTOR if entrant.timed else 1.0)
        late = [record for record in tried if record["wall_s"] > limit]
        done = [record for record in tried if is_valid(record) and record["wall_s"] <= limit]
        row |= _share(len(done), len(tried), f"success_{deadline_key(deadline)}")
        row[f"ratio_{deadline_key(deadline)}"] = _median(map(ratio, done))
        row[f"late_{deadline_key(deadline)}"] = len(late)
    return row


def summarise(
    entrants: Sequence[Entrant],
    cases: Sequence[Case],
    records: Sequence[Record],
    deadlines: Sequence[float],
) -> list[Row]:
    """A row for each entrant on each problem, and on all problems that it can take."""
    optima = {case.name: case.optimum for case in cases}
    rows = []
    for problem in [ALL, *optima] if len(cases) > 1 else optima:
        for entrant in entrants:
            of = [
                record
                for record in records
                if record["planner"] == entrant.name
                and problem in (ALL, record["problem"])
                and record["status"] != "not_for_this_map"
            ]
            if any(record["budget"] == FREE for record in of):
                rows.append(summary_row(entrant, problem, of, optima, deadlines))
    return rows


def ranking(rows: Sequence[Row], deadline: float) -> list[Row]:
    """The planners at a deadline, ranked by problems solved, then by length.

    Hybrids, which call another planner, and planners with an invalid path are left out.
    """
    place = rows[0]["problem"] if rows else ALL
    fit = [
        row
        for row in rows
        if row["problem"] == place
        and not row["calls"]
        and not row["invalid"]
        and not row["crashed"]
        and row[f"ratio_{deadline_key(deadline)}"] is not None
    ]
    return sorted(
        fit,
        key=lambda row: (
            -row[f"success_{deadline_key(deadline)}"],
            row[f"ratio_{deadline_key(deadline)}"],
        ),
    )


def columns(deadlines: Sequence[float]) -> list[Column]:
    """The columns of the table."""
    return [
        Column("success", "valid path", "%", 0, 100.0, interval=True),
        Column("invalid", "invalid paths", digits=0),
        Column("cold_s", "first call", "ms", 2, 1e3),
        Column("first_path_s", "first path", "ms", 2, 1e3),
        Column("time_s", "time", "ms", 2, 1e3),
        Column("cpu_s", "of it computing", "ms", 2, 1e3),
        Column("ratio", "length / optimum", digits=4),
        *(
            column
            for deadline in deadlines
            for column in (
                Column(f"ratio_{deadline_key(deadline)}", f"at {deadline_key(deadline)}", digits=4),
                Column(f"success_{deadline_key(deadline)}", "valid", "%", 0, 100.0, interval=True),
            )
        ),
        Column("nodes", "nodes", digits=0),
        Column("turning_rad", "turning", "rad", 3),
        Column("printed_turning", "f1 of RRT-WOA", digits=3),
        Column("clearance_min_m", "least clearance", "m", 3),
        Column("clearance_mean_m", "mean clearance", "m", 2),
    ]


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


def markdown(rows: Sequence[Row], deadlines: Sequence[float]) -> str:
    """A table for each problem, and the anytime ranking."""
    heads = columns(deadlines)
    lines = []
    for problem in dict.fromkeys(row["problem"] for row in rows):
        lines += [f"## {problem if problem != ALL else 'all problems'}", ""]
        lines.append("| planner | " + " | ".join(heading(column) for column in heads) + " |")
        lines.append("| --- |" + " ---: |" * len(heads))
        for row in rows:
            if row["problem"] != problem:
                continue
            cells = [entrant_title(row)]
            for column in heads:
                cell, interval = written(row[column.key], column), bounds_written(row, column)
                cells.append(f"{cell} ({interval})" if interval and cell != "-" else cell)
            lines.append("| " + " | ".join(cells) + " |")
        lines.append("")
    for deadline in deadlines:
        names = [
            f"{row['planner']} {row[f'ratio_{deadline_key(deadline)}']:.4f}"
            for row in ranking(rows, deadline)
        ]
        lines.append(f"Anytime ranking at {deadline_key(deadline)}: {', '.join(names) or 'none'}")
    return "\n".join(lines) + "\n"


def as_csv(rows: Sequence[Row]) -> str:
    """The rows as comma-separated values, with a header."""
    out = io.StringIO()
    writer = csv.DictWriter(out, fieldnames=list(rows[0]) if rows else ["planner"])
    writer.writeheader()
    for row in rows:
        writer.writerow(row | {"calls": " ".join(row["calls"])})
    return out.getvalue()
