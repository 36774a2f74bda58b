"""Runs that differ in one setting, side by side: a table, and curves of their trials."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl

from agents.evaluation.figures import COLOURS, DASHES, LOOK, MARKS, legend_above, new_axes
from agents.evaluation.metrics import wilson
from agents.evaluation.provenance import write_text
from agents.learning.curves import read_curve
from agents.learning.run import POLICY
from agents.learning.weights import load_weights
from wheelchair_gym.files import whole

Curve = list[tuple[float, float]]  # frames and share of success
NAME = "variation"


def write_variation(key: str, runs: Sequence[tuple[str, Path]], out: Path) -> str:
    """Write variation.csv and variation.svg to a folder; the table as text.

    Args:
        key: of the setting.
        runs: its value and the folder of each.
        out: where to.
    """
    curves: dict[str, list[Curve]] = {}
    rows: list[dict[str, Any]] = []
    for value, folder in runs:
        card = load_weights(folder / POLICY).card
        judged = [row for row in read_curve(folder) if row.get("trial_success") is not None]
        if not judged:
            continue
        curves.setdefault(value, []).append(
            [(float(row["frames"]), float(row["trial_success"])) for row in judged]
        )
        episodes = card["training"]["trials"]["episodes"]
        share = float(judged[-1]["trial_success"])
        low, high = wilson(round(share * episodes), episodes)
        rows.append({
            key: value, "seed": card["seed"], "frames": card["frames"], "episodes": episodes,
            "success": share, "low": low, "high": high,
            **{name: float(judged[-1][f"trial_{name}"])
               for name in ("collision", "timeout", "time")},
        })  # fmt: skip
    text = io.StringIO()
    if rows:
        writer = csv.DictWriter(text, list(rows[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
    write_text(out / f"{NAME}.csv", text.getvalue())
    with mpl.rc_context(LOOK), whole(out / f"{NAME}.svg") as part:
        _drawn(key, curves).savefig(part, format="svg", metadata={"Date": None, "Creator": None})
    return text.getvalue().rstrip()


def _drawn(key: str, curves: dict[str, list[Curve]]) -> Any:
    figure, axes = new_axes(3.2)
    for k, (value, runs) in enumerate(curves.items()):
        for number, curve in enumerate(runs):
            frames, shares = zip(*curve, strict=True)
            axes.plot(
                [n / 1e6 for n in frames], [100.0 * share for share in shares],
                DASHES[k % len(DASHES)], color=COLOURS[k % len(COLOURS)],
                marker=MARKS[k % len(MARKS)], ms=3.5, lw=1.2,
                label=f"{key.rpartition('.')[2]} {value}" if number == 0 else None,
            )  # fmt: skip
    axes.set(xlabel="frames [million]", ylabel="success in trials [%]", ylim=(0.0, 101.0))
    legend_above(figure, axes)
    return figure
