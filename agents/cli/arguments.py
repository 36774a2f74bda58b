"""Arguments, output and the real chair's environment, as several subcommands share them."""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from agents.watch import Watch

POSES = ("truth", "odometry", "modelled", "mcl", "slam")
POSE = "modelled"


def whole(text: str, least: int = 0) -> int:
    """A whole number of at least 0."""
    try:
        value = int(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is not a whole number") from None
    if value < least:
        raise argparse.ArgumentTypeError(f"{value} is too few; expected at least {least}")
    return value


def count(text: str) -> int:
    """A whole number of at least 1."""
    return whole(text, least=1)


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
        raise argparse.ArgumentTypeError(f"{text} is negative; expected at least 0")
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


def spec(text: str) -> str | dict[str, Any]:
    """What a person names: NAME, or FILE.json:NAME with the settings of that name in a file.

    A file of the thesis's own kind (its figure 3.1) holds the settings of its planners.

    Raises:
        InputError: the file cannot be read, or has no object of settings under that name.
    """
    from planners.thesis_settings import is_thesis, read_thesis, without_trailing_commas
    from wheelchair_gym.errors import InputError, shown
    from wheelchair_gym.files import parse_json, read_text

    file, colon, name = text.rpartition(":")
    if not colon:
        return text
    content = parse_json(without_trailing_commas(read_text(file, "json")), file)
    if is_thesis(content):
        return read_thesis(file).planner(name)
    if not isinstance(content, Mapping) or not isinstance(content.get(name), Mapping):
        known = shown(", ".join(content))[1:-1] if isinstance(content, Mapping) else ""
        raise InputError(f"{file}: no settings under {name!r}; known: {known or 'none'}")
    return {"name": name, **content[name]}  # the file may know it under another name


def changed(settings: str | Mapping[str, Any], changes: Sequence[str]) -> dict[str, Any]:
    """What a person names, with changes such as `iterations=30000` or `tree.step=2.0`.

    Raises:
        InputError: a change is not KEY=VALUE, or its key leads into what has no keys.
    """
    from wheelchair_gym.config import InputError, value_of, with_values

    whole: dict[str, Any] = {"name": settings} if isinstance(settings, str) else {**settings}
    for change in changes:
        key, equals, value = change.partition("=")
        if not (key and equals):
            raise InputError(f"--set {change}: expected KEY=VALUE")
        try:
            whole = with_values(whole, {key: value_of(value)})
        except InputError as error:
            raise InputError(f"--set {error}") from None
    return whole


def add_env(parser: argparse.ArgumentParser) -> None:
    """The options `--config FILE.json` and `--pose SOURCE`."""
    parser.add_argument("--config", metavar="FILE.json", help="settings, as in configs/env.json")
    parser.add_argument(
        "--pose", choices=POSES,
        help=f"the chair's own estimate (default: the config's, or {POSE} without one)",
    )  # fmt: skip


def add_shield(parser: argparse.ArgumentParser) -> None:
    """The option `--shield on|off`."""
    parser.add_argument(
        "--shield", choices=("on", "off"),
        help="only what the shield lets through is driven (default: on, or the config's settings)",
    )  # fmt: skip


def shield_of(given: argparse.Namespace) -> bool | None:
    """What that option says of the environment's shield; None leaves it to the config's own."""
    if given.shield is not None:
        return bool(given.shield == "on")
    if given.config is not None:
        from wheelchair_gym.config import read_json

        content = read_json(given.config)
        if isinstance(content, Mapping) and content.get("shield") is not None:
            return None
    return True


def add_watch(parser: argparse.ArgumentParser, record: str = "FILE.mcap") -> None:
    """The options `--record`, `--live` and `--images`, see `agents.watch.Watch`."""
    what = "one file an episode" if record == "FOLDER" else "what the chair was told and did"
    parser.add_argument("--record", metavar=record, help=f"write {what}, as MCAP")
    parser.add_argument(
        "--live", metavar="PORT", type=whole, nargs="?", const=8765,
        help="in real time, for Foxglove's viewers to join on this port (8765)",
    )  # fmt: skip
    parser.add_argument(
        "--images", metavar="HZ", type=distance, default=0.0,
        help="rendered pictures for viewers, so many a second (default none)",
    )  # fmt: skip
    parser.add_argument(
        "--when-full", choices=("go-on", "end"), default="go-on",
        help="the run, when the disk of the recording is full (default go-on)",
    )  # fmt: skip


def add_workers(parser: argparse.ArgumentParser) -> None:
    """The options `--jobs` and `--engine`."""
    parser.add_argument("--jobs", type=count, metavar="N", help="worker processes (default: cores)")
    parser.add_argument(
        "--engine", default="loky", metavar="NAME",
        help="what runs them: loky (default), or ray, on the cluster at RAY_ADDRESS or here",
    )  # fmt: skip


def watch(given: argparse.Namespace) -> Watch:
    """Who looks on, as those options say."""
    from agents.watch import Watch

    return Watch(given.record, given.live, given.images, given.when_full)


def add_json(parser: argparse.ArgumentParser) -> None:
    """The option `--json FILE`."""
    parser.add_argument(
        "--json", metavar="FILE", help="write the result as JSON; - is stdout, with nothing else"
    )


def report(given: argparse.Namespace, value: Any, text: str) -> None:
    """Give a result to the person: text on stdout, or JSON where it was asked for."""
    from agents.evaluation.provenance import write_json

    if given.json == "-":
        print(json.dumps(value, indent=1, allow_nan=False))
        return
    if given.json:
        write_json(given.json, value)
    print(text)


def drive_real(named: Any, settings: Mapping[str, Any], **more: Any) -> tuple[Any, Any]:
    """An environment with a shield over a real chair, and the chair itself.

    From now on SIGTERM and SIGHUP end this program as Ctrl-C does, so that the chair is told to
    stop, and a person at the terminal re-arms it.

    Args:
        named: the chair, as `make_chair` takes it.
        settings: of the environment, as `agents.evaluation.evaluate.env_settings` gives them.
        more: further arguments of the environment.

    Raises:
        InputError: the spec is wrong, or nothing answers there.
    """
    from agents.deploy import ended_as_by_hand, hear_person
    from wheelchair_gym.envs import NavigationEnv
    from wheelchair_gym.envs.settings import env_settings
    from wheelchair_gym.hardware.registry import make_chair

    ended_as_by_hand()
    own = env_settings(**{"config": None, **settings})
    chair: Any = make_chair(named, own)
    try:
        shield: Any = own.shield or True  # nobody is driven without one
        env = NavigationEnv(chair=chair, **{**settings, **more, "shield": shield})
        hear_person(chair, env.shield)
        return env, chair
    except BaseException:
        chair.close()
        raise
