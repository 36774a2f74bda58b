"""`wheelchair train`: learn to drive; one file of settings is the whole run."""

from __future__ import annotations

import argparse
import re
import subprocess
import sys
from pathlib import Path
from typing import Any, NamedTuple

from agents.cli.arguments import add_json, changed, count, names, report, whole
from agents.interrupt import by_hand

# Each gives a tenth more frames a second: torch's threads, when idle, leave the cores to those that
# drive; and what worlds know lies in large pages, of which processors remember more.
ENVIRON = {"GOMP_SPINCOUNT": "30000", "GLIBC_TUNABLES": "glibc.malloc.hugetlb=1"}
ALGORITHMS = ("ppo", "recurrent_ppo", "sac", "td3", "tqc", "bc")


def add(parts: Any) -> None:
    """Add the subcommand's parser."""
    parser: argparse.ArgumentParser = parts.add_parser(
        "train",
        help="learn to drive, or go on with a run that was stopped",
        description="Train a policy. The folder keeps curve.csv, policy.npz (the latest), best.npz "
        "(the best in trials), checkpoint.pt and TensorBoard's log. The same command after Ctrl-C "
        "goes on from the last checkpoint, as if nothing had happened. With --vary, a table and a "
        "figure of the trials are written, too. bc imitates a scripted policy.",
        epilog="example: wheelchair train ppo --config configs/ppo_guided.json --seeds 0,1 "
        "--jobs 2 --out runs/ppo",
    )
    parser.add_argument("algorithm", choices=ALGORITHMS)
    parser.add_argument("--config", metavar="FILE.json", help="as in configs/ppo_guided.json")
    parser.add_argument(
        "--set", metavar="KEY=VALUE", action="append", default=[],
        help="change a setting, such as env.rate=10; may be repeated",
    )  # fmt: skip
    parser.add_argument(
        "--vary", metavar="KEY=A,B", help="train once for each value of a setting, and compare"
    )
    parser.add_argument("--frames", type=count, metavar="N", help="control periods in all")
    parser.add_argument("--seeds", type=names, default=["0"], metavar="A,B", help="default 0")
    parser.add_argument(
        "--jobs", type=count, default=1, metavar="N", help="seeds side by side (default 1)"
    )
    parser.add_argument("--out", metavar="DIR", help="default runs/ALGORITHM, seeds below it")
    parser.add_argument("--quiet", action="store_true", help="no progress bar")
    add_json(parser)
    parser.set_defaults(run=run, environ=ENVIRON)


def run(given: argparse.Namespace) -> int:
    """Train each seed, of each value that a setting shall have."""
    from agents.learning.networks import SB3_CONTRIB, algorithm_class
    from wheelchair_gym.config import InputError, read_json

    try:
        seeds = [whole(text) for text in given.seeds]
    except argparse.ArgumentTypeError as error:
        raise InputError(f"--seeds: {error}") from None
    content = _defaults(given.algorithm) if given.config is None else read_json(given.config)
    if not isinstance(content, dict):
        raise InputError(f"{given.config}: expected an object with keys")
    if given.algorithm in SB3_CONTRIB:  # before anything is compiled or written
        algorithm_class(given.algorithm)
    where = "settings" if given.config is None else Path(given.config).name
    if given.frames is not None and given.algorithm != "bc":
        content["frames"] = given.frames
    out = Path(given.out or Path("runs") / given.algorithm)
    cases = []
    key, words = _varied(given.vary)
    for word in words:
        name = f"{key.rpartition('.')[2]}_{word}" if key else ""
        changes = [*given.set, *([f"{key}={word}"] if key else [])]
        own = _settings(given.algorithm, changed(content, changes), where)
        for seed in seeds:
            folder = out / name / f"seed_{seed}" if len(seeds) > 1 else out / name
            cases.append(Case(f"{name} seed {seed}".strip(), own, changes, seed, folder, word))
    if given.jobs > 1 and len(cases) > 1:
        code = _side_by_side(given, cases)
        if code != 0:
            return code
        results = {case.name: _last(given.algorithm, case.folder) for case in cases}
    else:
        results = {case.name: _one(given, case.own, case.seed, case.folder) for case in cases}
    lines = [f"{name}: {_line(row)}" for name, row in results.items()]
    if key:
        from agents.learning.curves import write_sweep

        lines.append(write_sweep(key, [(case.word, case.folder) for case in cases], out))
    report(given, results, "\n".join([*lines, str(out)]))
    return 0


class Case(NamedTuple):
    """One run of several."""

    name: str
    own: Any
    changes: list[str]
    seed: int
    folder: Path
    word: str  # the value of the setting that is varied, as it was typed


def _varied(vary: str | None) -> tuple[str, list[str]]:
    """Key and values, as they were typed, of KEY=A,B; no key and one value where none varies.

    A value may be a list: KEY=[],[1,2].
    """
    from wheelchair_gym.config import InputError

    if vary is None:
        return "", [""]
    key, _, words = vary.partition("=")
    if not (key and words):
        raise InputError(f"--vary {vary}: expected KEY=A,B")
    return key, [word.strip() for word in re.split(r",(?![^\[]*\])", words) if word.strip()]


def _defaults(algorithm: str) -> dict[str, Any]:
    if algorithm == "bc":
        return {}
    from agents.learning.settings import as_json, recipe

    return as_json(recipe(algorithm))  # type: ignore[arg-type]


def _settings(algorithm: str, content: dict[str, Any], where: str) -> Any:
    if algorithm == "bc":
        from agents.learning.demonstrations import load_imitation

        return load_imitation(content, where)
    from agents.learning.settings import read_training

    return read_training(content, where, algorithm)  # type: ignore[arg-type]


def _last(algorithm: str, folder: Path) -> dict[str, Any]:
    """What a run came to that another process has made."""
    if algorithm == "bc":
        from wheelchair_gym.config import read_json

        return read_json(folder / "rounds.json")[-1]  # type: ignore[no-any-return]
    from agents.learning.curves import read_curve

    return read_curve(folder)[-1]


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
        rows = train(own, seed, folder, on_step=each, on_row=told, on_prepared=prepared)
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
    if row.get("eval_success") not in (None, ""):
        parts.append(f"evaluation {float(row['eval_success']):.2f}")
    if "frames_per_second_s" in row:
        parts.append(f"{float(row['frames_per_second_s']):,.0f} frames/s")
    return ", ".join(parts)


def _side_by_side(given: argparse.Namespace, cases: list[Case]) -> int:
    """Each run in a process of its own, so many at a time; their words go to a log each."""
    waiting, running = list(cases), dict[str, tuple[Case, subprocess.Popen[bytes]]]()
    codes: dict[str, int] = {}
    try:
        while waiting or running:
            while waiting and len(running) < given.jobs:
                case = waiting.pop(0)
                case.folder.mkdir(parents=True, exist_ok=True)
                command = [sys.executable, "-m", "agents.cli", "train", given.algorithm]
                command += ["--seeds", str(case.seed), "--out", str(case.folder)]
                for key in ("config", "frames"):
                    if getattr(given, key) is not None:
                        command += [f"--{key}", str(getattr(given, key))]
                own = [] if given.algorithm == "bc" else ["threads=1"]
                for change in [*case.changes, *own]:
                    command += ["--set", change]
                log = (case.folder / "log.txt").open("ab")
                running[case.name] = case, subprocess.Popen(command, stdout=log, stderr=log)
                print(f"{case.name}: {case.folder / 'log.txt'}", file=sys.stderr)
            for name, (_, process) in list(running.items()):
                try:
                    codes[name] = process.wait(timeout=0.5)
                except subprocess.TimeoutExpired:
                    continue
                del running[name]
                print(f"{name}: exit code {codes[name]}", file=sys.stderr)
    finally:
        for _, process in running.values():
            process.terminate()
    return max(codes.values(), default=0)
