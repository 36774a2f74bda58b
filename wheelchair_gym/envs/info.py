"""The keys of `info`, one row each: the single and the vector environment fill them from it."""

from __future__ import annotations

from operator import itemgetter
from typing import TYPE_CHECKING, Any, NamedTuple

from wheelchair_gym.arrays import Mask
from wheelchair_gym.task.rewards import TERMS, Verdict
from wheelchair_gym.types import Reading, Truth

if TYPE_CHECKING:
    from wheelchair_gym.envs.results import Columns
    from wheelchair_gym.safety.shield import Decision


SOURCES: dict[str, tuple[str, ...]] = {
    "truth": Truth._fields,
    "reading": Reading._fields,
    "verdict": Verdict._fields,
    "success": ("",),
}


class InfoKey(NamedTuple):
    """One key of `info`."""

    name: str
    source: str  # one of SOURCES
    field: str  # of Truth, Reading or Verdict
    meaning: str

    @property
    def column(self) -> str:
        """Its field in a record of SENSED, where truth's pose and twist stand beside estimates."""
        return f"true_{self.field}" if self.source == "truth" and self.name in TRUE else self.field


TRUE = ("pose", "twist")
INFO_KEYS = (
    InfoKey("pose", "truth", "pose", "true pose (3,) [m, m, rad]"),
    InfoKey("twist", "truth", "twist", "true twist (2,) [m/s, rad/s]"),
    InfoKey("pose_estimate", "reading", "pose", "the chair's own estimate of its pose (3,)"),
    InfoKey("is_success", "success", "", "at the goal by truth, and nothing was touched"),
    InfoKey("arrived", "verdict", "arrived", "at the goal by the chair's own estimate"),
    InfoKey("bumped", "reading", "bumped", "a bumper strip is pressed"),
    InfoKey("contact", "truth", "contact", "touched anything during the last control period"),
    InfoKey(
        "at_fault", "truth", "at_fault",
        "the chair approached at more than 0.05 m/s, and faster than what it touched approached it",
    ),
    InfoKey("contact_with", "truth", "contact_with", "number of the actor touched; -1: none"),
    InfoKey("approach_speed", "truth", "approach_speed", "of the chair at that contact [m/s]"),
    InfoKey("other_approach_speed", "truth", "other_approach_speed", "of the other thing [m/s]"),
    InfoKey("clearance", "truth", "clearance", "from the outline to the nearest obstacle [m]"),
    InfoKey("energy", "truth", "energy", "drawn from the battery since reset [Wh]"),
    InfoKey("distance", "truth", "distance", "driven since reset [m]"),
    InfoKey("time", "reading", "stamp", "since reset [s]"),
    InfoKey("valid_beams", "verdict", "valid_beams", "finite ranges of the scan"),
    InfoKey("geodesic", "verdict", "geodesic", "shortest way from start to goal [m]"),
)  # fmt: skip
# Keys that tell which episode is driven.
EPISODE_KEYS = {
    "seed": "of the sequence of episodes: `reset(seed=...)` begins it again",
    "episode_number": "among those of its seed, from 0",
    "split": "stream of worlds that it is drawn from: train or test",
}

_FIELDS = [(source, field) for source, fields in SOURCES.items() for field in fields]
_NAMES = tuple(key.name for key in INFO_KEYS)
_VALUES = itemgetter(*(_FIELDS.index((key.source, key.field)) for key in INFO_KEYS))


def info_of(truth: Truth, reading: Reading, verdict: Verdict, success: bool) -> dict[str, Any]:
    """The info of one environment, but for its shield's."""
    info = dict(zip(_NAMES, _VALUES((*truth, *reading, *verdict, success)), strict=True))
    info["reward_terms"] = dict(zip(TERMS, verdict.terms, strict=True))
    return info


def info_of_shield(decision: Decision) -> dict[str, Any]:
    """Return what `info` tells of a shield's decision, with arrays of its own."""
    return decision._asdict() | {"asked": decision.asked.copy(), "given": decision.given.copy()}


def info_of_rows(columns: Columns, shielded: bool) -> dict[str, Any]:
    """The info of many environments, as arrays with their masks; of a reason, its number."""
    sensed, verdicts, decisions, success, _, mask = columns
    values: dict[str, Any] = {
        key.name: (verdicts if key.source == "verdict" else sensed)[key.column]
        if key.field
        else success
        for key in INFO_KEYS
    }
    terms = verdicts["terms"]
    values["reward_terms"] = _masked({name: terms[name] for name in TERMS}, mask)
    if shielded:
        names = decisions.dtype.names or ()
        values["shield"] = _masked({name: decisions[name] for name in names}, mask)
    return _masked(values, mask)


def _masked(values: dict[str, Any], mask: Mask) -> dict[str, Any]:
    return values | {f"_{name}": mask for name in values}


def info_table() -> str:
    """All keys as a table in Markdown."""
    meanings = {key.name: key.meaning for key in INFO_KEYS} | EPISODE_KEYS
    rows = (f"| {name} | {meaning} |" for name, meaning in meanings.items())
    return "\n    ".join(["| key | meaning |", "| --- | --- |", *rows])
