"""Wrong input is refused in one line that names it; the inputs stand in refusals.yaml."""

import dataclasses
import pkgutil
import re

import gymnasium as gym
import numpy as np
import pytest
import yaml

from agents.learning.settings import Imitation, Training, read_training
from agents.people.protocol import Protocol
from planners.problem_files import read_problems
from planners.rrt_star_woa import thesis
from tests.conftest import ROOT, put
from tests.hardware import test_plant
from tests.maps import test_files, test_importers
from tests.planners.test_planners import GOOD
from tests.planners.test_thesis import FIGURE
from tests.scenes.test_scenes import WORLDS
from tests.sim.worlds import box
from wheelchair_gym import maps
from wheelchair_gym.actors import records as actors
from wheelchair_gym.base.settings import InputError, dump, load, read, read_json
from wheelchair_gym.envs import EnvSettings
from wheelchair_gym.geometry.kinematics import Limits
from wheelchair_gym.hardware.joystick import JoystickSettings
from wheelchair_gym.hardware.laser import scip
from wheelchair_gym.hardware.registry import make_chair
from wheelchair_gym.hardware.settings import check_boards
from wheelchair_gym.hardware.twin.plant import Plant, PlantSettings
from wheelchair_gym.maps.cost_to_go import CostToGoSettings
from wheelchair_gym.maps.io.floor_plan import read_floor_plan_image
from wheelchair_gym.perception.monte_carlo import LocalizationSettings
from wheelchair_gym.recording.replay import sensor_log
from wheelchair_gym.safety import Shield
from wheelchair_gym.scenes import make_scene
from wheelchair_gym.sensors.settings import SensorSettings
from wheelchair_gym.sim.randomization import JointRandomization
from wheelchair_gym.sim.settings import ChairSettings

REFUSALS = yaml.safe_load((ROOT / "tests" / "laws" / "refusals.yaml").read_text())
SETTINGS = (
    ChairSettings, CostToGoSettings, EnvSettings, Imitation, JoystickSettings, Limits,
    LocalizationSettings, SensorSettings, Training,
)  # fmt: skip
PROTOCOL = read_json(ROOT / "examples" / "participants.json")
JOINT = dump(load(JointRandomization, {
    "quantities": ["motor.gain", "body.mass"], "mean": [1.0, 90.0],
    "covariance": [[0.01, 0.0], [0.0, 4.0]],
}, "joint"))  # fmt: skip
CLASSES = {cls.__name__: cls for cls in SETTINGS}


def changed(right, change):
    return {key: value for key, value in (right | change).items() if value != "(absent)"}


def replaced(right, change):
    return "" if change is None else right.replace(*change, 1)


def sample(spec):
    return make_scene(spec).sample(np.random.default_rng(0))


def sample_barn(file):
    return sample({"name": "barn", "path": str(file)})


def put_bytes(file, content):
    """Write Latin-1 to a file, or no file for None; its path."""
    if content is not None:
        file.write_bytes(content.encode("latin-1"))
    return file


def call(kind, value):
    """Call what a kind names, with the value as it is, as arguments or as keywords."""
    name, how = kind.removesuffix("_)").split("(")
    arguments, keywords = {"": ([value], {}), "*": (value, {}), "**": ([], value)}[how]
    return pkgutil.resolve_name(name)(*arguments, **keywords)


# Each makes something of a value; files are written to a folder.
MAKERS = {
    "world": lambda value, _: sample(value),
    "hardware environment": lambda value, _: gym.make("wheelchair_gym/Hardware-v1", **value),
    "environment": lambda value, _: gym.make("wheelchair_gym/Navigation-v1", **value).reset(seed=0),
    "settings": lambda value, _: load(CLASSES[value[0]], value[1], "file.json"),
    "shield": lambda value, _: Shield(
        chair=load(ChairSettings, value[0], "chair"), period=value[1]
    ),
    "protocol": lambda value, _: load(Protocol, PROTOCOL | value, "protocol.json"),
    "training": lambda value, _: read_training(value, "x.json", "ppo"),
    "image": lambda value, folder: read_floor_plan_image(put_bytes(folder / "a.pgm", value), 0.1),
    "map": lambda value, folder: maps.read_map(test_files.put_map(folder, **value)),
    "octile": lambda value, folder: maps.read_moving_ai_map(
        put(folder / "bad.map", replaced(test_importers.OCTILE, value))
    ),
    "thesis": lambda value, folder: thesis.read_thesis(
        put(folder / "figure.json", replaced(FIGURE, value))
    ),
    "house": lambda value, folder: maps.read_house(
        put(folder / "bad.json", changed(test_importers.HOUSE, value))
    ),
    "problem": lambda value, folder: read_problems(
        put(folder / "problems.json", [GOOD, changed(GOOD, value)])
    ),
    "barn": lambda value, folder: sample_barn(
        put(folder / "worlds.json", [changed(WORLDS[0], value)])
    ),
    "plant": lambda value, folder: PlantSettings.read(
        put(folder / "hidden.json", value), test_plant.BELIEVED
    ),
    "twin": lambda value, _: Plant(
        load(ChairSettings, value[0], "chair"), load(SensorSettings, value[1], "sensors")
    ),
    "joint": lambda value, _: load(ChairSettings, {"joint": JOINT | value}, "chair.json"),
    "no problems": lambda value, folder: read_problems(put(folder / "problems.json", value)),
    "group": lambda value, _: actors.group(actors.person([(0, 0)]), *value),
    "specification": lambda value, _: scip.specs_of(
        scip.Reply("PP", "00", tuple(line.encode() for line in value))
    ),
    "recording": lambda value, folder: sensor_log(put_bytes(folder / "run.log", value)),
    "settings file": lambda value, folder: read(
        ChairSettings, put_bytes(folder / "chair.json", value)
    ),
    "description": lambda value, folder: maps.read_map(put_bytes(folder / "map.yaml", value)),
    "arrival": lambda value, _: dataclasses.replace(box(), arrival=tuple(value)),
    "chair": lambda value, _: make_chair(value, EnvSettings()),
    "boards": lambda value, _: check_boards(load(SensorSettings, value, "sensors")),
    "any map": lambda value, folder: maps.read_any_map(put(folder / value[0], value[1])),
    "no worlds": lambda value, folder: sample_barn(put(folder / "worlds.json", value)),
}


@pytest.mark.parametrize(
    ("kind", "value", "words"), [(kind, *row) for kind, rows in REFUSALS.items() for row in rows]
)
def test_what_is_wrong_is_refused_in_one_line_that_names_it(kind, value, words, tmp_path):
    parts, end = words.removesuffix("$").split(" ... "), words.endswith("$") * "$"
    with pytest.raises(InputError, match=".*".join(map(re.escape, parts)) + end) as caught:
        MAKERS[kind](value, tmp_path) if kind in MAKERS else call(kind, value)
    assert kind != "map" or str(tmp_path) in str(caught.value)
