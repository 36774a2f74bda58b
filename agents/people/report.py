"""Conditions of an experiment compared within participants: tables, a page and tidy data."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from agents.evaluation.assisted import MEASURES
from agents.evaluation.metrics import Record
from agents.evaluation.provenance import provenance
from agents.evaluation.report import COLUMN_OF
from agents.evaluation.statistics import holm, median_interval, wilcoxon_p
from agents.evaluation.tables import Table, columns_of, make_table, write_page
from agents.people.export import export
from agents.people.folder import DATA, PAGE, read_folder
from agents.people.progress import State
from agents.people.protocol import Protocol
from wheelchair_gym.base.settings import InputError

# Keys of the measures of drives in the tables, in order.
DRIVE_MEASURES = (
    "success", "time", "at_fault", "clearance_min", "length", "jerk_rms", *MEASURES,
)  # fmt: skip
_NAME = {key: COLUMN_OF[key].name for key in DRIVE_MEASURES}
ONLY_OF_SUCCESSES = (_NAME["time"], _NAME["length"])


Values = Mapping[str, Mapping[tuple[int, str], float]]  # by condition: by participant and task


def _values(rows: Sequence[Record], measure: str, conditions: list[str]) -> Values:
    succeeded = {
        (row["participant"], row["condition"], row["task"])
        for row in rows
        if row["measure"] == _NAME["success"] and row["value"]
    }
    found: dict[str, dict[tuple[int, str], float]] = {name: {} for name in conditions}
    for row in rows:
        drive = row["participant"], row["condition"], row["task"]
        if row["measure"] != measure:
            continue
        if measure not in ONLY_OF_SUCCESSES or drive in succeeded:
            found[row["condition"]][row["participant"], row["task"]] = row["value"]
    return found


def _means_of(values: Mapping[tuple[int, str], float]) -> list[float]:
    """The mean over tasks of each participant."""
    people = sorted({person for person, _ in values})
    return [float(np.mean([v for (who, _), v in values.items() if who == p])) for p in people]


def _tables(rows: Sequence[Record], source: str, conditions: list[str]) -> list[Table]:
    """Means by condition, and differences of pairs of conditions; the rows are of one source."""
    units = {row["measure"]: row["unit"] for row in rows}
    means: list[list[Record]] = []
    tests: list[list[Record]] = []
    for measure in _NAME.values() if source == "drive" else units:
        if measure not in units:
            continue
        title = f"{measure} [{units[measure]}]" if units[measure] else measure
        values = _values(rows, measure, conditions)
        group: list[Record] = []
        for name in conditions:
            each = _means_of(values[name])
            if each:
                sd = float(np.std(each, ddof=1)) if len(each) > 1 else math.nan
                group.append({"measure": title, "condition": name, "participants": len(each),
                              "mean": float(np.mean(each)), "sd": sd})  # fmt: skip
        means.append(group)
        group = []
        for a, b in itertools.combinations(conditions, 2):
            ours, others = values[a], values[b]  # compared in the tasks that both have
            both = {key: others[key] - ours[key] for key in ours if key in others}
            off = np.array(_means_of(both))
            if len(off):
                median, low, high = median_interval(off)
                group.append({"measure": title, "pair": f"{b} - {a}", "participants": len(off),
                              "median": median, "low": low, "high": high,
                              "p": wilcoxon_p(off)})  # fmt: skip
        for row, p in zip(group, holm([float(row["p"]) for row in group]), strict=True):
            row["p_holm"] = p
        tests.append(group)
    what = "Drives" if source == "drive" else source
    columns = columns_of("differences")
    return [make_table(f"{what}: conditions", columns_of("conditions"), means),
            make_table(f"{what}: differences within participants", columns, tests)]  # fmt: skip


def tables(protocol: Protocol, rows: Sequence[Record]) -> list[Table]:
    """Two tables for the drives and for each questionnaire of the rows of `export.tidy`.

    The first has the mean of each condition over participants, the second paired differences with
    Wilcoxon's signed-rank test. Time and length count where the drive succeeded.
    """
    conditions = [condition.name for condition in protocol.conditions]
    made: list[Table] = []
    for source in dict.fromkeys(row["source"] for row in rows):
        found = [row for row in rows if row["source"] == source]
        if found[0]["condition"]:
            made += _tables(found, source, conditions)
        else:  # asked once, at the end of the experiment
            found = [row | {"condition": "all"} for row in found]
            made += _tables(found, source, ["all"])[:1]
    return made


def write_report(folder: str | Path, bom: bool = False) -> tuple[list[Table], Path]:
    """Write report.html and the tables of `export` into the folder of an experiment.

    Args:
        folder: of the experiment.
        bom: as in `export`.

    Returns:
        The tables, and the path of the page.

    Raises:
        InputError: it is no such folder, or nobody has done anything yet.
    """
    protocol, people = read_folder(folder)
    if not people:
        raise InputError(f"{folder}: has no participants yet")
    made = tables(protocol, export(Path(folder), protocol, people, bom))
    page = write_page(
        Path(folder) / PAGE, "participants.html", title=protocol.title, tables=made,
        people=len(people), complete=sum(one.state == State.FINISHED for one in people), data=DATA,
        source={"command": f"wheelchair report {folder}", "provenance": provenance()},
    )  # fmt: skip
    return made, page
