"""Comparisons: suites of policies and scenes, and all that is written about one."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from agents.evaluate import Spec, drive_episode, env_settings, evaluate, label, make_env
from agents.metrics import Record, summarise
from agents.policy import make_policy
from agents.provenance import command_line, commit, machine, versions, write_json, write_text
from wheelchair_gym.config import InputError, dump

Evaluation = dict[str, Any]
BEST = "lattice+window"  # chosen on training seeds; test seeds are 0 to n-1


@dataclass(frozen=True)
class Suite:
    """What is compared with what, on which episodes."""

    title: str
    policies: tuple[Spec, ...]
    scenes: tuple[Spec, ...]
    episodes: int  # seeds 0 to episodes - 1
    env: Mapping[str, Any] = field(default_factory=lambda: {"pose_source": "modelled"})
    video: bool = True


SUITES: dict[str, Suite] = {
    "demo": Suite(
        "Scripted policies on several scenes",
        ("random", "straight", "a_star+pure_pursuit", BEST),
        ("floor_plan", "clutter", "corridor", "map_file"),
        3,
    ),
    "homes": Suite("Floor plans never seen before", (BEST,), ("floor_plan",), 200),
    "followers": Suite(
        "One planner, each follower",
        ("a_star+pure_pursuit", "a_star+window", "lattice+pure_pursuit", "lattice+window"),
        ("floor_plan",),
        40,
    ),
}


def suite(name: str) -> Suite:
    """A suite by name.

    Raises:
        InputError: there is none of that name.
    """
    if name not in SUITES:
        raise InputError(f"suite {name!r} is unknown; known: {', '.join(sorted(SUITES))}")
    return SUITES[name]


def compare(
    what: Suite,
    folder: str | Path,
    *,
    jobs: int = 1,
    progress: bool = True,
    seeds: Sequence[int] | None = None,
) -> Evaluation:
    """Evaluate a suite and write results.json, table.md, a video and report.html to a folder.

    Raises:
        InputError: a name in the suite or the folder is wrong.
        StoppedError: Ctrl-C; the same call computes only what is missing.
    """
    begun = time.perf_counter()
    folder = Path(folder)
    seeds = list(range(what.episodes)) if seeds is None else list(seeds)
    records = evaluate(
        what.policies, what.scenes, seeds, env=what.env, folder=folder, jobs=jobs,
        progress=progress,
    )  # fmt: skip
    summary = summarise(records)
    evaluation: Evaluation = {
        "title": what.title,
        "command": command_line(),
        "provenance": {
            "config": dump(dataclasses.asdict(what)),
            "seeds": seeds,
            "commit": commit(),
            "machine": machine() | {"jobs": jobs},
            "versions": versions(),
            "finished": datetime.now(UTC).isoformat(timespec="seconds"),
        },
        "policies": [label(policy) for policy in what.policies],
        "scenes": [label(scene) for scene in what.scenes],
        "records": records,
        "summary": summary,
        "video": None,
    }
    if what.video and records:
        evaluation["video"] = film(what, summary, records, folder)
    evaluation["provenance"]["wall_time_s"] = round(time.perf_counter() - begun, 2)
    write_json(folder / "results.json", evaluation)
    write_text(folder / "table.md", table(evaluation))
    from agents.report import write_report

    write_report(evaluation, folder)
    return evaluation


def best_policy(summary: Sequence[Record]) -> str:
    """The policy with the most successes on all scenes, then the best SPL."""
    rows = [row for row in summary if row["scene"] == "all"]
    return str(max(rows, key=lambda row: (row["success"], row["spl"]))["policy"])


def film(
    what: Suite, summary: Sequence[Record], records: Sequence[Record], folder: Path
) -> str | None:
    """Film the best policy on its first good episode; the video's name, or None if none is."""
    from wheelchair_gym.view.video import write_video

    best = best_policy(summary)
    of = [record for record in records if record["policy"] == best]
    shown = next((record for record in of if record["success"]), of[0])
    policy = next(spec for spec in what.policies if label(spec) == best)
    scene = next(spec for spec in what.scenes if label(spec) == shown["scene"])
    env = make_env(scene, env_settings(**what.env))
    frames: list[Any] = []
    try:
        drive_episode(env, make_policy(policy), shown["seed"], lambda e: frames.append(e.render()))
        period = env.unwrapped.task.period
    finally:
        env.close()
    path = folder / "episode.mp4"
    write_video(path, frames, round(1.0 / period))
    return path.name


def _percent(row: Record, key: str) -> str:
    low, high = 100 * row[f"{key}_low"], 100 * row[f"{key}_high"]
    return f"{100 * row[key]:.1f} ({low:.1f}-{high:.1f})"


def _number(value: float | None, digits: int = 2) -> str:
    return "-" if value is None else f"{value:.{digits}f}"


COLUMNS = (
    "policy", "scene", "n", "success % (95 %)", "collision %", "timeout %", "SPL", "time s",
    "length m", "clearance min m", "jerk m/s3", "rough %", "Wh/m", "plan ms p50 / p95",
    "act ms p50 / p95",
)  # fmt: skip


def table(evaluation: Evaluation) -> str:
    """The summary as a table in Markdown, with the command that made it."""
    lines = [
        f"# {evaluation['title']}", "", f"`{evaluation['command']}`", "",
        "| " + " | ".join(COLUMNS) + " |", "|" + " --- |" * len(COLUMNS),
    ]  # fmt: skip
    for row in evaluation["summary"]:
        cells = [
            row["policy"], row["scene"], str(row["episodes"]), _percent(row, "success"),
            _percent(row, "collision"), _percent(row, "timeout"), _number(row["spl"], 3),
            _number(row["time"], 1), _number(row["length"]), _number(row["clearance_min"], 3),
            _number(row["jerk_rms"]), _number(100 * row["rough_share"], 1),
            _number(row["energy_per_m"]),
            f"{row['plan_ms_p50']:.1f} / {row['plan_ms_p95']:.1f}",
            f"{row['act_ms_p50']:.2f} / {row['act_ms_p95']:.2f}",
        ]  # fmt: skip
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"
