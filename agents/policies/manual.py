"""A person drives: arrow keys or WASD in the window, or a joystick or gamepad."""

from __future__ import annotations

import numpy as np

from wheelchair_gym.config import InputError, setting, settings
from wheelchair_gym.types import Command, Mission, Reading


@settings
class Manual:
    """Drives as a person's hands say; needs the window, which has the keyboard's attention."""

    speed: float = setting(default=0.6, low=0.0, high=1.0, source="design choice")
    """Share of the full speed that a key asks for."""
    turn: float = setting(default=0.6, low=0.0, high=1.0, source="design choice")
    """Share of the full turn rate that a key asks for."""
    slow: float = setting(default=0.4, low=0.0, high=1.0, source="design choice")
    """Factor on both while shift is held."""
    idle: float = setting(default=0.12, low=0.0, high=0.9, source="design choice")
    """Dead zone of a stick, as a share of its travel."""

    def make(self) -> Driver:
        """A fresh policy."""
        return Driver(self)


class Driver:
    """Reads keys and sticks each time it is asked to act."""

    def __init__(self, config: Manual) -> None:
        self.config = config

    def reset(self, mission: Mission) -> None:
        """See `Policy.reset`.

        Raises:
            InputError: there is no window.
        """
        try:
            import pygame
        except ImportError:
            raise InputError(
                "policy manual needs pygame-ce: pip install 'wheelchair_gym[view]'"
            ) from None
        if not pygame.display.get_init():
            raise InputError("policy manual: expected a window (--window), whose keys it reads")
        self._pygame, self._limits = pygame, mission.limits
        pygame.joystick.init()
        self._sticks = [pygame.joystick.Joystick(k) for k in range(pygame.joystick.get_count())]

    def act(self, reading: Reading) -> Command:
        """See `Policy.act`; at rest, and done, once the window is closed."""
        pygame, config = self._pygame, self.config
        if not pygame.display.get_init():
            return Command(np.zeros(2), done=True)
        keys = pygame.key.get_pressed()

        def held(*names: int) -> float:
            return float(any(keys[name] for name in names))

        v = held(pygame.K_UP, pygame.K_w) - held(pygame.K_DOWN, pygame.K_s)
        w = held(pygame.K_LEFT, pygame.K_a) - held(pygame.K_RIGHT, pygame.K_d)
        share = config.slow if held(pygame.K_LSHIFT, pygame.K_RSHIFT) else 1.0
        action = share * np.array([config.speed * v, config.turn * w])
        for stick in self._sticks:
            if stick.get_numaxes() >= 2 and not action.any():
                tilt = -np.array([stick.get_axis(1), stick.get_axis(0)])  # ahead, to the left
                action = np.where(np.abs(tilt) > config.idle, tilt, 0.0)
        return Command.from_action(np.clip(action, -1.0, 1.0), self._limits)
