"""Parameters given to boards that stand, and kept there."""

from __future__ import annotations

import math

from wheelchair_gym.hardware.boards.parameters import DRIVE_PARAMETERS, RANGE_PARAMETERS
from wheelchair_gym.hardware.boards.protocol import Get, Mode, Save, Set, Status
from wheelchair_gym.hardware.boards.senses import BoardSensors
from wheelchair_gym.hardware.control_loop import Clock

LOOK = 0.005  # s between two looks at the lines
PATIENCE = 3.0  # s for each parameter


def set_parameters(
    senses: BoardSensors, clock: Clock, board: str, wanted: dict[str, float]
) -> dict[str, str]:
    """Give a board the parameters that it lacks; it must stand. What is still wrong after, and why.

    They are in force, and gone with its power until it is told to save them.
    """
    link = senses.drive if board == "drive" else senses.range
    names = DRIVE_PARAMETERS if board == "drive" else RANGE_PARAMETERS
    left: dict[str, str] = {}
    for name, value in wanted.items():
        end = clock.now() + PATIENCE
        asked = -math.inf
        while clock.now() < end and link is not None:
            senses.poll()
            left[name] = senses.parameter_mismatch(board, {name: value})
            if not left[name]:
                del left[name]
                break
            if senses.out_of_bounds(
                board, name, value
            ):  # it will not take it, however often it is asked
                break
            if clock.now() - asked > 0.1 and "does not tell" not in left[name]:
                link.send(Set(names.index(name), value))
                link.send(Get(names.index(name)))
                asked = clock.now()
            clock.wait(clock.now() + LOOK)
        else:
            left.setdefault(name, f"there is no {board} board")
            left[name] += _unrest(senses, board)
    return left


def _unrest(senses: BoardSensors, board: str) -> str:
    """Why a board may not take a parameter now."""
    if board != "drive" or not math.isfinite(senses.stamp_of("odometry")):
        return ""
    mode = Mode(senses.odometry.mode)
    if mode in (Mode.STOPPED, Mode.READY):
        return ""
    return f": it takes parameters at rest, with its drivers off; its mode is {mode.name}"


def save_parameters(senses: BoardSensors, clock: Clock, board: str) -> bool:
    """Let a board keep its parameters over power-off; whether it says so."""
    link = senses.drive if board == "drive" else senses.range
    end = clock.now() + PATIENCE
    while clock.now() < end and link is not None:
        sequence = link.send(Save())
        until = clock.now() + 0.2
        while clock.now() < until:
            senses.poll()
            told = senses.answers.get(board)
            if told is not None and told.sequence == sequence and told.status == Status.DONE:
                return True
            clock.wait(clock.now() + LOOK)
    return False
