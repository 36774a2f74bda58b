"""A planner benchmark: its entrants, problems, conditions and results file."""

from __future__ import annotations

import sys
import time
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from agents.benchmarks.cases import MARGIN, SEED, description, scene_cases, stored_cases
from agents.benchmarks.entrants import UNLIMITED, make_entrants
from agents.benchmarks.environments import provenance
from agents.benchmarks.iteration import iteration_rows
from agents.benchmarks.runs import FORMAT, BenchmarkRuns, Record
from agents.benchmarks.summary import (
    LATE_FACTOR,
    as_csv,
    deadline_key,
    markdown,
    ranking,
    summarise,
)
from agents.evaluation.provenance import command_line, write_json, write_text
from agents.interrupt import by_hand

LOG_INTERVAL = 10.0  # s between two lines of progress in a log

TERMS = (
    "The arrays of a map for exact tests are made before the clock starts, and so is each peer's "
    "own description of the map. The first call is on a map that the planner has not seen; the "
    "other calls share a map and what a planner caches with it.",
    f"Under a deadline a planner's limit of iterations is {UNLIMITED:.0e}; an answer later than "
    f"{LATE_FACTOR} times the deadline does not count. A planner without deadlines answers when it "
    "is done.",
    "Where a planner reports the iteration of its first path and not the time, a run that ends at "
    "this iteration measures the time; where it reports neither, it is the time of the whole run.",
    "A path is valid if shapely finds no fault in it: exact edges, within 1e-6 m.",
    "OMPL gets our exact edge test, compiled for the map, which makes it faster; '..._sampled' is "
    "OMPL as it comes. Its random numbers are one stream of the process.",
)


class PlannerBenchmark:
    """A benchmark of planners: its entrants, problems, runs and results.

    Args:
        ours: planners by name, or mappings with their settings.
        peers: names of peers, installed.
        problems: file of problems; None: problems made from scenes.
        only: names of problems; empty: all.
        seeds: of the runs.
        deadlines: seconds.
        known: records of earlier runs, by key.
        core: that all runs use.

    Raises:
        InputError: a name, a setting or the file is wrong.
    """

    def __init__(
        self,
        ours: Sequence[Any],
        peers: Sequence[str],
        problems: str | Path | None,
        only: Sequence[str],
        seeds: Sequence[int],
        deadlines: Sequence[float],
        known: Mapping[str, Record],
        core: int | None = None,
    ) -> None:
        self.peers = list(peers)
        self.cases = stored_cases(problems, only) if problems else scene_cases(only)
        self.entrants = make_entrants(ours, peers)
        self.runs = BenchmarkRuns(self.entrants, self.cases, list(seeds), deadlines, known)
        self._iterations: list[dict[str, Any]] = []
        self._settings = {
            "problems": str(problems) if problems else f"scenes, seed {SEED}, margin {MARGIN} m",
            "seeds": list(seeds),
            "deadlines_s": self.runs.deadlines,
            "core": core,
            "terms": list(TERMS),
            "entrants": [entrant.description for entrant in self.entrants],
        }

    @property
    def progress(self) -> tuple[int, int]:
        """Finished runs, and all runs."""
        return len(self.runs.records), len(self.runs.wanted)

    def run(self, file: str | Path, bar: bool = True, pause: float = 30.0) -> bool:
        """Make the missing runs; False if Ctrl-C stopped them.

        Args:
            file: that results are written to at intervals, and at the end.
            bar: show progress on standard error.
            pause: interval of writing [s].
        """
        from tqdm import tqdm

        often = 0.1 if sys.stderr.isatty() else LOG_INTERVAL
        made, wanted = self.progress
        written, done = time.perf_counter(), True
        write_json(file, self.result())  # fails now where the file cannot be written
        try:
            self._iterations = iteration_rows(self.cases, self.peers)
            for _ in tqdm(
                self.runs.run_missing(), total=wanted, initial=made, unit="run", mininterval=often,
                maxinterval=often, disable=not bar,
            ):  # fmt: skip
                if time.perf_counter() - written > pause:
                    write_json(file, self.result())
                    written = time.perf_counter()
        except (KeyboardInterrupt, SystemError) as error:
            if not by_hand(error):
                raise
            done = False
        write_json(file, self.result())
        return done

    def rows(self) -> list[dict[str, Any]]:
        """The figures so far."""
        records = list(self.runs.records.values())
        return summarise(self.entrants, self.cases, records, self.runs.deadlines)

    def result(self) -> dict[str, Any]:
        """The content of the results file."""
        rows = self.rows()
        return {
            "format": FORMAT,
            "command": command_line(),
            "provenance": {
                **provenance(**self._settings),
                "written": datetime.now(UTC).isoformat(timespec="seconds"),
            },
            "problems": [description(case) for case in self.cases],
            "rows": rows,
            "anytime": {
                deadline_key(deadline): [row["planner"] for row in ranking(rows, deadline)]
                for deadline in self.runs.deadlines
            },
            "iterations": self._iterations,
            "records": self.runs.stored_records,
            "others": self.runs.others,
        }

    def text(self) -> str:
        """The figures as Markdown."""
        lines = [markdown(self.rows(), self.runs.deadlines)]
        if self._iterations:
            first = self._iterations[0]
            lines.append(
                f"One iteration, population {first['population']}, {first['way_points']} way "
                f"points, {first['problem']}: "
                + ", ".join(f"{row['swarm']} {row['us']:.0f} us" for row in self._iterations)
                + "\n"
            )
        return "\n".join(lines)

    def write(self, table: str | None, plot: str | None) -> None:
        """Write the figures as CSV, and plot them, where a file is given.

        Raises:
            InputError: a file cannot be written.
        """
        if table:
            write_text(table, as_csv(self.rows()))
        if plot:
            from agents.benchmarks.curves import draw

            optima = {case.name: case.optimum for case in self.cases}
            records = list(self.runs.records.values())
            draw(self.rows(), records, optima, self.runs.deadlines, plot)
