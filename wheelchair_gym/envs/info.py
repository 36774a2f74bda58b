"""The keys of `info`, one row each: the single and the vector environment fill them from it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

from wheelchair_gym.arrays import Mask
from wheelchair_gym.task.rewards import TERMS

if TYPE_CHECKING:
    from wheelchair_gym.envs.results import Columns
    from wheelchair_gym.safety.shield import Decision


class InfoKey(NamedTuple):
    """One key of `info`."""

    name: str
    column: str  # a field of SENSED or VERDICT; empty: success
    meaning: str


INFO_KEYS = (
    InfoKey("pose", "true_pose", "true pose (3,) [m, m, rad]"),
    InfoKey("twist", "true_twist", "true twist (2,) [m/s, rad/s]"),
    InfoKey("pose_estimate", "pose", "the chair's own estimate of its pose (3,)"),
    InfoKey("is_success", "", "at the goal by truth, and nothing was touched"),
    InfoKey("arrived", "arrived", "at the goal by the chair's own estimate"),
    InfoKey("bumped", "bumped", "a bumper strip is pressed"),
    InfoKey("contact", "contact", "touched anything during the last control period"),
    InfoKey(
        "at_fault", "at_fault",
        "the chair approached at more than 0.05 m/s, and faster than what it touched approached it",
    ),
    InfoKey("contact_with", "contact_with", "number of the actor touched; -1: none"),
    InfoKey("approach_speed", "approach_speed", "of the chair at that contact [m/s]"),
    InfoKey("other_approach_speed", "other_approach_speed", "of the other thing [m/s]"),
    InfoKey("clearance", "clearance", "from the outline to the nearest obstacle [m]"),
    InfoKey("energy", "energy", "drawn from the battery since reset [Wh]"),
    InfoKey("distance", "distance", "driven since reset [m]"),
    InfoKey("time", "stamp", "since reset [s]"),
    InfoKey("valid_beams", "valid_beams", "finite ranges of the scan"),
    InfoKey("geodesic", "geodesic", "shortest way from start to goal [m]"),
)  # fmt: skip
# Keys that tell which episode is driven.
EPISODE_KEYS = {
    "seed": "of the sequence of episodes: `reset(seed=...)` begins it again",
    "episode_number": "among those of its seed, from 0",
    "split": "stream of worlds that it is drawn from: train or test",
}


def info_of_shield(decision: Decision) -> dict[str, Any]:
    """Return what `info` tells of a shield's decision, with arrays of its own."""
    return decision._asdict() | {"asked": decision.asked.copy(), "given": decision.given.copy()}


def info_of_rows(columns: Columns, shielded: bool) -> dict[str, Any]:
    """The info of many environments, as arrays with their masks; of a reason, its number."""
    sensed, verdicts, decisions, success, _, mask = columns
    every = {name: rows[name] for rows in (sensed, verdicts) for name in rows.dtype.names or ()}
    every[""] = success
    values: dict[str, Any] = {key.name: every[key.column] for key in INFO_KEYS}
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
