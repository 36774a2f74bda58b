"""An episode prepared to be driven, with the distances to its goal."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.actors.records import ACTOR  # noqa: F401 for the record
from wheelchair_gym.base.arrays import Array
from wheelchair_gym.base.settings import FARTHEST
from wheelchair_gym.compiled.address import (
    Pointers,
    as_array,
    field_at,
    read_record,
    states_at,
    table_at,
)
from wheelchair_gym.compiled.kernel import borrowing_kernel
from wheelchair_gym.geometry.planar import project, world_to_body
from wheelchair_gym.maps import Geodesic
from wheelchair_gym.maps.cost_to_go import CostToGo, nearest_state, to_local
from wheelchair_gym.maps.geodesic import interpolate
from wheelchair_gym.sim.chairs import columns_of
from wheelchair_gym.types import Episode

Aim = Literal["goal", "path", "field", "time"]  # measure of progress: the setting `task.aim`
AIMS = get_args(Aim)
GOAL, PATH, FIELD, TIME = range(4)  # in that order

PREPARED, _TARGETS = read_record("PREPARED", globals())


@dataclass(frozen=True, eq=False)
class PreparedEpisode:
    """Episode ready to be driven; `record` (1,) of PREPARED points to arrays kept alive here.

    It never changes: a copy in this process is itself.
    """

    episode: Episode
    geodesic: Geodesic
    path: Array | None  # (n, 2) m
    cost_to_go: CostToGo | None  # of the outline
    pointers: Pointers  # of the record

    @property
    def record(self) -> NDArray[np.void]:
        """The record (1,) of PREPARED."""
        return self.pointers.record

    def __deepcopy__(self, memo: dict[int, Any]) -> PreparedEpisode:
        return self

    @cached_property
    def columns(self) -> int:
        """Columns of the workspace that it takes."""
        return columns_of(self.episode)

    @classmethod
    def of(
        cls,
        episode: Episode,
        geodesic: Geodesic,
        path: Array | None,
        tolerance: float,
        cost_to_go: CostToGo | None = None,
    ) -> PreparedEpisode:
        """Prepare an episode with the distances to its goal, and its guidance (n, 2) [m], if any.

        `tolerance` [m] counts where the episode names none; `cost_to_go` is of the outline, where
        that guides.
        """
        points = np.empty((0, 2))
        if path is not None:
            points = as_array(path[:, :2], np.float64, (None, 2), "path of the guidance", FARTHEST)
        actors, grid, field = episode.actors, geodesic.grid, geodesic.extended
        pointers = Pointers(np.zeros(1, PREPARED), _TARGETS, constant=True).fill(
            is_filled=True, walls=episode.walls, n_walls=len(episode.walls),
            discs=episode.discs, n_discs=len(episode.discs), actors=actors.rows,
            n_actors=len(actors), routes=actors.routes, n_routes=len(actors.routes),
            start=episode.start, goal=episode.goal, arrival=episode.arrival or 0.0,
            tolerance=tolerance if episode.tolerance is None else episode.tolerance,
            time_limit=math.nan if episode.time_limit is None else episode.time_limit,
            field=field, rows=field.shape[0], cols=field.shape[1], origin=grid.origin,
            resolution=grid.resolution, path=points, n_path_points=len(points),
        )  # fmt: skip
        if cost_to_go is not None:
            states = np.ascontiguousarray(cost_to_go.packed_states)
            moves, (rows, cols, headings) = np.ascontiguousarray(cost_to_go.moves), states.shape
            pointers.fill(
                packed_states=states, state_rows=rows, state_cols=cols, n_headings=headings,
                state_cell=cost_to_go.cell, state_origin=cost_to_go.origin, moves=moves,
                n_moves=len(moves),
            )  # fmt: skip
        return cls(episode, geodesic, path, cost_to_go, pointers)

    def starting_at(self, start: Array) -> PreparedEpisode:
        """The same episode from another start (3,) [m, m, rad]."""
        episode = self.episode.starting_at(start)
        pointers = self.pointers.again()
        pointers.record["start"] = episode.start
        return replace(self, episode=episode, pointers=pointers)


@borrowing_kernel
def geodesic_to_go(prepared: Any, x: float, y: float) -> float:
    """Length of the geodesic from a point to the goal [m]; straight where none is known."""
    c, s = math.cos(prepared.origin[2]), math.sin(prepared.origin[2])
    dx, dy = x - prepared.origin[0], y - prepared.origin[1]
    u, v = world_to_body(c, s, dx, dy)
    field = field_at(prepared.field, prepared.rows, prepared.cols)
    way = interpolate(field, u / prepared.resolution, v / prepared.resolution)
    if way < math.inf:
        return float(way)
    return math.hypot(prepared.goal[0] - x, prepared.goal[1] - y)


@borrowing_kernel
def path_to_go(path: Array, x: float, y: float) -> float:
    """Compute the distance [m] from a point to a path (n, 2) and along it to its end."""
    segment, share, gap = project(path, x, y)
    rest = gap
    for k in range(segment, path.shape[0] - 1):
        length = math.hypot(path[k + 1, 0] - path[k, 0], path[k + 1, 1] - path[k, 1])
        rest += length if k > segment else (1.0 - share) * length
    return rest


@borrowing_kernel
def seconds_to_go(prepared: Any, x: float, y: float, yaw: float) -> float:
    """Seconds to the goal from a pose by the cost to go of the outline; NaN where none is known."""
    if prepared.state_rows == 0:
        return math.nan
    packed_states = states_at(
        prepared.packed_states, prepared.state_rows, prepared.state_cols, prepared.n_headings
    )
    lx, ly, lyaw = to_local(prepared.state_origin, x, y, yaw)
    return nearest_state(packed_states, prepared.state_cell, lx, ly, lyaw)[3]


@borrowing_kernel
def remaining_to_goal(prepared: Any, aim: int, x: float, y: float, yaw: float) -> float:
    """Compute what remains from a pose to the goal [s for TIME, else m]; NaN where unknown."""
    if aim == TIME:
        return seconds_to_go(prepared, x, y, yaw)
    if aim == FIELD:
        return geodesic_to_go(prepared, x, y)
    if aim == PATH and prepared.n_path_points > 0:
        return path_to_go(table_at(prepared.path, prepared.n_path_points, 2), x, y)
    return math.hypot(prepared.goal[0] - x, prepared.goal[1] - y)
