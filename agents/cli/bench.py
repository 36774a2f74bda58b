"""`wheelchair bench`: how fast environments step on this machine, and how planners fare."""

from __future__ import annotations

import argparse
import importlib.util
import sys
from pathlib import Path
from typing import Any

from agents.cli.arguments import add_json, count, finite, names, report, spec

SEEDS = 20
DEADLINES = [0.01, 0.1, 1.0]  # s
PAUSE = 30.0  # s between two times that results are written while a benchmark runs


def add(parts: Any) -> None:
    """Add the subcommand's parsers."""
    parser: argparse.ArgumentParser = parts.add_parser(
        "bench",
        help="measure how fast environments step, or compare planners",
        description="Measure how fast environments step on this machine, or run planners against "
        "each other, beside other packages where they are installed (extra 'peers').",
        epilog="example: wheelchair bench env --beams 1081 --envs 1024 --threads 2",
    )
    whats = parser.add_subparsers(dest="what", required=True, metavar="WHAT")
    _add_env(whats)
    _add_planners(whats)


def _add_env(whats: Any) -> None:
    parser: argparse.ArgumentParser = whats.add_parser(
        "env",
        help="how fast environments step",
        description="Measure how fast environments step on this machine, one and many at once, "
        "beside IR-SIM where it is installed (extra 'peers').",
        epilog="example: wheelchair bench env --beams 1081 --envs 1024 --threads 2",
    )
    parser.add_argument("--beams", type=_counts, default=[64, 128, 181, 1081], help="of the laser")
    parser.add_argument("--envs", type=_counts, default=[1, 16, 64, 256, 1024], help="in a batch")
    parser.add_argument("--threads", type=_counts, default=[1, 2], help="of a batch")
    parser.add_argument("--bank", type=count, default=2048, help="worlds (default 2048)")
    parser.add_argument("--seconds", type=finite, default=3.0, help="each (default 3)")
    parser.add_argument("--no-peer", action="store_true", help="measure no other simulator")
    parser.add_argument("--no-start", action="store_true", help="leave out compilation and start")
    parser.add_argument("--out", default="runs/bench", help="folder (default runs/bench)")
    add_json(parser)
    parser.set_defaults(run=run_env)


def _add_planners(whats: Any) -> None:
    parser: argparse.ArgumentParser = whats.add_parser(
        "planners",
        help="planners against each other on the same problems, judged alike",
        description="Run every planner, and those of other packages where they are installed "
        "(extra 'peers'), on the same problems, one core, judged by geometry that is not theirs: "
        "time to the first path, length at deadlines, success, validity, smoothness, clearance.",
        epilog="example: wheelchair bench planners --problems problems.json --seeds 5 "
        "--planners rrt_star,visibility --plot planners.png",
    )
    parser.add_argument(
        "--problems", metavar="FILE.json",
        help="problems (default: one made from each scene that needs no file)",
    )  # fmt: skip
    parser.add_argument("--only", type=names, default=[], metavar="A,B", help="these problems")
    parser.add_argument(
        "--planners", type=names, metavar="A,B",
        help="these planners, also FILE.json:NAME (default all), and peers by name",
    )  # fmt: skip
    parser.add_argument(
        "--peers", action=argparse.BooleanOptionalAction, default=None,
        help="run other packages' planners (default: those installed, unless --planners is given)",
    )  # fmt: skip
    parser.add_argument("--seeds", type=count, default=SEEDS, metavar="N", help="default 20")
    parser.add_argument(
        "--deadlines", type=_deadlines, default=DEADLINES, metavar="S,S",
        help="seconds (default 0.01,0.1,1)",
    )  # fmt: skip
    parser.add_argument("--resume", metavar="FILE", help="go on from these results, and in them")
    parser.add_argument("--csv", metavar="FILE", help="write the figures as CSV")
    parser.add_argument("--plot", metavar="FILE.png", help="draw success and length against time")
    parser.add_argument("--out", default="runs/bench", help="folder (default runs/bench)")
    parser.add_argument("--quiet", action="store_true", help="no progress bar")
    add_json(parser)
    parser.set_defaults(run=run_planners)


def _counts(text: str) -> list[int]:
    return [count(part) for part in names(text)]


def _deadlines(text: str) -> list[float]:
    values = sorted({finite(part) for part in names(text)})
    if values[0] <= 0.0:
        raise argparse.ArgumentTypeError(f"{values[0]:g} s is no deadline; expected more than 0")
    return values


def run_env(given: argparse.Namespace) -> int:
    """Measure, print each figure as it comes, write them all."""
    from agents.benchmarks.environments import measure, provenance
    from agents.evaluation.provenance import write_json
    from wheelchair_gym.config import InputError

    if given.seconds <= 0.0:
        raise InputError(f"--seconds is {given.seconds:g}; expected more than 0")
    peer = not given.no_peer and importlib.util.find_spec("irsim") is not None
    chosen = {
        "beams": given.beams,
        "envs": given.envs,
        "threads": given.threads,
        "bank": given.bank,
        "seconds": given.seconds,
    }
    whence = provenance(**chosen)
    rows = []
    for row in measure(
        given.beams,
        given.envs,
        given.threads,
        bank=given.bank,
        seconds=given.seconds,
        peer=peer,
        start=not given.no_start,
    ):
        rows.append(row)
        print(line(row), file=sys.stderr if given.json == "-" else sys.stdout, flush=True)
    value = {"rows": rows, **whence}
    path = Path(given.out) / "env.json"
    write_json(path, value)
    report(given, value, str(path))
    return 0


def line(row: dict[str, Any]) -> str:
    """A figure as people read it."""
    if "rate" not in row:
        return f"{row['what']:<32}{row['value']:>12,.4g} {row['unit']}"
    where = f"{row['beams']} beams, {row['envs']} envs, {row['threads']} threads"
    ratio = f"   {row['ratio']:.1f} x IR-SIM" if "ratio" in row else ""
    return f"{row['what']:<10}{where:<38}{row['rate']:>12,.0f} steps/s{ratio}"


def _specs(wanted: list[str] | None) -> tuple[list[Any], list[str] | None]:
    """Planners of ours and peers that were named; None: no peer was."""
    from agents.peers import PEERS
    from planners import PLANNERS

    if wanted is None:
        return list(PLANNERS), None
    ours: list[Any] = []
    for name in wanted:
        if name not in PEERS:
            found = spec(name)
            ours.append(found if isinstance(found, str) else {**found, "label": Path(name).name})
    return ours, [name for name in wanted if name in PEERS] or None


def run_planners(given: argparse.Namespace) -> int:
    """Run what is missing, write results as they grow, print tables."""
    from agents.benchmarks.entrants import chosen_peers
    from agents.benchmarks.planner_benchmark import Championship
    from agents.benchmarks.race import known_records, one_core
    from wheelchair_gym.config import InputError

    if given.plot and Path(given.plot).suffix.lower() != ".png":
        raise InputError(f"{given.plot}: a plot is a .png")
    ours, named = _specs(given.planners)
    peers: list[str] = []
    if given.peers is not False and (named or given.peers or given.planners is None):
        peers, missing = chosen_peers(None if given.peers else named)
        for text in missing:
            print(f"wheelchair: {text}", file=sys.stderr)
    known = known_records(given.resume) if given.resume else {}
    with one_core() as core:
        championship = Championship(
            ours,
            peers,
            given.problems,
            given.only,
            range(given.seeds),
            given.deadlines,
            known,
            core,
        )
        file = given.json if given.json not in (None, "-") else Path(given.out) / "planners.json"
        done = championship.go(given.resume or file, bar=not given.quiet, pause=PAUSE)
    value = championship.result()
    championship.write(given.csv, given.plot)
    if given.resume and given.json not in (None, "-", given.resume):
        report(given, value, "")
    if given.json == "-":
        report(given, value, "")
    else:
        print(championship.text(), end="")
    if not done:
        made, wanted = championship.progress
        again = "" if given.resume else f" --resume {file}"
        from agents.evaluation.provenance import command_line

        print(
            f"wheelchair: stopped; {made} of {wanted} runs are kept; "
            f"resume with: {command_line()}{again}",
            file=sys.stderr,
        )
        return 130
    return 0
