"""The summary as HTML tables: ranked, sortable, each column explained."""

from __future__ import annotations

import html
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from agents.evaluation.metrics import BARN_SPEED, HALT, ROUGH, WIDE
from agents.evaluation.tables import (
    COLUMNS,
    bounds_written,
    by_scene,
    heading,
    known,
    overall,
    written,
)

Record = Mapping[str, Any]

MEANINGS = {
    "episodes": "driven, one a seed; every policy drives the same ones",
    "success": "at the goal by truth, without any contact",
    "wide": f"the same, of episodes whose margin is {WIDE:g} m or more",
    "margin": "what the chair might grow by on every side and still get to the goal between all "
    "that stands: beside it, and where that is less than 0.1 m, in its turns, too; least of all "
    "episodes",
    "collision": "any contact by truth, or a bumper strip pressed",
    "caused": "touched something while some point of the chair's outline closed on it at more than "
    "0.05 m/s, and faster than it closed on the chair: share of all episodes",
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
        # `overall` ranks the rows of "all"; these are ranked in that guise.
        named = {row["policy"]: row for row in rows}
        groups.append([named[r["policy"]] for r in overall([{**r, "scene": "all"} for r in rows])])
    return groups


class Head(NamedTuple):
    """A column's heading."""

    name: str
    unit: str | None = None  # None: a column of words
    meaning: str = ""


class Cell(NamedTuple):
    """A cell: HTML, small print below it, and what it is sorted by."""

    text: str
    small: str = ""
    key: float | None = None


def sortable(
    heads: Sequence[Head], bodies: Sequence[Sequence[Sequence[Cell]]], caption: str
) -> str:
    """Groups of rows as one table that sorts where a heading is clicked; row names come first."""
    top = ""
    for head in heads:
        if head.unit is None:
            top += f"<th scope='col'><button type='button'>{head.name}</button></th>"
            continue
        unit = f"<small>{html.escape(head.unit) or '&nbsp;'}</small>"
        top += (
            f"<th scope='col' class='n' title='{html.escape(head.meaning)}'>"
            f"<button type='button'>{html.escape(head.name)}{unit}</button></th>"
        )
    text = ""
    for rows in bodies:
        text += "<tbody>"
        for name, *cells in rows:
            text += f"<tr><th scope='row'>{name.text}</th>"
            for head, cell in zip(heads[1:], cells, strict=True):
                small = f"<small>{cell.small}</small>" if cell.small else ""
                key = f"{cell.key:.9g}" if known(cell.key) else ""
                sorts = f" class='n' data-key='{key}'" if head.unit is not None else ""
                text += f"<td{sorts}>{cell.text}{small}</td>"
            text += "</tr>"
        text += "</tbody>"
    return (
        f"<div class='wide' tabindex='0' role='region' aria-label='{html.escape(caption)}'><table>"
        f"<caption>{html.escape(caption)}</caption><thead><tr>{top}</tr></thead>"
        f"{text}</table></div>"
    )


def html_table(groups: Sequence[Sequence[Record]], caption: str, *, scenes: bool) -> str:
    """Groups of summary rows as one table; `scenes` adds the column that tells them apart."""
    if not any(groups):
        return ""
    heads = [Head(name) for name in (["policy", "scene"] if scenes else ["policy"])]
    heads += [Head(column.name, column.unit, MEANINGS[column.key]) for column in COLUMNS]
    bodies: list[list[list[Cell]]] = []
    for rows in groups:
        bodies.append([])
        for row in rows:
            cells = [Cell(html.escape(row["policy"]).replace("_", "_<wbr>"))]
            cells += [Cell(html.escape(row["scene"]))] if scenes else []
            cells += [
                Cell(written(row.get(c.key), c), bounds_written(row, c), row.get(c.key))
                for c in COLUMNS
            ]
            bodies[-1].append(cells)
    return sortable(heads, bodies, caption)


def glossary() -> str:
    """What every column means, folded away until asked for."""
    told = "".join(
        f"<div><dt>{html.escape(heading(column))}</dt><dd>{MEANINGS[column.key]}</dd></div>"
        for column in COLUMNS
    )
    return f"<details><summary>What the columns mean</summary><dl>{told}</dl></details>"
