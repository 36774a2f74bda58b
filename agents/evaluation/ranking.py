"""Who wins where: the best policy of each scene, and those that cannot be told from it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from markupsafe import Markup

from agents.evaluation.html_tables import Cell, Head, breakable, ranked_by_scene, sortable
from agents.evaluation.tables import COLUMNS, bounds_written, overall, written

Record = Mapping[str, Any]

LEVEL = 0.05  # of a test
FEWEST = 6  # pairs with which a paired test can tell anything at that level
MEANING = (
    "Success. Bold: the most on that scene, or no less than that as far as these episodes tell "
    f"(McNemar's exact paired test, {LEVEL:g}, each pair of policies by itself)."
)
_SHARE = next(column for column in COLUMNS if column.key == "success")


def level_with(successes: Mapping[int, bool], others: Mapping[int, bool]) -> bool:
    """Whether two policies' successes by seed cannot be told apart on the seeds of both."""
    from scipy.stats import binomtest

    both = successes.keys() & others.keys()
    ahead = sum(successes[seed] and not others[seed] for seed in both)
    behind = sum(others[seed] and not successes[seed] for seed in both)
    return ahead + behind == 0 or binomtest(ahead, ahead + behind).pvalue >= LEVEL


def winners(evaluation: Mapping[str, Any]) -> dict[str, list[str]]:
    """Scene -> the policies that win there, the best one first; none where nobody succeeds."""
    found = {}
    for scene, rows in zip(evaluation["scenes"], ranked_by_scene(evaluation), strict=True):
        of: dict[str, dict[int, bool]] = {row["policy"]: {} for row in rows}
        for record in evaluation["records"]:
            if record["scene"] == scene:
                of[record["policy"]][record["seed"]] = record["success"]
        best = next(iter(of.values()), {})
        found[scene] = [name for name in of if any(best.values()) and level_with(best, of[name])]
    return found


def tells(evaluation: Mapping[str, Any]) -> bool:
    """Whether there is anything to win, and enough episodes to say who does."""
    several = len(evaluation["policies"]) > 1 and len(evaluation["scenes"]) > 1
    pairs = len({record["seed"] for record in evaluation["records"]})
    return several and pairs >= FEWEST


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


def learned_beside_planned(evaluation: Mapping[str, Any]) -> str:
    """One sentence on who arrived how often; nothing where not both kinds were compared."""
    kinds = evaluation.get("kinds", {})  # older results have none
    begins = {
        "learned": "Learned policies reached the goal in {} episodes",
        "planned": "planned ones in {}",
    }
    said = []
    for kind, begin in begins.items():
        ends = {
            name: [r["success"] for r in evaluation["records"] if r["policy"] == name]
            for name in evaluation["policies"]
            if kinds.get(name) == kind
        }
        number = sum(map(len, ends.values()))
        if number == 0:
            return ""
        each = ", ".join(f"{name} {sum(of)} of {len(of)}" for name, of in ends.items())
        share = f"{sum(map(sum, ends.values()))} of {number}"
        said.append(f"{begin.format(share)} ({each})")
    return ", ".join(said) + "."


def told(evaluation: Mapping[str, Any]) -> str:
    """The table in Markdown; nothing where it would not tell anything."""
    if not tells(evaluation):
        return ""
    lines = [
        ["success [%]", *evaluation["scenes"]],
        ["---", *("---:" for _ in evaluation["scenes"])],
    ]
    for policy, cells in _cells(evaluation):
        lines.append([policy])
        for row, wins in cells:
            share = written(row["success"], _SHARE)
            mark = "**" if wins else ""
            lines[-1].append(f"{mark}{share}{mark} ({bounds_written(row, _SHARE)})")
    rows = (" | ".join(cell.replace("|", "\\|") for cell in line) for line in lines)
    return "\n".join([*(f"| {row} |" for row in rows), "", MEANING])


def table(evaluation: Mapping[str, Any]) -> Markup:
    """The table as HTML; empty where it could not tell the policies apart."""
    if not tells(evaluation):
        return Markup()
    heads = [Head("policy"), *(Head(scene, "%", "success") for scene in evaluation["scenes"])]
    body = []
    for policy, cells in _cells(evaluation):
        body.append([Cell(breakable(policy))])
        for row, wins in cells:
            share = written(row["success"], _SHARE)
            text = Markup("<strong>{}</strong>").format(share) if wins else share
            body[-1].append(Cell(text, bounds_written(row, _SHARE), row["success"]))
    note = Markup("<p class='note'>{}</p>").format(MEANING)
    return sortable(heads, [body], "Who wins where") + note
