"""Session of a participant: the steps of a protocol, each one or more records of a chain.

`Session` writes the records, and `Progress` reads from them how far a participant is. Participants
have numbers and no names. No record is written again: after an interruption, a participant goes on
with the first step that is not done. Every attempt at a drive is kept.
"""

import re
import threading
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from enum import StrEnum
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any, Final

from agents.evaluation.provenance import commit, now
from agents.evaluation.tables import exists
from agents.people import folder as stored
from agents.people.folder import Record
from agents.people.protocol import Protocol, Step
from wheelchair_gym.base.errors import shorten
from wheelchair_gym.base.settings import InputError

GIVEN_UP, CUT_OFF, ABORTED = "given_up", "cut_off", "aborted"  # outcomes beside `outcome_of`'s
_INTERRUPTED: Final = (CUT_OFF, ABORTED)  # not by the participant: the drive is still due


class State(StrEnum):
    """State of a participant's session."""

    NEW = "not begun"
    UNDER_WAY = "under way"
    PAUSED = "paused"
    FINISHED = "finished"
    STOPPED = "stopped by a rule"
    WITHDRAWN = "withdrawn"


OVER: Final = (State.FINISHED, State.STOPPED, State.WITHDRAWN)


class Progress:
    """Progress of a participant, by the records of their chain.

    Attributes:
        state: of the session.
        done: the record that completed each step, by its key.
        attempts: every drive that was begun: its record `started`, and from its end `outcome`,
            `end`, `figures` and whether it `counts`.
        last: time of the last record, as text; empty without any.
    """

    def __init__(self, protocol: Protocol, participant: int, records: Sequence[Record]) -> None:
        self.protocol, self.participant = protocol, participant
        self.steps = list(protocol.steps(participant))
        self.state, self.last = State.NEW, ""
        self.done: dict[str, Record] = {}
        self.attempts: list[Record] = []
        self.remarks: list[Record] = []  # notes and adverse events
        self.records = len(records)
        self._software: Record = {}
        for record in records:
            self.take(record)

    def take(self, record: Record) -> None:
        """Take the next record."""
        kind, self.last = record["kind"], record["at"]
        if kind == "opened":
            self._software = {key: record[key] for key in ("version", "commit", "protocol")}
        elif kind in ("consent", "answers"):
            self.done[record["key"]] = record
        elif kind == "started":
            begun = {"start": record["at"], "outcome": "", "counts": False}
            self.attempts.append(record | self._software | begun)
        elif kind == "ended":
            self._end(record)
        elif kind in ("note", "adverse_event"):
            self.remarks.append(record)
        states = {
            "consent": State.UNDER_WAY, "paused": State.PAUSED, "resumed": State.UNDER_WAY,
            "stopped": State.STOPPED, "withdrawn": State.WITHDRAWN,
        }  # fmt: skip
        if self.state not in OVER:
            self.state = states.get(kind, self.state)
            if all(step.key in self.done for step in self.steps):
                self.state = State.FINISHED

    def _end(self, record: Record) -> None:
        attempt, key, outcome = self.attempts[-1], record["key"], record["outcome"]
        attempt |= {"end": record["end"], "outcome": outcome, "figures": record["figures"]}
        mine = [one["outcome"] for one in self.attempts if one["key"] == key]
        tries = sum(one not in _INTERRUPTED for one in mine)
        protocol = self.protocol
        if attempt["practice"]:
            met = protocol.practice_until == "driven" or outcome == "success"
            over = (met and outcome != GIVEN_UP) or tries >= protocol.practice_tries
        else:
            over = outcome != GIVEN_UP or tries >= protocol.tries
        attempt["counts"] = over and outcome not in _INTERRUPTED
        if attempt["counts"]:
            self.done[key] = attempt

    def row(self) -> Record:
        """Return the progress as a row of a table."""
        return {
            "participant": self.participant,
            "group": self.protocol.group_of(self.participant).name,
            "state": self.state.value, "done": len(self.done), "steps": len(self.steps),
            "attempts": len(self.attempts), "remarks": len(self.remarks), "last": self.last,
        }  # fmt: skip

    def next(self) -> Step | None:
        """Return the first step that is not done; None where the session is over."""
        if self.state in OVER:
            return None
        return next((step for step in self.steps if step.key not in self.done), None)

    def rule(self) -> str:
        """Return the stop rule that the drives so far fulfil; empty: none."""
        contacts = sum(one["outcome"] == "collision" for one in self.attempts)
        seconds = sum(one.get("figures", {}).get("time") or 0.0 for one in self.attempts)
        limits = {"max_contacts": contacts, "max_minutes": seconds / 60.0}
        reached = (name for name, n in limits.items() if 0 < getattr(self.protocol, name) <= n)
        return next(reached, "")


def progress_of(folder: Path, protocol: Protocol, participant: int) -> Progress:
    """Read how far a participant is.

    Raises:
        InputError: the number is none or was deleted, or the records are damaged.
    """
    path = stored.folder_of(folder, participant) / stored.STEPS
    records = stored.read_chain(path)[0] if path.exists() else []
    return Progress(protocol, participant, records)


def read_folder(folder: str | Path) -> tuple[Protocol, list[Progress]]:
    """Read the protocol of an experiment and the records of all its participants.

    Raises:
        InputError: it is no folder of an experiment, or a file in it is damaged.
    """
    people, faults = read_people(Path(folder))
    if faults:
        raise faults[0]
    return stored.current_protocol(Path(folder)), people


def read_people(folder: Path) -> tuple[list[Progress], list[InputError]]:
    """Read the records of all participants; also return why those of others cannot be read."""
    try:
        protocol = stored.current_protocol(folder)
    except InputError as fault:
        return [], [fault]
    people, faults = [], []
    # A folder that cannot be read is an error; a pattern for what is in it would leave it out.
    for path in sorted(folder.glob(f"participant_{4 * '[0-9]'}")):
        try:
            if (path / stored.STEPS).exists():
                people.append(progress_of(folder, protocol, int(path.name[-4:])))
        except InputError as fault:
            faults.append(fault)
    return [one for one in people if one.last], faults


class Session:
    """One participant's session in the folder of an experiment, open to go on.

    Args:
        folder: of the experiment; made if missing.
        protocol: the experiment.
        participant: a number from 1.

    Raises:
        InputError: the folder belongs to another protocol, the number is none or was deleted, the
            session is open elsewhere, or its records are damaged.
    """

    def __init__(self, folder: str | Path, protocol: Protocol, participant: int) -> None:
        digest = stored.claim(Path(folder), protocol)
        self.protocol, self.participant = protocol, participant
        self.folder = stored.folder_of(Path(folder), participant)
        self._unsaved: dict[str, Any] = {}
        self._opening = {
            "participant": participant, "group": protocol.group_of(participant).name,
            "protocol": digest,
            "seed": protocol.seed, "version": version("wheelchair_gym"), "commit": _commit(),
        }  # fmt: skip
        self._lock = threading.RLock()  # the experimenter's remarks come from another thread
        self._chain = stored.Chain(self.folder / stored.STEPS)
        try:
            stored.folder_of(Path(folder), participant)  # it may have been deleted meanwhile
            self.progress = Progress(protocol, participant, self._chain.read())
            if self.progress.last:
                self._append("opened", self._opening)
                self._cut_off()  # the program ended in mid-drive
                self._check_rule()  # or before it stopped the session
        except BaseException:
            self._chain.close(empty=not self._chain.path.stat().st_size)
            raise

    def close(self) -> None:
        """Write what is left, and release the lock; a number that was only typed leaves nothing."""
        with suppress(InputError):
            self.save()
        self._chain.close(empty=not self.progress.last)

    def next(self) -> Step | None:
        """Return the first step that is not done; None where the session is over."""
        return self.progress.next()

    def mark(self, kind: str, /, **content: Any) -> None:
        """Record an event: paused, resumed, withdrawn, note or adverse_event, these with a text."""
        if not self.progress.last:
            self._append("opened", self._opening)
        if self.progress.state == State.PAUSED and kind in ("started", "answers"):
            self._append("resumed", {})  # a step ends a pause
        self._append(kind, content)

    def _append(self, kind: str, content: Mapping[str, Any]) -> None:
        with self._lock:
            self.save()
            self.progress.take(self._chain.append(kind, **content))

    def save(self) -> bool:
        """Write what could not be written when a drive ended; return whether there was anything.

        Raises:
            InputError: it still cannot be written.
        """
        with self._lock:
            if saved := bool(self._unsaved):
                self.progress.take(self._chain.append("ended", **self._unsaved))
                self._unsaved = {}
            return self._check_rule() or saved

    def _check_rule(self) -> bool:
        """Stop the session where a rule says so, and return whether one does."""
        if self.progress.state in OVER or not (rule := self.progress.rule()):
            return False
        self.progress.take(self._chain.append("stopped", rule=rule))
        return True

    def _cut_off(self) -> None:
        """End a drive that has begun, and whose end nobody has recorded."""
        self.save()
        if self.progress.attempts and not self.progress.attempts[-1]["outcome"]:
            self.end(CUT_OFF, {})

    def due(self, kind: str, step: Step | None = None) -> Step:
        """Return the step that is due.

        Raises:
            InputError: it is of another kind, or another step.
        """
        due = self.next()
        if due is None or due.kind != kind or (step is not None and step != due):
            now = "the session is over" if due is None else f"{due.key} is next"
            raise InputError(f"{kind if step is None else step.key}: {now}")
        return due

    def recording(self, step: Step) -> Path:
        """Return a new file for the recording of a drive; earlier ones are kept."""
        number = self.progress.steps.index(step) + 1
        name = f"{number:03d}_{re.sub(r'[^A-Za-z0-9]+', '_', step.key)[:60]}"
        tries = (self.folder / f"{name}_{k}.mcap" for k in range(1, 10_000))
        return next(path for path in tries if not path.exists())

    def world(self, step: Step) -> int:
        """Return the seed of the world of the next attempt at a drive."""
        return self.protocol.world(self.participant, step, self._attempts(step) + 1)

    def _attempts(self, step: Step) -> int:
        return sum(one["key"] == step.key for one in self.progress.attempts)

    def consent(self) -> None:
        """Record that the participant agrees to the protocol's text."""
        self.mark("consent", **self.due("consent")._asdict())

    def start(
        self, recording: str = "", device: str = "", scan_period: float | None = None
    ) -> None:
        """Record that the drive which is due has begun.

        Args:
            recording: the file's name.
            device: that the participant uses, one of the protocol's.
            scan_period: of a single switch [s].
        """
        step = self.due("drive")
        self._cut_off()
        self.due("drive", step)
        by = {"device": device, "scan_period": scan_period, "recording": recording}
        attempt = {"attempt": self._attempts(step) + 1, "world": self.world(step)}
        self.mark("started", **step._asdict() | attempt | by)

    def end(self, outcome: str, figures: Mapping[str, Any]) -> None:
        """Record how the drive that has begun ended, and stop the session where a rule says so.

        Args:
            outcome: one of `agents.evaluation.metrics.outcome_of`, GIVEN_UP, CUT_OFF or ABORTED.
            figures: its numbers, named as `wheelchair compare` does.

        Raises:
            InputError: it cannot be written; the next record writes it first.
        """
        numbers = {
            key: value if exists(value) else None
            for key, value in figures.items()
            if value is None or isinstance(value, bool | int | float)
        }
        key = self.progress.attempts[-1]["key"]
        self._unsaved = {"key": key, "end": now(), "outcome": outcome, "figures": numbers}
        self.save()

    def drive(self, step: Step, drive: Callable[[int], Mapping[str, Any]]) -> None:
        """Make the drive that is due: from the seed of its world to figures with an outcome."""
        self.due("drive", step)
        world = self.world(step)
        self.start()
        figures = drive(world)
        self.end(figures["outcome"], figures)

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
        answers = dict(zip(names, map(int, values), strict=True))
        self.mark("answers", **self.due("answers", step)._asdict() | {"answers": answers})


_commit = cache(commit)
