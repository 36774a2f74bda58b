"""`wheelchair scenes`: what scenes there are, and what they are like."""

from __future__ import annotations

import argparse
import inspect
from typing import Any

from agents.commands.arguments import add_json, count, report


def add(parts: Any) -> None:
    """Add the subcommand's parser."""
    parser: argparse.ArgumentParser = parts.add_parser(
        "scenes",
        help="list the scenes, or measure what one is like",
        description="List the scenes; with a name, sample it and print the distribution.",
        epilog="example: wheelchair scenes floor_plan --samples 50",
    )
    parser.add_argument("name", nargs="?", help="a scene to sample")
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

    scene = make_scene(given.name)
    values: dict[str, list[float]] = {"way_straight_m": [], "width_m": [], "height_m": []}
    solid = []
    for seed in range(given.samples):
        episode = scene.sample(np.random.default_rng(seed))
        x0, y0, x1, y1 = episode.map.bounds
        way = np.hypot(*(np.asarray(episode.goal)[:2] - np.asarray(episode.start)[:2]))
        values["way_straight_m"].append(float(way))
        values["width_m"].append(x1 - x0)
        values["height_m"].append(y1 - y0)
        solid.append(float(np.mean(episode.map.solid(False))))
    values["solid_share"] = solid
    rows = {
        key: {
            "p5": float(np.percentile(of, 5)),
            "p50": float(np.percentile(of, 50)),
            "p95": float(np.percentile(of, 95)),
        }
        for key, of in values.items()
    }
    lines = [f"{given.name}: {given.samples} samples (5 %, median, 95 %)"]
    lines += [f"{k:<16} {r['p5']:8.2f} {r['p50']:8.2f} {r['p95']:8.2f}" for k, r in rows.items()]
    report(given, {"name": given.name, "samples": given.samples, "figures": rows}, "\n".join(lines))
    return 0
