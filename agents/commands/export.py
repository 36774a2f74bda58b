"""`wheelchair export`: a learned policy as ONNX, all that it needs within the graph."""

from __future__ import annotations

import argparse
from typing import Any

from agents.commands.arguments import add_json, report


def add(parts: Any) -> None:
    """Add the subcommand's parser."""
    parser: argparse.ArgumentParser = parts.add_parser(
        "export",
        help="write a learned policy as ONNX",
        description="Write weights as an ONNX graph: pooling, missing echoes, normalisation, "
        "clipping and scaling are in it; FILE.json beside it tells inputs, outputs and settings.",
        epilog="example: wheelchair export runs/ppo/best.npz --onnx best.onnx",
    )
    parser.add_argument("policy", help="weights: a name or a file .npz")
    parser.add_argument("--onnx", metavar="FILE.onnx", required=True, help="where to")
    add_json(parser)
    parser.set_defaults(run=run)


def run(given: argparse.Namespace) -> int:
    """Export the weights."""
    from agents.learning.export import export_onnx
    from agents.learning.weights import find_weights, load_weights

    sidecar = export_onnx(load_weights(find_weights(given.policy)), given.onnx)
    report(given, sidecar, f"{given.onnx} and {given.onnx}.json")
    return 0
