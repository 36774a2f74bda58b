"""`wheelchair simulate`: one episode, to a window, a video or a picture."""

from __future__ import annotations

import argparse
from typing import Any

from agents.cli.arguments import (
    POSE,
    add_env,
    add_json,
    add_shield,
    add_watch,
    pose,
    report,
    shield_of,
    spec,
    watch,
    whole,
)


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
    parser.add_argument(
        "--chair", metavar="CHAIR",
        help="a real one in place of the simulated: ros://HOST:PORT, hardware, or FILE.json:NAME "
        "as in configs/chairs.json",
    )  # fmt: skip
    parser.add_argument(
        "--goal", metavar="X,Y[,YAW]", type=pose, help="of a real chair, on the map that it tells"
    )
    parser.add_argument(
        "--start", metavar="X,Y,YAW", type=pose, help="where it is, if it does not tell"
    )
    add_env(parser)
    add_shield(parser)
    shown = parser.add_mutually_exclusive_group()
    shown.add_argument("--window", action="store_true", help="show it live")
    shown.add_argument("--video", metavar="FILE", help="write a video (mp4)")
    shown.add_argument("--picture", metavar="FILE", help="draw the end, with the way driven")
    add_watch(parser)
    add_json(parser)
    parser.set_defaults(run=run)


def run(given: argparse.Namespace) -> int:
    """Drive the episode and report it."""
    from agents.deploy import Deployment, Journal, say
    from agents.evaluation.evaluate import drive_episode, env_settings, label, make_env
    from agents.policies import make_policy
    from wheelchair_gym.config import InputError
    from wheelchair_gym.rendering.video import write_png, write_video
    from wheelchair_gym.safety.stops import holds

    policy = make_policy(spec(given.policy))
    source = POSE if given.pose is None and given.config is None else given.pose
    settings = env_settings(pose_source=source, config=given.config, shield=shield_of(given))
    scene = settings.get("config", {}).get("scene", "floor_plan")
    if given.scene is not None:
        scene = spec(given.scene)
    mode, episode = "human" if given.window else "rgb_array", None
    if given.chair is not None:
        env, episode = _real(given, settings, scene, mode)
    elif given.goal or given.start:
        raise InputError("--goal and --start are of a real chair (--chair)")
    else:
        env = make_env(scene, settings, mode)
    frames: list[Any] = []
    film: Any = (lambda e: frames.append(e.render())) if given.video else None
    # Of a real chair it is told when it stands and why, and what cannot go on is ended.
    journal = None if given.chair is None else Journal(Deployment(), say, False)
    try:
        env, film = watch(given).on(env, film)

        def each(now: Any) -> bool:
            if film is not None:
                film(now)
            return journal is not None and journal(now)

        record = drive_episode(env, policy, given.seed, each, episode)
        if given.video:
            write_video(given.video, frames, round(1.0 / env.unwrapped.task.period))
        if given.picture:
            write_png(given.picture, env.render())
    finally:
        env.close()
    if journal is not None and journal.ended:
        record |= {"outcome": "halted", "success": False}
    stands = holds(env.unwrapped.task.reading.halted, env.unwrapped.shield)
    place = label(scene) if episode is None else episode.name
    record |= {"policy": given.policy, "scene": place, "seed": given.seed, "stands": stands}
    least = record["clearance_min"]
    text = (
        f"{given.policy} on {place}, seed {given.seed}: {record['outcome']} after "
        f"{record['time']:.1f} s and {record['length']:.2f} m (shortest {record['geodesic']:.2f}"
        f" m), least clearance {'-' if least is None else f'{least:.3f}'} m"
        + (f"; it stands: {'; '.join(stands)}" if stands else "")
        + (" (nobody re-arms it in simulation)" if stands and given.chair is None else "")
    )
    report(given, record, text)
    return 0


def _real(
    given: argparse.Namespace, settings: dict[str, Any], scene: Any, mode: str
) -> tuple[Any, Any]:
    """An environment of a real chair, and the episode on its own map if a goal is given."""
    from agents.cli.arguments import drive_real
    from wheelchair_gym.config import InputError

    if given.shield == "off":
        raise InputError("--shield off is of the simulated chair; a real one has it always")
    if given.goal is None and given.scene is None:
        raise InputError("--chair: expected --goal X,Y on its own map, or --scene with one")
    if given.start is not None and len(given.start) != 3:
        raise InputError("--start of a real chair: expected X,Y,YAW (m, m, rad)")
    named = given.chair if "://" in given.chair else spec(given.chair)
    env, chair = drive_real(named, settings, scene=scene, render_mode=mode)
    try:
        if given.goal is not None and not hasattr(chair, "episode"):
            raise InputError(f"--goal: {given.chair} has no map of its own; expected --scene")
        return env, None if given.goal is None else chair.episode(given.goal, given.start)
    except BaseException:
        env.close()
        raise
