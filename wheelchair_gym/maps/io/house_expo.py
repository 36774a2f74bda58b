"""Floor plans of HouseExpo: JSON with one outline in metres; all outside of it is solid.

`verts` holds the corners in order, `bbox` their least and greatest coordinates, `room_category` the
boxes of rooms by kind (Li et al. 2019, HouseExpo: a large-scale 2D indoor layout dataset).
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np

from wheelchair_gym.base.arrays import Array, Mask
from wheelchair_gym.base.errors import InputError, shorten
from wheelchair_gym.base.files import check_cells, coordinate_lists, read_json
from wheelchair_gym.geometry.planar import polygon_edges, signed_area
from wheelchair_gym.maps.grid import FREE, OCCUPIED, OccupancyGrid

MARGIN: Final = 0.25  # m of solid ground round the outline, in its grid
FRAME: Final = 1.0  # m of it in its walls, so that the grid lies within
TOUCH: Final = 1e-6  # cells: an edge along the side of a cell does not cut it
SLACK: Final = 0.01  # m: difference allowed between `bbox` and the corners
MAX_SIDE: Final = 300.0  # m


class House(NamedTuple):
    """A floor plan: one outline, free inside."""

    name: str
    outline: Array  # (k, 2) m, counter-clockwise, each corner once

    @property
    def walls(self) -> Array:
        """Closed loops (n, 4) [m]: the outline, and a frame far round it; between them is solid."""
        (x0, y0), (x1, y1) = self.outline.min(axis=0) - FRAME, self.outline.max(axis=0) + FRAME
        frame = np.array([(x0, y0), (x1, y0), (x1, y1), (x0, y1)])
        return np.vstack([polygon_edges(frame), polygon_edges(self.outline[::-1])])

    def grid(self, resolution: float = 0.05) -> OccupancyGrid:
        """The house as cells [m]: one that is not wholly inside the outline is occupied."""
        low, high = self.outline.min(axis=0) - MARGIN, self.outline.max(axis=0) + MARGIN
        columns, rows = np.ceil((high - low) / resolution).astype(int)
        check_cells(rows, columns, self.name)
        inside, cut = cells_of_outline((self.outline - low) / resolution, (rows, columns))
        cells = np.where(inside & ~cut, FREE, OCCUPIED).astype(np.int8)
        return OccupancyGrid(cells, resolution, (float(low[0]), float(low[1]), 0.0))


def cells_of_outline(outline: Array, shape: tuple[int, int]) -> tuple[Mask, Mask]:
    """Return cells with their centre inside an outline (k, 2) [cells], and those its edges cut."""
    rows, columns = shape
    inside, cut = np.zeros(shape, dtype=np.bool_), np.zeros(shape, np.bool_)
    for (ax, ay), (bx, by) in zip(outline, np.roll(outline, -1, axis=0), strict=True):
        # Only rows that the edge reaches: an outline of many corners costs its length.
        part = slice(max(0, int(min(ay, by)) - 1), max(0, int(max(ay, by)) + 2))
        y = np.arange(rows)[part, None] + 0.5  # centres
        x = np.arange(columns) + 0.5
        if ay != by:
            straddles = (ay <= y) != (by <= y)
            inside[part] ^= straddles & (ax + (y - ay) / (by - ay) * (bx - ax) > x)
        # Cells through whose inside the edge passes: no axis parts it from them.
        ex, ey = bx - ax, by - ay
        near = np.abs(ex * (y - ay) - ey * (x - ax)) < 0.5 * (abs(ex) + abs(ey)) - TOUCH
        near &= (x + 0.5 > min(ax, bx) + TOUCH) & (x - 0.5 < max(ax, bx) - TOUCH) | (ex == 0.0)
        near &= (y + 0.5 > min(ay, by) + TOUCH) & (y - 0.5 < max(ay, by) - TOUCH) | (ey == 0.0)
        cut[part] |= near
    return inside, cut


def read_house(path: str | Path) -> House:
    """The floor plan of a HouseExpo file.

    Raises:
        InputError: the file cannot be read, a key is missing, or the outline is none.
    """
    path = Path(path)
    data = read_json(path)
    if not isinstance(data, Mapping) or "verts" not in data:
        raise InputError(f"{path}: verts is missing; expected a HouseExpo floor plan")
    corners = np.array(coordinate_lists(data["verts"], 2, f"{path}: verts")).reshape(-1, 2)
    outline = corners[np.any(corners != np.roll(corners, 1, axis=0), axis=1)]
    if len(outline) < 3:
        raise InputError(f"{path}: verts has {len(outline)} corners; expected at least 3")
    low, high = outline.min(axis=0), outline.max(axis=0)
    if (high - low).max() > MAX_SIDE:
        raise InputError(f"{path}: verts span {(high - low).max():g} m; expected {MAX_SIDE:g} m")
    box = data.get("bbox")
    if box is not None:
        if not isinstance(box, Mapping) or not {"min", "max"} <= set(box):
            raise InputError(f"{path}: bbox is {shorten(box)}; expected min and max")
        given = np.array(coordinate_lists([box["min"], box["max"]], 2, f"{path}: bbox"))
        if np.abs(given - [low, high]).max() > SLACK:
            found = f"{low.tolist()} to {high.tolist()}"
            raise InputError(f"{path}: bbox is {given.tolist()}; expected that of verts, {found}")
    area = signed_area(outline)
    if area == 0.0:
        raise InputError(f"{path}: verts enclose nothing; expected an outline")
    return House(str(data.get("id", path.stem)), outline if area > 0.0 else outline[::-1])
