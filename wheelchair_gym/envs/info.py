"""The keys of `info`: signals, and what a task adds; single and vector environment fill them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

from wheelchair_gym.arrays import Mask
from wheelchair_gym.signals import READING, TRUTH
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
    *(
        InfoKey(s.info, s.column, f"{s.meaning} [{s.unit}]" if s.unit else s.meaning)
        for s in (*TRUTH, *READING)
        if s.info
    ),
    InfoKey("is_success", "", "at the goal by truth, and nothing was touched"),
    InfoKey("arrived", "arrived", "at the goal by the chair's own estimate"),
    InfoKey("valid_beams", "valid_beams", "finite ranges of the scan"),
    InfoKey("geodesic", "geodesic", "shortest way from start to goal [m]"),
)
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
