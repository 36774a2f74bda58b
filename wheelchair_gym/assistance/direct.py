"""No assistance: the stick is the twist, with or without the shield behind it."""

from __future__ import annotations

from typing import ClassVar

from wheelchair_gym.assistance.freedom import Freedom
from wheelchair_gym.config import settings


@settings
class Direct:
    """The stick is the twist; nothing is filtered."""

    shielded: ClassVar[bool] = False
    freedom: Freedom = Freedom(backward=2.0)


@settings
class Shielded:
    """The stick is the twist, behind the shield."""

    freedom: Freedom = Freedom(backward=2.0)
