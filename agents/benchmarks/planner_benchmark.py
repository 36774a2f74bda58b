"""A planner benchmark: every entrant on every problem, on one core, stored, resumable and drawn."""

import contextlib
import dataclasses
import gc
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import product
from pathlib import Path
from textwrap import shorten
from time import perf_counter, process_time
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from agents import is_interrupt, read_data
from agents.benchmarks import entrants as contest
from agents.evaluation.metrics import path_figures
from agents.evaluation.plots import COLOURS, DASHES, LOOK, MARKS
from agents.evaluation.provenance import command_line, machine, now, provenance, write_json
from agents.evaluation.runs import compute, read_store, run_key, source_digest
from agents.evaluation.statistics import share
from agents.evaluation.tables import Cell, Column, Table
from planners import Plan
from planners.judge import plan_faults
from wheelchair_gym.base.files import atomic_write
from wheelchair_gym.base.settings import InputError, read_json

Row = dict[str, Any]
Record = dict[str, Any]

COLD, FREE = "cold", "free"  # budgets without a deadline: the first call on a map, and later calls
ALL = "all"  # problems together
LATE_FACTOR = 1.25  # an answer after this multiple of the deadline does not count


def deadline_key(deadline: float) -> str:
    """The part of a key for a deadline."""
    return f"{deadline:g}s"


def is_valid(record: Record) -> bool:
    """Whether a run ended with a path without faults."""
    return record.get("length_m") is not None and record["faults"] == 0


def first_path_time(record: Record) -> float:
    """Time of the first path [s]; of the whole run where the planner does not report it."""
    reported = record.get("first_path_s")
    return float(record["wall_s"] if reported is None else reported)


def _median(values: Iterable[float | None]) -> float | None:
    given = [value for value in values if value is not None]
    return float(np.median(given)) if given else None


def summary_row(
    entrant: contest.Entrant,
    problem: str,
    records: Sequence[Record],
    optima: Mapping[str, float | None],
    deadlines: Sequence[float],
) -> Row:
    """The figures of one entrant on one problem, or on all.

    Medians of times and path measures are over runs without a deadline that ended with a valid
    path. For a planner without deadlines a run counts at a deadline if it had ended by then.
    """

    def ratios(of: Iterable[Record]) -> float | None:
        lengths = ((record["length_m"], optima[record["problem"]]) for record in of)
        return _median(float(length / optimum) for length, optimum in lengths if optimum)

    free = [record for record in records if record["budget"] == FREE]
    good = [record for record in free if is_valid(record)]
    paths = [record for record in records if record.get("length_m") is not None]
    invalid = [record for record in paths if record["faults"]]
    crashed = [record for record in records if record["status"] == "crashed"]
    row: Row = {
        "planner": entrant.name,
        "package": entrant.package,
        "calls": list(entrant.calls),
        "problem": problem,
        "runs": len(free),
        "paths": len(paths),
        "invalid": len(invalid),
        "crashed": len(crashed),
        "why": next((str(r["why"]) for r in [*crashed, *invalid] if r.get("why")), None),
        **share("success", len(good), len(free)),
        "cold_s": _median(r["wall_s"] for r in records if r["budget"] == COLD and is_valid(r)),
        "first_path_s": _median(map(first_path_time, good)),
        "time_s": _median(record["wall_s"] for record in good),
        "cpu_s": _median(record["cpu_s"] for record in good),
        "ratio": ratios(good),
    }
    for key in ("nodes", "turning_rad", "printed_turning", "clearance_min_m", "clearance_mean_m"):
        row[key] = _median(record[key] for record in good)
    for deadline in deadlines:
        tried = [r for r in records if r["budget"] == (deadline if entrant.timed else FREE)]
        limit = deadline * (LATE_FACTOR if entrant.timed else 1.0)
        in_time = [record for record in tried if record["wall_s"] <= limit]
        done = [record for record in in_time if is_valid(record)]
        row |= share(f"success_{deadline_key(deadline)}", len(done), len(tried))
        row[f"ratio_{deadline_key(deadline)}"] = ratios(done)
        row[f"late_{deadline_key(deadline)}"] = len(tried) - len(in_time)
    return row


def summarise(
    entrants: Sequence[contest.Entrant],
    optima: Mapping[str, float | None],
    records: Sequence[Record],
    deadlines: Sequence[float],
) -> list[Row]:
    """A row for each entrant on each problem of `optima`, and on all."""
    rows = []
    for problem, entrant in product([ALL, *optima] if len(optima) > 1 else optima, entrants):
        of = [r for r in records if r["planner"] == entrant.name and problem in (ALL, r["problem"])]
        if any(record["budget"] == FREE for record in of):
            rows.append(summary_row(entrant, problem, of, optima, deadlines))
    return rows


def ranking(rows: Sequence[Row], deadline: float) -> list[Row]:
    """The planners at a deadline, ranked by problems solved, then by length.

    Hybrids, which call another planner, and planners with an invalid path are left out.
    """
    solved, ratio = (f"{name}_{deadline_key(deadline)}" for name in ("success", "ratio"))
    excluded = "calls", "invalid", "crashed"
    first = [row for row in rows if row["problem"] == rows[0]["problem"]]
    eligible = [r for r in first if r[ratio] is not None and not any(r[key] for key in excluded)]
    return sorted(eligible, key=lambda row: (-row[solved], row[ratio]))


def columns(deadlines: Sequence[float]) -> list[Column]:
    """The columns of the table, after the planner's."""
    every = [Column(**column) for column in read_data("planner_benchmark.yaml")["columns"]]
    first = next(k for k, column in enumerate(every) if "{deadline}" in column.key)
    timed = [
        column._replace(key=column.key.format(deadline=key), name=column.name.format(deadline=key))
        for key in map(deadline_key, deadlines)
        for column in every[first : first + 2]
    ]
    return [*every[:first], *timed, *every[first + 2 :]]


def entrant_title(row: Row) -> str:
    """An entrant's name with remarks."""
    marks = []
    if row["calls"]:
        marks.append("hybrid: calls " + ", ".join(row["calls"]))
    if row["invalid"]:
        marks.append(f"INVALID: {row['invalid']} of {row['paths']} paths")
    if row["crashed"]:
        marks.append(f"CRASHED: {row['crashed']}")
    return str(row["planner"]) + (f" ({'; '.join(marks)})" if marks else "")


def tables_text(rows: Sequence[Row], deadlines: Sequence[float], full: bool) -> str:
    """A table for each problem and the anytime ranking, for a terminal or in full as Markdown.

    That for a terminal has the main columns, with the last three deadlines.
    """
    text, heads, written = "", columns(deadlines), Table.markdown
    if not full:
        keys = list(read_data("planner_benchmark.yaml")["terminal"])
        keys += [f"ratio_{deadline_key(deadline)}" for deadline in deadlines[-3:]]
        heads, written = [column for column in heads if column.key in keys], Table.text
    for problem in dict.fromkeys(row["problem"] for row in rows):
        of = [row for row in rows if row["problem"] == problem]
        body = [[Cell(entrant_title(row)), *(column.cell(row) for column in heads)] for row in of]
        table = Table("", [Column("planner", "planner", None), *heads], [body])
        title = "all problems" if problem == ALL else problem
        text += f"## {title}\n\n{written(table).rstrip()}\n\n"
    for deadline in deadlines:
        ratio = f"ratio_{deadline_key(deadline)}"
        names = [f"{row['planner']} {row[ratio]:.4f}" for row in ranking(rows, deadline)]
        text += f"Anytime ranking at {deadline_key(deadline)}: {', '.join(names) or 'none'}\n"
    return text


FORMAT = "wheelchair bench planners 1"  # of a results file
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
TERMS = [
    term.format(UNLIMITED=contest.UNLIMITED, LATE_FACTOR=LATE_FACTOR)
    for term in read_data("planner_benchmark.yaml")["terms"]
]

Budget = str | float  # COLD, FREE, or a deadline [s]
Job = tuple[contest.Entrant, contest.Case, int, Budget]


@contextlib.contextmanager
def one_core() -> Iterator[int | None]:
    """Pin this process to one core; its number, None where the system cannot."""
    before = {name: os.environ.get(name) for name in THREADS}
    os.environ.update(dict.fromkeys(THREADS, "1"))
    cores = os.sched_getaffinity(0) if hasattr(os, "sched_getaffinity") else set()
    core = max(cores) if cores else None
    try:
        if core is not None:
            os.sched_setaffinity(0, {core})
        yield core
    finally:
        if core is not None:
            os.sched_setaffinity(0, cores)
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


def run_once(planner: Any, case: contest.Case, seed: int, budget: Budget) -> Record:
    """The record of one run of a planner that is prepared for the map, with the judge's faults."""
    problem = case.fresh_problem() if budget == COLD else case.problem
    deadline = None if isinstance(budget, str) else budget
    gc.disable()
    error = None
    begun, cpu = perf_counter(), process_time()
    try:
        plan = contest.make_plan(planner, problem, seed, deadline)
    except Exception as raised:  # an error of one planner does not end a benchmark of hours
        if is_interrupt(raised):
            raise
        error, plan = raised, None
    finally:
        spent, cpu = perf_counter() - begun, process_time() - cpu
        gc.enable()
    record: Record = {"seed": seed, "budget": budget, "wall_s": spent, "cpu_s": cpu}
    if plan is None:
        return record | {"status": "crashed", "why": f"{type(error).__name__}: {error}"[:200]}
    record |= {
        "status": str(plan.status),
        "first_path_s": plan.timings.get("first_path_s"),
        "nodes": plan.counters.get("nodes"),
        "iterations": plan.counters.get("iterations"),
    }
    if not len(plan.path):
        return record
    if budget == FREE and record["first_path_s"] is None:
        record |= _first_path_by_replay(planner, case, seed, plan)
    faults = plan_faults(plan, problem, getattr(planner, "footprint", None), case.judge)
    return record | path_figures(plan.path, problem) | {"faults": len(faults), "why": faults[:1]}


def _first_path_by_replay(planner: Any, case: contest.Case, seed: int, plan: Plan) -> Record:
    """Time of the first path, by a run that ends at its iteration, where that is reported."""
    first = plan.counters.get("first_path_iterations")
    if first is None or not dataclasses.is_dataclass(planner):
        return {}
    begun = perf_counter()
    earlier = contest.make_plan(contest.with_iterations(planner, max(1, first)), case.problem, seed)
    spent = perf_counter() - begun
    if not len(earlier.path):
        return {}
    return {"first_path_s": spent, "first_path_length_m": earlier.length}


def check_result(path: str | Path) -> None:
    """Refuse a file that is not a result of this benchmark.

    Raises:
        InputError: it cannot be read, or is something else.
    """
    content = read_json(path)
    if not isinstance(content, Mapping) or content.get("format") != FORMAT:
        raise InputError(f"{path}: not a result of 'wheelchair bench planners'")


class PlannerBenchmark:
    """A benchmark of planners: its entrants, problems, runs and results.

    Each run is stored in FILE.jsonl as it ends, and the results in FILE.json at the end. Seeds are
    the outer loop of a problem: a change of the machine's load then affects all planners alike, and
    a benchmark that is stopped early has as many runs of each.

    Args:
        ours: planners by name, or mappings with their settings.
        peers: names of peers, installed.
        problems: file of problems; None: problems made from scenes.
        only: names of problems; empty: all.
        seeds: of the runs.
        deadlines: seconds.
        file: the results; FILE.jsonl stands beside it.
        resume: make no stored run again; otherwise the stored runs are deleted.
        core: that all runs use.

    Raises:
        InputError: a name, a setting or a file is wrong.
    """

    def __init__(
        self, ours: Sequence[Any], peers: Sequence[str], problems: str | Path | None,
        only: Sequence[str], seeds: Sequence[int], deadlines: Sequence[float], file: str | Path,
        *, scenes: Sequence[Any] = (), resume: bool = False, core: int | None = None,
    ) -> None:  # fmt: skip
        self.file, self.store = Path(file), Path(file).with_suffix(".jsonl")
        if resume:
            check_result(file)
        self.deadlines = sorted(deadlines)
        if scenes:
            self.cases = [contest.scene_case(scene) for scene in scenes]
        else:
            self.cases = (
                contest.stored_cases(problems, only) if problems else contest.scene_cases(only)
            )
        self.entrants = contest.make_entrants(ours, peers)
        for what, all_of in (("planners", self.entrants), ("problems", self.cases)):
            names = [one.name for one in all_of]
            if len({*names}) < len(names):
                raise InputError(f"{max(names, key=names.count)!r}: several {what} have this name")
        drawn = f"scenes, seed {contest.SEED}, margin {contest.MARGIN} m"
        source, cpu = source_digest(), machine()["cpu"]
        self.jobs: dict[str, Job] = {}
        for case, seed, entrant in product(self.cases, seeds, self.entrants):
            of = entrant.name, entrant.package, contest.settings_dump(entrant.config)
            cold = [COLD] if seed == seeds[0] else []
            for budget in [*cold, FREE, *(self.deadlines if entrant.timed else ())]:
                key = run_key(source, cpu, *of, case.name, case.digest, seed, budget)
                self.jobs[key] = entrant, case, seed, budget
        self._settings = {
            "problems": "maps" if scenes else str(problems or drawn),
            "seeds": list(seeds),
            "deadlines_s": self.deadlines,
            "core": core,
            "terms": TERMS,
            "entrants": [entrant.description for entrant in self.entrants],
        }
        self._prepared: dict[tuple[str, str], Any] = {}
        if not resume:
            write_json(self.file, {})  # fails now where the file cannot be written
            self.store.unlink(missing_ok=True)
        write_json(self.file, self.result())

    def run(self, progress: bool = True) -> None:
        """Make the missing runs, and write the results.

        Raises:
            StoppedError: Ctrl-C; the results hold what was made.
        """
        try:
            compute(self.jobs, self._work, self.store, progress=progress)
        finally:
            write_json(self.file, self.result())

    def _work(self, job: Job) -> Record:
        entrant, case, seed, budget = job
        place = entrant.name, case.name
        if place not in self._prepared:
            kept = {key: value for key, value in self._prepared.items() if key[1] == case.name}
            self._prepared = {**kept, place: entrant.prepare(case)}
        planners = self._prepared[place]
        record: Record = {"planner": entrant.name, "problem": case.name}
        return record | run_once(planners[not isinstance(budget, str)], case, seed, budget)

    @property
    def records(self) -> dict[str, Record]:
        """The records so far by key, in the order of the benchmark."""
        stored = read_store(self.store)
        return {key: stored[key] for key in self.jobs if key in stored}

    @property
    def optima(self) -> dict[str, float | None]:
        """The length [m] of each problem's shortest path, where it is known."""
        return {case.name: case.optimum for case in self.cases}

    def rows(self) -> list[dict[str, Any]]:
        """The figures so far."""
        return summarise(self.entrants, self.optima, list(self.records.values()), self.deadlines)

    def result(self) -> dict[str, Any]:
        """The content of the results file."""
        rows = self.rows()
        load = os.getloadavg()[0]
        return {
            "format": FORMAT,
            "command": command_line(),
            "provenance": {"settings": self._settings, **provenance(load=load), "written": now()},
            "problems": [case.description for case in self.cases],
            "rows": rows,
            "anytime": {
                deadline_key(deadline): [row["planner"] for row in ranking(rows, deadline)]
                for deadline in self.deadlines
            },
            "records": [{"key": key, **record} for key, record in self.records.items()],
        }

    def text(self, full: bool = False) -> str:
        """The figures so far, see `tables_text`."""
        return tables_text(self.rows(), self.deadlines, full)


FLOOR = 1e-3  # % above the optimum: smaller values are drawn here
_PANEL = (4.6, 3.1)  # inches
_LEGEND = 0.19  # inches a line
_DPI = 130


def draw(benchmark: PlannerBenchmark, rows: Sequence[Row], path: str | Path) -> None:
    """Write a PNG with two panels a problem, of the runs of a benchmark and their summary.

    Raises:
        InputError: the file cannot be written.
    """
    records, optima = list(benchmark.records.values()), benchmark.optima
    names = list(dict.fromkeys(row["planner"] for row in rows))
    looks: dict[str, dict[str, Any]] = {
        name: {
            "color": COLOURS[i % len(COLOURS)],
            "linestyle": DASHES[(i // len(COLOURS)) % len(DASHES)],
            "marker": MARKS[(i + i // len(COLOURS)) % len(MARKS)],
        }
        for i, name in enumerate(names)
    }
    problems = [name for name in optima if any(row["problem"] == name for row in rows)]
    width, height = 2 * _PANEL[0] + 3.4, max(_PANEL[1] * len(problems), _LEGEND * len(names) + 0.5)
    with mpl.rc_context(LOOK):
        figure = Figure(figsize=(width, height), layout="constrained")
        grid = figure.subplots(len(problems), 2, squeeze=False)
        for (left, right), problem in zip(grid, problems, strict=True):
            of = [record for record in records if record["problem"] == problem]
            here = [row for row in rows if row["problem"] == problem]
            for row in here:
                its = [record for record in of if record["planner"] == row["planner"]]
                _success(left, its, looks[row["planner"]])
                _lengths(right, its, optima[problem], benchmark.deadlines, looks[row["planner"]])
            _dress(left, right, problem, here)
        titles = {row["planner"]: entrant_title(row) for row in reversed(rows)}
        lines = [
            mpl.lines.Line2D([], [], **looks[name], markersize=4, label=shorten(titles[name], 60))
            for name in names
        ]
        figure.legend(handles=lines, loc="outside right upper", fontsize=7.5)
        with atomic_write(path) as part:
            figure.savefig(part, dpi=_DPI)


def _success(axes: Axes, records: Sequence[Record], look: Mapping[str, Any]) -> None:
    """Share of runs that had a valid first path by a time."""
    free = [record for record in records if record["budget"] == FREE]
    times = np.sort([1e3 * first_path_time(record) for record in free if is_valid(record)])
    if not len(times):
        return
    share = 100.0 * np.arange(1, len(times) + 1) / len(free)
    axes.step(
        np.append(times[0], times), np.append(0.0, share), where="post", linewidth=1.3,
        color=look["color"], linestyle=look["linestyle"],
    )  # fmt: skip
    axes.plot(times[-1], share[-1], marker=look["marker"], color=look["color"], markersize=4)


def _lengths(
    axes: Axes,
    records: Sequence[Record],
    optimum: float | None,
    deadlines: Sequence[float],
    look: Mapping[str, Any],
) -> None:
    """Median length above the optimum, at deadlines, or when a planner without them ended."""
    if not optimum:
        return
    valid = [record for record in records if is_valid(record)]
    if any(record["budget"] in deadlines for record in records):
        in_time = [
            (deadline, [r for r in valid if r["budget"] == deadline and r["wall_s"] <= limit])
            for deadline, limit in ((deadline, LATE_FACTOR * deadline) for deadline in deadlines)
        ]
    else:
        free = [record for record in valid if record["budget"] == FREE]
        in_time = [(float(np.median([r["wall_s"] for r in free])), free)] if free else []
    points = [(when, [record["length_m"] for record in of]) for when, of in in_time if of]
    if not points:
        return
    over = [100.0 * (np.percentile(lengths, [25, 50, 75]) / optimum - 1.0) for _, lengths in points]
    low, middle_, high = np.maximum(np.array(over), FLOOR).T
    axes.errorbar(
        [1e3 * when for when, _ in points], middle_, yerr=[middle_ - low, high - middle_],
        linewidth=1.3, markersize=4, elinewidth=0.7, capsize=2, **look,
    )  # fmt: skip


def _dress(left: Axes, right: Axes, problem: str, rows: Sequence[Row]) -> None:
    runs = max((row["runs"] for row in rows), default=0)
    left.set_title(f"{problem}: valid first path ({runs} runs)", fontsize=9, loc="left")
    left.set(xscale="log", ylim=(-2, 103), xlabel="time [ms]", ylabel="runs [%]")
    right.set_title(f"{problem}: median, quartiles", fontsize=9, loc="left")
    right.set(xscale="log", yscale="log", xlabel="time [ms]", ylabel="longer than the optimum [%]")
    if right.has_data():
        right.axhline(FLOOR, color=LOOK["grid.color"], linewidth=0.8)
        right.text(
            0.99, FLOOR * 1.15, f"at most {FLOOR:g} %", fontsize=7, ha="right",
            transform=right.get_yaxis_transform(),
        )  # fmt: skip
        right.set_ylim(bottom=0.6 * FLOOR)
    for axis in (left.xaxis, right.xaxis, right.yaxis):
        axis.set_major_formatter(lambda value, _: f"{value:g}")
