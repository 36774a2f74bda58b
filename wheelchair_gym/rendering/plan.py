"""A plan in its space: solids, tree, swarm, path, optimum, outlines of what moves, and a legend."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import ArrayLike

from wheelchair_gym.arrays import Array
from wheelchair_gym.geometry import polygon_edges
from wheelchair_gym.rendering import floor, palette
from wheelchair_gym.rendering.canvas import Canvas, Frame, Image, text_width, write_text
from wheelchair_gym.types import no_discs, no_walls

_TREE, _SWARM, _OUTLINE, _PATH, _OPTIMUM = 0.8, 0.9, 1.0, 4.0, 1.6  # widths [pixels]
_SWATCH = 2.2  # length of a line in the legend, in heights of its letters
_GAP = 1.4  # between two entries, likewise


def draw_plan(
    bounds: ArrayLike,
    start: ArrayLike,
    goal: ArrayLike,
    path: ArrayLike | None = None,
    tree: ArrayLike | None = None,
    *,
    walls: ArrayLike | None = None,
    discs: ArrayLike | None = None,
    polygons: Sequence[ArrayLike] = (),
    optimum: ArrayLike | None = None,
    swarm: Sequence[ArrayLike] = (),
    outlines: Sequence[ArrayLike] = (),
    tolerance: float = 0.0,
    size: int | tuple[int, int] = 640,
    caption: str = "",
    legend: bool = False,
) -> Image:
    """A picture (h, w, 3) RGB of a plan: solids, tree thin, path thick, optimum dashed.

    Args:
        bounds: xmin, ymin, xmax, ymax [m].
        start: (2,) or (3,) [m, m, rad].
        goal: (2,) or (3,).
        path: (n, 2 or 3) [m].
        tree: edges (k, 4) [m].
        walls: segments (n, 4) [m] of closed loops.
        discs: (m, 3) [m]: x, y, radius.
        polygons: closed loops (k, 2) [m], filled with the walls by the even-odd rule.
        optimum: the best path known (n, 2 or 3) [m].
        swarm: paths (n, 2 or 3) [m] that a swarm has tried.
        outlines: closed loops (k, 2) [m] of what moves, at places along the path.
        tolerance: how near the goal counts [m].
        size: height and width, or the long side alone [pixels]; a legend comes on top.
        caption: one line below the picture, ASCII.
        legend: say above the picture what is what.
    """
    box = np.asarray(bounds, dtype=np.float64)
    margin = 0.01 * float((box[2:] - box[:2]).max())
    canvas = floor.new_canvas(box + np.array([-margin, -margin, margin, margin]), size)
    fine = canvas.upsampled(floor.FINE)
    x0, y0, x1, y1 = box
    fine.fill([[(x0, y0), (x1, y0), (x1, y1), (x0, y1)]], palette.FREE)
    segments = [no_walls() if walls is None else np.asarray(walls, dtype=np.float64)]
    segments += [polygon_edges(polygon) for polygon in polygons]
    floor.draw_obstacles(fine, np.concatenate(segments), no_discs() if discs is None else discs)
    if tree is not None:
        fine.segments(tree, palette.TREE, _TREE)
    for particle in swarm:
        fine.line(particle, palette.SWARM, _SWARM)
    for outline in outlines:
        fine.line(outline, palette.OUTLINE, _OUTLINE, closed=True)
    if path is not None:
        fine.line(path, palette.TRAIL, _PATH)
    if optimum is not None:
        fine.dashes(optimum, palette.OPTIMUM, _OPTIMUM)
    if tolerance > 0.0:
        floor.draw_goal(fine, goal, tolerance)
    else:
        _mark_goal(fine, goal)
    floor.draw_start(fine, start)
    floor.draw_scale_bar(fine)
    picture = fine.downsampled(floor.FINE)
    floor.write_caption(picture, caption)
    if not legend:
        return picture.image
    entries: list[tuple[str, Callable[[Canvas, Array], None]]] = [
        ("start", lambda on, at: floor.draw_start(on, at.mean(axis=0))),
        ("goal", lambda on, at: _mark_goal(on, at.mean(axis=0))),
    ]
    if path is not None and len(np.asarray(path)):
        entries.append(("path", lambda on, at: on.line(at, palette.TRAIL, _PATH)))
    if optimum is not None:
        entries.append(("shortest", lambda on, at: on.dashes(at, palette.OPTIMUM, _OPTIMUM)))
    if tree is not None and len(np.asarray(tree)):
        entries.append(("tree", lambda on, at: on.line(at, palette.TREE, 2 * _TREE)))
    if len(swarm):
        entries.append(("swarm", lambda on, at: on.line(at, palette.SWARM, 2 * _SWARM)))
    if len(outlines):
        entries.append(("footprint", lambda on, at: on.line(at, palette.OUTLINE, 2 * _OUTLINE)))
    return np.vstack([_legend(entries, picture), picture.image])


def _mark_goal(canvas: Canvas, goal: ArrayLike) -> None:
    canvas.dot(goal, 7.0, palette.FREE)
    canvas.dot(goal, 5.5, palette.GOAL)


def _legend(entries: Sequence[tuple[str, Callable[[Canvas, Array], None]]], below: Canvas) -> Image:
    """Rows of swatches and words, as wide as the picture below them."""
    width = floor.FINE * below.image.shape[1]
    row = floor.FINE * floor.strip_height(max(below.image.shape[:2]))
    capital = 0.36 * row
    places, x, rows = [], capital, 1
    for label, _ in entries:
        needed = (_SWATCH + 0.6) * capital + text_width(label, capital)
        if x + needed > width - capital and x > capital:
            x, rows = capital, rows + 1
        places.append((x, (rows - 0.5) * row))
        x += needed + _GAP * capital
    # One metre is one pixel here, and y points up.
    image: Image = np.full((rows * row, width, 3), palette.PAPER, dtype=np.uint8)
    canvas = Canvas(image, Frame(1.0, 0.0, 0.0), below.stroke_scale * floor.FINE)
    for (left, middle), (label, swatch) in zip(places, entries, strict=True):
        swatch(canvas, np.array([(left, -middle), (left + _SWATCH * capital, -middle)]))
        at = (left + (_SWATCH + 0.6) * capital, middle + 0.5 * capital)
        write_text(image, label, at, capital, palette.INK)
    return canvas.downsampled(floor.FINE).image
