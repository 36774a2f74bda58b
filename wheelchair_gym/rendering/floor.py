"""Static parts of a picture: bounds, floor, map, solids, goal and start, caption strip."""

import math
from typing import Any

import cv2
import numpy as np
from numpy.typing import ArrayLike

from wheelchair_gym.base.arrays import Array
from wheelchair_gym.maps import FREE, OCCUPIED, UNKNOWN, OccupancyGrid
from wheelchair_gym.rendering import palette
from wheelchair_gym.rendering.canvas import Canvas, Frame, text_width, write_text

FINE = 2  # the background is drawn with this many times the pixels, then brought down
_STRIP = 0.047  # the caption strip's share of the long side
_STRIP_MIN = 26  # pixels: smaller captions cannot be read
_NO_STRIP = 200  # pixels: pictures with a shorter long side are for programs, and have no caption
_CAPITAL = 0.36  # height of a capital, as a share of the strip
_SHRINK = 0.6  # a caption too long is written smaller, down to this; then it loses words


def closed_loops(walls: ArrayLike) -> list[Array]:
    """Chain walls (n, 4) [m] into closed loops, each (k, 2), that the even-odd rule can fill.

    Where more than two walls meet, any way of chaining them fills the same points. A chain that
    does not close is left out: it is solid on neither side.
    """
    segments = np.asarray(walls, dtype=np.float64).reshape(-1, 2, 2)
    keys = [tuple(map(tuple, ends)) for ends in np.rint(segments * 1e6).astype(np.int64).tolist()]
    meeting: dict[tuple[int, ...], list[int]] = {}
    for k, ends in enumerate(keys):
        for end in ends:
            meeting.setdefault(end, []).append(k)
    used = [False] * len(keys)
    found = []
    for first in range(len(keys)):
        if used[first]:
            continue
        used[first] = True
        home, here = keys[first]
        chain = [segments[first, 0], segments[first, 1]]
        while here != home:
            k = next((other for other in reversed(meeting[here]) if not used[other]), -1)
            if k < 0:
                break
            used[k] = True
            far = 1 if keys[k][0] == here else 0
            here = keys[k][far]
            chain.append(segments[k, far])
        if here == home and len(chain) > 2:
            found.append(np.array(chain[:-1]))
    return found


def known_area(grid: OccupancyGrid) -> Array:
    """Corners (4, 2) [m] of the smallest part of the grid that holds every known cell."""
    known = np.argwhere(grid.cells != UNKNOWN)
    low, high = np.zeros(2), np.array(grid.shape)
    if len(known):
        low, high = known.min(axis=0), known.max(axis=0) + 1
    corners = np.array([(low[1], low[0]), (high[1], low[0]), (high[1], high[0]), (low[1], high[0])])
    return grid.from_lattice(corners)


def bounding_box(points: ArrayLike, margin: float) -> Array:
    """Bounds (xmin, ymin, xmax, ymax) [m] of points (n, 2), with a margin on each side."""
    p = np.asarray(points, dtype=np.float64)
    p = p[np.isfinite(p).all(axis=-1)]
    return np.concatenate([p.min(axis=0) - margin, p.max(axis=0) + margin])


def new_canvas(bounds: ArrayLike, size: int | tuple[int, int]) -> Canvas:
    """An empty canvas for bounds [m], with a strip for the caption below the world.

    Args:
        bounds: xmin, ymin, xmax, ymax [m].
        size: height and width [pixels], the world in their middle; or the long side alone: the
            world then gives the shape.

    Returns:
        A canvas with even sides, as video encoders ask for.

    Raises:
        ValueError: a side is under 64 pixels.
    """
    x0, y0, x1, y1 = np.asarray(bounds, dtype=np.float64)
    if isinstance(size, int):
        strip = strip_height(size)
        scale = min(size / (x1 - x0), (size - strip) / (y1 - y0))
        # A very long world still leaves room for a caption.
        height = max(round(scale * (y1 - y0)) + strip, 64)
        width = max(round(scale * (x1 - x0)), min(size, 320))
    else:
        height, width = size
    height, width = height + height % 2, width + width % 2
    if min(height, width) < 64:
        raise ValueError(f"size is {size}; a picture has at least 64 pixels a side")
    image = np.empty((height, width, 3), dtype=np.uint8)
    image[:] = palette.UNKNOWN
    long_side = max(height, width)
    room = height - strip_height(long_side)
    scale = min(width / (x1 - x0), room / (y1 - y0))  # centred
    left, bottom = 0.5 * width - scale * 0.5 * (x0 + x1), 0.5 * room + scale * 0.5 * (y0 + y1)
    return Canvas(image, Frame(scale, left, bottom), stroke_scale(long_side))


def stroke_scale(long_side: int) -> float:
    """The factor of stroke widths in a picture with this long side [pixels]."""
    return max(min(1.0, long_side / _NO_STRIP), long_side / 640.0)


def strip_height(long_side: int) -> int:
    """Height of the caption strip [pixels]; 0 in a picture too small for one."""
    return 0 if long_side < _NO_STRIP else max(_STRIP_MIN, round(_STRIP * long_side))


def draw_grid(canvas: Canvas, grid: OccupancyGrid) -> None:
    """Colour each pixel as the map's cell under it: free, occupied or unknown."""
    cells = grid.cells
    shades = np.empty((*cells.shape, 3), dtype=np.uint8)
    shades[:] = palette.UNKNOWN
    shades[cells == FREE] = palette.FREE
    shades[cells == OCCUPIED] = palette.MAPPED
    x, y, yaw = grid.origin
    c, s, step = math.cos(yaw), math.sin(yaw), grid.resolution
    frame = canvas.frame
    # From a pixel's centre to the world, then to cells; OpenCV's integers are centres of both.
    to_map = np.array([[1, 0, 0.5 - frame.left], [0, -1, frame.bottom - 0.5]]) / frame.scale
    turn = np.array([[c, s], [-s, c]]) / step
    warp = turn @ to_map
    warp[:, 2] -= turn @ (x, y) + 0.5
    h, w = canvas.image.shape[:2]
    flags = cv2.INTER_NEAREST | cv2.WARP_INVERSE_MAP
    laid: Any = cv2.warpAffine(
        shades, warp, (w, h), flags=flags, borderMode=cv2.BORDER_CONSTANT,
        borderValue=palette.UNKNOWN,
    )  # fmt: skip
    canvas.image[:] = laid


def draw_obstacles(canvas: Canvas, walls: ArrayLike, discs: ArrayLike) -> None:
    """Fill what the walls (n, 4) enclose and the discs (m, 3) [m]."""
    segments = np.asarray(walls, dtype=np.float64).reshape(-1, 4)
    canvas.fill(closed_loops(segments), palette.SOLID)
    canvas.segments(segments, palette.SOLID)
    for x, y, radius in np.asarray(discs, dtype=np.float64).reshape(-1, 3):
        canvas.disc((x, y), radius, palette.SOLID)


def draw_goal(canvas: Canvas, goal: ArrayLike, tolerance: float) -> None:
    """The goal, and within which circle it counts as reached."""
    canvas.disc(goal, tolerance, palette.GOAL, 0.22)
    canvas.ring(goal, tolerance, palette.GOAL, 2.0)
    canvas.dot(goal, 3.5, palette.GOAL)


def draw_start(canvas: Canvas, start: ArrayLike) -> None:
    """The start: a hollow circle, with a tick towards the heading where there is one."""
    s = np.asarray(start, dtype=np.float64)
    if len(s) > 2:
        tick = 14.0 * canvas.stroke_scale / canvas.frame.scale
        tip = s[:2] + tick * np.array([math.cos(s[2]), math.sin(s[2])])
        canvas.line([s[:2], tip], palette.START, 2.0)
    canvas.dot(s, 6.0, palette.START)
    canvas.dot(s, 3.5, palette.FREE)


def draw_scale_bar(canvas: Canvas) -> None:
    """Clear the caption strip and put a scale bar at its right end."""
    h, w = canvas.image.shape[:2]
    strip = strip_height(max(h, w) // FINE) * FINE
    if strip == 0:
        return
    image = canvas.image[h - strip :]
    image[:] = palette.PAPER
    image[: max(1, round(canvas.stroke_scale))] = palette.RULE
    capital = _CAPITAL * strip
    label, start, left = _scale_bar(w, canvas.frame.scale, strip)
    right, middle = w - 0.5 * strip, round(0.5 * strip)
    stroke = max(1, round(1.5 * canvas.stroke_scale))
    image[middle : middle + stroke, left : round(right)] = palette.INK
    for end in (left, round(right) - stroke):
        image[
            middle - round(0.14 * strip) : middle + round(0.14 * strip) + 1, end : end + stroke
        ] = palette.INK
    write_text(image, label, (start, 0.5 * strip + 0.5 * capital), capital, palette.INK)


def _scale_bar(width: float, scale: float, strip: int) -> tuple[str, float, int]:
    """A scale bar's label, and the columns where the label and the bar begin [pixels].

    The bar is the longest of 1, 2, 5 times a power of ten that takes at most 0.18 of the width.
    """
    wanted = 0.18 * width / scale
    power = 10.0 ** math.floor(math.log10(wanted))
    length = max(m * power for m in (1, 2, 5) if m * power <= wanted * (1 + 1e-9))
    label = f"{length:g} m"
    left = round(width - 0.5 * strip - length * scale)
    return label, left - text_width(label, _CAPITAL * strip) - 0.3 * strip, left


def write_caption(canvas: Canvas, text: str) -> None:
    """Write a line into the caption strip of a finished picture; it ends before the scale bar."""
    image = canvas.image
    h, w = image.shape[:2]
    strip = strip_height(max(h, w))
    if strip == 0:
        return
    # Everything is measured at the pixels at which it is drawn.
    tall = FINE * strip
    _, end, _ = _scale_bar(FINE * w, FINE * canvas.frame.scale, tall)
    room, full, minimum = end - 0.75 * tall, _CAPITAL * tall, _SHRINK * _CAPITAL * tall
    while text_width(text, minimum) > room and " " in text.strip():
        text = text.rstrip().rpartition(" ")[0]
    if not text.strip() or text_width(text, minimum) > room:
        return
    capital = max(minimum, min(full, full * room / text_width(text, full)))
    if text_width(text, capital) > room:  # strokes have whole widths: not quite in proportion
        capital = minimum
    part = image[h - strip + 2 :, : math.ceil(end / FINE)]
    fine: Any = cv2.resize(part, None, fx=FINE, fy=FINE, interpolation=cv2.INTER_NEAREST)
    baseline = 0.5 * tall + 0.5 * capital - 2 * FINE
    write_text(fine, text, (0.45 * tall, baseline), capital, palette.INK)
    size = (part.shape[1], part.shape[0])
    part[:] = cv2.resize(fine, size, interpolation=cv2.INTER_AREA)
