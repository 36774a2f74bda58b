"""Options that commands share, and what parses their values.

Nothing here imports more than the standard library, so that `--help` answers at once.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

CHAIR_CONFIG = "configs/hardware.json"
POSES = ("truth", "odometry", "modelled", "mcl", "slam")
DEFAULT_POSE = "modelled"
ALGORITHMS = ("ppo", "recurrent_ppo", "sac", "td3", "tqc", "bc")


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


class Option(NamedTuple):
    """An argument of `argparse.ArgumentParser.add_argument`."""

    name: str
    arguments: dict[str, Any]


class OneOf(NamedTuple):
    """Options of which at most one may be given, or exactly one."""

    options: Sequence[Option]
    required: bool = False


# What stands for a value of these types in help; for texts that are not paths, NAME.
METAVARS: dict[Any, str] = {
    None: "NAME", parse_int: "N", count: "N", finite: "X", non_negative: "X", share: "SHARE",
    pose: "X,Y[,YAW]", names: "A,B", poses: "A,B", counts: "N,N", deadlines: "S,S",
}  # fmt: skip


def option(
    name: str, help: str, type: Callable[[str], Any] | None = None, metavar: str = "", **more: Any
) -> Option:
    """A positional argument, or an option if the name begins with `--`; help names the default."""
    default = more.get("default")
    if default is not None and default != []:
        text = ",".join(map(str, default)) if isinstance(default, list) else f"{default}"
        help += f" (default {text.removesuffix('.0')})"
    if "choices" not in more and more.get("action", "append") == "append":
        more["metavar"] = metavar or (METAVARS[type] if name.startswith("-") else name)
    return Option(name, {"help": help} | ({"type": type} if type else {}) | more)


def flag(name: str, help: str) -> Option:
    """An option without a value, False where it is not given."""
    return Option(name, {"help": help, "action": "store_true"})


def seed(of: str = "the episode") -> Option:
    """The option `--seed`."""
    return option("--seed", f"seed of {of}", parse_int, default=0)


def record(metavar: str, what: str) -> list[Option]:
    """Options that record a run or show it to viewers, see `agents.watch.Watch`."""
    return [
        option("--record", f"write {what}, as MCAP", metavar=metavar),
        option("--format", "of the recording: Foxglove's messages in one file, or a ROS 2 bag, "
               "which is a folder", choices=("foxglove", "ros2"), default="foxglove"),
        option("--live", "serve Foxglove's viewers in real time, on this port (8765 if none is "
               "given)", parse_int, "PORT", nargs="?", const=8765),
        option("--images", "rate of rendered pictures in the recording [Hz]; 0: none",
               non_negative, default=0.0),
        option("--when-full", "what to do when the disk is full: go on without recording, or end",
               choices=("go-on", "end"), default="go-on"),
    ]  # fmt: skip


JSON = option("--json", "write the result as JSON to this file; - is standard output", None, "FILE")
QUIET = flag("--quiet", "show no progress bar")
CONFIG = option("--config", "settings of the environment, as in configs/env.json", None,
                "FILE.json")  # fmt: skip
POSE = option(
    "--pose", f"source of the estimated pose (default: the config's, or {DEFAULT_POSE})",
    choices=POSES,
)  # fmt: skip
SHIELD = option(
    "--shield", "filter commands by the shield (default: on, with the config's settings if any)",
    choices=("on", "off"),
)  # fmt: skip
CHAIR = ("a real chair: hardware, ros2://HOST:PORT, ros://HOST:PORT, or FILE.json:NAME as in "
         "configs/chairs.json")  # fmt: skip
MAP_FILES = ("map_server .yaml, MovingAI .map, HouseExpo .json, polygons .json, or an image of a "
             "floor plan with --resolution")  # fmt: skip
RESOLUTION = option("--resolution", "edge of a pixel of an image [m]", finite, "M")
UNKNOWN = option(
    "--unknown",
    "unknown cells of the map (default: blocked; on a map that the chair "
    "draws itself, --pose slam, they are always free)",
    choices=("blocked", "free"),
)


def map_options(kind: Callable[[str], Any] | None = None) -> list[Option]:
    """The options `--map`, of one file or several, and those that say more about the map."""
    metavar = "FILE" if kind is None else "FILE,FILE"
    return [
        option("--map", f"drive on a map of your own: {MAP_FILES}", kind, metavar), RESOLUTION,
        UNKNOWN,
        option("--start", "start on that map [m, m, rad] (default: drawn by the seed)", pose),
        option("--goal", "goal on that map [m, m, rad] (default: drawn by the seed)", pose),
    ]  # fmt: skip


OTHERS = "FILE.json:NAME, module:Class"
RECORD = record("FILE.mcap", "observations and commands")
WORKERS = option("--jobs", "number of worker processes (default: one a core)", count)
HARDWARE_CONFIG = option("--config", f"settings of the chair, as in {CHAIR_CONFIG}", None,
                         "FILE.json", required=True)  # fmt: skip
SECONDS = option("--seconds", "stop after this time [s] (default: at Ctrl-C)", finite)
VIDEO = option("--video", "write a video (.mp4)", None, "FILE")
END_PICTURE = option("--picture", "draw the end of the episode with the trail (.png)", None, "FILE")
WINDOW = flag("--window", "show a live view")
POLICY_HELP = "policy: PLANNER+FOLLOWER, random, a file of weights, ..."
