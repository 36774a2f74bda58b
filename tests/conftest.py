"""Fixtures for every test, and which files go first."""

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, settings

from wheelchair_gym.base.errors import InputError

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("wheelchair_gym", "planners", "agents")
# What tests build is kept in the clone: a HOME may be absent, or read-only.
for place in ("XDG_CACHE_HOME", "MPLCONFIGDIR", "JUPYTER_RUNTIME_DIR", "IPYTHONDIR"):
    os.environ.setdefault(place, str(ROOT / "build" / "cache"))
SHARED = Path(os.environ.get("WHEELCHAIR_SHARED", ROOT.parent / "shared"))
# Where nothing is compiled yet, a worker must not wait for what another compiles: one begins with
# the environment's kernels, the other with tests of no kernels, and goes on to the planners'.
# What takes long comes next, so that no worker has a long file to do when the other is ready.
FIRST = (
    "laws/test_copies", "agents/policies/test_planning",
    "test_compiling", "agents/evaluation/test_runs", "hardware/test_drive",
    "hardware/test_protocol", "hardware/test_link", "hardware/test_tools",
    "planners/test_random_maps", "planners/test_planners", "hardware/test_robot",
    "planners/test_lattice", "agents/evaluation/test_tuning", "agents/policies/test_unknown",
    "agents/cli/test_cli", "hardware/test_ros", "recording/test_record",
    "agents/learning/test_learning",
)  # fmt: skip


def long_but(names: Iterable[Any], short: Iterable[Any]) -> list[Any]:
    """Parameters of a test: a few of the names under `make test`, all under `make test-all`."""
    few, every = list(short), list(names)
    assert set(few) <= set(every)
    marks = [() if name in few else (pytest.mark.long,) for name in every]
    values = [name if isinstance(name, tuple) else (name,) for name in every]
    return [pytest.param(*value, marks=m) for value, m in zip(values, marks, strict=True)]


PATIENCE = 600.0  # s: a machine that is busy compiles and starts slowly


def until(true: Callable[[], Any], seconds: float = PATIENCE) -> Any:
    """Wait until a condition holds, or until no machine would be so slow; return its value."""
    end = time.monotonic() + seconds
    while not (value := true()) and time.monotonic() < end:
        time.sleep(0.01)
    return value


def run(*words: Any) -> Any:
    """The exit code of the command, whether the parser or the command gave it."""
    from agents.cli import main

    try:
        return main([str(word) for word in words])
    except SystemExit as left:
        return left.code


def refusal(words: list[Any], captured: Any) -> str:
    """Return the line in which the command refuses words: code 2, nothing else is said."""
    code = run(*words)
    said = captured.readouterr()
    (line,) = [line for line in said.err.splitlines() if not line.startswith("compiling")]
    assert (code, said.out, line.partition(": ")[0]) == (2, "", "wheelchair")
    return line


def output_of(words: list[Any], captured: Any) -> str:
    """Return what the command prints for words that it takes."""
    assert run(*words) == 0
    printed: str = captured.readouterr().out
    return printed


def json_of(words: list[Any], captured: Any) -> Any:
    """Return what the command prints as JSON for words that it takes."""
    return json.loads(output_of([*words, "--json", "-"], captured))


def put(path: Path, content: Any) -> Path:
    """Write a text, or anything else as JSON, to a file, and return its path."""
    path.write_text(content if isinstance(content, str) else json.dumps(content))
    return path


def modules() -> Iterator[tuple[str, Path]]:
    """Yield the dotted name and the file of each module of the project."""
    for package in PACKAGES:
        for path in sorted((ROOT / package).rglob("*.py")):
            yield ".".join(path.relative_to(ROOT).with_suffix("").parts), path


def python(code: str, *words: object) -> subprocess.CompletedProcess[str]:
    """Run a program of Python from the clone, with words as its arguments."""
    command = [sys.executable, "-c", code, *map(str, words)]
    return subprocess.run(
        command, cwd=ROOT, capture_output=True, text=True, check=False, timeout=600
    )


def at_start(env: Any, seed: Any = 0, **more: Any) -> Any:
    """Reset an environment with a seed; return it."""
    env.reset(seed=seed, **more)
    return env


def steps_of(env: Any, action: Any, maximum: int = sys.maxsize) -> Iterator[Any]:
    """Step with one action, at most to the end of the episode; yield what each step returns."""
    for _ in range(maximum):
        yield (told := env.step(action))
        if told[2] or told[3]:
            return


def need_pty():
    """A skip where the machine has no pseudo-terminals."""
    try:
        ends = os.openpty()
    except OSError as error:
        pytest.skip(f"needs a pseudo-terminal: {error}")
    for end in ends:
        os.close(end)


# No test fails because a machine is slow.
settings.register_profile("patient", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("patient")


def one_line(error: InputError, *words: object) -> None:
    """Every refusal that any test brings about is one line."""
    assert "\n" not in "".join(map(str, words)), words
    ValueError.__init__(error, *words)


InputError.__init__ = one_line


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Order the files of tests; each keeps its own order."""
    places = {ROOT / "tests" / f"{name}.py": k for k, name in enumerate(FIRST)}
    items.sort(key=lambda item: places.get(item.path, len(FIRST)))


@pytest.fixture
def served(tmp_path: Path) -> Iterator[Any]:
    """A twin behind devices, in real time."""
    from tests.hardware.realtime import serving

    with serving(tmp_path) as twin:
        yield twin


@pytest.fixture(scope="session")
def shared() -> Path:
    """The folder of maps, problems and logs that lies beside the project, or a skip."""
    if not SHARED.is_dir():
        pytest.skip(f"{SHARED} is absent; set WHEELCHAIR_SHARED to the folder of maps and problems")
    return SHARED
