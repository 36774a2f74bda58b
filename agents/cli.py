"""The command `wheelchair`: reads what a person typed, and answers errors in one line.

Every subcommand lives in `agents/commands` and imports what it needs only when it runs.
Exit codes: 0 done, 1 the world has no answer (no path), 2 what was asked is wrong, 130 stopped.
"""

from __future__ import annotations

import argparse
import os
import re
import sys
from collections.abc import Mapping, Sequence
from typing import NoReturn

from agents.commands import (
    bench,
    compare,
    deploy,
    export,
    hardware,
    inspect,
    map,
    plan,
    replay,
    scenes,
    settings,
    simulate,
    study,
    train,
    tune,
    twin,
)
from agents.interrupt import by_hand

COMMANDS = (
    plan, simulate, replay, compare, study, tune, map, train, export, inspect, scenes, settings,
    bench, twin, deploy, hardware,
)  # fmt: skip


class Parser(argparse.ArgumentParser):
    """An argument parser whose errors are one line."""

    def error(self, message: str) -> NoReturn:
        """Print the error in one line and leave with code 2."""
        self.exit(2, f"wheelchair: {message} (see {self.prog} --help)\n")


def parser() -> Parser:
    """The parser of the whole command."""
    whole = Parser(
        prog="wheelchair",
        description="Simulate, plan for and compare policies of a robotic wheelchair.",
        epilog="example: wheelchair simulate --policy a_star+window --seed 3 --video drive.mp4",
    )
    parts = whole.add_subparsers(dest="command", required=True, metavar="COMMAND")
    for command in COMMANDS:
        command.add(parts)
    return whole


def _joined(arguments: Sequence[str]) -> list[str]:
    """`--start -1,2` as `--start=-1,2`, which argparse would take for an option."""
    joined: list[str] = []
    for argument in arguments:
        if joined and joined[-1] in ("--start", "--goal") and re.match(r"-[\d.in]", argument):
            joined[-1] += f"={argument}"
        else:
            joined.append(argument)
    return joined


def _start_anew(wanted: Mapping[str, str]) -> None:
    """Run this program again in an environment that libraries read only once, when loaded."""
    missing = {name: value for name, value in wanted.items() if name not in os.environ}
    if missing and sys.platform == "linux":
        os.execve(sys.executable, [sys.executable, *sys.orig_argv[1:]], {**os.environ, **missing})


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; the exit code."""
    given = parser().parse_args(_joined(sys.argv[1:] if arguments is None else arguments))
    if arguments is None:
        _start_anew(getattr(given, "environ", {}))
    from wheelchair_gym.config import InputError  # not before: --help is to answer at once

    try:
        code: int = given.run(given)
        sys.stdout.flush()
    except InputError as error:
        print("wheelchair: " + " ".join(str(error).split()), file=sys.stderr)
        return 2
    except (KeyboardInterrupt, SystemError) as error:
        if not by_hand(error):
            raise
        print("wheelchair: stopped", file=sys.stderr)
        return 130
    except BrokenPipeError:  # the reader has gone: nothing more to say
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 141
    except ConnectionError as error:  # to a real chair
        print("wheelchair: " + " ".join(str(error).split()), file=sys.stderr)
        return 1
    return code


if __name__ == "__main__":
    sys.exit(main())
