"""Colours, named by what they show; hues of Okabe and Ito, distinct for colour-blind readers."""

from __future__ import annotations

Colour = tuple[int, int, int]  # RGB

BLACK: Colour = (0, 0, 0)
ORANGE: Colour = (230, 159, 0)
SKY: Colour = (86, 180, 233)
GREEN: Colour = (0, 158, 115)
BLUE: Colour = (0, 114, 178)
VERMILION: Colour = (213, 94, 0)
PURPLE: Colour = (204, 121, 167)

FREE: Colour = (255, 255, 255)
UNKNOWN: Colour = (211, 215, 220)
MAPPED: Colour = (158, 165, 173)  # occupied on the map, whether or not anything stands there
SOLID: Colour = (58, 64, 72)
PAPER: Colour = (248, 249, 250)  # of the caption
INK: Colour = (33, 37, 41)
RULE: Colour = (190, 196, 202)

CHAIR = BLUE
TRAIL = BLUE
WHEEL = INK
ESTIMATE = PURPLE
GOAL = GREEN
PATH = GREEN
START: Colour = (90, 98, 106)
LASER = VERMILION
NARROW = ORANGE
WIDE: Colour = (176, 158, 0)  # yellow, dark enough for a white floor
PERSON = SKY
BLIND: Colour = (204, 121, 167)  # rim of who pays no attention to the chair
LEAF: Colour = (140, 90, 40)  # of a door
SUDDEN = VERMILION  # what has appeared
LIGHT: Colour = (196, 164, 120)  # furniture that can be pushed
TREE = SKY
OUTLINE = PURPLE  # of what moves along a path
OPTIMUM = BLACK

SERIES: tuple[Colour, ...] = (BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY, SOLID, WIDE)


def css(colour: Colour) -> str:
    """A colour as matplotlib and style sheets write it."""
    return "#{:02x}{:02x}{:02x}".format(*colour)
