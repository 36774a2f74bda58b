"""Reads settings under the names that earlier releases wrote into recordings and weights."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import yaml

# Earlier name -> name now (`renamed`), and settings that are constants now, with their values or
# None where the value is not compared (`dropped`): both by section of the environment's settings.
_EARLIER: Final = yaml.safe_load(Path(__file__).with_name("earlier_names.yaml").read_text("utf-8"))
RENAMED: Final[dict[str, dict[str, str]]] = _EARLIER["renamed"]
DROPPED: Final[dict[str, dict[str, Any]]] = _EARLIER["dropped"]

# Where settings stand that have a section of their own: of mixed scenes, and of an experiment.
_SECTIONS: Final = {
    "scene.scenes": "scene",
    "protocol.tasks.scene": "scene",
    "protocol.practice.scene": "scene",
    "protocol.conditions.assist": "assistant",
}


def migrated(settings: Mapping[str, Any], section: str = "") -> dict[str, Any]:
    """Settings (JSON content) under the names of today, without those dropped.

    A dropped setting with another value than the constant of today is reported by a warning.

    Args:
        settings: of an environment, or of its section; of an experiment for "protocol".
        section: that they are.
    """
    section = _SECTIONS.get(section, section)
    names, dropped = RENAMED.get(section, {}), DROPPED.get(section, {})
    found = {}
    for key, value in settings.items():
        name = names.get(key, key)
        inner = f"{section}.{name}" if section else name
        if key not in dropped:
            found[name] = _migrated(value, inner)
        elif dropped[key] not in (None, value):
            warnings.warn(
                f"{inner} is {value} in a file of an earlier release; it is {dropped[key]} now",
                stacklevel=2,
            )
    return found


def _migrated(value: Any, section: str) -> Any:
    if isinstance(value, list) and any(isinstance(each, dict) for each in value):
        return [_migrated(each, section) for each in value]
    return migrated(value, section) if isinstance(value, dict) else value
