"""Laws of settings: strict, bounded, named in errors, and back again from JSON."""

from __future__ import annotations

import ast
import dataclasses
import json
import math
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from planners.trees.variants import RrtStarWoaGlobal
from tests.configs import SINGLE
from wheelchair_gym.config import InputError, dump, load, read
from wheelchair_gym.kinematics import Limits
from wheelchair_gym.physics.settings import ChairSettings
from wheelchair_gym.sensors.settings import SensorSettings


@pytest.mark.parametrize("name", SINGLE)
def test_defaults_survive_json(name):
    default = SINGLE[name]
    again = json.loads(json.dumps(dump(default)))
    assert load(type(default), again, name) == default


def test_a_part_keeps_the_defaults_that_it_has_where_it_stands():
    """A planner whose tree ends with the first path still does when its step is changed."""
    planner = load(RrtStarWoaGlobal, {"tree": {"step": 2.0}, "whales": {"a": 3.0}}, "planner")
    default = RrtStarWoaGlobal()
    assert planner.tree == dataclasses.replace(default.tree, step=2.0)
    assert planner.whales == dataclasses.replace(default.whales, a=3.0)


@pytest.mark.parametrize(
    ("cls", "data", "message"),
    [
        (
            SensorSettings,
            {"laser": {"beamz": 3}},
            "chair.json.laser.beamz is not a setting; it has be",
        ),
        (Limits, {"forward": "fast"}, "chair.json.forward is 'fast'; expected float"),
        (Limits, {"forward": True}, "chair.json.forward is True; expected float"),
        (
            Limits,
            {"forward": -1},
            "chair.json.forward is -1.0; it must be at least 0.05 and at most",
        ),
        (Limits, {"forward": math.nan}, "chair.json.forward is NaN"),
        (
            SensorSettings,
            {"pose_source": "gps"},
            "chair.json.pose_source is 'gps'; it must be one of",
        ),
        (SensorSettings, {"laser": 3}, r"chair.json.laser is 3; expected an object"),
        (SensorSettings, {"ultrasonic": {"order": [0, 1]}}, "order must name each mounted ranger"),
        (SensorSettings, {"ultrasonic": {"mounted": []}}, "mounted has 0 rangers; expected 8"),
        (
            ChairSettings,
            {"random": {"mass": [1]}},
            "chair.json.random.mass has 1 values; expected 2",
        ),
        (ChairSettings, {"body": {"centre_of_mass": 0.49}}, "must lie behind the casters"),
        (ChairSettings, [1], "chair.json: expected an object with keys, got list"),
    ],
)
def test_what_is_wrong_is_named_in_one_line(cls, data, message):
    with pytest.raises(InputError, match=message) as caught:
        load(cls, data, "chair.json")
    assert "\n" not in str(caught.value)


def test_files_that_cannot_be_read_are_named(tmp_path):
    for content, message in (
        (b"{", "line 1, column 2: not JSON"),
        (b"\xff\xfe", "not a text file"),
    ):
        path = tmp_path / "chair.json"
        path.write_bytes(content)
        with pytest.raises(InputError, match=message):
            read(ChairSettings, path)
    with pytest.raises(InputError, match=r"nothing\.json: cannot be read"):
        read(ChairSettings, tmp_path / "nothing.json")


@given(
    st.dictionaries(st.text(max_size=8), st.floats() | st.text(max_size=3) | st.none(), max_size=3)
)
def test_any_mapping_is_taken_or_refused_in_one_line(data):
    known = {f.name for f in dataclasses.fields(Limits)}
    if not set(data) <= known:
        with pytest.raises(InputError, match="is not a setting") as caught:
            load(Limits, data, "x")
        assert len(str(caught.value).splitlines()) == 1


# Folders whose settings have no `doc` yet.
WITHOUT_DOC = (
    "wheelchair_gym/", "wheelchair_gym/envs",
    "wheelchair_gym/physics",
    "wheelchair_gym/sensors", "wheelchair_gym/task",
)  # fmt: skip
ROOT = Path(__file__).parents[1]


def settings_calls():
    for package in ("wheelchair_gym", "planners", "agents"):
        for file in sorted((ROOT / package).rglob("*.py")):
            place = file.relative_to(ROOT)
            folder = "/".join(place.parts[:2]) if len(place.parts) > 2 else f"{place.parts[0]}/"
            for node in ast.walk(ast.parse(file.read_text())):
                call = node.value if isinstance(node, ast.AnnAssign) else None
                if isinstance(call, ast.Call) and ast.unparse(call.func) == "setting":
                    yield folder, f"{place}:{node.lineno}", {k.arg: k.value for k in call.keywords}


def test_every_setting_says_what_it_does_and_where_its_default_comes_from():
    seen = set()
    for folder, place, words in settings_calls():
        if folder in WITHOUT_DOC:
            continue
        seen.add(folder)
        doc = ast.literal_eval(words.get("doc", ast.Constant("")))
        assert doc[:1].isupper() or doc[:1].isdigit(), f"{place}: doc is a sentence"
        assert doc.endswith("."), f"{place}: doc is a sentence and ends with a full stop"
        number = isinstance(words["default"], ast.Constant | ast.UnaryOp | ast.Tuple | ast.Call)
        plain = isinstance(getattr(words["default"], "value", None), bool | str)
        if number and not plain and getattr(words["default"], "value", 0) is not None:
            assert words.get("source"), f"{place}: a number says where it comes from"
    assert seen or set(WITHOUT_DOC)
