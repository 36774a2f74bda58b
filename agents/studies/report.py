"""The page of studies, with all verdicts first, and their text."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import groupby
from pathlib import Path
from typing import Any

from markupsafe import Markup

from agents.evaluation.html_tables import Cell, Figures, Head, sortable, templates, write_page
from agents.evaluation.tables import known
from agents.studies.evidence import LEVEL, Verdict

Chapter = Mapping[str, Any]

_CLASSES = {Verdict.FAILS: "fails", Verdict.OPEN: "open", Verdict.HOLDS: "holds"}  # worst first
_INTERVAL = ("effect", "low", "high")


def count_verdicts(chapters: Sequence[Chapter]) -> dict[Verdict, int]:
    """The number of claims with each verdict."""
    verdicts = [claim["verdict"] for chapter in chapters for claim in chapter["claims"]]
    return {verdict: verdicts.count(verdict) for verdict in Verdict}


def _totals(chapters: Sequence[Chapter]) -> str:
    count = count_verdicts(chapters)
    return (
        f"Of {sum(count.values())} claims {count[Verdict.HOLDS]} hold, {count[Verdict.FAILS]} do "
        f"not, {count[Verdict.OPEN]} cannot be told"
    )


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
    if not known(claim["effect"]):
        return str(claim["test"])
    sign = "" if claim["test"].startswith("binomial") else "+"
    values = [round(claim[key], 6) if known(claim[key]) else None for key in _INTERVAL]
    effect, low, high = (f"{v:{sign}.3g}" if v is not None else "?" for v in values)
    bounds = "" if values[1] == values[2] else f" ({low} to {high})"
    return f"{effect}{bounds} {claim['unit']}"


def write_studies_page(
    path: Path, title: str, chapters: Sequence[tuple[Chapter, Figures]], source: Mapping[str, Any]
) -> Path:
    """Write one page of all chapters, which needs no other file."""
    templates().filters |= {
        "effect": effect_text,
        "verdict_class": lambda verdict: _CLASSES[Verdict(verdict)],
        "worst_first": lambda claims: sorted(
            claims, key=lambda claim: list(_CLASSES).index(claim["verdict"])
        ),
    }
    all_chapters = [chapter for chapter, _ in chapters]
    failed = [
        (claim, chapter["name"]) for chapter in all_chapters for claim in chapter["claims"]
        if claim["verdict"] == Verdict.FAILS
    ]  # fmt: skip
    return write_page(
        path, "studies.html", title=title, source=source, totals=_totals(all_chapters),
        failed=failed, level=f"{LEVEL:g}",
        contents=_contents(all_chapters) if len(chapters) > 1 else "",
        chapters=[{**chapter, "table": _table(chapter), "drawn": drawn}
                  for chapter, drawn in chapters],
    )  # fmt: skip


def _contents(chapters: Sequence[Chapter]) -> Markup:
    heads = [Head("study"), Head("subject"), *(Head(str(v), "claims") for v in Verdict)]
    link = Markup("<a href='#{0}'>{0}</a>")
    rows = [
        [Cell(link.format(chapter["name"])), Cell(chapter["title"]),
         *(Cell(str(n), key=n) for n in count_verdicts([chapter]).values())]
        for chapter in chapters
    ]  # fmt: skip
    return sortable(heads, [rows], "Verdicts by study")


def _table(chapter: Chapter) -> Markup:
    """Each row: our mean with its interval, the published value, the ratio, and the runs."""
    metrics = chapter["metrics"]
    with_published = {
        m["key"] for m in metrics
        if any(row["figures"][m["key"]]["published"] is not None for row in chapter["rows"])
    }  # fmt: skip
    heads = [Head("row")]
    for m in metrics:
        heads.append(Head(m["name"], m["unit"], "ours: mean and 95 % interval"))
        if m["key"] in with_published:
            heads += [Head("published", m["unit"], "as printed"),
                      Head("ratio", "ours / published")]  # fmt: skip
    heads.append(Head("solved", "of runs"))

    def cells(row: Mapping[str, Any]) -> Iterator[Cell]:
        yield Cell(row["row"])
        for m in metrics:
            figures, digits = row["figures"][m["key"]], m["digits"]
            mean, low, high = (
                f"{figures[key]:.{digits}f}" if known(figures[key]) else "?"
                for key in ("mean", "low", "high")
            )
            yield Cell("-") if mean == "?" else Cell(mean, f"{low}-{high}", figures["mean"])
            if m["key"] in with_published:
                for key, form in (("published", "g"), ("ratio", ".3g")):
                    value = figures[key]
                    yield Cell(f"{value:{form}}", key=value) if known(value) else Cell("-")
        yield Cell(f"{row['solved']}/{row['runs']}", key=row["solved"] / max(row["runs"], 1))

    def group(row: Mapping[str, Any]) -> str:
        return str(row["row"]).split(" lambda")[0] if " lambda" in row["row"] else ""

    bodies = [[list(cells(row)) for row in rows] for _, rows in groupby(chapter["rows"], group)]
    return sortable(heads, bodies, f"{chapter['runs']} runs of each row and map or goal")
