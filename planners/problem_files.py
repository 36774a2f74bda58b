"""Problem files: JSON lists of rectangle maps, each with a start, a goal and an optimum."""

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from planners.collision.space import Space
from planners.problem import Problem
from wheelchair_gym.base.errors import InputError, shorten
from wheelchair_gym.base.files import LIMITS, read_json
from wheelchair_gym.base.settings import FARTHEST, load, setting, settings


@settings
class StoredProblem:
    """A problem as a file has it."""

    name: str
    size: float = setting(default=1.0, unit="m", low=1e-9, high=FARTHEST, source="required")
    """Side of the square map."""
    rects: tuple[tuple[float, float, float, float], ...] = setting(default=(), source="required")
    """Obstacles: x0, y0, x1, y1 [m] each."""
    start: tuple[float, float] = setting(
        default=(0.0, 0.0), unit="m", low=-FARTHEST, high=FARTHEST, source="required"
    )
    """Start."""
    goal: tuple[float, float] = setting(
        default=(0.0, 0.0), unit="m", low=-FARTHEST, high=FARTHEST, source="required"
    )
    """Goal."""
    optimum: float | None = setting(
        default=None, unit="m", low=0.0, high=FARTHEST, source="null: unknown"
    )
    """Length of the shortest path."""


def _problem(data: Any, where: str) -> tuple[Problem, float | None]:
    *required, optional = (field.name for field in dataclasses.fields(StoredProblem))
    for key in required:
        if isinstance(data, Mapping) and key not in data:
            keys = f"{', '.join(required)}, and may have {optional}"
            raise InputError(f"{where}.{key} is missing; a problem has {keys}")
    stored = load(StoredProblem, data, where)
    if len(stored.rects) > LIMITS["outline"].maximum:
        expected = f"expected at most {LIMITS['outline'].maximum:,}"
        raise InputError(f"{where}.rects has {len(stored.rects):,} rectangles; {expected}")
    for index, (x0, y0, x1, y1) in enumerate(stored.rects):
        if not (-FARTHEST <= x0 < x1 <= FARTHEST and -FARTHEST <= y0 < y1 <= FARTHEST):
            value = shorten(data["rects"][index])
            expected = f"expected x0 < x1 and y0 < y1, at most {FARTHEST:,.0f} m from 0"
            raise InputError(f"{where}.rects[{index}] is {value}; {expected}")
    space = Space.from_rectangles(stored.rects, (0.0, 0.0, stored.size, stored.size))
    start, goal = np.array(stored.start), np.array(stored.goal)
    return Problem(space, start, goal, name=stored.name), stored.optimum


def read_problems(path: str | Path) -> list[tuple[Problem, float | None]]:
    """Return the problems of a file, each with its known optimum [m] or None.

    Raises:
        InputError: the file cannot be read, or a problem's key is missing, unknown or wrong.
    """
    path = Path(path)
    data = read_json(path)
    if not isinstance(data, list):
        raise InputError(f"{path.name}: expected a list of problems, got {type(data).__name__}")
    return [_problem(item, f"{path.name}: problem [{index}]") for index, item in enumerate(data)]
