"""What runs jobs in other processes: loky on this machine, Ray on this one or on a cluster."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Callable, Sequence
from typing import Any, Final, Protocol

from wheelchair_gym.config import InputError

# A worker computes on one core: threads of libraries would only fight for the others.
_ONE_THREAD = {
    f"{name}_NUM_THREADS": "1" for name in ("OMP", "OPENBLAS", "MKL", "NUMEXPR", "NUMBA")
}
KEPT = 300  # s that idle workers wait for the next runs: it takes seconds to load all kernels
RETRIES = 3  # Ray hands a lost task out so often before it tells us


class LostError(Exception):
    """A worker ended before its job did."""


class Pool(Protocol):
    """Workers. A ticket stands for a call that was handed out."""

    workers: int

    def __init__(self, workers: int) -> None: ...

    @staticmethod
    def check() -> None:
        """Raise InputError where the engine is not installed."""

    def submit(self, function: Callable[..., Any], *arguments: Any) -> Any:
        """Hand a call out; its ticket. LostError if no worker is left to take it."""

    def ended(self, tickets: Sequence[Any]) -> Sequence[Any]:
        """Wait until some calls have ended; their tickets."""

    def result(self, ticket: Any) -> Any:
        """What a call gave: its result, its exception, or LostError."""

    def close(self, done: bool) -> None:
        """Let the workers go, at once where not all is done."""


def _start_worker() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent decides when to stop
    threading.Thread(target=_end_with, args=(os.getppid(),), daemon=True).start()


def _end_with(parent: int) -> None:
    """A worker outlives nobody: a parent that was killed cannot end it."""
    while os.getppid() == parent:
        time.sleep(1.0)
    os._exit(1)


class Loky:
    """Processes of this machine (joblib's loky)."""

    def __init__(self, workers: int) -> None:
        self.workers = workers
        self._pool = self._new()

    @staticmethod
    def check() -> None:
        """Joblib is always there."""

    def _new(self) -> Any:
        from joblib.externals.loky import get_reusable_executor

        # Where the last one lost a worker, this is a new one.
        return get_reusable_executor(
            self.workers, timeout=KEPT, initializer=_start_worker, env=_ONE_THREAD
        )

    def submit(self, function: Callable[..., Any], *arguments: Any) -> Any:
        """Hand a call out; its ticket."""
        from concurrent.futures import BrokenExecutor

        try:
            return self._pool.submit(function, *arguments)
        except BrokenExecutor as error:
            self._pool = self._new()
            raise LostError(type(error).__name__) from None

    def ended(self, tickets: Sequence[Any]) -> Sequence[Any]:
        """Wait until some calls have ended; their tickets."""
        from concurrent.futures import FIRST_COMPLETED, wait

        return list(wait(tickets, return_when=FIRST_COMPLETED).done)

    def result(self, ticket: Any) -> Any:
        """What a call gave, or LostError."""
        from concurrent.futures import BrokenExecutor

        try:
            return ticket.result()
        except BrokenExecutor as error:
            self._pool = self._new()
            raise LostError(type(error).__name__) from None

    def close(self, done: bool) -> None:
        """Keep idle workers for the next runs; end those that are at work."""
        if not done:
            self._pool.shutdown(wait=False, kill_workers=True)


class Ray:
    """Tasks of Ray: on the cluster at RAY_ADDRESS, or else on this machine."""

    def __init__(self, workers: int) -> None:
        import ray

        self._ray, address = ray, os.environ.get("RAY_ADDRESS")
        quiet: dict[str, Any] = {"log_to_driver": False, "logging_level": "ERROR"}
        self._own = not ray.is_initialized()
        if not self._own:
            pass
        elif address:
            import agents
            import planners
            import wheelchair_gym

            # The cluster's machines run this very code, whatever is installed there.
            code = {"py_modules": [wheelchair_gym, planners, agents], "env_vars": _ONE_THREAD}
            ray.init(address, runtime_env=code, **quiet)
        else:
            # Ray itself holds a task of one core to one thread.
            ray.init("local", num_cpus=workers, include_dashboard=False, **quiet)
        cores: dict[str, float] = ray.cluster_resources()  # type: ignore[no-untyped-call]
        self.workers = max(workers, int(cores.get("CPU", 1)))

    @staticmethod
    def check() -> None:
        """Raise InputError where Ray is not installed."""
        import importlib.util

        if importlib.util.find_spec("ray") is None:
            raise InputError(
                "engine ray needs the package ray; pip install 'wheelchair_gym[cluster]'"
            )

    def submit(self, function: Callable[..., Any], *arguments: Any) -> Any:
        """Hand a call out; its ticket."""
        return self._ray.remote(max_retries=RETRIES)(function).remote(*arguments)

    def ended(self, tickets: Sequence[Any]) -> Sequence[Any]:
        """Wait until some calls have ended; their tickets."""
        first, rest = self._ray.wait(list(tickets), num_returns=1)
        return first + (self._ray.wait(rest, num_returns=len(rest), timeout=0)[0] if rest else [])

    def result(self, ticket: Any) -> Any:
        """What a call gave, or LostError."""
        from ray.exceptions import RayTaskError

        try:
            return self._ray.get(ticket)
        except RayTaskError as error:
            raise error.cause from None  # what the call itself raised
        except self._ray.exceptions.RayError as error:
            raise LostError(type(error).__name__) from None

    def close(self, done: bool) -> None:
        """Leave the cluster, or end this machine's workers."""
        if self._own:
            self._ray.shutdown()


ENGINES: Final[dict[str, type[Pool]]] = {"loky": Loky, "ray": Ray}
