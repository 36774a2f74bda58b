"""Settings that are searched: where, as a person writes it, and what is set there now."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from wheelchair_gym.config import InputError, value_of

if TYPE_CHECKING:
    import optuna


@dataclass(frozen=True)
class Range:
    """A setting that is searched, and where: from `low` to `high`, or among `choices`."""

    key: str
    low: float = 0.0
    high: float = 0.0
    log: bool = False
    choices: tuple[Any, ...] = ()

    @property
    def distribution(self) -> optuna.distributions.BaseDistribution:
        """As Optuna knows it; whole bounds stand for whole numbers."""
        from optuna import distributions

        if self.choices:
            return distributions.CategoricalDistribution(self.choices)
        if isinstance(self.low, int) and isinstance(self.high, int):
            return distributions.IntDistribution(self.low, self.high, log=self.log)
        return distributions.FloatDistribution(self.low, self.high, log=self.log)

    def has(self, value: Any) -> bool:
        """Whether a value is in it."""
        if self.choices:
            return value in self.choices
        number = isinstance(value, int | float) and not isinstance(value, bool)
        return number and self.low <= value <= self.high


def read_range(text: str) -> Range:
    """A range as a person writes it: KEY=LOW:HIGH, KEY=LOW:HIGH:log or KEY=A,B,C.

    Raises:
        InputError: it is none.
    """
    key, _, what = text.partition("=")
    if not (key and what):
        raise InputError(f"--vary {text}: expected KEY=LOW:HIGH, KEY=LOW:HIGH:log or KEY=A,B,C")
    ends = re.fullmatch(r"([^:,]+):([^:,]+)(:log)?", what)
    if not ends:
        if ":" in what or "," not in what:
            raise InputError(f"--vary {text}: expected LOW:HIGH, LOW:HIGH:log or A,B,C")
        return Range(key, choices=tuple(value_of(word) for word in what.split(",")))
    low, high, log = value_of(ends[1]), value_of(ends[2]), ends[3] is not None
    for end in (low, high):
        if isinstance(end, bool) or not isinstance(end, int | float) or not np.isfinite(end):
            raise InputError(f"--vary {text}: {end!r} is not a finite number")
    if low >= high or (log and low <= 0):
        raise InputError(f"--vary {text}: expected LOW < HIGH{', LOW > 0' if log else ''}")
    return Range(key, low, high, log)


def value_at(everything: Mapping[str, Any], key: str) -> Any:
    """The value at a dotted key of settings.

    Raises:
        InputError: there is no such setting, or it has settings of its own.
    """
    place: Any = everything
    for part in key.split("."):
        if not isinstance(place, Mapping) or part not in place:
            known = ", ".join(sorted(place)) if isinstance(place, Mapping) else "no settings"
            raise InputError(f"--vary {key}: {part} is not a setting; there are {known}")
        place = place[part]
    if isinstance(place, Mapping):
        raise InputError(f"--vary {key}: has settings of its own: {', '.join(sorted(place))}")
    return place
