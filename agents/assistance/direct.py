"""No assistance: the stick is the twist, with or without the shield behind it."""

from __future__ import annotations

from typing import ClassVar

from agents.assistance.assistant import (
    AssistInput,
    AssistMission,
    Freedom,
    Plain,
    SharedAssistant,
    Twist,
)
from wheelchair_gym.config import settings


@settings
class Direct:
    """The stick is the twist; nothing is filtered."""

    shielded: ClassVar[bool] = False

    def make(self) -> SharedAssistant:
        """A fresh assistant."""
        return SharedAssistant(Plain(_asked), Freedom())


@settings
class Shielded:
    """The stick is the twist, behind the shield."""

    def make(self) -> SharedAssistant:
        """A fresh assistant."""
        return SharedAssistant(Plain(_asked), Freedom())


def _asked(mission: AssistMission, now: AssistInput) -> Twist:
    return now.asked
