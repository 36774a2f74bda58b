"""Studies as one page: the verdicts first, then a chapter for each."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import groupby
from pathlib import Path
from typing import Any

from agents.evaluation.html_tables import Cell, Head, sortable
from agents.evaluation.report import as_text, gallery, provenance
from agents.evaluation.report import write_page as page_of
from agents.evaluation.tables import known
from agents.studies.evidence import LEVEL, Verdict

Chapter = Mapping[str, Any]
Drawn = Mapping[str, tuple[str, bytes]]

_CLASS = {Verdict.HOLDS: "holds", Verdict.FAILS: "fails", Verdict.OPEN: "open"}
_WORSE_FIRST = (Verdict.FAILS, Verdict.OPEN, Verdict.HOLDS)


def counted(chapters: Sequence[Chapter]) -> dict[Verdict, int]:
    """Verdicts of all chapters."""
    every = [claim["verdict"] for chapter in chapters for claim in chapter["claims"]]
    return {verdict: every.count(verdict) for verdict in Verdict}


def _sum(chapters: Sequence[Chapter]) -> str:
    count = counted(chapters)
    return (
        f"Of {sum(count.values())} claims {count[Verdict.HOLDS]} hold, {count[Verdict.FAILS]} do "
        f"not, {count[Verdict.OPEN]} cannot be told"
    )


def told(chapters: Sequence[Chapter]) -> str:
    """The verdicts as lines of text."""
    lines = []
    for chapter in chapters:
        lines.append(f"{chapter['name']}: {chapter['title']} ({chapter['runs']} runs)")
        for claim in chapter["claims"]:
            lines.append(f"  {claim['verdict']:14s} {claim['claim']}: {_effect(claim)}")
    return "\n".join([*lines, _sum(chapters)])


def _effect(claim: Mapping[str, Any]) -> str:
    """The effect with its interval; a share has no sign."""
    if not known(claim["effect"]):
        return str(claim["test"])
    sign = "" if claim["test"].startswith("binomial") else "+"
    values = [round(claim[key], 6) if known(claim[key]) else None for key in _BOUNDS]
    effect, low, high = (f"{v:{sign}.3g}" if v is not None else "?" for v in values)
    bounds = "" if values[1] == values[2] else f" ({low} to {high})"
    return f"{effect}{bounds} {claim['unit']}"


_BOUNDS = ("effect", "low", "high")


def write_page(
    path: Path, title: str, chapters: Sequence[tuple[Chapter, Drawn]], whence: Mapping[str, Any]
) -> Path:
    """Write one page of all chapters, which needs no other file."""
    return page_of(path, title, _body(title, chapters, whence))


def _body(
    title: str, chapters: Sequence[tuple[Chapter, Drawn]], whence: Mapping[str, Any]
) -> Iterator[str]:
    only = [chapter for chapter, _ in chapters]
    yield f"<header><h1>{as_text(title)}</h1><p class='asked'>"
    yield "What five source documents measured, run again: which of their claims hold?</p></header>"
    yield f"<section class='answer'><p class='lead'>{_sum(only)}.</p>"
    count = counted(only)
    if count[Verdict.FAILS]:
        yield "<p>What does not hold:</p><ul class='claims'>"
        for chapter in only:
            for claim in chapter["claims"]:
                if claim["verdict"] == Verdict.FAILS:
                    yield _claim(claim, chapter["name"])
        yield "</ul>"
    yield "</section>"
    yield (
        "<p class='note'>A claim holds, or does not, where a test says so at a level of "
        f"{LEVEL:g} for all claims together (Bonferroni, whether or not their studies ran here). "
        "A claim of no effect needs the effect to lie within a margin. Intervals are 95 %, of one "
        "figure at a time. A difference that is certain but smaller than its margin may hold: "
        "mind its size.</p>"
    )
    if len(chapters) > 1:
        yield from _contents(only)
    for chapter, drawn in chapters:
        yield from _chapter(chapter, drawn)
    yield from provenance(whence)


def _contents(chapters: Sequence[Chapter]) -> Iterator[str]:
    heads = [Head("study"), Head("subject"), *(Head(str(v), "claims") for v in Verdict)]
    rows = []
    for chapter in chapters:
        count = counted([chapter])
        link = f"<a href='#{chapter['name']}'>{chapter['name']}</a>"
        cells = [Cell(str(n), key=n) for n in count.values()]
        rows.append([Cell(link), Cell(as_text(chapter["title"])), *cells])
    yield "<section><h2>Studies</h2>" + sortable(heads, [rows], "Verdicts by study") + "</section>"


def _claim(claim: Mapping[str, Any], chapter: str | None = None) -> str:
    where = as_text(claim["source"])
    if chapter is not None:
        where += f", <a href='#{chapter}'>{chapter}</a>"
    said = f"{as_text(claim['said'])}: " if claim["said"] else ""
    p = f"p = {claim['p_for']:.2g} for, {claim['p_against']:.2g} against"
    return (
        f"<li class='{_CLASS[claim['verdict']]}'><strong>{claim['verdict']}</strong> "
        f"{as_text(claim['claim'])} <small>({where})</small>"
        f"<small>{said}{_effect(claim)}; {as_text(claim['test'])}; {p}</small></li>"
    )


def _chapter(chapter: Chapter, drawn: Drawn) -> Iterator[str]:
    yield f"<section id='{chapter['name']}'><h2>{as_text(chapter['title'])} "
    yield f"<small>{as_text(chapter['source'])}</small></h2>"
    yield f"<p>{as_text(chapter['settings'])}</p><ul class='claims'>"
    ranked = sorted(chapter["claims"], key=lambda claim: _WORSE_FIRST.index(claim["verdict"]))
    yield from (_claim(claim) for claim in ranked)
    yield "</ul>"
    yield _table(chapter)
    yield from gallery(drawn)
    for note in chapter["notes"]:
        yield f"<p class='note'>{as_text(note)}</p>"
    yield "</section>"


def _table(chapter: Chapter) -> str:
    """Each row: ours with its interval, the published value and the ratio, and the runs."""
    metrics = chapter["metrics"]
    given = {
        m["key"] for m in metrics
        if any(row["figures"][m["key"]]["published"] is not None for row in chapter["rows"])
    }  # fmt: skip
    heads = [Head("row")]
    for m in metrics:
        heads.append(Head(m["name"], m["unit"], "ours: mean and 95 % interval"))
        if m["key"] in given:
            heads.append(Head("published", m["unit"], "as printed"))
            heads.append(Head("ratio", "ours / published"))
    heads.append(Head("solved", "of runs"))

    def cells(row: Mapping[str, Any]) -> Iterator[Cell]:
        yield Cell(as_text(row["row"]))
        for m in metrics:
            found, digits = row["figures"][m["key"]], m["digits"]
            if known(found["mean"]):
                low, high = (
                    f"{found[end]:.{digits}f}" if known(found[end]) else "?"
                    for end in ("low", "high")
                )
                yield Cell(f"{found['mean']:.{digits}f}", f"{low}-{high}", found["mean"])
            else:
                yield Cell("-")
            if m["key"] in given:
                for key, form in (("published", "g"), ("ratio", ".3g")):
                    value = found[key]
                    yield Cell(f"{value:{form}}", key=value) if known(value) else Cell("-")
        yield Cell(f"{row['solved']}/{row['runs']}", key=row["solved"] / max(row["runs"], 1))

    def kind(row: Mapping[str, Any]) -> str:
        return str(row["row"]).split(" lambda")[0] if " lambda" in row["row"] else ""

    bodies = [[list(cells(row)) for row in rows] for _, rows in groupby(chapter["rows"], kind)]
    return sortable(heads, bodies, f"{chapter['runs']} runs of each row and map or goal")
