"""Colours, named by what they show: those of `theme.json`, which studio and reports share.

The hues of light pictures are those of Okabe and Ito, distinct for colour-blind readers.
"""

from pathlib import Path
from typing import Any

from wheelchair_gym.base.files import read_json

Colour = tuple[int, int, int]  # RGB
# Colours of light, dark and contrasting pages, and the legend's words.
_THEME: Any = read_json(Path(__file__).with_name("theme.json"))
WORDS: dict[str, str] = _THEME["words"]


def _of(*names: str) -> list[Colour]:
    """Light colours of the theme."""
    red_green_blue = [bytes.fromhex(_THEME["light"][name][1:]) for name in names]
    return [(red, green, blue) for red, green, blue in red_green_blue]


SERIES: tuple[Colour, ...] = tuple(_of(*(f"series-{k}" for k in range(8))))
BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY, *_ = SERIES
FREE, UNKNOWN, SOLID = _of("floor", "unknown", "wall")
MAPPED, PAPER, INK, RULE = _of("mapped", "ground", "text", "line")  # paper: of the caption
CHAIR, TRAIL, ESTIMATE, GOAL, PATH = _of("chair", "trail", "estimate", "goal", "path")
START, LASER, NARROW, WIDE = _of("start", "laser", "narrow", "ultrasonic")
# Blind: rim of who pays no attention to the chair; light: furniture that can be pushed.
PERSON, BLIND, LEAF, SUDDEN, LIGHT = _of("person", "inattentive", "door", "sudden", "furniture")
WHEEL, TREE, OUTLINE, OPTIMUM = INK, SKY, PURPLE, (0, 0, 0)


def css(colour: Colour) -> str:
    """A colour as matplotlib and style sheets write it."""
    return "#{:02x}{:02x}{:02x}".format(*colour)


def style_sheet() -> str:
    """The theme as custom properties of CSS: light, dark where a reader prefers it, contrast."""
    light, dark, contrast = (
        " ".join(f"--{name}: {colour};" for name, colour in _THEME[of].items())
        for of in ("light", "dark", "contrast")
    )
    return f""":root {{ color-scheme: light dark; {light} }}
@media (prefers-color-scheme: dark) {{ :root:not(.contrast) {{ {dark} }} }}
:root.contrast {{ {contrast} }}
"""
