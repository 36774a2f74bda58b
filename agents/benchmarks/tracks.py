"""The benchmark that others can enter: tracks of frozen episodes, and results that can be verified.

A policy drives in a process of its own (`agents.policies.delegated`). Its result file holds every
episode, so that `verify` can drive some of them again.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
from collections.abc import Mapping
from contextlib import closing
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

import numpy as np

from agents import read_data
from agents.evaluation.evaluate import Spec, evaluate, label, labelled_with, make_env
from agents.evaluation.metrics import Record
from agents.evaluation.provenance import now, provenance, write_json
from agents.evaluation.runs import run_key
from agents.evaluation.statistics import wilson
from wheelchair_gym.base.settings import InputError, read_json, suggest
from wheelchair_gym.types import Episode

_TABLE: Final = read_data("tracks.yaml")
VERSION: Final[int] = _TABLE["version"]
TRACKS: Final[dict[str, Any]] = _TABLE["tracks"]
# Of an episode in a result file; times of computing differ from drive to drive.
FIGURES: Final = ("success", "outcome", "time", "contact", "at_fault", "clearance_min", "length")
COMPUTING: Final = ("plan_ms", "act_ms_p50", "act_ms_p95")
NEAR: Final = 1e-6  # digits of a world that its digest holds: others differ between processors
DIFFERENT: Final = 0.2  # share of outcomes that may differ on another kind of processor


@dataclasses.dataclass(frozen=True)
class Drives:
    """The episodes of a track: its scenes with their settings, and the seeds of each."""

    scenes: tuple[dict[str, Any], ...]
    seeds: range
    env: Mapping[str, Any]
    digest: str


def drives_of(track: str, development: bool = False) -> Drives:
    """The test episodes of a track, or those for development.

    Raises:
        InputError: the track is unknown.
    """
    if track not in TRACKS:
        names = ", ".join(TRACKS)
        raise InputError(f"track {track!r} is unknown; known: {names}{suggest(track, TRACKS)}")
    of, kind = TRACKS[track], "development" if development else "test"
    scenes = [dict(scene) for scene in of["scenes"]]
    if "drivers" in of:
        people = of["drivers"]
        scenes = [labelled_with(scene, one, driver=one) for one in people for scene in scenes]
    first = _TABLE["seeds"][kind]
    env = {**_TABLE["env"], **of.get("env", {}), "split": "train" if development else "test"}
    seeds = range(first, first + of["episodes"])
    return Drives(tuple(scenes), seeds, env, of["digests"][kind])


def digest_of(drives: Drives) -> str:
    """SHA-256 of all worlds of a track, with starts, goals and people, rounded to `NEAR`."""
    digest = hashlib.sha256()
    for scene in drives.scenes:
        with closing(make_env(scene, drives.env, render_mode=None)) as env:
            for seed in drives.seeds:
                env.reset(seed=seed)
                _add(digest, env.unwrapped.episode)
    return digest.hexdigest()


def _add(digest: Any, episode: Episode) -> None:
    parts = [episode.start, episode.goal, episode.walls, episode.discs, episode.map.origin]
    parts += [episode.actors.routes, *(episode.actors.rows[name] for name in ("pose", "speed"))]
    for part in parts:
        digest.update((np.round(np.asarray(part, np.float64) / NEAR) + 0.0).tobytes())  # no -0
    digest.update(episode.map.cells.tobytes())


def run(
    policy: Spec, track: str, folder: Path, development: bool = False, jobs: int = 1,
    progress: bool = True,
) -> tuple[Record, Path]:  # fmt: skip
    """Drive the episodes of a track, and write the result file.

    Args:
        policy: a spec of `make_policy`; of an assistant on the track with drivers.
        track: its name.
        folder: of the result file and of the store, from which an interrupted run goes on.
        development: drive the episodes for development in place of those that count.
        jobs: worker processes.
        progress: show a bar.

    Returns:
        The content of the result file, and its path.

    Raises:
        InputError: the policy or the track is unknown, or this version draws other worlds.
    """
    drives = drives_of(track, development)
    if (found := digest_of(drives)) != drives.digest:
        raise InputError(
            f"track {track}: this installation draws other worlds than version {VERSION} of the "
            f"benchmark has ({found[:12]}, not {drives.digest[:12]})"
        )
    records = _drive(policy, track, drives, drives.seeds, folder, jobs, progress)
    episodes = [
        {key: record[key] for key in ("scene", "seed", *FIGURES, *COMPUTING)} for record in records
    ]
    result: Record = {
        "benchmark": VERSION, "track": track, "policy": label(policy), "spec": policy,
        "development": development, "worlds": drives.digest, "finished": now(), **provenance(),
        **summary(episodes), "episodes": episodes,
    }  # fmt: skip
    path = folder / f"{track}.json"
    write_json(path, result | {"digest": _digest(result)})
    return result, path


def _drive(
    policy: Spec, track: str, drives: Drives, seeds: Any, folder: Path, jobs: int, progress: bool
) -> list[Record]:
    """Records of episodes, whose policy is in a process of its own."""
    driver: Spec = policy
    if "drivers" in TRACKS[track]:
        driver = {"name": "assisted", "assist": policy}
    isolated = {"name": "isolated", "policy": driver, "label": label(policy)}
    return evaluate(
        [isolated], drives.scenes, list(seeds), env=drives.env, folder=folder, jobs=jobs,
        progress=progress,
    )  # fmt: skip


def summary(episodes: list[Record]) -> Record:
    """The primary number of a track with its 95 % interval, and the other measures.

    Primary is the share of drives that arrive without any contact.
    """
    n, arrived = len(episodes), [one for one in episodes if one["success"]]
    low, high = wilson(len(arrived), n)
    return {
        "n": n, "success": len(arrived) / n, "low": low, "high": high,
        "contacts": sum(one["contact"] for one in episodes),
        "at_fault": sum(one["at_fault"] for one in episodes),
        "time": float(np.mean([one["time"] for one in arrived])) if arrived else None,
        "clearance": float(np.median([one["clearance_min"] for one in episodes])),
        "plan_ms": float(np.median([one["plan_ms"] for one in episodes])),
        "act_ms": float(np.median([one["act_ms_p50"] for one in episodes])),
    }  # fmt: skip


def _digest(result: Mapping[str, Any]) -> str:
    return run_key(json.loads(json.dumps(dict(result))))


def read_result(path: Path) -> Record:
    """The content of a result file.

    Raises:
        InputError: it cannot be read, is of another version, or was changed.
    """
    result = read_json(path)
    if not isinstance(result, dict) or not {"benchmark", "track", "digest"} <= result.keys():
        raise InputError(f"{path}: expected a result file of `wheelchair benchmark run`")
    if result["benchmark"] != VERSION:
        raise InputError(f"{path}: of version {result['benchmark']}; expected {VERSION}")
    digest = result.pop("digest")
    if digest != _digest(result) or result | summary(result["episodes"]) != result:
        raise InputError(f"{path}: was changed since it was written: its digest differs")
    return result


def verify(path: Path, episodes: int, jobs: int = 1, progress: bool = True) -> tuple[bool, str]:
    """Drive some episodes of a result file again; whether they agree, and what was found.

    With the same kind of processor and the same versions, every figure has to be equal, and else
    the outcomes but a share of `DIFFERENT`.

    Args:
        path: of the result file.
        episodes: of each scene, evenly from its seeds.
        jobs: worker processes.
        progress: show a bar.

    Raises:
        InputError: see `read_result`; also if its worlds are not those of the track.
    """
    result = read_result(path)
    drives = drives_of(result["track"], result["development"])
    wanted = {(one["scene"], one["seed"]): one for one in result["episodes"]}
    if result["worlds"] != drives.digest or wanted.keys() != {
        (label(scene), seed) for scene in drives.scenes for seed in drives.seeds
    }:
        raise InputError(f"{path}: its episodes are not those of the track {result['track']}")
    every = max(1, len(drives.seeds) // episodes)
    with TemporaryDirectory() as folder:
        records = _drive(
            result["spec"], result["track"], drives, drives.seeds[::every], Path(folder), jobs,
            progress,
        )  # fmt: skip
    here = provenance()
    same = here["versions"] == result["versions"]
    same &= here["machine"]["cpu"] == result["machine"]["cpu"]
    differ = []
    for record in records:
        before = wanted[record["scene"], record["seed"]]
        where = f"{record['scene']}, seed {record['seed']}"
        for key in FIGURES if same else ("outcome",):
            if record[key] != before[key]:
                differ.append(f"{where}: {key} is {record[key]}, not {before[key]}")
    how = "every figure" if same else f"outcomes, but {DIFFERENT:.0%}, on another machine"
    agrees = len(differ) <= (0 if same else DIFFERENT * len(records))
    lines = [f"{len(records)} episodes driven again; compared: {how}", *differ[:5]]
    return agrees, "\n".join([*lines, "agrees" if agrees else "does not agree"])
