"""A course: an episode made ready to be driven, with the ways to its goal."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.compiled.address import (
    Pointers,
    Target,
    as_array,
    field_at,
    states_at,
    table_at,
)
from wheelchair_gym.compiled.kernel import borrowing_kernel
from wheelchair_gym.config import FARTHEST
from wheelchair_gym.maps import Geodesic
from wheelchair_gym.maps.cost_to_go import CostToGo, time_to_go, to_local
from wheelchair_gym.maps.geodesic import interpolate
from wheelchair_gym.physics.actors.records import MOVER
from wheelchair_gym.task.observations import project
from wheelchair_gym.types import Episode

Array = NDArray[np.float64]

GOAL, PATH, FIELD, TIME = range(4)  # what progress is measured along
AIMS = ("goal", "path", "field", "time")

COURSE = np.dtype(
    [
        ("walls", "u8"),  # addresses of walls (n, 4) and discs (m, 3) [m]
        ("discs", "u8"),
        ("n_walls", "i8"),
        ("n_discs", "i8"),
        ("movers", "u8"),  # addresses of movers (k,) of MOVER and of their routes (r, 2) [m]
        ("n_movers", "i8"),
        ("routes", "u8"),
        ("n_routes", "i8"),
        ("start", "f8", (3,)),  # m, m, rad
        ("goal", "f8", (3,)),
        ("tolerance", "f8"),  # m
        ("time_limit", "f8"),  # s; NaN: as the way to go demands
        ("field", "u8"),  # address of the ways to go (rows, cols) [m]
        ("rows", "i8"),
        ("cols", "i8"),
        ("origin", "f8", (3,)),  # m, m, rad: of its lower-left corner
        ("resolution", "f8"),  # m
        ("path", "u8"),  # address of the guidance (points, 2) [m]
        ("points", "i8"),  # 0: none
        ("words", "u8"),  # address of the ways of the outline (word_rows, word_cols, headings)
        ("word_rows", "i8"),  # 0: none
        ("word_cols", "i8"),
        ("headings", "i8"),
        ("moves", "u8"),  # address of their moves (n_moves, headings, 3)
        ("n_moves", "i8"),
        ("word_cell", "f8"),  # m
        ("word_origin", "f8", (3,)),  # m, m, rad
    ],
    align=True,
)

_TARGETS = {
    "walls": Target("f8", None, 4),
    "discs": Target("f8", None, 3),
    "movers": Target(MOVER, None),
    "routes": Target("f8", None, 2),
    "field": Target("f4", None, None),
    "path": Target("f8", None, 2),
    "words": Target("u4", None, None, None),
    "moves": Target("i4", None, None, 3),
}


@dataclass(frozen=True, eq=False)
class Course:
    """What an episode is driven on; `record` (1,) of COURSE points to arrays kept alive here.

    It never changes: a copy in this process is itself.
    """

    episode: Episode
    geodesic: Geodesic
    path: Array | None  # (n, 2) m
    ways: CostToGo | None  # of the outline
    pointers: Pointers  # of the record

    @property
    def record(self) -> NDArray[np.void]:
        """The record (1,) of COURSE."""
        return self.pointers.record

    def __deepcopy__(self, memo: dict[int, Any]) -> Course:
        return self

    @cached_property
    def segments(self) -> int:
        """How many segments sensors see, those of movers among them."""
        return len(self.episode.walls) + self.episode.movers.segments

    @classmethod
    def of(
        cls,
        episode: Episode,
        geodesic: Geodesic,
        path: Array | None,
        tolerance: float,
        ways: CostToGo | None = None,
    ) -> Course:
        """Lay out a course.

        Args:
            episode: where and what.
            geodesic: ways to its goal.
            path: guidance (n, 2) [m], or None.
            tolerance: where the episode names none [m].
            ways: of the outline, where they guide.
        """
        points = np.empty((0, 2))
        if path is not None:
            points = as_array(path[:, :2], np.float64, (None, 2), "path of the guidance", FARTHEST)
        pointers = Pointers(np.zeros(1, COURSE), _TARGETS, constant=True)
        r: Any = pointers.record[0]
        movers, field = episode.movers, geodesic.extended
        pointers.point("walls", episode.walls)
        pointers.point("discs", episode.discs)
        pointers.point("movers", movers.rows)
        pointers.point("routes", movers.routes)
        r["n_walls"], r["n_discs"] = len(episode.walls), len(episode.discs)
        r["n_movers"], r["n_routes"] = len(movers), len(movers.routes)
        r["start"], r["goal"] = episode.start, episode.goal
        r["tolerance"] = tolerance if episode.tolerance is None else episode.tolerance
        r["time_limit"] = math.nan if episode.time_limit is None else episode.time_limit
        pointers.point("field", field)
        r["rows"], r["cols"] = field.shape
        r["origin"], r["resolution"] = geodesic.grid.origin, geodesic.grid.resolution
        pointers.point("path", points)
        r["points"] = len(points)
        if ways is not None:
            words, moves = (
                np.ascontiguousarray(ways.packed_states),
                np.ascontiguousarray(ways.moves),
            )
            pointers.point("words", words)
            pointers.point("moves", moves)
            r["word_rows"], r["word_cols"], r["headings"] = words.shape
            r["n_moves"], r["word_cell"], r["word_origin"] = len(moves), ways.cell, ways.origin
        return cls(episode, geodesic, path, ways, pointers)

    def begun_at(self, start: Array) -> Course:
        """This course from another start (3,) [m, m, rad]."""
        episode = replace(self.episode, start=start)
        pointers = self.pointers.again()
        pointers.record["start"] = episode.start
        return replace(self, episode=episode, pointers=pointers)


@borrowing_kernel
def way_to_go(course: Any, x: float, y: float) -> float:
    """Length of the geodesic from a point to the goal [m]; straight where none is known."""
    c, s = math.cos(course.origin[2]), math.sin(course.origin[2])
    dx, dy = x - course.origin[0], y - course.origin[1]
    way = course.resolution
    field = field_at(course.field, course.rows, course.cols)
    way = interpolate(field, (c * dx + s * dy) / way, (c * dy - s * dx) / way)
    if way < math.inf:
        return float(way)
    return math.hypot(course.goal[0] - x, course.goal[1] - y)


@borrowing_kernel
def rest_of_path(path: Array, x: float, y: float) -> float:
    """Way [m] from a point to a path (n, 2) and along it to its end."""
    segment, share, gap = project(path, x, y)
    rest = gap
    for k in range(segment, path.shape[0] - 1):
        length = math.hypot(path[k + 1, 0] - path[k, 0], path[k + 1, 1] - path[k, 1])
        rest += length if k > segment else (1.0 - share) * length
    return rest


@borrowing_kernel
def seconds_to_go(course: Any, x: float, y: float, yaw: float) -> float:
    """Seconds to the goal from a pose by the ways of the outline; NaN where none is known."""
    if course.word_rows == 0:
        return math.nan
    words = states_at(course.words, course.word_rows, course.word_cols, course.headings)
    lx, ly, lyaw = to_local(course.word_origin, x, y, yaw)
    return time_to_go(words, course.word_cell, lx, ly, lyaw)


@borrowing_kernel
def to_go(course: Any, aim: int, x: float, y: float, yaw: float) -> float:
    """Way to go from a pose, as the task's aim measures it [m, or s]; NaN where none is known."""
    if aim == TIME:
        return seconds_to_go(course, x, y, yaw)
    if aim == FIELD:
        return way_to_go(course, x, y)
    if aim == PATH and course.points > 0:
        return rest_of_path(table_at(course.path, course.points, 2), x, y)
    return math.hypot(course.goal[0] - x, course.goal[1] - y)


@borrowing_kernel
def way_from(courses: Any, x: float, y: float) -> float:
    """`way_to_go` of the only row of courses (1,)."""
    return way_to_go(courses[0], x, y)
