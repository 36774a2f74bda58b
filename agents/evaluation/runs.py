"""Many runs by key, in parallel and resumable: what is stored once is never computed twice.

A run is a job that a function turns into a record. What a record says depends on its job alone, so
that neither the number of workers nor the engine changes it. A store is a file of one line of JSON
a run, written as they come.
"""

from __future__ import annotations

import hashlib
import json
import os
import sys
import time
import zlib
from collections import deque
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

from agents.evaluation.engines import ENGINES, LostError, Pool
from agents.interrupt import by_hand
from wheelchair_gym.config import InputError, dump
from wheelchair_gym.files import LIMITS, opened, parse_json, write_error

Record = dict[str, Any]
Job = TypeVar("Job")

LOG_PAUSE = 10.0  # s between two lines of progress where they are kept, as in a log
AHEAD = 2  # batches in hand for each worker, so that none waits for the next
SPAN = 0.25  # s of work in a batch
LOSSES = 3  # times in a row that workers may be lost before a single run has ended


class StoppedError(Exception):
    """A person stopped the runs; what was finished is in the store."""


@cache
def source_digest(*packages: str) -> str:
    """Digest of the code of packages or files, of all the project's without any name.

    Records of other code are not reused.
    """
    root = Path(__file__).resolve().parents[2]
    digest = hashlib.sha256()
    for package in packages or ("wheelchair_gym", "planners", "agents"):
        place = root / package
        for path in sorted(place.rglob("*.py")) if place.is_dir() else [place]:
            digest.update(path.read_bytes())
    return digest.hexdigest()


def run_key(*parts: Any) -> str:
    """What makes two runs the same, as one word."""
    plain = json.dumps([dump(part) for part in parts], sort_keys=True)
    return hashlib.sha256(plain.encode()).hexdigest()[:16]


def read_store(path: Path) -> dict[str, Record]:
    """Records by key; damaged lines, as after a crash, are left out and counted on standard error.

    Raises:
        InputError: the store cannot be read.
    """
    records: dict[str, Record] = {}
    if not path.exists():
        return records
    damaged, summed, most = 0, False, LIMITS["line"].most
    with opened(path) as lines:
        while line := lines.readline(most):
            if not line.strip():
                continue
            try:
                stored = parse_json(line, path)
                record = stored["record"]
                if not isinstance(stored["key"], str) or not isinstance(record, dict):
                    raise TypeError
                summed = summed or "crc" in stored  # only stores of 0.1 begin without
                if summed and stored["crc"] != _checksum(stored["key"], record):
                    raise ValueError
            except (InputError, KeyError, TypeError, ValueError):
                damaged += 1
                continue
            records[stored["key"]] = record
    if damaged:
        count = "1 damaged line" if damaged == 1 else f"{damaged} damaged lines"
        print(f"wheelchair: {path}: skipped {count}; what is lost is made anew", file=sys.stderr)
    return records


def _checksum(key: str, record: Record) -> int:
    return zlib.crc32(json.dumps([key, record], sort_keys=True).encode())


def stored_line(key: str, record: Record) -> str:
    """A record as a line of a store."""
    content = {"key": key, "record": record, "crc": _checksum(key, record)}
    return json.dumps(content, allow_nan=False) + "\n"


def open_store(path: Path) -> Any:
    """A store to append whole lines to.

    Raises:
        InputError: it cannot be written.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        if path.exists() and not path.is_file():
            raise InputError(f"{path}: cannot be written (not a regular file)")
        store = path.open("a+b", buffering=0)
    except OSError as error:
        raise write_error(path, error) from None
    if store.tell():
        store.seek(-1, os.SEEK_END)
        if store.read(1) != b"\n":  # a line cut short: what follows begins a new one
            store.write(b"\n")
    return store


def check(workers: int, engine: str) -> None:
    """Refuse workers and engines that do not exist.

    Raises:
        InputError: there are none such, or the engine is not installed.
    """
    if workers < 1:
        raise InputError(f"jobs is {workers}; it must be at least 1")
    if engine not in ENGINES:
        raise InputError(f"engine {engine!r} is unknown; known: {', '.join(ENGINES)}")
    ENGINES[engine].check()


def compute(
    jobs: Mapping[str, Job],
    work: Callable[[Job], Record],
    store: Path,
    *,
    workers: int = 1,
    engine: str = "loky",
    unit: str = "run",
    progress: bool = True,
    again: Callable[[Job], bool] | None = None,
    before: Callable[[Sequence[Job]], object] | None = None,
) -> dict[str, Record]:
    """Records of all jobs, in their order, by key; those of the store are not made again.

    Args:
        jobs: by key; equal keys are equal runs.
        work: makes a record, a JSON object; importable by workers, as its job.
        store: file of the records.
        workers: processes; with one, `loky` stays in this one.
        engine: one of `ENGINES`.
        unit: what a run is called in the progress bar.
        progress: show a bar on standard error.
        again: whether a job is made although it is stored.
        before: called once with the jobs to be made before workers are; compiles what they need.

    Raises:
        InputError: the store cannot be written, or there is no such engine.
        StoppedError: Ctrl-C; the same call computes only what is missing.
        ConnectionError: workers were lost over and over.
    """
    check(workers, engine)
    with open_store(store) as lines:
        stored = read_store(store)
        known = {
            k: stored[k] for k, job in jobs.items() if k in stored and not (again and again(job))
        }
        missing = [(key, job) for key, job in jobs.items() if key not in known]
        del stored
        here = engine == "loky" and (workers == 1 or len(missing) < 2)
        made = _here(missing, work) if here else _apart(missing, work, workers, engine)
        try:
            if missing and before is not None:
                before([job for _, job in missing])
            for found in _bar(made, len(jobs), len(known), unit, progress):
                known |= found
                lines.write("".join(stored_line(*each) for each in found).encode())
        except (KeyboardInterrupt, SystemError) as error:
            if not by_hand(error):
                raise
            raise StoppedError(f"{len(known)} of {len(jobs)} {unit}s are stored") from None
        except LostError as error:
            raise ConnectionError(
                f"workers were lost {LOSSES} times in a row ({error}); "
                f"{len(known)} of {len(jobs)} {unit}s are stored"
            ) from None
        finally:
            made.close()
    return {key: known[key] for key in jobs}


Found = list[tuple[str, Record]]


def _bar(made: Iterator[Found], total: int, done: int, unit: str, shown: bool) -> Iterator[Found]:
    from tqdm import tqdm

    pause = 0.1 if sys.stderr.isatty() else LOG_PAUSE
    with tqdm(
        total=total, initial=done, unit=unit, mininterval=pause, maxinterval=pause,
        disable=not shown,
    ) as bar:  # fmt: skip
        for found in made:
            yield found
            bar.update(len(found))


def _here(missing: Sequence[tuple[str, Job]], work: Callable[[Job], Record]) -> Generator[Found]:
    for key, job in missing:
        yield [(key, work(job))]


def _batch(work: Callable[[Job], Record], jobs: Sequence[tuple[str, Job]]) -> tuple[Found, float]:
    """Records, and the seconds that they took."""
    begun = time.perf_counter()
    return [(key, work(job)) for key, job in jobs], time.perf_counter() - begun


def _apart(
    missing: Sequence[tuple[str, Job]],
    work: Callable[[Job], Record],
    workers: int,
    engine: str,
) -> Generator[Found]:
    """Records in the order in which workers end them; what a lost worker held is handed out again.

    Short jobs are handed out together, for a time at which handing out costs little. Every batch
    that ended before a loss counts.
    """
    waiting = deque(missing)
    running: dict[Any, Sequence[tuple[str, Job]]] = {}
    size, losses, done = 1, 0, False
    pool: Pool = ENGINES[engine](workers)
    try:
        while waiting or running:
            lost = None
            try:
                while waiting and len(running) < AHEAD * pool.workers:
                    # Whatever remains is shared by all: the last batches end at about one time.
                    share = max(1, min(size, len(waiting) // (2 * AHEAD * pool.workers)))
                    jobs = [waiting[k] for k in range(share)]
                    running[pool.submit(_batch, work, jobs)] = jobs
                    for _ in jobs:
                        waiting.popleft()
            except LostError as error:
                lost = error
            for ticket in pool.ended(list(running)):
                held = running.pop(ticket)
                try:
                    found, seconds = pool.result(ticket)
                except LostError as error:
                    lost = error
                    waiting.extendleft(reversed(held))
                    continue
                losses = 0
                size = max(1, min(2 * len(held), int(SPAN * len(held) / max(seconds, 1e-9))))
                yield found
            if lost is not None:
                losses += 1
                size = 1  # a job that kills its worker shall take no other along
                if losses >= LOSSES:
                    raise lost
        done = True
    finally:
        pool.close(done)
