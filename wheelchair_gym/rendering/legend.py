"""Legends above finished pictures: what each colour and mark is."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from wheelchair_gym.actors import records
from wheelchair_gym.actors.records import Actors
from wheelchair_gym.base.arrays import Array
from wheelchair_gym.rendering import floor, palette
from wheelchair_gym.rendering.canvas import Canvas, Frame, Image, text_width, write_text
from wheelchair_gym.rendering.palette import WORDS, Colour

# Words, and what draws their mark between two points (2, 2).
Entry = tuple[str, Callable[[Canvas, Array], None]]
# Words and colour of each kind of thing that moves, and of the rim that tells whom a person avoids.
THINGS = {
    records.DOOR: (WORDS["door"], palette.LEAF),
    records.OBSTACLE: (WORDS["sudden"], palette.SUDDEN),
    records.FURNITURE: (WORDS["furniture"], palette.LIGHT),
}
RIMS = {
    records.EVERYBODY: (WORDS["person"], palette.INK),
    records.PEOPLE: ("inattentive person", palette.BLIND),
    records.NOBODY: ("person who avoids nothing", palette.VERMILION),
}
_SWATCH = 2.2  # length of a line, in heights of the letters
_GAP, _SPACE = 1.4, 0.5  # between two entries, and two words, likewise


def line(words: str, colour: Colour, width: float = 3.0) -> Entry:
    """An entry with a line."""
    return words, lambda on, at: on.line(at, colour, width)


def disc(words: str, colour: Colour, rim: Colour | None = None) -> Entry:
    """An entry with a disc, with a rim."""

    def draw(on: Canvas, at: Array) -> None:
        middle = at.mean(axis=0)
        if rim is not None:
            on.dot(middle, 7.5, rim)
        on.dot(middle, 5.5, colour)

    return words, draw


def scene_entries(actors: Actors) -> list[Entry]:
    """Return the legend's entries for what pictures of an episode show."""
    entries = [
        ("start", lambda on, at: floor.draw_start(on, at.mean(axis=0))),
        disc(WORDS["goal"], palette.GOAL),
        line(WORDS["path"], palette.PATH),
        line(WORDS["trail"], palette.TRAIL),
        line(WORDS["laser"], palette.LASER),
        line(WORDS["ultrasonic"], palette.WIDE),
        line(WORDS["estimate"], palette.ESTIMATE),
    ]
    kinds = set(actors.rows["kind"].tolist())
    avoids = set(actors.rows["avoids"][actors.rows["kind"] == records.PERSON].tolist())
    entries += [disc(RIMS[k][0], palette.PERSON, RIMS[k][1]) for k in sorted(avoids, reverse=True)]
    return entries + [line(*THINGS[kind], 6.0) for kind in sorted(kinds & set(THINGS))]


MAP_ENTRIES: list[Entry] = [
    ("start", lambda on, at: floor.draw_start(on, at.mean(axis=0))),
    line("trail", palette.TRAIL),
    line("occupied", palette.SOLID, 8.0),
    line("unknown", palette.UNKNOWN, 8.0),
]


def with_legend(picture: Image, entries: Sequence[Entry], caption: str = "") -> Image:
    """A picture (h, w, 3) with rows of marks and words on top, as wide as it is.

    The words of a caption follow on rows of their own.
    """
    long_side = max(picture.shape[:2])
    width, row = floor.FINE * picture.shape[1], floor.FINE * floor.strip_height(long_side)
    if row == 0:
        return picture
    capital = 0.36 * row
    places, x, rows = [], capital, 1
    words = caption.split()
    for k, label in enumerate([*(label for label, _ in entries), *words]):
        swatch = (_SWATCH + 0.6) * capital if k < len(entries) else 0.0
        needed = swatch + text_width(label, capital)
        if (x + needed > width - capital or k == len(entries)) and x > capital:
            x, rows = capital, rows + 1
        places.append((x + swatch, (rows - 0.5) * row))
        x += needed + (_GAP if swatch else _SPACE) * capital
    # One metre is one pixel here, and y points up.
    image: Image = np.full((rows * row, width, 3), palette.PAPER, dtype=np.uint8)
    canvas = Canvas(image, Frame(1.0, 0.0, 0.0), floor.stroke_scale(long_side) * floor.FINE)
    for (_, mark), (right, middle) in zip(entries, places, strict=False):
        left = right - (_SWATCH + 0.6) * capital
        mark(canvas, np.array([(left, -middle), (left + _SWATCH * capital, -middle)]))
    for label, (left, middle) in zip([*(e[0] for e in entries), *words], places, strict=True):
        write_text(image, label, (left, middle + 0.5 * capital), capital, palette.INK)
    return np.vstack([canvas.resized(1 / floor.FINE).image, picture])
