"""Why a chair stops, how the stop ends, and what a person does to continue: one table.

    drive board, link, chair, shield ──▶ messages ──▶ StopMonitor ──▶ log lines, stopped time

The shield (its faults), the hardware chair, the log of a deployed policy and the documentation
(`python -m wheelchair_gym.safety.stops` prints it) read the table `STOPS`. `StopMonitor` tracks all
active stops: a chair goes on when none is left.
"""

from __future__ import annotations

import enum
import re
from collections.abc import Iterable
from typing import Any, Final, NamedTuple


class Ends(enum.Enum):
    """How a stop ends."""

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
_PLUG = "check its plug, its cable and its power"
_SHIELD_MESSAGE = "the shield has stopped it: {}"


def _shield(name: str, meaning: str, advice: str) -> Stop:
    return Stop(
        name, "shield", re.escape(_SHIELD_MESSAGE.format(name)), meaning, Ends.REARM, advice
    )


def _board(name: str, meaning: str, advice: str) -> Stop:
    message = rf"the drive board has stopped \([^)]*\b{name}\b"
    return Stop(name, "drive board", message, meaning, Ends.NEW_RUN, advice)


STOPS: Final = (
    _shield("laser silent", "most beams of the laser are invalid for too long", _PLUG),
    _shield("laser frozen", "the laser repeats a scan while the chair moves", "restart the laser"),
    _shield(
        "laser blind",
        "the laser has no echo where it had some before, or where ultrasonics have one",
        "clean and uncover its window; where nothing is within its reach, start the program again",
    ),
    _shield(
        "laser disagrees",
        "scans do not move as the wheels do: the laser is late, repeats itself, or was moved; or "
        "wheels slip, or an encoder is wrong",
        "check the laser's mount and link and the encoders: wheelchair hardware check",
    ),
    _shield(
        "ultrasonic silent", "an ultrasonic that worked before is silent", _PLUG
    ),
    _shield(
        "ultrasonic frozen", "the ultrasonics repeat themselves although the chair moves",
        "restart the range board",
    ),
    _shield(
        "ultrasonic deaf", "an ultrasonic has no echo of surfaces that the laser shows before it",
        "uncover it; check its plug and where it looks",
    ),
    _shield("odometry silent", "the speed of the wheels is unknown", _PLUG),
    _shield(
        "odometry frozen", "the encoders do not show the commanded motion",
        "check whether a wheel is blocked or slips; check the encoders",
    ),
    _shield("bumped", "a bumper strip is pressed", "free the chair"),
    _board("RESET", "the board was switched on, or restarted", "nothing needs repair"),
    _board("EMERGENCY_STOP", "the emergency stop was pressed", "release the emergency stop"),
    _board("LINK", "no command came for a second", "check the USB cable and the computer"),
    _board(
        "STALL", "a wheel is driven and does not turn, or its encoder is silent",
        "free the wheel; check the cables of its motor and its encoder",
    ),
    _board(
        "DIRECTION", "a wheel turns against its motor",
        "exchange the motor's two wires, or the encoder's A and B, never both",
    ),
    _board("ENCODER", "an encoder's steps are impossible", "check its cable and its shield"),
    _board("OVER_SPEED", "a wheel turned too fast", "check the slope, the drivers, the gains"),
    _board("UNDER_VOLTAGE", "the battery is empty", "charge the battery"),
    _board("DRIVER", "a motor driver reports a fault", "check the driver and its motor"),
    _board("STORE", "the board's memory is unreadable", "run wheelchair hardware setup"),
    _board("RUNAWAY", "a wheel turned although it should not", "check the drivers and the brakes"),
    _board("BRAKE", "the closed brakes slip", "check the brakes; do not park on a slope"),
    _board(
        "IMPLAUSIBLE", "the motors' voltage and the measured speed do not match",
        "check the encoders and their counts per metre, then the motors",
    ),
    _board("OVERRUN", "the board's control came too late", "check the encoders' cables for noise"),
    _board(
        "LEVER", "the freewheel lever was lifted while the chair was in operation",
        "close the freewheel lever; to push the chair, hold its push switch",
    ),
    _board("not armed", "the board is not armed yet", "close the freewheel lever if it is open"),
    Stop(
        "board fault", "drive board", r"the drive board has stopped \(",
        "the board has stopped for a fault", Ends.NEW_RUN, "check what it names",
    ),
    Stop(
        "drive board silent", "link", r"the drive board is silent",
        "no odometry came for too long; the board stops by itself", Ends.ITSELF,
        "check the USB cable; it waits until the board sends again",
    ),
    Stop(
        "range board silent", "link", r"the range board is silent", "no range came for too long",
        Ends.ITSELF, "check the USB cable; it waits until the board sends again",
    ),
    Stop(
        "laser line silent", "link", r"the laser is silent", "no scan came for too long",
        Ends.ITSELF, f"{_PLUG}; it waits until the laser sends again",
    ),
    Stop(
        "link late", "link", r"(the laser|the drive board|\S+) is late: ",
        "data are under way for too long", Ends.ITSELF,
        "check the network or cable and the load of the computers",
    ),
    Stop(
        "topic silent", "link", r"\S+ is silent", "no message of a topic came for too long",
        Ends.ITSELF, "check the node that publishes it; it waits for the next message",
    ),
    Stop(
        "pose unknown", "link", r"\S+ does not report where ",
        "transforms do not lead from the map to the chair", Ends.ITSELF,
        "check the localizer; it waits until the pose is known",
    ),
    Stop(
        "clock stands", "link", r"\S+ has (reported no time|stood still) ",
        "the simulated clock of ROS does not advance", Ends.ITSELF,
        "start the simulation; it waits until the clock advances",
    ),
    Stop(
        "link lost", "link", r".*the link is lost",
        "the connection to the chair's computer is closed", Ends.NEW_RUN, "connect it again",
    ),
    Stop(
        "by hand", "person", re.escape(BY_HAND), "a person drives the chair by a joystick",
        Ends.PERSON, "release the stick and return control",
    ),
    Stop(
        "not held", "person", re.escape(NOT_HELD), "the switch that must be held to drive is free",
        Ends.ITSELF, "hold it, with the stick at its centre, and drive",
    ),
    Stop(
        "off centre", "person", re.escape(OFF_CENTRE),
        "after a stop, nothing is driven before the stick was at its centre", Ends.ITSELF,
        "let the stick return to its centre, then drive on",
    ),
    Stop(
        "no stick", "person", re.escape(NO_STICK), "the joystick or the keyboard is silent",
        Ends.ITSELF, "switch the joystick on, and check its plug; or click on the window",
    ),
    Stop(
        "assistant late", "assistant", LATE.format(r"\S+"),
        "the assistant has not answered in time", Ends.ITSELF,
        "let the stick return to its centre, then drive on; if it stays late, drive on by hand, "
        "or start again with another assistant",
    ),
    Stop(
        "assistant failed", "assistant", FAILED.format(r"\S+"),
        "the assistant has raised an error, or has answered with no twist", Ends.NEW_RUN,
        "drive on by hand (the manual switch), or start again with another assistant",
    ),
    Stop(
        "brought to rest", "drive board", re.escape(BROUGHT_TO_REST),
        "the board ends a motion, since commands were missing or a person let go", Ends.ITSELF,
        "it waits until the chair is at rest",
    ),
    Stop(
        "dry run", "program", re.escape(DRY_RUN), "nothing is sent to the chair",
        Ends.NEW_RUN, "run it without --dry-run",
    ),
    Stop(
        "unknown", "unknown", r"", "a message that this table does not hold", Ends.ITSELF,
        "check what it names",
    ),
)  # fmt: skip

_BY_NAME = {stop.name: stop for stop in STOPS}
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
    """What a person does about a message, as part of a sentence."""
    rows = matching_stops(message)
    return "; ".join(dict.fromkeys(stop.advice for stop in rows))


def active_stops(halted: str, shield: Any) -> list[str]:
    """Messages of all stops that are active: of the chair (`Reading.halted`) and of its shield."""
    fault = "" if shield is None else shield_message(shield.latched)
    return [why for why in (halted, fault) if why]


class StopMonitor:
    """The stops that are active now, and for how long they have lasted.

    Attributes:
        messages: of active stops, by the name of the row; empty: the chair drives.
    """

    def __init__(self) -> None:
        self.messages: dict[str, str] = {}
        self._waited, self._at = 0.0, 0.0

    def update(self, now: float, messages: Iterable[str]) -> list[str]:
        """Set the active messages at a time [s]; returns log lines of what changed.

        Empty messages are ignored. `goes on` is logged when no stop is left.
        """
        held = {matching_stops(message)[0].name: message for message in messages if message}
        before, self.messages = self.messages, held
        lines = [
            f"stands: {message}; {_sentence(message)}"
            for name, message in held.items()
            if name not in before
        ]
        over = [message for name, message in before.items() if name not in held]
        if over and not held:
            lines = ["goes on"]
        elif over:
            lines += [f"no longer: {'; '.join(over)}; still stands: {self.why}"]
        hand = any(matching_stops(why)[0].ends is Ends.PERSON for why in held.values())
        if not held or hand:
            self._waited = 0.0
        elif before:
            self._waited += now - self._at
        self._at = now
        return lines

    @property
    def why(self) -> str:
        """All active messages as one line."""
        return "; ".join(self.messages.values())

    @property
    def waited(self) -> float:
        """Seconds for which the chair has been stopped, manual driving left out."""
        return self._waited


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
