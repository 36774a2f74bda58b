"""A person drives with an assistant, which gets the stick and the sensors, and not the goal."""

from __future__ import annotations

from typing import Any

import numpy as np

from agents.people import make_assistant
from agents.people.assistant import AssistMission
from wheelchair_gym.base.settings import setting, settings
from wheelchair_gym.types import Command, Mission, Reading


@settings
class Assisted:
    """Drives as an assistant makes of a person's stick; without a person the chair stands."""

    assist: Any = setting(default="slide")
    """The assistant: a name of `agents.people`, module:Class, or a mapping with a name."""

    def __post_init__(self) -> None:
        make_assistant(self.assist)  # which refuses what is wrong

    def make(self) -> AssistedDriver:
        """A fresh policy."""
        return AssistedDriver(self)


class AssistedDriver:
    """Gives an assistant what it may know."""

    def __init__(self, config: Assisted) -> None:
        self.config = config
        self._assistant = make_assistant(config.assist)

    def reset(self, mission: Mission) -> None:
        """See `Policy.reset`."""
        self._assistant.reset(AssistMission(mission.chair, mission.sensors, mission.period))
        self._mission = mission

    def act(self, reading: Reading) -> Command:
        """See `Policy.act`."""
        stick = reading.stick
        if stick is None:
            return Command(np.zeros(2))
        known = self._mission.map if self._mission.map is not None else reading.map
        return Command(self._assistant.assist(stick, reading, known))
