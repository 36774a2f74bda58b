"""Conditions of an experiment compared within participants: tables, a page and tidy data."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import scipy  # which loads scipy.stats when it is used

from agents.evaluation.assisted import MEASURES
from agents.evaluation.metrics import Record
from agents.evaluation.plots import paired
from agents.evaluation.provenance import provenance
from agents.evaluation.report import COLUMN_OF, LEVEL
from agents.evaluation.statistics import effect_size, holm, median_interval, wilcoxon_p
from agents.evaluation.tables import Table, columns_of, make_table, write_page
from agents.people.export import TOTAL, export
from agents.people.folder import DATA, PAGE
from agents.people.protocol import NASA_TLX, Protocol
from agents.people.session import State, read_folder
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


def _means_of(values: Mapping[tuple[int, str], float]) -> dict[int, float]:
    """The mean over tasks of each participant."""
    people = sorted({person for person, _ in values})
    return {p: float(np.mean([v for (who, _), v in values.items() if who == p])) for p in people}


def _measures(rows: Sequence[Record]) -> dict[str, str]:
    """Title of each measure of rows of one source, with its unit, by name."""
    units = {row["measure"]: row["unit"] for row in rows}
    names = _NAME.values() if rows[0]["source"] == "drive" else units
    return {name: f"{name} [{units[name]}]" if units[name] else name
            for name in names if name in units}  # fmt: skip


def _tables(rows: Sequence[Record], conditions: list[str]) -> list[Table]:
    """Means by condition, differences of pairs of conditions, and effects of periods and orders.

    The rows are of one source.
    """
    source, most = rows[0]["source"], 0
    means: list[list[Record]] = []
    tests: list[list[Record]] = []
    periods: list[list[Record]] = []
    for measure, title in _measures(rows).items():
        values = _values(rows, measure, conditions)
        group: list[Record] = []
        for name in conditions:
            each = list(_means_of(values[name]).values())
            if each:
                sd = float(np.std(each, ddof=1)) if len(each) > 1 else math.nan
                group.append({"measure": title, "condition": name, "participants": len(each),
                              "mean": float(np.mean(each)), "sd": sd})  # fmt: skip
        means.append(group)
        group = []
        for a, b in itertools.combinations(conditions, 2):
            ours, others = values[a], values[b]  # compared in the tasks that both have
            both = {key: others[key] - ours[key] for key in ours if key in others}
            off = np.array(list(_means_of(both).values()))
            if len(off):
                median, low, high = median_interval(off)
                most = max(most, len(off))
                group.append({"measure": title, "pair": f"{b} - {a}", "participants": len(off),
                              "median": median, "low": low, "high": high, **effect_size(off),
                              "p": wilcoxon_p(off)})  # fmt: skip
        for row, p in zip(group, holm([float(row["p"]) for row in group]), strict=True):
            row["p_holm"] = p
        tests.append(group)
        periods.append(_periods([row for row in rows if row["measure"] == measure], title))
    what = "Drives" if source == "drive" else source
    pairs = len(conditions) * (len(conditions) - 1) // 2
    named = (("conditions", means), ("differences within participants", tests),
             ("effects of periods and orders", periods))  # fmt: skip
    made = [make_table(f"{what}: {name}", columns_of(name.split()[0]), of) for name, of in named]
    made[1] = made[1]._replace(note=_too_few(most, pairs))
    return made


def _too_few(n: int, pairs: int) -> str:
    """A warning where the smallest p that n participants can give is not small; else empty."""
    smallest = min(1.0, pairs * 2.0 ** (1 - n))
    if n == 0 or smallest < LEVEL:
        return ""
    return (
        f"Warning: with n = {n}, Wilcoxon's test of {pairs} pairs cannot give an adjusted p below "
        f"{smallest:.2g}: no difference can be significant at {LEVEL:g}."
    )


def _periods(rows: Sequence[Record], title: str) -> list[Record]:
    """Whether a measure changes with the period (position), and with the order of conditions.

    Periods are compared within participants who have all (Friedman; of two, Wilcoxon), orders
    between participants (Kruskal and Wallis).
    """
    found: dict[int, dict[int, list[Record]]] = {}  # by participant: by position
    for row in rows:
        found.setdefault(row["participant"], {}).setdefault(row["position"], []).append(row)
    last = max(max(of) for of in found.values())
    whole = [of for of in found.values() if len(of) == last]
    if last < 2 or len(whole) < 2:
        return []
    each = np.array(
        [[np.mean([row["value"] for row in of[k]]) for k in sorted(of)] for of in whole]
    )
    orders: dict[tuple[str, ...], list[float]] = {}
    for of, values in zip(whole, each, strict=True):
        order = tuple(of[k][0]["condition"] for k in sorted(of))
        orders.setdefault(order, []).append(float(values.mean()))
    samples, many = list(orders.values()), last > 2 and np.ptp(each, axis=1).any()
    return [{
        "measure": title, "participants": len(each), "first": float(each[:, 0].mean()),
        "last": float(each[:, -1].mean()),
        "p_period": float(scipy.stats.friedmanchisquare(*each.T).pvalue) if many
        else wilcoxon_p(each[:, -1] - each[:, 0]),
        "orders": len(samples),
        "p_order": math.nan if len(samples) < 2 or not np.ptp(each.mean(axis=1))
        else float(scipy.stats.kruskal(*samples).pvalue),
    }]  # fmt: skip


def tables(protocol: Protocol, rows: Sequence[Record]) -> list[Table]:
    """Three tables for the drives and for each questionnaire of the rows of `export.tidy`.

    The first has the mean of each condition over participants, the second paired differences with
    Wilcoxon's signed-rank test, the third effects of periods and orders. Time and length count
    where the drive succeeded.
    """
    conditions = [condition.name for condition in protocol.conditions]
    made: list[Table] = []
    for source in dict.fromkeys(row["source"] for row in rows):
        found = [row for row in rows if row["source"] == source]
        if found[0]["condition"]:
            made += _tables(found, conditions)
        else:  # asked once, at the end of the experiment
            made += _tables([row | {"condition": "all"} for row in found], ["all"])[:1]
    return made


def _figures(protocol: Protocol, rows: Sequence[Record]) -> dict[str, tuple[str, bytes]]:
    """Captions and pictures of the participants' values of the main measures."""
    names = [condition.name for condition in protocol.conditions]
    drawn = {}
    for source, kept in (("drive", [*_NAME.values()][:5]), (NASA_TLX, [TOTAL])):
        found = [row for row in rows if row["source"] == source]
        for measure, title in _measures(found).items() if found else ():
            if measure in kept:
                values = _values(found, measure, names)
                each = {name: _means_of(of) for name, of in values.items()}
                drawn[f"{source} {measure}"] = (
                    f"{title}: each participant's mean over the tasks, a line each.",
                    paired(title, each),
                )
    return drawn


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
    rows = export(Path(folder), protocol, people, bom)
    made = tables(protocol, rows)
    page = write_page(
        Path(folder) / PAGE, "participants.html", title=protocol.title, tables=made,
        people=len(people), complete=sum(one.state == State.FINISHED for one in people), data=DATA,
        figures=_figures(protocol, rows),
        source={"command": f"wheelchair report {folder}", "provenance": provenance()},
    )  # fmt: skip
    return made, page
