"""Conditions compared within participants, and groups between them: tables and a page."""

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
from agents.evaluation.statistics import (
    effect_size,
    estimate,
    holm,
    mann_whitney_p,
    median_interval,
    wilcoxon_p,
)
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
    most, pairs = 0, 0
    means: list[list[Record]] = []
    tests: list[list[Record]] = []
    periods: list[list[Record]] = []
    for measure, title in _measures(rows).items():
        values = _values(rows, measure, conditions)
        means.append(_means(title, {name: _means_of(of) for name, of in values.items()}))
        group: list[Record] = []
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
        pairs = max(pairs, len(group))
        tests.append(_adjusted(group))
        periods.append(_periods([row for row in rows if row["measure"] == measure], title))
    note = _too_few(f"{most}, Wilcoxon's", pairs, 2.0 ** (1 - most))
    return [
        _table(rows, "conditions", means),
        _table(rows, "differences within participants", tests)._replace(note=note),
        _table(rows, "effects of periods and orders", periods),
    ]


def _groups(rows: Sequence[Record], conditions: list[str], groups: list[str]) -> list[Table]:
    """Means by group, and differences of pairs of groups; the rows are of one source.

    A participant counts with the mean over conditions and tasks. Differences of means have Welch's
    interval, and p is of Mann and Whitney's test.
    """
    means: list[list[Record]] = []
    tests: list[list[Record]] = []
    smallest, sizes, pairs = math.inf, "", 0
    for measure, title in _measures(rows).items():
        samples = {}
        for name in groups:
            found = _values([row for row in rows if row["group"] == name], measure, conditions)
            samples[name] = _means_of({
                (who, f"{condition}/{task}"): value
                for condition, of in found.items() for (who, task), value in of.items()
            })  # fmt: skip
        means.append(_means(title, samples))
        group: list[Record] = []
        for a, b in itertools.combinations([name for name in groups if samples[name]], 2):
            ours, others = (np.array(list(samples[name].values())) for name in (a, b))
            low, high = estimate([{"": others}, {"": ours}], [1.0, -1.0]).interval
            n, m = len(ours), len(others)
            group.append({"measure": title, "pair": f"{b} - {a}", "participants": n + m,
                          "difference": float(others.mean() - ours.mean()), "low": low,
                          "high": high, "p": mann_whitney_p(others, ours)})  # fmt: skip
            if 2.0 / math.comb(n + m, n) < smallest:
                smallest, sizes = 2.0 / math.comb(n + m, n), f"{n} and {m}"
        pairs = max(pairs, len(group))
        tests.append(_adjusted(group))
    note = _too_few(f"{sizes}, Mann and Whitney's", pairs, smallest)
    return [
        _table(rows, "groups", means),
        _table(rows, "differences between groups", tests, "between")._replace(note=note),
    ]


def _table(rows: Sequence[Record], what: str, of: list[list[Record]], columns: str = "") -> Table:
    source = "Drives" if rows[0]["source"] == "drive" else rows[0]["source"]
    return make_table(f"{source}: {what}", columns_of(columns or what.split()[0]), of)


def _means(title: str, samples: Mapping[str, Mapping[int, float]]) -> list[Record]:
    """Rows of the mean and the standard deviation of each sample: by name, by participant."""
    found = []
    for name, of in samples.items():
        if each := list(of.values()):
            sd = float(np.std(each, ddof=1)) if len(each) > 1 else math.nan
            found.append({"measure": title, "name": name, "participants": len(each),
                          "mean": float(np.mean(each)), "sd": sd})  # fmt: skip
    return found


def _adjusted(rows: list[Record]) -> list[Record]:
    """The rows of all pairs of one measure with Holm's adjusted p."""
    adjusted = holm([float(row["p"]) for row in rows])
    return [row | {"p_holm": p} for row, p in zip(rows, adjusted, strict=True)]


def _too_few(who: str, pairs: int, smallest: float) -> str:
    """A warning where the smallest p that one test can give is not small for all; else empty."""
    if pairs == 0 or pairs * smallest < LEVEL:
        return ""
    return (
        f"Warning: with n = {who} test of {pairs} pairs cannot give an adjusted p below "
        f"{min(1.0, pairs * smallest):.2g}: no difference can be significant at {LEVEL:g}."
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
    """Tables for the drives and for each questionnaire of the rows of `export.tidy`.

    The first has the mean of each condition over participants, the second paired differences with
    Wilcoxon's signed-rank test, the third effects of periods and orders; two more compare groups,
    where there are any. Time and length count where the drive succeeded.
    """
    conditions = [condition.name for condition in protocol.conditions]
    groups = [group.name for group in protocol.groups]
    made: list[Table] = []
    for source in dict.fromkeys(row["source"] for row in rows):
        found = [row for row in rows if row["source"] == source]
        if found[0]["condition"]:
            made += _tables(found, conditions)
        else:  # asked once, at the end of the experiment
            found = [row | {"condition": "all"} for row in found]
            made += _tables(found, ["all"])[:1]
        made += _groups(found, [*conditions, "all"], groups) if groups else []
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
