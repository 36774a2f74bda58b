"""A person drives: arrow keys or WASD in the window, or a joystick or gamepad."""

from __future__ import annotations

import numpy as np

from wheelchair_gym.base.settings import InputError, settings
from wheelchair_gym.types import Command, Mission, Reading

FAST, SLOW = 0.6, 0.24  # shares of the full twist that a key asks for; SLOW while shift is held
DEAD_ZONE = 0.12  # share of a stick's travel that counts as released


@settings
class Manual:
    """Settings of a person who drives; needs the window, which must have keyboard focus."""

    def make(self) -> ManualPolicy:
        """Make a fresh policy."""
        return ManualPolicy()


class ManualPolicy:
    """Policy that reads keys and sticks at each step."""

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
        """See `Policy.act`; once the window is closed, the chair stops and the command is done.

        That ends a drive that draws a map (`map_by_driving`). A simulated drive (`drive_episode`)
        goes on until its episode ends.
        """
        pygame = self._pygame
        if not pygame.display.get_init():
            return Command(np.zeros(2), done=True)
        keys = pygame.key.get_pressed()

        def held(*names: int) -> float:
            return float(any(keys[name] for name in names))

        v = held(pygame.K_UP, pygame.K_w) - held(pygame.K_DOWN, pygame.K_s)
        w = held(pygame.K_LEFT, pygame.K_a) - held(pygame.K_RIGHT, pygame.K_d)
        share = SLOW if held(pygame.K_LSHIFT, pygame.K_RSHIFT) else FAST
        action = share * np.array([v, w])
        for stick in self._sticks:
            if stick.get_numaxes() >= 2 and not action.any():
                tilt = -np.array([stick.get_axis(1), stick.get_axis(0)])  # forward, to the left
                action = np.where(np.abs(tilt) > DEAD_ZONE, tilt, 0.0)
        return Command.from_action(np.clip(action, -1.0, 1.0), self._limits)
