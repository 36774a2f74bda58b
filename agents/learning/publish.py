"""Weights for publication with a model card: settings, curves of all seeds, results, limits."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from statistics import median
from typing import Any

from agents.evaluation.provenance import without_outputs, write_text
from agents.evaluation.tables import templates
from agents.learning.curves import read_curve
from agents.learning.run import POLICY
from agents.learning.weights import Weights, load_weights, save_weights
from wheelchair_gym.base.settings import InputError, read_json
from wheelchair_gym.task.observations import PRIVILEGED

POINTS = 12  # of each curve in a card
SHARES = ("success", "collision", "timeout")
RESULT_KEYS = ("episodes", *(f"{name}{end}" for name in SHARES for end in ("", "_low", "_high")),
           "wide", "wide_low", "wide_high", "spl", "time")  # fmt: skip


def publish(folder: Path, results: Sequence[Path], path: Path) -> Weights:
    """Write the last weights of the seed with the best last evaluation, and a card beside them.

    Args:
        folder: of a training run, or with a folder for each seed (seed_0, ...).
        results: files results.json of comparisons of weights in the folder.
        path: NAME.npz; the card is NAME.md.

    Raises:
        InputError: the folder holds no run, a run has not ended, or a file cannot be read.
    """
    folders = sorted(folder.glob("seed_*")) or [folder]
    runs = {of: load_weights(of / POLICY) for of in folders}
    for of, weights in runs.items():
        if weights.card["frames"] < weights.card["training"]["frames"]:
            raise InputError(f"{of}: the run has not ended; the same train command resumes it")
    curves = {of: _eval_curve(of) for of in folders}
    best = max(folders, key=lambda of: curves[of][-1][1] if curves[of] else 0.0)
    dropped = ("curve", "row", "evaluation")
    card = {key: value for key, value in runs[best].card.items() if key not in dropped}
    seeds = {of: str(weights.card["seed"]) for of, weights in runs.items()}
    card["curves"] = {seeds[of]: curve for of, curve in curves.items()}
    # Between checkpoints, without evaluations.
    speeds = {of: [float(row["frames_per_second_s"]) for row in read_curve(of)] for of in folders}
    card["speeds"] = {seeds[of]: round(median(speed)) for of, speed in speeds.items()}
    names = {str(of / POLICY): seeds[of] for of in folders}
    card["results"] = [row for file in results for row in _results(file, names, path.stem)]
    weights = Weights(runs[best].arrays, card)
    save_weights(path, weights)
    write_text(path.with_suffix(".md"), model_card(path.stem, card))
    return weights


def _eval_curve(folder: Path) -> list[list[float]]:
    """Frames, success and collision of some evaluations of a run, including the last one."""
    rows = [row for row in read_curve(folder) if row.get("eval_success") is not None]
    count = min(POINTS, len(rows))
    picked = [rows[round((k + 1) * len(rows) / count) - 1] for k in range(count)]
    return [
        [float(row[key]) for key in ("frames", "eval_success", "eval_collision")] for row in picked
    ]


def _results(file: Path, names: Mapping[str, str], name: str) -> list[dict[str, Any]]:
    """The results of each seed's weights in a comparison."""
    content = read_json(file)
    try:
        command = without_outputs(content["command"])
        command = re.sub(r"--(policies|assist) \S+", rf"--\1 {name}", command)
        return [
            {"suite": content["title"], "command": command,
             "commit": content["provenance"]["commit"], "scene": row["scene"],
             "seed": names[row["policy"]], **{key: row[key] for key in RESULT_KEYS}}
            for row in content["summary"]
            if row["policy"] in names and row["scene"] == "all"
        ]  # fmt: skip
    except (KeyError, TypeError):
        raise InputError(f"{file}: expected the results.json of a comparison") from None


def model_card(name: str, card: Mapping[str, Any]) -> str:
    """The card as Markdown."""
    curves = zip(*card["curves"].values(), strict=False)
    page = templates().get_template("model_card.md").render(
        name=name, card=card, privileged=PRIVILEGED, curves=curves,
        settings=json.dumps(card["training"], indent=1),
    )  # fmt: skip
    return page + "\n"
