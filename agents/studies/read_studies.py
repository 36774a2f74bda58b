"""The studies of agents/data/studies.yaml."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from itertools import product
from typing import Any, Final

from agents import read_data
from agents.studies.claims import Claim
from agents.studies.figures import FIGURES
from agents.studies.model import Metric, Row, Study, published
from planners.rrt_star_woa.thesis import FIGURE_3_1


def _combinations(axes: Sequence[Any]) -> Iterator[dict[str, Any]]:
    """Every choice of one item from each axis: {name: values}, or a list of {name: value}."""
    lists = [
        [{name: value} for name, values in axis.items() for value in values]
        if isinstance(axis, Mapping)
        else axis
        for axis in axes
    ]
    for chosen in product(*lists):
        yield {name: value for values in chosen for name, value in values.items()}


def _filled(value: Any, names: Mapping[str, Any]) -> Any:
    """A part of a job with the values of names for each `$name`, and a part of figure 3.1."""
    if isinstance(value, Mapping):
        filled = {key: _filled(item, names) for key, item in value.items()}
        return {**FIGURE_3_1.settings.get(filled.pop("figure_3_1", ""), {}), **filled}
    if isinstance(value, list):
        return [_filled(item, names) for item in value]
    named = isinstance(value, str) and value.startswith("$")
    return _filled(names[value[1:]], names) if named else value


def _rows(
    study: str, *, vary: Sequence[Any], label: str, stratum: str, job: Mapping[str, Any],
    over: Sequence[Any] = (), x: str | float = float("nan"), series: str = "", group: str = "",
) -> Iterator[Row]:  # fmt: skip
    """A row for each combination of the values in `vary`, a job for each of those in `over`."""
    for names in _combinations(vary):
        places = [names | more for more in _combinations(over)]
        jobs = {stratum.format(**of): _filled(job, of) for of in places}
        title = label.format(**names)
        yield Row(
            title, jobs, float(_filled(x, names)), series.format(**names), group.format(**names),
            published(study).get(title, {}),
        )  # fmt: skip


def _readings(
    *, readings: Sequence[Mapping[str, Any]], of: Sequence[str], known: Mapping[str, Study]
) -> Iterator[Row]:
    """The rows of studies of the global variant, once for each reading; x is the printed length.

    A reading has a name, a `leader`, the `goal_bias` of the tree, and whether mu's branches are
    exchanged: below mu a whale spirals, which is the same as a mu of 1 - mu.
    """
    for reading, name in product(readings, of):
        for row in known[name].rows:
            jobs = {}
            for stratum, job in row.jobs.items():
                planner = dict(job["planner"])
                tree = {"name": "rrt_star", **planner["tree"], "goal_bias": reading["goal_bias"]}
                whales = {**planner["whales"], "leader": reading["leader"]}
                if reading["exchanged"]:
                    whales["mu"] = 1.0 - whales.get("mu", 0.5)
                planner = {**planner, "whales": whales}
                jobs[stratum] = {"kind": "shortened", "scene": job["scene"], "tree": tree,
                                 "planner": planner}  # fmt: skip
            yield Row(
                f"{reading['name']}: {name}, {row.label}", jobs, row.published["length_m"],
                reading["name"], name,
            )  # fmt: skip


def _study(name: str, values: dict[str, Any], known: Mapping[str, Study]) -> Study:
    figure, *arguments = values.pop("figures")
    groups = values.pop("rows")
    parts = {
        "rows": [
            row
            for group in groups
            for row in (
                _readings(**group, known=known) if "readings" in group else _rows(name, **group)
            )
        ],
        "metrics": [Metric(**metric) for metric in values.pop("metrics")],
        "claims": [Claim(**claim) for claim in values.pop("claims")],
        "notes": values.pop("notes"),
    }
    tuples: dict[str, Any] = {key: tuple(part) for key, part in parts.items()}
    draw = partial(FIGURES[figure], **arguments[0] if arguments else {})
    return Study(name=name, figures=draw, **tuples, **values)


def _read() -> dict[str, Study]:
    content = read_data("studies.yaml")
    found: dict[str, Study] = {}
    for name, of in content.items():
        if not name.startswith("."):
            found[name] = _study(name, of, found)
    return found


STUDIES: Final[dict[str, Study]] = _read()
