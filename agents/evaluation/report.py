"""The page of an evaluation: the answer first, then tables, figures, failures, provenance."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any
from urllib.parse import quote

from markupsafe import Markup

from agents.evaluation import ranking
from agents.evaluation.figures import figures
from agents.evaluation.html_tables import (
    MEANINGS,
    data_uri,
    macro,
    ranked_by_scene,
    summary_table,
    write_page,
)
from agents.evaluation.tables import COLUMNS, bounds_written, heading, known, overall, written
from wheelchair_gym.files import atomic_write
from wheelchair_gym.rendering.video import webp

Evaluation = Mapping[str, Any]
Record = Mapping[str, Any]

# Bytes that are embedded; larger files are linked, so that the page stays quick to open.
_LARGEST_VIDEO = 3e6
_MOST_PICTURES = 3e6  # about 500 failures
_LEGEND = (
    "Blue: the chair and its trail, from the grey ring. Green: goal and path. Red: laser. Yellow: "
    "ultrasonic echoes. Purple outline: the estimated pose."
)
_SHARE = next(column for column in COLUMNS if column.key == "success")


def write_report(evaluation: Evaluation, folder: str | Path) -> Path:
    """Write report.html and its figures as figures/*.svg.

    The page needs no other file, unless a long video or hundreds of failures would make it large:
    then it links them.

    Args:
        evaluation: the content of results.json.
        folder: that holds the pictures and the video, and gets the page.

    Returns:
        The page's path.
    """
    folder = Path(folder)
    drawn = figures(evaluation)
    for name, (_, svg) in drawn.items():
        with atomic_write(folder / "figures" / f"{name}.svg") as part:
            part.write_bytes(svg)
    ranked = overall(evaluation["summary"])
    policies, scenes = evaluation["policies"], evaluation["scenes"]
    several = len(scenes) > 1
    tables = [
        summary_table([ranked], f"{'All scenes, best' if several else 'Best'} first", scenes=False),
        ranking.table(evaluation),
    ]
    if several:
        caption = "By scene, best first"
        tables.append(summary_table(ranked_by_scene(evaluation), caption, scenes=True))
    question = (
        f"{_count(len(policies), 'policy', 'policies')} on {_count(len(scenes), 'scene')}, "
        f"{_count(len(evaluation['records']), 'episode')}: which gets the chair to its goal, and "
        "how well?"
    )
    return write_page(
        folder / "report.html", "evaluation.html", title=evaluation["title"], source=evaluation,
        question=question, answer=answer(evaluation), tables=tables, figures=drawn,
        glossary=[(heading(column), MEANINGS[column.key]) for column in COLUMNS],
        video=_video(evaluation["video"], folder), legend=_LEGEND,
        failures=_failures(evaluation["records"], [row["policy"] for row in ranked], folder),
    )  # fmt: skip


def answer(evaluation: Evaluation) -> Markup:
    """The best policy, how certain that is, and how its episodes failed, as HTML."""
    rows = overall(evaluation["summary"])
    if not rows or not evaluation["records"]:
        return macro("answer", None)
    best, second = rows[0], rows[1] if len(rows) > 1 else None
    tied = second is not None and best["success"] == second["success"]
    outcomes = [r["outcome"] for r in evaluation["records"] if r["policy"] == best["policy"]]
    hits, late = outcomes.count("collision"), outcomes.count("timeout")
    failed = sum(not r["success"] for r in evaluation["records"] if r["policy"] == best["policy"])
    failures = f"{_count(hits, 'collision')}, {_count(late, 'timeout')}"
    if (other := failed - hits - late) > 0:
        failures += f", {_count(other, 'other failure')}"
    texts: dict[str, Any] = {
        "comparison": ranking.learned_beside_planned(evaluation),
        "best": best,
        "lead": "" if second is None else "comes first, by SPL alone: it " if tied else
                "is best: it ",
        "share": _percent(written(best["success"], _SHARE)),
        "interval": _percent(bounds_written(best, _SHARE)),
        "episodes": _count(best["episodes"], "episode"),
        "failures": failures,
        "second": second,
    }  # fmt: skip
    if second is not None:
        texts |= {
            "second_share": _percent(written(second["success"], _SHARE)),
            "second_interval": _percent(bounds_written(second, _SHARE)),
            "certain": best["success_low"] > second["success_high"],
        }
    return macro("answer", texts)


def _percent(text: str) -> str:
    return f"{text}\N{NO-BREAK SPACE}%"


def _count(number: int, one: str, many: str | None = None) -> str:
    return f"{number} {one if number == 1 else many or one + 's'}"


def _video(video: Record | None, folder: Path) -> dict[str, str] | None:
    path = folder / video["file"] if video else None
    if video is None or path is None or not path.is_file():
        return None
    small = path.stat().st_size <= _LARGEST_VIDEO
    source = data_uri(path.read_bytes(), path.suffix) if small else quote(video["file"])
    return {"file": video["file"], "source": source, "episode": _episode(video)}


def _episode(record: Record) -> str:
    return f"{record['policy']}, {record['scene']}, seed {record['seed']}"


def failure_text(record: Record) -> str:
    """How a failed episode ended, in one line."""
    after = f"after {record['time']:.1f} s" if known(record["time"]) else "at an unknown time"
    ends = {
        "collision": f"hit something {after}",
        "timeout": f"out of time {after}",
        "missed": f"stopped short of its goal {after}",
    }
    text = ends.get(record["outcome"], f"ended {after}")
    if known(record["length"]) and known(record["geodesic"]):
        text += f", {record['length']:.1f} m driven, shortest path {record['geodesic']:.1f} m"
    if record["arrived"]:
        text += "; its estimate was at the goal"
    return text


def _failures(
    records: Sequence[Record], policies: Sequence[str], folder: Path
) -> list[dict[str, Any]]:
    """Every failure with its picture, those of the best policy first."""
    failed = [record for record in records if not record["success"]]
    failed.sort(key=lambda record: policies.index(record["policy"]))
    left, found = _MOST_PICTURES, []
    for record in failed:
        source, picture = "", record.get("picture")
        if picture and (folder / picture).is_file():
            source = data_uri(webp(folder / picture), ".webp") if left > 0 else quote(picture)
            left -= len(source)
        found.append({
            "episode": _episode(record), "end": failure_text(record), "source": source,
            "picture": picture, "outcome": record["outcome"],
        })  # fmt: skip
    return found
