"""Policies, their evaluation and comparison, and the command line."""

from importlib.resources import files
from typing import Any

import yaml


class StoppedError(Exception):
    """Ctrl-C stopped runs; those that were finished are stored."""


def is_interrupt(error: BaseException) -> bool:
    """Whether an exception is Ctrl-C, or what a compiled function makes of it."""
    if isinstance(error, SystemError):  # 'returned a result with an exception set'
        return isinstance(error.__cause__ or error.__context__, KeyboardInterrupt)
    return isinstance(error, KeyboardInterrupt)


def read_data(name: str) -> Any:
    """The content of a YAML file of agents/data."""
    return yaml.safe_load((files("agents") / "data" / name).read_text("utf-8"))
