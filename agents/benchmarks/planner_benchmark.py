"""A planner benchmark: every entrant on every problem, on one core, stored and resumable."""

from __future__ import annotations

import contextlib
import dataclasses
import gc
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from time import perf_counter, process_time
from typing import Any

from agents import is_interrupt, read_data
from agents.benchmarks.cases import (
    MARGIN,
    SEED,
    Case,
    description,
    scene_case,
    scene_cases,
    stored_cases,
)
from agents.benchmarks.entrants import (
    UNLIMITED,
    Entrant,
    make_entrants,
    make_plan,
    settings_dump,
    with_iterations,
)
from agents.benchmarks.environments import provenance
from agents.benchmarks.summary import (
    COLD,
    FREE,
    LATE_FACTOR,
    Record,
    deadline_key,
    ranking,
    summarise,
    terminal,
)
from agents.evaluation.metrics import path_figures
from agents.evaluation.provenance import command_line, machine, now, write_json
from agents.evaluation.runs import (
    compute,
    read_store,
    run_key,
    source_digest,
    stopped_by_ctrl_c,
)
from planners import Plan
from planners.judge import plan_faults
from wheelchair_gym.config import InputError, read_json

FORMAT = "wheelchair bench planners 1"  # of a results file
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
TERMS = [
    term.format(UNLIMITED=UNLIMITED, LATE_FACTOR=LATE_FACTOR)
    for term in read_data("planner_benchmark.yaml")["terms"]
]

Budget = str | float  # COLD, FREE, or a deadline [s]
Job = tuple[Entrant, Case, int, Budget]


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


def run_once(planner: Any, case: Case, seed: int, budget: Budget) -> Record:
    """The record of one run of a planner that is prepared for the map, with the judge's faults."""
    problem = case.fresh_problem() if budget == COLD else case.problem
    deadline = None if isinstance(budget, str) else budget
    gc.disable()
    error = None
    begun, cpu = perf_counter(), process_time()
    try:
        plan = make_plan(planner, problem, seed, deadline)
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


def _first_path_by_replay(planner: Any, case: Case, seed: int, plan: Plan) -> Record:
    """Time of the first path, by a run that ends at its iteration, where that is reported."""
    first = plan.counters.get("first_path_iterations")
    if first is None or not dataclasses.is_dataclass(planner):
        return {}
    begun = perf_counter()
    earlier = make_plan(with_iterations(planner, max(1, first)), case.problem, seed)
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
            self.cases = [scene_case(scene) for scene in scenes]
        else:
            self.cases = stored_cases(problems, only) if problems else scene_cases(only)
        self.entrants = make_entrants(ours, peers)
        source, cpu = source_digest(), machine()["cpu"]
        self.jobs: dict[str, Job] = {}
        for case in self.cases:
            for seed in seeds:
                for entrant in self.entrants:
                    parts = (
                        source,
                        cpu,
                        entrant.name,
                        entrant.package,
                        settings_dump(entrant.config),
                    )
                    cold = [COLD] if seed == seeds[0] else []
                    for budget in [*cold, FREE, *(self.deadlines if entrant.timed else ())]:
                        key = run_key(*parts, case.digest, seed, budget)
                        self.jobs[key] = entrant, case, seed, budget
        self._settings = {
            "problems": str(problems) if problems else f"scenes, seed {SEED}, margin {MARGIN} m",
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
            with stopped_by_ctrl_c(
                lambda: f"{len(self.records)} of {len(self.jobs)} runs are kept"
            ):
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
        return {
            "format": FORMAT,
            "command": command_line(),
            "provenance": {**provenance(**self._settings), "written": now()},
            "problems": [description(case) for case in self.cases],
            "rows": rows,
            "anytime": {
                deadline_key(deadline): [row["planner"] for row in ranking(rows, deadline)]
                for deadline in self.deadlines
            },
            "records": [{"key": key, **record} for key, record in self.records.items()],
        }

    def text(self, of: Callable[..., str] = terminal) -> str:
        """The figures for a terminal, or as `markdown` writes them."""
        return of(self.rows(), self.deadlines)
