"""Memory of a long run: `OMP_NUM_THREADS=1 python -m tests.benchmarks.memory [--steps N]`.

256 rows in floor plans of a bank of 256, two threads, random actions. A line per million steps:
resident memory, live objects of worlds, worlds of the bank, and episodes of the slowest and the
fastest row.
"""

from __future__ import annotations

import argparse
import gc
from collections import Counter

import numpy as np

from agents.benchmarks.environments import resident_bytes
from wheelchair_gym.envs import NavigationVectorEnv

ROWS, LINE = 256, 1_000_000
KINDS = ("Episode", "Geodesic", "PreparedEpisode")


def main() -> None:
    """Step as often as asked."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--steps", type=int, default=3 * LINE, help="of all rows together")
    steps = parser.parse_args().steps
    env = NavigationVectorEnv(ROWS, bank=256, num_threads=2)
    env.reset(seed=0)
    rng = np.random.default_rng(0)
    for done in range(ROWS, steps + ROWS, ROWS):
        env.step(rng.uniform(-1.0, 1.0, (ROWS, 2)))
        if done % LINE < ROWS:
            gc.collect()
            alive = Counter(type(each).__name__ for each in gc.get_objects())
            objects = "  ".join(f"{alive[kind]} {kind}" for kind in KINDS)
            print(
                f"{done:>11,} steps  {resident_bytes() / 1e6:.1f} MB  {objects}  "
                f"{len(env.worlds)} worlds  {env._counts.min()} to {env._counts.max()} episodes",
                flush=True,
            )


if __name__ == "__main__":
    main()
