"""Floor plans: an image from a paint program, a JSON file of polygons, or one of HouseExpo.

An image is dark where something stands; what is transparent is free, and its border is a wall. It
says nothing of its size: the edge of a pixel in metres is told beside it. Its lower left corner is
the origin.

A JSON file holds `polygons`, solid ones, each a list of corners [x, y] in metres, which may overlap
and reach beyond the bounds. It may hold `bounds` [xmin, ymin, xmax, ymax], round which a wall
stands; without them it stands 1 m away.

A JSON file of HouseExpo holds one outline in metres; all outside of it is solid. `verts` holds the
corners in order, `bbox` their least and greatest coordinates, `room_category` the boxes of rooms by
kind (Li et al. 2019, HouseExpo: a large-scale 2D indoor layout dataset).
"""

import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np

from wheelchair_gym.base import files
from wheelchair_gym.base.arrays import Array, Mask
from wheelchair_gym.base.errors import InputError, shorten
from wheelchair_gym.geometry.planar import polygon_edges, signed_area
from wheelchair_gym.maps.grid import FREE, OCCUPIED, OccupancyGrid
from wheelchair_gym.maps.io.map_server import read_picture

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
        files.check_cells(rows, columns, self.name)
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
    data = files.read_json(path)
    if not isinstance(data, Mapping) or "verts" not in data:
        raise InputError(f"{path}: verts is missing; expected a HouseExpo floor plan")
    corners = np.array(files.coordinate_lists(data["verts"], 2, f"{path}: verts")).reshape(-1, 2)
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
        given = np.array(files.coordinate_lists([box["min"], box["max"]], 2, f"{path}: bbox"))
        if np.abs(given - [low, high]).max() > SLACK:
            found = f"{low.tolist()} to {high.tolist()}"
            raise InputError(f"{path}: bbox is {given.tolist()}; expected that of verts, {found}")
    area = signed_area(outline)
    if area == 0.0:
        raise InputError(f"{path}: verts enclose nothing; expected an outline")
    return House(str(data.get("id", path.stem)), outline if area > 0.0 else outline[::-1])


IMAGES: Final = (".png", ".jpg", ".jpeg", ".bmp", ".pgm", ".ppm", ".tif", ".tiff")
DARK: Final = 192  # of 255: a pixel below is occupied, so that greys are
DOUBTFUL: Final = 0.01  # share of grey pixels from which a warning says so: edges have fewer
SPACE: Final = 1.0  # m of free space round polygons without bounds
WALL: Final = 0.1  # m: of the wall round the bounds
CELL: Final = 0.05  # m
MERGED: Final = 1e-9  # m: polygons closer together than this touch


def read_floor_plan_image(path: str | Path, resolution: float) -> OccupancyGrid:
    """The grid of an image whose pixels are `resolution` [m] wide.

    Raises:
        InputError: the image cannot be read, the resolution makes no sense, or nothing is free.
    """
    path = Path(path)
    if not 1e-4 <= resolution <= 10.0:
        raise InputError(f"{path}: resolution is {resolution:g}; expected metres, 0.0001 to 10")
    picture = read_picture(path)
    white = picture.whiteness[picture.levels]
    if picture.alpha is not None:
        opacity = picture.alpha / picture.opaque
        white = white * opacity + (1 - opacity)  # on white paper
    cells = np.where(white < DARK / 255, OCCUPIED, FREE).astype(np.int8)
    doubtful = float(((white > 0.25) & (white < 0.75)).mean())
    if doubtful > DOUBTFUL:
        warnings.warn(
            f"{path}: {doubtful:.0%} of its pixels are grey; darker than {DARK} of 255 is solid, "
            "the rest is free",
            stacklevel=2,
        )
    cells[[0, -1]] = cells[:, [0, -1]] = OCCUPIED
    if not (cells == FREE).any():
        raise InputError(f"{path}: all of it is dark; expected white where the chair may drive")
    grid = OccupancyGrid(np.flipud(cells), resolution, (0.0, 0.0, 0.0))
    if not all(map(files.is_coordinate, grid.bounds)):
        maximum = files.LIMITS["coordinate"].maximum
        raise InputError(f"{path}: is larger than {maximum:,} m; expected a smaller resolution")
    return grid


def polygons_map(data: Mapping[str, Any], path: str | Path) -> tuple[OccupancyGrid, Array]:
    """Return the grid of a floor plan of polygons, and its exact walls (n, 4) [m].

    The polygons and the frame round the bounds are united: loops of walls neither cross nor
    overlap, and have what is solid on their left.

    Raises:
        InputError: a polygon or the bounds make no sense.
    """
    for key in data:
        if key not in ("polygons", "bounds", "name"):
            raise InputError(f"{path}: {shorten(key)} is unknown; expected polygons, bounds, name")
    polygons = data["polygons"]
    if not isinstance(polygons, list) or not (polygons or "bounds" in data):
        raise InputError(f"{path}: polygons is no list of polygons, or empty without bounds")
    outlines = []
    for k, polygon in enumerate(polygons):
        where = f"{path}: polygons[{k}]"
        corners = np.array(files.coordinate_lists(polygon, 2, where)).reshape(-1, 2)
        if len(corners) < 3 or signed_area(corners) == 0.0:
            raise InputError(f"{where} encloses nothing; expected at least 3 corners [x, y]")
        outlines.append(corners)
    if "bounds" in data:
        bounds = files.coordinates(data["bounds"], (4,), f"{path}: bounds")
        low, high = np.array(bounds).reshape(2, 2)
    else:
        every = np.vstack(outlines)
        low, high = every.min(axis=0) - SPACE, every.max(axis=0) + SPACE
    if not (low < high).all() or (high - low).max() > MAX_SIDE:
        sides = f"{(high - low).tolist()} m"
        raise InputError(f"{path}: bounds span {sides}; expected more than 0, up to {MAX_SIDE:g}")
    corner = low - WALL
    columns, rows = np.ceil((high - low + 2 * WALL) / CELL - 1e-9).astype(int)
    files.check_cells(rows, columns, str(path))
    box = np.array([low, (high[0], low[1]), high, (low[0], high[1])])
    inside, cut = cells_of_outline((box - corner) / CELL, (rows, columns))
    solid = ~inside | cut
    for outline in outlines:
        within, cut = cells_of_outline((outline - corner) / CELL, (rows, columns))
        solid |= within | cut
    cells = np.where(solid, OCCUPIED, FREE).astype(np.int8)
    grid = OccupancyGrid(cells, CELL, (float(corner[0]), float(corner[1]), 0.0))
    return grid, _united(outlines, low, high)


def _united(outlines: list[Array], low: Array, high: Array) -> Array:
    """Return the walls (n, 4) [m] of overlapping polygons and of a frame round the bounds."""
    import shapely  # only here: other maps load without it

    box = shapely.box(*(low - WALL), *(high + WALL))
    solids = [shapely.make_valid(shapely.Polygon(corners)) for corners in outlines]
    solids = [shapely.intersection(solid, box) for solid in solids]
    solids.append(shapely.difference(box, shapely.box(*low, *high)))
    united = shapely.orient_polygons(shapely.union_all(solids, grid_size=MERGED))
    polygons = [part for part in shapely.get_parts(united) if part.geom_type == "Polygon"]
    loops = [shapely.get_coordinates(ring)[:-1] for ring in shapely.get_rings(polygons)]
    return np.vstack([polygon_edges(loop) for loop in loops])
