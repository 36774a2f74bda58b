"""What is done once to a new chair: its boards get the parameters of its settings."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache

from wheelchair_gym.config import InputError
from wheelchair_gym.hardware.boards.messages import (
    Answer,
    Identify,
    Identity,
    Message,
    Parameter,
    Save,
    Set,
    Status,
)
from wheelchair_gym.hardware.boards.parameters import DRIVE, RANGE
from wheelchair_gym.hardware.boards.protocol import Receiver, encode
from wheelchair_gym.hardware.twin.board import FREQUENCY, EmulatedBoard

_BOOT = FREQUENCY // 10  # cycles
_ANSWER = FREQUENCY // 100
_SAVED = FREQUENCY  # a byte of EEPROM each control run of 5 ms, at most 32 parameters of 4
_SIZE = 256  # bytes: more than the largest store
_NAMES = {"drive.elf": DRIVE, "range.elf": RANGE}


def stored(mcu: str, target: str, bauds: tuple[int, int], wanted: Mapping[str, float]) -> bytes:
    """What EEPROM holds once a host has written these parameters and stored them.

    Args:
        mcu: see `EmulatedBoard`.
        target: see `EmulatedBoard`.
        bauds: see `EmulatedBoard`.
        wanted: values by name; the others keep the board's own defaults.

    Raises:
        InputError: the board refuses a value.
    """
    return _stored(mcu, target, bauds, tuple(wanted.items()))


@cache
def _stored(
    mcu: str, target: str, bauds: tuple[int, int], wanted: tuple[tuple[str, float], ...]
) -> bytes:
    board = EmulatedBoard(mcu, target, bauds)
    board.run(_BOOT)
    for name, value in wanted:
        told = _asked(board, Set(_NAMES[target].index(name), value), Parameter)
        if not isinstance(told, Parameter) or told.status != Status.DONE:
            raise InputError(f"the board refuses {name} = {value:g}")
    _asked(board, Save(), Answer)
    board.run(board.cycle + _SAVED)
    told = _asked(board, Identify(), Identity)
    if not isinstance(told, Identity) or not told.stored:
        raise InputError("the board does not keep its parameters")
    kept = board.eeprom(_SIZE)
    board.close()
    return kept


def _asked(board: EmulatedBoard, message: Message, kind: type) -> Message | None:
    """The answer to a message."""
    receiver = Receiver()
    board.read()
    board.write(b"\0" + encode(message, 0))
    board.run(board.cycle + _ANSWER)
    heard = [frame.message for frame in receiver.feed(board.read())]
    return next((told for told in heard if isinstance(told, kind)), None)
