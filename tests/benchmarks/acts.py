"""One action of a learned policy by torch, numpy and ONNX: how far apart, and how long each takes.

python -m tests.benchmarks.acts [POLICY ...]
"""

from __future__ import annotations

import dataclasses
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import torch

from agents.learning.export import OnnxNetwork, export_onnx
from agents.learning.networks import FeaturesExtractor, mlp
from agents.learning.sb3 import flatten_observations
from agents.learning.weights import Network, Weights, find_weights, load_weights, shipped
from wheelchair_gym.config import load
from wheelchair_gym.envs import EnvSettings, NavigationVectorEnv
from wheelchair_gym.envs.settings import BankSettings
from wheelchair_gym.task.observations import PRIVILEGED

ROWS, STEPS, SEED = 100, 100, 11
ACTS = 2000  # of each, timed one by one


def observed(weights: Weights) -> Any:
    """Flat observations (ROWS * STEPS, room) as the policy meets them where it drives."""
    own = load(EnvSettings, weights.card["env"], "weights: env")
    own = dataclasses.replace(own, bank=BankSettings(20, 0.0, SEED),
                              task=dataclasses.replace(own.task, privileged=False))  # fmt: skip
    env, network = NavigationVectorEnv(ROWS, own, autoreset_mode="SameStep"), Network(weights)
    seen, _ = env.reset(seed=SEED)
    network.reset(ROWS)
    kept = []
    for _ in range(STEPS):
        kept.append(flatten_observations(seen))
        seen, *_ = env.step(network(kept[-1]))
    env.close()
    return np.concatenate(kept)


def torch_network(weights: Weights) -> torch.nn.Module:
    """The actor as torch has it."""
    layout = weights.layout
    sizes = tuple((key, n) for key, n in layout.sizes if key not in PRIVILEGED)
    layout = dataclasses.replace(layout, sizes=sizes)
    hidden = tuple(len(weights.arrays[f"dense{k}.b"]) for k in range(weights.dense_layers - 1))
    layers = mlp(layout.actor_size, hidden)
    last = torch.nn.Linear(hidden[-1], 2)
    dense = [m for m in (*layers, last) if isinstance(m, torch.nn.Linear)]
    with torch.no_grad():
        for k, layer in enumerate(dense):
            layer.weight.copy_(torch.from_numpy(weights.arrays[f"dense{k}.w"]))
            layer.bias.copy_(torch.from_numpy(weights.arrays[f"dense{k}.b"]))
    space = gym.spaces.Box(-np.inf, np.inf, (layout.size,))
    head = torch.nn.Tanh() if weights.card["head"] == "tanh" else torch.nn.Hardtanh()
    return torch.nn.Sequential(FeaturesExtractor(space, layout), layers, last, head)


def microseconds(act: Any, seen: Any) -> float:
    """Median time of an act on one observation."""
    times = []
    for k in range(ACTS):
        row = seen[k % len(seen)][None]
        begun = time.perf_counter()
        act(row)
        times.append(time.perf_counter() - begun)
    return float(1e6 * np.median(times))


def main() -> None:
    """Print a line for each policy."""
    torch.set_num_threads(1)
    for name in sys.argv[1:] or list(shipped()):
        weights = load_weights(find_weights(name))
        if weights.lstm_size:
            print(f"{name}: has a memory, which is not compared here")
            continue
        seen, plain, module = observed(weights), Network(weights), torch_network(weights)
        with tempfile.TemporaryDirectory() as folder, torch.no_grad():
            export_onnx(weights, Path(folder) / "policy.onnx")
            exported = OnnxNetwork(Path(folder) / "policy.onnx")

            def by_torch(rows: Any, module: Any = module) -> Any:
                return module(torch.from_numpy(rows)).numpy()

            truth = by_torch(seen)
            told = [f"torch {microseconds(by_torch, seen):.0f} us"]
            for way, act in (("numpy", plain), ("ONNX", exported)):
                apart = np.abs(act(seen) - truth).max()
                told.append(f"{way} {microseconds(act, seen):.0f} us (differs by {apart:.1e})")
        print(f"{name}, {len(seen):,} observations: {', '.join(told)} per act")


if __name__ == "__main__":
    main()
