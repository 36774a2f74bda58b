"""`wheelchair map`: a map of a place, from a drive through it or from what was recorded there."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from agents.cli.arguments import add_json, add_watch, count, finite, report, spec, watch, whole

SECONDS = 900.0  # s: most homes are mapped in a quarter of that


def add(parts: Any) -> None:
    """Add the subcommand's parser."""
    parser: argparse.ArgumentParser = parts.add_parser(
        "map",
        help="build a map: by exploring a scene, from a recording or from a log",
        description="Build a map by SLAM. In a scene, or with a real chair, a policy drives "
        "through a world that it does not know; the map of a scene is compared with the truth. "
        "From a log in BreezySLAM's format (encoders and scans) or a recording of a chair, the "
        "map by odometry alone is built, too, "
        "and it is told how well scans that were kept out of each map lie on it.",
        epilog="example: wheelchair map --scene floor_plan --seed 4 --picture map.png",
    )
    source = parser.add_mutually_exclusive_group(required=True)
    source.add_argument("--scene", metavar="NAME", help="or FILE.json:NAME; explored")
    source.add_argument(
        "--chair", metavar="CHAIR",
        help="a real one, which explores where it stands: hardware, ros://HOST:PORT, or "
        "FILE.json:NAME as in configs/chairs.json",
    )  # fmt: skip
    source.add_argument("--log", metavar="FILE", help="in BreezySLAM's format: one line a scan")
    source.add_argument("--recording", metavar="FILE.mcap", help="of a chair; its first episode")
    parser.add_argument(
        "--policy", default="explore", help="drives through the scene: explore, manual, ..."
    )
    parser.add_argument(
        "--time", type=finite, default=SECONDS, metavar="S",
        help=f"at most so long in the scene (default {SECONDS:.0f} s)",
    )  # fmt: skip
    parser.add_argument("--window", action="store_true", help="show the drive live")
    parser.add_argument("--config", metavar="FILE.json", help="settings, as in configs/env.json")
    parser.add_argument(
        "--particles", type=count, metavar="N", help="of the SLAM; 1 only matches scans"
    )
    parser.add_argument(
        "--seed", type=whole, default=0, help="of the episode, or of the SLAM's draws (default 0)"
    )
    parser.add_argument(
        "--out", metavar="FOLDER", default="runs/map",
        help="for map.yaml and map.pgm (default runs/map)",
    )  # fmt: skip
    parser.add_argument("--picture", metavar="FILE.png", help="draw the maps with the way driven")
    parser.add_argument("--odometry-only", action="store_true", help="trust the wheels: no SLAM")
    parser.add_argument("--quiet", action="store_true", help="no progress bar")
    add_watch(parser)
    add_json(parser)
    parser.set_defaults(run=run)


def run(given: argparse.Namespace) -> int:
    """Build the maps, write them, and say how good they are."""
    from agents.evaluation.provenance import command_line, commit, machine, versions
    from wheelchair_gym.config import InputError

    if given.picture and Path(given.picture).suffix.lower() != ".png":
        raise InputError(f"{given.picture}: a picture is a .png")
    value, lines = _explored(given) if given.scene or given.chair else _surveyed(given)
    path = Path(given.out) / "map.yaml"
    value |= {
        "seed": given.seed,
        "files": {"map": str(path), "picture": given.picture},
        "command": command_line(),
        "commit": commit(),
        "machine": machine(),
        "versions": versions(),
    }
    report(given, value, "\n".join([*lines, str(path)]))
    return 0


def _place(given: argparse.Namespace) -> Any:
    """The scene, or the chair, that a person names."""
    named = given.scene or given.chair
    return named if "://" in named else spec(named)


def _explored(given: argparse.Namespace) -> tuple[dict[str, Any], list[str]]:
    """Drive through a scene; figures, and lines for a person."""
    import dataclasses

    from agents.cli.arguments import drive_real
    from agents.evaluation.evaluate import label, make_env
    from agents.evaluation.map_building import chart
    from agents.evaluation.map_evaluation import progress
    from agents.policies import make_policy
    from wheelchair_gym.config import InputError
    from wheelchair_gym.envs.settings import env_settings
    from wheelchair_gym.maps import write_map
    from wheelchair_gym.rendering import draw_map, write_png

    if given.odometry_only:
        raise InputError("--odometry-only: expected --log or --recording with it")
    if not given.time > 0.0:
        raise InputError(f"--time {given.time}: expected more than 0 s")
    chosen, scene = spec(given.policy), _place(given)
    if chosen == "explore":
        chosen = {"name": "explore", "seek": False}  # all of the scene, wherever its goal is
    policy = make_policy(chosen)
    own = env_settings(given.config, pose_source="slam")
    if given.particles is not None:
        slam = dataclasses.replace(own.slam, particles=given.particles)
        own = dataclasses.replace(own, slam=slam)
    mode = "human" if given.window else "rgb_array"
    if given.chair:
        env, _ = drive_real(scene, {"config": own}, render_mode=mode)
    else:
        env = make_env(scene, {"config": own}, mode)
    try:
        with progress(round(given.time), not given.quiet, "s") as bar:

            def count_seconds(env: Any) -> None:
                bar.update(env.unwrapped.task.reading.stamp - bar.n)

            env, each = watch(given).on(env, count_seconds)
            made = chart(
                env, policy, given.seed, given.time, each or count_seconds, real=bool(given.chair)
            )
    finally:
        env.close()
    write_map(made.grid, Path(given.out) / "map.yaml")
    if given.picture:
        truth = env.unwrapped.episode.map
        drawn = [("SLAM", made.grid, made.believed), ("truth", truth, made.true)]
        write_png(given.picture, draw_map(drawn[:1] if given.chair else drawn))
    of = made.figures
    where = f"{label(scene)}, seed {given.seed}" if given.scene else given.chair
    lines = [
        f"{given.policy} on {where}: {made.ended} after {made.seconds:.1f} s and {made.way:.1f} m"
    ]
    if given.scene:
        lines += [
            f"pose: RMS {100 * of['pose_rms_m']:.1f} cm, {of['heading_rms_deg']:.2f} deg",
            f"map: {100 * of['right']:.1f} % of its cells right, walls off by "
            f"{100 * of['wall_median']:.1f} cm (median), {100 * of['wall_p95']:.1f} cm (p95), "
            f"{100 * of['floor_seen']:.1f} % of the floor seen",
        ]
    return {"scene": label(scene), "policy": given.policy, **of}, lines


def _surveyed(given: argparse.Namespace) -> tuple[dict[str, Any], list[str]]:
    """Maps from a log or a recording; figures, and lines for a person."""
    from agents.evaluation.map_evaluation import HOLD, by_odometry, by_slam, progress
    from wheelchair_gym.config import InputError, dump
    from wheelchair_gym.localization.logs import LogFormat, read_log
    from wheelchair_gym.localization.slam import Slam, SlamSettings
    from wheelchair_gym.maps import write_map
    from wheelchair_gym.recording.replay import recorded_log
    from wheelchair_gym.rendering import draw_map, write_png

    if given.odometry_only and watch(given):
        raise InputError("--odometry-only: viewers and recordings are told of the SLAM")
    form = LogFormat()
    file = given.log or given.recording
    log, laser = (read_log(file, form), form.laser) if given.log else recorded_log(file)
    own = SlamSettings() if given.particles is None else SlamSettings(particles=given.particles)
    with progress(len(log.stamps), not given.quiet) as bar:
        surveys = [by_odometry(log, laser, own.mapping)]
        if not given.odometry_only:
            each, end = watch(given).on_survey(log, laser)

            def tell(slam: Slam) -> None:
                each(slam)
                bar.update(1)

            try:
                surveys.append(by_slam(log, laser, own, given.seed, tell))
            finally:
                end(None)
    for survey in surveys:
        name = "map" if survey is surveys[-1] else "odometry"
        write_map(survey.grid, Path(given.out) / f"{name}.yaml")
    if given.picture:
        write_png(given.picture, draw_map([(s.name, s.grid, s.trail) for s in reversed(surveys)]))
    skipped = sum(log.skipped.values())
    why = ", ".join(f"{lines} {reason}" for reason, lines in log.skipped.items())
    value = {
        "log": Path(file).name,
        "scans": len(log.stamps),
        "seconds": float(log.stamps[-1]),
        "skipped": dict(log.skipped),
        "held_out": f"every {HOLD}th scan",
        "maps": [survey.figures for survey in surveys],
        "settings": dump(own),
    }
    lines = [
        f"{file}: {len(log.stamps)} scans in {log.stamps[-1]:.1f} s, "
        f"{skipped} lines skipped{f' ({why})' if why else ''}",
        f"held-out scans (every {HOLD}th), from each beam's end to the nearest occupied cell:",
        *(survey.line for survey in surveys),
    ]
    return value, lines
