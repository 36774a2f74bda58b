"""`wheelchair simulate`: one episode, to a window, a video or a picture."""

from __future__ import annotations

import argparse
from typing import Any

from agents.commands.arguments import POSE, add_env, add_json, add_watch, report, spec, watch, whole


def add(parts: Any) -> None:
    """Add the subcommand's parser."""
    parser: argparse.ArgumentParser = parts.add_parser(
        "simulate",
        help="drive one episode, in a window, to a video or to a picture",
        description="Drive one episode and print how it went.",
        epilog="example: wheelchair simulate --scene floor_plan --policy a_star+pure_pursuit "
        "--seed 3 --video drive.mp4",
    )
    parser.add_argument(
        "--scene", metavar="NAME", help="or FILE.json:NAME as in configs/scenes.json; see: "
        "wheelchair scenes (default: the config's, or floor_plan)",
    )  # fmt: skip
    parser.add_argument("--policy", default="lattice+window", help="PLANNER+FOLLOWER, random, ...")
    parser.add_argument("--seed", type=whole, default=0, help="of the episode (default 0)")
    add_env(parser)
    shown = parser.add_mutually_exclusive_group()
    shown.add_argument("--window", action="store_true", help="show it live")
    shown.add_argument("--video", metavar="FILE", help="write a video (mp4)")
    shown.add_argument("--picture", metavar="FILE", help="draw the end, with the way driven")
    add_watch(parser)
    add_json(parser)
    parser.set_defaults(run=run)


def run(given: argparse.Namespace) -> int:
    """Drive the episode and report it."""
    from agents.evaluate import drive_episode, env_settings, label, make_env
    from agents.policy import make_policy
    from wheelchair_gym.view.video import write_png, write_video

    policy = make_policy(spec(given.policy))
    pose = POSE if given.pose is None and given.config is None else given.pose
    settings = env_settings(pose_source=pose, config=given.config)
    scene = settings.get("config", {}).get("scene", "floor_plan")
    if given.scene is not None:
        scene = spec(given.scene)
    env: Any = make_env(scene, settings, "human" if given.window else "rgb_array")
    frames: list[Any] = []
    film: Any = (lambda e: frames.append(e.render())) if given.video else None
    env, film = watch(given).on(env, film)
    try:
        record = drive_episode(env, policy, given.seed, film)
        if given.video:
            write_video(given.video, frames, round(1.0 / env.unwrapped.task.period))
        if given.picture:
            write_png(given.picture, env.render())
    finally:
        env.close()
    record |= {"policy": given.policy, "scene": label(scene), "seed": given.seed}
    least = record["clearance_min"]
    text = (
        f"{given.policy} on {label(scene)}, seed {given.seed}: {record['outcome']} after "
        f"{record['time']:.1f} s and {record['length']:.2f} m (shortest {record['geodesic']:.2f}"
        f" m), least clearance {'-' if least is None else f'{least:.3f}'} m"
    )
    report(given, record, text)
    return 0
