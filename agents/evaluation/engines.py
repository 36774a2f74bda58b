"""Engines run jobs in other processes: joblib's loky on this machine, Ray on this one or a cluster.

An engine yields the number and the result of each job as it ends. It raises LostError where a
worker was lost; the jobs that have not ended are then run again. `alone`: hand out each job by
itself; otherwise short jobs are handed out in batches.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Generator, Sequence
from typing import Any, Final

from wheelchair_gym.config import InputError

Job = Any
Results = Generator[tuple[int, Any]]
IDLE_TIME = 300  # s that idle workers wait for the next runs: loading all kernels takes seconds
RETRIES = 3  # of Ray, for a lost task
BATCHES = 8  # of Ray, for each worker


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
    work: Callable[[Job], Any], number: int, job: Job, places: Sequence[str] = ()
) -> tuple[int, Any]:
    """The number and the result of a job, with modules looked for in these folders, too."""
    sys.path += [place for place in places if place not in sys.path]
    return number, work(job)


def _loky(work: Callable[[Job], Any], jobs: Sequence[Job], workers: int, alone: bool) -> Results:
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


def _ray(work: Callable[[Job], Any], jobs: Sequence[Job], workers: int, alone: bool) -> Results:
    import ray

    address = os.environ.get("RAY_ADDRESS")
    quiet: dict[str, Any] = {"log_to_driver": False, "logging_level": "ERROR"}
    started = not ray.is_initialized()
    if started and address:
        import agents
        import planners
        import wheelchair_gym
        from wheelchair_gym.registry import modules_of_others

        # Send this code to the cluster's machines, whatever is installed there.
        threads = ("OMP", "OPENBLAS", "MKL", "NUMEXPR", "NUMBA")
        env = {f"{name}_NUM_THREADS": "1" for name in threads}
        modules = [wheelchair_gym, planners, agents, *modules_of_others()]
        code = {"py_modules": modules, "env_vars": env}
        ray.init(address, runtime_env=code, **quiet)
    elif started:  # Ray itself holds a task of one core to one thread
        ray.init("local", num_cpus=workers, include_dashboard=False, **quiet)
    cores: dict[str, float] = ray.cluster_resources()  # type: ignore[no-untyped-call]
    workers = max(workers, int(cores.get("CPU", 1)))
    size = 1 if alone else max(1, len(jobs) // (BATCHES * workers))
    remote: Any = ray.remote(max_retries=RETRIES)(_batch)
    numbered = list(enumerate(jobs))
    batches = [numbered[k : k + size] for k in range(0, len(jobs), size)]
    try:
        running: list[Any] = []
        while batches or running:
            while batches and len(running) < 2 * workers:
                running.append(remote.remote(work, batches.pop(0)))
            (ended,), running = ray.wait(running, num_returns=1)
            yield from ray.get(ended)
    except ray.exceptions.RayTaskError as error:
        raise error.cause from None  # what the job itself raised
    except ray.exceptions.RayError as error:
        raise LostError(type(error).__name__) from None
    finally:
        if started:
            ray.shutdown()


def _batch(work: Callable[[Job], Any], jobs: Sequence[tuple[int, Job]]) -> list[tuple[int, Any]]:
    return [_numbered(work, *job) for job in jobs]


ENGINES: Final = {"loky": _loky, "ray": _ray}


def check(workers: int, engine: str) -> None:
    """Refuse workers and engines that do not exist.

    Raises:
        InputError: the number is below 1, or the engine is unknown or not installed.
    """
    import importlib.util

    if workers < 1:
        raise InputError(f"jobs is {workers}; it must be at least 1")
    if engine not in ENGINES:
        raise InputError(f"engine {engine!r} is unknown; known: {', '.join(ENGINES)}")
    if engine == "ray" and importlib.util.find_spec("ray") is None:
        raise InputError("engine ray needs the package ray; pip install 'wheelchair_gym[cluster]'")
