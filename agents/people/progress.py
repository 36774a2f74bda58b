"""Progress of a participant through a protocol, by the records of their chain."""

from __future__ import annotations

from collections.abc import Sequence
from enum import StrEnum
from typing import Final

from agents.people.chain import Record
from agents.people.protocol import Protocol, Step

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
