"""The table of commands, agents/data/commands.toml: name, function, help and options of each.

Nothing here imports more than the standard library, so that `--help` answers at once; the function
of a command is imported when the command runs.
"""

from __future__ import annotations

import argparse
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from importlib.resources import files
from types import MappingProxyType
from typing import Any, NamedTuple

from agents.cli import options

_TABLE = tomllib.loads((files("agents") / "data" / "commands.toml").read_text("utf-8"))
_WORDS = {
    **_TABLE["words"],
    "DEFAULT_POSE": options.DEFAULT_POSE,
    "POSES": ", ".join(options.POSES),
}


class Option(NamedTuple):
    """An argument of `argparse.ArgumentParser.add_argument`."""

    name: str
    arguments: dict[str, Any]


class OneOf(NamedTuple):
    """Options of which at most one may be given, or exactly one."""

    options: Sequence[Option]
    required: bool = False


class Command(NamedTuple):
    """A command, or a subcommand such as `bench env`."""

    name: str
    run: str  # module:function, which takes the parsed arguments and returns the exit code
    help: str
    description: str
    example: str
    options: Sequence[Option | OneOf]
    environ: Mapping[str, str] = MappingProxyType({})  # set before it runs


def _options(rows: Sequence[str | dict[str, Any]]) -> Iterator[Option | OneOf]:
    """The options of rows: the name of shared ones, or a table of an option's own."""
    for row in rows:
        if isinstance(row, str):
            yield from _options(_TABLE["shared"][row])
        elif "one_of" in row:
            parts = [part for part in _options(row["one_of"]) if isinstance(part, Option)]
            yield OneOf(parts, row.get("required", False))
        elif "seed" in row:
            yield _option(f"seed of {row['seed']}", "--seed", type="parse_int", default=0)
        else:
            yield _option(**row)


def _option(
    help: str, name: str = "", flag: str = "", type: str = "", between: Sequence[Any] = (),
    metavar: str = "", **more: Any,
) -> Option:  # fmt: skip
    """A positional argument, or an option if the name begins with `--`; help names the default."""
    help = help.format(**_WORDS)
    if flag:
        return Option(flag, {"help": help, "action": "store_true"})
    parse = getattr(options, type) if type else None
    if between:
        parse = options.number({"int": int, "float": float}[between[0]], *between[1:])
    if more.get("action") == "boolean":
        more["action"] = argparse.BooleanOptionalAction
    if isinstance(more.get("choices"), str):
        more["choices"] = getattr(options, more["choices"])
    default = more.get("default")
    if default is not None and default != []:
        text = ",".join(map(str, default)) if isinstance(default, list) else f"{default}"
        help += f" (default {text.removesuffix('.0')})"
    if "choices" not in more and more.get("action", "append") == "append":
        more["metavar"] = metavar or (options.METAVARS[parse] if name.startswith("-") else name)
    return Option(name, {"help": help} | ({"type": parse} if parse else {}) | more)


def _command(**row: Any) -> Command:
    """A command as the table has it."""
    row["options"] = list(_options(row["options"]))
    row["example"] = row["example"].format(**_WORDS)
    return Command(**row)


GROUPS = {
    name: (group["help"], group["example"].format(**_WORDS))
    for name, group in _TABLE["groups"].items()
}
COMMANDS = tuple(_command(**row) for row in _TABLE["commands"])
