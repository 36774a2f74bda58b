"""One page about an evaluation: the answer first, then tables, figures, failures, provenance."""

from __future__ import annotations

import base64
import html
from collections.abc import Iterator, Mapping, Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any

from agents.figures import figures
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
from wheelchair_gym.files import whole

Evaluation = Mapping[str, Any]
Record = Mapping[str, Any]

_KINDS = {
    ".png": "image/png", ".gif": "image/gif", ".jpg": "image/jpeg", ".svg": "image/svg+xml",
    ".mp4": "video/mp4",
}  # fmt: skip
_LARGEST_VIDEO = 12e6  # bytes: a larger one is linked, lest the page grow too heavy to open
_SHARE = next(column for column in COLUMNS if column.key == "success")


def write_report(evaluation: Evaluation, folder: str | Path) -> Path:
    """Write report.html, which needs no other file, and its figures as figures/*.svg.

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
    place = files("agents") / "data"
    parts = {
        "title": _text(evaluation["title"]),
        "style": (place / "report.css").read_text(encoding="utf-8"),
        "script": (place / "report.js").read_text(encoding="utf-8"),
        "body": "\n".join(_body(evaluation, folder, drawn)),
    }
    page = (place / "report.html").read_text(encoding="utf-8")
    for key, value in parts.items():  # the body last: what it quotes is not filled in again
        page = page.replace("{{" + key + "}}", value)
    with whole(folder / "report.html") as part:
        part.write_text(page, encoding="utf-8")
    return folder / "report.html"


def _text(value: Any) -> str:
    return html.escape(str(value))


def _body(
    evaluation: Evaluation, folder: Path, drawn: Mapping[str, tuple[str, bytes]]
) -> Iterator[str]:
    policies, scenes = evaluation["policies"], evaluation["scenes"]
    records = evaluation["records"]
    yield f"<header><h1>{_text(evaluation['title'])}</h1>"
    asked = (
        f"{_count(len(policies), 'policy', 'policies')} on {_count(len(scenes), 'scene')}, "
        f"{_count(len(records), 'episode')}: which gets the chair to its goal, and how well?"
    )
    yield f"<p class='asked'>{_text(asked)}</p></header>"
    yield f"<section class='answer'>{answer(evaluation)}</section>"
    yield "<section><h2>Results</h2>"
    yield _table(overall(evaluation["summary"]), "All scenes, best first", scenes=False)
    yield _table(by_scene(evaluation["summary"]), "By scene", scenes=True)
    yield (
        "<p class='note'>Success and collision are by truth; <i>own estimate arrived</i> is what "
        "the chair believed. Small figures are 95 % Wilson intervals. SPL: success weighted by "
        "geodesic over driven length. Click a heading to sort.</p></section>"
    )
    yield "<section><h2>Figures</h2><div class='figures'>"
    for words, svg in drawn.values():
        source = _data_uri(svg, ".svg")
        yield (
            f"<figure><img src='{source}' alt='{_text(words)}'>"
            f"<figcaption>{_text(words)}</figcaption></figure>"
        )
    yield "</div></section>"
    yield from _video(evaluation.get("video"), folder)
    yield from _failures(records, folder)
    yield from _provenance(evaluation)


def answer(evaluation: Evaluation) -> str:
    """Who is best, how sure that is, and what went wrong, as HTML."""
    rows = overall(evaluation["summary"])
    if not rows or not evaluation["records"]:
        return "<p>No episodes were recorded.</p>"
    best = rows[0]
    said = [
        f"<p class='lead'><strong>{_text(best['policy'])}</strong> "
        f"{'is best: it ' if len(rows) > 1 else ''}reaches the goal in "
        f"<strong>{written(best['success'], _SHARE)} %</strong> of "
        f"{_count(best['episodes'], 'episode')} "
        f"(95 % Wilson interval {bounds_written(best, _SHARE)} %).</p>"
    ]
    if len(rows) > 1:
        second = rows[1]
        clear = best["success_low"] > second["success_high"]
        verdict = "the intervals do not overlap" if clear else (
            "the intervals overlap, so these episodes alone do not tell the two apart"
        )  # fmt: skip
        said.append(
            f"<p>Next is {_text(second['policy'])} with {written(second['success'], _SHARE)} % "
            f"({bounds_written(second, _SHARE)} %); {verdict}.</p>"
        )
    of = [r for r in evaluation["records"] if r["policy"] == best["policy"]]
    hits = sum(r["outcome"] == "collision" for r in of)
    late = sum(r["outcome"] == "timeout" for r in of)
    other = sum(not r["success"] for r in of) - hits - late
    failed = f"{_count(hits, 'collision')}, {_count(late, 'timeout')}"
    if other > 0:
        failed += f", {_count(other, 'other failure')}"
    said.append(f"<p>What went wrong for {_text(best['policy'])}: {failed}.</p>")
    return "".join(said)


def _count(number: int, one: str, many: str | None = None) -> str:
    return f"{number} {one if number == 1 else many or one + 's'}"


def _table(rows: Sequence[Record], caption: str, *, scenes: bool) -> str:
    if not rows:
        return ""
    names = ["policy", "scene"] if scenes else ["policy"]
    heads = "".join(f"<th scope='col'><button type='button'>{name}</button></th>" for name in names)
    for column in COLUMNS:
        unit = f"<small>{_text(column.unit) or '&nbsp;'}</small>"
        heads += (
            f"<th scope='col' class='n' title='{_text(heading(column))}'>"
            f"<button type='button'>{_text(column.name)}{unit}</button></th>"
        )
    lines = []
    for row in rows:
        name = _text(row["policy"]).replace("_", "_<wbr>")
        cells = f"<th scope='row'>{name}</th>"
        cells += f"<td>{_text(row['scene'])}</td>" if scenes else ""
        cells += "".join(_cell(row, column) for column in COLUMNS)
        lines.append(f"<tr>{cells}</tr>")
    return (
        f"<div class='wide' tabindex='0' role='region' aria-label='{_text(caption)}'><table>"
        f"<caption>{_text(caption)}</caption><thead><tr>{heads}</tr></thead>"
        f"<tbody>{''.join(lines)}</tbody></table></div>"
    )


def _cell(row: Record, column: Column) -> str:
    value = row.get(column.key)
    key = f"{value:.9g}" if known(value) else ""
    interval = bounds_written(row, column)
    small = f"<small>{interval}</small>" if interval else ""
    return f"<td class='n' data-key='{key}'>{written(value, column)}{small}</td>"


def _data_uri(data: bytes, suffix: str) -> str:
    return f"data:{_KINDS[suffix]};base64,{base64.b64encode(data).decode()}"


def _embedded(folder: Path, name: str | None) -> str | None:
    """A file as a data URI; None where there is none of that name."""
    path = folder / name if name else None
    if path is None or not path.is_file() or path.suffix not in _KINDS:
        return None
    return _data_uri(path.read_bytes(), path.suffix)


def _video(name: str | None, folder: Path) -> Iterator[str]:
    source = _embedded(folder, name)
    if name is None or source is None:
        return
    words = "The best policy on one of its episodes"
    yield "<section class='film'><h2>Video</h2>"
    if not name.endswith(".mp4"):
        yield f"<img src='{source}' alt='{words}'>"
    elif (folder / name).stat().st_size <= _LARGEST_VIDEO:
        yield f"<video controls muted playsinline preload='metadata' src='{source}'></video>"
    yield f"<p class='note'>{words}: <a href='{_text(name)}'>{_text(name)}</a></p></section>"


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


def _failures(records: Sequence[Record], folder: Path) -> Iterator[str]:
    failed = [record for record in records if not record["success"]]
    yield f"<section><h2>Failures <small>{len(failed)} of {len(records)}</small></h2>"
    if not failed:
        yield "<p>None: every episode reached its goal.</p>"
    yield "<div class='gallery'>"
    for record in failed:
        name = f"{record['policy']}, {record['scene']}, seed {record['seed']}"
        said = what_happened(record)
        source = _embedded(folder, record.get("picture"))
        shown = f"<img src='{source}' alt='{_text(f'{name}: {said}')}'>" if source else (
            "<div class='absent'>no picture</div>"
        )  # fmt: skip
        yield (
            f"<figure>{shown}<figcaption><strong>{_text(name)}</strong> "
            f"<span class='{_text(record['outcome'])}'>{_text(said)}</span></figcaption></figure>"
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


def _provenance(evaluation: Evaluation) -> Iterator[str]:
    yield "<section><h2>Provenance</h2><p>Run it again:</p>"
    yield f"<pre>{_text(evaluation['command'])}</pre><dl>"
    for name, text in _flat(evaluation["provenance"]):
        yield f"<div><dt>{_text(name)}</dt><dd>{_text(text)}</dd></div>"
    yield "</dl></section>"
