"""Comparisons: suites of policies and scenes, and all that is written about one."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from agents import read_data
from agents.evaluation import report
from agents.evaluation.evaluate import (
    NO_WATCH,
    Spec,
    distinct,
    drive_episode,
    env_settings,
    evaluate,
    label,
    make_env,
    without_labels,
)
from agents.evaluation.metrics import Record, summarise
from agents.evaluation.provenance import command_line, now, provenance, write_json, write_text
from agents.policies import kind_of, make_policy
from agents.watch import Watch
from wheelchair_gym.config import InputError, dump, suggest
from wheelchair_gym.scenes.arena import Doorway

Evaluation = dict[str, Any]
BEST = "lattice+window"  # chosen on training seeds; test seeds are 0 to n-1
FILM, FILMS = "episode", (".mp4", ".gif")
RESULTS = "results.json"


@dataclass(frozen=True)
class Suite:
    """The policies, scenes and episodes of a comparison."""

    title: str
    policies: tuple[Spec, ...]
    scenes: tuple[Spec, ...]
    episodes: int  # test seeds 0 to episodes - 1
    env: Mapping[str, Any] = field(default_factory=lambda: {"pose_source": "modelled"})
    video: bool = True


def _scene(spec: Spec) -> Spec:
    """A scene; a doorway is labelled with the margin that the best manoeuvre leaves."""
    if not isinstance(spec, Mapping) or spec["name"] != "doorway":
        return spec
    door, corridor = spec["door_width"], spec["corridor_width"]
    margin = Doorway(door_width=door, corridor_width=corridor).margin
    return {**spec, "label": f"door {door:.2f} corridor {corridor:.2f} margin {margin:.3f}"}


SUITES = {
    name: Suite(
        one["title"], tuple(one["policies"]), tuple(map(_scene, one["scenes"])), one["episodes"]
    )
    for name, one in read_data("suites.yaml").items()
}


def suite(name: str) -> Suite:
    """A suite by name.

    Raises:
        InputError: there is none of that name.
    """
    if name not in SUITES:
        near = suggest(name, SUITES)
        raise InputError(f"suite {name!r} is unknown; known: {', '.join(sorted(SUITES))}{near}")
    return SUITES[name]


def compare(
    what: Suite,
    folder: str | Path,
    *,
    jobs: int = 1,
    progress: bool = True,
    seeds: Sequence[int] | None = None,
    watch: Watch = NO_WATCH,
) -> Evaluation:
    """Evaluate a suite and write results.json, table.md, a video and report.html to a folder.

    Raises:
        InputError: a name in the suite or the folder is wrong.
        StoppedError: Ctrl-C; the same call computes only what is missing.
    """
    begun = time.perf_counter()
    folder = Path(folder)
    what = dataclasses.replace(
        what,
        policies=distinct(what.policies, "policies"),
        scenes=distinct(what.scenes, "scenes"),
    )
    seeds = list(range(what.episodes)) if seeds is None else list(seeds)
    records = evaluate(
        what.policies, what.scenes, seeds, env=what.env, folder=folder, jobs=jobs,
        progress=progress, watch=watch,
    )  # fmt: skip
    summary = summarise(records)
    evaluation: Evaluation = {
        "title": what.title,
        "command": command_line(),
        "provenance": {
            "config": dump(dataclasses.asdict(what)),
            "seeds": seeds,
            **provenance(jobs=jobs),
            "finished": now(),
        },
        "policies": [label(policy) for policy in what.policies],
        "kinds": {label(policy): kind_of(without_labels(policy)) for policy in what.policies},
        "scenes": [label(scene) for scene in what.scenes],
        "records": records,
        "summary": summary,
        "video": None,
    }
    if (folder / RESULTS).exists():  # then a film there is of another comparison
        for suffix in FILMS:
            (folder / f"{FILM}{suffix}").unlink(missing_ok=True)
    if what.video and records:
        filmed = episode_to_film(summary, records)
        evaluation["video"] = {"file": film(what, filmed, folder), **filmed}
    evaluation["provenance"]["wall_time_s"] = round(time.perf_counter() - begun, 2)
    write_json(folder / RESULTS, evaluation)
    write_text(folder / "table.md", report.markdown(evaluation))
    report.write_report(evaluation, folder)
    return evaluation


def episode_to_film(summary: Sequence[Record], records: Sequence[Record]) -> Record:
    """Policy, scene and seed of the best policy's first success, or of its first episode."""
    best = report.ranked(summary)[0]["policy"]
    of = [record for record in records if record["policy"] == best]
    chosen = next((record for record in of if record["success"]), of[0])
    return {key: chosen[key] for key in ("policy", "scene", "seed")}


def film(what: Suite, episode: Record, folder: Path) -> str:
    """Film an episode (policy, scene and seed by label); the video's name."""
    from wheelchair_gym.rendering.video import video_suffix, write_video

    policy = next(spec for spec in what.policies if label(spec) == episode["policy"])
    scene = next(spec for spec in what.scenes if label(spec) == episode["scene"])
    env = make_env(scene, env_settings(**what.env), policy=policy)
    frames: list[Any] = []
    try:
        driver = make_policy(without_labels(policy))
        drive_episode(env, driver, episode["seed"], lambda e: frames.append(e.render()))
        period = env.unwrapped.task.period
    finally:
        env.close()
    path = folder / f"{FILM}{video_suffix()}"
    write_video(path, frames, 1.0 / period)
    return path.name
