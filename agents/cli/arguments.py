"""Settings, environments, recordings and output from the arguments of commands."""

import argparse
import json
import sys
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from agents.cli.options import DEFAULT_POSE
from agents.evaluation.provenance import command_line, write_json
from agents.evaluation.tables import json_value
from agents.watch import Watch
from planners.rrt_star_woa.thesis import is_thesis, read_thesis, without_trailing_commas
from wheelchair_gym.base.errors import shorten
from wheelchair_gym.base.files import parse_json, read_text
from wheelchair_gym.base.settings import InputError, read_json, value_of, with_values


def spec(text: str) -> str | dict[str, Any]:
    """The name NAME or module:Class, or the settings called NAME in a file, for FILE.json:NAME.

    A file in the format of the thesis (figure 3.1) holds the settings of its planners.

    Raises:
        InputError: the file cannot be read, or has no object of settings under that name.
    """
    file, colon, name = text.rpartition(":")
    if not colon or not Path(file).suffix:
        return text
    is_module = all(part.isidentifier() for part in file.split("."))
    if is_module and Path(file).suffix not in (".json", ".py") and not Path(file).exists():
        return text  # of a package: package.module:Class
    if Path(file).suffix == ".py":
        path = Path(file)
        raise InputError(
            f"{text}: a class is named by its module, not its file: write {path.stem}:{name}, in "
            f"the folder of {path.name}"
        )
    content = parse_json(without_trailing_commas(read_text(file, "json")), file)
    if is_thesis(content):
        return read_thesis(file).planner(name)
    if not isinstance(content, Mapping) or not isinstance(content.get(name), Mapping):
        known = shorten(", ".join(content))[1:-1] if isinstance(content, Mapping) else ""
        raise InputError(f"{file}: no settings under {name!r}; known: {known or 'none'}")
    return {"name": name, **content[name]}  # the file may know it under another name


def labelled(name: str) -> str | dict[str, Any]:
    """As `spec`; settings from a file get the label FILE.json:NAME."""
    found = spec(name)
    return found if isinstance(found, str) else {**found, "label": Path(name).name}


def refuse(given: argparse.Namespace, names: Iterable[str], why: str) -> None:
    """Refuse options that would be ignored.

    Raises:
        InputError: one of them was given.
    """
    for name in names:
        if getattr(given, name) != given.parser.get_default(name):
            raise InputError(f"--{name.replace('_', '-')}: {why}")


def map_scenes(given: argparse.Namespace) -> list[dict[str, Any]]:
    """Scenes for the maps of --map, by the options that say more about them; none without --map.

    Raises:
        InputError: an option needs --map, or a pose has no heading where it needs one.
    """
    if not given.map:
        refuse(given, ("resolution", "unknown", "start", "goal"), "expected with --map")
        return []
    given_ends = {key: getattr(given, key) for key in ("start", "goal")}
    ends = {key: [*pose, 0.0][:3] for key, pose in given_ends.items() if pose is not None}
    scale = {} if given.resolution is None else {"resolution": given.resolution}
    if given.unknown == "free":
        scale["unknown_is_solid"] = False
    files = [given.map] if isinstance(given.map, str) else given.map
    scene = {"name": "map_file", **scale, **ends}
    return [{**scene, "path": file, "label": Path(file).stem} for file in files]


def scene_of(given: argparse.Namespace, default: Any = "floor_plan") -> Any:
    """Return the scene of --scene or of --map.

    Raises:
        InputError: both are given, or an option needs --map.
    """
    maps = map_scenes(given)
    if maps and given.scene is not None:
        raise InputError("--map and --scene: expected one of them")
    if maps:
        return maps[0]
    return default if given.scene is None else spec(given.scene)


def check_assist(given: argparse.Namespace) -> None:
    """Refuse --assist without --driver.

    Raises:
        InputError: nobody holds the stick.
    """
    if given.assist is not None and given.driver is None:
        raise InputError("--assist needs --driver: a person whose stick is assisted")


def chair_spec(text: str) -> Any:
    """A real chair: as `spec`, or an address such as ros://HOST:PORT."""
    return text if "://" in text else spec(text)


def changed(settings: str | Mapping[str, Any], changes: Sequence[str]) -> dict[str, Any]:
    """Settings with changes such as `iterations=30000` or `tree.step=2.0`.

    Raises:
        InputError: a change is not KEY=VALUE, or its key leads into what has no keys.
    """
    found: dict[str, Any] = {"name": settings} if isinstance(settings, str) else {**settings}
    for change in changes:
        key, equals, value = change.partition("=")
        if not (key and equals):
            raise InputError(f"--set {change}: expected KEY=VALUE")
        try:
            found = with_values(found, {key: value_of(value)})
        except InputError as error:
            raise InputError(f"--set {error}") from None
    return found


def shield_of(given: argparse.Namespace) -> bool | None:
    """The environment's shield by --shield; None leaves it to the config."""
    if given.shield is not None:
        return bool(given.shield == "on")
    if given.config is not None:
        content = read_json(given.config)
        if isinstance(content, Mapping) and content.get("shield") is not None:
            return None
    return True


def env_of(given: argparse.Namespace) -> dict[str, Any]:
    """Settings of an environment by --config, --pose and --shield."""
    from agents.evaluation.evaluate import env_settings

    source = DEFAULT_POSE if given.pose is None and given.config is None else given.pose
    shield = shield_of(given)
    return env_settings(pose_source=source, config=given.config, model=given.model, shield=shield)


def watch(given: argparse.Namespace) -> Watch:
    """Recording and live viewers by --record, --format, --live, --images and --when-full.

    Raises:
        InputError: an option needs --record, or a viewer.
    """
    if given.record is None:
        refuse(given, ("format", "when_full"), "expected with --record")
    if given.record is None and given.live is None:
        refuse(given, ("images",), "expected with --record or --live")
    return Watch(given.record, given.live, given.images, given.when_full, given.format)


def check_picture(file: str | None) -> None:
    """Refuse a picture that is not PNG.

    Raises:
        InputError: its name ends otherwise.
    """
    if file and Path(file).suffix.lower() != ".png":
        raise InputError(f"{file}: expected a name that ends with .png")


def report(given: argparse.Namespace, value: Any, text: str) -> None:
    """Print a result as text, or write it as JSON where --json was given."""
    value = json_value(value)
    if given.json == "-":
        print(json.dumps(value, indent=1, allow_nan=False))
        return
    if given.json:
        write_json(given.json, value)
    print(text)


def stopped(error: object, more: str = "") -> int:
    """Say how to resume a command that was stopped, with more options; the exit code."""
    again = f"{command_line()}{more}"
    print(f"wheelchair: stopped; {error}; resume with: {again}", file=sys.stderr)
    return 130


def real_chair_env(chair: Any, settings: Mapping[str, Any], **more: Any) -> tuple[Any, Any]:
    """An environment with a shield over a real chair, and the chair itself.

    From now on SIGTERM and SIGHUP end this program as Ctrl-C does, so that the chair stops, and a
    person at the terminal can re-arm it.

    `chair` is for `make_chair`; `settings` and `more` are arguments of the environment.

    Raises:
        InputError: the settings are wrong, or no chair answers.
    """
    from agents.deploy import end_as_by_ctrl_c, listen_for_rearm
    from wheelchair_gym.envs import NavigationEnv
    from wheelchair_gym.envs.settings import env_settings
    from wheelchair_gym.hardware.registry import make_chair

    end_as_by_ctrl_c()
    config = env_settings(**{"config": None, **settings})
    made: Any = make_chair(chair, config)
    try:
        shield: Any = config.shield or True  # a real chair always has one
        env = NavigationEnv(chair=made, **{**settings, **more, "shield": shield})
        listen_for_rearm(made, env.shield)
        return env, made
    except BaseException:
        made.close()
        raise
