"""The summary as HTML tables: ranked, sortable, each column explained."""

from __future__ import annotations

import html
from collections.abc import Mapping, Sequence
from typing import Any

from agents.metrics import BARN_SPEED, HALT, ROUGH, WIDE
from agents.tables import (
    COLUMNS,
    Column,
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
    "wide": "the same, of episodes whose narrowest spot on the widest way leaves "
    f"{WIDE:g} m or more on each side of the chair",
    "margin": "beyond half the chair's width at that spot, least of all episodes; of what stands",
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


def html_table(groups: Sequence[Sequence[Record]], caption: str, *, scenes: bool) -> str:
    """Groups of summary rows as one table; `scenes` adds the column that tells them apart."""
    if not any(groups):
        return ""
    names = ["policy", "scene"] if scenes else ["policy"]
    heads = "".join(f"<th scope='col'><button type='button'>{name}</button></th>" for name in names)
    for column in COLUMNS:
        unit = f"<small>{html.escape(column.unit) or '&nbsp;'}</small>"
        heads += (
            f"<th scope='col' class='n' title='{html.escape(MEANINGS[column.key])}'>"
            f"<button type='button'>{html.escape(column.name)}{unit}</button></th>"
        )
    bodies = ""
    for rows in groups:
        bodies += "<tbody>"
        for row in rows:
            name = html.escape(row["policy"]).replace("_", "_<wbr>")
            cells = f"<th scope='row'>{name}</th>"
            cells += f"<td>{html.escape(row['scene'])}</td>" if scenes else ""
            cells += "".join(_cell(row, column) for column in COLUMNS)
            bodies += f"<tr>{cells}</tr>"
        bodies += "</tbody>"
    return (
        f"<div class='wide' tabindex='0' role='region' aria-label='{html.escape(caption)}'><table>"
        f"<caption>{html.escape(caption)}</caption><thead><tr>{heads}</tr></thead>"
        f"{bodies}</table></div>"
    )


def _cell(row: Record, column: Column) -> str:
    value = row.get(column.key)
    key = f"{value:.9g}" if known(value) else ""
    interval = bounds_written(row, column)
    small = f"<small>{interval}</small>" if interval else ""
    return f"<td class='n' data-key='{key}'>{written(value, column)}{small}</td>"


def glossary() -> str:
    """What every column means, folded away until asked for."""
    told = "".join(
        f"<div><dt>{html.escape(heading(column))}</dt><dd>{MEANINGS[column.key]}</dd></div>"
        for column in COLUMNS
    )
    return f"<details><summary>What the columns mean</summary><dl>{told}</dl></details>"
