"""Problem files: JSON lists of rectangle maps, each with a start, a goal and an optimum."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from planners.collision.space import Space
from planners.problem import Problem
from wheelchair_gym.errors import InputError, shorten
from wheelchair_gym.files import LIMITS, coordinate_lists, coordinates, is_coordinate, read_json

KEYS = {"name", "size", "rects", "start", "goal", "optimum"}


def _problem(data: Any, where: str) -> tuple[Problem, float | None]:
    if not isinstance(data, Mapping):
        raise InputError(
            f"{where} is {shorten(data)}; expected an object with {', '.join(sorted(KEYS))}"
        )
    for key in data:
        if key not in KEYS:
            named = key if len(key) < 80 else shorten(key)
            raise InputError(f"{where}.{named} is not a key; it has {', '.join(sorted(KEYS))}")
    for key in sorted(KEYS - {"optimum"}):
        if key not in data:
            raise InputError(f"{where}.{key} is missing")
    if not isinstance(data["name"], str):
        raise InputError(f"{where}.name is {shorten(data['name'])}; expected text")
    size = data["size"]
    if not is_coordinate(size) or size <= 0:
        expected = f"expected metres, above 0 and at most {LIMITS['coordinate'].most:,}"
        raise InputError(f"{where}.size is {shorten(size)}; {expected}")
    rectangles = coordinate_lists(data["rects"], 4, f"{where}.rects")
    for index, (x0, y0, x1, y1) in enumerate(rectangles):
        if x1 <= x0 or y1 <= y0:
            expected = "expected x0 < x1 and y0 < y1"
            raise InputError(f"{where}.rects[{index}] is {[x0, y0, x1, y1]}; {expected}")
    optimum = data.get("optimum")
    if optimum is not None and (not is_coordinate(optimum) or optimum < 0):
        raise InputError(f"{where}.optimum is {shorten(optimum)}; expected metres or null")
    problem = Problem(
        Space.from_rectangles(rectangles, (0.0, 0.0, size, size)),
        np.array(coordinates(data["start"], (2,), f"{where}.start")),
        np.array(coordinates(data["goal"], (2,), f"{where}.goal")),
        name=data["name"],
    )
    return problem, None if optimum is None else float(optimum)


def read_problems(path: str | Path) -> list[tuple[Problem, float | None]]:
    """Problems of a file, each with its known optimum [m] or None.

    Raises:
        InputError: the file cannot be read, or a problem's key is missing, unknown or wrong.
    """
    path = Path(path)
    data = read_json(path)
    if not isinstance(data, list):
        raise InputError(f"{path.name}: expected a list of problems, got {type(data).__name__}")
    return [_problem(item, f"{path.name}: [{index}]") for index, item in enumerate(data)]
