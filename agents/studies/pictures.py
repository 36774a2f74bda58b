"""Figures of the studies that show places and paths, in the manner of the sources."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle

from agents.evaluation.figures import COLOURS, DASHES, MARKS, WIDTH, legend_above, new_axes
from agents.studies.drawing import Figures, interval, named, panels_of
from agents.studies.evidence import estimate
from agents.studies.model import LENGTH, Array, Results
from wheelchair_gym.rendering import palette

_GREY = "#8a929a"
_SOLID = palette.css(palette.SOLID)
TRACK = 0.36  # m: P2's robot
WHEEL = 0.075  # m: radius, P2
SAMPLING = 0.1  # s: P2


def _floor(axes: Axes, scene: Any) -> Any:
    """Draw the solid things of a scene; its episode."""
    from wheelchair_gym.scenes import make_scene

    episode = make_scene(scene).sample(np.random.default_rng(0))
    for x0, y0, x1, y1 in episode.walls:
        axes.plot([x0, x1], [y0, y1], color=_SOLID, linewidth=1.2, solid_capstyle="round")
    _discs(axes, episode.discs)
    _ends(axes, episode.start[:2], episode.goal[:2])
    axes.set_aspect("equal")
    axes.grid(visible=False)
    axes.set_xlabel("x [m]")
    axes.set_ylabel("y [m]")
    return episode


def _discs(axes: Axes, discs: Any) -> None:
    for x, y, radius in discs:
        axes.add_patch(Circle((x, y), radius, color=_SOLID, alpha=0.55, linewidth=0))


def _ends(axes: Axes, start: Any, goal: Any) -> None:
    axes.plot(*start, "o", color=palette.css(palette.START), markersize=6, zorder=5)
    axes.plot(*goal, "*", color=palette.css(palette.GOAL), markersize=10, zorder=5)


def compared(r: Results, rows: Sequence[str], best: str, scene: str) -> Figures:
    """Lengths by map beside the shortest, and paths of one seed (T1, figure 3.6)."""
    from agents.studies.worlds import problem_of
    from planners import make_planner

    strata = list(r.sample(rows[0], LENGTH))
    figure, axes = new_axes(2.9)
    for k, row in enumerate([*rows, best]):
        sample = r.sample(row, LENGTH)
        found = []
        for stratum in strata:
            values = {stratum: sample[stratum]}
            one = estimate([values], [1.0])
            found.append((one.value, *one.interval))
        x = np.arange(len(strata)) + (k - 1.5) * 0.12
        mean, low, high = (np.array(v) for v in zip(*found, strict=True))
        error = np.nan_to_num([mean - low, high - mean])
        axes.errorbar(x, mean, yerr=error, fmt=MARKS[k], color=COLOURS[k], label=row,
                      markersize=5, capsize=2.5)  # fmt: skip
    axes.set_xticks(range(len(strata)), [f"map {s[-1]}" for s in strata])
    axes.set_ylabel(named(LENGTH))
    legend_above(figure, axes)
    drawn, plot = new_axes(3.4)
    _floor(plot, scene)
    jobs = {row.label: row.jobs[scene] for row in r.study.rows}
    for k, row in enumerate([*rows, best]):
        for seed in range(20):  # the first that finds a path
            plan = make_planner(jobs[row]["planner"]).plan(
                problem_of(scene), np.random.default_rng(seed)
            )
            if len(plan.path):
                plot.plot(*plan.path[:, :2].T, DASHES[k % 4], color=COLOURS[k], linewidth=1.5,
                          label=row)  # fmt: skip
                break
    legend_above(drawn, plot)
    return {
        "lengths": ("Mean lengths of the paths found on each map, with 95 % intervals.", figure),
        "paths": (f"Paths of the first seed that found one on {scene.replace('_', ' ')}, as the "
                  "thesis's figure 3.6.", drawn),
    }  # fmt: skip


def _kept(r: Results, row: str) -> list[Mapping[str, Any]]:
    return [rec for (label, _), of in r.runs.items() if label == row for rec in of if "line" in rec]


def velocities(line: Array) -> dict[str, Array]:
    """P2 (6) to (8), corrected: speeds of platform and wheels along a curve (n, 2) [m].

    Points are `SAMPLING` apart in time.
    """
    velocity = np.gradient(line, SAMPLING, axis=0)
    second = np.gradient(velocity, SAMPLING, axis=0)
    v = np.hypot(*velocity.T)
    cross = velocity[:, 0] * second[:, 1] - velocity[:, 1] * second[:, 0]
    w = cross / np.maximum(v**2, 1e-9)
    right, left = v + 0.5 * TRACK * w, v - 0.5 * TRACK * w
    return {"v": v, "w": w, "right": right, "left": left,
            "right_w": right / WHEEL, "left_w": left / WHEEL}  # fmt: skip


def convergence(r: Results) -> Figures:
    """P2's figures: paths, convergence, and velocities of platform and wheels."""
    from wheelchair_gym.scenes.published import CHAOTIC_PSO_DISCS

    names = {"pso": "PSO", "pso_chaotic": "chaotic PSO"}
    best = {row: min(_kept(r, row), key=lambda rec: rec["costs"][-1]) for row in names}
    figure, axes = new_axes(2.8)
    for k, (row, label) in enumerate(names.items()):
        curves = np.array([rec["costs"] for rec in _kept(r, row)])
        x = np.arange(1, curves.shape[1] + 1)
        axes.plot(x, np.median(curves, axis=0), DASHES[k], color=COLOURS[k], label=label)
        axes.fill_between(x, *np.percentile(curves, [10, 90], axis=0), color=COLOURS[k],
                          alpha=0.15, linewidth=0)  # fmt: skip
    axes.set_xlabel("iteration")
    axes.set_ylabel("least cost [m]")
    legend_above(figure, axes)
    paths, plot = new_axes(3.9)
    _discs(plot, CHAOTIC_PSO_DISCS)
    for k, (row, label) in enumerate(names.items()):
        plot.plot(*np.array(best[row]["line"]).T, DASHES[k], color=COLOURS[k], label=label)
    _ends(plot, (1, 1), (9, 9))
    plot.set(xlim=(0, 10), ylim=(0, 10), aspect="equal", xlabel="x [m]", ylabel="y [m]")
    legend_above(paths, plot)
    speeds, panels = panels_of(6, 1.5)
    for k, (row, label) in enumerate(names.items()):
        found = velocities(np.array(best[row]["line"]))
        t = SAMPLING * np.arange(len(found["v"]))
        kinds = (("v", "v [m/s]"), ("w", "ω [rad/s]"), ("right", "right [m/s]"),
                 ("left", "left [m/s]"), ("right_w", "right [rad/s]"),
                 ("left_w", "left [rad/s]"))  # fmt: skip
        for axes_, (key, unit) in zip(panels, kinds, strict=True):
            axes_.plot(t, found[key], DASHES[k], color=COLOURS[k], linewidth=1.2, label=label)
            axes_.set_ylabel(unit)
    panels[-1].set_xlabel("time [s]")
    legend_above(speeds, panels[0])
    return {
        "convergence": (f"Median of the least cost over {len(_kept(r, 'pso'))} runs, 10th to 90th "
                        "percentile shaded (the paper's figures 5 and 10).", figure),
        "paths": ("Best paths of those runs (figures 4 and 9).", paths),
        "velocities": ("Along the best paths: linear and angular velocity of the platform, then "
                       "linear and angular velocities of the right and left wheel (figures 6 to 8 "
                       "and 11 to 13).", speeds),
    }  # fmt: skip


def discs_and_lines(r: Results) -> Figures:
    """R1: lengths by goal and method, and paths of the best runs."""
    from wheelchair_gym.scenes.published import GREY_WOLF_DISCS, GREY_WOLF_GOALS

    methods = list(dict.fromkeys(row.label.partition(" (")[0] for row in r.study.rows))
    goals = [f"({goal})" for goal in GREY_WOLF_GOALS]
    figure, axes = new_axes(3.2)
    for k, method in enumerate(methods):
        found = [interval(r, f"{method} {goal}", LENGTH) for goal in goals]
        mean, low, high = (np.array(v) for v in zip(*found, strict=True))
        x = np.arange(len(goals)) + (k - 2) * 0.13
        axes.errorbar(x, mean, yerr=[mean - low, high - mean], fmt=MARKS[k], color=COLOURS[k],
                      markersize=5, capsize=2, label=method)  # fmt: skip
        given = [
            row.published.get("length_m", np.nan) for goal in goals for row in r.study.rows
            if row.label == f"{method} {goal}"
        ]  # fmt: skip
        axes.plot(x, given, "_", color=_GREY, markersize=9, markeredgewidth=1.6,
                  label="published" if k == 0 else None)  # fmt: skip
    axes.set_xticks(range(len(goals)), goals)
    axes.set_ylabel(named(LENGTH))
    legend_above(figure, axes)
    paths = Figure(figsize=(WIDTH, 6.6), layout="constrained")
    for goal, plot in zip(goals, np.ravel(paths.subplots(3, 2)), strict=True):
        _discs(plot, GREY_WOLF_DISCS)
        for k, method in enumerate(methods):
            kept = _kept(r, f"{method} {goal}")
            if kept:
                line = np.array(min(kept, key=lambda rec: rec["length_m"])["line"])
                plot.plot(*line.T, DASHES[k % 4], color=COLOURS[k], linewidth=1.1, label=method)
        _ends(plot, (0, 0), GREY_WOLF_GOALS[goal[1:-1]])
        plot.set(aspect="equal", title=goal, xlim=(-1, 25), ylim=(-1, 25))
        plot.tick_params(labelsize=7)
    legend_above(paths, paths.axes[0])
    return {
        "lengths": ("Mean lengths with 95 % intervals, and the published ones (grey bars).",
                    figure),
        "paths": ("The shortest path of each method among the runs kept; x and y in metres. Legs "
                  "may cut discs where a method tests way points only.", paths),
    }  # fmt: skip


def driven(r: Results) -> Figures:
    """T1, figure 2.27: the planned path and the roll-out of its controls."""
    found: Figures = {}
    figure = Figure(figsize=(WIDTH, 5.2), layout="constrained")
    shown = [row for row in r.study.rows if row.label in ("thesis_3", "thesis_5")]
    for row, axes in zip(shown, np.ravel(figure.subplots(len(shown), 1)), strict=True):
        scene = json.loads(json.dumps(row.jobs[row.label]["scene"]))
        _floor(axes, scene)
        kept = [rec for rec in r.runs[row.label, row.label] if "driven" in rec]
        if kept:
            axes.plot(*np.array(kept[0]["path"]).T, "--", color=COLOURS[1], label="path")
            axes.plot(*np.array(kept[0]["driven"]).T, color=COLOURS[0], label="roll-out")
            legend_above(figure, axes) if row is shown[0] else None
    words = "The path of the global variant, and where its generated controls take the axle."
    found["driven"] = (words, figure)
    return found
