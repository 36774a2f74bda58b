"""Figures of the studies, in the manner of the sources."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from agents.evaluation.figures import COLOURS, DASHES, MARKS, WIDTH, legend_above, new_axes
from agents.studies.evidence import estimate
from agents.studies.model import Metric, Results

Figures = dict[str, tuple[str, Figure]]

_GREY = "#8a929a"


def named(metric: Metric) -> str:
    """A metric with its unit."""
    return f"{metric.name} [{metric.unit}]" if metric.unit else metric.name


def interval(r: Results, row: str, metric: Metric) -> tuple[float, float, float]:
    """Mean over the strata and its 95 % interval; NaN where a stratum has no two values."""
    sample = {k: v for k, v in r.sample(row, metric).items() if len(v) > 1}
    if not sample:
        return math.nan, math.nan, math.nan
    found = estimate([sample], [1.0])
    return found.value, *found.interval


def panels_of(count: int, height: float = 2.0) -> tuple[Figure, list[Axes]]:
    """A figure of panels, one below the other."""
    figure = Figure(figsize=(WIDTH, height * count), layout="constrained")
    return figure, list(np.atleast_1d(figure.subplots(count, 1, sharex=False)))


def bars(axes: Axes, x: Sequence[float], found: Sequence[tuple[float, float, float]], k: int,
          label: str) -> None:  # fmt: skip
    """Means with their intervals, as one line of a figure."""
    mean, low, high = (np.array(v) for v in zip(*found, strict=True))
    error = np.nan_to_num([np.maximum(mean - low, 0.0), np.maximum(high - mean, 0.0)])
    axes.errorbar(x, mean, yerr=error, fmt=MARKS[k % 8] + DASHES[0], color=COLOURS[k % 8],
                  markersize=4, capsize=2.5, linewidth=1.3, label=label)  # fmt: skip


def over(r: Results, what: str, metrics: Sequence[Metric]) -> Figures:
    """Each metric over what is varied: ours with intervals, the published scaled to begin alike."""
    series = list(dict.fromkeys(row.series for row in r.study.rows))
    figure, panels = panels_of(len(metrics))
    for axes, metric in zip(panels, metrics, strict=True):
        for k, name in enumerate(series):
            rows = [row for row in r.study.rows if row.series == name]
            x = [row.x for row in rows]
            found = [interval(r, row.label, metric) for row in rows]
            bars(axes, x, found, k, f"ours, {name}" if name else "ours")
            given = np.array([row.published.get(metric.key, np.nan) for row in rows])
            mean = np.array([value[0] for value in found])
            scale = np.nanmean(mean) / np.nanmean(given)
            if np.isfinite(scale):
                axes.plot(x, scale * given, ":", color=COLOURS[k % 8] if name else _GREY,
                          marker=".", linewidth=1.0,
                          label=f"published, {name}" if name else "published, scaled to one mean",
                          zorder=1)  # fmt: skip
        axes.set_ylabel(named(metric))
    panels[-1].set_xlabel(what)
    legend_above(figure, panels[0])
    words = (
        "Means over five maps with 95 % intervals; the published means (dotted) are scaled to the "
        "mean of ours, as maps and computers differ."
    )
    return {"trend": (words, figure)}


def boxes(r: Results, rows: Sequence[str], metrics: Sequence[Metric]) -> Figures:
    """Box plots of each metric (P1, figures 9 to 11), and mean ranks (its figure 12)."""
    figure, panels = panels_of(len(metrics), 2.2)
    for axes, metric in zip(panels, metrics, strict=True):
        axes.boxplot([r.pooled(row, metric) for row in rows], tick_labels=list(rows),
                     showfliers=False, medianprops={"color": COLOURS[1]})  # fmt: skip
        axes.tick_params(axis="x", labelsize=7.5)
        axes.set_ylabel(named(metric))
    table, plot = new_axes(2.8)
    for k, metric in enumerate(metrics):
        values = np.array([r.pooled(row, metric) for row in rows])  # (rows, runs)
        if metric.key == "improvement":
            values = -values
        rank = values.argsort(axis=0).argsort(axis=0) + 1.0
        plot.plot(range(len(rows)), rank.mean(axis=1), MARKS[k] + DASHES[k % 4], color=COLOURS[k],
                  label=metric.name)  # fmt: skip
    plot.set_xticks(range(len(rows)), list(rows), fontsize=7.5)
    plot.set_ylim(len(rows) + 0.2, 0.8)
    plot.set_ylabel("mean rank (1: best)")
    legend_above(table, plot)
    return {
        "boxes": ("Quartiles of all runs; whiskers reach 1.5 quartile ranges, outliers are left "
                  "out. As the paper's figures 9 to 11.", figure),
        "ranks": ("Mean rank among rivals that began alike, by metric: the paper's radar chart, "
                  "figure 12, as lines.", table),
    }  # fmt: skip


def ladder(r: Results, methods: Sequence[str], counts: Sequence[float]) -> Figures:
    """T2: lengths and times on the labs, and how often each method solves as clutter grows."""
    from agents.evaluation.metrics import wilson

    figure, panels = panels_of(2)
    for axes, metric in zip(panels, r.study.metrics[:2], strict=True):
        for k, method in enumerate(methods):
            rows = [row for row in r.study.rows if row.series == method]
            bars(axes, [row.x for row in rows],
                  [interval(r, row.label, metric) for row in rows], k, method)  # fmt: skip
        axes.set_ylabel(named(metric))
        axes.set_xticks([1, 2, 3], ["lab 1", "lab 2", "lab 3"])
    panels[1].set_ylim(bottom=0.0)
    legend_above(figure, panels[0])
    rungs, plot = new_axes(2.8)
    for k, method in enumerate(methods):
        found = []
        for row in (row for row in r.study.rows if row.series == f"{method}, clutter"):
            hits, runs = r.solved(row.label)
            low, high = wilson(hits, runs)
            found.append((100.0 * hits / max(runs, 1), 100.0 * low, 100.0 * high))
        bars(plot, counts, found, k, method)
    plot.set(xlabel="boxes in a room of 7 m x 5 m", ylabel="solved [%]", ylim=(-3, 103))
    legend_above(rungs, plot)
    return {
        "labs": ("Means with 95 % intervals on three labs.", figure),
        "ladder": ("Share of rooms solved as clutter grows, with 95 % Wilson intervals.",
                   rungs),
    }  # fmt: skip


def methods_compared(r: Results, rows: Sequence[str]) -> Figures:
    """Length against the shortest, and nodes, by method."""
    figure, axes = new_axes(3.2)
    for k, row in enumerate(rows):
        ratio, nodes = r.pooled(row, "ratio"), r.pooled(row, "nodes")
        if len(ratio) and len(nodes):
            axes.plot(ratio.mean(), nodes.mean(), MARKS[k % 8], color=COLOURS[k % 8], label=row,
                      markersize=7, fillstyle="full" if k < 8 else "none")  # fmt: skip
    axes.set_yscale("log")
    axes.set_xlabel("length / shortest (mean over rooms)")
    axes.set_ylabel("nodes")
    legend_above(figure, axes)
    return {"methods": ("Mean length as a multiple of the shortest, and nodes kept.", figure)}
