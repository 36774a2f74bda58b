"""Fingerprints of what the project computes, to tell whether a change of the code changes results.

`python -m tests.benchmarks.equality --out a.json` at one commit, `--out b.json --against a.json` at
another, on one machine: prints each part that differs, and ends with code 1 if one does. Numbers
are compared in their order, without names, seconds, versions, commits and folders. Everything runs
through the environments' ids and the command `wheelchair`, so that the parts mean the same at each
commit.
A part that the file has already is not computed again.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

from tests.conftest import SHARED

POLICIES = "lattice+window,visibility+mppi,visibility+pure_pursuit,straight,ppo_guided,td3_guided"
SCENES = "floor_plan,clutter,crowd,temporary,doorway"
# Keys of results that say when, where, how fast and by what code they were made.
PROVENANCE = {
    "commit", "command", "date", "machine", "versions", "source", "folder", "out", "file", "map",
    "key", "crc", "real_time_factor",
}  # fmt: skip


def numbers(value: Any) -> list[float]:
    """A result's numbers in their order, without seconds and provenance: names may change."""
    if isinstance(value, dict):
        kept = (
            item
            for key, item in value.items()
            if not (key.endswith("_s") or "_ms" in key or key in PROVENANCE)
        )
        return [number for item in kept for number in numbers(item)]
    if isinstance(value, list):
        return [number for item in value for number in numbers(item)]
    return [float(value)] if isinstance(value, int | float) else []


def digest(value: Any) -> str:
    return hashlib.sha256(np.array(numbers(value)).tobytes()).hexdigest()[:16]


def wheelchair(*arguments: str) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "wheelchair_gym", *arguments],
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode not in (0, 1):
        raise SystemExit(f"wheelchair {' '.join(arguments)}: {done.stderr.strip()[-500:]}")


def planners() -> list[str]:
    from planners import PLANNERS

    return sorted(PLANNERS)


def episodes(policy: str, scene: str, n: int) -> dict[str, str]:
    """A digest of each episode of a policy on a scene, through `wheelchair compare`."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder)
        wheelchair(
            "compare", "--policies", policy, "--scenes", scene, "--episodes", str(n), "--jobs", "2",
            "--pose", "modelled", "--no-video", "--quiet", "--out", str(out / "run"),
        )  # fmt: skip
        lines = (out / "run" / "episodes.jsonl").read_text().splitlines()
    records = sorted(numbers(json.loads(line)) for line in lines)
    return {"episodes": digest(records), "n": str(len(records))}


def plans(planner: str) -> dict[str, str]:
    """Digests of a planner's answers to each problem of the file, with a budget of iterations."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "plans.json"
        wheelchair(
            "plan", "--problems", str(SHARED / "problems" / "planning.json"),
            "--planner", planner, "--json", str(out),
        )  # fmt: skip
        answers = json.loads(out.read_text())
    return {answer["name"]: digest(answer) for answer in answers}


def training(frames: int) -> dict[str, str]:
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "run"
        wheelchair("train", "ppo", "--frames", str(frames), "--quiet", "--out", str(out))
        (file,) = out.rglob("policy.npz")
        arrays = np.load(file, allow_pickle=False)
        h = hashlib.sha256()
        for name in arrays.files:
            if arrays[name].dtype.kind == "f":
                h.update(arrays[name].tobytes())
    return {"weights": h.hexdigest()[:16]}


def slam() -> dict[str, str]:
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder)
        log = str(SHARED / "logs" / "mines_exp1.dat")
        wheelchair("map", "--log", log, "--quiet", "--out", folder, "--json", str(out / "map.json"))
        image = hashlib.sha256((out / "map.pgm").read_bytes()).hexdigest()[:16]
        return {"map": image, "figures": digest(json.loads((out / "map.json").read_text()))}


def studies() -> dict[str, str]:
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "study"
        wheelchair("study", "all", "--quick", "--jobs", "2", "--quiet", "--out", str(out),
                   "--json", str(Path(folder) / "s.json"))  # fmt: skip
        result = json.loads((Path(folder) / "s.json").read_text())
    for study in result.values():  # claims on computing time differ from run to run
        study["claims"] = [
            c for c in study["claims"] if "time" not in c.get("comparison", c.get("said", ""))
        ]
    return {"result": digest(result)}


def twin() -> dict[str, str]:
    from tests.laws.test_twin import Both

    both = Both("clutter")
    both.run(0, 5.0)
    both.close()
    return {"readings": both.digest.hexdigest()[:16]}


def environments() -> dict[str, str]:
    """A digest of 500 random steps; the values of `info` are sorted, since names may change."""
    ids = ("wheelchair_gym/Navigation-v1", "wheelchair_gym/GuidedNavigation-v1")
    return {f"{name} {seed}": _steps(name, seed) for name in ids for seed in (0, 1, 2)}


def _steps(env_id: str, seed: int) -> str:
    import gymnasium

    import wheelchair_gym.envs  # noqa: F401

    env = gymnasium.make(env_id, split="test", pose_source="modelled")
    rng, h = np.random.default_rng(seed), hashlib.sha256()
    result = (*env.reset(seed=seed), False, False)
    for _ in range(500):
        observation, info, *rest = result
        for value in observation.values():
            h.update(value.tobytes())
        flat = [np.ravel(np.array(value, float)) for value in _leaves(info)]
        values = np.concatenate([*flat, np.array(rest, float)]) + 0.0  # -0.0 becomes 0.0
        h.update(np.sort(values).tobytes())
        if rest[0] or rest[1]:
            result = (*env.reset(), False, False)
            continue
        observation, reward, terminated, truncated, info = env.step(rng.uniform(-1, 1, 2))
        result = (observation, info, terminated, truncated, reward)
    return h.hexdigest()[:16]


def _leaves(info: dict[str, Any]) -> list[Any]:
    found = []
    for value in info.values():
        if isinstance(value, dict):
            found += _leaves(value)
        elif isinstance(value, (int, float, np.ndarray, np.generic)):
            found.append(value)
    return found


def parts(n: int, frames: int) -> dict[str, Any]:
    found: dict[str, Any] = {"environments": environments, "twin": twin, "slam": slam}
    for name in planners():
        found[f"plans of {name}"] = lambda name=name: plans(name)
    found[f"training, {frames} frames"] = lambda: training(frames)
    for policy in POLICIES.split(","):
        for scene in SCENES.split(","):
            found[f"{n} episodes of {policy} on {scene}"] = lambda p=policy, s=scene: episodes(
                p, s, n
            )
    found["studies, quick"] = studies
    return found


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, required=True, help="digests, as JSON; gone on with")
    parser.add_argument("--against", type=Path, help="digests of another commit")
    parser.add_argument("--episodes", type=int, default=20, help="of each policy and scene")
    parser.add_argument("--frames", type=int, default=200_000, help="of training")
    parser.add_argument("--only", default="", help="parts whose name has this in it")
    given = parser.parse_args()
    known = json.loads(given.out.read_text()) if given.out.exists() else {}
    other = json.loads(given.against.read_text()) if given.against else {}
    differing = 0
    for name, part in parts(given.episodes, given.frames).items():
        if given.only not in name:
            continue
        begun = time.monotonic()
        if name not in known:
            known[name] = part()
            new = given.out.with_suffix(".part")
            new.write_text(json.dumps(known, indent=1))
            os.replace(new, given.out)
        said = "computed"
        if other:
            same = other.get(name) == known[name]
            differing += not same
            apart = [k for k, v in known[name].items() if other.get(name, {}).get(k) != v]
            said = "equal" if same else f"DIFFERS in {', '.join(apart)}"
        print(f"{name}: {said} ({time.monotonic() - begun:.0f} s)", flush=True)
    return 1 if differing else 0


if __name__ == "__main__":
    sys.exit(main())
