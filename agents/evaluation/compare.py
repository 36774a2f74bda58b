"""Comparisons: suites of policies and scenes, and all that is written about one."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import product
from pathlib import Path
from typing import Any

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
from agents.learning.weights import shipped
from agents.policies import kind_of, make_policy
from agents.watch import Watch
from wheelchair_gym.config import InputError, dump
from wheelchair_gym.scenes.arena import Doorway

Evaluation = dict[str, Any]
BEST = "lattice+window"  # chosen on training seeds; test seeds are 0 to n-1
TRAINING = 1_000_000  # the first training seed


@dataclass(frozen=True)
class Suite:
    """The policies, scenes and episodes of a comparison."""

    title: str
    policies: tuple[Spec, ...]
    scenes: tuple[Spec, ...]
    episodes: int  # test seeds 0 to episodes - 1
    env: Mapping[str, Any] = field(default_factory=lambda: {"pose_source": "modelled"})
    video: bool = True


DOORS = (1.00, 0.95, 0.90, 0.85, 0.80)  # m: ADA asks for 0.815
CORRIDORS = (1.20, 1.05, 0.90)  # m: ADA asks for 0.915


def _doorway(door: float, corridor: float) -> Spec:
    """A door off a corridor, labelled with the margin that the best manoeuvre leaves."""
    spec = {"name": "doorway", "door_width": door, "corridor_width": corridor}
    margin = Doorway(door_width=door, corridor_width=corridor).margin
    return {**spec, "label": f"door {door:.2f} corridor {corridor:.2f} margin {margin:.3f}"}


_CLINIC = {
    "kind": "clinic", "door_width": (1.0, 1.4), "corridor_width": (1.5, 2.4),
    "building_size": (14.0, 24.0),
}  # fmt: skip
_HOME = {"name": "floor_plan", "kind": "home", "door_width": (0.9, 1.1), "label": "home"}
_CROSSING = {"people": {"crossing_share": 1.0}, "label": "crossing"}
_CROWDS = (
    {  # public buildings: a chair and a person pass each other (DIN 18040-1: 1.50 m)
        "name": "crowd",
        "place": "building",
        "people": {"density": (0.01, 0.04)},  # without people who sit
        "building": _CLINIC,
        "label": "building",
    },
    {"name": "crowd", "place": "hall", "label": "hall"},
)
_VARIANTS = ("rrt_star_woa_local+window", "rrt_star_woa_global+window")

SUITES: dict[str, Suite] = {
    "demo": Suite(
        "Planned and learned policies on several scenes",
        (
            *(f"rrt_star_woa_{v}+{f}" for v in ("local", "global") for f in ("window", "controls")),
            *(BEST, "ppo_guided", "ppo_goal"),
        ),
        ("floor_plan", "clutter", "thesis_3", "map_file"),
        3,
    ),
    "homes": Suite(
        "Homes never seen before: doors from 0.90 m, corridors from 1.10 m",
        ("random", "straight", BEST),
        ({**_HOME, "corridor_width": (1.1, 1.6)},),
        200,
    ),
    "clinic": Suite(
        "Clinics never seen before: doors from 1.00 m, corridors from 1.50 m",
        ("straight", BEST),
        ({"name": "floor_plan", **_CLINIC, "label": "clinic"},),
        200,
    ),
    "barn": Suite(
        "Worlds of cylinders, drawn as those of the BARN challenge were",
        ("straight", "a_star+pure_pursuit", BEST),
        ("barn",),
        100,
    ),
    "thesis": Suite(
        "The thesis's five maps",
        ("straight", *_VARIANTS, BEST),
        tuple(f"thesis_{k}" for k in range(1, 6)),
        20,
    ),
    "followers": Suite(
        "One planner, each follower",
        (
            *(f"a_star+{name}" for name in ("pure_pursuit", "window")),
            *(f"lattice+{f}" for f in ("pure_pursuit", "controls", "dwa", "mppi", "window", "woa")),
        ),
        ("floor_plan",),
        40,
    ),
    "crowd": Suite(
        "Among people, in buildings and halls; one in ten pays no attention",
        ("straight", BEST),
        _CROWDS,
        40,
    ),
    "cylinders": Suite(
        "Cylinders that cross a hall and avoid nothing, as in DynaBARN",
        ("straight", BEST),
        ({**_CROWDS[1], **_CROSSING},),
        40,
    ),
    "temporary": Suite(
        "Obstacles that appear on the way and disappear again",
        ("a_star+pure_pursuit", BEST),
        ("temporary",),
        40,
    ),
    "doors": Suite(
        "How tight a door off a corridor may be; the margin is what remains round the corner",
        ("a_star+window", BEST),
        tuple(_doorway(door, corridor) for door, corridor in product(DOORS, CORRIDORS)),
        10,
    ),
}

SUITES["league"] = Suite(
    "Kinds of policies on kinds of scenes: who wins where",
    (
        *("random", "straight", "a_star+pure_pursuit", "rrt_star+window", *_VARIANTS),
        *("rrt_star_woa_global+controls", "lattice+dwa", "lattice+mppi", "lattice+woa", BEST),
        *shipped(),
    ),
    (
        *(*SUITES["homes"].scenes, "thesis_3", "thesis_5", "barn"),
        *(_doorway(door, 1.05) for door in (1.00, 0.90, 0.85)),
        *("temporary", *_CROWDS),
    ),
    20,
)


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
    engine: str = "loky",
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
        engine=engine, progress=progress, watch=watch,
    )  # fmt: skip
    summary = summarise(records)
    evaluation: Evaluation = {
        "title": what.title,
        "command": command_line(),
        "provenance": {
            "config": dump(dataclasses.asdict(what)),
            "seeds": seeds,
            **provenance(jobs=jobs, engine=engine),
            "finished": now(),
        },
        "policies": [label(policy) for policy in what.policies],
        "kinds": {label(policy): kind_of(without_labels(policy)) for policy in what.policies},
        "scenes": [label(scene) for scene in what.scenes],
        "records": records,
        "summary": summary,
        "video": None,
    }
    if what.video and records:
        filmed = episode_to_film(summary, records)
        evaluation["video"] = {"file": film(what, filmed, folder), **filmed}
    evaluation["provenance"]["wall_time_s"] = round(time.perf_counter() - begun, 2)
    write_json(folder / "results.json", evaluation)
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
    env = make_env(scene, env_settings(**what.env))
    frames: list[Any] = []
    try:
        driver = make_policy(without_labels(policy))
        drive_episode(env, driver, episode["seed"], lambda e: frames.append(e.render()))
        period = env.unwrapped.task.period
    finally:
        env.close()
    path = folder / f"episode{video_suffix()}"
    write_video(path, frames, round(1.0 / period))
    return path.name
