"""Problems with known optima, and a clock for deadlines that no machine's speed changes."""

import sys

import pytest

from planners.problem_files import read_problems
from tests.planners.make_problems import FILE

TICK = 0.005  # s: what each look at the clock takes


class Clock:
    """Time that passes only while somebody looks."""

    def __init__(self) -> None:
        self.now = 0.0

    def __call__(self) -> float:
        self.now += TICK
        return self.now


@pytest.fixture(scope="session")
def stored():
    """Name -> problem and optimum [m], of the file that lies here."""
    return {problem.name: (problem, optimum) for problem, optimum in read_problems(FILE)}


@pytest.fixture
def clock(monkeypatch):
    ticking = Clock()
    for name, module in list(sys.modules.items()):
        if name.startswith("planners") and hasattr(module, "clock"):
            monkeypatch.setattr(module, "clock", ticking)
    return ticking
