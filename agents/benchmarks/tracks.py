"""The benchmark that others can enter: tracks of frozen episodes, and results that can be verified.

A policy drives in a process of its own (`agents.policies.delegated`). Its result file holds every
episode, so that `verify` can drive some of them again.
"""

import hashlib
import json
import math
import random
from collections.abc import Mapping, Sequence
from contextlib import closing
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

import numpy as np

from agents import read_data
from agents.evaluation.evaluate import (
    Spec,
    evaluate,
    label,
    labelled_with,
    make_env,
    without_labels,
)
from agents.evaluation.metrics import Record
from agents.evaluation.provenance import now, provenance, write_json
from agents.evaluation.statistics import wilson
from agents.people import make_assistant
from agents.policies import settings_of
from wheelchair_gym.base.settings import InputError, read_json, suggest
from wheelchair_gym.types import Episode

_TABLE: Final = read_data("tracks.yaml")
VERSION: Final[int] = _TABLE["version"]
TRACKS: Final[dict[str, Any]] = _TABLE["tracks"]
# Of an episode in a result file; times of computing differ from drive to drive.
FIGURES: Final = ("success", "outcome", "time", "contact", "at_fault", "clearance_min", "length")
COMPUTING: Final = ("plan_ms", "act_ms_p50", "act_ms_p95")
NEAR: Final = 1e-6  # digits of a world that its digest holds: others differ between processors
NEEDED: Final = {
    "benchmark", "track", "spec", "development", "worlds", "machine", "versions", "episodes",
    "digest",
}  # fmt: skip
DIFFERENT: Final = 0.2  # share of outcomes that may differ on another kind of processor


class Track:
    """The episodes of a track: those that count, or those for development.

    Attributes:
        scenes: with their settings.
        seeds: of each scene.
        env: further settings of the environment.
        digest: of all worlds, as this version of the benchmark has them.

    Raises:
        InputError: the track is unknown.
    """

    def __init__(self, name: str, development: bool = False) -> None:
        if name not in TRACKS:
            names = ", ".join(TRACKS)
            raise InputError(f"track {name!r} is unknown; known: {names}{suggest(name, TRACKS)}")
        of, kind = TRACKS[name], "development" if development else "test"
        self.scenes: list[dict[str, Any]] = [dict(scene) for scene in of["scenes"]]
        if people := of.get("drivers"):
            self.scenes = [
                labelled_with(one, who, driver=who) for who in people for one in self.scenes
            ]
        first = _TABLE["seeds"][kind]
        self.seeds, self.digest = range(first, first + of["episodes"]), of["digests"][kind]
        split = {"split": "train" if development else "test"}
        self.env: dict[str, Any] = _TABLE["env"] | of.get("env", {}) | split
        self._assists = bool(people)

    def found_digest(self) -> str:
        """SHA-256 of all worlds that are drawn, with starts, goals and people, to `NEAR`."""
        digest = hashlib.sha256()
        for scene in self.scenes:
            with closing(make_env(scene, self.env, render_mode=None)) as env:
                for seed in self.seeds:
                    env.reset(seed=seed)
                    _add(digest, env.unwrapped.episode)
        return digest.hexdigest()

    def drive(
        self, policy: Spec, seeds: Sequence[int], folder: Path, jobs: int, progress: bool
    ) -> list[Record]:
        """Records of episodes, whose policy, or assistant, is in a process of its own."""
        plain, jobs = without_labels(policy), 1 if _by_ros(policy) else jobs
        (make_assistant if self._assists else settings_of)(plain)  # which refuse what is wrong
        driver = {"name": "assisted", "assist": plain} if self._assists else plain
        isolated = {"name": "isolated", "policy": driver, "label": label(policy)}
        return evaluate(
            [isolated], self.scenes, seeds, env=self.env, folder=folder, jobs=jobs,
            progress=progress,
        )  # fmt: skip


def _by_ros(spec: Spec) -> bool:
    """Whether a program drives in real time, over one port."""
    return (spec.get("name") if isinstance(spec, Mapping) else spec) == "ros"


def _add(digest: Any, episode: Episode) -> None:
    rows: Any = episode.actors.rows
    grid = episode.map
    parts: list[Any] = [episode.start, episode.goal, episode.walls, episode.discs]
    parts += [grid.origin, grid.resolution, episode.actors.routes]
    parts += [np.nan if one is None else one for one in (episode.tolerance, episode.time_limit)]
    for part in (*parts, *(rows[name] for name in rows.dtype.names)):
        digest.update((np.round(np.asarray(part, np.float64) / NEAR) + 0.0).tobytes())  # no -0
    digest.update(grid.cells.tobytes())


def run(
    policy: Spec, track: str, folder: Path, development: bool = False, jobs: int = 1,
    progress: bool = True, episodes: int | None = None,
) -> tuple[Record, Path]:  # fmt: skip
    """Drive the episodes of a track, and write the result file.

    Args:
        policy: a spec of `make_policy`; of an assistant on the track with drivers.
        track: its name.
        folder: of the result file and of the store, from which an interrupted run goes on.
        development: drive the episodes for development in place of those that count.
        jobs: worker processes.
        progress: show a bar.
        episodes: of each scene for development, the first ones; None: all.

    Returns:
        The content of the result file, and its path.

    Raises:
        InputError: the policy or the track is unknown, or this version draws other worlds.
    """
    if episodes is not None and not development:
        raise InputError("--episodes needs --development: a result has all episodes of its track")
    drives = Track(track, development)
    if (found := drives.found_digest()) != drives.digest:
        raise InputError(
            f"track {track}: this installation draws other worlds than version {VERSION} of the "
            f"benchmark has ({found[:12]}, not {drives.digest[:12]})"
        )
    records = drives.drive(policy, drives.seeds[:episodes], folder, jobs, progress)
    kept = [
        {key: record[key] for key in ("scene", "seed", *FIGURES, *COMPUTING)} for record in records
    ]
    result: Record = {
        "benchmark": VERSION, "track": track, "policy": label(policy), "spec": policy,
        "development": development, "worlds": drives.digest, "finished": now(), **provenance(),
        **summary(kept), "episodes": kept,
    }  # fmt: skip
    path = folder / f"{track}.json"
    write_json(path, result | {"digest": _digest(result)})
    return result, path


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
    return hashlib.sha256(json.dumps(result, sort_keys=True).encode()).hexdigest()


def read_result(path: Path) -> Record:
    """The content of a result file.

    Raises:
        InputError: it cannot be read, is of another version, or was changed.
    """
    result = read_json(path)
    if not isinstance(result, dict) or not result.keys() >= NEEDED:
        raise InputError(f"{path}: expected a result file of `wheelchair benchmark run`")
    if result["benchmark"] != VERSION:
        raise InputError(f"{path}: of version {result['benchmark']}; expected {VERSION}")
    digest = result.pop("digest")
    if digest != _digest(result):
        raise InputError(f"{path}: was changed since it was written: its digest differs")
    track, machine, episodes = result["track"], result["machine"], result["episodes"]
    if not (isinstance(track, str) and isinstance(machine, dict) and "cpu" in machine):
        raise InputError(f"{path}: expected the name of a track, and a machine with its 'cpu'")
    try:
        agrees = result | summary(episodes) == result
        places = {(one["scene"], one["seed"]) for one in episodes}
        agrees &= all(one.keys() >= {*FIGURES} and one["success"] in (0, 1) for one in episodes)
    except (ArithmeticError, KeyError, TypeError, ValueError):
        agrees, places = False, set()
    if not agrees or len(places) < len(episodes):
        raise InputError(f"{path}: its figures are not those of its episodes, each once")
    return result


def verify(path: Path, episodes: int, jobs: int = 1, progress: bool = True) -> tuple[bool, str]:
    """Drive some episodes of a result file again; whether they agree, and what was found.

    With the same kind of processor and the same versions, every figure has to be equal. Else, and
    where ROS drives in real time, all episodes are driven again, and outcomes may differ in a share
    of `DIFFERENT`, but not for the file: successes that are lost may exceed those that are gained
    by two standard deviations of what chance does.

    Args:
        path: of the result file.
        episodes: of each scene, drawn at random, so that nobody knows them before.
        jobs: worker processes.
        progress: show a bar.

    Raises:
        InputError: see `read_result`; also if its worlds are not those of the track.
    """
    result = read_result(path)
    drives = Track(result["track"], result["development"])
    wanted = {(one["scene"], one["seed"]): one for one in result["episodes"]}
    if result["worlds"] != drives.digest or wanted.keys() != {
        (label(scene), seed) for scene in drives.scenes for seed in drives.seeds
    }:
        raise InputError(f"{path}: its episodes are not those of the track {result['track']}")
    here, spec = provenance(), result["spec"]
    same = here["versions"] == result["versions"] and not _by_ros(spec)
    same &= here["machine"]["cpu"] == result["machine"]["cpu"]
    number = min(episodes, len(drives.seeds)) if same else len(drives.seeds)
    some = sorted(random.sample(drives.seeds, number))
    with TemporaryDirectory() as folder:
        records = drives.drive(spec, some, Path(folder), jobs, progress)
    differ, turns = [], []
    for record in records:
        before = wanted[record["scene"], record["seed"]]
        turns.append(before["success"] - record["success"])
        keys = FIGURES if same else ("success", "outcome")
        if off := [f"{k} is {record[k]}, not {before[k]}" for k in keys if record[k] != before[k]]:
            differ.append(f"{record['scene']}, seed {record['seed']}: {', '.join(off)}")
    how = "every figure" if same else f"outcomes, but {DIFFERENT:.0%} (other machine, or real time)"
    agrees = len(differ) <= (0 if same else DIFFERENT * len(records))
    agrees &= sum(turns) <= 2.0 * math.sqrt(sum(map(abs, turns)))
    seeds = ", ".join(map(str, some))
    lines = [f"{len(records)} episodes driven again (seeds {seeds}); compared: {how}", *differ[:5]]
    return agrees, "\n".join([*lines, "agrees" if agrees else "does not agree"])
