"""Parsers of option values, and the values that some options may have.

Nothing here imports more than the standard library, so that `--help` answers at once.
"""

import argparse
import math
from collections.abc import Callable
from typing import Any

POSES = ("truth", "odometry", "modelled", "mcl", "slam")
DEFAULT_POSE = "modelled"
LEARNED = ("ppo", "sac", "td3")
ALGORITHMS = (*LEARNED, "bc")


def number(
    kind: Callable[[str], float], low: float = -math.inf, high: float = math.inf
) -> Callable[[str], Any]:
    """A parser of integers or finite numbers within bounds."""

    def parse(text: str) -> float:
        try:
            value = kind(text)
        except ValueError:
            what = "an integer" if kind is int else "a number"
            raise argparse.ArgumentTypeError(f"{text!r} is not {what}") from None
        if isinstance(value, float) and not math.isfinite(value):
            raise argparse.ArgumentTypeError(f"{text!r} is not finite")
        if not low <= value <= high:
            expected = f"at least {low:g}" if high == math.inf else f"{low:g} to {high:g}"
            raise argparse.ArgumentTypeError(f"{text}: expected {expected}")
        return value

    return parse


parse_int, count = number(int, low=0), number(int, low=1)
finite, non_negative, share = number(float), number(float, low=0), number(float, 0, 1)


def pose(text: str) -> list[float]:
    """X,Y or X,Y,YAW: two or three finite numbers."""
    parts = text.split(",")
    if len(parts) not in (2, 3):
        raise argparse.ArgumentTypeError(f"{text!r}: expected X,Y or X,Y,YAW (m, m, rad)")
    return [finite(part) for part in parts]


def names(text: str) -> list[str]:
    """Names separated by commas."""
    found = [name.strip() for name in text.split(",") if name.strip()]
    if not found:
        raise argparse.ArgumentTypeError("expected names separated by commas")
    return found


def poses(text: str) -> list[str]:
    """Pose sources separated by commas."""
    found = names(text)
    for name in found:
        if name not in POSES:
            raise argparse.ArgumentTypeError(f"{name!r} is unknown; known: {', '.join(POSES)}")
    return found


def counts(text: str) -> list[int]:
    """Integers of at least 1, separated by commas."""
    return [count(part) for part in names(text)]


def deadlines(text: str) -> list[float]:
    """Numbers above 0, separated by commas, in ascending order."""
    values = sorted({finite(part) for part in names(text)})
    if values[0] <= 0.0:
        raise argparse.ArgumentTypeError(f"{values[0]:g} s is not positive")
    return values


# What stands for a value of these types in help; for texts that are not paths, NAME.
METAVARS: dict[Any, str] = {
    None: "NAME", parse_int: "N", count: "N", finite: "X", non_negative: "X", share: "SHARE",
    pose: "X,Y[,YAW]", names: "A,B", poses: "A,B", counts: "N,N", deadlines: "S,S",
}  # fmt: skip
