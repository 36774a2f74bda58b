"""Mutations of valid files of every reader: `python -m tests.benchmarks.fuzz_files`.

Reads `--count` (100,000) mutations of each reader's valid file (`tests.fuzz`), in a worker process
with a limit of memory and a time limit for each input, and prints by reader how many were read, how
many refused in one line, what failed, and the longest time and most memory of one input. What was
done is kept in `--out` (runs/fuzz_files.json); the same command goes on from there. Exit code 1: an
input hung, crashed, took too much memory, or ended in anything but one line.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any

from tests.fuzz import MEMORY, READERS, TIMEOUT, Watched, fuzz
from wheelchair_gym.files import atomic_write

BATCH = 200  # inputs between two saves


def added(before: dict[str, Any], found: dict[str, Any]) -> dict[str, Any]:
    """Counts and failures summed, the longest and the most of both."""
    if not before:
        return found
    most = {name: max(before[name], found[name]) for name in ("longest_s", "most_bytes")}
    return {name: before[name] + found[name] for name in found if name not in most} | most


def table(done: dict[str, Any]) -> str:
    """Counts by reader, as a table of Markdown."""
    lines = [
        "| reader | inputs | read | refused, one line | failed | longest [s] | most memory [MB] |",
        "| --- | ---: | ---: | ---: | ---: | ---: | ---: |",
    ]
    for name, of in done.items():
        lines.append(
            f"| {name} | {of['inputs']:,} | {of['read']:,} | {of['refused']:,} | "
            f"{len(of['failed'])} | {of['longest_s']:.2f} | {of['most_bytes'] / 1e6:.0f} |"
        )
    return "\n".join(lines)


def main() -> int:
    """Fuzz, save, and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=100_000, help="inputs of each reader")
    parser.add_argument("--out", type=Path, default=Path("runs/fuzz_files.json"))
    given = parser.parse_args()
    done: dict[str, Any] = json.loads(given.out.read_text()) if given.out.exists() else {}
    with Watched() as watched:
        missing = True
        while missing:  # a batch of each in turn
            missing = False
            for name in READERS:
                first = done.get(name, {}).get("inputs", 0)
                if first >= given.count:
                    continue
                missing = True
                numbers = range(first, min(first + BATCH, given.count))
                done[name] = added(done.get(name, {}), fuzz(watched, name, numbers))
                with atomic_write(given.out) as part:
                    part.write_text(json.dumps(done, indent=1))
                print(f"{name}: {done[name]['inputs']:,} of {given.count:,}", file=sys.stderr)
    print(table({name: done[name] for name in READERS if name in done}))
    print(f"limits of one input: {TIMEOUT:g} s, {MEMORY / 1e6:,.0f} MB")
    failed = [(name, *what) for name in READERS for what in done.get(name, {}).get("failed", ())]
    for name, number, said in failed:
        print(f"{name}, input {number}: {said}")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
