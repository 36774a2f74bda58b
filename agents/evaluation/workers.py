"""Jobs in worker processes of this machine."""

from __future__ import annotations

import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Generator, Sequence
from typing import Any

Job = Any
Results = Generator[tuple[int, Any]]
IDLE_TIME = 300  # s that idle workers wait for the next runs: loading all kernels takes seconds


class LostError(Exception):
    """A worker ended before its job did."""


def _start_worker() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent decides when to stop
    threading.Thread(target=_end_with, args=(os.getppid(),), daemon=True).start()


def _end_with(parent: int) -> None:
    """End this worker with its parent, which cannot end it when it is killed."""
    while os.getppid() == parent:
        time.sleep(1.0)
    os._exit(1)


def _numbered(
    work: Callable[[Job], Any], number: int, job: Job, places: Sequence[str]
) -> tuple[int, Any]:
    """The number and the result of a job, with modules looked for in these folders, too."""
    sys.path += [place for place in places if place not in sys.path]
    return number, work(job)


def in_workers(
    work: Callable[[Job], Any], jobs: Sequence[Job], workers: int, alone: bool
) -> Results:
    """The number and the result of each job as it ends.

    Args:
        work: importable by workers, as its job.
        jobs: of the work.
        workers: processes.
        alone: hand out each job by itself; otherwise short jobs are handed out in batches.

    Raises:
        LostError: a worker was lost; the jobs that have not ended are not run.
    """
    from concurrent.futures import BrokenExecutor

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
        yield from made
    except BrokenExecutor as error:
        raise LostError(type(error).__name__) from None
    finally:
        made.close()
