"""Functions that workers import and run in the tests of runs."""

import os
import signal
import time
from pathlib import Path

import numpy as np


def draw(job):
    """Numbers that depend on the job alone."""
    seed, _ = job
    rng = np.random.default_rng(seed)
    return {"seed": seed, "sum": float(rng.normal(size=100).sum()), "tail": float(rng.random())}


def dying(job):
    """The same, but the first process that is given a marked job is killed."""
    seed, mark = job
    if mark is not None and not Path(mark).exists():
        Path(mark).write_text(str(os.getpid()))
        os.kill(os.getpid(), signal.SIGKILL)
    return draw((seed, None))


def deadly(job):
    if job[0] == 3:
        os.kill(os.getpid(), signal.SIGKILL)
    return draw(job)


def wrong(job):
    raise ZeroDivisionError(f"seed {job[0]}")


def counted(job):
    """Leaves a trace of each call, and stops by hand at a job that is marked 'stop'."""
    seed, folder = job
    if (mark := Path(folder) / f"stop {seed}").exists():
        if mark.read_text() == "in compiled code":
            raise SystemError("returned a result with an exception set") from KeyboardInterrupt()
        raise KeyboardInterrupt
    with (Path(folder) / "calls").open("a") as calls:
        calls.write(f"{seed}\n")
    return draw((seed, None))


def lasting(job):
    (Path(job[1]) / str(os.getpid())).touch()
    time.sleep(600.0)
    return draw(job)
