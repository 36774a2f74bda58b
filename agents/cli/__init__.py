"""The command `wheelchair`: reads what a person typed, and answers errors in one line.

Every subcommand is a module of `agents/cli` and imports what it needs only when it runs.
Exit codes: 0 done, 1 the world has no answer (no path), 2 what was asked is wrong, 130 stopped.
"""

from __future__ import annotations

import argparse
import io
import os
import re
import sys
from collections.abc import Mapping, Sequence
from typing import Any, NoReturn

from agents.cli import (
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


MOST_SAID = 1000  # characters of an error


class Parser(argparse.ArgumentParser):
    """An argument parser whose errors are one line."""

    def error(self, message: str) -> NoReturn:
        """Print the error in one line and leave with code 2."""
        self.exit(2, f"wheelchair: {message} (see {self.prog} --help)\n")

    def _print_message(self, message: str, file: Any = None) -> None:
        # As argparse does it, but what cannot be written is not passed over.
        if message:
            (file or sys.stderr).write(message)


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
    _stand_in()
    try:
        try:
            given = parser().parse_args(_joined(sys.argv[1:] if arguments is None else arguments))
            if arguments is None:
                _start_anew(getattr(given, "environ", {}))
            code: int = given.run(given)
        finally:  # also after --help, which leaves by an exception
            sys.stdout.flush()
    except MemoryError as error:
        _say(f"not enough memory ({error})" if str(error) else "not enough memory")
        return 2
    except (KeyboardInterrupt, SystemError) as error:
        if not by_hand(error):
            raise
        _say("stopped")
        return 130
    except BrokenPipeError:  # the reader has gone: nothing more to say
        _drop_output()
        return 141
    except ConnectionError as error:  # to a real chair
        _say(error)
        return 1
    except OSError as error:  # a full disk, or standard output that is full or closed
        if error.errno is None:
            _say(error)
        elif error.filename is not None:
            _say(f"{error.filename}: {error.strerror}")
        else:
            _say(f"standard output: cannot be written ({error.strerror})")
        _drop_output()
        return 2
    except ValueError as error:
        from wheelchair_gym.errors import InputError  # not before: --help is to answer at once

        if not isinstance(error, InputError):
            raise
        _say(error)
        return 2
    return code


def _stand_in() -> None:
    """Put something in place of standard streams that are closed, which no file may then take."""
    if sys.stdout is None:
        # Opened for reading: what is written to it is refused, as by a closed output.
        sys.stdout = io.TextIOWrapper(io.FileIO(os.open(os.devnull, os.O_RDONLY), "w"), "utf-8")
    if sys.stderr is None:
        sys.stderr = io.TextIOWrapper(io.FileIO(os.devnull, "w"), "utf-8")


def _say(what: object) -> None:
    """One line on standard error, of characters that a terminal shows, and not too many."""
    line = " ".join(str(what).split())
    line = "".join(c if c.isprintable() else "?" for c in line)
    if len(line) > MOST_SAID:
        line = f"{line[: MOST_SAID // 2]} ... {line[-MOST_SAID // 2 :]}"
    print(f"wheelchair: {line}", file=sys.stderr)


def _drop_output() -> None:
    """Send what is left of standard output nowhere, so that the end of the program succeeds."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
