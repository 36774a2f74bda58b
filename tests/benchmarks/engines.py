"""What two workers gain, and what an episode costs beyond its driving, on each engine.

`python -m tests.benchmarks.engines [episodes [runs]]`: two bare busy loops say what the machine
gives at most; then the same episodes, and the same runs of a study for each of its rows and maps,
by one worker and by two. The rounds alternate, so that whatever else the machine does falls on all.
The overhead is of runs that do nothing, by two workers.
"""

from __future__ import annotations

import importlib.util
import multiprocessing
import statistics
import sys
import tempfile
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from agents.evaluation.compare import BEST
from agents.evaluation.engines import ENGINES
from agents.evaluation.evaluate import run_episode, warm
from agents.evaluation.runs import compute
from agents.studies.experiments import measure
from agents.studies.runner import STUDIES, study_jobs

ROUNDS, EMPTY, SPINS = 3, 2000, 60_000_000
ENV = {"pose_source": "modelled", "shield": {}}
SCENE = "floor_plan"
STUDY = "t1-3.13"


def spin(count: int) -> None:
    """A bare busy loop."""
    for _ in range(count):
        pass


def spun(workers: int) -> float:
    """Seconds of so many busy loops side by side."""
    processes = [multiprocessing.Process(target=spin, args=(SPINS,)) for _ in range(workers)]
    begun = time.perf_counter()
    for process in processes:
        process.start()
    for process in processes:
        process.join()
    return time.perf_counter() - begun


def driven(seed: int) -> dict[str, Any]:
    """An episode of the best scripted policy."""
    return run_episode(BEST, SCENE, seed, ENV, None)


def nothing(seed: int) -> dict[str, Any]:
    """A run without any work."""
    return {"seed": seed}


def seconds(work: Any, jobs: Mapping[str, Any], workers: int, engine: str = "loky") -> float:
    """Wall time of runs; workers are there already where the engine keeps them."""
    with tempfile.TemporaryDirectory() as folder:
        begun = time.perf_counter()
        compute(jobs, work, Path(folder) / "runs.jsonl", workers=workers, engine=engine,
                progress=False)  # fmt: skip
        return time.perf_counter() - begun


def seeds(count: int) -> dict[str, int]:
    """Jobs that are a seed each."""
    return {str(seed): seed for seed in range(count)}


def gain(name: str, timed: Callable[[int], float]) -> None:
    """Print what two workers gain over one, beside two bare busy loops."""
    spins, drives = [], []
    for number in range(ROUNDS):
        spins.append(2.0 * spun(1) / spun(2))
        drives.append(timed(1) / timed(2))
        print(f"round {number}: busy loops {spins[-1]:.3f}, {name} {drives[-1]:.3f}", flush=True)
    share = statistics.median(d / s for d, s in zip(drives, spins, strict=True))
    print(f"speed-up by two workers, {name}: {statistics.median(drives):.3f}, of two busy loops "
          f"{statistics.median(spins):.3f}: {100 * share:.1f} %")  # fmt: skip


def main() -> None:
    """Print ratios and milliseconds."""
    given = [int(word) for word in sys.argv[1:3]]
    episodes, runs = given + [80, 100][len(given) :]
    warm(BEST, SCENE, ENV)
    seconds(driven, seeds(4), 2)  # workers load their kernels
    gain(f"{episodes} episodes", lambda workers: seconds(driven, seeds(episodes), workers))
    jobs = {key: job for key, job in study_jobs(STUDIES[STUDY], runs).values()}
    seconds(measure, dict(list(jobs.items())[:200]), 2)
    gain(f"{len(jobs)} runs of {STUDY}", lambda workers: seconds(measure, jobs, workers))
    for engine in ENGINES:
        if engine == "ray" and importlib.util.find_spec("ray") is None:
            continue
        start = seconds(nothing, seeds(4), 2, engine)
        cost = statistics.median(seconds(nothing, seeds(EMPTY), 2, engine) for _ in range(ROUNDS))
        print(f"{engine}: {1e3 * cost / EMPTY:.2f} ms a run of {EMPTY} "
              f"(its start among them; four runs from cold {start:.1f} s)")  # fmt: skip


if __name__ == "__main__":
    main()
