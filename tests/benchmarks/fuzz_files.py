"""Mutations of valid files of every reader: `python -m tests.benchmarks.fuzz_files`.

Reads `--count` (100,000) mutations of each reader's valid file (`tests.fuzz`), in a worker process
with a limit of memory and a time limit for each input, and prints by reader how many were read, how
many refused in one line, what failed, and the longest time and most memory of one input. What was
done is kept in `--out`; the same command goes on from there. Exit code 1: an input hung, crashed,
took too much memory, or ended in anything but one line.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

from agents.evaluation.runs import compute, run_key, source_digest
from agents.evaluation.tables import markdown_table
from tests.fuzz import MEMORY, READERS, TIMEOUT, Watched, fuzz

BATCH = 200  # inputs between two saves


def added(before: dict[str, Any], found: dict[str, Any]) -> dict[str, Any]:
    """Counts and failures summed, the longest and the most of both."""
    if not before:
        return found
    maximum = {name: max(before[name], found[name]) for name in ("longest_s", "max_bytes")}
    return {name: before[name] + found[name] for name in found if name not in maximum} | maximum


def table(done: dict[str, Any]) -> str:
    """Counts by reader, as a table of Markdown."""
    heads = (
        "reader", "inputs", "read", "refused, one line", "failed", "longest [s]",
        "most memory [MB]",
    )  # fmt: skip
    rows = [
        [
            name, f"{of['inputs']:,}", f"{of['read']:,}", f"{of['refused']:,}", len(of["failed"]),
            f"{of['longest_s']:.2f}", f"{of['max_bytes'] / 1e6:.0f}",
        ]
        for name, of in done.items()
    ]  # fmt: skip
    return markdown_table(heads, rows, [False] + [True] * 6)


def main() -> int:
    """Fuzz, save, and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=100_000, help="inputs of each reader")
    parser.add_argument("--out", type=Path, default=Path("runs/fuzz_files.jsonl"))
    given = parser.parse_args()
    batches = [range(k, min(k + BATCH, given.count)) for k in range(0, given.count, BATCH)]
    code = source_digest(), source_digest("tests/fuzz.py")
    jobs = {
        run_key(*code, name, list(numbers)): (name, numbers)
        for numbers in batches  # a batch of each in turn
        for name in READERS
    }
    with Watched() as watched:
        found = compute(jobs, lambda job: fuzz(watched, *job), given.out, unit="batch")
    done: dict[str, Any] = {}
    for (name, _), counts in zip(jobs.values(), found.values(), strict=True):
        done[name] = added(done.get(name, {}), counts)
    print(table({name: done[name] for name in READERS}))
    print(f"limits of one input: {TIMEOUT:g} s, {MEMORY / 1e6:,.0f} MB")
    failed = [(name, *what) for name in READERS for what in done[name]["failed"]]
    for name, number, said in failed:
        print(f"{name}, input {number}: {said}")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
