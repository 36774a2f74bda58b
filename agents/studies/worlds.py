"""Where experiments take place: scenes, rooms of boxes, squares with discs; made once a process."""

from __future__ import annotations

import json
import math
from functools import lru_cache
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from planners import Problem, Space, make_planner
from wheelchair_gym.config import InputError
from wheelchair_gym.geometry import polygon_edges
from wheelchair_gym.scenes import make_scene
from wheelchair_gym.scenes.published import LAB_SIZE, LABS
from wheelchair_gym.types import Episode

Array = NDArray[np.float64]


@lru_cache(maxsize=64)
def episode_of(scene: str, seed: int) -> Episode:
    """The episode that a seed draws of a scene, given as JSON."""
    return make_scene(json.loads(scene)).sample(np.random.default_rng(seed))


@lru_cache(maxsize=64)
def _space(scene: str, seed: int) -> Space:
    episode = episode_of(scene, seed)
    return Space.from_walls(episode.walls, episode.discs, episode.map.bounds)


def problem_of(scene: Any, seed: int = 0, clearance: float = 0.0) -> Problem:
    """The problem of a scene; one seed has one."""
    spec = json.dumps(scene)
    episode = episode_of(spec, seed)
    return Problem(_space(spec, seed), episode.start[:2], episode.goal[:2], clearance)


def room_problem(boxes: Array, start: Any, goal: Any) -> Problem:
    """A room of T2's kind: separate upright boxes (n, 4) [m], and no wall round it."""
    walls = np.concatenate([polygon_edges(box_corners(box)) for box in boxes])
    space = Space.from_walls(walls, np.empty((0, 3)), (0.0, 0.0, *LAB_SIZE))
    return Problem(space, np.array(start, dtype=float), np.array(goal, dtype=float))


def box_corners(box: Any) -> Array:
    """Corners (4, 2) of an upright box xmin, ymin, xmax, ymax, counter-clockwise."""
    x0, y0, x1, y1 = box
    return np.array([(x0, y0), (x1, y0), (x1, y1), (x0, y1)], dtype=float)


@lru_cache(maxsize=64)
def lab_problem(number: int) -> Problem:
    """A lab of T2 as it had them: boxes only."""
    plan = LABS[number - 1]
    return room_problem(np.array(plan.walls, dtype=float), plan.start, plan.goal)


DRAWS: Final = 100  # rooms drawn until one can be crossed
_APART: Final = 0.3  # m from boxes to start and goal
_ENDS: Final = ((0.5, 0.5), (6.5, 4.5))
_LONG: Final = (0.5, 2.0)  # m, as T2's screens and benches
_THIN: Final = (0.1, 0.4)  # m


def drawn_problem(count: int, seed: int) -> tuple[Problem, float]:
    """A room with so many boxes at random that can be crossed, and the shortest way [m].

    Raises:
        InputError: no room drawn can be.
    """
    rng = np.random.default_rng([seed, count])
    for _ in range(DRAWS):
        boxes: list[Array] = []
        while len(boxes) < count:
            sides = np.array([rng.uniform(*_LONG), rng.uniform(*_THIN)])
            sides = sides[:: rng.choice([1, -1])]
            low = rng.uniform(-0.5 * sides, np.array(LAB_SIZE) - 0.5 * sides)
            box = np.concatenate([np.maximum(low, 0.0), np.minimum(low + sides, LAB_SIZE)])
            gaps = [np.maximum(box[:2] - end, end - box[2:]).max() for end in np.array(_ENDS)]
            if min(gaps) > _APART:
                boxes.append(box)
        problem = room_problem(np.array(boxes), *_ENDS)
        shortest = make_planner("visibility").plan(problem, rng).length
        if math.isfinite(shortest):
            return problem, shortest
    raise InputError(f"none of {DRAWS} rooms with {count} boxes can be crossed")


@lru_cache(maxsize=16)
def ground(size: float, discs: Any, start: Any, goal: Any) -> Problem:
    """A square of free ground with discs."""
    space = Space.from_walls(np.empty((0, 4)), discs, (0.0, 0.0, size, size))
    return Problem(space, np.array(start, dtype=float), np.array(goal, dtype=float))
