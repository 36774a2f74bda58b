"""People by name: for each of `named.yaml` a function that gives a `Driver`.

The settings of the file are those in which a person differs from `Driver()`.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import yaml

from wheelchair_gym.base.settings import load
from wheelchair_gym.people.drivers.settings import Driver

PEOPLE: Final = yaml.safe_load(Path(__file__).with_name("named.yaml").read_text("utf-8"))


def _define(name: str, text: str, settings: Mapping[str, Any]) -> None:
    """Define the function of a person, an attribute of this module, where the registry finds it."""

    def person() -> Driver:
        return load(Driver, settings, f"driver {name}")

    person.__name__ = person.__qualname__ = name
    person.__doc__ = text
    globals()[name] = person


for _name, _person in PEOPLE.items():
    _define(_name, **_person)
