"""Scenes of a source that counts its maps: one settings class for each number."""

from __future__ import annotations

import sys
from typing import Any, TypeVar

from wheelchair_gym.config import InputError, setting, settings

T = TypeVar("T")


def numbered(scene: type[T], name: str, count: int, what: str) -> dict[str, type[T]]:
    """Scenes `name_1` to `name_count` of a class whose `number` says which map it is.

    Args:
        scene: a settings class with the field `number`.
        name: of the scenes, without the number.
        count: of the maps.
        what: the docstring of each, before its number.
    """
    return {f"{name}_{k}": _fixed(scene, f"{name}_{k}", k, what) for k in range(1, count + 1)}


def _fixed(scene: type[T], name: str, number: int, what: str) -> type[T]:
    """The settings class of one map: the number cannot be set to another."""

    def check(self: Any) -> None:
        if self.number != number:
            raise InputError(f"{name}.number is {self.number}; expected {number}")

    namespace = {
        "__annotations__": {"number": int},
        "__doc__": f"{what} {number}.",
        "__post_init__": check,
        "__module__": scene.__module__,
        "number": setting(default=number, source="of the map", low=number, high=number),
    }
    made: type[T] = settings(type(f"{scene.__name__}{number}", (scene,), namespace))
    # A pickle names a class by its module and its name there.
    setattr(sys.modules[scene.__module__], made.__name__, made)
    return made
