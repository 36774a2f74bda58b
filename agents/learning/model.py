"""The model that learns: an algorithm of stable-baselines3, as a run's settings say."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from stable_baselines3.common.noise import NormalActionNoise, VectorizedActionNoise

from agents.learning.features import Layout
from agents.learning.networks import Features, algorithm_class, policy_of
from agents.learning.sb3 import SB3VecEnv
from agents.learning.settings import ON_POLICY, Training


def make_model(own: Training, seed: int, env: SB3VecEnv, layout: Layout) -> Any:
    """A fresh model, whose learning rate falls in a line over the whole run.

    Raises:
        InputError: the algorithm needs an extra that is not installed.
    """
    kwargs: dict[str, Any] = {
        "features_extractor_class": Features,
        "features_extractor_kwargs": {"layout": layout},
    }
    if own.algorithm in ON_POLICY:
        options, first = _on_policy(own, kwargs)
    else:
        options, first = _off_policy(own, kwargs)
    made: list[Any] = []

    def rate(_: float) -> float:
        """The library counts what is left of a part only: the frames tell of the whole."""
        done = made[0].num_timesteps / own.frames if made else 0.0
        return first * max(0.0, 1.0 - done)

    made.append(
        algorithm_class(own.algorithm)(
            policy_of(own.algorithm), env, learning_rate=rate, policy_kwargs=kwargs, seed=seed,
            device="cpu", verbose=0, **options,
        )
    )  # fmt: skip
    return made[0]


def _on_policy(own: Training, kwargs: dict[str, Any]) -> tuple[dict[str, Any], float]:
    a = own.on_policy
    kwargs |= {
        "net_arch": {"pi": list(own.hidden), "vf": list(own.hidden)},
        "log_std_init": a.log_deviation,
        "activation_fn": torch.nn.ReLU,
    }
    if own.algorithm == "recurrent_ppo":
        kwargs["lstm_hidden_size"] = a.memory
    options = {
        "n_steps": a.steps, "batch_size": a.batch, "n_epochs": a.epochs, "gamma": a.discount,
        "gae_lambda": a.trace, "clip_range": a.clip, "ent_coef": a.entropy, "vf_coef": a.critic,
        "max_grad_norm": a.gradient,
    }  # fmt: skip
    return options, a.rate


def _off_policy(own: Training, kwargs: dict[str, Any]) -> tuple[dict[str, Any], float]:
    o = own.off_policy
    kwargs["net_arch"] = list(own.hidden)
    options: dict[str, Any] = {
        "buffer_size": o.buffer, "batch_size": o.batch, "learning_starts": o.begin,
        "gradient_steps": o.updates, "train_freq": 1, "gamma": o.discount, "tau": o.follow,
    }  # fmt: skip
    if own.algorithm == "td3":
        noise = NormalActionNoise(np.zeros(2), np.full(2, o.noise))
        options["action_noise"] = VectorizedActionNoise(noise, own.envs)
    return options, o.rate
