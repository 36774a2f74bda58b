"""The summary of an evaluation as numbers a person reads: one list of columns for every table."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

Row = Mapping[str, Any]


class Column(NamedTuple):
    """One figure of the summary: its key, its heading and unit, and how it is written."""

    key: str
    name: str
    unit: str = ""
    digits: int = 2
    factor: float = 1.0
    interval: bool = False


COLUMNS = (
    Column("episodes", "episodes", digits=0),
    Column("success", "success", "%", 1, 100.0, interval=True),
    Column("wide", "success, 5 cm of margin", "%", 1, 100.0, interval=True),
    Column("margin", "least margin", "m", 3),
    Column("collision", "collision", "%", 1, 100.0, interval=True),
    Column("at_fault", "caused by the chair", "%", 1, 100.0),
    Column("timeout", "timeout", "%", 1, 100.0, interval=True),
    Column("arrived", "own estimate arrived", "%", 1, 100.0),
    Column("spl", "SPL", digits=3),
    Column("barn", "BARN score", digits=3),
    Column("barn_own", "BARN score at own speed", digits=3),
    Column("time", "time", "s", 1),
    Column("length", "length", "m"),
    Column("halts", "halts"),
    Column("replans", "replans"),
    Column("clearance_min", "clearance min", "m", 3),
    Column("clearance_mean", "clearance mean", "m", 3),
    Column("accel_rms", "RMS acceleration", "m/s²"),
    Column("jerk_rms", "RMS jerk", "m/s³"),
    Column("rough_share", "above 0.9 m/s²", "% of time", 1, 100.0),
    Column("energy_per_m", "energy", "Wh/m"),
    Column("plan_ms_p50", "plan p50", "ms", 1),
    Column("plan_ms_p95", "plan p95", "ms", 1),
    Column("act_ms_p50", "act p50", "ms"),
    Column("act_ms_p95", "act p95", "ms"),
)


def known(value: Any) -> bool:
    """Whether a figure exists: neither null nor NaN nor infinite."""
    return value is not None and math.isfinite(value)


def written(value: float | None, column: Column) -> str:
    """A figure as its column writes it; a dash where there is none."""
    return (
        f"{value * column.factor:.{column.digits}f}" if known(value) and value is not None else "-"
    )


def bounds_written(row: Row, column: Column) -> str:
    """The 95 % interval of a share as 'low-high', or nothing where the column has none."""
    low, high = row.get(f"{column.key}_low"), row.get(f"{column.key}_high")
    if not column.interval or not (known(low) and known(high)):
        return ""
    return f"{written(low, column)}-{written(high, column)}"


def heading(column: Column) -> str:
    """A column's name with its unit."""
    return f"{column.name} [{column.unit}]" if column.unit else column.name


def overall(summary: Sequence[Row]) -> list[Row]:
    """The rows over all scenes: best first, by success, then by SPL."""
    rows = [row for row in summary if row["scene"] == "all"]
    return sorted(rows, key=lambda row: (-(row["success"] or 0.0), -(row["spl"] or 0.0)))


def by_scene(summary: Sequence[Row]) -> list[Row]:
    """The rows of single scenes, in the order given."""
    return [row for row in summary if row["scene"] != "all"]


def markdown(evaluation: Mapping[str, Any], first: str = "") -> str:
    """The summary as a Markdown table, with the command that made it; `first` stands before it."""
    names = ["policy", "scene", *(heading(column) for column in COLUMNS)]
    lines = [
        f"# {evaluation['title']}",
        "",
        f"`{evaluation['command']}`",
        "",
        "Shares carry their 95 % Wilson interval.",
        "",
        *([first, ""] if first else []),
        "| " + " | ".join(names) + " |",
        "| --- | --- |" + " ---: |" * len(COLUMNS),
    ]
    for row in [*overall(evaluation["summary"]), *by_scene(evaluation["summary"])]:
        cells = [str(row["policy"]), str(row["scene"])]
        for column in COLUMNS:
            interval = bounds_written(row, column)
            figure = written(row.get(column.key), column)
            cells.append(f"{figure} ({interval})" if interval else figure)
        lines.append("| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |")
    return "\n".join(lines) + "\n"
