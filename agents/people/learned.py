"""Learned assistants: a trained network changes the twist that a compiled assistant gives.

The network observes the stick, its history and the chair's sensors. What it adds to the twist of
the compiled assistant, its base, is a residual (Johannink et al. 2019; for shared control Schaff
and Walter 2020), kept within the base's freedom: it cannot move a chair whose stick is centred.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from agents.learning.weights import find_weights
from agents.people.assistant import AssistMission, Freedom
from agents.policies.learned import Trained, read_network
from wheelchair_gym.base.arrays import Array
from wheelchair_gym.base.settings import InputError, setting, settings
from wheelchair_gym.maps import OccupancyGrid
from wheelchair_gym.people.assistance import make_compiled
from wheelchair_gym.people.assistance.step import Assistants
from wheelchair_gym.task.task import Task
from wheelchair_gym.types import Episode, Reading, Stick


@settings
class Residual:
    """Adds to what `shared_dwa` makes of the stick."""

    weights: str = setting(default="residual")
    """Name of weights that come with the package, or a file of them."""

    def __post_init__(self) -> None:
        find_weights(self.weights)  # which refuses what is unknown

    def make(self) -> LearnedAssistant:
        """A fresh assistant.

        Raises:
            InputError: there are no such weights, they are incomplete, or a policy's.
        """
        path = find_weights(self.weights)
        made = LearnedAssistant(*read_network(path))
        if not made.layout.is_assistant or made.env.assistant is None:
            raise InputError(f"{path}: expected an assistant's weights (train with env.assistant)")
        return made


@settings
class PpoAssist(Residual):
    """Adds to the stick itself."""

    weights: str = setting(default="ppo_assist")
    """Name of weights that come with the package, or a file of them."""


class LearnedAssistant(Trained):
    """A compiled assistant and, as often as in training, what a network adds to its twist."""

    @property
    def freedom(self) -> Freedom:
        """Its freedom: that of its base."""
        freedom: Freedom = make_compiled(self.env.assistant).freedom
        return freedom

    def reset(self, mission: AssistMission) -> None:
        """See `Assistant.reset`."""
        period = self.begin_episode(mission.sensors, mission.period)
        self._base = Assistants(
            make_compiled(self.env.assistant), mission.chair, mission.sensors, mission.period
        )
        self._base.begin()
        settings = dataclasses.replace(self.env.task, privileged=False, aim="goal")
        self.observe_by(Task(settings, mission.chair, mission.sensors, period, has_driver=True))
        self._began = False

    def assist(self, stick: Stick, reading: Reading, map: OccupancyGrid | None) -> Array:
        """See `Assistant.assist`; the map is not looked at."""
        if not self._began:
            self._begin(reading)
        self._base.update(stick, reading)
        if self.is_due(reading):
            self.task.take_stick(stick, reading.pose, reading.twist)
            a_v, a_w = self.action(reading).tolist()
            self._residual = a_v, a_w
        return self._base.twist(self._residual)

    def _begin(self, reading: Reading) -> None:
        """Begin with the first reading; no goal is known, and nothing of it is observed."""
        nowhere = Episode(OccupancyGrid(np.zeros((1, 1), np.int8), 1.0), np.zeros(3), np.zeros(3))
        self.task.begin(self.task.prepare(nowhere), reading, 0, True)
        self._began = True
