"""Imitation learning: a scripted policy demonstrates, and labels the observations of its student.

Demonstrations may be those of a data set, too, such as recorded drives of a person.

Behaviour cloning, then DAgger (Ross, Gordon and Bagnell 2011): from the second round on the student
drives and the expert labels each observation with its action. The resulting policy can be driven
as it is, or be the `warm_start` of a training run.
"""

import dataclasses
import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import torch
from joblib import Parallel, delayed
from torch import nn
from tqdm import tqdm

from agents.evaluation.provenance import write_json
from agents.learning.networks import FeaturesExtractor, arrays_of, dense_parameters, mlp
from agents.learning.settings import Imitation, training_env_settings
from agents.learning.weights import Layout, Network, Weights, make_card, save_weights
from agents.policies import GymPolicy, make_policy
from wheelchair_gym.base.arrays import Floats
from wheelchair_gym.base.settings import InputError, load
from wheelchair_gym.envs import EnvSettings, NavigationEnv

_FIRST_SEED = 7_000_003  # of the first episode, apart from the seeds on which weights are chosen
Demonstration = tuple[Floats, Floats, bool]  # observations (n, size), actions (n, 2), success


def _demonstrate(
    env: NavigationEnv, expert: GymPolicy, student: Network | None, seed: int
) -> Demonstration:
    """One episode, labelled with the expert's actions; the student drives it, if there is one."""
    observation, info = env.reset(seed=seed)
    expert.reset()
    observations, actions, over = [], [], False
    while not over:
        flat = np.concatenate([observation[key] for key in env.task.spaces])
        label = np.asarray(expert.act(observation), np.float32)
        observations.append(flat)
        actions.append(label)
        action = label if student is None else student(flat[None])[0]
        observation, _, terminated, truncated, info = env.step(action)
        over = terminated or truncated
    return np.array(observations), np.array(actions), bool(info["is_success"])


def _episodes(
    settings: EnvSettings, expert: Any, student: Weights | None, seeds: list[int]
) -> list[Demonstration]:
    env = NavigationEnv(config=settings)
    policy = GymPolicy(make_policy(expert), env)
    network = None if student is None else Network(student)
    try:
        return [_demonstrate(env, policy, network, seed) for seed in seeds]
    finally:
        env.close()


def _all_episodes(
    config: Imitation, env: EnvSettings, student: Weights | None, seeds: list[int]
) -> Iterator[Demonstration]:
    """Episodes in the order of their seeds, driven by `config.jobs` processes."""
    size = 1 if config.jobs == 1 else 4
    parts = [seeds[k : k + size] for k in range(0, len(seeds), size)]
    jobs = (delayed(_episodes)(env, config.expert, student, part) for part in parts)
    for part in Parallel(n_jobs=config.jobs, return_as="generator")(jobs):
        yield from part


def _load_dataset(name: str) -> tuple[Any, EnvSettings]:
    """A Minari data set, and the settings of its environment, which has to be this project's."""
    try:
        import minari

        data: Any = minari.load_dataset(name)
        env: Any = data.recover_environment().unwrapped
        return data, env.settings
    except ImportError:
        raise InputError("data sets need minari; pip install 'wheelchair_gym[dataset]'") from None
    except Exception as error:  # its reader documents no errors
        folder = os.environ.get("MINARI_DATASETS_PATH", "~/.minari/datasets")
        expected = f"expected one that wheelchair dataset wrote, in {folder}"
        raise InputError(f"dataset {name!r}: {expected} (MINARI_DATASETS_PATH)") from error


def _stored_episodes(data: Any, keys: Sequence[str]) -> Iterator[Demonstration]:
    """The episodes of a data set, with their observation keys in this order."""
    metadata = data.storage.get_episode_metadata(range(data.total_episodes))
    for episode, about in zip(data.iterate_episodes(), metadata, strict=True):
        parts = [episode.observations[key][:-1] for key in keys]
        yield np.concatenate(parts, axis=-1), episode.actions, bool(about.get("success"))


def imitate(config: Imitation, seed: int, folder: Path, progress: bool = True) -> dict[str, Any]:
    """Imitate, and write policy.npz to a folder; the figures of the last round.

    Raises:
        InputError: a setting is wrong, or the folder cannot be written.
    """
    stored, spec = (None, config.env) if config.dataset is None else _load_dataset(config.dataset)
    env = training_env_settings(spec)
    task = dataclasses.replace(env.task, privileged=False)
    env = dataclasses.replace(env, task=task, starts_within=0.0)
    layout = Layout.of_task(NavigationEnv(config=env).task)
    torch.manual_seed(seed)
    space = gym.spaces.Box(-1.0, 1.0, (layout.size,))
    network = nn.Sequential(  # the actor of PPO alone
        FeaturesExtractor(space, layout),
        *mlp(layout.actor_size, config.net_arch),
        nn.Linear(config.net_arch[-1], 2),
    )
    student: Weights | None = None
    observations, actions, rounds = [], [], []
    n = config.rounds if stored is None else 1
    total = config.episodes * n if stored is None else stored.total_episodes
    bar = tqdm(total=total, unit="episode", disable=not progress)
    for number in range(n):
        first = _FIRST_SEED + (seed * n + number) * config.episodes
        seeds = list(range(first, first + config.episodes))
        success, driven = 0, 0
        for episode_observations, episode_actions, is_success in (
            _all_episodes(config, env, student, seeds) if stored is None
            else _stored_episodes(stored, [key for key, _ in layout.sizes])
        ):  # fmt: skip
            observations.append(episode_observations)
            actions.append(episode_actions)
            success += is_success
            driven += 1
            bar.update()
        inputs, targets = (torch.from_numpy(np.concatenate(of)) for of in (observations, actions))
        loss = _fit(network, inputs, targets, config)
        who = "data set" if stored else "expert" if student is None else "student"
        rounds.append(
            {"driver": who, "loss": loss,
             "success": success / driven, "steps": sum(map(len, observations))}
        )  # fmt: skip
        card = make_card(
            "bc", "clip", layout, env, config, seed,
            limits="it imitates, in simulation; it guarantees nothing: drive it behind a shield",
        )  # fmt: skip
        student = Weights(arrays_of(dense_parameters(network)), card | {"rounds": rounds})
        save_weights(folder / "policy.npz", student)
        write_json(folder / "rounds.json", rounds)
    bar.close()
    return rounds[-1]


def _fit(
    network: nn.Module, inputs: torch.Tensor, targets: torch.Tensor, config: Imitation
) -> float:
    """Fit the student to the expert's actions; the mean squared error of the last epoch."""
    optimizer = torch.optim.Adam(network.parameters(), lr=config.learning_rate)
    total = 0.0
    for _ in range(config.n_epochs):
        order, total = torch.randperm(len(inputs)), 0.0
        for first in range(0, len(order), config.batch_size):
            rows = order[first : first + config.batch_size]
            loss = nn.functional.mse_loss(network(inputs[rows]), targets[rows])
            optimizer.zero_grad()
            loss.backward()  # type: ignore[no-untyped-call]
            optimizer.step()
            total += float(loss.detach()) * len(rows)
    return total / len(inputs)


def load_imitation(content: dict[str, Any], where: str) -> Imitation:
    """Settings of imitation from a file's content.

    Raises:
        InputError: a setting is wrong.
    """
    config = load(Imitation, content, where)
    training_env_settings(config.env)
    make_policy(config.expert)
    return config
