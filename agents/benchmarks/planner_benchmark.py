"""A planner benchmark as a whole: who, on what, under which conditions, and its results file."""

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
from agents.benchmarks.race import FORMAT, BenchmarkRuns, Record
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

LOG_PAUSE = 10.0  # s between two lines of progress where they are kept, as in a log

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
    """Everything of one benchmark.

    Args:
        ours: planners by name, or mappings with their settings.
        peers: names of peers, installed.
        problems: file of problems; None: problems made from scenes.
        only: names of problems; empty: all.
        seeds: of the runs.
        deadlines: seconds.
        known: records of earlier runs, by key.
        core: which all runs use.

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
        self.race = BenchmarkRuns(self.entrants, self.cases, list(seeds), deadlines, known)
        self._iterations: list[dict[str, Any]] = []
        self._settings = {
            "problems": str(problems) if problems else f"scenes, seed {SEED}, margin {MARGIN} m",
            "seeds": list(seeds),
            "deadlines_s": self.race.deadlines,
            "core": core,
            "terms": list(TERMS),
            "contenders": [runner.description for runner in self.entrants],
        }

    @property
    def progress(self) -> tuple[int, int]:
        """Runs made, and runs wanted."""
        return len(self.race.records), len(self.race.wanted)

    def run(self, file: str | Path, bar: bool = True, pause: float = 30.0) -> bool:
        """Make the runs that are missing; whether all were made, or a person stopped it.

        Args:
            file: results are written there now and then, and at the end.
            bar: show progress on standard error.
            pause: seconds between two times of writing.
        """
        from tqdm import tqdm

        often = 0.1 if sys.stderr.isatty() else LOG_PAUSE
        made, wanted = self.progress
        written, done = time.perf_counter(), True
        write_json(file, self.result())  # what cannot be written is known before hours have gone
        try:
            self._iterations = iteration_rows(self.cases, self.peers)
            for _ in tqdm(
                self.race.run_missing(), total=wanted, initial=made, unit="run", mininterval=often,
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
        records = list(self.race.records.values())
        return summarise(self.entrants, self.cases, records, self.race.deadlines)

    def result(self) -> dict[str, Any]:
        """Everything, as the results file has it."""
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
                for deadline in self.race.deadlines
            },
            "iterations": self._iterations,
            "records": self.race.stored_records,
            "others": self.race.others,
        }

    def text(self) -> str:
        """The figures as Markdown."""
        lines = [markdown(self.rows(), self.race.deadlines)]
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
        """Write the figures as CSV, and draw them, where that is asked for.

        Raises:
            InputError: a file cannot be written.
        """
        if table:
            write_text(table, as_csv(self.rows()))
        if plot:
            from agents.benchmarks.curves import draw

            optima = {case.name: case.optimum for case in self.cases}
            records = list(self.race.records.values())
            draw(self.rows(), records, optima, self.race.deadlines, plot)
