"""What two workers gain, and what an episode costs beyond its driving, on each engine.

`python -m tests.benchmarks.engines [episodes]`: two bare busy loops say what the machine gives at
most; then the same episodes by one worker and by two. The rounds alternate, so that whatever else
the machine does falls on all. The overhead is of runs that do nothing, by two workers.
"""

from __future__ import annotations

import importlib.util
import multiprocessing
import statistics
import sys
import tempfile
import time
from functools import partial
from pathlib import Path
from typing import Any

from agents.compare import BEST
from agents.engines import ENGINES
from agents.evaluate import run_episode, warm
from agents.runs import compute

ROUNDS, EMPTY, SPINS = 3, 2000, 60_000_000
ENV = {"pose_source": "modelled", "shield": {}}
SCENE = "floor_plan"


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


def seconds(work: Any, count: int, workers: int, engine: str) -> float:
    """Wall time of so many runs; workers are there already where the engine keeps them."""
    jobs = {str(seed): seed for seed in range(count)}
    with tempfile.TemporaryDirectory() as folder:
        begun = time.perf_counter()
        compute(jobs, work, Path(folder) / "runs.jsonl", workers=workers, engine=engine,
                progress=False)  # fmt: skip
        return time.perf_counter() - begun


def main() -> None:
    """Print ratios and milliseconds."""
    episodes = int(sys.argv[1]) if len(sys.argv) > 1 else 80
    warm(BEST, SCENE, ENV)
    one, two = partial(seconds, driven, episodes, 1), partial(seconds, driven, episodes, 2)
    seconds(driven, 4, 2, "loky")  # workers load their kernels
    spins, drives = [], []
    for number in range(ROUNDS):
        spins.append(2.0 * spun(1) / spun(2))
        drives.append(one("loky") / two("loky"))
        print(f"round {number}: busy loops {spins[-1]:.3f}, {episodes} episodes {drives[-1]:.3f}",
              flush=True)  # fmt: skip
    share = statistics.median(d / s for d, s in zip(drives, spins, strict=True))
    gain, most = statistics.median(drives), statistics.median(spins)
    print(f"speed-up by two workers {gain:.3f}, of two busy loops {most:.3f}: {100 * share:.1f} %")
    for engine in ENGINES:
        if engine == "ray" and importlib.util.find_spec("ray") is None:
            continue
        start = seconds(nothing, 4, 2, engine)
        cost = statistics.median(seconds(nothing, EMPTY, 2, engine) for _ in range(ROUNDS))
        print(f"{engine}: {1e3 * cost / EMPTY:.2f} ms a run of {EMPTY} "
              f"(its start among them; four runs from cold {start:.1f} s)")  # fmt: skip


if __name__ == "__main__":
    main()
