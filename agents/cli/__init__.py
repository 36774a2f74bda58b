"""The command `wheelchair`: parses what was typed, runs a command, and prints errors in one line.

Commands stand in agents/data/commands.toml. Nothing here imports more than the standard library, so
that `--help` answers at once; the function of a command is imported when the command runs.

Exit codes: 0 done, 1 no result (such as no path), 2 wrong input, 130 stopped.
"""

import _thread
import argparse
import importlib
import io
import os
import re
import sys
import threading
import tomllib
import warnings
from collections.abc import Mapping, Sequence
from importlib.metadata import version
from importlib.resources import files
from types import MappingProxyType
from typing import Any, NamedTuple, NoReturn

from agents import StoppedError, is_interrupt
from agents.cli import options

_TABLE = tomllib.loads((files("agents") / "data" / "commands.toml").read_text("utf-8"))
_WORDS = {
    **_TABLE["words"],
    "DEFAULT_POSE": options.DEFAULT_POSE,
    "POSES": ", ".join(options.POSES),
}


Rows = Sequence[str | dict[str, Any]]  # names of shared options, or tables of a command's own


class Command(NamedTuple):
    """A command, or a subcommand such as `bench env`."""

    name: str
    run: str  # module:function, which takes the parsed arguments and returns the exit code
    help: str
    description: str
    example: str
    options: Rows
    environ: Mapping[str, str] = MappingProxyType({})  # set before it runs


def _add_options(parser: Any, rows: Rows) -> None:
    """Add the options of rows to a parser, or to a group of one."""
    for row in rows:
        if isinstance(row, str):
            _add_options(parser, _TABLE["shared"][row])
        elif "one_of" in row:  # at most one of these may be given, or exactly one
            group = parser.add_mutually_exclusive_group(required=row.get("required", False))
            _add_options(group, row["one_of"])
        elif "seed" in row:
            _add_option(parser, f"seed of {row['seed']}", "--seed", type="parse_int", default=0)
        else:
            _add_option(parser, **row)


def _add_option(
    parser: Any, help: str, name: str = "", flag: str = "", type: str = "",
    between: Sequence[Any] = (), metavar: str = "", **more: Any,
) -> None:  # fmt: skip
    """Add a positional argument, or an option if the name begins with `--`; help has the default.

    A flag has no value.
    """
    help = help.format(**_WORDS)
    if flag:
        parser.add_argument(flag, help=help, action="store_true")
        return
    parse = getattr(options, type) if type else None
    if between:
        parse = options.number({"int": int, "float": float}[between[0]], *between[1:])
    if more.get("action") == "boolean":
        more["action"] = argparse.BooleanOptionalAction
    if isinstance(more.get("choices"), str):
        more["choices"] = getattr(options, more["choices"])
    default = more.get("default")
    if default is not None and default != []:
        values = default if isinstance(default, list) else [default]
        text = ",".join(str(value) for value in values)  # here `map` is the command's module
        help += f" (default {text.removesuffix('.0')})"
    if "choices" not in more and more.get("action", "append") == "append":
        more["metavar"] = metavar or (options.METAVARS[parse] if name.startswith("-") else name)
    parser.add_argument(name, help=help, **({"type": parse} if parse else {}), **more)


GROUPS = {
    name: (group["help"], group["example"].format(**_WORDS))
    for name, group in _TABLE["groups"].items()
}
COMMANDS = tuple(
    Command(**row | {"example": row["example"].format(**_WORDS)}) for row in _TABLE["commands"]
)


LONGEST_ERROR = 1000  # characters


class Parser(argparse.ArgumentParser):
    """An argument parser whose errors are one line, with the nearest known name."""

    def __init__(self, *words: Any, **more: Any) -> None:
        super().__init__(*words, **more)
        self._negative_number_matcher = re.compile(r"-[\d.in]")  # such as in --start -1,2

    def error(self, message: str) -> NoReturn:
        """Print the error in one line and exit with code 2."""
        from wheelchair_gym.base.settings import suggest  # imported late, so that --help is fast

        if unknown := re.match(r".*invalid choice: '(.*?)' \(choose from (.*)\)", message):
            message += suggest(unknown[1], re.findall(r"[\w-]+", unknown[2]))
        self.exit(2, f"wheelchair: {message} (see {self.prog} --help)\n")

    def parse_all(self, arguments: Sequence[str]) -> argparse.Namespace:
        """The parsed arguments; an unknown option is an error of its command."""
        given, unknown = self.parse_known_args(arguments)
        if unknown:
            from wheelchair_gym.base.settings import suggest

            command: Parser = getattr(given, "parser", self)
            options = [name for action in command._actions for name in action.option_strings]
            near = suggest(unknown[0].partition("=")[0], options)
            command.error(f"unrecognized arguments: {' '.join(unknown)}{near}")
        return given

    def _print_message(self, message: str, file: Any = None) -> None:
        # As in argparse, but an error of writing is raised.
        if message:
            (file or sys.stderr).write(message)


class PrintCompletion(argparse.Action):
    """Prints a completion script of a shell, and exits."""

    def __call__(self, parser: argparse.ArgumentParser, _: Any, shell: Any, *__: Any) -> NoReturn:
        """Print and exit."""
        import shtab

        print(shtab.complete(parser, shell))
        parser.exit()


def parser() -> Parser:
    """The parser of all commands."""
    main = Parser(
        prog="wheelchair",
        description="Simulate, plan for and compare policies of a robotic wheelchair.",
        epilog="example: wheelchair simulate --policy a_star+window --seed 3 --video drive.mp4",
    )
    name = f"wheelchair {version('wheelchair_gym')}"
    main.add_argument("--version", action="version", version=name, help="print the version")
    main.add_argument(
        "--completion", action=PrintCompletion, choices=("bash", "zsh"),
        help="print a completion script of a shell",
    )  # fmt: skip
    parsers = main.add_subparsers(dest="command", required=True, metavar="COMMAND")
    groups: dict[str, Any] = {}
    for command in COMMANDS:
        group, _, name = command.name.rpartition(" ")
        if group and group not in groups:
            help, example = GROUPS[group]
            of_group = _add(parsers, group, help, "", example)
            groups[group] = of_group.add_subparsers(dest="part", required=True, metavar="COMMAND")
        parent = groups.get(group, parsers)
        one = _add(parent, name, command.help, command.description, command.example)
        _add_options(one, command.options)
        one.set_defaults(parser=one, row=command)
    return main


def _add(parsers: Any, name: str, help: str, description: str, example: str) -> Parser:
    added: Parser = parsers.add_parser(
        name, help=help, description=description or f"{help[0].upper()}{help[1:]}.",
        epilog=f"example: {example}",
    )  # fmt: skip
    return added


def run(given: argparse.Namespace) -> int:
    """Run the command that was parsed; the exit code."""
    command: Command = given.row
    if hasattr(given, "when_full"):  # what is wrong with these options is told at once
        importlib.import_module("agents.cli.arguments").watch(given)
    module, _, function = command.run.partition(":")
    code: int = getattr(importlib.import_module(f"agents.cli.{module}"), function)(given)
    return code


def _restart(environ: Mapping[str, str]) -> None:
    """Run this program again with environment variables that libraries read when they load."""
    missing = {name: value for name, value in environ.items() if name not in os.environ}
    if missing and sys.platform == "linux":
        os.execve(sys.executable, [sys.executable, *sys.orig_argv[1:]], {**os.environ, **missing})


def one_line_warning(message: Warning | str, category: type[Warning], *where: Any) -> str:
    """A warning about settings without the line of the source; others as Python writes them."""
    if category is UserWarning:
        return f"wheelchair: {message}\n"
    return _python_warning(message, category, *where)


_python_warning = warnings.formatwarning


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; the exit code."""
    _replace_closed_streams()
    if arguments is None:  # this process is the command
        _hear_lost_interrupts()
        warnings.formatwarning = one_line_warning  # type: ignore[assignment]
    try:
        try:
            typed = sys.argv[1:] if arguments is None else arguments
            if not typed or (len(typed) == 1 and typed[0] in GROUPS):  # a name that is not whole
                typed = [*typed, "--help"]
            given = parser().parse_all(typed)
            if arguments is None:
                _restart(given.row.environ)
            return run(given)
        finally:  # also after --help, which leaves by an exception
            sys.stdout.flush()
    except MemoryError as error:
        return _fail(f"not enough memory ({error})" if str(error) else "not enough memory")
    except StoppedError as error:
        from agents.cli.arguments import stopped

        return stopped(error)
    except (KeyboardInterrupt, SystemError) as error:
        if not is_interrupt(error):
            raise
        return _fail("stopped", 130)
    except BrokenPipeError:  # the reader of a pipe has ended
        _drop_output()
        return 141
    except ConnectionError as error:  # to a real chair
        return _fail(error, 1)
    except OSError as error:  # a full disk, or standard output that is full or closed
        if error.errno is None:
            what: object = error
        elif error.filename is not None:
            what = f"{error.filename}: {error.strerror}"
        else:
            what = f"standard output: cannot be written ({error.strerror})"
        _fail(what)
        _drop_output()
        return 2
    except ValueError as error:
        from wheelchair_gym.base.errors import InputError  # imported late, so that --help is fast

        if not isinstance(error, InputError):
            raise
        return _fail(error)


def _hear_lost_interrupts() -> None:
    """Raise Ctrl-C again where Python could not: in a function that C calls, or in a destructor."""
    report = sys.unraisablehook

    def hook(lost: Any) -> None:
        if lost.exc_type is KeyboardInterrupt:
            threading.Timer(0.05, _thread.interrupt_main).start()
        else:
            report(lost)

    sys.unraisablehook = hook


def _replace_closed_streams() -> None:
    """Open something in place of closed standard streams, so that no file gets their numbers."""
    if sys.stdout is None:
        # Opened for reading, so that writing fails, as with a closed output.
        sys.stdout = io.TextIOWrapper(io.FileIO(os.open(os.devnull, os.O_RDONLY), "w"), "utf-8")
    if sys.stderr is None:
        sys.stderr = io.TextIOWrapper(io.FileIO(os.devnull, "w"), "utf-8")


def _fail(what: object, code: int = 2) -> int:
    """Print one line of printable characters on standard error; the exit code."""
    line = " ".join(str(what).split())
    line = "".join(c if c.isprintable() else "?" for c in line)
    if len(line) > LONGEST_ERROR:
        line = f"{line[: LONGEST_ERROR // 2]} ... {line[-LONGEST_ERROR // 2 :]}"
    print(f"wheelchair: {line}", file=sys.stderr)
    return code


def _drop_output() -> None:
    """Redirect standard output to nowhere, so that flushing it at exit succeeds."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
