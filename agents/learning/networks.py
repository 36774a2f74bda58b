"""Models and networks of stable-baselines3, with a critic that gets more than the actor.

Their classes inherit, as that library requires. PPO, its loss and its update are that library's.
What differs is where the work of its collection is done:

- The features of an observation have no parameters: they are computed once, not in every epoch.
- The critic values a whole rollout in one batch, not step by step.
- The actor runs on one thread while it drives. On more, the threads of torch would go on spinning
  for milliseconds after each step, on the cores that the environments need.
- A GPU, where there is one, holds networks and rollouts; environments stay on the processor.
- Hidden layers may be computed in bfloat16 (`AsymmetricPolicy.in_bfloat16`).
"""

from collections.abc import Generator
from typing import Any

import gymnasium as gym
import numpy as np
import torch
from stable_baselines3 import PPO, SAC, TD3
from stable_baselines3.common.buffers import RolloutBuffer
from stable_baselines3.common.logger import Logger
from stable_baselines3.common.noise import NormalActionNoise, VectorizedActionNoise
from stable_baselines3.common.policies import ActorCriticPolicy
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor, create_mlp
from stable_baselines3.common.type_aliases import RolloutBufferSamples
from torch import nn

from agents.learning.sb3 import SB3VecEnv
from agents.learning.settings import Training
from agents.learning.weights import Layout, Network, Weights, features
from wheelchair_gym.base.arrays import Floats
from wheelchair_gym.base.settings import InputError, dump, load
from wheelchair_gym.envs import EnvSettings
from wheelchair_gym.task.observations import PRIVILEGED


class FeaturesExtractor(BaseFeaturesExtractor):
    """Features of a flat observation: the actor's, the critic's own, and a teacher's action."""

    def __init__(
        self, space: gym.Space[Any], layout: Layout, teacher: "Teacher | None" = None
    ) -> None:
        taught = 0 if teacher is None else 2
        super().__init__(space, layout.actor_size + layout.privileged_size + taught)
        self.layout, self.teacher = layout, teacher
        self.scaled: torch.Tensor
        self.scales: torch.Tensor
        self.private: torch.Tensor
        self.register_buffer("scaled", torch.from_numpy(layout.scaled_indices))
        self.register_buffer("scales", torch.from_numpy(layout.scales))
        self.register_buffer("private", torch.from_numpy(layout.privileged_scales))

    def forward(self, observations: torch.Tensor) -> torch.Tensor:
        """Return features (n, features_dim) of observations (n, size)."""
        public = self.layout.size - self.layout.privileged_size
        found = features(torch, observations[:, :public], self.layout, self.scaled, self.scales)
        parts = [found, observations[:, public:] * self.private]
        if self.teacher is not None:
            parts.append(self.teacher(observations))
        return torch.cat(parts, -1)


class SeparateNetworks(nn.Module):
    """Separate hidden layers of actor and critic; the actor does not get privileged features."""

    def __init__(self, actor_size: int, privileged_size: int, hidden: tuple[int, ...]) -> None:
        super().__init__()
        self.actor_size, self.critic_size = actor_size, actor_size + privileged_size
        self.latent_dim_pi = self.latent_dim_vf = hidden[-1]
        self.actor = mlp(actor_size, hidden)
        self.critic = mlp(self.critic_size, hidden)

    def forward(self, x: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Return latent vectors of actor and critic."""
        return self.forward_actor(x), self.forward_critic(x)

    def forward_actor(self, x: torch.Tensor) -> torch.Tensor:
        """Return the latent vector of the actor."""
        return self.actor(x[:, : self.actor_size])  # type: ignore[no-any-return]

    def forward_critic(self, x: torch.Tensor) -> torch.Tensor:
        """Return the latent vector of the critic."""
        return self.critic(x[:, : self.critic_size])  # type: ignore[no-any-return]


def mlp(size: int, hidden: tuple[int, ...]) -> nn.Sequential:
    """Dense layers, each followed by a rectifier."""
    return nn.Sequential(*create_mlp(size, 0, list(hidden)))


class Teacher:
    """A trained actor whose observations are those of its student's critic.

    Raises:
        InputError: the student's observation lacks a key that the teacher needs.
    """

    def __init__(self, weights: Weights, layout: Layout, env: EnvSettings) -> None:
        its = load(EnvSettings, weights.card["env"], "teacher: env")
        for name, here, there in (
            ("rate", env.rate, its.rate),
            ("task.look_ahead_time", env.task.look_ahead_time, its.task.look_ahead_time),
        ):
            if here != there:
                raise InputError(f"teacher: its {name} is {there}; expected {here}")
        indices = []
        for key, size in weights.layout.sizes:
            if key in PRIVILEGED:
                continue
            at = layout.slice_of(f"privileged_{key}")
            at = at if at.stop else layout.slice_of(key)
            if at.stop - at.start != size:
                raise InputError(
                    f"teacher: it needs {size} numbers of {key}; observed are {at.stop - at.start}"
                )
            indices.append(np.arange(at.start, at.stop))
        self._indices, self._network = np.concatenate(indices), Network(weights)

    def __call__(self, observations: torch.Tensor) -> torch.Tensor:
        """Actions (n, 2) in [-1, 1] for a student's flat observations (n, size)."""
        actions = self._network(observations.cpu().numpy()[:, self._indices])
        return torch.as_tensor(actions, device=observations.device)


class AsymmetricPolicy(ActorCriticPolicy):
    """Actor and critic of PPO with separate networks (asymmetric: Pinto et al. 2018)."""

    in_bfloat16 = False  # compute hidden layers in bfloat16 while learning
    kickstart_weight = 0.0  # of the squared distance to the teacher's action

    def _build_mlp_extractor(self) -> None:
        layout: Layout = self.features_extractor_kwargs["layout"]
        hidden = tuple(self.net_arch["pi"])  # type: ignore[call-overload]
        self.mlp_extractor = SeparateNetworks(layout.actor_size, layout.privileged_size, hidden)  # type: ignore[assignment]

    def action_distribution(self, features: torch.Tensor) -> Any:
        """Return the distribution of actions, given features (n, features_dim)."""
        with torch.autocast(self.device.type, torch.bfloat16, self.in_bfloat16):
            latent = self.mlp_extractor.forward_actor(features)
        return self._get_action_dist_from_latent(latent.float())

    def values(self, features: torch.Tensor) -> torch.Tensor:
        """Return the critic's values (n,), given features (n, features_dim)."""
        return self.value_net(self.mlp_extractor.forward_critic(features)).flatten()  # type: ignore[no-any-return]

    def evaluate_actions(
        self, obs: Any, actions: torch.Tensor
    ) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor | None]:
        """Values, log-probabilities, and entropy less the kickstarting loss (Schmitt et al. 2018).

        PPO maximises the last one with the weight `ent_coef`.

        Args:
            obs: features (n, features_dim), not observations: a `Rollout` holds features.
            actions: (n, 2).
        """
        with torch.autocast(self.device.type, torch.bfloat16, self.in_bfloat16):
            actor, critic = self.mlp_extractor(obs)
        distribution: Any = self._get_action_dist_from_latent(actor.float())
        bonus = distribution.entropy()
        if self.kickstart_weight > 0.0:
            error = distribution.distribution.mean - obs[:, -2:]
            bonus = bonus - self.kickstart_weight * (error * error).sum(dim=1)
        return self.value_net(critic.float()), distribution.log_prob(actions), bonus


def make_model(
    config: Training, seed: int, env: SB3VecEnv, layout: Layout, teacher: "Teacher | None" = None
) -> Any:
    """Make a new model, whose learning rate decreases linearly over the run.

    Raises:
        InputError: a GPU was asked for, and there is none.
    """
    if config.device == "cuda" and not torch.cuda.is_available():
        raise InputError("device is cuda; torch finds no GPU here: expected cpu or auto")
    on_policy = config.algorithm == "ppo"
    options = dump(config.on_policy if on_policy else config.off_policy)
    initial_rate, log_std_init, precision, sigma = (
        options.pop(key, None)
        for key in ("learning_rate", "log_std_init", "precision", "action_noise")
    )
    hidden = list(config.net_arch)
    policy_options: dict[str, Any] = {
        "features_extractor_class": FeaturesExtractor,
        "features_extractor_kwargs": {"layout": layout, "teacher": teacher},
        "net_arch": {"pi": hidden, "vf": hidden} if on_policy else hidden,
        "optimizer_kwargs": {"fused": True},
    }
    if on_policy:
        policy_options |= {"log_std_init": log_std_init, "activation_fn": nn.ReLU}
    else:
        options["train_freq"] = 1
    if config.algorithm == "td3":
        noise = NormalActionNoise(np.zeros(2), np.full(2, sigma))
        options["action_noise"] = VectorizedActionNoise(noise, config.n_envs)
    made: list[Any] = []

    def learning_rate(_: float) -> float:
        """Return the rate at the run's progress; the library gives that between two checkpoints."""
        progress = made[0].num_timesteps / config.frames if made else 0.0
        return float(initial_rate * max(0.0, 1.0 - progress))

    kind: Any = {"ppo": FastPPO, "sac": SAC, "td3": TD3}[config.algorithm]
    model = kind(
        AsymmetricPolicy if on_policy else "MlpPolicy", env, learning_rate=learning_rate,
        policy_kwargs=policy_options, seed=seed, device=config.device, verbose=0, **options,
    )  # fmt: skip
    made.append(model)
    if on_policy:
        on_gpu = model.device.type == "cuda"
        fast = torch.cuda.is_bf16_supported() if on_gpu else torch.cpu._is_avx512_bf16_supported()
        model.policy.in_bfloat16 = precision == "bfloat16" or (precision == "auto" and fast)
    model.set_logger(Logger(None, []))  # by default the library leaves an empty folder in /tmp
    return model


def dense_parameters(*parts: nn.Module) -> dict[str, torch.Tensor]:
    """Return the parameters of the dense layers of networks, by the name of their array."""
    layers = [m for part in parts for m in part.modules() if isinstance(m, nn.Linear)]
    return {
        f"dense{k}.{name}": parameter
        for k, layer in enumerate(layers)
        for name, parameter in (("w", layer.weight), ("b", layer.bias))
    }


def _actor_parameters(model: Any, algorithm: str) -> dict[str, torch.Tensor]:
    """Return the actor's parameters by the name of their array."""
    policy = model.policy
    if algorithm == "ppo":
        return dense_parameters(policy.mlp_extractor.actor, policy.action_net)
    if algorithm == "td3":
        return dense_parameters(policy.actor.mu)
    return dense_parameters(policy.actor.latent_pi, policy.actor.mu)


def arrays_of(parameters: dict[str, torch.Tensor]) -> dict[str, Floats]:
    """Return parameters as arrays."""
    return {
        name: np.array(parameter.detach().cpu().numpy(), np.float32)
        for name, parameter in parameters.items()
    }


def actor_arrays(model: Any, algorithm: str) -> dict[str, Floats]:
    """Return the actor's arrays."""
    return arrays_of(_actor_parameters(model, algorithm))


def load_actor_arrays(model: Any, algorithm: str, arrays: dict[str, Floats]) -> None:
    """Load arrays into the actor and into its target network.

    Raises:
        InputError: they have the shapes of another network.
    """
    given, expected = (
        sorted((name, array.shape) for name, array in of.items())
        for of in (arrays, actor_arrays(model, algorithm))
    )
    if given != expected:
        raise InputError(f"warm_start: layers are {given}; expected {expected}")
    with torch.no_grad():
        for name, parameter in _actor_parameters(model, algorithm).items():
            parameter.copy_(torch.from_numpy(arrays[name].copy()))
    if hasattr(model.policy, "actor_target"):
        model.policy.actor_target.load_state_dict(model.policy.actor.state_dict())


BATCH = 4096  # observations valued at once


class Rollout(RolloutBuffer):
    """A rollout whose observations are features, and minibatches of it."""

    def get(self, batch_size: int | None = None) -> Generator[RolloutBufferSamples, None, None]:
        """All steps in random order, in minibatches."""
        n = self.buffer_size * self.n_envs
        arrays = (
            self.observations, self.actions, self.values, self.log_probs, self.advantages,
            self.returns,
        )  # fmt: skip
        steps = [self.to_torch(array, False).reshape(n, *array.shape[2:]) for array in arrays]
        order = np.random.permutation(n)  # noqa: NPY002 the library's generator, which runs seed
        for first in range(0, n, batch_size or n):
            chosen = self.to_torch(order[first : first + (batch_size or n)], False)
            yield RolloutBufferSamples(*(of.index_select(0, chosen) for of in steps))


class FastPPO(PPO):
    """PPO for an `AsymmetricPolicy`."""

    policy: Any

    def _setup_model(self) -> None:
        super()._setup_model()
        space = gym.spaces.Box(-np.inf, np.inf, (self.policy.features_dim,), np.float32)
        self.rollout_buffer = Rollout(
            self.n_steps, space, self.action_space, self.device, self.gae_lambda, self.gamma,
            self.n_envs,
        )  # fmt: skip

    def collect_rollouts(
        self, env: Any, callback: Any, rollout_buffer: RolloutBuffer, n_rollout_steps: int
    ) -> bool:
        """Drive all environments, and fill the buffer; False if the callback ended the run."""
        self.policy.set_training_mode(False)
        rollout_buffer.reset()
        callback.on_rollout_start()
        low, high = self.action_space.low, self.action_space.high  # type: ignore[attr-defined]
        ends: list[tuple[int, int, Any]] = []  # step, row and last observation of cut episodes
        threads = torch.get_num_threads()
        for step in range(n_rollout_steps):
            torch.set_num_threads(1)
            with torch.no_grad():
                features = self.policy.extract_features(self._tensor(self._last_obs))
                distribution = self.policy.action_distribution(features)
                actions = distribution.get_actions()
                log_probs = distribution.log_prob(actions)
            torch.set_num_threads(threads)
            chosen = actions.cpu().numpy()
            new_obs, rewards, dones, infos = env.step(np.clip(chosen, low, high))
            self.num_timesteps += env.num_envs
            callback.update_locals(locals())
            if not callback.on_step():
                return False
            self._update_info_buffer(infos, dones)
            cut = [k for k in np.flatnonzero(dones).tolist() if infos[k]["TimeLimit.truncated"]]
            ends += [(step, k, infos[k]["terminal_observation"]) for k in cut]
            rollout_buffer.add(
                features.cpu().numpy(), chosen, rewards, self._last_episode_starts,  # type: ignore[arg-type]
                torch.zeros(env.num_envs), log_probs,
            )  # fmt: skip
            self._last_obs, self._last_episode_starts = new_obs, dones
        of = rollout_buffer.observations
        of = of.reshape(-1, of.shape[-1])
        rollout_buffer.values[:] = self._values(of).reshape(rollout_buffer.values.shape)
        if ends:  # an episode that was cut is worth what its last state promises
            steps, rows, last = zip(*ends, strict=True)
            rest = self._values(self.policy.extract_features(self._tensor(np.stack(last))))
            rollout_buffer.rewards[list(steps), list(rows)] += self.gamma * rest
        rest = self._values(self.policy.extract_features(self._tensor(self._last_obs)))
        rollout_buffer.compute_returns_and_advantage(torch.from_numpy(rest), dones)
        callback.update_locals(locals())
        callback.on_rollout_end()
        return True

    def _values(self, features: Any) -> Any:
        """The critic's values (n,) of features (n, features_dim)."""
        parts = [features[k : k + BATCH] for k in range(0, len(features), BATCH)]
        with torch.no_grad():
            values = [self.policy.values(self._tensor(part)) for part in parts]
        return torch.cat(values).cpu().numpy()

    def _tensor(self, array: Any) -> torch.Tensor:
        """An array or a tensor on the device of the networks."""
        return torch.as_tensor(array, device=self.device)
