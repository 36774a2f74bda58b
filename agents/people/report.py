"""Report of an experiment: tables for other programs, and conditions and groups that are compared.

The tables are long, wide, attempts, and their dictionary. Conditions are compared within
participants, groups between them.
"""

import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from operator import itemgetter
from pathlib import Path
from typing import Any

import numpy as np
import scipy  # which loads scipy.stats when it is used

from agents import read_data
from agents.evaluation import statistics
from agents.evaluation.assisted import MEASURES
from agents.evaluation.compare import COLUMN_OF, LEVEL
from agents.evaluation.metrics import Record
from agents.evaluation.plots import paired
from agents.evaluation.provenance import provenance, write_text
from agents.evaluation.tables import Column, Table, columns_of, csv_table, make_table, write_page
from agents.people.folder import ATTEMPTS, DATA, DICTIONARY, PAGE, WIDE
from agents.people.protocol import NASA_TLX, Protocol
from agents.people.session import Progress, State, read_folder
from wheelchair_gym.base.settings import InputError

TOTAL = "total"  # of NASA-TLX: the mean of its scales
_DEFINED = read_data("tables.yaml")["participants"]  # by table: column: unit and definition
COLUMNS = tuple(_DEFINED["long"])


def measures_of(protocol: Protocol, source: str) -> dict[str, Column]:
    """Return the measures of `drive` or of a questionnaire, by their keys in the records."""
    if source == "drive":
        return COLUMN_OF
    tlx = source == NASA_TLX
    found = {
        item.name: Column(
            item.name, item.name if tlx else item.text,
            meaning=f"{item.values[0]}: {item.low.removeprefix('tlx_')}, "
            f"{item.values[-1]}: {item.high.removeprefix('tlx_')}",
        )
        for item in protocol.items(source)
    }  # fmt: skip
    return found | ({TOTAL: Column(TOTAL, TOTAL, meaning="mean of the six scales")} if tlx else {})


def tidy(people: Sequence[Progress]) -> list[Record]:
    """Return a row for each measure of each step that counts: long form, columns `COLUMNS`."""
    rows = []
    for one in people:
        for record in one.done.values():
            if record.get("practice") or not (values := _numbers(record)):
                continue
            source = record["questionnaire"] or "drive"
            tried = [other for other in one.attempts if other["key"] == record["key"]]
            same = {key: record.get(key) for key in COLUMNS} | {
                "participant": one.participant,
                "group": one.protocol.group_of(one.participant).name,
                "attempts": len(tried) or None, "source": source,
            }  # fmt: skip
            for key, column in measures_of(one.protocol, source).items():
                if isinstance(values.get(key), bool | int | float):
                    rows.append(same | {"measure": column.name, "unit": column.unit,
                                        "value": column.factor * values[key]})  # fmt: skip
    return rows


def _numbers(record: Record) -> Record:
    """The numbers of a finished step, and the mean of the scales of a NASA-TLX."""
    values: Record = record.get("figures") or record.get("answers") or {}
    if record.get("questionnaire") == NASA_TLX:
        return values | {TOTAL: float(np.mean(list(values.values())))}
    return values


def wide(people: Sequence[Progress], rows: Sequence[Record]) -> list[Record]:
    """Return a row for each participant: a column for each condition, task and measure."""
    found = []
    for one in people:
        who = one.participant
        order = " > ".join(condition.name for condition in one.protocol.conditions_of(who))
        values = {heading(row): row["value"] for row in rows if row["participant"] == who}
        found.append({"participant": who, "order": order, "state": one.state.value} | values)
    return found


def heading(row: Record) -> str:
    """Return the name of the column of a row of the long form in the wide form."""
    parts = (row["condition"], row["task"], row["source"], row["measure"])
    unit = f" [{row['unit']}]" if row["unit"] else ""
    return ": ".join(str(part) for part in parts if part and part != "drive") + unit


def export(folder: Path, protocol: Protocol, people: Sequence[Progress], bom: bool) -> list[Record]:
    """Write the tables of an experiment into its folder, and return the rows of the long form.

    Args:
        folder: of the experiment.
        protocol: the experiment.
        people: its participants.
        bom: begin each file with a byte-order mark, which tells some programs that it is UTF-8.

    Raises:
        InputError: a file cannot be written.
    """
    rows = tidy(people)
    attempts: list[Any] = [
        {"participant": one.participant} | attempt for one in people for attempt in one.attempts
    ]
    defined = [
        {"table": table, "name": name} | row
        for table, columns in _DEFINED.items() for name, row in columns.items()
    ]  # fmt: skip
    for source in dict.fromkeys(row["source"] for row in rows):
        present = {row["measure"] for row in rows if row["source"] == source}
        for column in measures_of(protocol, source).values():
            if column.name in present:
                defined.append({"table": source, "name": column.name, "unit": column.unit,
                                "definition": column.meaning})  # fmt: skip
    tables = {
        DATA: (rows, COLUMNS), WIDE: (wide(people, rows), ()),
        ATTEMPTS: (attempts, tuple(_DEFINED["attempts"])), DICTIONARY: (defined, ()),
    }  # fmt: skip
    for name, (content, columns) in tables.items():
        write_text(folder / name, "\ufeff" * bom + csv_table(content, columns))
    return rows


# Keys of the measures of drives in the tables, in order.
DRIVE_MEASURES = (
    "success", "time", "at_fault", "clearance_min", "length", "jerk_rms", *MEASURES,
)  # fmt: skip
_NAME = {key: COLUMN_OF[key].name for key in DRIVE_MEASURES}
ONLY_OF_SUCCESSES = (_NAME["time"], _NAME["length"])


Values = Mapping[tuple[int, str], float]  # by participant and task


def _counted(rows: Sequence[Record], measure: str) -> list[Record]:
    """Rows of a measure; time and length are of drives that succeeded."""
    drive = itemgetter("participant", "condition", "task")
    good = {drive(row) for row in rows if row["measure"] == _NAME["success"] and row["value"]}
    found = [row for row in rows if row["measure"] == measure]
    return [row for row in found if measure not in ONLY_OF_SUCCESSES or drive(row) in good]


def _values(rows: Sequence[Record], measure: str, conditions: list[str]) -> Mapping[str, Values]:
    """Values of a measure by condition."""
    found: dict[str, dict[tuple[int, str], float]] = {name: {} for name in conditions}
    for row in _counted(rows, measure):
        found[row["condition"]][row["participant"], row["task"]] = row["value"]
    return found


def _means_of(values: Values) -> dict[int, float]:
    """The mean over tasks of each participant."""
    people = sorted({person for person, _ in values})
    return {p: float(np.mean([v for (who, _), v in values.items() if who == p])) for p in people}


def _measures(rows: Sequence[Record]) -> dict[str, str]:
    """Title of each measure of rows of one source, with its unit, by name."""
    units = {row["measure"]: row["unit"] for row in rows}
    names = _NAME.values() if rows[0]["source"] == "drive" else units
    return {name: f"{name} [{units[name]}]" if units[name] else name
            for name in names if name in units}  # fmt: skip


def _within(ours: Values, others: Values) -> Record:
    """Compare two conditions in the tasks that both have: the participants' differences."""
    both = {key: others[key] - ours[key] for key in ours if key in others}
    off = np.array(list(_means_of(both).values()))
    if not len(off):
        return {}
    median, low, high = statistics.median_interval(off)
    return {
        "participants": len(off), "median": median, "low": low, "high": high,
        **statistics.effect_size(off), "p": statistics.wilcoxon_p(off),
        "min_p": 2.0 ** (1 - len(off)), "test": f"{len(off)}, Wilcoxon's",
    }  # fmt: skip


def _between(ours: Values, others: Values) -> Record:
    """Compare two groups of participants: the difference of their means."""
    x, y = (np.array(list(_means_of(of).values())) for of in (ours, others))
    if not len(x) or not len(y):
        return {}
    low, high = statistics.estimate([{"": y}, {"": x}], [1.0, -1.0]).interval
    return {
        "participants": len(x) + len(y), "difference": float(y.mean() - x.mean()), "low": low,
        "high": high, "p": float(scipy.stats.mannwhitneyu(y, x).pvalue),
        "min_p": 2.0 / math.comb(len(x) + len(y), len(x)),
        "test": f"{len(x)} and {len(y)}, Mann and Whitney's",
    }  # fmt: skip


def _compared(
    rows: Sequence[Record], names: list[str], compare: Callable[[Values, Values], Record]
) -> tuple[list[list[Record]], list[list[Record]]]:
    """Rows of means by condition (or group), and of comparisons of each two; both by measure."""
    means: list[list[Record]] = []
    tests: list[list[Record]] = []
    for measure, title in _measures(rows).items():
        values = _values(rows, measure, names)
        each = {name: list(_means_of(of).values()) for name, of in values.items()}
        means.append([
            {"measure": title, "name": name, "participants": len(of), "mean": float(np.mean(of)),
             "sd": float(np.std(of, ddof=1)) if len(of) > 1 else math.nan}
            for name, of in each.items() if of
        ])  # fmt: skip
        pairs = itertools.combinations(names, 2)
        group = [{"measure": title, "pair": f"{b} - {a}", **found}
                 for a, b in pairs if (found := compare(values[a], values[b]))]  # fmt: skip
        adjusted = statistics.holm([float(row["p"]) for row in group])
        tests.append([row | {"p_holm": p} for row, p in zip(group, adjusted, strict=True)])
    return means, tests


def _tables(rows: Sequence[Record], conditions: list[str], groups: list[str]) -> list[Table]:
    """The tables of rows of one source; see `tables`."""
    if not rows[0]["condition"]:  # asked once, at the end of the experiment
        rows = [row | {"condition": "all"} for row in rows]
        made = [("conditions", "conditions", _compared(rows, ["all"], _within)[0])]
    else:
        means, tests = _compared(rows, conditions, _within)
        periods = [_periods(_counted(rows, name), title)
                   for name, title in _measures(rows).items()]  # fmt: skip
        made = [("conditions", "conditions", means),
                ("differences", "differences within participants", tests),
                ("effects", "effects of periods and orders", periods)]  # fmt: skip
    if groups:
        rows = [row | {"condition": row["group"], "task": f"{row['condition']}/{row['task']}"}
                for row in rows]  # fmt: skip
        means, tests = _compared(rows, groups, _between)
        made += [("groups", "groups", means), ("between", "differences between groups", tests)]
    what = "Drives" if rows[0]["source"] == "drive" else rows[0]["source"]
    return [
        make_table(f"{what}: {name}", columns_of(columns), of)._replace(note=_too_few(of))
        for columns, name, of in made
    ]


def _too_few(groups: list[list[Record]]) -> str:
    """A warning where the smallest p that tests of pairs can give is not small; else empty."""
    rows = [row for group in groups for row in group if "min_p" in row]
    best = min(rows, key=lambda row: float(row["min_p"]), default=None)
    pairs = max(map(len, groups), default=0)
    if best is None or pairs * best["min_p"] < LEVEL:
        return ""
    return (
        f"Warning: with n = {best['test']} test of {pairs} pairs cannot give an adjusted p below "
        f"{min(1.0, pairs * best['min_p']):.2g}: no difference can be significant at {LEVEL:g}."
    )


def _periods(rows: Sequence[Record], title: str) -> list[Record]:
    """Whether a measure changes with the period (position), and with the order of conditions.

    Periods are compared within participants who have all (Friedman; of two, Wilcoxon), orders
    between participants (Kruskal and Wallis).
    """
    found: dict[int, dict[int, list[Record]]] = {}  # by participant: by position
    for row in rows:
        found.setdefault(row["participant"], {}).setdefault(row["position"], []).append(row)
    last = max((max(of) for of in found.values()), default=0)
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
        else statistics.wilcoxon_p(each[:, -1] - each[:, 0]),
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
        made += _tables(found, conditions, groups)
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
