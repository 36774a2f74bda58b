"""A map that a person draws: the cells of a map, and shapes over them; and the files made of it."""

from __future__ import annotations

import json
import warnings
from contextlib import suppress
from pathlib import Path
from typing import Final

import numpy as np
import shapely
from PIL import Image

from agents.evaluation.provenance import write_text
from wheelchair_gym.base.arrays import Array
from wheelchair_gym.base.errors import shorten
from wheelchair_gym.base.files import LIMITS, parse_yaml, read_text
from wheelchair_gym.base.settings import InputError
from wheelchair_gym.maps import FREE, OCCUPIED, OccupancyGrid, read_grid

# A wall, an opening in one, solid, rubbed out.
SHAPES: Final = ("wall", "door", "furniture", "free")
UPLOADS: Final = "uploads"  # folder of maps that pages have sent
CELL: Final = 0.05  # m
_WIDTH: Final = 0.10  # m of a wall
_OPENING: Final = 0.30  # m: how deep a door cuts, so that walls a little thicker are open, too
_LONGEST_NAME: Final = 255  # bytes of a file's name, as file systems have it
_MAX_WALLS: Final = 50_000  # segments that a page can draw
_MAX_CELLS: Final = 25_000_000  # of a map, or pixels of its image: 0.5 GB of memory, some seconds


def blank(width: float, height: float) -> OccupancyGrid:
    """An empty room with walls round it; its inside is of that size [m]."""
    rim = round(_WIDTH / CELL)
    shape = round(height / CELL) + 2 * rim, round(width / CELL) + 2 * rim
    cells = np.full(shape, OCCUPIED, np.int8)
    cells[rim:-rim, rim:-rim] = FREE
    return OccupancyGrid(cells, CELL)


def drawn(grid: OccupancyGrid, shapes: list[list[float]]) -> OccupancyGrid:
    """A map with shapes over it, one after another.

    Args:
        grid: the map below.
        shapes: rows of a number in SHAPES and two points [m]: ends of a wall or a door, corners of
            what is furniture or free.
    """
    cells = grid.cells.copy()
    for kind, *ends in shapes:
        name = SHAPES[int(kind)]
        a, b = grid.to_lattice(np.reshape(ends, (2, 2)))
        width = {"wall": _WIDTH, "door": _OPENING}.get(name, 0.0) / grid.resolution
        low = np.floor(np.minimum(a, b) - width).astype(int).clip(0)
        high = np.ceil(np.maximum(a, b) + width).astype(int).clip(0)
        part = cells[low[1] : high[1], low[0] : high[0]]
        rows, cols = np.indices(part.shape)
        centres = np.stack([cols, rows], axis=-1) + low + 0.5
        if width:
            line = shapely.LineString([a, b])
            within = shapely.distance(shapely.points(centres), line) <= 0.5 * width + 1e-9
        else:
            within = (centres >= np.minimum(a, b)) & (centres <= np.maximum(a, b))
            within = within.all(axis=-1)
        part[within] = OCCUPIED if name in ("wall", "furniture") else FREE
    return OccupancyGrid(cells, grid.resolution, grid.origin)


def loaded(path: Path, resolution: float) -> OccupancyGrid:
    """The map of an uploaded file, which may not lead out of its folder.

    Args:
        path: of the file.
        resolution: edge of a pixel [m], of an image.

    Raises:
        InputError: the file cannot be read, names an image elsewhere, or is too intricate.
    """
    image, image_file = path.suffix.lower() not in (".yaml", ".yml"), path
    if not image:
        content = parse_yaml(read_text(path, "yaml", errors="replace"), path.name)
        name = content.get("image") if isinstance(content, dict) else None
        if (
            not isinstance(name, str)
            or Path(name).name != name
            or len(name.encode(errors="replace")) > _LONGEST_NAME
        ):
            shown = shorten(name)
            raise InputError(f"{path.name}: image is {shown}; expected the bare name of a file")
        image_file = path.parent / name
        if image_file.is_symlink() or not image_file.is_file():
            raise InputError(f"{path.name}: load its image, {name}, together with it")
    pixels = 0
    with suppress(Exception), warnings.catch_warnings():  # what is no image is refused below
        warnings.simplefilter("ignore")  # of its own limit
        with Image.open(image_file) as head:
            pixels = head.width * head.height
    _check_cells(pixels, path)  # before they are decoded
    try:
        grid = read_grid(path, True, resolution if image else None)
    except InputError as error:
        raise InputError(str(error).replace(f"{path.parent}/", "")) from None
    _check_cells(grid.cells.size, path)
    if grid.n_walls > _MAX_WALLS:
        raise InputError(f"{path.name}: more than {_MAX_WALLS:,} walls; expected a simpler map")
    return grid


def _check_cells(n: int, path: Path) -> None:
    if n > _MAX_CELLS:
        raise InputError(
            f"{path.name}: {n:,} pixels or cells; expected at most {_MAX_CELLS:,}: make the image "
            "smaller and its pixels larger, both by the same factor"
        )


def scaled(grid: OccupancyGrid, factor: float) -> OccupancyGrid:
    """The same cells, each larger by a factor."""
    x, y, yaw = grid.origin
    return OccupancyGrid(grid.cells, factor * grid.resolution, (factor * x, factor * y, yaw))


def far_ends(grid: OccupancyGrid, name: str) -> tuple[list[float], list[float]]:
    """The first and the last place [m] of a map where there is room for a chair.

    Raises:
        InputError: there is none; the message begins with the map's name.
    """
    free = grid.traversable(0.4)
    if not free.any():
        raise InputError(f"{name}: nowhere on it is room for a chair; check the resolution")
    flat = free.ravel()
    ends = [int(flat.argmax()), flat.size - 1 - int(flat[::-1].argmax())]
    first, last = grid.to_world(np.stack(np.unravel_index(ends, free.shape), axis=-1)).tolist()
    return first, last


def rectangles(grid: OccupancyGrid) -> Array:
    """Return solid cells as rectangles (n, 4) [m]: x0, y0, x1, y1 from the lower left corner.

    Runs of cells of one row are joined with equal runs of the rows above.
    """
    solid = grid.cells == OCCUPIED
    open_runs: dict[tuple[int, int], int] = {}
    found: list[tuple[int, int, int, int]] = []
    for row in range(len(solid) + 1):
        runs: list[tuple[int, int]] = []
        if row < len(solid):
            edges = np.flatnonzero(np.diff(np.concatenate([[0], solid[row].view(np.int8), [0]])))
            runs = [(int(a), int(b)) for a, b in edges.reshape(-1, 2)]
        for run in [run for run in open_runs if run not in runs]:
            found.append((run[0], open_runs.pop(run), run[1], row))
        for run in runs:
            open_runs.setdefault(run, row)
    return np.array(found, np.float64).reshape(-1, 4) * grid.resolution


def write_problem(path: Path, grid: OccupancyGrid, start: list[float], goal: list[float]) -> None:
    """Write a file of one problem (docs/how_to/files.md); its map begins at (0, 0).

    Args:
        path: of the file.
        grid: the map; what is beyond it in the square of the file is solid.
        start: (2,) [m] on the map.
        goal: likewise.

    Raises:
        InputError: the map is turned, or its obstacles are more than a file may have.
    """
    x, y, yaw = grid.origin
    if yaw != 0.0:
        raise InputError(f"{path.name}: the map is turned by {yaw:g} rad; expected an upright one")
    rows, cols = grid.shape
    width, height = cols * grid.resolution, rows * grid.resolution
    size = max(width, height)
    rects = rectangles(grid).tolist()
    if width < size:
        rects.append([width, 0.0, size, size])
    if height < size:
        rects.append([0.0, height, size, size])
    if len(rects) > LIMITS["outline"].maximum:
        expected = f"expected at most {LIMITS['outline'].maximum:,}"
        raise InputError(f"{path.name}: {len(rects):,} rectangles; {expected}")
    problem = {
        "name": path.stem, "size": round(size, 6),
        "rects": [[round(value, 6) for value in rect] for rect in rects],
        "start": [round(start[0] - x, 6), round(start[1] - y, 6)],
        "goal": [round(goal[0] - x, 6), round(goal[1] - y, 6)], "optimum": None,
    }  # fmt: skip
    write_text(path, json.dumps([problem]))
