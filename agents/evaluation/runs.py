"""Many runs by key, in parallel and resumable: what is stored is not computed again.

A run is a job that a function turns into a record. A record depends on its job alone, not on the
number of workers. A store is a file with one line of JSON for each run, written as
the runs end.
"""

import errno
import hashlib
import json
import os
import signal
import sys
import threading
import time
import warnings
import zlib
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from concurrent.futures import BrokenExecutor
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

from tqdm import tqdm

from agents import StoppedError, is_interrupt
from wheelchair_gym.base.files import LIMITS, file_digest, opened, parse_json, sources, write_error
from wheelchair_gym.base.registry import places_in, source_of
from wheelchair_gym.base.settings import InputError, dump
from wheelchair_gym.maps import map_files

Record = dict[str, Any]
Job = TypeVar("Job")
Made = tuple[str, Record]

LOG_PAUSE = 10.0  # s between two lines of progress in a log
LOSSES = 3  # in a row: workers that are lost without the end of a run between
IDLE_TIME = 300  # s that idle workers wait for the next runs: loading all kernels takes seconds


@contextmanager
def stopped_by_ctrl_c(text: Callable[[], str]) -> Iterator[None]:
    """Raise Ctrl-C in the block, also from compiled code, as a StoppedError with this text."""
    try:
        yield
    except (KeyboardInterrupt, SystemError, StoppedError) as error:
        if not (isinstance(error, StoppedError) or is_interrupt(error)):
            raise
        raise StoppedError(text()) from None


@cache
def source_digest(*packages: str) -> str:
    """Digest of the code and data of packages or files, of all the project's without any name.

    Records of other code, or of other data beside it, are not reused.
    """
    root = Path(__file__).resolve().parents[2]
    digest = hashlib.sha256()
    every = ["wheelchair_gym", "planners", "agents"]
    if (root / "configs").is_dir():  # a wheel holds it in wheelchair_gym
        every.append("configs/chairs")
    for package in packages or every:
        place = root / package
        for path in sources(place) if place.is_dir() else [place]:
            digest.update(path.read_bytes())
    return digest.hexdigest()


def run_key(*parts: Any) -> str:
    """A key that is equal for runs of equal parts, with the code and the maps that they name."""
    # A label such as planners.json:NAME looks like a place, and is none.
    files = {source_of(place) for place in places_in(parts)} - {None}
    code = [source_digest(file) for file in sorted(map(str, files))]
    plain = [dump(part) for part in parts]
    worlds = [file_digest(file, "image") for file in map_files(plain) if file.is_file()]
    text = json.dumps(plain + code + worlds, sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def read_store(path: Path) -> dict[str, Record]:
    """Records by key; damaged lines, as after a crash, are skipped and counted on standard error.

    Raises:
        InputError: the store cannot be read.
    """
    records: dict[str, Record] = {}
    if not path.exists():
        return records
    damaged, summed, maximum = 0, False, LIMITS["line"].maximum
    with opened(path) as lines:
        while line := lines.readline(maximum):
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
        print(f"wheelchair: {path}: skipped {count}; the runs are made again", file=sys.stderr)
    return records


def _checksum(key: str, record: Record) -> int:
    return zlib.crc32(json.dumps([key, record], sort_keys=True).encode())


def stored_line(key: str, record: Record) -> str:
    """A record as a line of a store."""
    content = {"key": key, "record": record, "crc": _checksum(key, record)}
    return json.dumps(content, allow_nan=False) + "\n"


def open_store(path: Path) -> Any:
    """A store, opened to append lines.

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
            _append(store, b"\n")
    return store


def _append(store: Any, line: bytes) -> None:
    try:
        if store.write(line) < len(line):  # the disk has become full
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
    except OSError as error:
        store.close()
        raise write_error(Path(store.name), error) from None


def compute(
    jobs: Mapping[str, Job],
    work: Callable[[Job], Record],
    store: Path,
    *,
    workers: int = 1,
    unit: str = "run",
    progress: bool = True,
    again: Callable[[Job], bool] | None = None,
    before: Callable[[Sequence[Job]], object] | None = None,
) -> dict[str, Record]:
    """Records of all jobs by key, in their order; those that are stored are not made again.

    Args:
        jobs: by key; equal keys are equal runs.
        work: makes a record, a JSON object; importable by workers, as its job.
        store: file of the records.
        workers: processes; one is this one.
        unit: what a run is called in the progress bar.
        progress: show a bar on standard error.
        again: whether a job is run again although it is stored.
        before: called once with the missing jobs, before workers start; compiles what they need.

    Raises:
        InputError: the store cannot be written, or there is no worker.
        StoppedError: Ctrl-C; the same call computes only what is missing.
        ConnectionError: workers were lost over and over.
    """
    if workers < 1:
        raise InputError(f"jobs is {workers}; it must be at least 1")
    with open_store(store) as lines:
        stored = read_store(store)
        done = {
            k: stored[k] for k, job in jobs.items() if k in stored and not (again and again(job))
        }
        missing = {key: job for key, job in jobs.items() if key not in done}
        del stored
        made: Generator[Made] = (
            ((key, work(job)) for key, job in missing.items())
            if workers == 1 or len(missing) < 2
            else _by_workers(missing, work, workers)
        )
        try:
            with stopped_by_ctrl_c(lambda: f"{len(done)} of {len(jobs)} {unit}s are stored"):
                if missing and before is not None:
                    before(list(missing.values()))
                pause = 0.1 if sys.stderr.isatty() else LOG_PAUSE
                for key, record in tqdm(
                    made, total=len(jobs), initial=len(done), unit=unit, mininterval=pause,
                    maxinterval=pause, disable=not progress,
                ):  # fmt: skip
                    done[key] = record
                    _append(lines, stored_line(key, record).encode())
        except LostError as error:
            raise ConnectionError(
                f"workers were lost {LOSSES} times in a row ({error}); "
                f"{len(done)} of {len(jobs)} {unit}s are stored"
            ) from None
        finally:
            made.close()
    return {key: done[key] for key in jobs}


def _by_workers(
    missing: Mapping[str, Job], work: Callable[[Job], Record], workers: int
) -> Generator[Made]:
    """Records in the order in which workers finish them; jobs of a lost worker are repeated."""
    left, losses, alone = dict(missing), 0, False
    while left:
        keys = list(left)
        made = in_workers(work, list(left.values()), workers, alone)
        try:
            for number, record in made:
                losses = 0
                del left[keys[number]]
                yield keys[number], record
        except LostError:
            losses, alone = losses + 1, True  # a job that kills its worker takes no other along
            if losses == LOSSES:
                raise
        finally:
            made.close()


class LostError(Exception):
    """A worker ended before its job did."""


def _start_worker() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent decides when to stop
    threading.Thread(target=end_with, args=(os.getppid(),), daemon=True).start()


def end_with(parent: int) -> None:
    """End this process with its parent, which cannot end it when it is killed."""
    while os.getppid() == parent:
        time.sleep(1.0)
    os._exit(1)


def _numbered(
    work: Callable[[Any], Any], number: int, job: Any, places: Sequence[str]
) -> tuple[int, Any]:
    """The number and the result of a job, with modules looked for in these folders, too."""
    sys.path += [place for place in places if place not in sys.path]
    return number, work(job)


def in_workers(
    work: Callable[[Any], Any], jobs: Sequence[Any], workers: int, alone: bool
) -> Generator[tuple[int, Any]]:
    """The number and the result of each job as it ends.

    Args:
        work: importable by workers, as its job.
        jobs: of the work.
        workers: processes.
        alone: hand out each job by itself; otherwise short jobs are handed out in batches.

    Raises:
        LostError: a worker was lost; the jobs that have not ended are not run.
    """
    from joblib import Parallel, delayed

    pool = Parallel(
        workers, "loky", return_as="generator_unordered", batch_size=1 if alone else "auto",
        max_nbytes=None, initializer=_start_worker, inner_max_num_threads=1,
        idle_worker_timeout=IDLE_TIME,
    )  # fmt: skip
    # Workers may be those of an earlier call from another folder.
    places = [os.getcwd(), *filter(None, sys.path)]
    made = pool(delayed(_numbered)(work, number, job, places) for number, job in enumerate(jobs))
    try:
        for ended in made:  # noqa: UP028 it is closed below, quietly
            yield ended
    except BrokenExecutor as error:
        raise LostError(type(error).__name__) from None
    finally:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # of results that nobody asked for
            made.close()
