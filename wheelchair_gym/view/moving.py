"""What moves in a world besides the chair, drawn."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.movers import (
    DOOR,
    EVERYBODY,
    FURNITURE,
    NOBODY,
    OBSTACLE,
    PERSON,
    Movers,
    outline_of,
)
from wheelchair_gym.view import palette
from wheelchair_gym.view.canvas import Canvas

Array = NDArray[np.float64]

FILLS = {
    PERSON: palette.PERSON,
    DOOR: palette.LEAF,
    OBSTACLE: palette.SUDDEN,
    FURNITURE: palette.LIGHT,
}
# Rims tell whether a person heeds the chair.
RIMS = {EVERYBODY: palette.INK, NOBODY: palette.VERMILION}


def draw_movers(canvas: Canvas, movers: Movers, poses: Array) -> None:
    """Draw movers at their true shapes.

    Args:
        canvas: to draw on.
        movers: of the episode.
        poses: where they are (k, 3) [m, m, rad]; NaN: not there.
    """
    for row, (x, y, yaw) in zip(movers.rows, poses, strict=True):
        if not math.isfinite(x):
            continue
        kind, colour = int(row["kind"]), FILLS[int(row["kind"])]
        outline = outline_of(row, x, y, yaw)
        if len(outline) == 1:
            rim = RIMS.get(int(row["heeds"]), palette.BLIND) if kind == PERSON else palette.INK
            canvas.disc(outline[0], float(row["size"][0]), colour)
            canvas.ring(outline[0], float(row["size"][0]), rim, 2.0)
        else:
            canvas.fill([outline], colour)
            # A leaf is too thin for a line round it in another colour.
            edge = colour if kind == DOOR else palette.INK
            canvas.line(outline, edge, 1.5, closed=True)
