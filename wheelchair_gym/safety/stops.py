"""Why a chair stops, how the stop ends, and what a person does to continue: one table.

    drive board, link, chair, shield ──▶ messages ──▶ StopMonitor ──▶ log lines, stopped time

The shield (its faults), the hardware chair, the log of a deployed policy and the documentation
(`python -m wheelchair_gym.safety.stops` prints it) read the table `STOPS`, which stands in
`stops.yaml`. `StopMonitor` tracks all active stops: a chair goes on when none is left.
"""

import enum
import re
from collections.abc import Iterable
from pathlib import Path
from typing import Any, Final, NamedTuple

import yaml


class Ends(enum.Enum):
    """The end of a stop."""

    ITSELF = "goes on by itself"
    PERSON = "goes on when the person returns control"
    REARM = "needs a re-arm by a person"
    NEW_RUN = "needs a re-arm by a person, and a new start of the program"


class Stop(NamedTuple):
    """A reason for which a chair is stopped."""

    name: str
    part: str  # that reports it
    message: str  # regular expression that matches its messages
    meaning: str
    ends: Ends
    advice: str  # what a person does, or what the chair waits for


BY_HAND: Final = "a person drives it by the joystick"
NOT_HELD: Final = "the person does not hold the dead-man switch"
OFF_CENTRE: Final = "the stick has not been at its centre"
NO_STICK: Final = "no stick is heard"
LATE: Final = "the assistant {} is late"
FAILED: Final = "the assistant {} has failed"
DRY_RUN: Final = "a dry run sends no commands"
BROUGHT_TO_REST: Final = "the drive board brings it to rest"
_SHIELD_MESSAGE = "the shield has stopped it: {}"


def _stop(
    name: str, part: str, meaning: str, advice: str, message: str = "", ends: str = ""
) -> Stop:
    """A row of the table; messages and ends of the shield and the drive board go without saying."""
    if part == "shield":
        message, ends = message or re.escape(_SHIELD_MESSAGE.format(name)), ends or "REARM"
    elif part == "drive board":
        message = message or rf"the drive board has stopped \([^)]*\b{name}\b"
        ends = ends or "NEW_RUN"
    return Stop(name, part, message, meaning, Ends[ends], advice)


_ROWS: Final = yaml.safe_load(Path(__file__).with_name("stops.yaml").read_text("utf-8"))
STOPS: Final = tuple(_stop(**row) for row in _ROWS)

SHIELD_FAULTS: Final = tuple(stop.name for stop in STOPS if stop.part == "shield")


def shield_message(fault: str) -> str:
    """The message of a fault that the shield has latched; empty for none."""
    return _SHIELD_MESSAGE.format(fault) if fault else ""


def matching_stops(message: str) -> list[Stop]:
    """The rows of the table that match a message: one, or one for each fault of a board."""
    found = [stop for stop in STOPS if re.match(stop.message, message)]
    faults = [stop for stop in found if stop.part == "drive board" and stop.name != "board fault"]
    return faults or found[:1]


def advice_for(message: str) -> str:
    """Return what a person can do about a message, as part of a sentence."""
    return "; ".join(dict.fromkeys(stop.advice for stop in matching_stops(message)))


def active_stops(halted: str, shield: Any) -> list[str]:
    """Messages of all stops that are active: of the chair (`Reading.halted`) and of its shield."""
    fault = "" if shield is None else shield_message(shield.latched)
    return [why for why in (halted, fault) if why]


class StopMonitor:
    """The stops that are active now, and for how long they have lasted.

    Attributes:
        messages: of active stops, by the text that rows match, which holds no details; empty: the
            chair drives.
        waited: seconds for which the chair has been stopped, manual driving left out.
    """

    def __init__(self) -> None:
        self.messages: dict[str, str] = {}
        self.waited, self._at = 0.0, 0.0

    def update(self, now: float, messages: Iterable[str]) -> list[str]:
        """Set the active messages at a time [s]; returns log lines of what changed.

        Empty messages are ignored. `goes on` is logged when no stop is left.
        """
        held = {_matched_text(message): message for message in messages if message}
        before, self.messages = self.messages, held
        new = [message for name, message in held.items() if name not in before]
        lines = [f"stands: {message}; {_sentence(message)}" for message in new]
        over = [message for name, message in before.items() if name not in held]
        if over and not held:
            lines = ["goes on"]
        elif over:
            lines += [f"no longer: {'; '.join(over)}; still stands: {self.why}"]
        hand = any(matching_stops(why)[0].ends is Ends.PERSON for why in held.values())
        if not held or hand:
            self.waited = 0.0
        elif before:
            self.waited += now - self._at
        self._at = now
        return lines

    @property
    def why(self) -> str:
        """All active messages as one line."""
        return "; ".join(self.messages.values())


def _matched_text(message: str) -> str:
    """Return the text of a message that its rows match, or a row's name if that matches any."""
    matches = ((re.match(stop.message, message), stop) for stop in matching_stops(message))
    return "; ".join((found and found.group()) or stop.name for found, stop in matches)


def _sentence(message: str) -> str:
    """Return the advice for a stop, and before it how the stop ends if it lasts until a re-arm."""
    stops, advice = matching_stops(message), advice_for(message)
    lasts = any(stop.ends in (Ends.REARM, Ends.NEW_RUN) for stop in stops)
    return f"{stops[0].ends.value}: {advice}" if lasts else advice


def as_table() -> str:
    """The table as Markdown."""
    head = "| stop | reported by | meaning | how it ends | what to do |"
    lines = [head, "| --- | --- | --- | --- | --- |"]
    lines += [
        f"| {stop.name} | {stop.part} | {stop.meaning} | {stop.ends.value} | {stop.advice} |"
        for stop in STOPS[:-1]
    ]
    return "\n".join(lines)


if __name__ == "__main__":
    print(as_table())
