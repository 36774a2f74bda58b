"""Map files of cells: map_server's YAML files that describe an image, and those of MovingAI.

The whiteness g of a pixel, 0 to 1, is occupancy p = 1 - g, or g where the file says negate. The
image is flipped: its lowest row is row 0 of the grid. Mode trinary knows occupied, free and
unknown; scale keeps degrees between the thresholds; raw takes the values 255 g up to 100 as they
are, and the rest for unknown. A pixel that is not opaque is never free: scale and raw take it for
unknown; trinary averages its opacity in with its colours, as nav2_map_server does, and keeps what
that makes occupied. nav2 averages opaque pixels, too, which makes unknown greys free: here their
colours alone count. In mode raw nav2 does not look at opacity. PGM and PPM files are decoded here,
because a sample is a share of the `maxval` of their header; OpenCV decodes the other formats, and a
rotation by EXIF is applied.

A MovingAI map (`.map` of type octile) is text, its top row first: '.' and 'G' are ground, 'S' is
swamp, all free; '@' and 'O' are out of bounds, 'T' trees and 'W' water, all solid. It has no scale:
a cell is one metre if not told (Sturtevant 2012, Benchmarks for grid-based pathfinding).
"""

import io
import math
import re
import warnings
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path, PureWindowsPath
from typing import Any, Final, Literal, NamedTuple

import cv2
import numpy as np
import yaml
from numpy.typing import NDArray

from wheelchair_gym.base import files
from wheelchair_gym.base.errors import InputError, shorten
from wheelchair_gym.base.files import LIMITS, check_cells, read_bytes, read_text
from wheelchair_gym.maps.grid import FREE, OCCUPIED, UNKNOWN, OccupancyGrid

Samples = NDArray[Any]  # unsigned integers

_FORMATS = ("PNG", "PPM", "BMP", "JPEG", "TIFF")
_GAP: Final = rb"(?:\s|#[^\r\n]*[\r\n])+"
_COMMENT: Final = re.compile(rb"#[^\r\n]*")
# Magic number, columns, rows and maxval; then one blank, or a comment's line.
_HEADER: Final = re.compile(rb"P([2356])" + 3 * (_GAP + rb"(\d+)") + rb"(?:\s|#[^\r\n]*[\r\n])")
_EXIF_ORIENTATION: Final = 0x0112


class Picture(NamedTuple):
    """The pixels of an image, top row first."""

    levels: Samples  # (rows, cols): the grey sample, or the sum of red, green and blue
    white: int  # the level of white; black is 0
    alpha: Samples | None = None  # (rows, cols); None where all pixels are opaque
    opaque: int = 255  # the largest alpha

    @property
    def whiteness(self) -> NDArray[np.float64]:
        """The share of white of each level (white + 1,)."""
        return np.arange(self.white + 1) / self.white


def read_picture(path: Path) -> Picture:
    """Read an image file.

    Raises:
        InputError: the image cannot be read, or is too large.
    """
    from PIL import Image  # only here, where the header alone is read

    content = read_bytes(path, "image")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of its own, looser limit
            header = Image.open(io.BytesIO(content), formats=_FORMATS)
    except Exception:  # whatever Pillow makes of damaged bytes
        raise _undecodable(path) from None
    columns, rows = header.size
    check_cells(rows, columns, str(path))
    # As OpenCV decodes it: 16 bits where the format has them, and every channel.
    size = rows * columns * max(1, len(header.getbands())) * (1 if "8" in header.mode else 2)
    if size > LIMITS["decoded"].maximum:
        raise InputError(
            f"{path}: {size:,} bytes of pixels; expected at most {LIMITS['decoded'].maximum:,}"
        )
    if header.format == "PPM" and header.mode != "1":
        return _netpbm(content, path)
    image = _decoded(content, path)
    if header.format == "JPEG" or b"eXIf" in content:  # OpenCV turns TIFF itself
        try:
            image = _turned(image, header.getexif().get(_EXIF_ORIENTATION, 1))
        except Exception:
            raise _undecodable(path) from None
    transparent = "transparency" in header.info or "A" in header.getbands()
    if transparent and (image.ndim == 2 or image.shape[2] != 4):
        raise InputError(f"{path}: its transparency cannot be decoded; expected a PNG with alpha")
    maximum = int(np.iinfo(image.dtype).max)
    if image.ndim == 2:
        return Picture(image, maximum)
    levels = image[..., :3].sum(axis=-1, dtype=np.uint32)
    return Picture(levels, 3 * maximum, image[..., 3] if image.shape[2] == 4 else None, maximum)


def _undecodable(path: Path) -> InputError:
    return InputError(f"{path}: not an image that can be decoded; expected PGM or PNG")


def _decoded(content: bytes, path: Path) -> Samples:
    """Decode an image (rows, cols) or (rows, cols, 3 or 4) of 8 or 16 bits with OpenCV."""
    level = cv2.utils.logging.getLogLevel()
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)  # the error below says it
    try:
        image = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error:
        image = None
    finally:
        cv2.utils.logging.setLogLevel(level)
    if image is None or image.size == 0:
        raise _undecodable(path)
    if image.dtype not in (np.uint8, np.uint16):
        raise InputError(f"{path}: pixels are {image.dtype}; expected 8 or 16 bits each")
    return image


def _turned(image: Samples, orientation: int) -> Samples:
    """Apply an orientation of EXIF, 1 to 8, to an image; other values count as 1."""
    if orientation in (5, 6, 7, 8):
        image = np.swapaxes(image, 0, 1)
    if orientation in (3, 4, 7, 8):
        image = image[::-1]
    if orientation in (2, 3, 6, 7):
        image = image[:, ::-1]
    return image


def _netpbm(content: bytes, path: Path) -> Picture:
    """Decode a PGM or PPM, as text (P2, P3) or binary (P5, P6)."""
    found = _HEADER.match(content)
    if found is None:
        raise _undecodable(path)
    kind, columns, rows, white = map(int, found.groups())
    shape, body = (rows, columns, 3 if kind in (3, 6) else 1), content[found.end() :]
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")  # older numpy warns where it finds no number
            samples: Samples = (
                np.fromstring(_COMMENT.sub(b" ", body), np.int64, sep=" ")[: math.prod(shape)]
                if kind < 5
                else np.frombuffer(body, ">u2" if white > 255 else "u1", math.prod(shape))
            ).reshape(shape)
    except (ValueError, DeprecationWarning):  # too few samples, or no numbers
        raise _undecodable(path) from None
    low, high = samples.min(), samples.max()
    if not 0 <= low <= high <= white:
        worst = low if low < 0 else high
        raise InputError(f"{path}: a sample is {worst}; expected 0 to {white}, its maxval")
    return Picture(samples.sum(axis=-1, dtype=np.uint32), shape[2] * white)


MODES: Final = ("trinary", "scale", "raw")
Cells = NDArray[np.int8]

_KEYS = ("image", "resolution", "origin", "negate", "occupied_thresh", "free_thresh")
_THRESHOLDS: Final = (0.65, 0.196)  # occupancy from which cells are occupied, up to which free
_GREYS: Final = {FREE: 255, OCCUPIED: 0, UNKNOWN: 205}  # that are written


def _meaning(white: int, mode: str, negate: bool, occupied: float, free: float) -> Cells:
    """Return the cell value of each level from black, 0, to white."""
    level = np.arange(white + 1)
    if mode == "raw":
        value = np.rint(255 * level / white)
        return np.where(value <= OCCUPIED, value, UNKNOWN).astype(np.int8)
    p = (level if negate else white - level) / white
    between = np.full(white + 1, UNKNOWN)
    if mode == "scale":
        between = np.rint(100 * (p - free) / (occupied - free)).astype(int)
    value = np.where(p >= occupied, OCCUPIED, np.where(p <= free, FREE, between))
    return value.astype(np.int8)


def _number(data: Mapping[str, Any], key: str, path: Path, low: float, high: float) -> float:
    value = data[key]
    if isinstance(value, bool) or not isinstance(value, int | float) or not low <= value <= high:
        raise InputError(
            f"{path}: {key} is {shorten(value)}; expected a number from {low:g} to {high:g}"
        )
    return float(value)


def _description(path: Path) -> dict[str, Any]:
    # Bytes that are no UTF-8 stand in comments; in a key or a value they make it a wrong one.
    data = files.parse_yaml(files.read_text(path, "yaml", errors="replace"), path)
    if not isinstance(data, dict):
        raise InputError(f"{path}: expected keys {', '.join(_KEYS)}")
    if "free_thresh" not in data and "occupied_thresh" in data:
        _warn(f"{path}: free_thresh is missing; {_THRESHOLDS[1]} is used")
        data["free_thresh"] = _THRESHOLDS[1]
    for key in _KEYS:
        if key not in data:
            raise InputError(f"{path}: {key} is missing; expected {', '.join(_KEYS)}")
    return data


def _warn(text: str) -> None:
    warnings.warn(text, stacklevel=2)


def _image_file(path: Path, name: Any) -> Path:
    """Return the image that a YAML file names, or one of that name beside the YAML file.

    Raises:
        InputError: the name is none, or there is no such file.
    """
    if not isinstance(name, str) or not name:
        raise InputError(f"{path}: image is {shorten(name)}; expected a file name")
    named, beside = path.parent / name, path.parent / PureWindowsPath(name).name
    if files.exists(named):
        return named
    if not files.exists(beside):
        places = " or ".join(dict.fromkeys(f"{str(place)!r:.1000}" for place in (named, beside)))
        raise InputError(f"{path}: image is {shorten(name)}; there is no file {places}")
    _warn(f"{path}: image is {shorten(name)}, which is missing; {beside} is used")
    return beside


def map_files(spec: Any) -> list[Path]:
    """Return the files that nested settings name by `path`, and the images of map_server's."""
    if isinstance(spec, list | tuple):
        return [file for each in spec for file in map_files(each)]
    if isinstance(spec, Mapping):
        paths = spec.get("path")
        named = paths if isinstance(paths, list | tuple) else [paths]
        found = [file for path in named if path and isinstance(path, str) for file in _parts(path)]
        return found + map_files([*spec.values()])
    return []


def _parts(name: str) -> list[Path]:
    """Return a file, and the image that it names; what is wrong with them is said elsewhere."""
    path = Path(name)
    if path.suffix.lower() in (".yaml", ".yml"):
        with suppress(InputError, KeyError, TypeError):
            data = files.parse_yaml(files.read_text(path, "yaml", errors="replace"), path)
            return [path, _image_file(path, data["image"])]
    return [path]


def read_map(path: str | Path) -> OccupancyGrid:
    """The grid that a map_server YAML file and its image describe.

    Raises:
        InputError: a file is missing or broken, a key is missing or its value makes no sense.
    """
    path = Path(path)
    data = _description(path)
    mode = str(data.get("mode", "trinary")).lower()
    if mode not in MODES:
        raise InputError(f"{path}: mode is {shorten(mode)}; expected one of {', '.join(MODES)}")
    negate = data["negate"]
    if negate not in (0, 1):
        raise InputError(f"{path}: negate is {shorten(negate)}; expected 0 or 1")
    resolution = _number(data, "resolution", path, 1e-4, 1e3)
    occupied = _number(data, "occupied_thresh", path, 0.0, 1.0)
    free = _number(data, "free_thresh", path, 0.0, 1.0)
    if free >= occupied:
        raise InputError(f"{path}: free_thresh is {free}; expected less than occupied_thresh")
    x, y, yaw = (*files.coordinates(data["origin"], (2, 3), f"{path}: origin"), 0.0)[:3]
    picture = read_picture(_image_file(path, data["image"]))
    values = _meaning(picture.white, mode, bool(negate), occupied, free)
    cells = values[picture.levels]
    saved, off = divmod(_GREYS[UNKNOWN] * picture.white, 255)
    if mode == "trinary" and not off and values[saved] == FREE and (picture.levels == saved).any():
        _warn(
            f"{path}: free_thresh {free:g} reads the grey {_GREYS[UNKNOWN]}, which map savers "
            "write for unknown cells, as free; 0.196 reads it as unknown"
        )
    if picture.alpha is not None:
        clear = picture.alpha < picture.opaque
        cells[clear] = UNKNOWN
        if mode == "trinary":
            white = picture.whiteness[picture.levels[clear]]
            shade = (3.0 * white + picture.alpha[clear] / picture.opaque) / 4.0
            p = shade if negate else 1.0 - shade
            cells[clear] = np.where(p > occupied, OCCUPIED, UNKNOWN)
    grid = OccupancyGrid(np.flipud(cells), resolution, (x, y, yaw))
    if not all(map(files.is_coordinate, grid.bounds)):
        raise InputError(
            f"{path}: reaches from {grid.bounds[:2]} to {grid.bounds[2:]} m; "
            f"expected coordinates up to {files.LIMITS['coordinate'].maximum:,} m"
        )
    return grid


def write_map(
    grid: OccupancyGrid, path: str | Path, *, suffix: Literal[".pgm", ".png"] = ".pgm"
) -> None:
    """Write a map_server YAML file, and its image beside it; `read_map` gives the same grid.

    Raises:
        InputError: a cell is neither free, occupied nor unknown, or a file cannot be written.
    """
    path = Path(path)
    cells = np.flipud(grid.cells)
    image = np.select([cells == value for value in _GREYS], list(_GREYS.values()), -1)
    if (image < 0).any():
        value = int(cells[image < 0][0])
        raise InputError(f"{path}: mode trinary cannot hold the cell value {value} as {suffix}")
    data = {
        "image": path.with_suffix(suffix).name,
        "mode": "trinary",
        "resolution": float(grid.resolution),
        "origin": list(grid.origin),
        "negate": 0,
        "occupied_thresh": _THRESHOLDS[0],
        "free_thresh": _THRESHOLDS[1],
    }
    with files.atomic_write(path.with_suffix(suffix)) as part:
        part.write_bytes(cv2.imencode(suffix, image.astype(np.uint8))[1].tobytes())
    with files.atomic_write(path) as part:
        part.write_text(yaml.safe_dump(data, sort_keys=False), encoding="utf-8")


_DIGITS: Final = re.compile(r"[1-9][0-9]{0,17}")
PASSABLE: Final = ".GS"
SOLID: Final = "@OTW"


def _size(line: str, key: str, where: str) -> int:
    words = line.split()
    if len(words) != 2 or words[0] != key or not _DIGITS.fullmatch(words[1]):
        raise InputError(f"{where} is {line.strip()[:40]!r}; expected '{key} N', N at least 1")
    return int(words[1])


def read_moving_ai_map(path: str | Path, resolution: float = 1.0) -> OccupancyGrid:
    """The grid of a `.map` file with cells of a side [m]; its lower-left corner is (0, 0).

    Raises:
        InputError: the file cannot be read, or a line is not what the format says.
    """
    path = Path(path)
    lines = read_text(path).splitlines()
    head = [*lines[:4], *([""] * 4)][:4]
    if head[0].split() != ["type", "octile"]:
        raise InputError(f"{path}: line 1 is {head[0][:40]!r}; expected 'type octile'")
    height = _size(head[1], "height", f"{path}: line 2")
    width = _size(head[2], "width", f"{path}: line 3")
    if head[3].strip() != "map":
        raise InputError(f"{path}: line 4 is {head[3][:40]!r}; expected 'map'")
    check_cells(height, width, str(path))
    rows = [line.rstrip("\r\n") for line in lines[4:]]
    while len(rows) > height and not rows[-1].strip():
        rows.pop()
    if len(rows) != height:
        raise InputError(f"{path}: has {len(rows)} rows; expected height {height}")
    cells = np.empty((height, width), dtype=np.int8)
    for k, row in enumerate(rows):
        if len(row) != width:
            raise InputError(f"{path}: line {k + 5} has {len(row)} cells; expected width {width}")
        for column, sign in enumerate(row if row.strip(PASSABLE + SOLID) else ""):
            if sign not in PASSABLE + SOLID:
                place = f"{path}: line {k + 5}, column {column + 1}"
                raise InputError(f"{place} is {sign!r}; expected one of {PASSABLE + SOLID}")
        letters = np.frombuffer(row.encode("ascii"), dtype=np.uint8)
        solid = np.isin(letters, np.frombuffer(SOLID.encode("ascii"), dtype=np.uint8))
        cells[height - 1 - k] = np.where(solid, OCCUPIED, FREE)
    return OccupancyGrid(cells, resolution)
