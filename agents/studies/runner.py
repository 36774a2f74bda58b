"""All studies: their runs, the tests of their claims, and the files that are written."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import matplotlib as mpl
import numpy as np

from agents.evaluation.figures import LOOK, as_svg
from agents.evaluation.provenance import command_line, now, provenance, write_json, write_text
from agents.evaluation.runs import compute, run_key, source_digest
from agents.evaluation.statistics import wilson
from agents.evaluation.tables import csv_table, json_value
from agents.studies.agreement import agreement
from agents.studies.evidence import LEVEL, no_evidence
from agents.studies.experiments import kernel_key, measure
from agents.studies.figures import mean_interval
from agents.studies.gains import gains
from agents.studies.model import Metric, Results, Row, Study
from agents.studies.read_studies import STUDIES
from agents.studies.report import write_studies_page
from wheelchair_gym.config import InputError
from wheelchair_gym.files import atomic_write

# Verdicts are corrected for all claims, so that they do not depend on which studies run.
CLAIMS: Final = sum(len(study.claims) for study in STUDIES.values())


def find_studies(name: str) -> list[Study]:
    """One study by name, or `all`.

    Raises:
        InputError: the name is unknown.
    """
    if name == "all":
        return list(STUDIES.values())
    if name not in STUDIES:
        raise InputError(f"study {name!r} is unknown; known: all, {', '.join(STUDIES)}")
    return [STUDIES[name]]


STORE = "runs.jsonl"
VERDICTS = "verdicts.csv"
FORMAT = 1


def study_jobs(study: Study, runs: int) -> dict[tuple[str, str, int], tuple[str, dict[str, Any]]]:
    """(row, stratum, seed) -> the key of the run and its job; equal runs of rows have one key."""
    # A record depends on this code alone, not on how it is tested or drawn.
    source = source_digest("wheelchair_gym", "planners", "agents/studies/experiments.py")
    found = {}
    for row in study.rows:
        for stratum, job in row.jobs.items():
            cell = run_key(source, job)
            for seed in study.seeds(row, runs):
                found[row.label, stratum, seed] = f"{cell}-{seed}", {**job, "seed": seed}
    return found


def run_studies(
    studies: Sequence[Study],
    folder: str | Path,
    *,
    runs: int | None = None,
    quick: bool = False,
    jobs: int = 1,
    progress: bool = True,
    title: str | None = None,
) -> dict[str, Any]:
    """Make the missing runs, test the claims, and write all results to a folder.

    Args:
        studies: what to run.
        folder: for the store of runs, NAME.csv and NAME.json of each study, its figures, all
            verdicts, and one page, `report.html`.
        runs: of each row and stratum; None: the study's number.
        quick: few runs, for a first look.
        jobs: worker processes.
        progress: show a bar on standard error.
        title: of the page.

    Returns:
        The content of NAME.json by study.

    Raises:
        InputError: the folder cannot be written.
        StoppedError: Ctrl-C; the same call runs only what is missing.
    """
    started, folder = time.perf_counter(), Path(folder)
    if runs is not None and runs < 2:
        raise InputError(f"runs is {runs}; an interval takes at least 2")
    counts = {study.name: runs or (study.quick_runs if quick else study.runs) for study in studies}
    wanted = {study.name: study_jobs(study, counts[study.name]) for study in studies}
    records = compute(
        {key: job for of in wanted.values() for key, job in of.values()}, measure,
        folder / STORE, workers=jobs, progress=progress,
        before=_compile_all,
    )  # fmt: skip
    source: dict[str, Any] = {
        **provenance(jobs=jobs),
        "judged together": f"{CLAIMS} claims, level {LEVEL} for all, Bonferroni",
        "seeds": "as in the CSV: different for each row, equal for paired rows",
        "finished": now(),
    }
    chapters: dict[str, Any] = {}
    page = []
    for study in studies:
        runs_of = [(*where, records[key]) for where, (key, _) in wanted[study.name].items()]
        results = Results(study, runs_of)
        figures = _write_figures(study, results, folder)
        chapter = {
            **summary(study, results, counts[study.name]),
            "figures": {name: caption for name, (caption, _) in figures.items()},
        }
        lines = [
            {"study": study.name, "row": row, "stratum": stratum, "seed": seed}
            | {k: v for k, v in record.items() if not isinstance(v, list | dict)}
            for row, stratum, seed, record in runs_of
        ]
        write_text(folder / f"{study.name}.csv", csv_table(lines))
        write_json(folder / f"{study.name}.json", {
            "format": FORMAT, "command": command_line(), "provenance": source, **chapter,
        })  # fmt: skip
        chapters[study.name] = chapter
        page.append((chapter, figures))
    verdicts = [
        {"study": name, "commit": source["commit"]}
        | {k: float(f"{v:.5g}") if isinstance(v, float) else v for k, v in claim.items()}
        for name, chapter in chapters.items()
        for claim in chapter["claims"]
    ]
    write_text(folder / VERDICTS, csv_table(verdicts))
    source["wall_time_s"] = round(time.perf_counter() - started, 1)
    write_studies_page(
        folder / "report.html", title or "The experiments of the sources, repeated", page,
        {"command": command_line(), "provenance": source},
    )  # fmt: skip
    return chapters


def _compile_all(jobs: Sequence[Mapping[str, Any]]) -> None:
    """Compile in this process; workers then load the compiled code."""
    for job in {kernel_key(job): job for job in jobs}.values():
        measure(job)


def _write_figures(study: Study, results: Results, folder: Path) -> dict[str, tuple[str, bytes]]:
    """Each figure with its caption as SVG; also written as SVG and PNG."""
    found = {}
    with mpl.rc_context(LOOK):
        for name, figure in study.figures(results).items():
            svg = as_svg(figure)
            with atomic_write(folder / "figures" / f"{study.name}-{name}.svg") as part:
                part.write_bytes(svg)
            with atomic_write(folder / "figures" / f"{study.name}-{name}.png") as part:
                figure.savefig(part, format="png", dpi=150)
            found[name] = (study.captions[name], svg)
    return found


def cell_figures(results: Results, row: Row, metric: Metric) -> dict[str, Any]:
    """One cell: mean with its 95 % interval, runs, the published value and the ratio to it."""
    values = results.pooled(row.label, metric)
    if metric.unit == "share":
        hits = int(values.sum())
        mean = hits / len(values) if len(values) else np.nan
        low, high = wilson(hits, len(values))
    elif not np.isnan((found := mean_interval(results, row.label, metric))[0]):
        mean, low, high = found
    else:
        mean = low = high = float(values.mean()) if len(values) else np.nan
    given = row.published.get(metric.key)
    return {
        "mean": json_value(mean),
        "low": json_value(low),
        "high": json_value(high),
        "runs": len(values),
        "published": given,
        "ratio": json_value(mean / given) if given else None,
    }


def summary(study: Study, results: Results, runs: int) -> dict[str, Any]:
    """Every row and every claim, for JSON."""
    rows = []
    for row in study.rows:
        solved, made = results.solved(row.label)
        cells = {metric.key: cell_figures(results, row, metric) for metric in study.metrics}
        rows.append({"row": row.label, "solved": solved, "runs": made, "figures": cells})
    claims = []
    compared = any(claim.test == "follows" for claim in study.claims)  # readings with a source
    for claim in study.claims:
        try:
            evidence = claim.judge(results)
        except (ValueError, ZeroDivisionError) as error:  # too few values to test
            evidence = no_evidence(f"not testable: {error}")
        margin = claim.margin(study)
        claims.append({
            "claim": claim.text,
            "source": claim.source,
            "reading": claim.reading or study.reading,
            "printed": json_value(100.0 * claim.printed_effect(study)),
            **{key: json_value(getattr(evidence, key)) for key in ("effect", "low", "high")},
            "unit": evidence.unit,
            "margin": None if margin is None else 100.0 * margin,
            "verdict": str(evidence.verdict(CLAIMS)),
            "comparison": evidence.text,
            **{key: getattr(evidence, key) for key in ("test", "p_for", "p_against")},
            "runs": runs,
            "command": f"wheelchair study {study.name} --runs {runs}",
        })  # fmt: skip
    return {
        **{key: getattr(study, key) for key in ("name", "title", "source", "settings")},
        "notes": list(study.notes),
        "runs": runs,
        "metrics": [metric._asdict() for metric in study.metrics],
        "rows": rows,
        "claims": claims,
        "readings": agreement(results) if compared else [],
        "gains": gains(results) if study.name == "t1-budget" else [],
    }
