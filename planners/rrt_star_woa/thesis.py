"""The thesis's settings: its figure 3.1, and files of that format, for our planners and maps.

Trailing commas are allowed, as in the figure. `agents.studies.plan_pictures` makes maps,
pictures and films of the other keys.
"""

import math
import re
from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any, Final, NamedTuple

from planners.registries import PLANNERS
from wheelchair_gym.base.errors import InputError, shorten
from wheelchair_gym.base.files import parse_json, read_text
from wheelchair_gym.base.settings import LARGEST

# Each key of the file: its value in the figure, its minimum, and its place in the planner's
# settings.
KEYS: Final[dict[str, tuple[Any, float, tuple[str, ...]]]] = {
    "ReturnOnFirstPath": (True, 0, ("tree", "return_on_first_path")),
    "RenderGraphics": (False, 0, ()),
    "CreateVideo": (False, 0, ()),
    "TestMode": (True, 0, ()),
    "MapProcessor_Obstacles_Dilation": (0, 0, ()),
    "MapProcessor_Epsilon": (0.02, 0, ()),
    "MapProcessor_Map_Name": ("5", 0, ()),
    "PathPlanner_Iterations": (10_000, 1, ("tree", "iterations")),
    "PathPlanner_Step_Size": (1.0, 1e-3, ("tree", "step")),
    "PathPlanner_Search_Radius": (1.5, 1e-3, ("tree", "search_radius")),
    "PathPlanner_Goal_Threshold": (1.0, 0, ("tree", "goal_reach")),
    "PathOptimizer_Population": (10, 1, ("whales", "population")),
    "PathOptimizer_Iterations": (10, 0, ("whales", "iterations")),
    "PathOptimizer_a_Parameter": (4.0, 0, ("whales", "a")),
    "PathOptimizer_b_Parameter": (1.0, -math.inf, ("whales", "b")),
    "PathOptimizer_Shortness_Weight": (10.0, 0, ("shortness_weight",)),
    "PathOptimizer_Collision_Free_Weight": (1.0, 0, ("collision_free_weight",)),
    "PathOptimizer_Width_Bound": (2.5, 0, ("width_bound",)),
    "PathOptimizer_Height_Bound": (2.5, 0, ("height_bound",)),
}
KINDS: Final = {bool: "true or false", int: "a whole number", float: "a number", str: "text"}
PLANNERS_OF_FILE: Final = ("rrt_star", "rrt_star_woa_local", "rrt_star_woa_global")
GLOBAL: Final = "rrt_star_woa_global"


class ThesisFile(NamedTuple):
    """The content of a settings file; missing keys keep our defaults, except bias and leader."""

    path: Path
    settings: Mapping[str, Any]  # of the global variant
    values: Mapping[str, Any]  # of the keys that it has

    def value(self, key: str) -> Any:
        """Return the value of a key that no planner has; false, 0 or '' if it is missing."""
        return self.values.get(key, type(KEYS[key][0])())

    def without_effect(self, planner: str, only_planner: bool = False) -> str:
        """Return one line on the keys without effect, with the reasons; '' if each has an effect.

        Args:
            planner: name of the planner.
            only_planner: whether the file gives no map and nothing is drawn.
        """
        used = {"tree"} if planner == "rrt_star" else set()
        if planner in PLANNERS_OF_FILE[1:]:
            used = {field.name for field in fields(PLANNERS[planner])}
        said = []
        idle = [key for key in self.values if KEYS[key][2] and KEYS[key][2][0] not in used]
        if idle:
            said.append(f"{', '.join(idle)}: not of the planner {planner}")
        others = [key for key in self.values if not KEYS[key][2] and key != "TestMode"]
        if only_planner and others:
            said.append(f"{', '.join(others)}: --problems has its own maps, and draws nothing")
        if self.value("TestMode"):
            said.append("TestMode: the thesis does not say what it does")
        return f"{self.path}: without effect: {'; '.join(said)}" if said else ""

    def planner(self, name: str = GLOBAL) -> dict[str, Any]:
        """Return the settings of one of the thesis's planners, for `make_planner`.

        Raises:
            InputError: the thesis has no such planner.
        """
        if name not in PLANNERS_OF_FILE:
            known = ", ".join(PLANNERS_OF_FILE)
            raise InputError(f"planner {name!r} is none of the thesis's; expected {known}")
        values = self.settings.get("tree", {}) if name == "rrt_star" else self.settings
        names = {field.name for field in fields(PLANNERS[name])}
        return {"name": name, **{key: value for key, value in values.items() if key in names}}


def _settings_of(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return the settings of the global variant for values of keys.

    As the thesis prints its algorithms: no sample is the goal, and the leader is overwritten in
    each iteration.
    """
    settings: dict[str, Any] = {"tree": {"goal_bias": 0.0}, "whales": {"leader": "latest"}}
    for key, value in values.items():
        *above, last = KEYS[key][2] or ("",)
        if last:
            place = settings
            for part in above:
                place = place.setdefault(part, {})
            place[last] = value
    return settings


_VALUES = {key: value for key, (value, _, _) in KEYS.items()}
# The figure itself; `make_planner(FIGURE_3_1.planner(name))` is one of the thesis's planners.
FIGURE_3_1: Final = ThesisFile(Path("figure_3_1"), _settings_of(_VALUES), _VALUES)


def _checked(key: str, value: Any, path: Path) -> Any:
    kind, minimum = type(KEYS[key][0]), KEYS[key][1]
    numeric = isinstance(value, int | float) and not isinstance(value, bool)
    good = isinstance(value, kind) if kind in (bool, str) else numeric
    if kind is int and good:
        good = float(value).is_integer()
    if not good or (numeric and not math.isfinite(value)):
        raise InputError(f"{path}: {key} is {shorten(value)}; expected {KINDS[kind]}")
    if numeric and not minimum <= value <= LARGEST:
        expected = f"expected at least {minimum:g} and at most {LARGEST:g}"
        raise InputError(f"{path}: {key} is {shorten(value)}; {expected}")
    return kind(value)


def is_thesis(data: Any) -> bool:
    """Return whether the content of a JSON file is settings of the thesis's format."""
    return isinstance(data, Mapping) and any(key in KEYS for key in data)


def read_thesis(path: str | Path) -> ThesisFile:
    """Return the content of a settings file of the thesis's format.

    Raises:
        InputError: the file cannot be read, or a key is unknown or has a wrong value.
    """
    path = Path(path)
    data = parse_json(without_trailing_commas(read_text(path, "json")), path)
    if not isinstance(data, Mapping):
        raise InputError(f"{path}: expected an object with keys, got {type(data).__name__}")
    values: dict[str, Any] = {}
    for key, value in data.items():
        if key not in KEYS:
            raise InputError(f"{path}: {shorten(key)} is not a key; it has {', '.join(KEYS)}")
        values[key] = _checked(key, value, path)
    return ThesisFile(path, _settings_of(values), values)


def without_trailing_commas(text: str) -> str:
    """Return a JSON text without commas before a closing bracket; quoted text stays."""
    return re.sub(r'("(?:[^"\\]|\\.)*")|,(?=\s*[}\]])', lambda found: found[1] or "", text)
