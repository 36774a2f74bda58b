"""The folder of a training run: its checkpoint, its curve, and its weights for publication.

A checkpoint is complete or refused, and read without executing code in it. The curve has a row for
each checkpoint, in CSV and for TensorBoard; a sweep over one setting is written as a table of the
last rows and a figure of all curves. Published weights have a model card: settings, curves of all
seeds, results, limits.
"""

import csv
import hashlib
import io
import json
import re
import zipfile
from collections import Counter
from collections.abc import Mapping, Sequence
from contextlib import suppress
from operator import attrgetter
from pathlib import Path
from statistics import median
from typing import Any

import matplotlib as mpl
import torch

from agents.evaluation import plots, provenance, statistics, tables
from agents.evaluation.provenance import without_outputs, write_text
from agents.evaluation.tables import templates
from agents.learning.weights import Weights, load_weights, save_weights
from wheelchair_gym.base.errors import InputError
from wheelchair_gym.base.files import LIMITS, atomic_write, read_bytes, read_text
from wheelchair_gym.base.settings import read_json
from wheelchair_gym.task.observations import PRIVILEGED

CHECKPOINT, CURVE, SWEEP = "checkpoint.pt", "curve.csv", "sweep"
POLICY, BEST = "policy.npz", "best.npz"
_HEAD = b"wheelchair checkpoint 1\n"
_REPLAY = ("observations", "next_observations", "actions", "rewards", "dones", "timeouts")


def model_state(model: Any) -> dict[str, Any]:
    """The state of a model: networks, optimizers and replay buffer."""
    names, variables = model._get_torch_save_params()
    state: dict[str, Any] = {
        "modules": {name: attrgetter(name)(model).state_dict() for name in names},
        "variables": {name: attrgetter(name)(model).data for name in variables or []},
        "frames": model.num_timesteps,
        "updates": model._n_updates,
    }
    buffer = getattr(model, "replay_buffer", None)
    if buffer is not None:
        end = buffer.buffer_size if buffer.full else buffer.pos
        state["replay"] = {name: torch.from_numpy(getattr(buffer, name)[:end]) for name in _REPLAY}
        state["replay_at"] = [int(buffer.pos), int(buffer.full)]
    return state


def load_model_state(model: Any, state: dict[str, Any]) -> None:
    """Load a state from `model_state` into a model of the same settings."""
    for name, values in state["modules"].items():
        attrgetter(name)(model).load_state_dict(values)
    for name, values in state["variables"].items():
        attrgetter(name)(model).data.copy_(values)
    model.num_timesteps, model._n_updates = state["frames"], state["updates"]
    if "replay" in state:
        buffer = model.replay_buffer
        for name, values in state["replay"].items():
            getattr(buffer, name)[: len(values)] = values.numpy()
        buffer.pos, buffer.full = state["replay_at"][0], bool(state["replay_at"][1])


def save_checkpoint(folder: Path, content: dict[str, Any]) -> None:
    """Write a checkpoint atomically.

    Raises:
        InputError: it cannot be written.
    """
    stream = io.BytesIO()
    torch.save(content, stream)
    body = stream.getbuffer()
    digest = hashlib.sha256(body).hexdigest().encode()
    with atomic_write(folder / CHECKPOINT) as part, part.open("wb") as file:
        file.write(_HEAD + digest + b"\n")
        file.write(body)


def load_checkpoint(folder: Path) -> dict[str, Any] | None:
    """The checkpoint of a folder; None where there is none.

    Raises:
        InputError: it cannot be read, or is not complete.
    """
    path = folder / CHECKPOINT
    if not path.exists():
        return None
    data = read_bytes(path, "checkpoint")
    head = len(_HEAD) + 65
    body = memoryview(data)[head:]
    digest = hashlib.sha256(body).hexdigest().encode()
    expected = "expected a complete checkpoint; delete it to start again"
    if data[:head] != _HEAD + digest + b"\n":
        raise InputError(f"{path}: {expected}")
    try:
        with zipfile.ZipFile(io.BytesIO(body)) as packed:
            if sum(member.file_size for member in packed.infolist()) > LIMITS["checkpoint"].maximum:
                raise ValueError("too large when unpacked")
        content = torch.load(io.BytesIO(body), weights_only=True, map_location="cpu")
        if not isinstance(content, dict):
            raise ValueError("not an object with keys")
    except Exception as error:  # torch documents no errors of its reader
        why = " ".join(str(error).split()[:20]) or type(error).__name__
        raise InputError(f"{path}: {expected} ({why})") from None
    return content


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


def read_curve(folder: Path) -> list[Row]:
    """Read the rows of a folder's curve, as they were written.

    Raises:
        InputError: it cannot be read.
    """
    path = folder / CURVE
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
    provenance.write_text(folder / CURVE, tables.csv_table(rows))


def write_sweep(key: str, runs: Sequence[tuple[str, Path]], out: Path) -> str:
    """Write sweep.csv and sweep.svg, which compare runs that differ in one setting.

    Args:
        key: name of the setting that varies.
        runs: its value and the folder of each run.
        out: folder to write to.

    Returns:
        The table as text.
    """
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
        if "frames" not in weights.card:
            raise InputError(f"{of}: imitated weights, without a curve; expected a run that learns")
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
