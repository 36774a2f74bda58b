"""The vector environment as stable-baselines3 expects it, and models that know their training."""

import json
import re
import time
import zipfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper

from agents.policies.sb3 import RECORD
from wheelchair_gym.base.files import atomic_write
from wheelchair_gym.base.settings import InputError, dump
from wheelchair_gym.envs import NavigationVectorEnv


def flatten_observations(observations: dict[str, Any]) -> Any:
    """Observations by key as one array (n, size)."""
    return np.concatenate(list(observations.values()), axis=1)


class SB3VecEnv(VecEnv):
    """stable-baselines3's `VecEnv` over a `NavigationVectorEnv` in SAME_STEP mode.

    Observations are passed on without a copy: the environment never writes them again. The info
    of an episode's last step holds `terminal_observation`, `TimeLimit.truncated` (truncated and not
    terminated: the learner adds the value of the last state), `is_success` and `episode` (return r,
    length l, time t), so that no `Monitor` is needed; other infos are empty.

    Args:
        env: a vector environment in SAME_STEP mode.
        flat: return observations as one array (n, size), which copies less.

    Raises:
        ValueError: the env is in another autoreset mode.
    """

    def __init__(self, env: NavigationVectorEnv, flat: bool = False) -> None:
        mode = getattr(env.metadata.get("autoreset_mode"), "value", None)
        if mode != "SameStep":
            raise ValueError(f"autoreset_mode is {mode}; expected a vector environment's SameStep")
        self.env = env
        self._seed: int | None = None
        self._started = time.perf_counter()
        self._flat = flat
        space: Any = env.single_observation_space
        if flat:  # the keys in the order in which kernels write them
            boxes = env.task.spaces.values()
            low, high = (np.concatenate([getattr(b, e) for b in boxes]) for e in ("low", "high"))
            space = gym.spaces.Box(low, high)
        self.render_mode = env.render_mode
        super().__init__(env.num_envs, space, env.single_action_space)
        self._returns = np.zeros(self.num_envs)
        self._lengths = np.zeros(self.num_envs, np.int64)

    def reset(self) -> Any:
        """Reset every row; see `VecEnv.reset`.

        Raises:
            InputError: `set_options` was given other options than `NavigationVectorEnv.reset` has,
                or different ones for the rows.
        """
        (options, *others), seed = self._options, self._seed
        self._reset_options()
        self._seed = None
        if any(other != options for other in others):
            raise InputError("set_options: rows share their options; expected the same for all")
        if "reset_mask" in options:
            raise InputError("set_options: reset_mask is no option here; reset() is of every row")
        observations, _ = self.env.reset(seed=seed, options=options)
        self._returns[:], self._lengths[:] = 0.0, 0
        return self._observation(observations)

    def _observation(self, observations: dict[str, Any]) -> Any:
        """Observations as the space has them: by key, or the array that kernels wrote."""
        return next(iter(observations.values())).base if self._flat else observations

    def seed(self, seed: int | None = None) -> Sequence[int | None]:
        """Seed row i with seed + i at the next reset."""
        self._seed = seed
        return [None if seed is None else seed + i for i in range(self.num_envs)]

    def step_async(self, actions: NDArray[Any]) -> None:
        """Store the actions (n, 2) of the next step."""
        self._actions = actions

    def step_wait(self) -> Any:
        """Step every row; see `VecEnv.step_wait`."""
        observations, rewards, terminated, truncated, final = self.env.step(self._actions)
        dones = terminated | truncated
        self._returns += rewards
        self._lengths += 1
        infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        for i in np.flatnonzero(dones).tolist():
            infos[i] = {
                "terminal_observation": self._row(final["final_obs"], i),
                "TimeLimit.truncated": bool(truncated[i] and not terminated[i]),
                "is_success": bool(final["final_info"]["is_success"][i]),
                "level": int(final["final_info"]["level"][i]),
                "episode": {
                    "r": float(self._returns[i]),
                    "l": int(self._lengths[i]),
                    "t": round(time.perf_counter() - self._started, 6),
                },
            }
            self._returns[i], self._lengths[i] = 0.0, 0
        return self._observation(observations), rewards.astype(np.float32), dones, infos

    def _row(self, observations: dict[str, Any], i: int) -> Any:
        if self._flat:
            return self._observation(observations)[i]
        return {key: value[i] for key, value in observations.items()}

    def get_images(self) -> Sequence[NDArray[np.uint8] | None]:
        """A picture of each row, where the environment has `render_mode="rgb_array"`."""
        return self.env.render() or []

    def close(self) -> None:
        """Close the environments."""
        self.env.close()

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """An attribute of the vector environment, once for each index."""
        return [getattr(self.env, attr_name) for _ in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Set an attribute of the vector environment.

        Raises:
            NotImplementedError: indices were given.
        """
        if indices is not None:
            raise NotImplementedError(f"{attr_name} can be set for all rows only")
        self.env.set_attr(attr_name, value)

    def env_method(self, method_name: str, *args: Any, indices: Any = None, **kwargs: Any) -> Any:
        """Call a method of the vector environment; its result once for each index."""
        result = getattr(self.env, method_name)(*args, **kwargs)
        return [result for _ in self._get_indices(indices)]

    def env_is_wrapped(self, wrapper_class: type, indices: Any = None) -> list[bool]:
        """False for each index: rows are not wrapped."""
        return [False for _ in self._get_indices(indices)]


def save_model(model: Any, path: str | Path) -> None:
    """Save a model with what it needs to drive as in training.

    Its .zip also holds the settings of the environment, the names of the wrappers, and the
    statistics of `VecNormalize`, which must be the model's environment (`model.set_env`).
    """
    path = Path(path)
    scale, venv, wrappers = model.get_vec_normalize_env(), model.get_env(), []
    while isinstance(venv, VecEnvWrapper):
        wrappers.append(type(venv).__name__)
        venv = venv.venv
    flat = isinstance(venv, SB3VecEnv) and venv._flat
    if not isinstance(venv, SB3VecEnv):  # such as <Monitor<NavigationEnv<id>>>
        (text,) = venv.env_method("__str__", indices=[0])
        wrappers += re.findall(r"<(\w+)(?=[<\s])", text)[:-1]
    (settings,) = venv.get_attr("settings", indices=[0])
    normalization = None
    if scale is not None and scale.norm_obs:
        of = scale.obs_rms if isinstance(scale.obs_rms, dict) else {"": scale.obs_rms}
        keys = {key: (rms.mean.tolist(), rms.var.tolist()) for key, rms in of.items()}
        normalization = {"epsilon": scale.epsilon, "clip": scale.clip_obs, "keys": keys}
    record = {
        "env": dump(settings), "flat": flat, "wrappers": wrappers, "normalization": normalization,
    }  # fmt: skip
    with atomic_write(path) as part:
        with part.open("wb") as stream:
            model.save(stream)
        with zipfile.ZipFile(part, "a") as file:
            file.writestr(RECORD, json.dumps(record))


class SaveModel(BaseCallback):
    """A callback that calls `save_model` at the end of training, and between.

    Args:
        path: file of the model (.zip).
        frequency: number of steps of the vector environment between two saves; 0: none between.
    """

    def __init__(self, path: str | Path, frequency: int = 0) -> None:
        super().__init__()
        self._path, self._frequency = path, frequency

    def _on_step(self) -> bool:
        if self._frequency and self.n_calls % self._frequency == 0:
            save_model(self.model, self._path)
        return True

    def _on_training_end(self) -> None:
        save_model(self.model, self._path)


class DrawCurve(BaseCallback):
    """A callback that draws, while it trains, the share of episodes that succeed over frames.

    Args:
        path: file of the picture (.png), made anew at most every 2 s and at the end.
        window: number of latest episodes of which the share is taken.
    """

    def __init__(self, path: str | Path, window: int = 200) -> None:
        super().__init__()
        self._path, self._window, self._drawn = Path(path), window, 0.0
        self._ended: list[bool] = []
        self.points: list[tuple[int, float]] = []  # frames, share

    def _on_step(self) -> bool:
        dones, infos = self.locals["dones"], self.locals["infos"]
        ended = [infos[i]["is_success"] for i in dones.nonzero()[0].tolist()]
        if ended:
            self._ended = (self._ended + ended)[-self._window :]
            self.points.append((self.num_timesteps, float(np.mean(self._ended))))
        if time.monotonic() - self._drawn > 2.0:
            self._draw()
        return True

    def _on_training_end(self) -> None:
        self._draw()

    def _draw(self) -> None:
        figure = Figure(figsize=(6.0, 3.5), layout="constrained")
        axes = figure.subplots()
        axes.plot([frames for frames, _ in self.points], [share for _, share in self.points])
        axes.set(xlabel="frames", ylabel=f"success in {self._window} episodes", ylim=(0.0, 1.0))
        self._path.parent.mkdir(parents=True, exist_ok=True)
        figure.savefig(self._path)
        self._drawn = time.monotonic()
