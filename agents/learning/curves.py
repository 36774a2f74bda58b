"""The curve of a training run: a row for each checkpoint, in CSV and for TensorBoard.

A sweep over one setting is written as a table of the last rows and a figure of all curves.
"""

from __future__ import annotations

import csv
import io
from collections import Counter
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import matplotlib as mpl
from stable_baselines3.common.logger import Logger

from agents.evaluation import plots, provenance, statistics, tables
from agents.learning.weights import load_weights
from wheelchair_gym.base.errors import InputError
from wheelchair_gym.base.files import atomic_write, read_text

NAME = "curve.csv"
SWEEP = "sweep"
Row = dict[str, Any]


def add_ended_episodes(sums: Counter[str], infos: Any, dones: Any) -> None:
    """Add each episode that ended in this step to the totals.

    The keys of `infos` are those of `SB3VecEnv.step_wait` (`agents/learning/sb3.py`): a new total
    needs a key there, and a name in `episode_row`.
    """
    for i in dones.nonzero()[0].tolist():
        success, timeout = infos[i]["is_success"], infos[i]["TimeLimit.truncated"]
        total, length = infos[i]["episode"]["r"], infos[i]["episode"]["l"]
        ended = {"episodes": 1, "success": success, "timeout": timeout, "length": length}
        sums.update({**ended, "return": total})


def episode_row(sums: Counter[str]) -> Row:
    """Return the number of episodes, and shares and means over them if there are any."""
    n, keys = sums["episodes"], ("success", "timeout", "return", "length")
    return {"episodes": n, **{key: sums[key] / n for key in keys if n}}


def log_row(logger: Logger, row: Row) -> None:
    """Log the numbers of a row."""
    for key, value in row.items():
        if key != "frames" and isinstance(value, int | float):
            logger.record(key, value)
    logger.dump(int(row["frames"]))


def read_curve(folder: Path) -> list[Row]:
    """Read the rows of a folder's curve, as they were written.

    Raises:
        InputError: it cannot be read.
    """
    path = folder / NAME
    if not path.exists():
        return []
    try:
        rows = list(csv.DictReader(io.StringIO(read_text(path))))
    except csv.Error as error:
        raise InputError(f"{path}: not a table in CSV ({error})") from None
    return [
        {key: _number(text) for key, text in row.items() if key is not None and text}
        for row in rows
    ]


def _number(text: Any) -> Any:
    """Return the number that a text stands for; otherwise the text."""
    for kind in (int, float):
        with suppress(ValueError, TypeError):
            return kind(text)
    return text


def write_curve(folder: Path, rows: list[Row]) -> None:
    """Write a curve atomically; columns are those of all rows, in order."""
    provenance.write_text(folder / NAME, tables.csv_table(rows))


def write_sweep(key: str, runs: Sequence[tuple[str, Path]], out: Path) -> str:
    """Write sweep.csv and sweep.svg, which compare runs that differ in one setting.

    Args:
        key: name of the setting that varies.
        runs: its value and the folder of each run.
        out: folder to write to.

    Returns:
        The table as text.
    """
    from agents.learning.run import POLICY

    curves: dict[str, list[Any]] = {}
    rows: list[Row] = []
    for value, folder in runs:
        evaluated = [row for row in read_curve(folder) if row.get("eval_success") is not None]
        if not evaluated:
            continue
        card, last = load_weights(folder / POLICY).card, evaluated[-1]
        points = [(float(row["frames"]), float(row["eval_success"])) for row in evaluated]
        curves.setdefault(value, []).append(points)
        episodes = card["training"]["evaluation"]["episodes"]
        found = statistics.share("success", round(float(last["eval_success"]) * episodes), episodes)
        rows.append({
            key: value, "seed": card["seed"], "frames": card["frames"], "episodes": episodes,
            "success": float(last["eval_success"]), "low": found["success_low"],
            "high": found["success_high"],
            **{name: float(last[f"eval_{name}"]) for name in ("collision", "timeout", "time")},
        })  # fmt: skip
    table = tables.csv_table(rows) if rows else ""
    provenance.write_text(out / f"{SWEEP}.csv", table)
    with mpl.rc_context(plots.LOOK), atomic_write(out / f"{SWEEP}.svg") as part:
        part.write_bytes(plots.as_svg(_plot_sweep(key, curves)))
    return table.rstrip()


def _plot_sweep(key: str, curves: dict[str, list[Any]]) -> Any:
    figure, axes = plots.new_axes(3.2)
    for k, (value, runs) in enumerate(curves.items()):
        for number, curve in enumerate(runs):
            frames, shares = zip(*curve, strict=True)
            axes.plot(
                [n / 1e6 for n in frames], [100.0 * success for success in shares],
                plots.DASHES[k % len(plots.DASHES)], color=plots.COLOURS[k % len(plots.COLOURS)],
                marker=plots.MARKS[k % len(plots.MARKS)], ms=3.5, lw=1.2,
                label=f"{key.rpartition('.')[2]} {value}" if number == 0 else None,
            )  # fmt: skip
    axes.set(xlabel="frames [million]", ylabel="success in evaluation [%]", ylim=(0.0, 101.0))
    return figure
