"""Comparisons: suites of policies and scenes, and all that is written about one."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

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
from agents.policies.planned import PlannedDriver
from agents.studies.plan_pictures import SHORTENS, PlanPictures
from agents.watch import Watch
from wheelchair_gym.base.settings import InputError, dump, suggest
from wheelchair_gym.rendering.picture import with_legend
from wheelchair_gym.rendering.video import video_suffix, write_video
from wheelchair_gym.scenes.arena import Doorway

Evaluation = dict[str, Any]
BEST = "lattice+window"  # chosen on training seeds; test seeds are 0 to n-1
FILM, FILMS = "episode", (".mp4", ".gif")
RESULTS = "results.json"
PLANNED, PAUSE = 6, 10  # a film shows every n-th picture of a plan, and stays at its end


@dataclass(frozen=True)
class Suite:
    """The policies, scenes and episodes of a comparison."""

    title: str
    policies: Sequence[Spec]
    scenes: Sequence[Spec]
    episodes: int  # test seeds 0 to episodes - 1
    env: Mapping[str, Any] = field(default_factory=lambda: {"pose_source": "modelled"})
    video: bool = True
    film: Sequence[str] = ()  # names of the policies to film; none: the best one


def _scene(spec: Spec) -> Spec:
    """A scene; a doorway is labelled with the margin that the best manoeuvre leaves."""
    if not isinstance(spec, Mapping) or spec["name"] != "doorway":
        return spec
    door, corridor = spec["door_width"], spec["corridor_width"]
    margin = Doorway(door_width=door, corridor_width=corridor).margin()
    return {**spec, "label": f"door {door:.2f} corridor {corridor:.2f} margin {margin:.3f}"}


SUITES = {
    name: Suite(**one | {"scenes": tuple(map(_scene, one["scenes"]))})
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
        what, policies=distinct(what.policies, "policies"), scenes=distinct(what.scenes, "scenes")
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
        evaluation["video"] = film(what, evaluation, folder)
    evaluation["provenance"]["wall_time_s"] = round(time.perf_counter() - begun, 2)
    write_json(folder / RESULTS, evaluation)
    write_text(folder / "table.md", report.markdown(evaluation))
    report.write_report(evaluation, folder)
    return evaluation


def film(what: Suite, evaluation: Evaluation, folder: Path) -> Record:
    """Film the suite's policies side by side, or the best policy's first success or episode.

    Returns:
        The file, the policies, the scene and the seed.
    """
    best = report.ranked(evaluation["summary"])[0]["policy"]
    policies = [spec for spec in what.policies if label(spec) in what.film]
    policies = policies or [spec for spec in what.policies if label(spec) == best]
    of = [record for record in evaluation["records"] if record["policy"] == label(policies[0])]
    chosen = next((record for record in of if record["success"]), of[0])
    scene = next(spec for spec in what.scenes if label(spec) == chosen["scene"])
    frames, period = side_by_side(policies, scene, chosen["seed"], env_settings(**what.env))
    path = folder / f"{FILM}{video_suffix()}"
    write_video(path, frames, 1.0 / period)
    names = ", ".join(map(label, policies))
    return {"file": path.name, "policy": names, "scene": chosen["scene"], "seed": chosen["seed"]}


def side_by_side(
    policies: Sequence[Spec], scene: Spec, seed: int, env: Mapping[str, Any], periods: int = 1
) -> tuple[list[Any], float]:
    """Pictures of the policies' drives, every n-th control period, and the time between two [s].

    The plan of a policy whose whales shorten a path comes first. Several drives have titles.
    """
    parts = [_pictures(policy, scene, seed, env) for policy in policies]
    before = max(len(planned) for planned, _, _ in parts)
    after = max(len(driven) for _, driven, _ in parts) + PAUSE
    columns = []
    for policy, (planned, driven, _) in zip(policies, parts, strict=True):
        drive = driven + driven[-1:] * (after - len(driven))
        pictures = (planned or driven[:1] * before) + drive[::periods]
        titled = (with_legend(picture, [], label(policy)) for picture in pictures)
        columns.append([*titled] if len(parts) > 1 else pictures)
    return [np.hstack(row) for row in zip(*columns, strict=True)], periods * parts[0][2]


def _pictures(
    policy: Spec, scene: Spec, seed: int, settings: Mapping[str, Any]
) -> tuple[list[Any], list[Any], float]:
    """Pictures of a plan with whales, if there is one, and of the drive; the control period [s]."""
    driver: Any = make_policy(without_labels(policy))
    planned: list[Any] = []
    driven: list[Any] = []

    def add(env: Any) -> None:
        driven.append(env.render())
        planner = driver.config.planner["name"] if isinstance(driver, PlannedDriver) else ""
        mission = env.unwrapped.mission
        if len(driven) == 1 and planner == SHORTENS and mission.map is not None:
            film = PlanPictures.of_drive(driver, mission, size=driven[0].shape[:2]).film()
            planned.extend([*film][::PLANNED])

    with closing(make_env(scene, settings, policy=policy)) as env:
        drive_episode(env, driver, seed, add)
        return planned, driven, env.unwrapped.task.period
