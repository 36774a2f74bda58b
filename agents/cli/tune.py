"""`wheelchair tune`: a search for settings of a planner or a policy."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from agents.cli.arguments import (
    add_env,
    add_json,
    add_shield,
    add_workers,
    count,
    finite,
    names,
    report,
    shield_of,
    spec,
    whole,
)

if TYPE_CHECKING:
    from agents.evaluation.evaluate import Spec

APART = 500_000  # from the episodes of trials to those that the best is judged on again


def add(parts: Any) -> None:
    """Add the subcommand's parser."""
    parser: argparse.ArgumentParser = parts.add_parser(
        "tune",
        help="search for settings of a planner or a policy",
        description="Search for settings by Optuna, on training seeds: a policy (PLANNER+FOLLOWER) "
        "is judged by driving a suite, a planner by its plans. The first trial is what is set. The "
        "best is judged again on episodes that no trial saw. The same command after Ctrl-C, or "
        "with more trials, goes on.",
        epilog="example: wheelchair tune lattice+window --vary follower.objective.clearance=0.05:1 "
        "--suite homes --trials 40",
    )
    parser.add_argument("name", metavar="NAME", help="what is tuned; or FILE.json:NAME")
    parser.add_argument(
        "--vary", action="append", required=True, metavar="KEY=LOW:HIGH",
        help="a setting and where to search: KEY=LOW:HIGH, KEY=LOW:HIGH:log or KEY=A,B,C; may be "
        "given again",
    )  # fmt: skip
    parser.add_argument("--trials", type=count, default=40, metavar="N", help="default 40")
    parser.add_argument(
        "--episodes", type=count, default=20, metavar="N",
        help="or worlds, per scene and trial (default 20)",
    )  # fmt: skip
    parser.add_argument("--suite", help="whose scenes a policy drives (default homes)")
    parser.add_argument(
        "--scenes", type=names, metavar="A,B", help="in place of a suite's; default floor_plan"
    )
    parser.add_argument(
        "--by", metavar="METRIC",
        help="of a policy's episodes: sct (default; success weighted by completion time), spl, "
        "success, barn or barn_own",
    )  # fmt: skip
    parser.add_argument("--deadline", type=finite, metavar="S", help="of a planner's plans")
    parser.add_argument("--seed", type=whole, default=0, metavar="S", help="of Optuna's draws")
    add_env(parser)
    add_shield(parser)
    add_workers(parser)
    parser.add_argument("--out", metavar="DIR", help="default runs/tune/NAME")
    parser.add_argument("--quiet", action="store_true", help="no progress bar")
    add_json(parser)
    parser.set_defaults(run=run)


def run(given: argparse.Namespace) -> int:
    """Search, and write everything to the folder."""
    import importlib.util

    from agents.evaluation.compare import TRAINING
    from agents.evaluation.provenance import command_line
    from agents.evaluation.runs import StoppedError
    from agents.evaluation.search_space import read_range
    from agents.evaluation.tuning import tune
    from wheelchair_gym.config import InputError

    if importlib.util.find_spec("optuna") is None:
        raise InputError("tune needs the package optuna; pip install 'wheelchair_gym[tune]'")
    what = spec(given.name)
    ranges = [read_range(text) for text in given.vary]
    if len({vary.key for vary in ranges}) < len(ranges):
        raise InputError("--vary: a setting is given twice")
    folder = Path(given.out or Path("runs") / "tune" / Path(given.name).name.replace(":", "_"))
    try:
        found = tune(
            what, ranges, _judge(given, what, folder),
            range(TRAINING, TRAINING + given.episodes),
            range(TRAINING + APART, TRAINING + APART + given.episodes),
            trials=given.trials, folder=folder, seed=given.seed, progress=not given.quiet,
        )  # fmt: skip
    except StoppedError as stopped:
        print(f"wheelchair: stopped; {stopped}; resume with: {command_line()}", file=sys.stderr)
        return 130
    report(given, found, f"{_told(found)}\n{folder / 'best.json'}:{found['name']}")
    return 0


def _judge(given: argparse.Namespace, what: Any, folder: Path) -> Any:
    """Who judges, as the options say."""
    from agents.cli.compare import scenes_of
    from agents.evaluation.compare import suite
    from agents.evaluation.provenance import cores
    from agents.evaluation.tuning import METRICS, Drives, Plans, is_planner
    from wheelchair_gym.config import InputError

    jobs = given.jobs or cores()
    scenes: Sequence[Spec] = [scene for name in given.scenes or () for scene in scenes_of(name)]
    if is_planner(what):
        for option in ("suite", "by", "config", "pose", "shield"):
            if getattr(given, option) is not None:
                raise InputError(f"--{option} is of policies; {given.name} is a planner")
        return Plans(scenes or ["floor_plan"], given.deadline, folder, jobs, given.engine)
    if given.deadline is not None:
        raise InputError(f"--deadline is of planners; {given.name} is a policy")
    metric = given.by or METRICS[0]
    if metric not in METRICS:
        raise InputError(f"--by {metric} is unknown; known: {', '.join(METRICS)}")
    env = {"config": given.config, "pose_source": given.pose, "shield": shield_of(given)}
    if given.config is None and given.pose is None:
        env["pose_source"] = "modelled"
    scenes = scenes or suite(given.suite or "homes").scenes
    return Drives(scenes, env, metric, folder, jobs, given.engine)


def _told(found: dict[str, Any]) -> str:
    """The result in words."""
    best, others = found["best"], found["others"]
    first = f"{found['name']}: the best of {found['trials']} trials is number {best['trial']}"
    lines = [f"{first}, {best['score']:.4g}"]
    for key, value in best["settings"].items():
        lines.append(f"  {key} = {value:.4g}" if isinstance(value, float) else f"  {key} = {value}")
        lines[-1] += f" (was {found['before'][key]})"
    low, high = others["gain_interval"]
    lines.append(
        f"on {others['episodes']} that no trial saw: {others['best']:.4g}, what was set "
        f"{others['before']:.4g}; gain {others['gain']:+.4g} ({low:+.4g} to {high:+.4g})"
    )
    return "\n".join(lines)
