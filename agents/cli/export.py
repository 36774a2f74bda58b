"""`wheelchair export`: a learned policy for others: as ONNX, or as weights with a model card."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from agents.cli.arguments import add_json, names, report


def add(parts: Any) -> None:
    """Add the subcommand's parser."""
    parser: argparse.ArgumentParser = parts.add_parser(
        "export",
        help="write a learned policy for others: ONNX, or weights with a model card",
        description="Write weights as an ONNX graph: pooling, missing echoes, normalisation, "
        "clipping and scaling are in it; FILE.json beside it tells inputs, outputs and settings. "
        "Or write the last weights of a training run's best seed with a card, NAME.md: settings, "
        "curves of all seeds, results, limits.",
        epilog="example: wheelchair export runs/ppo/policy.npz --onnx policy.onnx",
    )
    parser.add_argument("policy", help="weights: a name or a file .npz; for --npz a run's folder")
    to = parser.add_mutually_exclusive_group(required=True)
    to.add_argument("--onnx", metavar="FILE.onnx", help="where to")
    to.add_argument("--npz", metavar="NAME.npz", help="where to, with a card beside it")
    parser.add_argument(
        "--results", type=names, default=[], metavar="A,B",
        help="files results.json of comparisons, for the card",
    )  # fmt: skip
    add_json(parser)
    parser.set_defaults(run=run)


def run(given: argparse.Namespace) -> int:
    """Export the weights."""
    if given.npz is not None:
        from agents.learning.publish import publish

        file = Path(given.npz)
        weights = publish(Path(given.policy), [Path(name) for name in given.results], file)
        report(given, weights.card, f"{file} and {file.with_suffix('.md')}")
        return 0
    from agents.learning.export import export_onnx
    from agents.learning.weights import find_weights, load_weights

    sidecar = export_onnx(load_weights(find_weights(given.policy)), given.onnx)
    report(given, sidecar, f"{given.onnx} and {given.onnx}.json")
    return 0
