"""A trained network at work: what it observes is made as in training, and it acts as often."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from agents.learning.features import Layout
from agents.learning.weights import Network, load_weights
from wheelchair_gym.base.arrays import Array, Floats
from wheelchair_gym.base.settings import InputError, load
from wheelchair_gym.envs.settings import EnvSettings
from wheelchair_gym.sensors.settings import SensorSettings
from wheelchair_gym.task.task import Task
from wheelchair_gym.types import Reading

_ELSE = "; give the settings of the chair that it was trained with (--config)"


def read_network(path: Path) -> tuple[Callable[[Floats], Floats], dict[str, Any]]:
    """The network in a file of weights (.npz, .onnx), and its card.

    Raises:
        InputError: the file cannot be read, or is not complete.
    """
    if path.suffix == ".onnx":
        from agents.learning.export import OnnxNetwork

        onnx = OnnxNetwork(path)
        return onnx, onnx.card
    weights = load_weights(path)
    return Network(weights), weights.card


class Trained:
    """A network with the task that makes its observations.

    Args:
        network: gives actions (n, 2) in [-1, 1] for flat observations (n, size).
        card: of its weights.

    Attributes:
        env: settings of the environment of its training.
        layout: of its observations.
        observation: the flat observation (n,) that its last action is for.
    """

    def __init__(self, network: Callable[[Floats], Floats], card: Mapping[str, Any]) -> None:
        self.network: Any = network
        self.env = load(EnvSettings, card["env"], "weights: env")
        self.layout = Layout.of_card(card)

    def begin_episode(self, sensors: SensorSettings, period: float) -> float:
        """Begin an episode on a chair with these sensors; the period of actions [s].

        Args:
            sensors: those of the chair.
            period: of control [s].

        Raises:
            InputError: the network was trained with other sensors or at another rate.
        """
        acts_every = 1.0 / self.env.rate
        self._hold = max(1, round(acts_every / period))
        if not math.isclose(self._hold * period, acts_every, rel_tol=1e-6):
            raise InputError(
                f"the policy acts at {self.env.rate:g} Hz; a control period of {period:g} s is "
                "no whole part of that"
            )
        if len(sensors.ultrasonic.mounted) != dict(self.layout.sizes).get("ultrasonic", 0):
            raise InputError(
                f"the policy was trained with other ultrasonics than this chair has{_ELSE}"
            )
        if len(sensors.lasers) != len(self.env.sensors.lasers):
            raise InputError(f"the policy was trained with other lasers than this chair has{_ELSE}")
        self.observation: Floats | None = None
        self._intervention = np.zeros(2)
        self._steps = 0
        return self._hold * period

    def observe_by(self, task: Task) -> None:
        """Set the task that makes the observations.

        Raises:
            InputError: its observations have other sizes than those of training.
        """
        sizes = dict(self.layout.sizes)
        for key, box in task.spaces.items():
            if sizes.get(key, box.shape[0]) != box.shape[0]:
                raise InputError(
                    f"the policy was trained with {sizes[key]} numbers of {key}; this chair's "
                    f"sensors give {box.shape[0]}{_ELSE}"
                )
        self.task = task

    def is_due(self, reading: Reading) -> bool:
        """Count a control period; whether an action is due in it."""
        self._intervention += np.divide(reading.shield_intervention, self._hold)
        self._steps += 1
        return (self._steps - 1) % self._hold == 0

    def action(self, reading: Reading) -> Array:
        """The action (2,) in [-1, 1] for a reading."""
        # The twist driven may be less than commanded: `deploy` begins slowly.
        less = float(self._intervention[0]), float(self._intervention[1])
        self._intervention[:] = 0.0
        seen = self.task.assess(reading, reading.action, less)
        self.observation = np.concatenate(
            [seen[key] for key, _ in self.layout.sizes if key in seen]
        )
        action: Array = self.network(self.observation[None])[0].astype(np.float64)
        return action
