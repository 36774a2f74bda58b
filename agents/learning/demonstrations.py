"""Imitation: a scripted policy shows how to drive, and what it would do where the student errs.

Behaviour cloning, then DAgger (Ross, Gordon and Bagnell 2011): from the second round on the student
drives and the expert names its own action for each observation. The result may be driven as it is,
or be a run's `warm_start`.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import nn

from agents.evaluation.provenance import command_line, commit, machine, versions, write_json
from agents.learning.features import Layout
from agents.learning.networks import Features, body
from agents.learning.settings import Imitation, environment
from agents.learning.weights import FORMAT, Floats, Network, Weights, save_weights
from agents.policies import make_policy
from wheelchair_gym.config import dump, load
from wheelchair_gym.envs import EnvSettings, NavigationEnv
from wheelchair_gym.envs.settings import StartSettings

_SEED = 7_000_003  # of the first episode, far from those that policies are tested on


def _shown(
    env: NavigationEnv, expert: Any, student: Network | None, seed: int
) -> tuple[Floats, Floats, bool]:
    """Observations (n, room) and the expert's actions (n, 2) of an episode; and its success."""
    observation, info = env.reset(seed=seed)
    expert.reset(env.task)
    if student is not None:
        student.reset(1)
    seen, shown, over = [], [], False
    while not over:
        flat = np.concatenate([observation[key] for key in env.task.boxes])
        told = np.asarray(expert.act(observation), np.float32)
        seen.append(flat)
        shown.append(told)
        action = told if student is None else student(flat[None])[0]
        observation, _, terminated, truncated, info = env.step(action)
        over = terminated or truncated
    return np.array(seen), np.array(shown), bool(info["is_success"])


def _episodes(
    own: EnvSettings, expert: Any, student: Weights | None, seeds: list[int]
) -> list[tuple[Floats, Floats, bool]]:
    env, driver = NavigationEnv(config=own), make_policy(expert)
    network = None if student is None else Network(student)
    try:
        return [_shown(env, driver, network, seed) for seed in seeds]
    finally:
        env.close()


def _gathered(
    own: Imitation, env: EnvSettings, student: Weights | None, seeds: list[int]
) -> Iterator[tuple[Floats, Floats, bool]]:
    """Episodes in the order of their seeds, driven by so many processes."""
    if own.jobs == 1:
        for seed in seeds:
            yield from _episodes(env, own.expert, student, [seed])
        return
    from joblib import Parallel, delayed

    parts = [seeds[k : k + 4] for k in range(0, len(seeds), 4)]
    jobs = (delayed(_episodes)(env, own.expert, student, part) for part in parts)
    for part in Parallel(n_jobs=own.jobs, return_as="generator")(jobs):
        yield from part


def imitate(own: Imitation, seed: int, folder: Path, progress: bool = True) -> dict[str, Any]:
    """Imitate, and keep policy.npz in a folder; what it came to.

    Raises:
        InputError: a setting is wrong, or the folder cannot be written.
    """
    from tqdm import tqdm

    made = environment(own.env)
    env = dataclasses.replace(
        made, task=dataclasses.replace(made.task, privileged=False), starts=StartSettings()
    )
    layout = _layout(env)
    torch.manual_seed(seed)
    net = _Student(layout, own.hidden)
    student: Weights | None = None
    seen, shown, rounds = [], [], []
    bar = tqdm(total=own.rounds * own.episodes, unit="episode", disable=not progress)
    for number in range(own.rounds):
        begin = _SEED + (seed * own.rounds + number) * own.episodes
        success = 0
        for flat, told, done in _gathered(
            own, env, student, list(range(begin, begin + own.episodes))
        ):
            seen.append(flat)
            shown.append(told)
            success += done
            bar.update()
        loss = _fit(net, np.concatenate(seen), np.concatenate(shown), own)
        rounds.append(
            {"driver": "expert" if student is None else "student", "loss": loss,
             "success": success / own.episodes, "steps": sum(map(len, seen))}
        )  # fmt: skip
        card = {
            "format": FORMAT, "algorithm": "bc", "head": "clip",
            "layout": {"sizes": [list(pair) for pair in layout.sizes], "posed": layout.posed},
            "env": dump(env), "training": dump(own), "seed": seed, "rounds": rounds,
            "command": command_line(), "commit": commit(), "machine": machine(),
            "versions": versions(),
            "limits": "it imitates, in simulation; it guarantees nothing: drive it behind a shield",
        }  # fmt: skip
        student = Weights(net.arrays(), card)
        save_weights(folder / "policy.npz", student)
        write_json(folder / "rounds.json", rounds)
    bar.close()
    return rounds[-1]


def _layout(env: EnvSettings) -> Layout:
    task = NavigationEnv(config=env).task
    return Layout.of(((key, box.shape[0]) for key, box in task.boxes.items()), task.posed)


class _Student(nn.Module):
    """The actor of PPO, alone."""

    def __init__(self, layout: Layout, hidden: tuple[int, ...]) -> None:
        super().__init__()
        import gymnasium as gym

        self.features = Features(gym.spaces.Box(-1.0, 1.0, (layout.room,)), layout)
        self.body = body(layout.told, hidden)
        self.last = nn.Linear(hidden[-1], 2)

    def forward(self, flat: torch.Tensor) -> torch.Tensor:
        return self.last(self.body(self.features(flat)))  # type: ignore[no-any-return]

    def arrays(self) -> dict[str, Floats]:
        layers = [m for m in (*self.body, self.last) if isinstance(m, nn.Linear)]
        arrays = {}
        for k, layer in enumerate(layers):
            arrays[f"dense{k}.w"] = layer.weight.detach().numpy().copy()
            arrays[f"dense{k}.b"] = layer.bias.detach().numpy().copy()
        return arrays


def _fit(net: _Student, seen: Floats, shown: Floats, own: Imitation) -> float:
    """Fit the student to what it was shown; the mean squared error of the last epoch."""
    inputs, targets = torch.from_numpy(seen), torch.from_numpy(shown)
    optimiser = torch.optim.Adam(net.parameters(), lr=own.rate)
    loss_sum = 0.0
    for _ in range(own.epochs):
        order, loss_sum = torch.randperm(len(inputs)), 0.0
        for begin in range(0, len(order), own.batch):
            rows = order[begin : begin + own.batch]
            loss = nn.functional.mse_loss(net(inputs[rows]), targets[rows])
            optimiser.zero_grad()
            loss.backward()  # type: ignore[no-untyped-call]
            optimiser.step()
            loss_sum += float(loss.detach()) * len(rows)
    return loss_sum / len(inputs)


def load_imitation(content: dict[str, Any], where: str) -> Imitation:
    """Settings of imitation from a file's content.

    Raises:
        InputError: a setting is wrong.
    """
    own = load(Imitation, content, where)
    environment(own.env)
    make_policy(own.expert)
    return own
