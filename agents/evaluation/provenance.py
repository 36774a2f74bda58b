"""Origin of a result: command, code, machine and versions; and atomic writing of files."""

import importlib.metadata
import json
import os
import platform
import re
import shlex
import subprocess
import sys
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from wheelchair_gym.base.files import atomic_write

PACKAGES = (
    "wheelchair_gym", "numpy", "numba", "gymnasium", "pymunk", "scipy", "shapely",
    "stable-baselines3", "torch",
)  # fmt: skip
TREES = ("wheelchair_gym", "planners", "agents", "configs")  # of code that figures depend on


def git(*arguments: str) -> str | None:
    """Output of git for this checkout; None outside a repository, or where git fails.

    An installed copy may lie in the repository of another project, which does not track it.
    """
    own = Path(__file__).resolve()
    with suppress(OSError, subprocess.SubprocessError):
        for asked in (("ls-files", "--error-unmatch", own), arguments):
            ran = subprocess.run(
                ["git", *asked], cwd=own.parents[2], capture_output=True, text=True, timeout=10,
                check=True,
            )  # fmt: skip
        return ran.stdout.strip()
    return None


def commit() -> str | None:
    """The code's git commit, with `+` if its files differ from it; None outside a repository."""
    head = git("rev-parse", "--short=12", "HEAD")
    changed = git("status", "-s", "-uno", "--", *TREES)
    return None if head is None or changed is None else head + ("+" if changed else "")


def machine() -> dict[str, Any]:
    """Processor, cores that may be used, and operating system."""
    cpu = platform.processor() or platform.machine()
    with suppress(OSError):  # where it is not Linux
        if found := re.search(r"^model name\s*:(.*)$", Path("/proc/cpuinfo").read_text(), re.M):
            cpu = found[1].strip()
    return {"cpu": cpu, "cores": cores(), "system": f"{platform.system()} {platform.release()}"}


def cores() -> int:
    """Cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def versions() -> dict[str, str]:
    """Versions of Python and of the packages that results depend on."""
    found = {"python": platform.python_version()}
    for name in PACKAGES:
        with suppress(importlib.metadata.PackageNotFoundError):
            found[name] = importlib.metadata.version(name)
    return found


def provenance(**more: Any) -> dict[str, Any]:
    """The code's commit, git's names of its trees, the machine (and more of it), and versions."""
    trees = {name: git("rev-parse", "--short=12", f"HEAD:{name}") for name in TREES}
    more = machine() | more
    return {"commit": commit(), "trees": trees, "machine": more, "versions": versions()}


def now() -> str:
    """The time, in UTC, as ISO 8601."""
    return datetime.now(UTC).isoformat(timespec="seconds")


def command_line() -> str:
    """The command that a person typed, as a shell takes it."""
    name = Path(sys.argv[0]).name
    # python -m wheelchair_gym is the same program
    return shlex.join(["wheelchair" if name == "__main__.py" else name, *sys.argv[1:]])


def without_outputs(command: str) -> str:
    """A command without where it wrote to and how many processes it took."""
    return re.sub(r" --(out|jobs|json) \S+| --(no-video|quiet)", "", command)


def write_text(path: str | Path, text: str) -> None:
    """Write a file atomically.

    Raises:
        InputError: it cannot be written.
    """
    with atomic_write(path) as part:
        part.write_text(text, encoding="utf-8")


def write_json(path: str | Path, value: Any) -> None:
    """Write JSON atomically; a value that is infinite or NaN raises ValueError."""
    write_text(path, json.dumps(value, indent=1, allow_nan=False) + "\n")
