"""The types of a study: rows of runs with their published figures, and claims."""

import csv
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from functools import cache
from importlib.resources import files
from typing import TYPE_CHECKING, Any, NamedTuple
from zlib import crc32

import numpy as np

from agents.evaluation.runs import Record
from wheelchair_gym.base.arrays import Array

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from agents.studies.claims import Claim

SEED_STRIDE = 1_000_000  # between the first seeds of two rows

Job = Mapping[str, Any]


class Metric(NamedTuple):
    """A figure of a run: its key in records, name, unit and number of digits."""

    key: str
    name: str
    unit: str = ""
    digits: int = 3
    only_solved: bool = True  # only of runs that found a path

    @property
    def heading(self) -> str:
        """The name with the unit."""
        return f"{self.name} [{self.unit}]" if self.unit else self.name


LENGTH = Metric("length_m", "length", "m")
NODES = Metric("nodes", "nodes", "", 1)
RATIO = Metric("ratio", "length / shortest", "", 4)


@dataclass(frozen=True)
class Row:
    """A line of a table: runs that differ by seed and stratum only."""

    label: str
    jobs: Mapping[str, Job]  # by stratum, such as a map
    x: float = float("nan")  # the varied quantity
    series: str = ""  # the line in the figure
    group: str = ""  # rows that a claim takes together
    published: Mapping[str, float] = field(default_factory=dict)


class Results:
    """The runs of a study, by row and stratum."""

    def __init__(self, study: "Study", records: Iterable[tuple[str, str, int, Record]]) -> None:
        self.study = study
        self.runs: dict[tuple[str, str], list[Record]] = {
            (row.label, stratum): [] for row in study.rows for stratum in row.jobs
        }
        for row, stratum, _, record in records:
            self.runs[row, stratum].append(record)

    def sample(self, row: str, metric: Metric, all_runs: bool = False) -> dict[str, Array]:
        """Values by stratum; for a metric with `only_solved`, of solved runs.

        With `all_runs` there is a value for each run, NaN for a run without one.
        """
        found = {}
        for (label, stratum), records in self.runs.items():
            if label == row:
                of = [
                    r.get(metric.key) if r["solved"] or not metric.only_solved else None
                    for r in records
                ]
                values = np.array(of, dtype=float)
                found[stratum] = values if all_runs else values[~np.isnan(values)]
        return found

    def pooled(self, row: str, metric: Metric) -> Array:
        """The values of all strata in one array."""
        return np.concatenate([*self.sample(row, metric).values(), np.empty(0)])

    def paired(self, row: str, metric: Metric) -> Array:
        """The values of all runs (n,) in one order; NaN for a run without one."""
        records = [record for (label, _), of in self.runs.items() if label == row for record in of]
        return np.array([record.get(metric.key, np.nan) for record in records], dtype=float)

    def solved(self, row: str) -> tuple[int, int]:
        """Number of runs that found a path, and of all runs."""
        of = [r for (label, _), records in self.runs.items() if label == row for r in records]
        return sum(bool(r["solved"]) for r in of), len(of)


@dataclass(frozen=True)
class Study:
    """The repetition of a table or section of a source."""

    name: str
    title: str
    source: str
    settings: str  # of our runs, with reasons
    reading: str  # of the source, where its text is silent
    metrics: tuple[Metric, ...]
    margins: Mapping[str, float]  # by metric: less than this part counts as no difference
    rows: tuple[Row, ...]
    claims: "tuple[Claim, ...]"
    figures: "Callable[[Results], Mapping[str, Figure]]"
    captions: Mapping[str, str]  # of the figures
    paired: bool = False  # all rows have the same seeds
    runs: int = 400  # the 100 of the thesis leave most trends undecided
    quick_runs: int = 10
    notes: tuple[str, ...] = ()

    def metric(self, key: str) -> Metric:
        """The metric of a key."""
        return next(metric for metric in self.metrics if metric.key == key)

    def series(self, name: str) -> list[Row]:
        """The rows of a series."""
        return [row for row in self.rows if row.series == name]

    def seeds(self, row: Row, runs: int) -> range:
        """Seeds of a row's runs; rows are independent unless they are paired."""
        place = 0 if self.paired else crc32(f"{self.name} {row.label}".encode())
        return range(place * SEED_STRIDE, place * SEED_STRIDE + runs)


@cache
def published(study: str) -> dict[str, dict[str, float]]:
    """The figures of a source's table, as printed: row -> key of the metric -> value."""
    text = (files("agents") / "data" / "published.csv").read_text(encoding="utf-8")
    found: dict[str, dict[str, float]] = {}
    for line in csv.DictReader(text.splitlines()):
        if line["study"] == study:
            found.setdefault(line["row"], {})[line["metric"]] = float(line["value"])
    return found
