"""Models of stable-baselines3 as policies: a .zip that `save_model` or `model.save` wrote.

`agents.learning.sb3.save_model` adds what a model needs to drive as in training: the settings of
its environment, and the statistics of `VecNormalize`.

Loading such a file runs code that the file contains (it holds pickled objects): load only files
that you trust. `wheelchair export` writes weights (.npz) that hold no code.
"""

import dataclasses
import sys
import zipfile
from collections.abc import Mapping
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np

from agents import read_data
from agents.learning.weights import Layout
from agents.policies.learned import LearnedDriver
from wheelchair_gym.base.arrays import Floats
from wheelchair_gym.base.files import LIMITS, opened, parse_json
from wheelchair_gym.base.settings import InputError, dump, load, setting, settings
from wheelchair_gym.envs.guidance import make_guidance
from wheelchair_gym.envs.settings import EnvSettings
from wheelchair_gym.task.task import Task

RECORD = "wheelchair.json"  # the member of the .zip that `save_model` writes
_KNOWN = read_data("sb3.yaml")  # what is known of models and of wrappers
HARMLESS = set(_KNOWN["harmless_wrappers"])


@settings
class Sb3Model:
    """A model of stable-baselines3 (.zip); loading it runs code that is in the file."""

    file: str = setting(default="")
    """The file that `agents.learning.sb3.save_model` or `model.save` wrote."""
    trained_in: Mapping[str, Any] | None = setting(default=None)
    """Settings of the environment that it was trained in, where the file does not hold them; the
    number of laser beams follows from the model."""

    def path(self) -> Path:
        """The file of the model."""
        return Path(self.file)

    def make(self) -> LearnedDriver:
        """A fresh policy.

        Raises:
            InputError: the file is no such model, says not what it was trained in, was trained
                behind a wrapper that changes what it observes, or does not fit its settings.
        """
        path = self.path()
        algorithm, record = _algorithm(path)
        where = f"{path}: {RECORD}"
        if record is None:
            if self.trained_in is None:
                raise InputError(
                    f"{path}: does not hold the settings that it was trained in; save it by "
                    "agents.learning.sb3.save_model, or give them: --trained-in FILE.json, or "
                    '"trained_in" in the settings of the policy'
                )
            record, where = {"env": self.trained_in}, f"policy {path}: trained_in"
        elif self.trained_in is not None:
            raise InputError(f"{path}: holds the settings of its training; expected no trained_in")
        if others := sorted(set(record.get("wrappers", ())) - HARMLESS):
            raise InputError(
                f"{path}: was trained behind {', '.join(others)}, which may change observations or "
                f"actions; expected at most {', '.join(sorted(HARMLESS))}"
            )
        env = load(EnvSettings, record["env"], where)
        _say_once(f"wheelchair: {path}: loading it runs code that is in the file")
        try:
            model = algorithm.load(path, device="cpu")
        except Exception as error:  # whatever a pickle raises
            why = f"{type(error).__name__}: {error}".split("\n")[0]
            raise InputError(f"{path}: the model cannot be loaded ({why})") from error
        space, flat = model.observation_space, bool(record.get("flat", False))
        if not flat and not isinstance(space, gym.spaces.Dict):
            raise InputError(
                f"{path}: its observations are {type(space).__name__}; expected the Dict of the "
                "navigation environment, without wrappers that change it"
            )
        boxes = {"observations": space} if flat else dict(space.spaces)
        expected = {key: box.shape for key, box in boxes.items()}
        if len(expected.get("laser") or ()) == 1 and not env.sensors.more_lasers:
            task = dataclasses.replace(env.task, beams=expected["laser"][0])
            env = dataclasses.replace(env, task=task)
        guidance = make_guidance(env.guidance)
        task_of_env = Task(env.task, env.chair, env.sensors, 1.0 / env.rate, guidance)
        layout = Layout.of_task(task_of_env)
        found = {key: box.shape for key, box in task_of_env.spaces.items()}
        found = {"observations": (sum(n for (n,) in found.values()),)} if flat else found
        if found != expected:
            raise InputError(
                f"{path}: its observations are {_text(expected)}, those of {where} {_text(found)}; "
                "expected the settings of its training"
            )
        normalization = record.get("normalization")
        if "wrappers" not in record:
            _say_once(
                f"wheelchair: {path}: assumed: trained at {env.rate:g} Hz, without wrappers and "
                "without normalization (VecNormalize)"
            )
        card = {"env": dump(env), "layout": dump(layout)}
        network = _Network(model, layout, flat, normalization)
        return LearnedDriver(network, card, begin=network.reset)


@cache
def _say_once(text: str) -> None:
    print(text, file=sys.stderr)


class _Network:
    """A model's deterministic action for flat observations, with its recurrent state."""

    def __init__(
        self, model: Any, layout: Layout, flat: bool, normalization: Mapping[str, Any] | None
    ) -> None:
        self._model, self._layout, self._flat = model, layout, flat
        self._normalization = normalization
        self.reset()

    def reset(self) -> None:
        """Forget the recurrent state."""
        self._state: Any = None
        self._begins = np.ones(1, bool)

    def __call__(self, flat: Floats) -> Floats:
        seen = {"": flat}
        if not self._flat:
            seen = {key: flat[:, self._layout.slice_of(key)] for key, _ in self._layout.sizes}
        if self._normalization is not None:  # as VecNormalize does it
            epsilon, maximum = self._normalization["epsilon"], self._normalization["clip"]
            for key, (mean, var) in self._normalization["keys"].items():
                scaled = (seen[key] - np.array(mean)) / np.sqrt(np.array(var) + epsilon)
                seen[key] = np.clip(scaled, -maximum, maximum).astype(np.float32)
        given = seen[""] if self._flat else seen
        action, self._state = self._model.predict(given, self._state, self._begins, True)
        self._begins = np.zeros_like(self._begins)
        return np.asarray(action, np.float32)


def _text(shapes: Mapping[str, Any]) -> str:
    sizes = {key: " x ".join(map(str, shape or ())) for key, shape in shapes.items()}
    return ", ".join(f"{key} {size or '(no array)'}" for key, size in sizes.items())


def _algorithm(path: Path) -> tuple[Any, dict[str, Any] | None]:
    """The class of a model, and what `save_model` recorded; nothing in the file is run."""
    try:
        with opened(path) as stream, zipfile.ZipFile(stream) as file:
            names = ("data", RECORD) if RECORD in file.namelist() else ("data",)
            if any(file.getinfo(name).file_size > LIMITS["json"].maximum for name in names):
                raise InputError(f"{path}: its data is too long")
            data, *records = (parse_json(file.read(name), path) for name in names)
        module = data["policy_class"]["__module__"]
        for record in records:
            _check(record)
    except InputError:
        raise
    except Exception:  # whatever a damaged archive makes of itself
        raise InputError(f"{path}: expected a model that stable-baselines3 saved (.zip)") from None
    place = _KNOWN["algorithms"].get(module)
    if place is None:
        place = "stable_baselines3:PPO" if "clip_range" in data else "stable_baselines3:A2C"
    package, _, name = place.partition(":")
    try:
        return getattr(import_module(package), name), next(iter(records), None)
    except ImportError:
        raise InputError(f"{path}: needs the package {package}; pip install {package}") from None


def _check(record: Any) -> None:
    """Raise TypeError, KeyError or ValueError if a record is not as `save_model` writes it."""
    if not (isinstance(record["env"], dict) and isinstance(record["flat"], bool)):
        raise TypeError
    if not all(isinstance(name, str) for name in record["wrappers"]):
        raise TypeError
    if (scale := record["normalization"]) is not None:
        float(scale["epsilon"]), float(scale["clip"])
        for mean, var in scale["keys"].values():
            if np.array(mean, float).shape != np.array(var, float).shape:
                raise ValueError
