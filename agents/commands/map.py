"""`wheelchair map`: a map of a place, from what a robot recorded there."""

from __future__ import annotations

import argparse
from typing import Any

from agents.commands.arguments import add_json, add_watch, count, report, watch, whole


def add(parts: Any) -> None:
    """Add the subcommand's parser."""
    parser: argparse.ArgumentParser = parts.add_parser(
        "map",
        help="build a map from a recorded log, by SLAM and by odometry alone",
        description="Build a map from a log in BreezySLAM's format (encoders and scans), by SLAM "
        "and by odometry alone, and tell how well scans that were kept out of each map lie on it.",
        epilog="example: wheelchair map --log mines_exp1.dat --particles 10 --picture map.png",
    )
    parser.add_argument("--log", required=True, metavar="FILE", help="one line a scan")
    parser.add_argument(
        "--particles", type=count, metavar="N", help="of the SLAM; 1 only matches scans"
    )
    parser.add_argument("--seed", type=whole, default=0, help="of the SLAM's draws (default 0)")
    parser.add_argument(
        "--out", metavar="FOLDER", default="runs/map",
        help="for map.yaml and map.pgm (default runs/map)",
    )  # fmt: skip
    parser.add_argument(
        "--picture", metavar="FILE.png", help="draw the map with the way driven, both ways"
    )
    parser.add_argument("--odometry-only", action="store_true", help="trust the wheels: no SLAM")
    parser.add_argument("--quiet", action="store_true", help="no progress bar")
    add_watch(parser)
    add_json(parser)
    parser.set_defaults(run=run)


def run(given: argparse.Namespace) -> int:
    """Build the maps, write them, and say how good they are."""
    from pathlib import Path

    from agents.provenance import command_line, commit, machine, versions
    from agents.survey import HOLD, by_odometry, by_slam, progress
    from wheelchair_gym.config import InputError, dump
    from wheelchair_gym.mapping.log import LogFormat, read_log
    from wheelchair_gym.mapping.slam import Slam, SlamSettings
    from wheelchair_gym.maps import write_map
    from wheelchair_gym.view import draw_map, write_png

    if given.picture and Path(given.picture).suffix.lower() != ".png":
        raise InputError(f"{given.picture}: a picture is a .png")
    if given.odometry_only and watch(given):
        raise InputError("--odometry-only: viewers and recordings are told of the SLAM")
    form = LogFormat()
    log = read_log(given.log, form)
    own = SlamSettings() if given.particles is None else SlamSettings(particles=given.particles)
    with progress(len(log.stamps), not given.quiet) as bar:
        surveys = [by_odometry(log, form.laser, own.mapping)]
        if not given.odometry_only:
            each, end = watch(given).on_survey(log, form.laser)

            def tell(slam: Slam) -> None:
                each(slam)
                bar.update(1)

            try:
                surveys.append(by_slam(log, form.laser, own, given.seed, tell))
            finally:
                end(None)
    folder = Path(given.out)
    path = folder / "map.yaml"
    for survey in surveys:
        name = "odometry.yaml" if survey is not surveys[-1] else path.name
        write_map(survey.grid, folder / name)
    if given.picture:
        write_png(given.picture, draw_map([(s.name, s.grid, s.trail) for s in reversed(surveys)]))
    skipped = sum(log.skipped.values())
    value = {
        "log": Path(given.log).name,
        "scans": len(log.stamps),
        "seconds": float(log.stamps[-1]),
        "skipped": dict(log.skipped),
        "held_out": f"every {HOLD}th scan",
        "maps": [survey.figures for survey in surveys],
        "settings": dump(own),
        "seed": given.seed,
        "files": {"map": str(path), "picture": given.picture},
        "command": command_line(),
        "commit": commit(),
        "machine": machine(),
        "versions": versions(),
    }
    why = ", ".join(f"{lines} {reason}" for reason, lines in log.skipped.items())
    lines = [
        f"{given.log}: {len(log.stamps)} scans in {log.stamps[-1]:.1f} s, "
        f"{skipped} lines skipped{f' ({why})' if why else ''}",
        f"held-out scans (every {HOLD}th), from each beam's end to the nearest occupied cell:",
    ]
    lines += [survey.line for survey in surveys]
    report(given, value, "\n".join([*lines, str(path)]))
    return 0
