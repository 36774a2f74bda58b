"""Planners on problems, run by run on one core: records that can be kept and continued."""

from __future__ import annotations

import contextlib
import dataclasses
import gc
import hashlib
import json
import os
from collections.abc import Iterator, Mapping, Sequence
from time import perf_counter, process_time
from typing import Any

from agents.benchmarks.cases import Case
from agents.benchmarks.entrants import Entrant, make_plan, with_iterations
from agents.evaluation.path_metrics import path_figures
from agents.evaluation.provenance import machine
from agents.evaluation.runs import source_digest
from agents.interrupt import by_hand
from planners import Plan
from wheelchair_gym.config import InputError, dump, read_json

COLD, FREE = "cold", "free"  # runs without a deadline: the first on a map, and the others
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")  # of what is yet to load
FORMAT = "wheelchair bench planners 1"  # what a results file says it is

Record = dict[str, Any]
Budget = str | float  # COLD, FREE, or a deadline [s]


@contextlib.contextmanager
def one_core() -> Iterator[int | None]:
    """Let this process and its threads use one core; its number, None where systems refuse."""
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


def key_of(entrant: Entrant, case: Case, seed: int, budget: Budget) -> str:
    """What makes two runs the same: code, machine, settings, problem, seed and time allowed."""
    parts = [
        source_digest(), machine()["cpu"], entrant.name, entrant.package, dump(entrant.config),
        case.digest, seed, budget,
    ]  # fmt: skip
    return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()[:16]


def run_once(planner: Any, case: Case, seed: int, budget: Budget) -> Record:
    """One run: what came of it, when, and what the judge says.

    Args:
        planner: of this map.
        case: the problem.
        seed: of the random numbers.
        budget: COLD: on a map that it has never seen; FREE: without a deadline; else seconds.
    """
    problem = case.fresh_problem() if budget == COLD else case.problem
    deadline = None if isinstance(budget, str) else budget
    gc.disable()
    error = None
    begun, cpu = perf_counter(), process_time()
    try:
        plan = make_plan(planner, problem, seed, deadline)
    except Exception as raised:  # a benchmark of hours does not end with one planner's mistake
        if by_hand(raised):
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
    faults = case.judge.faults(plan.path, problem.start, problem.goal)
    return record | path_figures(plan.path, problem) | {"faults": len(faults), "why": faults[:1]}


def _first_path_by_replay(planner: Any, case: Case, seed: int, plan: Plan) -> Record:
    """When the first path was there, from a run cut off with it, where its iteration is told."""
    first = plan.counters.get("first_path_iterations")
    if first is None or not dataclasses.is_dataclass(planner):
        return {}
    cut = with_iterations(planner, max(1, first))
    begun = perf_counter()
    earlier = make_plan(cut, case.problem, seed)
    spent = perf_counter() - begun
    if not len(earlier.path):
        return {}
    return {"first_path_s": spent, "first_path_length_m": earlier.length}


class BenchmarkRuns:
    """All the runs of a benchmark: those known, and those still to be made.

    Seeds are the outermost loop of a problem, so that what else happens on the machine falls on
    all alike, and so that a benchmark that is stopped early has judged all alike.

    Args:
        runners: who takes part.
        cases: the problems.
        seeds: of the runs.
        deadlines: seconds.
        known: records of an earlier benchmark, by key.
    """

    def __init__(
        self,
        entrants: Sequence[Entrant],
        cases: Sequence[Case],
        seeds: Sequence[int],
        deadlines: Sequence[float],
        known: Mapping[str, Record] | None = None,
    ) -> None:
        self.runners, self.cases, self.seeds = entrants, cases, seeds
        self.deadlines = sorted(deadlines)
        self.wanted = {
            key_of(runner, case, seed, budget): (runner, case, seed, budget)
            for case in cases
            for seed in seeds
            for runner in entrants
            for budget in self.budgets(runner, seed)
        }
        known = known or {}
        self.records = {key: value for key, value in known.items() if key in self.wanted}
        self._others = {key: value for key, value in known.items() if key not in self.wanted}

    def budgets(self, runner: Entrant, seed: int) -> list[Budget]:
        """The runs of one entrant for one seed."""
        cold: list[Budget] = [COLD] if seed == self.seeds[0] else []
        return [*cold, FREE, *(self.deadlines if runner.timed else ())]

    def run_missing(self) -> Iterator[Record]:
        """Make the runs that are missing; each is kept before it is given."""
        ready: dict[tuple[str, str], Any] = {}
        for key, (runner, case, seed, budget) in self.wanted.items():
            if key in self.records:
                continue
            place = runner.name, case.name
            if place not in ready:
                ready = {k: v for k, v in ready.items() if k[1] == case.name}
                ready[place] = runner.prepare(case)
            planners = ready[place]
            record: Record = {"planner": runner.name, "problem": case.name}
            if planners is None:
                record |= {"seed": seed, "budget": budget, "status": "not_for_this_map"}
            else:
                record |= run_once(planners[not isinstance(budget, str)], case, seed, budget)
            self.records[key] = record
            yield record

    @property
    def stored_records(self) -> list[Record]:
        """The records so far, each with its key, in the order of the benchmark."""
        return [{"key": key, **self.records[key]} for key in self.wanted if key in self.records]

    @property
    def others(self) -> list[Record]:
        """Records known from before that this benchmark does not ask for; they are not lost."""
        return [{"key": key, **record} for key, record in self._others.items()]


def read_records(path: Any) -> dict[str, Record]:
    """Records by key of an earlier results file.

    Raises:
        InputError: it cannot be read, or is something else.
    """
    content = read_json(path)
    if not isinstance(content, Mapping) or content.get("format") != FORMAT:
        raise InputError(f"{path}: not a result of 'wheelchair bench planners'")
    parts = [content.get("records"), content.get("others")]
    records = [record for part in parts if isinstance(part, list) for record in part]
    if not all(isinstance(part, list) for part in parts) or not all(
        isinstance(record, Mapping) and isinstance(record.get("key"), str) for record in records
    ):
        raise InputError(f"{path}: expected lists of records with keys, 'records' and 'others'")
    return {record["key"]: {k: v for k, v in record.items() if k != "key"} for record in records}
