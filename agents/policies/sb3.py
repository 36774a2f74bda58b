"""Models of stable-baselines3 as policies: a .zip that `model.save` wrote.

Loading such a file runs code that the file contains (it holds pickled objects): load only files
that you trust. `wheelchair export` writes weights (.npz) that hold no code.
"""

from __future__ import annotations

import dataclasses
import sys
import zipfile
from collections.abc import Mapping
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from agents.learning.features import Layout
from agents.policies.learned import LearnedDriver
from wheelchair_gym.config import InputError, dump, load, setting, settings
from wheelchair_gym.envs.guidance import make_guidance
from wheelchair_gym.envs.settings import EnvSettings
from wheelchair_gym.files import LIMITS, opened, parse_json
from wheelchair_gym.task.task import Task

Floats = NDArray[np.float32]

# The class of a model by the module of its network's class; of PPO and A2C, by their settings.
_ALGORITHMS = {
    "stable_baselines3.sac.policies": "stable_baselines3:SAC",
    "stable_baselines3.td3.policies": "stable_baselines3:TD3",
    "sb3_contrib.tqc.policies": "sb3_contrib:TQC",
    "sb3_contrib.common.recurrent.policies": "sb3_contrib:RecurrentPPO",
}


@settings
class Sb3Model:
    """A model of stable-baselines3 (.zip); loading it runs code that is in the file."""

    file: str = setting(default="", source="")
    """The file that `model.save` wrote."""
    trained_in: Mapping[str, Any] = dataclasses.field(
        default_factory=dict, metadata={"source": "design choice"}
    )
    """Settings of the environment that it was trained in, where they are not the defaults; the
    number of laser beams follows from the file."""

    def make(self) -> LearnedDriver:
        """A fresh policy.

        Raises:
            InputError: the file is no such model, or `trained_in` gives other observations.
        """
        path = Path(self.file)
        algorithm = _algorithm(path)
        _say_once(f"wheelchair: {path}: loading it runs code that is in the file")
        try:
            model = algorithm.load(path, device="cpu")
        except Exception as error:  # whatever a pickle raises
            why = f"{type(error).__name__}: {error}".split("\n")[0]
            raise InputError(f"{path}: the model cannot be loaded ({why})") from error
        expected = {key: box.shape for key, box in _boxes(model.observation_space, path).items()}
        env = load(EnvSettings, self.trained_in, f"policy {path}: trained_in")
        if "laser" in expected:
            task = dataclasses.replace(env.task, beams=expected["laser"][0])
            env = dataclasses.replace(env, task=task)
        guidance = make_guidance(env.guidance)
        task_of_env = Task(env.task, env.chair, env.sensors, 1.0 / env.rate, guidance)
        found = {key: box.shape for key, box in task_of_env.spaces.items()}
        if found != expected:
            raise InputError(
                f"{path}: its observations are {_text(expected)}, those of the default "
                f"environment {_text(found)}; give what it was trained in as trained_in"
            )
        layout = Layout.of_task(task_of_env)
        card = {
            "env": dump(env),
            "layout": {"sizes": layout.sizes, "path_has_heading": layout.path_has_heading},
        }
        return LearnedDriver(_Network(model, layout), card, hasattr(model.policy, "lstm_actor"))


@cache
def _say_once(text: str) -> None:
    print(text, file=sys.stderr)


class _Network:
    """A model's deterministic action for flat observations, with its recurrent state."""

    def __init__(self, model: Any, layout: Layout) -> None:
        self._model, self._layout = model, layout
        self.reset(1)

    def reset(self, rows: int) -> None:
        """Forget the recurrent state."""
        self._state: Any = None
        self._begins = np.ones(rows, bool)

    def __call__(self, flat: Floats) -> Floats:
        seen = {key: flat[:, self._layout.slice_of(key)] for key, _ in self._layout.sizes}
        action, self._state = self._model.predict(seen, self._state, self._begins, True)
        self._begins = np.zeros_like(self._begins)
        return np.asarray(action, np.float32)


def _boxes(space: Any, path: Path) -> Mapping[str, Any]:
    import gymnasium as gym

    if not isinstance(space, gym.spaces.Dict):
        raise InputError(
            f"{path}: its observations are {type(space).__name__}; expected the Dict of the "
            "navigation environment, without wrappers that change it"
        )
    return dict(space.spaces)


def _text(shapes: Mapping[str, Any]) -> str:
    return ", ".join(f"{key} {shape[0]}" for key, shape in shapes.items())


def _algorithm(path: Path) -> Any:
    """The class of a model, read from its file without running anything in it."""
    try:
        with opened(path) as stream, zipfile.ZipFile(stream) as file:
            if file.getinfo("data").file_size > LIMITS["json"].most:
                raise InputError(f"{path}: its data is too long")
            data = parse_json(file.read("data"), path)
        module = data["policy_class"]["__module__"]
    except InputError:
        raise
    except Exception:  # whatever a damaged archive makes of itself
        raise InputError(f"{path}: expected a model that stable-baselines3 saved (.zip)") from None
    place = _ALGORITHMS.get(module)
    if place is None:
        place = "stable_baselines3:PPO" if "clip_range" in data else "stable_baselines3:A2C"
    package, _, name = place.partition(":")
    try:
        return getattr(import_module(package), name)
    except ImportError:
        raise InputError(f"{path}: needs the package {package}; pip install {package}") from None
