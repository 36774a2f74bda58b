"""`wheelchair simulate`: one episode, to a window, a video or a picture."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from agents.commands.arguments import add_json, report, whole

POSES = ("truth", "odometry", "modelled")


def add(parts: Any) -> None:
    """Add the subcommand's parser."""
    parser: argparse.ArgumentParser = parts.add_parser(
        "simulate",
        help="drive one episode, in a window, to a video or to a picture",
        description="Drive one episode and print how it went.",
        epilog="example: wheelchair simulate --scene floor_plan --policy a_star+pure_pursuit "
        "--seed 3 --video drive.mp4",
    )
    parser.add_argument("--scene", default="floor_plan", help="see: wheelchair scenes")
    parser.add_argument("--policy", default="lattice+window", help="PLANNER+FOLLOWER, random, ...")
    parser.add_argument("--seed", type=whole, default=0, help="of the episode (default 0)")
    parser.add_argument(
        "--pose", choices=POSES, default="modelled", help="the chair's own estimate"
    )
    parser.add_argument("--config", metavar="FILE.json", help="settings of the environment")
    shown = parser.add_mutually_exclusive_group()
    shown.add_argument("--window", action="store_true", help="show it live")
    shown.add_argument("--video", metavar="FILE", help="write a video (mp4)")
    shown.add_argument("--picture", metavar="FILE", help="draw the end, with the way driven")
    add_json(parser)
    parser.set_defaults(run=run)


def run(given: argparse.Namespace) -> int:
    """Drive the episode and report it."""
    from agents.evaluate import drive_episode, env_settings, make_env, save_picture
    from agents.policy import make_policy

    policy = make_policy(given.policy)
    env = make_env(
        given.scene,
        env_settings(pose_source=given.pose, config=given.config),
        "human" if given.window else "rgb_array",
    )
    frames: list[Any] = []
    film = (lambda e: frames.append(e.render())) if given.video else None
    try:
        record = drive_episode(env, policy, given.seed, film)
        if given.video:
            from wheelchair_gym.view.video import write_video

            write_video(Path(given.video), frames, round(1.0 / env.unwrapped.task.period))
        if given.picture:
            save_picture(env.render(), Path(given.picture))
    finally:
        env.close()
    record |= {"policy": given.policy, "scene": given.scene, "seed": given.seed}
    least = record["clearance_min"]
    text = (
        f"{given.policy} on {given.scene}, seed {given.seed}: {record['outcome']} after "
        f"{record['time']:.1f} s and {record['length']:.2f} m (shortest {record['geodesic']:.2f}"
        f" m), least clearance {'-' if least is None else f'{least:.3f}'} m"
    )
    report(given, record, text)
    return 0
