"""Guidance: what the setting of that name means, and the two that are built in."""

from collections.abc import Mapping
from functools import partial
from inspect import signature
from typing import Any, cast

import numpy as np

from wheelchair_gym.base.arrays import Array
from wheelchair_gym.base.errors import shorten
from wheelchair_gym.base.registry import imported, is_place
from wheelchair_gym.base.settings import InputError, load, setting, settings
from wheelchair_gym.maps import FREE, OccupancyGrid
from wheelchair_gym.maps.cost_to_go import CostToGo, CostToGoSettings, cost_to_go
from wheelchair_gym.task.task import Guidance, Task

GOAL_DEPTH = 0.5  # share of the tolerance within which routes end
# Of a degraded map [m]: the radius of a forgotten patch, the distance round start and goal within
# which nothing is forgotten, and the standard deviation of the map's shift on each axis.
_PATCH, _KNOWN, _SHIFT = 0.8, 2.0, 0.03
_PATCH_DENSITY = 0.02  # 1/m2 of a degraded map: patches that are forgotten


def geodesic_path(task: Task) -> Array:
    """Return the geodesic from the start to the goal (n, 2) [m]."""
    path = task.geodesic.path(task.start[:2])  # short at the goal, and where no way is known
    return path if len(path) > 1 else np.stack([task.start[:2], task.goal[:2]])


@settings
class PoseGuidance:
    """Poses on the quickest way of the chair's outline, from wherever the chair is.

    The map may be degraded, as a stand-in for one that the chair builds: some patches are
    forgotten, which planners take for free, and all of it is shifted.
    """

    poses = True  # what `Task` asks a guidance for
    ways: CostToGoSettings = CostToGoSettings()
    max_detour: float | None = setting(default=None, unit="s", low=0.0)
    """Only states whose cost exceeds that of the direct way by less than this are searched;
    none: all."""
    degraded_share: float = setting(default=0.0, low=0.0, high=1.0)
    """Share of worlds whose map is degraded."""

    def __call__(self, task: Task) -> CostToGo:
        """Compute the cost to go of the outline to the task's goal."""
        heading = task.settings.heading_tolerance if task.settings.heading else None
        return cost_to_go(
            self._map_of(task),
            task.goal,
            task.footprint,
            task.limits,
            tolerance=GOAL_DEPTH * max(0.0, task.tolerance - task.settings.arrival_margin),
            starts=[task.start],
            heading=heading if task.arrival is None else task.arrival.heading,
            config=self.ways,
            slack=self.max_detour,
        )

    def _map_of(self, task: Task) -> OccupancyGrid:
        """Return the map, or a degraded one; the same for the same start and goal."""
        grid = task.map
        rng = np.random.default_rng(np.concatenate([task.start, task.goal]).view(np.uint32))
        if self.degraded_share == 0.0 or rng.random() >= self.degraded_share:
            return grid
        cells_high, cells_wide = grid.shape
        count = rng.poisson(_PATCH_DENSITY * grid.resolution**2 * grid.cells.size)
        places = grid.from_lattice(rng.uniform(0.0, (cells_wide, cells_high), (count, 2)))
        ends = np.stack([task.start[:2], task.goal[:2]])
        apart = np.hypot(*np.moveaxis(places[:, None] - ends, -1, 0)).min(axis=1, initial=np.inf)
        cells = grid.cells.copy()
        reach = int(_PATCH / grid.resolution)
        for row, col in grid.to_cell(places[apart > _KNOWN + _PATCH]):
            rows = np.arange(max(0, row - reach), min(grid.shape[0], row + reach + 1))
            cols = np.arange(max(0, col - reach), min(grid.shape[1], col + reach + 1))
            within = np.hypot(rows[:, None] - row, cols - col) <= reach
            cells[rows[0] : rows[-1] + 1, cols[0] : cols[-1] + 1][within] = FREE
        dx, dy = rng.normal(0.0, _SHIFT, 2).tolist()
        x, y, yaw = grid.origin
        return OccupancyGrid(cells, grid.resolution, (x + dx, y + dy, yaw))


BUILT_IN: dict[str, Any] = {"geodesic": geodesic_path, "poses": PoseGuidance()}


def is_built_in(spec: Any) -> bool:
    """Return whether a guidance is none or comes with the package: no file of data names code."""
    if isinstance(spec, Mapping):
        spec = spec.get("call")
    return spec is None or (isinstance(spec, str) and spec in BUILT_IN)


def make_guidance(spec: Any) -> Guidance | None:
    """Return the guidance that a setting names.

    Raises:
        InputError: it names nothing that can be imported and called.
    """
    if spec is None:
        return None
    if isinstance(spec, Mapping):
        options = dict(spec)
        named = options.pop("call", None)
        if named == "poses":
            return load(PoseGuidance, options, "guidance")
        call = make_guidance(named)
        if call is None:
            raise InputError("guidance: a mapping needs the key 'call'")
        try:
            signature(call).bind(None, **options)
        except TypeError as error:
            raise InputError(f"guidance {named}: {error}") from None
        made: Any = partial(call, **options)
        made.poses = getattr(call, "poses", False)
        return cast("Guidance", made)
    found = spec
    if isinstance(spec, str):
        found = imported(spec) if is_place(spec) else BUILT_IN.get(spec)
    if not callable(found):
        known = ", ".join(map(repr, BUILT_IN))
        raise InputError(f"guidance is {shorten(spec)}; expected {known} or 'module:function'")
    return cast("Guidance", found)
