"""HTML pages by Jinja2: the environment of their templates, and tables that sort."""

from __future__ import annotations

import base64
from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import jinja2
from markupsafe import Markup

from agents.evaluation.metrics import BARN_SPEED, HALT, ROUGH, WIDE
from agents.evaluation.tables import COLUMNS, bounds_written, by_scene, known, overall, written
from wheelchair_gym.files import atomic_write

Record = Mapping[str, Any]
Figures = Mapping[str, tuple[str, bytes]]  # name: caption and SVG

_TYPES = {
    ".gif": "image/gif", ".svg": "image/svg+xml", ".mp4": "video/mp4", ".webp": "image/webp",
}  # fmt: skip

MEANINGS = {
    "episodes": "driven, one a seed; every policy drives the same ones",
    "success": "at the goal by truth, without any contact",
    "wide": f"the same, of episodes whose margin is {WIDE:g} m or more",
    "margin": "what the chair might grow by on every side and still get to the goal between all "
    "that stands: beside it, and where that is less than 0.1 m, in its turns, too; least of all "
    "episodes",
    "collision": "any contact by truth, or a bumper strip pressed",
    "at_fault": "touched something while some point of the chair's outline closed on it at more "
    "than 0.05 m/s, and faster than it closed on the chair: share of all episodes",
    "timeout": "still under way when the time limit ended the episode; success, collision and "
    "timeout fall short of 100 % by those that stopped at what they wrongly believed to be the "
    "goal",
    "arrived": "the chair believed to be at its goal, by its own estimate of its pose",
    "spl": "success weighted by path length: mean over all episodes of geodesic / driven length, "
    "0 for a failure; 1 is perfect",
    "barn": "success x swift / clip(time, 2 swift, 8 swift), swift = way / "
    f"{BARN_SPEED:g} m/s, as the BARN challenge has it; 0.5 is the best; mean of all episodes",
    "barn_own": "the same at the chair's own top speed",
    "time": "mean of successful episodes",
    "length": "driven, mean of successful episodes",
    "halts": f"times the chair stood for {HALT:g} s or more on its way, mean of all episodes",
    "replans": "plans made after the first, mean of all episodes",
    "clearance_min": "least distance between the chair's outline and anything, of all episodes; "
    "0 is contact",
    "clearance_mean": "the same distance, mean over time",
    "accel_rms": "root mean square of the change of speed",
    "jerk_rms": "root mean square of the second difference of the speed; less is smoother",
    "rough_share": f"share of time with more acceleration, ahead and sideways together, than "
    f"{ROUGH:g} m/s²: about where standing passengers of public transport begin to complain",
    "energy_per_m": "drawn from the battery per metre driven",
    "plan_ms_p50": "time to make the first plan, median",
    "plan_ms_p95": "time to make the first plan, 95 of 100 episodes stay below",
    "act_ms_p50": "time to choose one action, median",
    "act_ms_p95": "time to choose one action, 95 of 100 episodes' own 95th percentiles stay below",
}


def ranked_by_scene(evaluation: Mapping[str, Any]) -> list[list[Record]]:
    """The rows of each scene, best first as over all scenes."""
    groups = []
    for scene in evaluation["scenes"]:
        rows = [row for row in by_scene(evaluation["summary"]) if row["scene"] == scene]
        # `overall` ranks rows of the scene "all", so these are ranked as such.
        named = {row["policy"]: row for row in rows}
        groups.append([named[r["policy"]] for r in overall([{**r, "scene": "all"} for r in rows])])
    return groups


class Head(NamedTuple):
    """A column's heading."""

    name: str
    unit: str | None = None  # None: a column of words
    meaning: str = ""


class Cell(NamedTuple):
    """A cell: its text, small print below it, and the number by which it is sorted."""

    text: str
    small: str = ""
    key: float | None = None


@cache
def templates() -> jinja2.Environment:
    """The environment of the templates in agents/templates; values are escaped."""
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("agents", "templates"), autoescape=True,
        undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True,
    )  # fmt: skip
    environment.filters |= {
        "flat": flat,
        "data_uri": data_uri,
        "sort_key": lambda value: f"{value:.9g}" if known(value) else "",
    }
    return environment


def macro(name: str, *arguments: Any) -> Markup:
    """The HTML of a macro of macros.html."""
    return Markup(getattr(templates().get_template("macros.html").module, name)(*arguments))


def write_page(path: Path, template: str, **context: Any) -> Path:
    """Write a page that needs no other file; its path."""
    page = templates().get_template(template).render(context)
    with atomic_write(path) as part:
        part.write_text(page, encoding="utf-8")
    return path


def data_uri(data: bytes, suffix: str) -> str:
    """Data embedded in a page."""
    return f"data:{_TYPES[suffix]};base64,{base64.b64encode(data).decode()}"


def flat(value: Any, name: str = "") -> Iterator[tuple[str, str]]:
    """Nested values as (dotted name, text); a list of plain values is one line."""
    if isinstance(value, Mapping) and value:
        for key, item in value.items():
            yield from flat(item, f"{name}.{key}" if name else str(key))
    elif isinstance(value, list | tuple) and any(isinstance(v, Mapping | list) for v in value):
        for k, item in enumerate(value):
            yield from flat(item, f"{name}[{k}]")
    elif isinstance(value, list | tuple):
        integers = all(isinstance(v, int) for v in value) and len(value) > 3
        run = integers and list(value) == list(range(value[0], value[0] + len(value)))
        yield name, f"{value[0]} to {value[-1]}" if run else ", ".join(map(str, value))
    else:
        yield name, "-" if value is None or value == {} else str(value)


def sortable(
    heads: Sequence[Head], bodies: Sequence[Sequence[Sequence[Cell]]], caption: str
) -> Markup:
    """Groups of rows as one table that sorts by the heading that is clicked."""
    return macro("table", heads, bodies, caption)


def breakable(name: str) -> Markup:
    """A name whose lines may break after underscores."""
    return Markup("_<wbr>").join(name.split("_"))


def summary_table(groups: Sequence[Sequence[Record]], caption: str, *, scenes: bool) -> Markup:
    """Groups of summary rows as one table; `scenes` adds the column of the scene."""
    if not any(groups):
        return Markup()
    heads = [Head(name) for name in (["policy", "scene"] if scenes else ["policy"])]
    heads += [Head(column.name, column.unit, MEANINGS[column.key]) for column in COLUMNS]
    bodies = [
        [
            [
                Cell(breakable(row["policy"])),
                *([Cell(row["scene"])] if scenes else []),
                *(
                    Cell(written(row.get(c.key), c), bounds_written(row, c), row.get(c.key))
                    for c in COLUMNS
                ),
            ]
            for row in rows
        ]
        for rows in groups
    ]
    return sortable(heads, bodies, caption)
