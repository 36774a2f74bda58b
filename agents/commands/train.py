"""`wheelchair train`: learn to drive; one file of settings is the whole run."""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

from agents.commands.arguments import add_json, changed, count, names, report, whole
from agents.interrupt import by_hand

ALGORITHMS = ("ppo", "recurrent_ppo", "sac", "td3", "tqc", "bc")


def add(parts: Any) -> None:
    """Add the subcommand's parser."""
    parser: argparse.ArgumentParser = parts.add_parser(
        "train",
        help="learn to drive, or go on with a run that was stopped",
        description="Train a policy. The folder keeps curve.csv, policy.npz (the latest), best.npz "
        "(the best in trials), checkpoint.pt and TensorBoard's log. The same command after Ctrl-C "
        "goes on from the last checkpoint, as if nothing had happened. bc imitates a scripted "
        "policy.",
        epilog="example: wheelchair train ppo --config configs/ppo.json --seeds 0,1 --jobs 2 "
        "--out runs/ppo",
    )
    parser.add_argument("algorithm", choices=ALGORITHMS)
    parser.add_argument("--config", metavar="FILE.json", help="the run, as in configs/ppo.json")
    parser.add_argument(
        "--set", metavar="KEY=VALUE", action="append", default=[],
        help="change a setting, such as env.rate=10; may be repeated",
    )  # fmt: skip
    parser.add_argument("--frames", type=count, metavar="N", help="control periods in all")
    parser.add_argument("--seeds", type=names, default=["0"], metavar="A,B", help="default 0")
    parser.add_argument(
        "--jobs", type=count, default=1, metavar="N", help="seeds side by side (default 1)"
    )
    parser.add_argument("--out", metavar="DIR", help="default runs/ALGORITHM, seeds below it")
    parser.add_argument("--quiet", action="store_true", help="no progress bar")
    add_json(parser)
    parser.set_defaults(run=run)


def run(given: argparse.Namespace) -> int:
    """Train each seed."""
    from wheelchair_gym.config import InputError, read_json

    try:
        seeds = [whole(text) for text in given.seeds]
    except argparse.ArgumentTypeError as error:
        raise InputError(f"--seeds: {error}") from None
    # Torch's threads, when idle, leave the cores to those that drive: a tenth more frames a second.
    os.environ.setdefault("GOMP_SPINCOUNT", "30000")
    content = _defaults(given.algorithm) if given.config is None else read_json(given.config)
    if not isinstance(content, dict):
        raise InputError(f"{given.config}: expected an object with keys")
    where = "settings" if given.config is None else Path(given.config).name
    content = changed(content, given.set)
    if given.frames is not None and given.algorithm != "bc":
        content["frames"] = given.frames
    out = Path(given.out or Path("runs") / given.algorithm)
    own = _settings(given.algorithm, content, where)
    if given.jobs > 1 and len(seeds) > 1:
        return _side_by_side(given, seeds, out)
    results = {}
    for seed in seeds:
        folder = out if len(seeds) == 1 else out / f"seed_{seed}"
        results[seed] = _one(given, own, seed, folder)
    lines = [f"seed {seed}: {_line(row)}" for seed, row in results.items()]
    report(given, {str(k): v for k, v in results.items()}, "\n".join([*lines, str(out)]))
    return 0


def _defaults(algorithm: str) -> dict[str, Any]:
    if algorithm == "bc":
        return {}
    from agents.learning.settings import RECIPES, plain

    return plain(RECIPES[algorithm])


def _settings(algorithm: str, content: dict[str, Any], where: str) -> Any:
    if algorithm == "bc":
        from agents.learning.demonstrations import load_imitation

        return load_imitation(content, where)
    from agents.learning.settings import read_training

    return read_training(content, where, algorithm)  # type: ignore[arg-type]


def _one(given: argparse.Namespace, own: Any, seed: int, folder: Path) -> dict[str, Any]:
    from tqdm import tqdm

    pause = 0.5 if sys.stderr.isatty() else 10.0
    quiet = given.quiet
    if given.algorithm == "bc":
        from agents.learning.demonstrations import imitate

        return imitate(own, seed, folder, progress=not quiet)
    from agents.learning.run import train

    style: dict[str, Any] = {"mininterval": pause, "maxinterval": pause, "disable": quiet}
    worlds = tqdm(total=0, unit="world", leave=False, desc="worlds", **style)
    frames = tqdm(total=own.frames, unit="frame", unit_scale=True, desc=f"seed {seed}", **style)

    def prepared(ready: int, total: int) -> None:
        worlds.total = total
        worlds.update(ready - worlds.n)

    def each(done: int) -> None:
        worlds.close()
        frames.update(done - frames.n)

    def told(row: dict[str, Any]) -> None:
        frames.set_postfix_str(_line(row))

    try:
        rows = train(own, seed, folder, each=each, report=told, prepared=prepared)
    except (KeyboardInterrupt, SystemError) as error:
        if by_hand(error):
            print(f"\n{folder}: the same command goes on from its last checkpoint", file=sys.stderr)
        raise
    finally:
        worlds.close()
        frames.close()
    return rows[-1]


def _line(row: dict[str, Any]) -> str:
    """What a person wants to know of a row."""
    parts = [f"success {float(row['success']):.2f}"] if "success" in row else []
    if row.get("trial_success") not in (None, ""):
        parts.append(f"trials {float(row['trial_success']):.2f}")
    if "frames_per_second_s" in row:
        parts.append(f"{float(row['frames_per_second_s']):,.0f} frames/s")
    return ", ".join(parts)


def _side_by_side(given: argparse.Namespace, seeds: list[int], out: Path) -> int:
    """Each seed in a process of its own, so many at a time; their words go to a log each."""
    waiting, running = list(seeds), dict[int, subprocess.Popen[bytes]]()
    codes: dict[int, int] = {}
    try:
        while waiting or running:
            while waiting and len(running) < given.jobs:
                seed = waiting.pop(0)
                folder = out / f"seed_{seed}"
                folder.mkdir(parents=True, exist_ok=True)
                command = [sys.executable, "-m", "agents.cli", "train", given.algorithm]
                command += ["--seeds", str(seed), "--out", str(folder)]
                for key in ("config", "frames"):
                    if getattr(given, key) is not None:
                        command += [f"--{key}", str(getattr(given, key))]
                for change in [*given.set, "threads=1"]:
                    command += ["--set", change]
                log = (folder / "log.txt").open("ab")
                running[seed] = subprocess.Popen(command, stdout=log, stderr=log)
                print(f"seed {seed}: {folder / 'log.txt'}", file=sys.stderr)
            for seed, process in list(running.items()):
                try:
                    codes[seed] = process.wait(timeout=0.5)
                except subprocess.TimeoutExpired:
                    continue
                del running[seed]
                print(f"seed {seed}: exit code {codes[seed]}", file=sys.stderr)
    finally:
        for process in running.values():
            process.terminate()
    return max(codes.values(), default=0)
