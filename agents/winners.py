"""Who wins where: the best policy of each scene, and those that cannot be told from it."""

from __future__ import annotations

import html
from collections.abc import Mapping, Sequence
from typing import Any

from scipy.stats import binomtest

from agents.html_tables import Cell, Head, sortable
from agents.tables import COLUMNS, bounds_written, overall, written

Record = Mapping[str, Any]

LEVEL = 0.05  # of a test
MEANING = (
    f"Bold wins: the most success, or success that a paired test (McNemar's exact one, {LEVEL:g}, "
    "each pair by itself) cannot tell from that on the same episodes."
)
_SHARE = next(column for column in COLUMNS if column.key == "success")


def level_with(successes: Mapping[int, bool], others: Mapping[int, bool]) -> bool:
    """Whether two policies' successes by seed cannot be told apart on the seeds of both."""
    both = successes.keys() & others.keys()
    ahead = sum(successes[seed] and not others[seed] for seed in both)
    behind = sum(others[seed] and not successes[seed] for seed in both)
    return ahead + behind == 0 or binomtest(ahead, ahead + behind).pvalue >= LEVEL


def winners(evaluation: Mapping[str, Any]) -> dict[str, list[str]]:
    """Scene -> the policies that win there, the best one first."""
    found = {}
    for scene in evaluation["scenes"]:
        rows = [row for row in evaluation["summary"] if row["scene"] == scene]
        ranked = [r["policy"] for r in overall([{**row, "scene": "all"} for row in rows])]
        of: dict[str, dict[int, bool]] = {policy: {} for policy in ranked}
        for record in evaluation["records"]:
            if record["scene"] == scene:
                of[record["policy"]][record["seed"]] = record["success"]
        found[scene] = [p for p in ranked if level_with(of[ranked[0]], of[p])]
    return found


def _cells(evaluation: Mapping[str, Any]) -> list[tuple[str, list[tuple[Record, bool]]]]:
    """Each policy, best first, with its row of each scene and whether it wins there."""
    rows = {(row["policy"], row["scene"]): row for row in evaluation["summary"]}
    first = winners(evaluation)
    return [
        (
            row["policy"],
            [(rows[row["policy"], scene], row["policy"] in first[scene]) for scene in first],
        )
        for row in overall(evaluation["summary"])
    ]


def told(evaluation: Mapping[str, Any]) -> str:
    """The table in Markdown."""
    scenes: Sequence[str] = evaluation["scenes"]
    lines = [["success [%]", *scenes], ["---", *("---:" for _ in scenes)]]
    for policy, cells in _cells(evaluation):
        lines.append([policy])
        for row, wins in cells:
            share = written(row["success"], _SHARE)
            mark = "**" if wins else ""
            lines[-1].append(f"{mark}{share}{mark} ({bounds_written(row, _SHARE)})")
    rows = (" | ".join(cell.replace("|", "\\|") for cell in line) for line in lines)
    return "\n".join([*(f"| {row} |" for row in rows), "", MEANING, ""])


def table(evaluation: Mapping[str, Any]) -> str:
    """The table as HTML."""
    heads = [Head("policy"), *(Head(scene, "%", "success") for scene in evaluation["scenes"])]
    body = []
    for policy, cells in _cells(evaluation):
        body.append([Cell(html.escape(policy).replace("_", "_<wbr>"))])
        for row, wins in cells:
            share = written(row["success"], _SHARE)
            text = f"<strong>{share}</strong>" if wins else share
            body[-1].append(Cell(text, bounds_written(row, _SHARE), row["success"]))
    return sortable(heads, [body], "Who wins where") + f"<p class='note'>{MEANING}</p>"
