"""`wheelchair map` and `convert`: a map from a drive, a recording or a log, or from a file."""

import argparse
import dataclasses
from pathlib import Path
from typing import Any

from agents.cli import arguments
from agents.cli.arguments import check_picture, real_chair_env, refuse, report, spec, watch
from agents.evaluation.evaluate import label, make_env
from agents.evaluation.map_evaluation import HOLD, by_odometry, by_slam, map_by_driving, progress
from agents.evaluation.provenance import command_line, provenance
from agents.policies import make_policy
from wheelchair_gym.base.settings import InputError, dump
from wheelchair_gym.envs.settings import env_settings
from wheelchair_gym.maps import read_grid, write_map
from wheelchair_gym.perception.logs import LASER, read_log
from wheelchair_gym.perception.slam import Slam, SlamSettings
from wheelchair_gym.recording.replay import sensor_log
from wheelchair_gym.rendering import draw_map, write_png
from wheelchair_gym.rendering.picture import MAP_ENTRIES, with_legend


def run(given: argparse.Namespace) -> int:
    """Build the maps, write them, and report their quality."""
    check_picture(given.picture)
    value, lines = _explored(given) if given.scene or given.chair else _from_scans(given)
    path = Path(given.out) / "map.yaml"
    value |= {
        "seed": given.seed,
        "files": {"map": str(path), "picture": given.picture},
        "command": command_line(),
        **provenance(),
    }
    report(given, value, "\n".join([*lines, str(path)]))
    return 0


def _slam(given: argparse.Namespace) -> SlamSettings:
    """Return the settings of SLAM, with as many particles as asked for."""
    slam = env_settings(given.config, model=given.model).slam
    return slam if given.particles is None else dataclasses.replace(slam, particles=given.particles)


def _explored(given: argparse.Namespace) -> tuple[dict[str, Any], list[str]]:
    """Drive through a scene; figures, and lines of text."""
    if given.odometry_only:
        raise InputError("--odometry-only: expected --log or --recording with it")
    if not given.time > 0.0:
        raise InputError(f"--time {given.time}: expected more than 0 s")
    chosen, scene = spec(given.policy), arguments.chair_spec(given.scene or given.chair)
    if chosen == "explore":
        chosen = {"name": "explore", "seek": False}  # all of it, not only up to the goal
    policy = make_policy(chosen)
    refuse(given, ("scan_topic", "odometry_topic"), "expected with --recording")
    config = env_settings(given.config, model=given.model, pose_source="slam")
    config = dataclasses.replace(config, slam=_slam(given))
    mode = "human" if given.window else "rgb_array"
    if given.chair:
        env, _ = real_chair_env(scene, {"config": config}, render_mode=mode)
    else:
        env = make_env(scene, {"config": config}, mode)
    try:
        with progress(round(given.time), not given.quiet, "s") as bar:
            env, each = watch(given).on(
                env, lambda env: bar.update(env.unwrapped.task.reading.stamp - bar.n)
            )
            real = bool(given.chair)
            made = map_by_driving(env, policy, given.seed, given.time, each, real=real)
    finally:
        env.close()
    write_map(made.grid, Path(given.out) / "map.yaml")
    if given.picture:
        truth = env.unwrapped.episode.map
        drawn = [("SLAM", made.grid, made.estimated), ("truth", truth, made.true)]
        picture = draw_map(drawn[:1] if given.chair else drawn)
        write_png(given.picture, with_legend(picture, MAP_ENTRIES))
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


def _from_scans(given: argparse.Namespace) -> tuple[dict[str, Any], list[str]]:
    """Maps from a log or a recording; figures, and lines of text."""
    if given.odometry_only and watch(given):
        raise InputError("--odometry-only: viewers and recordings show SLAM")
    refuse(given, ("policy", "time", "window", "images"), "expected with --scene or --chair")
    topics = ("scan_topic", "odometry_topic") if given.log else ()
    refuse(given, topics, "expected with --recording")
    file = given.log or given.recording
    log, laser = (
        (read_log(file), LASER)
        if given.log
        else sensor_log(file, given.scan_topic, given.odometry_topic)
    )
    config = _slam(given)
    with progress(len(log.stamps), not given.quiet) as bar:
        maps = [by_odometry(log, laser, config)]
        if not given.odometry_only:
            with watch(given).on_log(log, laser) as each:

                def each_scan(slam: Slam) -> None:
                    each(slam)
                    bar.update(1)

                maps.append(by_slam(log, laser, config, given.seed, each_scan))
    for one in maps:
        name = "map" if one is maps[-1] else "odometry"
        write_map(one.grid, Path(given.out) / f"{name}.yaml")
    if given.picture:
        picture = draw_map([(s.name, s.grid, s.trail) for s in reversed(maps)])
        write_png(given.picture, with_legend(picture, MAP_ENTRIES))
    skipped = sum(log.skipped.values())
    why = ", ".join(f"{lines} {reason}" for reason, lines in log.skipped.items())
    value = {
        "log": Path(file).name,
        "scans": len(log.stamps),
        "seconds": float(log.stamps[-1]),
        "skipped": dict(log.skipped),
        "held_out": f"every {HOLD}th scan",
        "maps": [one.figures for one in maps],
        "settings": dump(config),
    }
    lines = [
        f"{file}: {len(log.stamps)} scans in {log.stamps[-1]:.1f} s, "
        f"{skipped} lines skipped{f' ({why})' if why else ''}",
        f"held-out scans (every {HOLD}th), from each beam's end to the nearest occupied cell:",
        *(one.line for one in maps),
    ]
    return value, lines


def convert(given: argparse.Namespace) -> int:
    """Write the YAML file and its image."""
    out = Path(given.out or Path(given.file).with_suffix(".yaml").name)
    if out.suffix not in (".yaml", ".yml"):
        raise InputError(f"--out {out}: expected a name that ends with .yaml")
    for path in (out, out.with_suffix(".pgm")):
        if path.exists():
            raise InputError(f"{path} exists; expected a new name (--out)")
    grid = read_grid(given.file, resolution=given.resolution)
    write_map(grid, out)
    rows, columns = grid.shape
    size = width, height = [columns * grid.resolution, rows * grid.resolution]
    value = {"file": str(out), "resolution": grid.resolution, "size": size, "origin": grid.origin}
    text = f"{out}: {width:g} m x {height:g} m, {columns} x {rows} cells of {grid.resolution:g} m"
    report(given, value, text)
    return 0
