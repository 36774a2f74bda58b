"""`wheelchair scenes`: what scenes there are, and what they are like."""

from __future__ import annotations

import argparse
import inspect
from typing import Any

from agents.cli.arguments import add_json, count, report, spec


def add(parts: Any) -> None:
    """Add the subcommand's parser."""
    parser: argparse.ArgumentParser = parts.add_parser(
        "scenes",
        help="list the scenes, or measure what one is like",
        description="List the scenes; with a name, sample it and print the distribution.",
        epilog="example: wheelchair scenes floor_plan --samples 50",
    )
    parser.add_argument("name", nargs="?", help="a scene to sample, or FILE.json:NAME")
    parser.add_argument("--samples", type=count, default=20, help="episodes (default 20)")
    add_json(parser)
    parser.set_defaults(run=run)


def run(given: argparse.Namespace) -> int:
    """List or describe."""
    from wheelchair_gym.scenes import SCENES

    if given.name is not None:
        return _describe(given)
    found = []
    for name, scene in sorted(SCENES.items()):
        what = (inspect.getdoc(scene) or "").split("\n")[0]
        found.append({"name": name, "what": what})
    report(given, found, "\n".join(f"{scene['name']:<16} {scene['what']}" for scene in found))
    return 0


def _describe(given: argparse.Namespace) -> int:
    import numpy as np

    from wheelchair_gym.scenes import make_scene
    from wheelchair_gym.scenes.describe import measure

    drawn = measure(make_scene(spec(given.name)), range(given.samples))
    rows = []
    for name, values in drawn.items():
        least, low, middle, high, most = np.quantile(values, (0.0, 0.05, 0.5, 0.95, 1.0)).tolist()
        rows.append(
            {"figure": name, "n": len(values), "least": least, "p5": low, "p50": middle}
            | {"p95": high, "most": most}
        )
    columns = ("n", "least", "p5", "p50", "p95", "most")
    lines = [f"{given.name}, seeds 0 to {given.samples - 1}".ljust(32)]
    lines[0] += "".join(f"{column:>9}" for column in columns)
    lines += [
        f"{row['figure']:<32}" + "".join(f"{row[column]:>9.4g}" for column in columns)
        for row in rows
    ]
    value = {"scene": given.name, "samples": given.samples, "figures": rows}
    report(given, value, "\n".join(lines))
    return 0
