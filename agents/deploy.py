"""A policy on a real chair: slowly at first, with a log of all that happens, and always stopped."""

from __future__ import annotations

import signal
import sys
import threading
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from agents.evaluate import drive_episode
from agents.metrics import Record
from agents.policy import Policy
from wheelchair_gym.config import InputError, setting, settings
from wheelchair_gym.hardware.chair import BY_HAND
from wheelchair_gym.mapping.chair import bare
from wheelchair_gym.types import Episode

Array = NDArray[np.float64]
Say = Callable[[str], None]


@settings
class Deployment:
    """How fast a policy may drive, and how long it may be kept from driving."""

    first: float = setting(
        default=0.2, unit="m/s", source="cap of the speed at the start and after each halt",
        low=0.02,
    )  # fmt: skip
    rise: float = setting(
        default=0.05, unit="m/s2", source="of the cap: at 0.8 m/s after 12 s", low=0.0
    )
    most: float = setting(
        default=2.0, unit="m/s", source="the cap rises no further than this, or the limits",
        low=0.02, high=2.0,
    )  # fmt: skip
    patience: float = setting(
        default=20.0, unit="s", low=0.0,
        source="kept from driving by silent sensors; not by a person's hand",
    )  # fmt: skip

    def __post_init__(self) -> None:
        if self.most < self.first:
            raise InputError(f"a cap that rises from {self.first:g} to {self.most:g} m/s falls")


class Capped:
    """A policy whose twists are slowed, along the same arc, to a cap that rises while it drives.

    Args:
        policy: any.
        own: the cap.

    Attributes:
        cap: now [m/s].
    """

    def __init__(self, policy: Policy, own: Deployment) -> None:
        self.policy, self.own, self.cap = policy, own, own.first

    def reset(self, task: Any) -> None:
        """See `Policy.reset`."""
        self._task, self.cap = task, self.own.first
        self.policy.reset(task)

    def act(self, observation: Mapping[str, NDArray[np.float32]]) -> Array:
        """See `Policy.act`."""
        action, task, own = self.policy.act(observation), self._task, self.own
        if task.reading.halted:
            self.cap = own.first
        else:
            self.cap = min(self.cap + own.rise * task.period, own.most, task.limits.forward)
        twist = task.limits.twist(action)
        fast = abs(float(twist[0]))
        if fast <= self.cap:
            return action
        slowed: Array = task.limits.action(twist * (self.cap / fast))
        return slowed


class Journal:
    """Tells a person what happens, once a control period; ends what cannot go on.

    Args:
        own: how long to wait.
        say: takes a line.
        each: every command is told, not only what changes.

    Attributes:
        ended: why it was ended before the goal; empty: it was not.
    """

    def __init__(self, own: Deployment, say: Say, each: bool) -> None:
        self._own, self._say, self._each = own, say, each
        self._halted, self._since = "", 0.0
        self.ended = ""

    def __call__(self, env: Any) -> bool:
        """Take in a step of the environment; whether it has to end."""
        task = env.unwrapped.task
        now, why = task.reading.stamp, task.reading.halted
        if why != self._halted:
            self._say(f"{now:7.1f} s  stands: {why}" if why else f"{now:7.1f} s  goes on")
            self._halted, self._since = why, now
        if self._each and now > 0.0:
            self._say(_asked(env, now))
        if latched(env.unwrapped.chair):
            self.ended = why
        elif why and why != BY_HAND and now - self._since > self._own.patience:
            self.ended = f"{why}, for {self._own.patience:g} s"
        return bool(self.ended) and not self._each


def latched(chair: Any) -> str:
    """What a chair has stopped for until a person re-arms it and it is reset; empty: nothing."""
    return str(getattr(bare(chair), "latched", ""))


def _asked(env: Any, now: float) -> str:
    chair: Any = bare(env.unwrapped.chair)
    v, w = chair.asked
    x, y, yaw = env.unwrapped.task.reading.pose
    return f"{now:7.1f} s  v {v:6.3f} m/s  w {w:6.3f} rad/s  at ({x:.2f}, {y:.2f}, {yaw:.2f})"


def deploy(
    env: Any,
    policy: Policy,
    episode: Episode,
    own: Deployment,
    say: Say,
    each: bool = False,
    film: Callable[[Any], None] | None = None,
) -> Record:
    """Drive a real chair to an episode's goal.

    Args:
        env: of the chair; what stands between policy and chair is its affair.
        policy: drives, under the cap.
        episode: map, start and goal.
        own: cap and patience.
        say: takes the lines of the log.
        each: tell every command; never give up.
        film: is called with the environment after reset and each step, too.

    Returns:
        Figures as of `drive_episode`, by the chair's own belief, and `ended`, why it was ended.
    """
    journal = Journal(own, say, each)

    def watch(now: Any) -> bool:
        if film is not None:
            film(now)
        return journal(now)

    record = drive_episode(env, Capped(policy, own), 0, watch, episode)
    if journal.ended:
        record |= {"outcome": "halted", "success": False}
    return record | {"ended": journal.ended}


def ended_as_by_hand() -> None:
    """Whoever ends this program ends it as Ctrl-C does: the chair is told to stop."""
    for name in ("SIGTERM", "SIGHUP"):
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), signal.default_int_handler)


def hear_person(driven: Any) -> None:
    """A person at the terminal re-arms a chair that waits for it."""
    chair: Any = bare(driven)
    if not hasattr(chair, "rearm") or sys.stdin is None or not sys.stdin.isatty():
        return

    def listen() -> None:
        for _ in sys.stdin:
            if chair.waiting:
                chair.rearm()

    print("Enter re-arms the chair while it waits for a person", file=sys.stderr)
    threading.Thread(target=listen, name="person", daemon=True).start()
