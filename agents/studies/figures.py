"""Figures of the studies, in the style of the sources."""

import math
from collections.abc import Callable, Mapping, Sequence
from itertools import product
from typing import Any, Final

import numpy as np
import shapely
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle

from agents.evaluation.plots import COLOURS, DASHES, MARKS, error_bars, new_axes, new_panels
from agents.evaluation.statistics import estimate, wilson
from agents.studies.claims import between, fit_reading
from agents.studies.experiments import lab_problem, problem_of
from agents.studies.model import LENGTH, NODES, RATIO, Metric, Results, Row
from planners import make_planner
from wheelchair_gym.base.arrays import Array
from wheelchair_gym.rendering import palette
from wheelchair_gym.scenes import make_scene, published

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
            got = between(a, b, -1.0, 1.0, "", True)
            change[name] = [round(value, 2) for value in (got.effect, got.low, got.high)]
        times = np.concatenate([*r.sample(row.label, r.study.metric("time_s")).values()])
        solved, runs = r.solved(row.label)
        found.append({
            "row": row.label, "series": row.series, "x": row.x if row.series else None,
            "solved": solved, "runs": runs, "time_s": float(f"{times.mean():.3g}"), "gain": change,
        })  # fmt: skip
    return found


Figures = dict[str, Figure]


def mean_interval(r: Results, row: str, metric: Metric) -> tuple[float, float, float]:
    """Mean over the strata and its 95 % interval; NaN where a stratum has no two values."""
    sample = {k: v for k, v in r.sample(row, metric).items() if len(v) > 1}
    if not sample:
        return math.nan, math.nan, math.nan
    found = estimate([sample], [1.0])
    return found.value, *found.interval


def mean_bars(
    axes: Axes, r: Results, rows: Sequence[Row], metric: Metric, k: int, label: str,
    x: Any = None, line: str = "-",
) -> Any:  # fmt: skip
    """Draw the means of rows with their intervals, at x or at the rows' own; the means."""
    found = [mean_interval(r, row.label, metric) for row in rows]
    error_bars(axes, [row.x for row in rows] if x is None else x, found, k, label, line)
    return np.array(found)[:, 0]


def trend_figures(r: Results, what: str) -> Figures:
    """Each metric over the varied quantity: our means, and the published ones, scaled."""
    metrics = r.study.metrics
    series = list(dict.fromkeys(row.series for row in r.study.rows))
    figure, panels = new_panels(2.0 * len(metrics), len(metrics))
    for axes, metric in zip(panels, metrics, strict=True):
        for k, name in enumerate(series):
            rows = r.study.series(name)
            mean = mean_bars(axes, r, rows, metric, k, f"ours, {name}" if name else "ours")
            given = np.array([row.published.get(metric.key, np.nan) for row in rows])
            scale = np.nanmean(mean) / np.nanmean(given)
            if np.isfinite(scale):
                axes.plot([row.x for row in rows], scale * given, ":",
                          color=COLOURS[k % 8] if name else _GREY, marker=".", linewidth=1.0,
                          label=f"published, {name}" if name else "published, scaled to one mean",
                          zorder=1)  # fmt: skip
        axes.set_ylabel(metric.heading)
    panels[-1].set_xlabel(what)
    return {"trend": figure}


def box_figures(r: Results) -> Figures:
    """Box plots of three metrics (P1, figures 9 to 11), and mean ranks (its figure 12)."""
    rows, metrics = [row.label for row in r.study.series("exact")], r.study.metrics[:3]
    figure, panels = new_panels(2.2 * len(metrics), len(metrics))
    for axes, metric in zip(panels, metrics, strict=True):
        axes.boxplot([r.pooled(row, metric) for row in rows], tick_labels=list(rows),
                     showfliers=False, medianprops={"color": COLOURS[1]})  # fmt: skip
        axes.tick_params(axis="x", labelsize=7.5)
        axes.set_ylabel(metric.heading)
    table, plot = new_axes(2.8)
    for k, metric in enumerate(metrics):
        values = np.array([r.pooled(row, metric) for row in rows])  # (rows, runs)
        if metric.key == "improvement":
            values = -values
        rank = values.argsort(axis=0).argsort(axis=0) + 1.0
        plot.plot(range(len(rows)), rank.mean(axis=1), MARKS[k] + DASHES[k % 4], color=COLOURS[k],
                  label=metric.name)  # fmt: skip
    plot.set_xticks(range(len(rows)), list(rows), fontsize=7.5)
    plot.set(ylim=(len(rows) + 0.2, 0.8), ylabel="mean rank (1: best)")
    return {"boxes": figure, "ranks": table, "paths": _smoothed_paths()}


def _smoothed_paths() -> Figure:
    """P1, figures 13 and 14: an RRT's path and the smoothed one, for three seeds of two paths."""
    planner: Any = make_planner("rrt_woa")
    figure, panels = new_panels(7.4, 3, 2)
    for axes, (seed, path) in zip(panels, product(range(3), (1, 2)), strict=True):
        scene = {"name": "design_lab", "path": path}
        _draw_scene(axes, scene)
        for k, (label, of) in enumerate((("RRT", planner.tree), ("smoothed", planner))):
            line = of.plan(problem_of(scene, 0.4), np.random.default_rng(seed)).path
            axes.plot(*line[:, :2].T, DASHES[1 - k], color=COLOURS[k], label=label)
        axes.set_title(f"path {path}, seed {seed}")
    return figure


def ladder_figures(r: Results) -> Figures:
    """T2: lengths and times on the labs, and how often each method solves as clutter grows."""
    methods = list(dict.fromkeys(row.series.partition(",")[0] for row in r.study.rows))
    figure, panels = new_panels(4.0, 2)
    for axes, metric in zip(panels, r.study.metrics[:2], strict=True):
        for k, method in enumerate(methods):
            mean_bars(axes, r, r.study.series(method), metric, k, method)
        axes.set_ylabel(metric.heading)
        axes.set_xticks([1, 2, 3], ["lab 1", "lab 2", "lab 3"])
    panels[1].set_ylim(bottom=0.0)
    rungs, plot = new_axes(2.8)
    for k, method in enumerate(methods):
        found = []
        rows = r.study.series(f"{method}, clutter")
        for row in rows:
            hits, runs = r.solved(row.label)
            low, high = wilson(hits, runs)
            found.append((100.0 * hits / max(runs, 1), 100.0 * low, 100.0 * high))
        error_bars(plot, [row.x for row in rows], found, k, method, "-")
    plot.set(xlabel="boxes in a room of 7 m x 5 m", ylabel="solved [%]", ylim=(-3, 103))
    return {"labs": figure, "ladder": rungs, "paths": _lab_paths(r, methods[:3])}


def _lab_paths(r: Results, methods: Sequence[str]) -> Figure:
    """T2, figures 3.7 and 3.19 to 3.27: trees and paths on the labs, one seed."""
    figure, panels = new_panels(4.6, 3, len(methods))
    jobs = [row.jobs for method in methods for row in r.study.series(method)]
    for k, of in enumerate(jobs):
        ((lab, job),) = of.items()
        axes, problem = panels[len(methods) * (k % 3) + k // 3], lab_problem(job["lab"])
        plan = make_planner(job["planner"]).plan(problem, np.random.default_rng(0))
        for box in shapely.get_parts(problem.space.solid):
            axes.fill(*shapely.get_coordinates(box).T, color=_SOLID, linewidth=0)
        axes.plot(*plan.tree.reshape(-1, 2, 2).T, color=COLOURS[5], linewidth=0.5)
        axes.plot(*plan.path[:, :2].T, color=COLOURS[1], linewidth=1.5)
        _ends(axes, problem.start, problem.goal)
        axes.set(aspect="equal", xlim=(0, published.LAB_SIZE[0]), ylim=(0, published.LAB_SIZE[1]))
        axes.set_title(f"{methods[k // 3]}, {lab}", fontsize=8)
        axes.tick_params(labelsize=6)
    return figure


def method_figures(r: Results) -> Figures:
    """Length against the shortest, and nodes, by method."""
    rows = [row.label for row in r.study.rows]
    figure, axes = new_axes(3.2)
    for k, row in enumerate(rows):
        ratio, nodes = (r.pooled(row, metric) for metric in (RATIO, NODES))
        if len(ratio) and len(nodes):
            axes.plot(ratio.mean(), nodes.mean(), MARKS[k % 8], color=COLOURS[k % 8], label=row,
                      markersize=7, fillstyle="full" if k < 8 else "none")  # fmt: skip
    axes.set(yscale="log", xlabel="length / shortest (mean over rooms)", ylabel="nodes")
    return {"methods": figure}


_GREY = palette.css(palette.MAPPED)
_SOLID = palette.css(palette.SOLID)
TRACK = 0.36  # m: P2's robot
WHEEL = 0.075  # m: radius, P2
SAMPLING = 0.1  # s: P2


def _draw_scene(axes: Axes, scene: Any) -> None:
    """Draw the obstacles of a scene, its start and its goal."""
    episode = make_scene(scene).sample(np.random.default_rng(0))
    for x0, y0, x1, y1 in episode.walls:
        axes.plot([x0, x1], [y0, y1], color=_SOLID, linewidth=1.2, solid_capstyle="round")
    _discs(axes, episode.discs)
    _ends(axes, episode.start[:2], episode.goal[:2])
    axes.grid(visible=False)
    axes.set(aspect="equal", xlabel="x [m]", ylabel="y [m]")


def _discs(axes: Axes, discs: Any) -> None:
    for x, y, radius in discs:
        axes.add_patch(Circle((x, y), radius, color=_SOLID, alpha=0.55, linewidth=0))


def _ends(axes: Axes, start: Any, goal: Any) -> None:
    axes.plot(*start, "o", color=palette.css(palette.START), markersize=6, zorder=5)
    axes.plot(*goal, "*", color=palette.css(palette.GOAL), markersize=10, zorder=5)


def map_figures(r: Results, rows: Sequence[str], best: str, scene: str) -> Figures:
    """Lengths by map beside the shortest, and paths of one seed (T1, figure 3.6)."""
    strata = list(r.sample(rows[0], LENGTH))
    figure, axes = new_axes(2.9)
    for k, row in enumerate([*rows, best]):
        ones = [estimate([{s: v}], [1.0]) for s, v in r.sample(row, LENGTH).items()]
        x = np.arange(len(strata)) + (k - 1.5) * 0.12
        error_bars(axes, x, [(one.value, *one.interval) for one in ones], k, row)
    axes.set_xticks(range(len(strata)), [f"map {s[-1]}" for s in strata])
    axes.set_ylabel(LENGTH.heading)
    drawn, plot = new_axes(3.4)
    jobs = {row.label: row.jobs[scene] for row in r.study.rows}
    _draw_scene(plot, jobs[best]["scene"])
    for k, row in enumerate([*rows, best]):
        for seed in range(20):  # the first that finds a path
            planner, problem = make_planner(jobs[row]["planner"]), problem_of(jobs[row]["scene"])
            plan = planner.plan(problem, np.random.default_rng(seed))
            if len(plan.path):
                plot.plot(*plan.path[:, :2].T, DASHES[k % 4], color=COLOURS[k], linewidth=1.5,
                          label=row)  # fmt: skip
                break
    return {"lengths": figure, "paths": drawn}


def _kept(r: Results, row: str) -> list[Mapping[str, Any]]:
    return [rec for (label, _), of in r.runs.items() if label == row for rec in of if "line" in rec]


def velocities(line: Array) -> dict[str, Array]:
    """P2 (6) to (8), corrected: speeds of platform and wheels along a curve (n, 2) [m], by label.

    Points are `SAMPLING` apart in time.
    """
    velocity = np.gradient(line, SAMPLING, axis=0)
    second = np.gradient(velocity, SAMPLING, axis=0)
    v = np.hypot(*velocity.T)
    cross = velocity[:, 0] * second[:, 1] - velocity[:, 1] * second[:, 0]
    w = cross / np.maximum(v**2, 1e-9)
    right, left = v + 0.5 * TRACK * w, v - 0.5 * TRACK * w
    return {"v [m/s]": v, "ω [rad/s]": w, "right [m/s]": right, "left [m/s]": left,
            "right [rad/s]": right / WHEEL, "left [rad/s]": left / WHEEL}  # fmt: skip


def convergence_figures(r: Results) -> Figures:
    """P2's figures: paths, convergence, and velocities of platform and wheels."""
    names = {"pso": "PSO", "pso_chaotic": "chaotic PSO"}
    best = {row: min(_kept(r, row), key=lambda rec: rec["costs"][-1]) for row in names}
    figure, axes = new_axes(2.8)
    for k, (row, label) in enumerate(names.items()):
        curves = np.array([rec["costs"] for rec in _kept(r, row)])
        x = np.arange(1, curves.shape[1] + 1)
        axes.plot(x, np.median(curves, axis=0), DASHES[k], color=COLOURS[k], label=label)
        axes.fill_between(x, *np.percentile(curves, [10, 90], axis=0), color=COLOURS[k],
                          alpha=0.15, linewidth=0)  # fmt: skip
    axes.set(xlabel="iteration", ylabel="least cost [m]")
    paths, plot = new_axes(3.9)
    _discs(plot, published.CHAOTIC_PSO_DISCS)
    for k, (row, label) in enumerate(names.items()):
        plot.plot(*np.array(best[row]["line"]).T, DASHES[k], color=COLOURS[k], label=label)
    _ends(plot, (1, 1), (9, 9))
    plot.set(xlim=(0, 10), ylim=(0, 10), aspect="equal", xlabel="x [m]", ylabel="y [m]")
    speeds, panels = new_panels(9.0, 6)
    for k, (row, label) in enumerate(names.items()):
        found = velocities(np.array(best[row]["line"]))
        for axes_, (name, values) in zip(panels, found.items(), strict=True):
            t = SAMPLING * np.arange(len(values))
            axes_.plot(t, values, DASHES[k], color=COLOURS[k], linewidth=1.2, label=label)
            axes_.set_ylabel(name)
    panels[-1].set_xlabel("time [s]")
    return {"convergence": figure, "paths": paths, "velocities": speeds}


def disc_figures(r: Results) -> Figures:
    """R1: lengths by goal and method, and paths of the best runs."""
    methods = list(dict.fromkeys(row.label.partition(" (")[0] for row in r.study.rows))
    goals = [f"({goal})" for goal in published.GREY_WOLF_GOALS]
    figure, axes = new_axes(3.2)
    for k, method in enumerate(methods):
        rows = [row for row in r.study.rows if row.label.startswith(f"{method} (")]
        x = np.arange(len(goals)) + (k - 2) * 0.13
        mean_bars(axes, r, rows, LENGTH, k, method, x, "")
        given = [row.published.get("length_m", np.nan) for row in rows]
        axes.plot(x, given, "_", color=_GREY, markersize=9, markeredgewidth=1.6,
                  label="published" if k == 0 else None)  # fmt: skip
    axes.set_xticks(range(len(goals)), goals)
    axes.set_ylabel(LENGTH.heading)
    paths, panels = new_panels(6.6, 3, 2)
    for goal, plot in zip(goals, panels, strict=True):
        _discs(plot, published.GREY_WOLF_DISCS)
        for k, method in enumerate(methods):
            kept = _kept(r, f"{method} {goal}")
            if kept:
                line = np.array(min(kept, key=lambda rec: rec["length_m"])["line"])
                plot.plot(*line.T, DASHES[k % 4], color=COLOURS[k], linewidth=1.1, label=method)
        _ends(plot, (0, 0), published.GREY_WOLF_GOALS[goal[1:-1]])
        plot.set(aspect="equal", title=goal, xlim=(-1, 25), ylim=(-1, 25))
        plot.tick_params(labelsize=7)
    return {"lengths": figure, "paths": paths}


def rollout_figures(r: Results, scenes: Sequence[str]) -> Figures:
    """T1, figure 2.27: the planned path and the rollout of its controls."""
    drawn = [row for row in r.study.rows if row.label in scenes]
    figure, panels = new_panels(5.2, len(drawn))
    for row, axes in zip(drawn, panels, strict=True):
        _draw_scene(axes, row.jobs[row.label]["scene"])
        kept = [rec for rec in r.runs[row.label, row.label] if "driven" in rec]
        if kept:
            axes.plot(*np.array(kept[0]["path"]).T, "--", color=COLOURS[1], label="path")
            axes.plot(*np.array(kept[0]["driven"]).T, color=COLOURS[0], label="roll-out")
    return {"driven": figure}


def agreement_figures(r: Results) -> Figures:
    """Printed lengths over those that each reading predicts."""
    readings = list(dict.fromkeys(row.series for row in r.study.rows))
    figure, axes = new_axes(4.2)
    for k, reading in enumerate(readings):
        found = fit_reading(r, reading)
        axes.plot(found.predicted, found.printed, MARKS[k % 8], color=COLOURS[k % 8], markersize=4,
                  alpha=0.8, label=f"{reading} (r = {found.correlation:.2f})")  # fmt: skip
    ends = np.array(axes.get_xlim())
    axes.plot(ends, ends, color=_GREY, linewidth=1.0, zorder=1)
    axes.set(xlabel="predicted length [m]", ylabel="printed length [m]")
    return {"agreement": figure}


def gain_figure(rows: Sequence[Mapping[str, Any]]) -> Figure:
    """T1: gains over RRT* by map and on all, over the evaluations of a swarm, and the ceiling."""
    series = list(dict.fromkeys(row["series"] for row in rows if row["series"]))
    best = next(row["gain"] for row in rows if row["row"] == SHORTEST)
    figure, panels = new_panels(7.0, 3, 2)
    for name, axes in zip(best, panels, strict=True):
        for k, of in enumerate(series):
            line = [row for row in rows if row["series"] == of]
            gains_at = [row["gain"][name] for row in line]
            error_bars(axes, [row["x"] for row in line], gains_at, k, of, "-")
        axes.axhline(best[name][0], color=_GREY, linestyle=":", label="shortest path")
        axes.set(
            title=name.replace("thesis_", "map "), xscale="log", ylabel="length [%]", ylim=(-23, 8)
        )
    for axes in panels[-2:]:
        axes.set_xlabel("evaluations of one swarm")
    return figure


FIGURES: Final[dict[str, Callable[..., Figures]]] = {
    "trend": trend_figures,
    "boxes": box_figures,
    "ladder": ladder_figures,
    "methods": method_figures,
    "maps": map_figures,
    "convergence": convergence_figures,
    "discs": disc_figures,
    "rollouts": rollout_figures,
    "agreement": agreement_figures,
    "gains": lambda r: {"gains": gain_figure(gains(r))},
}
