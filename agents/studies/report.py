"""The page of studies, with all verdicts first, and their text."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import groupby
from pathlib import Path
from typing import Any

from agents.evaluation.tables import (
    Cell,
    Column,
    Figures,
    Table,
    columns_of,
    exists,
    make_table,
    write_page,
)
from agents.studies.evidence import LEVEL, ClaimVerdict

Chapter = Mapping[str, Any]

_CLASSES = {
    ClaimVerdict.FAILS: "fails",
    ClaimVerdict.OPEN: "open",
    ClaimVerdict.HOLDS: "holds",
}  # worst first


def count_verdicts(chapters: Sequence[Chapter]) -> dict[ClaimVerdict, int]:
    """The number of claims with each verdict."""
    verdicts = [claim["verdict"] for chapter in chapters for claim in chapter["claims"]]
    return {verdict: verdicts.count(verdict) for verdict in ClaimVerdict}


def _totals(chapters: Sequence[Chapter]) -> str:
    count = count_verdicts(chapters)
    kinds = ClaimVerdict.HOLDS, ClaimVerdict.FAILS, ClaimVerdict.OPEN
    hold, fail, undecided = (count[kind] for kind in kinds)
    total = sum(count.values())
    return f"Of {total} claims {hold} hold, {fail} do not, {undecided} cannot be decided"


def summary_text(chapters: Sequence[Chapter]) -> str:
    """The verdicts as lines of text."""
    lines = []
    for chapter in chapters:
        lines.append(f"{chapter['name']}: {chapter['title']} ({chapter['runs']} runs)")
        for claim in chapter["claims"]:
            lines.append(f"  {claim['verdict']:14s} {claim['claim']}: {effect_text(claim)}")
    return "\n".join([*lines, _totals(chapters)])


def effect_text(claim: Mapping[str, Any]) -> str:
    """The effect with its interval; a share has no sign."""
    if not exists(claim["effect"]):
        return str(claim["test"])
    sign = "" if claim["test"].startswith("binomial") else "+"
    effect, low, high = (
        f"{round(claim[key], 6):{sign}.3g}" if exists(claim[key]) else "?"
        for key in ("effect", "low", "high")
    )
    return f"{effect}{'' if low == high else f' ({low} to {high})'} {claim['unit']}"


def write_studies_page(
    path: Path, title: str, chapters: Sequence[tuple[Chapter, Figures]], source: Mapping[str, Any]
) -> Path:
    """Write one page of all chapters, which needs no other file."""
    found = []
    for chapter, drawn in chapters:
        claims = [
            {**claim, "effect": effect_text(claim), "study": chapter["name"],
             "class": _CLASSES[ClaimVerdict(claim["verdict"])]}
            for claim in sorted(
                chapter["claims"], key=lambda claim: list(_CLASSES).index(claim["verdict"])
            )
        ]  # fmt: skip
        fits = _fits(chapter["readings"]) if chapter["readings"] else None
        table = None if fits else _table(chapter)
        found.append({**chapter, "claims": claims, "table": table, "fits": fits, "drawn": drawn})
    return write_page(
        path, "studies.html", title=title, source=source, totals=_totals(found),
        failed=[c for of in found for c in of["claims"] if c["verdict"] == ClaimVerdict.FAILS],
        level=f"{LEVEL:g}", contents=_contents(found), chapters=found,
    )  # fmt: skip


def _contents(chapters: Sequence[Chapter]) -> Table:
    texts = [Column("", name, None) for name in ("study", "subject")]
    rows = [
        [Cell(chapter["name"], link=f"#{chapter['name']}"), Cell(chapter["title"]),
         *(Cell(str(n), key=n) for n in count_verdicts([chapter]).values())]
        for chapter in chapters
    ]  # fmt: skip
    columns = [*texts, *(Column("", str(verdict), "claims") for verdict in ClaimVerdict)]
    return Table("Verdicts by study", columns, [rows])


def _fits(readings: Sequence[Mapping[str, Any]]) -> Table:
    """The readings of an algorithm, by how well they predict the printed lengths."""
    caption = f"{readings[0]['rows']} printed mean lengths; intervals by bootstrap over them"
    return make_table(caption, columns_of("readings"), [readings])


def _table(chapter: Chapter) -> Table:
    """Each row: our mean with its interval, the published value, the ratio, and the runs."""
    columns = [Column("row", "row", None)]
    for m in chapter["metrics"]:
        key, unit, of = m["key"], m["unit"], "mean and 95 % interval"
        columns.append(Column(key, m["name"], unit, m["digits"], interval=True, meaning=of))
        if any(exists(row["figures"][key]["published"]) for row in chapter["rows"]):
            columns.append(Column(f"{key}_published", "published", unit, "g", meaning="as printed"))
            columns.append(Column(f"{key}_ratio", "ratio", "", ".3g", meaning="ours / published"))

    def cells(row: Mapping[str, Any]) -> list[Cell]:
        flat = {"row": row["row"]}
        for key, figures in row["figures"].items():
            flat |= {key: figures["mean"], **{f"{key}_{part}": v for part, v in figures.items()}}
        solved = Cell(f"{row['solved']}/{row['runs']}", key=row["solved"] / max(row["runs"], 1))
        return [*(column.cell(flat) for column in columns), solved]

    def group(row: Mapping[str, Any]) -> str:
        return str(row["row"]).split(" lambda")[0] if " lambda" in row["row"] else ""

    groups = [[cells(row) for row in of] for _, of in groupby(chapter["rows"], group)]
    caption = f"{chapter['runs']} runs of each row and map or goal"
    return Table(caption, [*columns, Column("", "solved", "of runs")], groups)
