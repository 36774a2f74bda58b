"""Networks for stable-baselines3: an actor that is told what it may know, a critic that knows more.

Its classes are made by inheritance, as that library asks.
"""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
import torch
from stable_baselines3.common.policies import ActorCriticPolicy
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor
from torch import nn

from agents.learning.features import Layout, features
from agents.learning.weights import Floats, Network, Weights
from wheelchair_gym.config import InputError, load
from wheelchair_gym.envs import EnvSettings
from wheelchair_gym.task.observation_layout import PRIVATE


class Features(BaseFeaturesExtractor):
    """What networks are told of a flat observation; what only a critic may see stands last."""

    def __init__(self, space: gym.Space[Any], layout: Layout) -> None:
        super().__init__(space, layout.told + layout.private)
        self.layout = layout
        self.scaled: torch.Tensor
        self.scales: torch.Tensor
        self.private: torch.Tensor
        self.register_buffer("scaled", torch.from_numpy(layout.scaled))
        self.register_buffer("scales", torch.from_numpy(layout.scales))
        self.register_buffer("private", torch.from_numpy(layout.private_scales))

    def forward(self, observations: torch.Tensor) -> torch.Tensor:
        """Features (n, told + private) of observations (n, room)."""
        room = self.layout.room - self.layout.private
        told = features(torch, observations[:, :room], self.layout, self.scaled, self.scales)
        if self.layout.private == 0:
            return told  # type: ignore[no-any-return]
        return torch.cat([told, observations[:, room:] * self.private], -1)


class Halves(nn.Module):
    """Separate bodies of actor and critic; the actor's is not given the last numbers."""

    def __init__(self, told: int, private: int, hidden: tuple[int, ...]) -> None:
        super().__init__()
        self.told = told
        self.latent_dim_pi = self.latent_dim_vf = hidden[-1]
        self.actor = body(told, hidden)
        self.critic = body(told + private, hidden)

    def forward(self, x: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """What actor and critic make of features."""
        return self.forward_actor(x), self.forward_critic(x)

    def forward_actor(self, x: torch.Tensor) -> torch.Tensor:
        """What the actor makes of features."""
        return self.actor(x[:, : self.told])  # type: ignore[no-any-return]

    def forward_critic(self, x: torch.Tensor) -> torch.Tensor:
        """What the critic makes of features."""
        return self.critic(x)  # type: ignore[no-any-return]


def body(room: int, hidden: tuple[int, ...]) -> nn.Sequential:
    """Dense layers, each with a rectifier."""
    layers: list[nn.Module] = []
    for before, after in zip((room, *hidden), hidden, strict=False):
        layers += [nn.Linear(before, after), nn.ReLU()]
    return nn.Sequential(*layers)


class Teacher:
    """A trained actor that sees what its student's critic sees, and tells what it would do.

    Raises:
        InputError: the student's observation lacks what the teacher needs.
    """

    def __init__(self, weights: Weights, layout: Layout, env: EnvSettings) -> None:
        known = load(EnvSettings, weights.card["env"], "teacher: env")
        for name, here, there in (
            ("rate", env.rate, known.rate),
            ("task.look_ahead_time", env.task.look_ahead_time, known.task.look_ahead_time),
            ("memory", 0, weights.memory),
        ):
            if here != there:
                raise InputError(f"teacher: its {name} is {there}; expected {here}")
        places = []
        for key, size in weights.layout.sizes:
            if key in PRIVATE:
                continue
            at = layout.place(f"hidden_{key}")
            at = at if at.stop else layout.place(key)
            if at.stop - at.start != size:
                raise InputError(
                    f"teacher: it needs {size} numbers of {key}; observed are {at.stop - at.start}"
                )
            places.append(np.arange(at.start, at.stop))
        self._places, self._network = np.concatenate(places), Network(weights)

    def __call__(self, observations: torch.Tensor) -> torch.Tensor:
        """Actions (n, 2) in [-1, 1] for a student's flat observations (n, room)."""
        return torch.from_numpy(self._network(observations.numpy()[:, self._places]))


class AsymmetricPolicy(ActorCriticPolicy):
    """Actor and critic of PPO with separate bodies (asymmetric: Pinto et al. 2018)."""

    def _build_mlp_extractor(self) -> None:
        layout: Layout = self.features_extractor_kwargs["layout"]
        hidden = tuple(self.net_arch["pi"])  # type: ignore[call-overload]
        self.mlp_extractor = Halves(layout.told, layout.private, hidden)  # type: ignore[assignment]
        self.teacher: Teacher | None = None
        self.leash = 0.0  # weight of the squared distance from what the teacher does

    def evaluate_actions(
        self, obs: Any, actions: torch.Tensor
    ) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor | None]:
        """Values, log-probabilities, and what is rewarded beside returns: entropy, less the leash.

        Kickstarting (Schmitt et al. 2018): for a while the actor is drawn to a teacher's actions.
        """
        actor, critic = self.mlp_extractor(self.extract_features(obs))
        chosen: Any = self._get_action_dist_from_latent(actor)
        bonus = chosen.entropy()
        if self.teacher is not None and self.leash > 0.0:
            apart = chosen.distribution.mean - self.teacher(obs)
            bonus = bonus - self.leash * (apart * apart).sum(dim=1)
        return self.value_net(critic), chosen.log_prob(actions), bonus


def policy_of(algorithm: str) -> Any:
    """The policy class, or its name, that an algorithm takes."""
    return {"ppo": AsymmetricPolicy, "recurrent_ppo": "MlpLstmPolicy"}.get(algorithm, "MlpPolicy")


CONTRIBUTED = ("recurrent_ppo", "tqc")  # algorithms of sb3-contrib, of the extra 'learn'


def algorithm_class(name: str) -> Any:
    """The class of an algorithm.

    Raises:
        InputError: it needs an extra that is not installed.
    """
    import stable_baselines3 as sb3

    if name in ("ppo", "sac", "td3"):
        return getattr(sb3, name.upper())
    try:
        import sb3_contrib
    except ImportError:
        raise InputError(f"{name} needs: pip install 'wheelchair_gym[learn]'") from None
    return {"recurrent_ppo": sb3_contrib.RecurrentPPO, "tqc": sb3_contrib.TQC}[name]


def _dense_layers(model: Any, algorithm: str) -> list[nn.Linear]:
    """The actor's dense layers in order."""
    policy = model.policy
    if algorithm == "ppo":
        parts = [policy.mlp_extractor.actor, policy.action_net]
    elif algorithm == "recurrent_ppo":
        parts = [policy.mlp_extractor.policy_net, policy.action_net]
    elif algorithm == "td3":
        parts = [policy.actor.mu]
    else:
        parts = [policy.actor.latent_pi, policy.actor.mu]
    return [m for part in parts for m in part.modules() if isinstance(m, nn.Linear)]


def arrays_of(model: Any, algorithm: str) -> dict[str, Floats]:
    """The actor's arrays."""
    arrays: dict[str, Floats] = {}
    if algorithm == "recurrent_ppo":
        lstm = model.policy.lstm_actor
        arrays["lstm.x"], arrays["lstm.h"] = _array(lstm.weight_ih_l0), _array(lstm.weight_hh_l0)
        arrays["lstm.b"] = _array(lstm.bias_ih_l0) + _array(lstm.bias_hh_l0)
    for k, layer in enumerate(_dense_layers(model, algorithm)):
        arrays[f"dense{k}.w"], arrays[f"dense{k}.b"] = _array(layer.weight), _array(layer.bias)
    return arrays


def take_arrays(model: Any, algorithm: str, arrays: dict[str, Floats]) -> None:
    """Give arrays to the actor, and to a target of it.

    Raises:
        InputError: they are of another network.
    """
    own = arrays_of(model, algorithm)
    if {k: v.shape for k, v in own.items()} != {k: v.shape for k, v in arrays.items()}:
        raise InputError(
            f"warm_start: layers are {sorted((k, v.shape) for k, v in arrays.items())}; expected "
            f"{sorted((k, v.shape) for k, v in own.items())}"
        )
    with torch.no_grad():
        if "lstm.x" in arrays:
            lstm = model.policy.lstm_actor
            for parameter, name in ((lstm.weight_ih_l0, "lstm.x"), (lstm.weight_hh_l0, "lstm.h")):
                parameter.copy_(torch.from_numpy(arrays[name].copy()))
            lstm.bias_ih_l0.copy_(torch.from_numpy(arrays["lstm.b"].copy()))
            lstm.bias_hh_l0.zero_()
        for k, layer in enumerate(_dense_layers(model, algorithm)):
            layer.weight.copy_(torch.from_numpy(arrays[f"dense{k}.w"].copy()))
            layer.bias.copy_(torch.from_numpy(arrays[f"dense{k}.b"].copy()))
    if hasattr(model.policy, "actor_target"):
        model.policy.actor_target.load_state_dict(model.policy.actor.state_dict())


def head_of(algorithm: str) -> str:
    """How an actor's last numbers become actions."""
    return "clip" if algorithm in ("ppo", "recurrent_ppo") else "tanh"


def _array(parameter: torch.Tensor) -> Floats:
    found: Floats = parameter.detach().cpu().numpy().astype(np.float32).copy()
    return found
