"""Registries: names of settings classes, imported when first used."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import cache
from importlib import import_module
from typing import Any

from wheelchair_gym.config import dump, load, suggest
from wheelchair_gym.errors import InputError, shorten


@cache
def _imported(place: str) -> Any:
    module, _, attribute = place.partition(":")
    return getattr(import_module(module), attribute)


class Registry(Mapping[str, Any]):
    """Objects by name; each is imported when it is first looked up.

    Args:
        kind: what the entries are, such as `planner`; error messages begin with it.
        places: `module:attribute` of each name.
    """

    def __init__(self, kind: str, places: Mapping[str, str]) -> None:
        self.kind, self.places = kind, dict(sorted(places.items()))

    def __getitem__(self, name: str) -> Any:
        return _imported(self.places[name])

    def __iter__(self) -> Iterator[str]:
        return iter(self.places)

    def __len__(self) -> int:
        return len(self.places)

    def __contains__(self, name: object) -> bool:
        return name in self.places

    def name_of(self, value: object) -> str | None:
        """The name of an object's class, or None if it has none here."""
        place = f"{type(value).__module__}:{type(value).__qualname__}"
        return next((name for name in self.places if self.places[name] == place), None)

    def spec(self, value: Any) -> dict[str, Any]:
        """A name, a mapping with a name, or an object of a registered class, as a mapping.

        Raises:
            InputError: the value is none of these, or the name is unknown.
        """
        known = self.name_of(value)
        if known is not None:
            return {"name": known, **dump(value)}
        if not isinstance(value, str | Mapping):
            expected = "expected a name or an object with a name"
            raise InputError(f"{self.kind} is {shorten(value)}; {expected}")
        values = {"name": value} if isinstance(value, str) else dict(value)
        name = values.get("name")
        if not isinstance(name, str) or name not in self.places:
            known = ", ".join(self.places)
            near = suggest(name, self.places)
            raise InputError(f"{self.kind} {shorten(name)} is unknown; there are {known}{near}")
        return values

    def make(self, value: Any) -> Any:
        """The settings object of a name or a mapping; an object of a registered class is itself.

        Raises:
            InputError: the name is unknown, or a setting is wrong.
        """
        if self.name_of(value) is not None:
            return value
        values = self.spec(value)
        name = values.pop("name")
        return load(self[name], values, f"{self.kind} {name}")
