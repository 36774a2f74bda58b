"""Arguments and output that several subcommands share."""

from __future__ import annotations

import argparse
import json
import math
from typing import Any


def whole(text: str) -> int:
    """A whole number of at least 0."""
    try:
        value = int(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is not a whole number") from None
    if value < 0:
        raise argparse.ArgumentTypeError(f"{value} is negative; expected at least 0")
    return value


def count(text: str) -> int:
    """A whole number of at least 1."""
    value = whole(text)
    if value < 1:
        raise argparse.ArgumentTypeError(f"{value} is too few; expected at least 1")
    return value


def finite(text: str) -> float:
    """A finite number."""
    try:
        value = float(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is not a number") from None
    if not math.isfinite(value):
        raise argparse.ArgumentTypeError(f"{text!r} is not finite")
    return value


def distance(text: str) -> float:
    """A finite number of at least 0."""
    value = finite(text)
    if value < 0:
        raise argparse.ArgumentTypeError(f"{text} m is negative; expected at least 0")
    return value


def pose(text: str) -> list[float]:
    """X,Y or X,Y,YAW: two or three finite numbers."""
    parts = text.split(",")
    if len(parts) not in (2, 3):
        raise argparse.ArgumentTypeError(f"{text!r}: expected X,Y or X,Y,YAW (m, m, rad)")
    return [finite(part) for part in parts]


def names(text: str) -> list[str]:
    """Names between commas."""
    found = [name.strip() for name in text.split(",") if name.strip()]
    if not found:
        raise argparse.ArgumentTypeError("expected names between commas")
    return found


def add_json(parser: argparse.ArgumentParser) -> None:
    """The option `--json FILE`."""
    parser.add_argument(
        "--json", metavar="FILE", help="write the result as JSON; - is stdout, with nothing else"
    )


def report(given: argparse.Namespace, value: Any, text: str) -> None:
    """Give a result to the person: text on stdout, or JSON where it was asked for."""
    from agents.provenance import write_json

    if given.json == "-":
        print(json.dumps(value, indent=1, allow_nan=False))
        return
    if given.json:
        write_json(given.json, value)
    print(text)
