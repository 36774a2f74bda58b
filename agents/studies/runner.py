"""All studies of agents/data/studies.yaml: their runs, tests of claims, and written files."""

import time
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from itertools import chain, groupby, product
from pathlib import Path
from typing import Any, Final

import matplotlib as mpl
import numpy as np

from agents import read_data
from agents.evaluation import tables
from agents.evaluation.plots import LOOK, as_svg
from agents.evaluation.provenance import command_line, now, provenance, write_json, write_text
from agents.evaluation.runs import compute, run_key, source_digest
from agents.evaluation.statistics import wilson
from agents.evaluation.tables import Cell, Column, Figures, Table
from agents.studies.claims import LEVEL, Claim, ClaimVerdict, agreement, no_evidence
from agents.studies.experiments import kernel_key, measure
from agents.studies.figures import FIGURES, gains, mean_interval
from agents.studies.model import Metric, Results, Row, Study, published
from planners.rrt_star_woa.thesis import FIGURE_3_1
from wheelchair_gym.base.files import atomic_write
from wheelchair_gym.base.settings import InputError

Chapter = Mapping[str, Any]

_WORST_FIRST = ClaimVerdict.FAILS, ClaimVerdict.OPEN, ClaimVerdict.HOLDS


def count_verdicts(chapters: Sequence[Chapter]) -> dict[ClaimVerdict, int]:
    """The number of claims with each verdict."""
    verdicts = [claim["verdict"] for chapter in chapters for claim in chapter["claims"]]
    return {verdict: verdicts.count(verdict) for verdict in ClaimVerdict}


def _totals(chapters: Sequence[Chapter]) -> str:
    hold, fail, undecided = count_verdicts(chapters).values()
    total = hold + fail + undecided
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
    if not tables.exists(claim["effect"]):
        return str(claim["test"])
    sign = "" if claim["test"].startswith("binomial") else "+"
    effect, low, high = (
        f"{round(claim[key], 6):{sign}.3g}" if tables.exists(claim[key]) else "?"
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
             "class": verdict.name.lower()}
            for verdict in _WORST_FIRST
            for claim in chapter["claims"]
            if claim["verdict"] == verdict
        ]  # fmt: skip
        fits = None
        if readings := chapter["readings"]:  # by how well they predict the printed lengths
            head = f"{readings[0]['rows']} printed mean lengths; intervals by bootstrap over them"
            fits = tables.make_table(head, tables.columns_of("readings"), [readings])
        table = None if fits else _table(chapter)
        found.append({**chapter, "claims": claims, "table": table, "fits": fits, "drawn": drawn})
    return tables.write_page(
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


def _table(chapter: Chapter) -> Table:
    """Each row: our mean with its interval, the published value, the ratio, and the runs."""
    columns = [Column("row", "row", None)]
    for m in chapter["metrics"]:
        key, unit, of = m["key"], m["unit"], "mean and 95 % interval"
        columns.append(Column(key, m["name"], unit, m["digits"], interval=True, meaning=of))
        if any(tables.exists(row["figures"][key]["published"]) for row in chapter["rows"]):
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


def _combinations(axes: Sequence[Any]) -> Iterator[dict[str, Any]]:
    """Every choice of one item from each axis: {name: values}, or a list of {name: value}."""
    lists = [
        [{name: value} for name, values in axis.items() for value in values]
        if isinstance(axis, Mapping)
        else axis
        for axis in axes
    ]
    for chosen in product(*lists):
        yield {name: value for values in chosen for name, value in values.items()}


def _filled(value: Any, names: Mapping[str, Any]) -> Any:
    """A part of a job with the values of names for each `$name`, and a part of figure 3.1."""
    if isinstance(value, Mapping):
        filled = {key: _filled(item, names) for key, item in value.items()}
        return {**FIGURE_3_1.settings.get(filled.pop("figure_3_1", ""), {}), **filled}
    if isinstance(value, list):
        return [_filled(item, names) for item in value]
    named = isinstance(value, str) and value.startswith("$")
    return _filled(names[value[1:]], names) if named else value


def _rows(
    study: str, *, vary: Sequence[Any], label: str, stratum: str, job: Mapping[str, Any],
    over: Sequence[Any] = (), x: str | float = float("nan"), series: str = "", group: str = "",
) -> Iterator[Row]:  # fmt: skip
    """A row for each combination of the values in `vary`, a job for each of those in `over`."""
    for names in _combinations(vary):
        places = [names | more for more in _combinations(over)]
        jobs = {stratum.format(**of): _filled(job, of) for of in places}
        title = label.format(**names)
        yield Row(
            title, jobs, float(_filled(x, names)), series.format(**names), group.format(**names),
            published(study).get(title, {}),
        )  # fmt: skip


def _readings(
    *, readings: Sequence[Mapping[str, Any]], of: Sequence[str], known: Mapping[str, Study]
) -> Iterator[Row]:
    """The rows of studies of the global variant, once for each reading; x is the printed length.

    A reading has a name, a `leader`, the `goal_bias` of the tree, and whether mu's branches are
    exchanged: below mu a whale spirals, which is the same as a mu of 1 - mu.
    """
    for reading, name in product(readings, of):
        for row in known[name].rows:
            jobs = {}
            for stratum, job in row.jobs.items():
                planner = dict(job["planner"])
                tree = {"name": "rrt_star", **planner["tree"], "goal_bias": reading["goal_bias"]}
                whales = {**planner["whales"], "leader": reading["leader"]}
                if reading["exchanged"]:
                    whales["mu"] = 1.0 - whales.get("mu", 0.5)
                planner = {**planner, "whales": whales}
                jobs[stratum] = {"kind": "shortened", "scene": job["scene"], "tree": tree,
                                 "planner": planner}  # fmt: skip
            yield Row(
                f"{reading['name']}: {name}, {row.label}", jobs, row.published["length_m"],
                reading["name"], name,
            )  # fmt: skip


def _study(name: str, values: dict[str, Any], known: Mapping[str, Study]) -> Study:
    figure, *arguments = values.pop("figures")
    groups = values.pop("rows")
    rows = (_readings(**g, known=known) if "readings" in g else _rows(name, **g) for g in groups)
    parts = {
        "rows": chain.from_iterable(rows),
        "metrics": [Metric(**metric) for metric in values.pop("metrics")],
        "claims": [Claim(**claim) for claim in values.pop("claims")],
        "notes": values.pop("notes"),
    }
    tuples: dict[str, Any] = {key: tuple(part) for key, part in parts.items()}
    draw = partial(FIGURES[figure], **arguments[0] if arguments else {})
    return Study(name=name, figures=draw, **tuples, **values)


STUDIES: Final[dict[str, Study]] = {}
for _name, _values in read_data("studies.yaml").items():
    if not _name.startswith("."):
        STUDIES[_name] = _study(_name, _values, STUDIES)  # some take rows of those before

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
FORMAT = 1


def study_jobs(study: Study, runs: int) -> dict[tuple[str, str, int], tuple[str, dict[str, Any]]]:
    """(row, stratum, seed) -> the key of the run and its job; equal runs of rows have one key."""
    # A record depends on this code alone, not on how it is tested or drawn.
    modules = "evaluation/metrics", "evaluation/tables", "studies/experiments", "studies/model"
    own = (f"agents/{module}.py" for module in modules)
    source = source_digest("wheelchair_gym", "planners", *own)
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
        write_text(folder / f"{study.name}.csv", tables.csv_table(lines))
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
    write_text(folder / "verdicts.csv", tables.csv_table(verdicts))
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
        "mean": tables.json_value(mean),
        "low": tables.json_value(low),
        "high": tables.json_value(high),
        "runs": len(values),
        "published": given,
        "ratio": tables.json_value(mean / given) if given else None,
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
            "printed": tables.json_value(100.0 * claim.printed_effect(study)),
            **{key: tables.json_value(getattr(evidence, key)) for key in ("effect", "low", "high")},
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
