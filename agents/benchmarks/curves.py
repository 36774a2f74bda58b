"""The plot of a planner benchmark: success and length over time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from textwrap import shorten
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from agents.benchmarks.planner_benchmark import (
    FREE,
    LATE_FACTOR,
    PlannerBenchmark,
    Record,
    Row,
    entrant_title,
    first_path_time,
    is_valid,
)
from agents.evaluation.plots import COLOURS, DASHES, LOOK, MARKS
from wheelchair_gym.base.files import atomic_write

FLOOR = 1e-3  # % above the optimum: smaller values are drawn here
_PANEL = (4.6, 3.1)  # inches
_LEGEND = 0.19  # inches a line
_DPI = 130


def draw(benchmark: PlannerBenchmark, rows: Sequence[Row], path: str | Path) -> None:
    """Write a PNG with two panels a problem, of the runs of a benchmark and their summary.

    Raises:
        InputError: the file cannot be written.
    """
    records, optima = list(benchmark.records.values()), benchmark.optima
    names = list(dict.fromkeys(row["planner"] for row in rows))
    looks: dict[str, dict[str, Any]] = {
        name: {
            "color": COLOURS[i % len(COLOURS)],
            "linestyle": DASHES[(i // len(COLOURS)) % len(DASHES)],
            "marker": MARKS[(i + i // len(COLOURS)) % len(MARKS)],
        }
        for i, name in enumerate(names)
    }
    problems = [name for name in optima if any(row["problem"] == name for row in rows)]
    width, height = 2 * _PANEL[0] + 3.4, max(_PANEL[1] * len(problems), _LEGEND * len(names) + 0.5)
    with mpl.rc_context(LOOK):
        figure = Figure(figsize=(width, height), layout="constrained")
        grid = figure.subplots(len(problems), 2, squeeze=False)
        for (left, right), problem in zip(grid, problems, strict=True):
            of = [record for record in records if record["problem"] == problem]
            here = [row for row in rows if row["problem"] == problem]
            for row in here:
                its = [record for record in of if record["planner"] == row["planner"]]
                _success(left, its, looks[row["planner"]])
                _lengths(right, its, optima[problem], benchmark.deadlines, looks[row["planner"]])
            _dress(left, right, problem, here)
        titles = {row["planner"]: entrant_title(row) for row in reversed(rows)}
        lines = [
            mpl.lines.Line2D([], [], **looks[name], markersize=4, label=shorten(titles[name], 60))
            for name in names
        ]
        figure.legend(handles=lines, loc="outside right upper", fontsize=7.5)
        with atomic_write(path) as part:
            figure.savefig(part, dpi=_DPI)


def _success(axes: Axes, records: Sequence[Record], look: Mapping[str, Any]) -> None:
    """Share of runs that had a valid first path by a time."""
    free = [record for record in records if record["budget"] == FREE]
    times = np.sort([1e3 * first_path_time(record) for record in free if is_valid(record)])
    if not len(times):
        return
    share = 100.0 * np.arange(1, len(times) + 1) / len(free)
    axes.step(
        np.append(times[0], times), np.append(0.0, share), where="post", linewidth=1.3,
        color=look["color"], linestyle=look["linestyle"],
    )  # fmt: skip
    axes.plot(times[-1], share[-1], marker=look["marker"], color=look["color"], markersize=4)


def _lengths(
    axes: Axes,
    records: Sequence[Record],
    optimum: float | None,
    deadlines: Sequence[float],
    look: Mapping[str, Any],
) -> None:
    """Median length above the optimum, at deadlines, or when a planner without them ended."""
    if not optimum:
        return
    valid = [record for record in records if is_valid(record)]
    if any(record["budget"] in deadlines for record in records):
        in_time = [
            (deadline, [r for r in valid if r["budget"] == deadline and r["wall_s"] <= limit])
            for deadline, limit in ((deadline, LATE_FACTOR * deadline) for deadline in deadlines)
        ]
    else:
        free = [record for record in valid if record["budget"] == FREE]
        in_time = [(float(np.median([r["wall_s"] for r in free])), free)] if free else []
    points = [(when, [record["length_m"] for record in of]) for when, of in in_time if of]
    if not points:
        return
    over = [100.0 * (np.percentile(lengths, [25, 50, 75]) / optimum - 1.0) for _, lengths in points]
    low, middle_, high = np.maximum(np.array(over), FLOOR).T
    axes.errorbar(
        [1e3 * when for when, _ in points], middle_, yerr=[middle_ - low, high - middle_],
        linewidth=1.3, markersize=4, elinewidth=0.7, capsize=2, **look,
    )  # fmt: skip


def _dress(left: Axes, right: Axes, problem: str, rows: Sequence[Row]) -> None:
    runs = max((row["runs"] for row in rows), default=0)
    left.set_title(f"{problem}: valid first path ({runs} runs)", fontsize=9, loc="left")
    left.set(xscale="log", ylim=(-2, 103), xlabel="time [ms]", ylabel="runs [%]")
    right.set_title(f"{problem}: median, quartiles", fontsize=9, loc="left")
    right.set(xscale="log", yscale="log", xlabel="time [ms]", ylabel="longer than the optimum [%]")
    if right.has_data():
        right.axhline(FLOOR, color=LOOK["grid.color"], linewidth=0.8)
        right.text(
            0.99, FLOOR * 1.15, f"at most {FLOOR:g} %", fontsize=7, ha="right",
            transform=right.get_yaxis_transform(),
        )  # fmt: skip
        right.set_ylim(bottom=0.6 * FLOOR)
    for axis in (left.xaxis, right.xaxis, right.yaxis):
        axis.set_major_formatter(lambda value, _: f"{value:g}")
