"""stable-baselines3's PPO with a faster collection.

The algorithm, its loss and its update are that library's. What differs is where the work is done:

- The features of an observation have no parameters: they are computed once, not in every epoch.
- The critic values a whole rollout in one batch, not step by step.
- The actor runs on one thread while it drives. On more, the threads of torch would go on spinning
  for milliseconds after each step, on the cores that the environments need.
- A GPU, where there is one, holds networks and rollouts; environments stay on the processor.
- Hidden layers may be computed in bfloat16 (`AsymmetricPolicy.in_bfloat16`).
"""

from __future__ import annotations

from collections.abc import Generator
from typing import Any

import gymnasium as gym
import numpy as np
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.buffers import RolloutBuffer
from stable_baselines3.common.type_aliases import RolloutBufferSamples

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
