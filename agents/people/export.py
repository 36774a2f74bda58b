"""Tables of an experiment for other programs: long, wide, attempts, and their dictionary."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from agents import read_data
from agents.evaluation.provenance import write_text
from agents.evaluation.report import COLUMN_OF
from agents.evaluation.tables import Column, csv_table
from agents.people.chain import Record
from agents.people.folder import ATTEMPTS, DATA, DICTIONARY, WIDE
from agents.people.protocol import NASA_TLX, Protocol
from agents.people.session import Progress

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
            if record.get("practice") or not (values := _values(record)):
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


def _values(record: Record) -> Record:
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
        bom: begin each file with a byte-order mark, by which some programs recognize UTF-8.

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
