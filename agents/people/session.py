"""Record of a participant's session in a folder: one line a step, and recordings of the drives.

A folder belongs to one protocol. Participants have numbers and no names. A line is never written
again: after an interruption, a participant goes on with the first step that is missing.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from agents.evaluation.metrics import Record
from agents.evaluation.provenance import write_json
from agents.evaluation.runs import open_store, read_store, stored_line
from agents.evaluation.tables import exists
from agents.people.protocol import Protocol, Step
from wheelchair_gym.base.errors import shorten
from wheelchair_gym.base.settings import InputError, dump, load, read_json

PROTOCOL = "protocol.json"
STEPS = "steps.jsonl"
DATA = "data.csv"
COLUMNS = (
    "participant", "position", "condition", "task", "device", "scan_period", "source", "measure",
    "value",
)  # fmt: skip
LARGEST = 9999  # number of a participant


class Session:
    """One participant's session in the folder of an experiment.

    Args:
        folder: of the experiment; made if missing.
        protocol: the experiment.
        participant: a number from 1.

    Raises:
        InputError: the folder belongs to another protocol, or the number is none.
    """

    def __init__(self, folder: str | Path, protocol: Protocol, participant: int) -> None:
        if not 1 <= participant <= LARGEST:
            raise InputError(f"participant {participant}: expected a number from 1 to {LARGEST}")
        self.protocol, self.participant = protocol, participant
        claim(Path(folder), protocol)
        self.folder = Path(folder) / f"participant_{participant:04d}"
        self._done = read_store(self.folder / STEPS)

    def next(self) -> Step | None:
        """Return the first step that is not done; None at the end."""
        steps = self.protocol.steps(self.participant)
        return next((step for step in steps if step.key not in self._done), None)

    def recording(self, step: Step) -> Path:
        """Return a new file for the recording of a drive; earlier tries are kept."""
        names = {"/": "__", " ": "_"}
        name = "".join(names.get(letter, letter) for letter in step.key)
        tries = (self.folder / f"{name}_{number}.mcap" for number in range(1, LARGEST))
        return next(path for path in tries if not path.exists())

    def consent(self) -> None:
        """Record that the participant agrees to the protocol's text."""
        self._finish("consent", {"agreed": True})

    def drive(
        self, step: Step, figures: Mapping[str, Any], recording: str = "", device: str = "",
        scan_period: float | None = None,
    ) -> None:  # fmt: skip
        """Record that a drive is over.

        Args:
            step: which drive.
            figures: its numbers, named as `wheelchair compare` does.
            recording: the file's name.
            device: that the participant used, one of the protocol's.
            scan_period: of a single switch [s].
        """
        numbers = {
            key: value if exists(value) else None
            for key, value in figures.items()
            if value is None or isinstance(value, bool | int | float)
        }
        by = {"device": device, "scan_period": scan_period}
        self._finish("drive", {"figures": numbers, "recording": recording, **by}, step)

    def answer(self, step: Step, values: Sequence[Any]) -> None:
        """Record the answers to a questionnaire, a number for each item.

        Raises:
            InputError: one is missing, or is not on the scale.
        """
        items = self.protocol.items(step.questionnaire)
        if len(values) != len(items):
            raise InputError(f"{step.questionnaire}: {len(values)} answers; expected {len(items)}")
        for item, value in zip(items, values, strict=True):
            if isinstance(value, bool) or value not in item.values:
                ends = f"{item.values[0]} to {item.values[-1]} in steps of {item.values.step}"
                where = f"{step.questionnaire}, {item.name}"
                raise InputError(f"{where}: {shorten(value)}; expected {ends}")
        names = [item.name for item in items]
        self._finish("answers", {"answers": dict(zip(names, map(int, values), strict=True))}, step)

    def _finish(self, kind: str, record: Record, step: Step | None = None) -> None:
        due = self.next()
        if due is None or due.kind != kind or (step is not None and step != due):
            now = "the session is over" if due is None else f"{due.key} is next"
            raise InputError(f"{kind if step is None else step.key}: {now}")
        record = {
            "participant": self.participant, "at": datetime.now(UTC).isoformat("T", "seconds"),
            **due._asdict(), **record,
        }  # fmt: skip
        with open_store(self.folder / STEPS) as store:
            store.write(stored_line(due.key, record).encode())
        self._done[due.key] = record


def read_protocol(path: str | Path) -> Protocol:
    """Read the protocol of a file.

    Raises:
        InputError: the file cannot be read, or a setting in it is wrong.
    """
    return load(Protocol, read_json(path), Path(path).name)


def claim(folder: Path, protocol: Protocol) -> None:
    """Write the protocol to its folder, once.

    Raises:
        InputError: the folder belongs to another protocol.
    """
    path = folder / PROTOCOL
    if path.exists():
        if read_protocol(path) != protocol:
            raise InputError(
                f"{folder} holds data of another protocol, {path}; expected that one, or another "
                "folder (--out)"
            )
    else:
        write_json(path, dump(protocol))


def read_folder(folder: str | Path) -> tuple[Protocol, list[Record]]:
    """Read the protocol of an experiment and the steps of all its participants.

    Raises:
        InputError: it is no folder of an experiment, or a file in it is damaged.
    """
    folder = Path(folder)
    if not (folder / PROTOCOL).exists():
        raise InputError(f"{folder}: no folder of an experiment; expected {PROTOCOL} in it")
    protocol = read_protocol(folder / PROTOCOL)
    stores = sorted(folder.glob(f"participant_*/{STEPS}"))
    return protocol, [record for path in stores for record in read_store(path).values()]


def tidy(records: Sequence[Record]) -> list[Record]:
    """Return a row for each measure of each step that counts: long form, columns `COLUMNS`."""
    rows = []
    for record in records:
        if record["practice"]:
            continue
        same = {key: record[key] for key in ("participant", "position", "condition", "task")}
        same |= {key: record.get(key) for key in ("device", "scan_period")}  # of drives
        values: Record = record.get("figures") or record.get("answers") or {}
        source = record["questionnaire"] or "drive"
        for measure, value in values.items():
            if isinstance(value, bool | int | float):
                rows.append(same | {"source": source, "measure": measure, "value": float(value)})
    return rows
