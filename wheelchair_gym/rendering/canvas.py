"""Drawing in metres: a frame places the world on pixels, a canvas draws into an RGB array."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from wheelchair_gym.base.arrays import Array
from wheelchair_gym.geometry.planar import arc_lengths
from wheelchair_gym.rendering.palette import Colour

Image = NDArray[np.uint8]

_SHIFT = 4  # fractional bits of OpenCV's fixed-point coordinates
_ONE = 1 << _SHIFT
_FAR = 100_000 * _ONE


@dataclass(frozen=True)
class Frame:
    """Place and scale of the world on a picture: y points up, pixel centres are at half a pixel."""

    scale: float  # pixels per metre
    left: float  # column of x = 0 [pixels]
    bottom: float  # row of y = 0 [pixels]

    def pixels(self, points: ArrayLike) -> Array:
        """Columns and rows (..., 2) [pixels] of points (..., 2) [m]."""
        p = np.asarray(points, dtype=np.float64)[..., :2]
        return p * (self.scale, -self.scale) + (self.left, self.bottom)


@dataclass(frozen=True)
class Canvas:
    """An image (h, w, 3) that is drawn on in place; `stroke_scale` multiplies stroke widths."""

    image: Image
    frame: Frame
    stroke_scale: float = 1.0

    def resized(self, factor: float) -> Canvas:
        """A copy with more pixels to be drawn on, or with fewer ones, each the mean of several."""
        how = cv2.INTER_NEAREST if factor > 1.0 else cv2.INTER_AREA
        h, w = self.image.shape[:2]
        size = (int(w * factor), int(h * factor))
        image: Any = cv2.resize(self.image, size, interpolation=how)
        f = self.frame
        frame = Frame(f.scale * factor, f.left * factor, f.bottom * factor)
        return Canvas(image, frame, self.stroke_scale * factor)

    def _fixed(self, points: ArrayLike) -> NDArray[np.int32]:
        """Points (n, 2) [m] in OpenCV's fixed-point pixels, whose integers are pixel centres."""
        fixed = (self.frame.pixels(points) - 0.5) * _ONE
        np.rint(fixed, out=fixed)
        # Far points stay far: clipped so that the fixed point never overflows.
        return np.clip(fixed, -_FAR, _FAR, out=fixed).astype(np.int32)

    def _width(self, width: float) -> int:
        return max(1, round(width * self.stroke_scale))

    def fill(self, loops: Sequence[ArrayLike], colour: Colour, alpha: float = 1.0) -> None:
        """Fill closed loops, each (k, 2) [m], by the even-odd rule, only where they lie."""
        outlines = [self._fixed(loop) for loop in loops]
        if not outlines:
            return
        if alpha >= 1.0:
            cv2.fillPoly(self.image, outlines, colour, cv2.LINE_AA, _SHIFT)
            return
        every = outlines[0] if len(outlines) == 1 else np.concatenate(outlines)
        h, w = self.image.shape[:2]
        c0, r0 = np.maximum(every.min(axis=0) // _ONE - 1, 0)
        c1, r1 = np.minimum(every.max(axis=0) // _ONE + 3, (w, h))
        if c0 >= c1 or r0 >= r1:
            return
        part = self.image[r0:r1, c0:c1]
        layer = part.copy()
        corner = np.array([c0 * _ONE, r0 * _ONE], dtype=np.int32)
        cv2.fillPoly(layer, [line - corner for line in outlines], colour, cv2.LINE_AA, _SHIFT)
        part[:] = cv2.addWeighted(layer, alpha, part, 1.0 - alpha, 0.0)

    def line(
        self, points: ArrayLike, colour: Colour, width: float = 1.0, closed: bool = False
    ) -> None:
        """Draw a polyline (n, 2 or 3) [m]."""
        p = np.asarray(points, dtype=np.float64)
        if len(p) < 2:
            return
        if len(p) > 50:  # a long trail: points closer than two pixels cost time and show nothing
            way = np.cumsum(np.hypot(*np.diff(p[:, :2], axis=0).T)) * self.frame.scale
            kept = np.diff(np.floor(way / (2.0 * self.stroke_scale)), prepend=0.0) > 0.0
            kept[-1] = True
            p = p[np.concatenate([[True], kept])]
        stroke = self._width(width)
        cv2.polylines(self.image, [self._fixed(p)], closed, colour, stroke, cv2.LINE_AA, _SHIFT)

    def segments(self, segments: ArrayLike, colour: Colour, width: float = 1.0) -> None:
        """Draw segments (n, 4) [m], all at once."""
        s = np.asarray(segments, dtype=np.float64).reshape(-1, 2, 2)
        if len(s):
            lines: Any = self._fixed(s)
            cv2.polylines(self.image, lines, False, colour, self._width(width), cv2.LINE_AA, _SHIFT)

    def dashes(self, points: ArrayLike, colour: Colour, width: float = 1.0) -> None:
        """Draw a polyline (n, 2 or 3) [m] with dashes and gaps of 7 pixels."""
        p = np.asarray(points, dtype=np.float64)[:, :2]
        if len(p) < 2:
            return
        way = arc_lengths(p)
        step = 7.0 * self.stroke_scale / self.frame.scale
        for a in np.arange(0.0, way[-1], 2.0 * step):
            b = min(a + step, way[-1])
            stops = np.concatenate([[a], way[(way > a) & (way < b)], [b]])
            xs, ys = (np.interp(stops, way, p[:, k]) for k in range(2))
            self.line(np.stack([xs, ys], axis=-1), colour, width)

    def _circle(self, centre: ArrayLike, radius: float, colour: Colour, stroke: int) -> None:
        """A circle whose radius is in pixels; a stroke of -1 fills it."""
        column, row = self._fixed(np.asarray(centre, dtype=np.float64)[:2]).tolist()
        size = round(radius * _ONE)
        cv2.circle(self.image, (column, row), size, colour, stroke, cv2.LINE_AA, _SHIFT)

    def disc(self, centre: ArrayLike, radius: float, colour: Colour, alpha: float = 1.0) -> None:
        """Fill a disc of radius [m]."""
        around = np.linspace(0.0, 2.0 * math.pi, 73)[:-1]
        ring = radius * np.stack([np.cos(around), np.sin(around)], axis=-1)
        self.fill([np.asarray(centre, dtype=np.float64)[:2] + ring], colour, alpha)

    def ring(self, centre: ArrayLike, radius: float, colour: Colour, width: float = 1.0) -> None:
        """Draw a circle of radius [m]."""
        self._circle(centre, radius * self.frame.scale, colour, self._width(width))

    def dot(self, centre: ArrayLike, radius: float, colour: Colour) -> None:
        """Fill a disc whose radius is in pixels: a mark, whatever the scale."""
        self._circle(centre, radius * self.stroke_scale, colour, -1)

    def points(self, points: ArrayLike, colour: Colour) -> None:
        """Set a small square at each of many points (n, 2) [m], quickly."""
        side = self._width(2.0)
        corner = np.rint(self.frame.pixels(points) - 0.5 * side).astype(np.int64)
        h, w = self.image.shape[:2]
        corner = corner[((corner >= 0) & (corner < (w - side + 1, h - side + 1))).all(axis=-1)]
        for dr in range(side):
            for dc in range(side):
                self.image[corner[:, 1] + dr, corner[:, 0] + dc] = colour


def text_width(text: str, height: float) -> float:
    """Width [pixels] of a text whose capitals are `height` pixels high, as it is written."""
    scale, stroke = _pen(height)
    (width, _), _ = cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, scale, stroke)
    return float(width)


def write_text(image: Image, text: str, at: tuple[float, float], height: float, c: Colour) -> None:
    """Write ASCII text whose baseline starts at a column and row; capitals `height` pixels high."""
    where = (round(at[0]), round(at[1]))
    scale, stroke = _pen(height)
    cv2.putText(image, text, where, cv2.FONT_HERSHEY_SIMPLEX, scale, c, stroke, cv2.LINE_AA)


def _pen(height: float) -> tuple[float, int]:
    """OpenCV's scale and stroke for capitals of a height [pixels]; both change a text's width."""
    return height / 21.0, max(1, round(height / 9.0))
