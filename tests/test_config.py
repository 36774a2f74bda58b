"""Laws of settings: strict, bounded, named in errors, and back again from JSON."""

import dataclasses
import json
import math
import typing

import pytest

from agents.cli.lists import all_settings, settings_rows
from agents.cli.options import POSES
from tests.configs import SINGLE
from wheelchair_gym.base.settings import InputError, dump, load, setting_docs, with_values
from wheelchair_gym.envs.guidance import PoseGuidance
from wheelchair_gym.envs.settings import EnvSettings
from wheelchair_gym.sensors.settings import POSE_SOURCES


@pytest.mark.parametrize("name", SINGLE)
def test_defaults_survive_json(name):
    default = SINGLE[name]
    again = json.loads(json.dumps(dump(default)))
    assert load(type(default), again, name) == default


@pytest.mark.parametrize("name", all_settings())
def test_a_printed_default_is_that_of_the_settings_without_arguments_and_survives_json(name):
    cls = all_settings()[name]
    required = {
        field.name: "required" for field in dataclasses.fields(cls)
        if field.default is field.default_factory is dataclasses.MISSING
    }  # fmt: skip
    expected = required or dump(cls())
    assert required or load(cls, json.loads(json.dumps(expected)), name) == cls()
    printed = with_values({}, {row["name"]: row["default"] for row in settings_rows(cls)})
    assert {key: printed.get(key, {}) for key in expected} == expected


def classes_of_settings():
    """Every class of settings that `wheelchair settings` lists, with the parts of each."""
    found, waiting = set(), [EnvSettings, PoseGuidance, *all_settings().values()]
    while waiting:
        cls = waiting.pop()
        if cls not in found:
            found.add(cls)
            defaults = (field.default for field in dataclasses.fields(cls))
            waiting += [type(value) for value in defaults if dataclasses.is_dataclass(value)]
    return sorted(found, key=lambda cls: (cls.__module__, cls.__name__))


def wrong_values(cls):
    """Settings of a class that must be refused, each with a part of the message."""
    yield "no_such_setting", 1, "is not a setting; it has"
    for name, hint in typing.get_type_hints(cls).items():
        if typing.get_origin(hint) is typing.Literal:
            yield name, "no such word", "it must be one of"
        elif hint is str:
            yield name, 3, "expected str"
        elif hint in (int, float):
            yield name, "fast", f"expected {hint.__name__}"
            yield name, math.nan, "expected int" if hint is int else "is NaN"
            bounds = cls.__dataclass_fields__[name].metadata
            for bound, beyond in ("low", -1), ("high", 1):
                if bounds.get(bound) is not None:
                    yield name, bounds[bound] + beyond, "it must be at "


@pytest.mark.parametrize("cls", classes_of_settings(), ids=lambda cls: cls.__name__)
def test_no_setting_takes_an_unknown_key_another_type_or_a_value_beyond_its_bounds(cls):
    for name, value, says in wrong_values(cls):
        with pytest.raises(InputError) as caught:
            load(cls, {name: value}, "some.json")
        said = str(caught.value)
        assert said.startswith(f"some.json.{name} is ")
        assert says in said


def test_the_command_line_offers_every_pose_source():
    assert POSES == POSE_SOURCES


@pytest.mark.parametrize("cls", classes_of_settings(), ids=lambda cls: cls.__name__)
def test_every_setting_says_what_it_does_and_where_its_default_comes_from(cls):
    docs = setting_docs(cls)
    for field in dataclasses.fields(cls):
        if dataclasses.is_dataclass(field.default) and not field.metadata:
            continue  # a part, whose class says what it is
        doc, place = docs.get(field.name, ""), f"{cls.__name__}.{field.name}"
        assert doc[:1].isupper() or doc[:1].isdigit(), f"{place} has no description"
        assert doc.endswith("."), f"{place}: the description is no sentence"
        if isinstance(field.default, bool | str | None) or field.default == ():
            continue  # a choice among words needs no source
        if field.default is field.default_factory is dataclasses.MISSING:
            continue  # it must be given
        assert field.metadata.get("source"), f"{place} does not say where its default comes from"
