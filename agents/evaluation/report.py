"""One page about an evaluation: the answer first, then tables, figures, failures, provenance."""

from __future__ import annotations

import base64
import html
from collections.abc import Iterator, Mapping, Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any
from urllib.parse import quote

from agents.evaluation import ranking
from agents.evaluation.figures import figures
from agents.evaluation.html_tables import glossary, html_table, ranked_by_scene
from agents.evaluation.tables import COLUMNS, bounds_written, known, overall, written
from wheelchair_gym.files import whole
from wheelchair_gym.rendering.video import webp

Evaluation = Mapping[str, Any]
Record = Mapping[str, Any]

_KINDS = {
    ".gif": "image/gif", ".svg": "image/svg+xml", ".mp4": "video/mp4", ".webp": "image/webp",
}  # fmt: skip
# What is embedded, in bytes; beyond it files are linked, lest the page grow too heavy to open.
_LARGEST_VIDEO = 3e6
_MOST_PICTURES = 3e6  # some 500 failures
_LEGEND = (
    "Blue: the chair and the way it drove, from the grey ring. Green: its goal and its path. Red: "
    "laser. Yellow: ultrasonic echoes. Purple outline: where it believed to be."
)
_SHARE = next(column for column in COLUMNS if column.key == "success")


def write_report(evaluation: Evaluation, folder: str | Path) -> Path:
    """Write report.html and its figures as figures/*.svg.

    The page needs no other file, unless a long video or hundreds of failures would make it heavy:
    then it shows them from beside it.

    Args:
        evaluation: the content of results.json.
        folder: where it lies; pictures and the video are named relative to it.

    Returns:
        The page's path.
    """
    folder = Path(folder)
    drawn = figures(evaluation)
    for name, (_, svg) in drawn.items():
        with whole(folder / "figures" / f"{name}.svg") as part:
            part.write_bytes(svg)
    path = folder / "report.html"
    return write_page(path, evaluation["title"], _body(evaluation, folder, drawn))


def write_page(path: Path, title: str, body: Iterator[str]) -> Path:
    """Write a page with the reports' style and sorting tables; its path."""
    place = files("agents") / "data"
    parts = {
        "title": as_text(title),
        "style": (place / "report.css").read_text(encoding="utf-8"),
        "script": (place / "report.js").read_text(encoding="utf-8"),
        "body": "\n".join(body),
    }
    page = (place / "report.html").read_text(encoding="utf-8")
    for key, value in parts.items():  # the body last: what it quotes is not filled in again
        page = page.replace("{{" + key + "}}", value)
    with whole(path) as part:
        part.write_text(page, encoding="utf-8")
    return path


def as_text(value: Any) -> str:
    """Any value as text that HTML may hold."""
    return html.escape(str(value))


def _body(
    evaluation: Evaluation, folder: Path, drawn: Mapping[str, tuple[str, bytes]]
) -> Iterator[str]:
    policies, scenes = evaluation["policies"], evaluation["scenes"]
    records = evaluation["records"]
    yield f"<header><h1>{as_text(evaluation['title'])}</h1>"
    asked = (
        f"{_count(len(policies), 'policy', 'policies')} on {_count(len(scenes), 'scene')}, "
        f"{_count(len(records), 'episode')}: which gets the chair to its goal, and how well?"
    )
    yield f"<p class='asked'>{as_text(asked)}</p></header>"
    yield f"<section class='answer'>{answer(evaluation)}</section>"
    yield "<section><h2>Results</h2>"
    ranked = overall(evaluation["summary"])
    several = len(scenes) > 1
    caption = "All scenes, best first" if several else "Best first"
    yield html_table([ranked], caption, scenes=False)
    yield ranking.table(evaluation)
    if several:
        yield html_table(ranked_by_scene(evaluation), "By scene, best first", scenes=True)
    yield "<p class='note'>Small figures are 95 % Wilson intervals. Best is most success, then "
    yield f"highest SPL. Click a heading to sort.</p>{glossary()}</section>"
    yield "<section><h2>Figures</h2>"
    yield from gallery(drawn)
    yield "</section>"
    video = list(_video(evaluation["video"], folder))
    yield from video
    legend = "" if video else _LEGEND  # once is enough
    yield from _failures(records, [row["policy"] for row in ranked], folder, legend)
    yield from provenance(evaluation)


def gallery(drawn: Mapping[str, tuple[str, bytes]]) -> Iterator[str]:
    """Figures, each with what it shows, embedded."""
    yield "<div class='figures'>"
    for words, svg in drawn.values():
        source = _data_uri(svg, ".svg")
        yield (
            f"<figure><img src='{source}' alt='{as_text(words)}'>"
            f"<figcaption>{as_text(words)}</figcaption></figure>"
        )
    yield "</div>"


def answer(evaluation: Evaluation) -> str:
    """Who is best, how sure that is, and what went wrong, as HTML."""
    rows = overall(evaluation["summary"])
    if not rows or not evaluation["records"]:
        return "<p>No episodes were recorded.</p>"
    best = rows[0]
    beside = ranking.learned_beside_planned(evaluation)
    lead = "<p class='lead'>"
    said = [f"{lead}{as_text(beside)}</p>"] if beside else []
    said += [
        f"{'<p>' if beside else lead}<strong>{as_text(best['policy'])}</strong> "
        f"{_standing(rows)}reaches the goal in "
        f"<strong>{written(best['success'], _SHARE)} %</strong> of "
        f"{_count(best['episodes'], 'episode')} "
        f"(95 % Wilson interval {bounds_written(best, _SHARE)} %).</p>"
    ]
    if len(rows) > 1:
        second = rows[1]
        clear = best["success_low"] > second["success_high"]
        verdict = "the intervals do not overlap" if clear else (
            "the intervals overlap, so these episodes alone may not tell the two apart"
        )  # fmt: skip
        said.append(
            f"<p>Next is {as_text(second['policy'])} with {written(second['success'], _SHARE)} % "
            f"({bounds_written(second, _SHARE)} %); {verdict}.</p>"
        )
    of = [r for r in evaluation["records"] if r["policy"] == best["policy"]]
    hits = sum(r["outcome"] == "collision" for r in of)
    late = sum(r["outcome"] == "timeout" for r in of)
    other = sum(not r["success"] for r in of) - hits - late
    failed = f"{_count(hits, 'collision')}, {_count(late, 'timeout')}"
    if other > 0:
        failed += f", {_count(other, 'other failure')}"
    said.append(f"<p>What went wrong for {as_text(best['policy'])}: {failed}.</p>")
    return "".join(said).replace(" %", "&nbsp;%")


def _standing(rows: Sequence[Record]) -> str:
    """How the first of ranked rows leads: alone, by success, or among equals by SPL alone."""
    if len(rows) == 1:
        return ""
    tied = rows[0]["success"] == rows[1]["success"]
    return "comes first, by SPL alone: it " if tied else "is best: it "


def _count(number: int, one: str, many: str | None = None) -> str:
    return f"{number} {one if number == 1 else many or one + 's'}"


def _beside(name: str) -> str:
    """A file of the report's folder as an address; names may hold what addresses may not."""
    return quote(name)


def _data_uri(data: bytes, suffix: str) -> str:
    return f"data:{_KINDS[suffix]};base64,{base64.b64encode(data).decode()}"


def _video(video: Record | None, folder: Path) -> Iterator[str]:
    path = folder / video["file"] if video else None
    if video is None or path is None or not path.is_file():
        return
    small = path.stat().st_size <= _LARGEST_VIDEO
    source = _data_uri(path.read_bytes(), path.suffix) if small else _beside(video["file"])
    words = as_text(_episode(video))
    yield "<section class='film'><h2>Video</h2>"
    if path.suffix == ".mp4":
        yield f"<video controls muted playsinline preload='metadata' src='{source}'></video>"
    else:
        yield f"<img src='{source}' alt='{words}'>"
    link = f"<a href='{_beside(video['file'])}'>{as_text(video['file'])}</a>"
    yield f"<p class='note'>{words}: {link}. {_LEGEND}</p></section>"


def _episode(record: Record) -> str:
    return f"{record['policy']}, {record['scene']}, seed {record['seed']}"


def what_happened(record: Record) -> str:
    """One line about an episode that failed."""
    after = f"after {record['time']:.1f} s" if known(record["time"]) else "at an unknown time"
    ends = {
        "collision": f"hit something {after}",
        "timeout": f"out of time {after}",
        "missed": f"stopped short of its goal {after}",
    }
    said = ends.get(record["outcome"], f"ended {after}")
    if known(record["length"]) and known(record["geodesic"]):
        said += f", {record['length']:.1f} m driven, shortest way {record['geodesic']:.1f} m"
    if record["arrived"]:
        said += "; it believed it had arrived"
    return said


def _failures(
    records: Sequence[Record], policies: Sequence[str], folder: Path, legend: str
) -> Iterator[str]:
    """Every failure with its picture, those of the best policy first."""
    failed = [record for record in records if not record["success"]]
    failed.sort(key=lambda record: policies.index(record["policy"]))
    yield f"<section><h2>Failures <small>{len(failed)} of {len(records)}</small></h2>"
    if not failed:
        yield "<p>None: every episode reached its goal.</p>"
    else:
        yield f"<p class='note'>How each ended, the best policy's first. {legend}</p>"
    room = _MOST_PICTURES
    yield "<div class='gallery'>"
    for record in failed:
        name = _episode(record)
        said = what_happened(record)
        shown, picture = "<div class='absent'>no picture</div>", record.get("picture")
        if picture and (folder / picture).is_file():
            source = _data_uri(webp(folder / picture), ".webp") if room > 0 else _beside(picture)
            room -= len(source)
            shown = (
                f"<a href='{_beside(picture)}'>"
                f"<img src='{source}' alt='{as_text(f'{name}: {said}')}' loading='lazy'></a>"
            )
        yield (
            f"<figure>{shown}<figcaption><strong>{as_text(name)}</strong> "
            f"<span class='{as_text(record['outcome'])}'>{as_text(said)}</span>"
            "</figcaption></figure>"
        )
    yield "</div></section>"


def _flat(value: Any, name: str = "") -> Iterator[tuple[str, str]]:
    """Nested values as (dotted name, text); plain lists stay on one line."""
    if isinstance(value, Mapping) and value:
        for key, item in value.items():
            yield from _flat(item, f"{name}.{key}" if name else str(key))
    elif isinstance(value, list | tuple) and any(isinstance(v, Mapping | list) for v in value):
        for k, item in enumerate(value):
            yield from _flat(item, f"{name}[{k}]")
    elif isinstance(value, list | tuple):
        whole = all(isinstance(v, int) for v in value) and len(value) > 3
        run = whole and list(value) == list(range(value[0], value[0] + len(value)))
        yield name, f"{value[0]} to {value[-1]}" if run else ", ".join(map(str, value))
    else:
        yield name, "-" if value is None or value == {} else str(value)


def provenance(evaluation: Evaluation) -> Iterator[str]:
    """How to run it again, and with what it ran: keys `command` and `provenance`."""
    yield "<section><h2>Provenance</h2><p>Run it again:</p>"
    yield f"<pre>{as_text(evaluation['command'])}</pre><dl>"
    for name, text in _flat(evaluation["provenance"]):
        yield f"<div><dt>{as_text(name)}</dt><dd>{as_text(text)}</dd></div>"
    yield "</dl></section>"
