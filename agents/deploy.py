"""A policy on a real chair: slowly at first, with a log of all that happens, and always stopped."""

from __future__ import annotations

import logging
import signal
import sys
import threading
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from agents.evaluation.evaluate import drive_episode
from agents.evaluation.metrics import Record
from agents.policies import Policy
from agents.start_fit import StartCheck, start_fit
from wheelchair_gym.config import InputError, setting, settings
from wheelchair_gym.geometry import wrap
from wheelchair_gym.localization.localized_chair import unwrapped
from wheelchair_gym.safety.stops import StopMonitor, active_stops, advice_for, shield_message
from wheelchair_gym.types import Command, Episode, Mission, Reading

Array = NDArray[np.float64]
Say = Callable[[str], None]

_LOG = logging.getLogger(__name__)


@settings
class Deployment:
    """How fast a policy may drive, and how long it may be kept from driving."""

    first: float = setting(default=0.2, unit="m/s", low=0.02, source="design choice")
    """Cap of the speed at the start and after each halt."""
    rise: float = setting(
        default=0.05, unit="m/s2", low=0.0, source="design choice; 0.8 m/s after 12 s"
    )
    """Rate at which the cap rises while the chair drives."""
    most: float = setting(default=2.0, unit="m/s", low=0.02, high=2.0, source="design choice")
    """Highest cap; the limits of the chair hold besides."""
    patience: float = setting(default=20.0, unit="s", low=0.0, source="design choice")
    """Time after which a chair that sensors or a latched shield halt is given up."""

    def __post_init__(self) -> None:
        if self.most < self.first:
            raise InputError(f"a cap that rises from {self.first:g} to {self.most:g} m/s falls")


class Capped:
    """A policy whose twists are slowed, along the same arc, to a cap that rises while it drives.

    Args:
        policy: any.
        own: the cap.
        latched: says for which fault the shield stands; empty: none.

    Attributes:
        cap: now [m/s].
    """

    def __init__(
        self, policy: Policy, own: Deployment, latched: Callable[[], str] = lambda: ""
    ) -> None:
        self.policy, self.own, self.cap = policy, own, own.first
        self._latched = latched

    def reset(self, mission: Mission) -> None:
        """See `Policy.reset`."""
        self._limits, self._period, self.cap = mission.limits, mission.period, self.own.first
        self.policy.reset(mission)

    def act(self, reading: Reading) -> Command:
        """See `Policy.act`."""
        command, limits, own = self.policy.act(reading), self._limits, self.own
        if reading.halted or self._latched():
            self.cap = own.first
        else:
            self.cap = min(self.cap + own.rise * self._period, own.most, limits.forward)
        twist = limits.twist(command.as_action(limits))
        fast = abs(float(twist[0]))
        if fast <= self.cap:
            return command
        return command._replace(twist=twist * (self.cap / fast), action=None)


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
        self._stops = StopMonitor()
        self.ended = ""

    def __call__(self, env: Any) -> bool:
        """Take in a step of the environment; whether it has to end."""
        env = env.unwrapped
        now, stops = env.task.reading.stamp, self._stops
        for line in stops.update(now, active_stops(env.task.reading.halted, env.shield)):
            self._say(f"{now:7.1f} s  {line}")
        if env.shield is not None and (fault := env.shield.refused()):
            advice = advice_for(shield_message(fault))
            self._say(f"{now:7.1f} s  not re-armed: {fault}, still; {advice}")
        if self._each and now > 0.0:
            self._say(_asked(env, now))
        if latched(env.chair):
            self.ended = stops.why
        elif stops.waited > self._own.patience:
            self.ended = f"{stops.why}, for {self._own.patience:g} s"
        return bool(self.ended) and not self._each


def latched(chair: Any) -> str:
    """What a chair has stopped for until a person re-arms it and it is reset; empty: nothing."""
    return str(getattr(unwrapped(chair), "latched", ""))


def _asked(env: Any, now: float) -> str:
    chair: Any = unwrapped(env.unwrapped.chair)
    v, w = chair.commanded
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
    begin: Callable[[Any], None] | None = None,
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
        begin: is called with the environment after reset, before anything is driven; may raise.

    Returns:
        Figures as of `drive_episode`, by the chair's own belief, and `ended`, why it was ended.
    """
    journal, shield = Journal(own, say, each), env.unwrapped.shield
    steps = 0

    def watch(now: Any) -> bool:
        nonlocal steps
        if begin is not None and steps == 0:
            begin(now)
        steps += 1
        if film is not None:
            film(now)
        return journal(now)

    capped = Capped(policy, own, lambda: shield.latched if shield else "")
    record = drive_episode(env, capped, 0, watch, episode)
    if journal.ended:
        record |= {"outcome": "halted", "success": False}
    return record | {"ended": journal.ended}


def check_start(env: Any, start: Array, own: StartCheck, forced: bool, say: Say) -> None:
    """Tell how well the first scan fits the map where the chair is said to stand.

    Args:
        env: of the chair, after reset.
        start: (3,) m, m, rad on the episode's map.
        own: what is believed.
        forced: a start that fits badly is told, and not refused.
        say: takes the line.

    Raises:
        InputError: it fits badly.
    """
    env = env.unwrapped
    found = start_fit(
        env.episode.map, start, env.settings.sensors.laser, env.task.reading.laser, own
    )
    x, y, yaw = start.tolist()
    off = np.hypot(*(found.pose - start)[:2])
    turn = np.degrees(abs(wrap(float(found.pose[2] - yaw))))
    told = f"the scan fits the map with {found.fit:.2f} of 1 at --start {x:g},{y:g},{yaw:g}"
    if not found.wrong:
        say(f"{told}, best {off:.2f} m and {turn:.0f} deg beside it")
    elif forced:
        say(f"{told}: {found.wrong}; driven all the same (--force-start)")
    else:
        raise InputError(f"{told}: {found.wrong}; correct it, or add --force-start")


def say(line: str) -> None:
    """Write a line of the log to standard error."""
    print(line, file=sys.stderr, flush=True)


def ended_as_by_hand() -> None:
    """Whoever ends this program ends it as Ctrl-C does: the chair is told to stop."""
    for name in ("SIGTERM", "SIGHUP"):
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), signal.default_int_handler)


def hear_person(driven: Any, shield: Any = None) -> None:
    """A person at the terminal re-arms a chair that waits for it, or its shield.

    What the chair waits for at reset is told from now on with the ways there are to re-arm it.

    Args:
        driven: the chair, with or without what finds it on a map.
        shield: of the environment that drives it, if it has one.
    """
    chair: Any = unwrapped(driven)
    terminal = sys.stdin is not None and sys.stdin.isatty()
    if hasattr(chair, "on_wait"):
        chair.on_wait = lambda line: _LOG.warning("%s", _with_ways(chair, line, terminal))
    if not terminal or (shield is None and not hasattr(chair, "rearm")):
        return

    def listen() -> None:
        for _ in sys.stdin:
            if getattr(chair, "waiting_for", "") or (shield is not None and shield.latched):
                rearm(chair, shield)

    print("Enter re-arms the chair while it waits for a person", file=sys.stderr)
    threading.Thread(target=listen, name="person", daemon=True).start()


def rearm(chair: Any, shield: Any) -> None:
    """A person re-arms a chair and its shield."""
    if hasattr(chair, "rearm"):
        chair.rearm()
    if shield is not None:
        shield.rearm()


def _with_ways(chair: Any, line: str, terminal: bool) -> str:
    """A line, and how a person re-arms a chair, if that is what the line is about."""
    if not chair.waiting_for:
        return line
    ways = ["Enter here"] if terminal else []
    if (hand := getattr(chair.joystick, "error", None)) is not None:
        button = chair.joystick.settings.rearm_button
        ways.append(f"button {button} of the host's joystick" + (f" ({hand})" if hand else ""))
    ways.append("the joystick of the drive board: manual, then hold")
    return f"{line}: {advice_for(line)}, then {', or '.join(ways)}"
