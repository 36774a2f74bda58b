"""`wheelchair deploy`: a policy drives a real chair on a map."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

from agents.cli.arguments import POSES, add_json, add_watch, distance, pose, report, spec, watch

CONFIG = "configs/hardware.json"
_WARM = "clutter"  # the scene in which all is tried in simulation first


def add(parts: Any) -> None:
    """Add the subcommand's parser."""
    parser: argparse.ArgumentParser = parts.add_parser(
        "deploy",
        help="a policy drives a real chair to a goal on a map",
        description="Drive a real chair: it waits for a person to re-arm it (Enter, or its "
        "joystick), drives slowly at first, and stands whenever a sensor is silent, a person takes "
        "it, or this program ends. What happens is told on standard error. Keep a hand at the "
        "emergency stop.",
        epilog=f"example: wheelchair deploy --config {CONFIG} --map clinic.yaml --start 1,2,0 "
        "--goal 6,3.5 --record run.mcap",
    )
    parser.add_argument("--policy", default="lattice+window", help="NAME, or FILE.json:NAME")
    parser.add_argument("--config", metavar="FILE.json", required=True, help=f"as {CONFIG}")
    parser.add_argument("--map", metavar="FILE", required=True, help="map_server's YAML, or others")
    parser.add_argument("--goal", metavar="X,Y[,YAW]", type=pose, required=True, help="on the map")
    parser.add_argument(
        "--start", metavar="X,Y,YAW", type=pose, required=True, help="about where it stands"
    )
    parser.add_argument(
        "--force-start", action="store_true",
        help="drive even where the first scan does not fit the map at --start",
    )  # fmt: skip
    parser.add_argument(
        "--chair", metavar="CHAIR", default="hardware",
        help="or ros://HOST:PORT, or FILE.json:NAME as in configs/chairs.json (default hardware)",
    )  # fmt: skip
    parser.add_argument(
        "--pose", choices=[p for p in POSES if p not in ("truth", "modelled")],
        help="the chair's own estimate (default: the config's)",
    )  # fmt: skip
    parser.add_argument(
        "--first", metavar="MPS", type=distance, help="speed cap at the start (default 0.2 m/s)"
    )
    parser.add_argument(
        "--rise", metavar="MPS2", type=distance, help="of the cap (default 0.05 m/s each second)"
    )
    parser.add_argument("--most", metavar="MPS", type=distance, help="the cap rises to (no bound)")
    parser.add_argument(
        "--dry-run", action="store_true",
        help="show what would be commanded until Ctrl-C, and send no command",
    )  # fmt: skip
    add_watch(parser)
    add_json(parser)
    parser.set_defaults(run=run)


def run(given: argparse.Namespace) -> int:
    """Drive it; 0 when it arrived."""
    from agents.cli.arguments import drive_real
    from agents.deploy import Deployment, check_start, deploy, say
    from agents.evaluation.evaluate import env_settings, warm
    from agents.policies import make_policy
    from agents.start_fit import StartCheck
    from wheelchair_gym.config import InputError
    from wheelchair_gym.envs.settings import env_settings as whole_settings
    from wheelchair_gym.hardware.registry import check_extras

    if len(given.start) != 3:
        raise InputError("--start: expected X,Y,YAW (m, m, rad)")
    caps = {name: getattr(given, name) for name in ("first", "rise", "most")}
    own = Deployment(**{name: value for name, value in caps.items() if value is not None})
    named: Any = given.chair if "://" in given.chair else spec(given.chair)
    check_extras(named)
    policy = make_policy(spec(given.policy))
    settings = env_settings(config=given.config, pose_source=given.pose)
    episode = _episode(given, whole_settings(**settings).chair.footprint)
    if given.dry_run:
        named = {"name": named} if isinstance(named, str) else named
        if named["name"] != "hardware":
            raise InputError(f"--dry-run: {given.chair} cannot be listened to; expected hardware")
        named = {**named, "dry": True}
    print("getting ready", file=sys.stderr)
    warm(spec(given.policy), _WARM, settings)  # nothing is compiled while a person sits in it
    env, _ = drive_real(named, settings, render_mode="rgb_array")

    def begin(env: Any) -> None:
        check_start(env, episode.start, StartCheck(), given.force_start, say)

    try:
        env, film = watch(given).on(env)
        record = deploy(env, policy, episode, own, say, given.dry_run, film, begin)
    finally:
        env.close()
    record |= {"policy": given.policy, "map": given.map, "goal": given.goal}
    ended = f"; {record['ended']}" if record["ended"] else ""
    report(
        given,
        record,
        f"{given.policy}: {record['outcome']} after {record['time']:.1f} s and "
        f"{record['length']:.2f} m (shortest {record['geodesic']:.2f} m), by its own belief{ended}",
    )
    return 0 if record["success"] or given.dry_run else 1


def _episode(given: argparse.Namespace, outline: Any) -> Any:
    """Map, start and goal; whether the chair can go there its policy finds out.

    A goal without a heading gets the one at which the chair has the most room.

    Raises:
        InputError: the map cannot be read, or start or goal lie beside it or in something solid.
    """
    import numpy as np

    from wheelchair_gym.config import InputError
    from wheelchair_gym.geometry import roomiest
    from wheelchair_gym.maps import OCCUPIED, read_ground
    from wheelchair_gym.types import Episode

    grid, walls = read_ground(given.map, False)
    for name, place in (("--start", given.start), ("--goal", given.goal)):
        row, col = grid.to_cell(place[:2])
        if not grid.inside(place[:2]) or grid.cells[row, col] == OCCUPIED:
            raise InputError(f"{name} {place[0]:g},{place[1]:g}: not a free place on {given.map}")
    goal = np.array([*given.goal, 0.0][:3])
    if len(given.goal) == 2:
        goal[2], room = roomiest(goal, outline, walls, np.empty((0, 3)))
        if room <= 0.0:
            where = f"--goal {goal[0]:g},{goal[1]:g}"
            raise InputError(f"{where}: no room for the chair on {given.map}, however it faces")
    return Episode(grid, np.array(given.start), goal, walls, name=Path(given.map).stem)
