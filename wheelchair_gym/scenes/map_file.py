"""A map file as a scene, and the small clinic that comes with the package."""

import math
from functools import lru_cache
from importlib import resources
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.base.arrays import Array
from wheelchair_gym.base.files import modified
from wheelchair_gym.base.settings import InputError, setting, settings
from wheelchair_gym.geometry.outline import Footprint
from wheelchair_gym.maps import FREE, OccupancyGrid, geodesic, map_files, read_any_map
from wheelchair_gym.scenes.arena import CLEARANCE, FOOTPRINT, Ends, is_free_pose, passing_radius
from wheelchair_gym.types import Episode, no_discs

_TRIES = 200  # places drawn for one pose
_GOALS = 20  # goals drawn before the map is called impossible


def example_map() -> Path:
    """The map that comes with the package: a small clinic."""
    return Path(str(resources.files("wheelchair_gym.maps") / "data" / "clinic.yaml"))


@lru_cache(maxsize=8)
def _read(
    path: Path, stamps: tuple[int, ...], unknown_is_solid: bool, resolution: float | None
) -> tuple[OccupancyGrid, Array]:
    """Map and walls; the stamps make edited files be read again."""
    return read_any_map(path, unknown_is_solid, resolution)


@settings
class MapFile(Ends):
    """A map file; start and goal are given, or drawn from where the chair can stand."""

    path: str | tuple[str, ...] = setting(default="")
    """Map file: map_server's YAML, MovingAI's .map, HouseExpo's JSON, polygons in JSON or an image;
    of several each episode draws one; empty takes the clinic of the package."""
    resolution: float | None = setting(default=None, unit="m", low=1e-4, high=10.0)
    """Edge of a pixel of an image; null for other files, which have a scale."""
    min_path_length: float = setting(default=3.0, unit="m", low=0.0)
    """Least length of the path from start to goal where one is drawn or both are; half the longest
    possible one where one is given and the map is smaller."""
    unknown_is_solid: bool = setting(default=True)
    """Unknown cells are solid in this world and on its map; otherwise they are free."""

    def __post_init__(self) -> None:
        if not isinstance(self.path, str) and not self.path:
            raise InputError("MapFile.path is an empty list; expected map files")

    def sample(self, rng: np.random.Generator, footprint: Footprint = FOOTPRINT) -> Episode:
        """Draw what is not given, for a chair of this footprint.

        Raises:
            InputError: the map cannot be read; a given pose is not free; there is no way.
        """
        files = (self.path,) if isinstance(self.path, str) else self.path
        chosen = files[0] if len(files) == 1 else files[int(rng.integers(len(files)))]
        path = Path(chosen) if chosen else example_map()
        stamps = tuple(map(modified, map_files({"path": str(path)})))
        grid, walls = _read(path, stamps, self.unknown_is_solid, self.resolution)
        for name, pose in (("start", self.start), ("goal", self.goal)):
            if pose is None:
                continue
            place = f"{path}: the {name} {','.join(f'{value:g}' for value in pose)}"
            if not grid.inside(pose[:2]):
                raise InputError(f"{place} lies outside the map, {grid.extent}")
            is_free = grid.cells[tuple(grid.to_cell(pose[:2]))] == FREE
            if not is_free or not is_free_pose(np.array(pose), walls, no_discs(), footprint, 0.0):
                raise InputError(
                    f"{place} is not free: {footprint} would touch something there; expected "
                    "another place, or another heading (X,Y,YAW)"
                )

        def draw(cells: NDArray[np.int64]) -> Array | None:
            """A pose on one of the cells where the chair stands free."""
            for _ in range(_TRIES if len(cells) else 0):
                x, y = grid.to_world(cells[rng.integers(len(cells))])
                pose = np.array([x, y, rng.uniform(-math.pi, math.pi)])
                if is_free_pose(pose, walls, no_discs(), footprint, CLEARANCE):
                    return pose
            return None

        radius = passing_radius(footprint)
        free = np.argwhere(grid.traversable(radius))
        if self.start is not None and self.goal is not None:
            start, goal = np.array(self.start), np.array(self.goal)
            if not np.isfinite(geodesic(grid, goal, radius).at(start[:2])):
                raise InputError(
                    f"{path}: there is no way from the start to the goal for {footprint}"
                )
            return Episode(grid, start, goal, walls, name=path.stem)
        given = self.goal if self.start is None else self.start
        for _ in range(_GOALS if given is None else 1):
            end = draw(free) if given is None else np.array(given)
            if end is None:
                break
            lengths = geodesic(grid, end, radius).field
            reached = lengths[np.isfinite(lengths)]
            minimum = self.min_path_length
            if given is not None and len(reached):  # on a small map, the half that is farther away
                minimum = min(minimum, 0.5 * float(reached.max()))
            other = draw(np.argwhere(np.isfinite(lengths) & (lengths >= minimum)))
            if other is not None:
                start, goal = (other, end) if self.start is None else (end, other)
                return Episode(grid, start, goal, walls, name=path.stem)
        raise InputError(
            f"{path}: no start and goal for {footprint} with {self.min_path_length} m between them"
        )
