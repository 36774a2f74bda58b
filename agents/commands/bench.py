"""`wheelchair bench env`: how fast environments step on this machine."""

from __future__ import annotations

import argparse
import importlib.util
import sys
from pathlib import Path
from typing import Any

from agents.commands.arguments import add_json, count, finite, names, report


def add(parts: Any) -> None:
    """Add the subcommand's parser."""
    parser: argparse.ArgumentParser = parts.add_parser(
        "bench",
        help="measure how fast environments step",
        description="Measure how fast environments step on this machine, one and many at once, "
        "beside IR-SIM where it is installed (extra 'peers').",
        epilog="example: wheelchair bench env --beams 1081 --envs 1024 --threads 2",
    )
    parser.add_argument("what", choices=["env"], help="what is measured")
    parser.add_argument("--beams", type=_counts, default=[64, 128, 181, 1081], help="of the laser")
    parser.add_argument("--envs", type=_counts, default=[1, 16, 64, 256, 1024], help="in a batch")
    parser.add_argument("--threads", type=_counts, default=[1, 2], help="of a batch")
    parser.add_argument("--bank", type=count, default=2048, help="worlds (default 2048)")
    parser.add_argument("--seconds", type=finite, default=3.0, help="each (default 3)")
    parser.add_argument("--no-peer", action="store_true", help="measure no other simulator")
    parser.add_argument("--no-start", action="store_true", help="leave out compilation and start")
    parser.add_argument("--out", default="runs/bench", help="folder (default runs/bench)")
    add_json(parser)
    parser.set_defaults(run=run)


def _counts(text: str) -> list[int]:
    return [count(part) for part in names(text)]


def run(given: argparse.Namespace) -> int:
    """Measure, print each figure as it comes, write them all."""
    from agents.bench import measure, provenance
    from agents.provenance import write_json
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
