"""A plan in its space: solids, tree, swarm, path, roll-out, optimum, outlines, and a legend."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from wheelchair_gym.geometry import polygon_edges
from wheelchair_gym.rendering import floor, palette
from wheelchair_gym.rendering.canvas import Canvas, Image
from wheelchair_gym.rendering.legend import Entry, disc, line, with_legend
from wheelchair_gym.types import no_discs, no_walls

# Widths [pixels]; the last is the radius of a swarm's point.
_TREE, _SWARM, _OUTLINE, _PATH, _ROLLOUT, _OPTIMUM = 0.8, 0.9, 1.0, 4.0, 2.4, 1.6
_RAW, _POINT = 3.0, 4.0
_GOAL = disc("goal", palette.GOAL, palette.FREE)


@dataclass(frozen=True)
class PlanPicture:
    """What a picture of a plan shows: solids, tree thin, path thick, optimum dashed.

    Attributes:
        bounds: xmin, ymin, xmax, ymax [m].
        start: (2,) or (3,) [m, m, rad].
        goal: (2,) or (3,).
        path: (n, 2 or 3) [m].
        tree: edges (k, 4) [m].
        polygons: closed loops (k, 2) [m], filled by the even-odd rule.
        inflated: closed loops (k, 2) [m] of what is solid and kept free, filled likewise, paler.
        rollout: poses (n, 2 or 3) [m] that commands lead through; the path is then red, they blue.
        optimum: the best path known (n, 2 or 3) [m].
        raw: the tree's own path (n, 2) [m].
        swarm: words, colour, and a path (n, 2) or a point (1, 2) [m] that a swarm has tried.
        outlines: closed loops (k, 2) [m] of what moves, at places along the path.
    """

    bounds: ArrayLike
    start: ArrayLike
    goal: ArrayLike
    path: ArrayLike | None = None
    tree: ArrayLike | None = None
    polygons: Sequence[ArrayLike] = ()
    inflated: Sequence[ArrayLike] = ()
    rollout: ArrayLike | None = None
    optimum: ArrayLike | None = None
    raw: ArrayLike | None = None
    swarm: Sequence[tuple[str, palette.Colour, ArrayLike]] = ()
    outlines: Sequence[ArrayLike] = ()

    def draw(
        self, size: int | tuple[int, int] = 640, caption: str = "", legend: bool = False
    ) -> Image:
        """Return the picture (h, w, 3) RGB.

        Args:
            size: height and width, or the long side alone [pixels]; a legend comes on top.
            caption: one line below it, or with a legend as many above it as it takes; ASCII.
            legend: say above the picture what is what.
        """
        x0, y0, x1, y1 = box = np.asarray(self.bounds, dtype=np.float64)
        margin = 0.01 * float((box[2:] - box[:2]).max())
        canvas = floor.new_canvas(box + np.array([-margin, -margin, margin, margin]), size)
        fine = canvas.upsampled(floor.FINE)
        fine.fill([[(x0, y0), (x1, y0), (x1, y1), (x0, y1)]], palette.FREE)
        fine.fill(self.inflated, palette.MAPPED)
        edges = [no_walls(), *(polygon_edges(polygon) for polygon in self.polygons)]
        floor.draw_obstacles(fine, np.concatenate(edges), no_discs())
        self._draw_ways(fine)
        _GOAL[1](fine, np.atleast_2d(self.goal))
        floor.draw_start(fine, self.start)
        floor.draw_scale_bar(fine)
        picture = fine.downsampled(floor.FINE)
        if legend:
            return with_legend(picture.image, self._entries(), caption)
        floor.write_caption(picture, caption)
        return picture.image

    @property
    def _path_colour(self) -> palette.Colour:
        return palette.TRAIL if self.rollout is None else palette.VERMILION

    def _draw_ways(self, fine: Canvas) -> None:
        """Draw tree, swarm and paths."""
        if self.tree is not None:
            fine.segments(self.tree, palette.TREE, _TREE)
        for _, colour, member in self.swarm:
            fine.line(member, colour, _SWARM)
            if len(np.asarray(member)) == 1:
                fine.dot(np.asarray(member)[0], _POINT, colour)
        if self.raw is not None:
            fine.line(self.raw, palette.TREE, _RAW)
        for outline in self.outlines:
            fine.line(outline, palette.OUTLINE, _OUTLINE, closed=True)
        if self.path is not None:
            fine.line(self.path, self._path_colour, _PATH)
        if self.rollout is not None:
            fine.line(self.rollout, palette.TRAIL, _ROLLOUT)
        if self.optimum is not None:
            fine.dashes(self.optimum, palette.OPTIMUM, _OPTIMUM)

    def _entries(self) -> list[Entry]:
        """The legend's entries of what is drawn."""
        dashes: Entry = ("shortest", lambda on, at: on.dashes(at, palette.OPTIMUM, _OPTIMUM))
        entries: list[tuple[object, Entry]] = [
            (True, ("start", lambda on, at: floor.draw_start(on, at.mean(axis=0)))),
            (True, _GOAL),
            (_any(self.path), line("path", self._path_colour, _PATH)),
            (_any(self.rollout), line("roll-out", palette.TRAIL, _ROLLOUT)),
            (len(self.inflated), line("solid", palette.SOLID, 2 * _PATH)),
            (len(self.inflated), line("dilated", palette.MAPPED, 2 * _PATH)),
            (self.optimum is not None, dashes),
            (_any(self.tree), line("tree", palette.TREE, 2 * _TREE)),
            (self.raw is not None, line("path of the tree", palette.TREE, _RAW)),
            *((True, entry) for entry in {of[0]: _member(*of) for of in self.swarm}.values()),
            (len(self.outlines), line("footprint", palette.OUTLINE, 2 * _OUTLINE)),
        ]
        return [entry for drawn, entry in entries if drawn]


def _any(drawn: ArrayLike | None) -> bool:
    return drawn is not None and np.size(drawn) > 0


def _member(words: str, colour: palette.Colour, where: ArrayLike) -> Entry:
    is_point = len(np.asarray(where)) == 1
    return disc(words, colour) if is_point else line(words, colour, 2 * _SWARM)
