"""Figures of an evaluation, as SVG: the same records give the same bytes."""

import io
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from cycler import cycler
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from agents import read_data
from agents.evaluation.tables import exists
from wheelchair_gym.rendering import palette
from wheelchair_gym.scenes.arena import Doorway

Record = Mapping[str, Any]

COLOURS = tuple(palette.css(colour) for colour in palette.SERIES)
MARKS = "osD^vPX*"  # policies differ by shape, too, not only by colour
DASHES = ("-", "--", "-.", ":")
WIDTH = 4.4  # inches: on a phone, letters then keep the size of the text around them
_STYLE = Path(__file__).parents[1] / "data" / "report.mplstyle"
LOOK: Any = {
    **mpl.rc_params_from_file(_STYLE, use_default_template=False),
    "axes.edgecolor": palette.css(palette.INK),
    "grid.color": palette.css(palette.RULE),
    "axes.prop_cycle": cycler(color=COLOURS),
}


def figures(evaluation: Mapping[str, Any]) -> dict[str, tuple[str, bytes]]:
    """Every figure by name: its caption and its SVG."""
    policies, records = evaluation["policies"], evaluation["records"]
    scenes, summary, doorways = evaluation["scenes"], evaluation["summary"], _doorways(evaluation)
    drawn: dict[str, Callable[[], Figure]] = {
        "success": lambda: _success(policies, scenes, summary),
        "time": lambda: _time(policies, records),
        "clearance": lambda: _clearance(policies, records),
    }
    if any(exists(record.get("authority")) for record in records):
        drawn = {"help": lambda: _help(policies, summary), **drawn}
    if doorways:
        drawn["doors"] = lambda: _doors(policies, doorways, summary)
    captions = read_data("captions.yaml")
    with mpl.rc_context(LOOK):
        return {name: (captions[name], as_svg(make())) for name, make in drawn.items()}


def as_svg(figure: Figure) -> bytes:
    """A figure as SVG, with one legend of its first panel above all, where it hides no data."""
    handles, labels = figure.axes[0].get_legend_handles_labels()
    if labels and not figure.legends:
        columns = max(1, min(len(labels), 56 // (max(map(len, labels)) + 6)))
        figure.legend(handles, labels, loc="outside upper left", ncols=columns)
    out = io.BytesIO()
    figure.savefig(out, format="svg", metadata={"Date": None, "Creator": None})
    return out.getvalue()


def new_panels(height: float, rows: int, columns: int = 1) -> tuple[Figure, list[Axes]]:
    """An empty figure of this height [inches] with rows and columns of panels."""
    figure = Figure(figsize=(WIDTH, height), layout="constrained")
    return figure, list(figure.subplots(rows, columns, squeeze=False).flat)


def new_axes(height: float) -> tuple[Figure, Axes]:
    """An empty figure of this height [inches]."""
    figure, (axes,) = new_panels(height, 1)
    return figure, axes


def error_bars(
    axes: Axes, at: Any, found: Sequence[Sequence[float]], k: int, label: str, line: str = "",
    across: bool = False,
) -> None:  # fmt: skip
    """Draw the k-th series: rows of value, low and high, as one line where `line` is not empty.

    Values are up the page, or `across` it.
    """
    value, low, high = np.reshape(np.array(found, dtype=float), (-1, 3)).T
    # Rounding may put a bound a hair beyond its value.
    error = np.nan_to_num([np.maximum(value - low, 0.0), np.maximum(high - value, 0.0)])
    places, bars = ((value, at), "xerr") if across else ((at, value), "yerr")
    axes.errorbar(
        *places, **{bars: error}, fmt=MARKS[k % 8] + line, color=COLOURS[(k + k // 8) % 8],
        label=label, markersize=4 if line else 5, capsize=2.5, linewidth=1.3,
    )  # fmt: skip


def with_interval(row: Record, key: str, factor: float = 1.0) -> list[float]:
    """Return a figure of a row and the ends of its interval."""
    return [factor * row[name] for name in (key, f"{key}_low", f"{key}_high")]


def paired(title: str, values: Mapping[str, Mapping[int, float]]) -> bytes:
    """Draw each participant as a line over conditions, and the mean of all, as SVG.

    Args:
        title: measure with its unit.
        values: by condition: by participant.
    """
    names = [name.replace("$", r"\$") for name in values]
    with mpl.rc_context(LOOK):
        figure, axes = new_axes(2.6)
        for who in sorted({who for of in values.values() for who in of}):
            each = [of.get(who, np.nan) for of in values.values()]
            axes.plot(names, each, "o-", color="#8a9299", linewidth=0.8, markersize=3)
        means = [float(np.mean([*of.values()])) if of else np.nan for of in values.values()]
        axes.plot(names, means, "s-", color=COLOURS[0], linewidth=2.0, label="mean")
        axes.set(ylabel=title.replace("$", r"\$"))
        return as_svg(figure)


def _success(policies: Sequence[str], scenes: Sequence[str], summary: Sequence[Record]) -> Figure:
    places = ["all", *scenes] if len(scenes) > 1 else list(scenes)
    found = {(row["policy"], row["scene"]): row for row in summary if exists(row["success"])}
    step = 0.72 / len(policies)
    figure, axes = new_axes(1.0 + 0.2 * len(places) * max(2, len(policies)))
    for i, policy in enumerate(policies):
        rows = [
            (k, found[policy, place]) for k, place in enumerate(places) if (policy, place) in found
        ]
        y = [k + (i - 0.5 * (len(policies) - 1)) * step for k, _ in rows]
        shares = [with_interval(row, "success", 100.0) for _, row in rows]
        error_bars(axes, y, shares, i, policy, across=True)
    axes.set_yticks(range(len(places)), ["all scenes" if p == "all" else p for p in places])
    axes.set_ylim(len(places) - 0.5, -0.5)
    for edge in range(1, len(places)):
        axes.axhline(edge - 0.5, color=LOOK["grid.color"], linewidth=0.6)
    axes.grid(axis="y", visible=False)
    axes.set(xlim=(-2, 102), xlabel="success [% of episodes]")
    return figure


def unbeaten(points: Sequence[tuple[float, float]]) -> list[int]:
    """Indices, by x, of the points that no other equals or beats in both: less x, more y."""
    order = sorted(range(len(points)), key=lambda i: (points[i][0], -points[i][1]))
    found: list[int] = []
    for i in order:
        if not found or points[i][1] > points[found[-1]][1]:
            found.append(i)
    return found


def _help(policies: Sequence[str], summary: Sequence[Record]) -> Figure:
    rows = {row["policy"]: row for row in summary if row["scene"] == "all"}
    known = [p for p, r in rows.items() if exists(r.get("authority")) and exists(r["success"])]
    named = [policy for policy in policies if policy in known]
    points = [(100.0 * rows[p]["authority"], 100.0 * rows[p]["success"]) for p in named]
    figure, axes = new_axes(3.3)
    front = np.array([points[i] for i in unbeaten(points)])
    axes.plot(*front.T, color=palette.css(palette.MAPPED), linewidth=0.8, zorder=0)
    for policy, (x, _) in zip(named, points, strict=True):
        share = with_interval(rows[policy], "success", 100.0)
        error_bars(axes, [x], [share], policies.index(policy), policy)
    axes.set(xlabel="authority of the assistant [%]", ylabel="success [% of episodes]")
    axes.set_xlim(left=min(0.0, axes.get_xlim()[0]))
    return figure


def _time(policies: Sequence[str], records: Sequence[Record]) -> Figure:
    figure, axes = new_axes(3.3)
    for i, policy in enumerate(policies):
        of = [r for r in records if r["policy"] == policy and exists(r["geodesic"])]
        of = [r for r in of if exists(r["time"])]
        for good in (True, False):
            some = [r for r in of if bool(r["success"]) == good]
            axes.scatter(
                [r["geodesic"] for r in some], [r["time"] for r in some], s=20 if good else 26,
                marker=MARKS[i % 8] if good else "x", color=COLOURS[i % 8], alpha=0.75,
                linewidths=0.0 if good else 1.2, label=policy if good else None,
            )  # fmt: skip
    # From zero, with a margin for the marks at the far ends.
    for limit, key in ((axes.set_xlim, "geodesic"), (axes.set_ylim, "time")):
        limit(0.0, 1.05 * max((r[key] for r in records if exists(r[key])), default=1.0))
    axes.set(xlabel="geodesic from start to goal [m]", ylabel="time [s]")
    return figure


def _clearance(policies: Sequence[str], records: Sequence[Record]) -> Figure:
    figure, axes = new_axes(3.3)
    every = [r["clearance_min"] for r in records if exists(r["clearance_min"])]
    end = 1.03 * max(every, default=0.0) or 1.0
    for i, policy in enumerate(policies):
        of = [r["clearance_min"] for r in records if r["policy"] == policy]
        values = np.sort(np.array([v for v in of if exists(v)], dtype=float))
        if len(values):  # each curve runs on to the right end: one of nothing but contacts shows
            share = 100.0 * np.arange(1, len(values) + 1) / len(values)
            axes.step(
                np.concatenate([[0.0], values, [end]]), np.concatenate([[0.0], share, [100.0]]),
                where="post",
                color=COLOURS[i % 8], linestyle=DASHES[i % 4], linewidth=1.6, label=policy,
            )  # fmt: skip
    axes.set(xlim=(-0.02 * end, end), xlabel="least clearance of the episode [m]")
    axes.set(ylim=(0, 102), ylabel="episodes at or below [%]")
    return figure


def _doorways(evaluation: Mapping[str, Any]) -> dict[str, Doorway]:
    """The doorways of the scenes, by label; none if a scene is of another kind, or occurs twice."""
    config = evaluation["provenance"].get("config", {})
    doorways = {}
    for label, spec in zip(evaluation["scenes"], config.get("scenes", ()), strict=False):
        if not isinstance(spec, Mapping) or spec.get("name") != "doorway":
            return {}
        widths = {key: spec[key] for key in ("door_width", "corridor_width") if key in spec}
        doorways[label] = Doorway(**widths)
    return doorways if len(set(doorways.values())) == len(doorways) else {}


def _doors(
    policies: Sequence[str], doorways: Mapping[str, Doorway], summary: Sequence[Record]
) -> Figure:
    found: dict[tuple[str, str], float] = {
        (row["policy"], row["scene"]): row["success"] for row in summary if exists(row["success"])
    }
    corridors, doors = (
        [getattr(r, key) for r in doorways.values()] for key in ("corridor_width", "door_width")
    )
    widths = np.linspace(min(corridors) - 0.08, max(corridors) + 0.08, 30)
    figure, panels = new_panels(0.8 + 2.6 * len(policies), len(policies))
    for axes, policy in zip(panels, policies, strict=True):
        for margin, dash in ((0.0, "-"), (0.05, "--")):
            minimum = [Doorway.narrowest_door(margin, width) for width in widths]
            name = f"{100 * margin:.0f} cm to spare"
            axes.plot(widths, minimum, dash, color=COLOURS[1], label=name)
        for label, doorway in doorways.items():
            if (share := found.get((policy, label))) is None:
                continue
            colour = mpl.colormaps["RdYlGn"](share, 0.6)
            axes.text(
                doorway.corridor_width, doorway.door_width, f"{100 * share:.0f}", ha="center",
                va="center", bbox={"boxstyle": "circle", "fc": colour, "ec": "none"},
            )  # fmt: skip
        axes.set(
            xlim=(widths[0], widths[-1]), ylim=(min(0.60, min(doors) - 0.05), max(doors) + 0.05)
        )
        axes.set_title(policy, loc="left", fontsize=9.0)
        axes.set(xlabel="corridor [m]", ylabel="door [m]")
    return figure
