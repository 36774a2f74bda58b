"""The runs of a planner benchmark on one core: records that can be stored and continued."""

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

# Budgets without a deadline: the first call on a map, and the others.
COLD, FREE = "cold", "free"
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
FORMAT = "wheelchair bench planners 1"  # of a results file

Record = dict[str, Any]
Budget = str | float  # COLD, FREE, or a deadline [s]


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


def key_of(entrant: Entrant, case: Case, seed: int, budget: Budget) -> str:
    """The key of a run: code, machine, settings, problem, seed and budget."""
    parts = [
        source_digest(), machine()["cpu"], entrant.name, entrant.package, dump(entrant.config),
        case.digest, seed, budget,
    ]  # fmt: skip
    return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()[:16]


def run_once(planner: Any, case: Case, seed: int, budget: Budget) -> Record:
    """The record of one run, with the faults that the judge finds.

    Args:
        planner: prepared for the map.
        case: the problem.
        seed: of the random numbers.
        budget: COLD for a map that it has not seen, FREE for no deadline, or a deadline [s].
    """
    problem = case.fresh_problem() if budget == COLD else case.problem
    deadline = None if isinstance(budget, str) else budget
    gc.disable()
    error = None
    begun, cpu = perf_counter(), process_time()
    try:
        plan = make_plan(planner, problem, seed, deadline)
    except Exception as raised:  # an error of one planner does not end a benchmark of hours
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
    """Time of the first path, by a run that ends at its iteration, where that is reported."""
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
    """All runs of a benchmark, finished and missing.

    Seeds are the outer loop of a problem: other load on the machine then affects all planners
    alike, and a benchmark that is stopped early has as many runs of each.

    Args:
        entrants: the planners that take part.
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
        self.entrants, self.cases, self.seeds = entrants, cases, seeds
        self.deadlines = sorted(deadlines)
        self.wanted = {
            key_of(entrant, case, seed, budget): (entrant, case, seed, budget)
            for case in cases
            for seed in seeds
            for entrant in entrants
            for budget in self.budgets(entrant, seed)
        }
        known = known or {}
        self.records = {key: value for key, value in known.items() if key in self.wanted}
        self._others = {key: value for key, value in known.items() if key not in self.wanted}

    def budgets(self, entrant: Entrant, seed: int) -> list[Budget]:
        """The budgets of one entrant for one seed."""
        cold: list[Budget] = [COLD] if seed == self.seeds[0] else []
        return [*cold, FREE, *(self.deadlines if entrant.timed else ())]

    def run_missing(self) -> Iterator[Record]:
        """Make the missing runs; each is stored before it is yielded."""
        ready: dict[tuple[str, str], Any] = {}
        for key, (entrant, case, seed, budget) in self.wanted.items():
            if key in self.records:
                continue
            place = entrant.name, case.name
            if place not in ready:
                ready = {k: v for k, v in ready.items() if k[1] == case.name}
                ready[place] = entrant.prepare(case)
            planners = ready[place]
            record: Record = {"planner": entrant.name, "problem": case.name}
            if planners is None:
                record |= {"seed": seed, "budget": budget, "status": "not_for_this_map"}
            else:
                record |= run_once(planners[not isinstance(budget, str)], case, seed, budget)
            self.records[key] = record
            yield record

    @property
    def stored_records(self) -> list[Record]:
        """The records so far with their keys, in the order of the benchmark."""
        return [{"key": key, **self.records[key]} for key in self.wanted if key in self.records]

    @property
    def others(self) -> list[Record]:
        """Earlier records that are not part of this benchmark, which are kept in the file."""
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
