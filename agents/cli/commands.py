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
from agents.cli.options import OneOf, Option, map_options, number, option, record, seed

# Shared lists of options, and words in help and examples.
_LISTS = {"MAP": map_options(), "MAPS": map_options(options.names), "RECORD": options.RECORD}
_WORDS = {
    **{name: getattr(options, name) for name in ("CHAIR", "CHAIR_CONFIG", "MAP_FILES", "OTHERS")},
    "POLICY_HELP": options.POLICY_HELP, "POSES": ", ".join(options.POSES),
}  # fmt: skip


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
    """The options of rows: the name of a shared one, or a table of an option's own."""
    for row in rows:
        if isinstance(row, str):
            yield from _LISTS[row] if row in _LISTS else [getattr(options, row)]
        elif "one_of" in row:
            parts = [part for part in _options(row["one_of"]) if isinstance(part, Option)]
            yield OneOf(parts, row.get("required", False))
        elif "seed" in row:
            yield seed(row["seed"])
        elif "record" in row:
            yield from record(*row["record"])
        else:
            yield _option(**row)


def _option(
    help: str, name: str = "", flag: str = "", type: str = "", between: Sequence[Any] = (),
    metavar: str = "", **more: Any,
) -> Option:  # fmt: skip
    """An option of its own."""
    help = help.format(**_WORDS)
    if flag:
        return options.flag(flag, help)
    parse = getattr(options, type) if type else None
    if between:
        parse = number({"int": int, "float": float}[between[0]], *between[1:])
    if more.get("action") == "boolean":
        more["action"] = argparse.BooleanOptionalAction
    if isinstance(more.get("choices"), str):
        more["choices"] = getattr(options, more["choices"])
    return option(name, help, parse, metavar, **more)


def _command(**row: Any) -> Command:
    """A command as the table has it."""
    row["options"] = list(_options(row["options"]))
    row["example"] = row["example"].format(**_WORDS)
    return Command(**row)


_TABLE = tomllib.loads((files("agents") / "data" / "commands.toml").read_text("utf-8"))
GROUPS = {
    name: (group["help"], group["example"].format(**_WORDS))
    for name, group in _TABLE["groups"].items()
}
COMMANDS = tuple(_command(**row) for row in _TABLE["commands"])
