"""A clock for deadlines that no machine's speed changes."""

from __future__ import annotations

import sys

import pytest

TICK = 0.005  # s: what each look at the clock takes


class Clock:
    """Time that passes only while somebody looks."""

    def __init__(self) -> None:
        self.now = 0.0

    def __call__(self) -> float:
        self.now += TICK
        return self.now


@pytest.fixture
def clock(monkeypatch):
    ticking = Clock()
    for name, module in list(sys.modules.items()):
        if name.startswith("planners") and hasattr(module, "clock"):
            monkeypatch.setattr(module, "clock", ticking)
    return ticking
