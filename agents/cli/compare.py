"""`wheelchair compare`: policies against each other on many episodes."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

from agents.cli.arguments import (
    POSES,
    add_json,
    add_shield,
    add_watch,
    add_workers,
    count,
    names,
    report,
    shield_of,
    spec,
    watch,
    whole,
)


def add(parts: Any) -> None:
    """Add the subcommand's parser."""
    parser: argparse.ArgumentParser = parts.add_parser(
        "compare",
        help="compare policies on scenes, and write a report",
        description="Run a suite of episodes, each policy on each scene and seed. Finished "
        "episodes are stored: the same command after Ctrl-C computes only what is missing.",
        epilog="example: wheelchair compare --suite demo --jobs 2 --out runs/demo",
    )
    parser.add_argument(
        "--suite", default="demo",
        help="barn, clinic, crowd, cylinders, demo, doors, followers, homes, league, temporary "
        "or thesis (default demo)",
    )  # fmt: skip
    parser.add_argument("--policies", type=names, metavar="A,B", help="in place of the suite's")
    parser.add_argument(
        "--scenes", type=names, metavar="A,B",
        help="in place of the suite's; a name, FILE.json:NAME as in configs/scenes.json, or "
        "FILE.json: all worlds in a file of BARN's",
    )  # fmt: skip
    parser.add_argument("--episodes", type=count, metavar="N", help="per policy and scene")
    first = parser.add_mutually_exclusive_group()
    first.add_argument("--first-seed", type=whole, default=0, metavar="S", help="default 0")
    first.add_argument("--train", action="store_true", help="training seeds, to choose settings on")
    parser.add_argument("--config", metavar="FILE.json", help="settings, as in configs/env.json")
    parser.add_argument(
        "--pose", type=poses, metavar="A,B",
        help=f"the chair's own estimate: {', '.join(POSES)} (then the map is unknown); several are "
        "compared (default: the config's, or the suite's)",
    )  # fmt: skip
    add_shield(parser)
    add_workers(parser)
    parser.add_argument("--out", metavar="DIR", help="default runs/SUITE")
    parser.add_argument("--no-video", action="store_true", help="film nothing")
    parser.add_argument("--quiet", action="store_true", help="no progress bar")
    add_watch(parser, "FOLDER")
    add_json(parser)
    parser.set_defaults(run=run)


def poses(text: str) -> list[str]:
    """Pose sources between commas."""
    found = names(text)
    for name in found:
        if name not in POSES:
            raise argparse.ArgumentTypeError(f"{name!r} is none; known: {', '.join(POSES)}")
    return found


def scenes_of(name: str) -> list[str | dict[str, Any]]:
    """What a person names; all worlds of a file."""
    from wheelchair_gym.scenes.barn import numbers_in

    if not name.endswith(".json"):
        return [_labelled(name)]
    stem = Path(name).stem
    return [
        {"name": "barn", "path": name, "world": world, "label": f"{stem} {world}"}
        for world in numbers_in(name)
    ]


def _labelled(name: str) -> str | dict[str, Any]:
    """What a person names; settings from a file are shown as FILE.json:NAME."""
    found = spec(name)
    return found if isinstance(found, str) else {**found, "label": Path(name).name}


def run(given: argparse.Namespace) -> int:
    """Compare, report, and write everything to the folder."""
    import dataclasses

    from agents.evaluation.compare import TRAINING, compare, in_words, suite
    from agents.evaluation.evaluate import label
    from agents.evaluation.provenance import command_line, cores
    from agents.evaluation.runs import StoppedError

    what = suite(given.suite)
    env = dict(what.env) if given.config is None else {"config": given.config}
    scenes = [scene for name in given.scenes or () for scene in scenes_of(name)] or what.scenes
    if given.pose is not None and len(given.pose) == 1:
        env["pose_source"] = given.pose[0]
    elif given.pose is not None:
        scenes = [
            {
                **({"name": scene} if isinstance(scene, str) else scene),
                "label": f"{label(scene)}, {pose}",
                "env": {"pose_source": pose},
            }
            for pose in given.pose
            for scene in scenes
        ]
    env["shield"] = shield_of(given)
    what = dataclasses.replace(
        what,
        policies=tuple(map(_labelled, given.policies or ())) or what.policies,
        scenes=tuple(scenes),
        episodes=given.episodes or what.episodes,
        env=env,
        video=what.video and not given.no_video,
    )
    folder = Path(given.out or Path("runs") / given.suite)
    first = TRAINING if given.train else given.first_seed
    seeds = range(first, first + what.episodes)
    try:
        evaluation = compare(
            what, folder, jobs=given.jobs or cores(), engine=given.engine,
            progress=not given.quiet, seeds=seeds, watch=watch(given),
        )  # fmt: skip
    except StoppedError as stopped:
        print(f"wheelchair: stopped; {stopped}; resume with: {command_line()}", file=sys.stderr)
        return 130
    report(given, evaluation, f"{in_words(evaluation)}\n{folder / 'report.html'}")
    return 0
