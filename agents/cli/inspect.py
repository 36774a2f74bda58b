"""`wheelchair inspect`: what a learned policy looks at, as a picture."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from agents.cli.arguments import (
    POSE,
    add_env,
    add_json,
    add_shield,
    finite,
    report,
    shield_of,
    spec,
    whole,
)


def share(text: str) -> float:
    """A number from 0 to 1."""
    value = finite(text)
    if not 0.0 <= value <= 1.0:
        raise argparse.ArgumentTypeError(f"{text}: expected 0 to 1")
    return value


def add(parts: Any) -> None:
    """Add the subcommand's parser."""
    parser: argparse.ArgumentParser = parts.add_parser(
        "inspect",
        help="draw what a learned policy looks at",
        description="Drive one episode, hide parts of what the policy sees, and draw how much its "
        "action changes: for each beam at a moment, and for each part over the whole episode.",
        epilog="example: wheelchair inspect runs/ppo/policy.npz --scene clutter --out looks.png",
    )
    parser.add_argument("policy", help="weights: a name or a file")
    parser.add_argument("--scene", metavar="NAME", default="floor_plan", help="default floor_plan")
    parser.add_argument("--seed", type=whole, default=0, help="of the episode (default 0)")
    parser.add_argument(
        "--at", type=share, default=0.5, metavar="SHARE", help="of the episode (default 0.5)"
    )
    parser.add_argument("--out", metavar="FILE", default="looks.png", help="png, svg or pdf")
    add_env(parser)
    add_shield(parser)
    add_json(parser)
    parser.set_defaults(run=run)


def run(given: argparse.Namespace) -> int:
    """Drive, hide and draw."""
    from agents.evaluation.evaluate import drive_episode, env_settings, make_env
    from agents.evaluation.figures import LOOK
    from agents.learning.occlusion import OcclusionRecorder
    from agents.policies import make_policy
    from wheelchair_gym.config import InputError
    from wheelchair_gym.files import whole as written

    file = Path(given.out)
    if file.suffix not in (".png", ".svg", ".pdf"):
        raise InputError(f"--out {file}: expected a name that ends with .png, .svg or .pdf")
    driver = make_policy(spec(given.policy))
    looking = OcclusionRecorder(driver)
    source = POSE if given.pose is None and given.config is None else given.pose
    settings = env_settings(pose_source=source, config=given.config, shield=shield_of(given))
    env = make_env(spec(given.scene), settings)
    try:
        record = drive_episode(env, driver, given.seed, looking)
        import matplotlib as mpl

        with mpl.rc_context(LOOK):
            figure, told = looking.draw(env, given.at)
            with written(file) as part:
                figure.savefig(part, format=file.suffix[1:], dpi=150)
    finally:
        env.close()
    parts = sorted(told["parts"].items(), key=lambda pair: -pair[1])
    told |= {"policy": given.policy, "seed": given.seed, "outcome": record["outcome"]}
    lines = [f"{name}: {change:.3f}" for name, change in parts]
    report(
        given, told, "\n".join([f"{record['outcome']}; the action changes by", *lines, str(file)])
    )
    return 0
