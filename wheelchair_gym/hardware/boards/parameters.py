"""Parameters of the boards: names, the values that a chair's settings ask for, reading, writing.

Defaults and bounds live in the firmware (protocol.h), which reports them on request.
"""

from __future__ import annotations

import math
from dataclasses import fields
from typing import TYPE_CHECKING

import numpy as np

from wheelchair_gym.hardware.boards import protocol
from wheelchair_gym.hardware.boards.link import Link
from wheelchair_gym.hardware.settings import HardwareSettings
from wheelchair_gym.sensors.settings import SensorSettings, UltrasonicSettings
from wheelchair_gym.sim.settings import ChairSettings

if TYPE_CHECKING:
    from wheelchair_gym.hardware.boards.senses import BoardSensors
    from wheelchair_gym.hardware.control_loop import Clock

DRIVE_PARAMETERS = (  # in the board's order: chair, limits, control, supervision, person and rest
    "track", "counts_per_metre",
    "forward", "backward", "turn", "acceleration", "deceleration", "protective",
    "turn_acceleration", "jerk", "turn_jerk", "stop",
    "feed", "kp", "ki", "kd", "ka", "smoothing",
    "timeout", "latch", "missing", "over_speed", "under_voltage", "battery_full",
    "manual", "creep", "half_width", "runaway", "load", "hold", "park", "slip", "duty_limit",
)  # fmt: skip
RANGE_PARAMETERS = (
    "interval", "sound", "narrow_reach", "wide_reach", "narrow_blind", "wide_blind", "n_rangers",
)  # fmt: skip
NAMES = {"drive": DRIVE_PARAMETERS, "range": RANGE_PARAMETERS}
PATIENCE = 3.0  # s for each parameter, for an identity, and until EEPROM is written
_REPEAT = 0.1  # s between two attempts to set one
_ANSWER = 0.2  # s for an answer to `Save` or `Identify`
_AGREE = 1e-4  # relative difference between equal parameters: boards keep 32 bits
_MISSING, _COUNTS = 0.01, 3.0  # m; counts of coarse encoders, which report a motion in jumps


def drive_parameters(chair: ChairSettings) -> dict[str, float]:
    """Return the chair's parameters that the drive board must hold; others are the board's own."""
    drive, limits, motor = chair.drive, chair.limits, chair.motor
    values = {field.name: float(getattr(limits, field.name)) for field in fields(limits)}
    # To slow the chair at this rate, the board's set point falls faster.
    del values["protective"]
    values |= {"track": drive.track, "counts_per_metre": drive.counts_per_metre}
    values |= {name: float(getattr(motor, name)) for name in ("kp", "ki", "kd", "ka")}
    values["smoothing"] = motor.filter_time
    values["feed"] = motor.believed_constant / drive.wheel_radius
    values["under_voltage"] = chair.battery.empty_voltage
    values["missing"] = max(_MISSING, _COUNTS / drive.counts_per_metre)
    values["half_width"] = chair.footprint.half_width
    return values


def range_parameters(rangers: UltrasonicSettings) -> dict[str, float]:
    """Return the parameters that the range board must hold for a chair's ultrasonics."""
    values = {"interval": rangers.interval, "n_rangers": float(len(rangers.mounted))}
    for name, model in (("narrow", rangers.narrow), ("wide", rangers.wide)):
        values |= {f"{name}_reach": model.reach, f"{name}_blind": model.range_min}
    return values


def board_parameters(
    chair: ChairSettings, sensors: SensorSettings, hardware: HardwareSettings
) -> dict[str, dict[str, float]]:
    """Return the parameters that the boards must hold for a chair, by the name of the board."""
    drive = drive_parameters(chair)
    drive |= {name: getattr(hardware, name) for name in ("battery_full", "duty_limit")}
    return {"drive": drive, "range": range_parameters(sensors.ultrasonic)}


class ParameterTable:
    """The parameters that a board has reported.

    Args:
        board: drive or range.
        link: to the board, or None.

    Attributes:
        reported: by name, since this was last cleared.
    """

    def __init__(self, board: str, link: Link | None) -> None:
        self.board, self.link, self.names = board, link, NAMES[board]
        self.reported: dict[str, protocol.Parameter] = {}

    def update(self, parameter: protocol.Parameter) -> None:
        """Take a parameter that the board reports."""
        if parameter.number < len(self.names):
            self.reported[self.names[parameter.number]] = parameter

    def mismatch(self, wanted: dict[str, float]) -> str:
        """That the board holds another parameter than is wanted; empty: all agree.

        One that has not been reported yet is requested, and named.
        """
        if self.link is None:
            return ""
        for name, value in wanted.items():
            held = self.reported.get(name)
            if held is None:
                self.link.send(protocol.Get(self.names.index(name)))
                return f"the {self.board} board does not report its {name}"
            if not math.isclose(held.value, value, rel_tol=_AGREE, abs_tol=1e-6):
                found = f"the {self.board} board's {name} is {held.value:.6g}; expected {value:.6g}"
                if self.refuses(name, value):
                    found += f", which it refuses: it takes {held.low:g} to {held.high:g}"
                return found
        return ""

    def refuses(self, name: str, value: float) -> bool:
        """Whether the board's own bounds of a parameter, if reported, forbid a value."""
        held = self.reported.get(name)
        return held is not None and not held.low <= float(np.float32(value)) <= held.high


def set_parameters(
    senses: BoardSensors, clock: Clock, board: str, wanted: dict[str, float]
) -> dict[str, str]:
    """Set the parameters of a board that differ, once it has identified itself; it must be at rest.

    They are in force at once, and lost at power-off until the board has saved them.

    Returns:
        What is still wrong with a parameter, by its name.
    """
    table = senses.parameters[board]
    if table.link is None:
        return dict.fromkeys(wanted, f"there is no {board} board")
    if not identify(senses, clock, board):
        why = table.link.error or table.link.mismatch or "it does not identify itself"
        return dict.fromkeys(wanted, f"the {board} board takes no parameters ({why})")
    found = {name: _set(senses, clock, table, name, value) for name, value in wanted.items()}
    return {name: why for name, why in found.items() if why}


def _set(senses: BoardSensors, clock: Clock, table: ParameterTable, name: str, value: float) -> str:
    """Set one parameter; returns what is still wrong with it."""
    link, number, sent = table.link, table.names.index(name), -math.inf
    assert link is not None

    def settled() -> bool:
        nonlocal sent
        if not table.mismatch({name: value}) or table.refuses(name, value):
            return True
        if name in table.reported and clock.now() - sent > _REPEAT:
            link.send(protocol.Set(number, value))
            link.send(protocol.Get(number))
            sent = clock.now()
        return False

    done = senses.wait_for(clock, settled, PATIENCE)
    why = table.mismatch({name: value})
    if done or table.board != "drive" or not math.isfinite(senses.stamp_of("odometry")):
        return why
    mode = protocol.Mode(senses.odometry.mode)
    if mode in (protocol.Mode.STOPPED, protocol.Mode.READY):
        return why
    return f"{why}: it takes parameters at rest, with its drivers off; its mode is {mode.name}"


def identify(senses: BoardSensors, clock: Clock, board: str, stored: bool = False) -> bool:
    """Ask a board to identify itself; return whether it does, `stored`: with saved parameters."""
    link, end = senses.parameters[board].link, clock.now() + PATIENCE
    senses.identities.pop(board, None)

    def identified() -> bool:
        identity = senses.identities.get(board)
        return identity is not None and (bool(identity.stored) or not stored)

    while link is not None and clock.now() < end and not link.other_board:
        link.send(protocol.Identify())
        if senses.wait_for(clock, identified, _ANSWER):
            return True
    return False


def save_parameters(senses: BoardSensors, clock: Clock, board: str) -> bool:
    """Make a board keep its parameters over power-off; return whether its EEPROM holds them."""
    link = senses.parameters[board].link
    end = clock.now() + PATIENCE
    while link is not None and clock.now() < end:
        expected = link.send(protocol.Save()), protocol.Status.DONE

        def saved(expected: tuple[int | None, protocol.Status] = expected) -> bool:
            answer = senses.answers.get(board)
            return answer is not None and (answer.sequence, answer.status) == expected

        if senses.wait_for(clock, saved, _ANSWER):
            return identify(senses, clock, board, stored=True)
    return False
