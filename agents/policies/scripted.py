"""Policies without planning or learning: random, straight, and a person at the keys."""

import math

import numpy as np

from wheelchair_gym.base.errors import imports
from wheelchair_gym.base.settings import InputError, setting, settings
from wheelchair_gym.types import Command, Mission, Reading


def episode_rng(mission: Mission, seed: int) -> np.random.Generator:
    """Random draws of an episode: the same for the same episode and seed."""
    return np.random.default_rng([seed, mission.key])


HOLD = 0.5  # s for which each random action is held; inertia averages out shorter ones


@settings
class RandomPolicy:
    """Twists drawn evenly, each held for a while."""

    seed: int = setting(default=0, low=0)
    """Seed of the actions, with the episode's key."""

    def make(self) -> "RandomDriver":
        """A fresh policy."""
        return RandomDriver(self)


class RandomDriver:
    """Holds one random action after another."""

    def __init__(self, config: RandomPolicy) -> None:
        self.config = config

    def reset(self, mission: Mission) -> None:
        """See `Policy.reset`."""
        self._limits, self._rng = mission.limits, episode_rng(mission, self.config.seed)
        self._held = max(1, round(HOLD / mission.period))
        self._count = 0

    def act(self, reading: Reading) -> Command:
        """See `Policy.act`."""
        if self._count % self._held == 0:
            self._command = Command.from_action(self._rng.uniform(-1.0, 1.0, 2), self._limits)
        self._count += 1
        return self._command


_GAIN = 1.5  # 1/s: turn rate per heading error
_PIVOT = 0.5  # rad: heading error above which the chair turns in place


@settings
class StraightPolicy:
    """Turns to the goal and drives there, whatever stands between."""

    def make(self) -> "StraightDriver":
        """A fresh policy."""
        return StraightDriver()


class StraightDriver:
    """Steers for the goal."""

    def reset(self, mission: Mission) -> None:
        """See `Policy.reset`."""
        self._goal, self._limits = mission.goal, mission.limits

    def act(self, reading: Reading) -> Command:
        """See `Policy.act`."""
        (x, y, yaw), goal = reading.pose, self._goal
        error = math.remainder(math.atan2(goal[1] - y, goal[0] - x) - yaw, 2 * math.pi)
        v = self._limits.forward * max(0.0, 1.0 - abs(error) / _PIVOT)
        return Command(np.array([v, _GAIN * error]))


FAST, SLOW = 0.6, 0.24  # shares of the full twist that a key asks for; SLOW while shift is held
DEAD_ZONE = 0.12  # share of a stick's travel that counts as released


@settings
class Manual:
    """Settings of a person who drives by arrow keys or WASD, or by a joystick or gamepad.

    It needs the window, which must have keyboard focus.
    """

    def make(self) -> "ManualPolicy":
        """Make a fresh policy."""
        return ManualPolicy()


class ManualPolicy:
    """Policy that reads keys and sticks at each step."""

    def reset(self, mission: Mission) -> None:
        """See `Policy.reset`.

        Raises:
            InputError: there is no window.
        """
        with imports("policy manual needs pygame-ce", "view"):
            import pygame
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
