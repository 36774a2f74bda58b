"""A person who drives a chair with an assistant: the stick, the keyboard, and what may go wrong.

    joystick at the drive board ─┐
    gamepad at the host          ├─▶ PersonsStick ──▶ TimedAssistant ──▶ environment ──▶ chair
    keys in a window            ─┘    may it drive?     in time? sound?

Whatever is wrong, the stick counts as centred, the chair comes to rest, and it drives on only once
the stick was at its centre. The guard of a real chair asks `PersonsStick` every few milliseconds,
whatever the assistant does.
"""

import math
import queue
import threading
from collections.abc import Callable
from contextlib import suppress
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from agents.deploy import Log, late_steps
from agents.evaluation.assisted import StickTrace
from agents.policies import GymPolicy, Policy
from wheelchair_gym.base.arrays import Array
from wheelchair_gym.geometry.kinematics import Limits
from wheelchair_gym.maps import FREE, OccupancyGrid
from wheelchair_gym.perception.localized_chair import unwrapped
from wheelchair_gym.safety import stops
from wheelchair_gym.types import Command, Episode, Mission, Reading, Stick

CENTRED = Stick(0.0, 0.0, False)
DEADLINE = 0.15  # s: less than the drive board's own timeout
_SILENT = 0.3  # s after which keys that nobody has read count as silent
_SLOW = 0.4  # factor of a key while shift is held
_PAGE = (640, 200)  # pixels
_LETTERS = 60
_KEYS = (
    "arrows or WASD: drive; with shift: slowly",
    "M: by hand, without help, and back",
    "Enter: re-arm    Q: end",
)


class StickSource(Protocol):
    """A reader of a person's stick: a gamepad, a chair with its own joystick, or a keyboard."""

    def stick(self, now: float) -> tuple[Stick, str]:
        """Return the stick at a time [s], and why it may not drive; empty: it may."""
        ...


class Stand:
    """A policy that leaves the chair at rest, while a person follows prompts."""

    def reset(self, mission: Mission) -> None:
        """See `Policy.reset`."""

    def act(self, reading: Reading) -> Command:
        """See `Policy.act`."""
        return Command(np.zeros(2))


class PersonsStick:
    """The stick that an assistant gets: centred while anything forbids it to drive.

    Args:
        share: of full speed at full deflection.
        now: the time [s].
        fault: returns why the assistant may not drive; empty: it may.

    Attributes:
        source: reads it; None: no stick is heard yet.
    """

    def __init__(self, share: float, now: Callable[[], float], fault: Callable[[], str]) -> None:
        self.source: StickSource | None = None
        self._share, self._now, self._fault = share, now, fault
        self._lock = threading.Lock()  # the chair's guard asks, too
        self._must_centre = True

    def must_centre(self) -> None:
        """Require that the stick returns to its centre before the chair drives."""
        with self._lock:
            self._must_centre = True

    def read(self) -> tuple[Stick, str]:
        """Return the stick, and why it counts as centred; empty: it is that of the hand."""
        stick, why = CENTRED, stops.NO_STICK
        if self.source is not None:
            stick, why = self.source.stick(self._now())
        why = why or self._fault()
        with self._lock:
            if why:
                self._must_centre = True
            elif stick.forward == stick.left == 0.0:
                self._must_centre = False
            elif self._must_centre:
                why = stops.OFF_CENTRE
        if why:
            return CENTRED, why
        return Stick(self._share * stick.forward, self._share * stick.left, stick.latched), ""

    def __call__(self) -> Stick:
        """Return the stick, for an environment's `person`."""
        return self.read()[0]

    def why(self) -> str:
        """Return why nothing may be driven, for a chair's guard; empty: it may."""
        return self.read()[1]


class TimedAssistant:
    """A policy that answers in time or not at all, and whose errors stop the chair.

    The policy runs in a thread. Its twist is held to what the person's stick allows: none with a
    centred stick, and no more speed than the stick's.

    Args:
        policy: drives with the stick, such as `agents.policies.delegated`.
        name: of the assistant, in messages.
        deadline: for each answer [s].

    Attributes:
        fault: why it may not drive; empty: it may.
        error: that it raised, or None.
    """

    def __init__(self, policy: Policy, name: str, deadline: float = DEADLINE) -> None:
        self.policy, self.name, self.deadline = policy, name, deadline
        self.fault = ""
        self.error: Exception | None = None
        self._questions: queue.SimpleQueue[Reading | None] = queue.SimpleQueue()
        self._answers: queue.SimpleQueue[Command | Exception] = queue.SimpleQueue()
        self._waits = False  # for an answer that did not come in time
        self._thread: threading.Thread | None = None

    def reset(self, mission: Mission) -> None:
        """See `Policy.reset`; an assistant that is still late, or has failed, stays as it is."""
        self._limits = mission.limits
        if self.fault:
            return
        if self._thread is None:
            self._thread = threading.Thread(target=self._work, name="assistant", daemon=True)
            self._thread.start()
        try:
            self.policy.reset(mission)
        except Exception as error:  # whatever it is, the person learns of it and drives by hand
            self._fail(error)

    def act(self, reading: Reading) -> Command:
        """See `Policy.act`; rest while the assistant has no answer."""
        rest = Command(np.zeros(2))
        if self.error is not None:
            return rest
        if not self._waits:
            self._questions.put(reading)
        try:
            answer = self._answers.get(timeout=0.0 if self._waits else self.deadline)
        except queue.Empty:
            self._waits, self.fault = True, stops.LATE.format(self.name)
            return rest
        if self._waits and not isinstance(answer, Exception):
            self._waits, self.fault = False, ""  # that answer is too old
            return rest
        if isinstance(answer, Exception):
            return self._fail(answer)
        stick = reading.stick or CENTRED
        return answer._replace(twist=held_to_stick(answer.twist, stick, self._limits), action=None)

    def close(self) -> None:
        """End its thread, once it has answered."""
        self._questions.put(None)

    def _fail(self, error: Exception) -> Command:
        self.error = error
        text = " ".join(str(error).split())[:120]
        self.fault = f"{stops.FAILED.format(self.name)} ({type(error).__name__}: {text})"
        return Command(np.zeros(2))

    def _work(self) -> None:
        while (reading := self._questions.get()) is not None:
            try:
                answer = self.policy.act(reading)
                self._answers.put(checked(answer))
            except Exception as error:
                self._answers.put(error)


def checked(command: Any) -> Command:
    """Return a command if its twist is two finite numbers.

    Raises:
        ValueError: it is not.
    """
    twist = np.asarray(getattr(command, "twist", None), np.float64)
    if not isinstance(command, Command) or twist.shape != (2,) or not np.isfinite(twist).all():
        raise ValueError(f"it gave {command!r:.80}; expected a twist of two finite numbers")
    return command


def held_to_stick(twist: Array, stick: Stick, limits: Limits) -> Array:
    """Return a twist (2,) [m/s, rad/s] whose speed is between rest and the stick's.

    With a centred stick it is rest.
    """
    asked, turn = limits.twist_of(stick.forward, stick.left)
    if asked == 0.0 and turn == 0.0:
        return np.zeros(2)
    return np.array([min(max(float(twist[0]), min(0.0, asked)), max(0.0, asked)), float(twist[1])])


class Keyboard:
    """Keys in a window: arrows or WASD are the stick, M drives by hand, Enter re-arms, Q ends.

    Keys count while the window has the attention and `poll` is called.

    Args:
        share: of full speed, by hand.
        rearm: called when the person re-arms.

    Attributes:
        open: the window is.
        status: shown in the window.

    Raises:
        InputError: there is no display.
    """

    def __init__(self, share: float, rearm: Callable[[], None] = lambda: None) -> None:
        from wheelchair_gym.rendering.video import Window

        self._window = Window("wheelchair drive")
        import pygame

        self._pygame = k = pygame
        self._share, self._rearm = share, rearm
        self._held: set[int] = set()
        self._manual, self._read_at, self.open = False, -math.inf, True
        self._ways = ((k.K_UP, k.K_w), (k.K_DOWN, k.K_s), (k.K_LEFT, k.K_a), (k.K_RIGHT, k.K_d))
        self.status = ""
        self._window.show(_page("", False))

    def poll(self, now: float) -> None:
        """Read the keys at a time [s]."""
        pygame = self._pygame
        for event in pygame.event.get(
            (pygame.KEYDOWN, pygame.KEYUP, pygame.WINDOWFOCUSLOST, pygame.QUIT)
        ):
            if event.type == pygame.KEYDOWN:
                self._press(event.key)
            elif event.type == pygame.KEYUP:
                self._held.discard(event.key)
            elif event.type == pygame.QUIT:
                self.open = False
            else:
                self._held.clear()
        self.open = self.open and self._window.show(_page(self.status, self._manual))
        self._read_at = now

    def _press(self, key: int) -> None:
        pygame = self._pygame
        if key in (pygame.K_q, pygame.K_ESCAPE):
            self.open = False
        elif key == pygame.K_m:
            self._manual = not self._manual
        elif key == pygame.K_RETURN:
            self._rearm()
        else:
            self._held.add(key)

    def stick(self, now: float) -> tuple[Stick, str]:
        """See `StickSource.stick`."""
        if not self.open or now - self._read_at > _SILENT:
            return CENTRED, stops.NO_STICK
        up, down, left, right = (any(key in self._held for key in keys) for keys in self._ways)
        slow = {self._pygame.K_LSHIFT, self._pygame.K_RSHIFT} & self._held
        share = _SLOW if slow else 1.0
        stick = Stick(share * (up - down), share * (left - right), False)
        return stick, stops.BY_HAND if self._manual else ""

    def __call__(self, now: float, limits: Limits) -> Array | None:
        """See `HardwareChair.joystick`: by hand, without an assistant; M begins and ends it."""
        if not self._manual:
            return None
        stick, _ = self.stick(now)
        return np.array(limits.twist_of(self._share * stick.forward, self._share * stick.left))

    def close(self) -> None:
        """Close the window."""
        self.open = False
        self._window.close()


def _page(status: str, manual: bool) -> NDArray[np.uint8]:
    """Draw the window's picture: who drives, the state, and the keys."""
    from wheelchair_gym.rendering.canvas import write_text

    image = np.full((_PAGE[1], _PAGE[0], 3), 255, np.uint8)
    lines = ["by hand, without help" if manual else "with help", status[:_LETTERS], *_KEYS]
    for k, line in enumerate(lines):
        write_text(image, line, (16.0, 30.0 + 28.0 * k), 12.0, (0, 0, 0))
    return image


_EXTENT, _CELL = 60.0, 0.1  # m: of the empty map of a chair that has none, and of its cells
_FOR_EVER = 1e6  # s


def open_space() -> Episode:
    """An episode without walls and without a goal that is ever reached, around the start."""
    n = round(_EXTENT / _CELL)
    corner = (-0.5 * _EXTENT, -0.5 * _EXTENT, 0.0)
    grid = OccupancyGrid(np.full((n, n), FREE, np.int8), _CELL, corner)
    return without_goal(grid, np.zeros(3), np.empty((0, 4)))


def without_goal(grid: OccupancyGrid, start: Any, walls: Any) -> Episode:
    """An episode on a map that goes on for ever, since nobody knows where the person wants to go.

    Args:
        grid: the map.
        start: pose (3,) [m, m, rad].
        walls: of the map (n, 4) [m].
    """
    beside = np.add(start, (1e-3, 0.0, 0.0))
    return Episode(grid, start, beside, walls, tolerance=0.0, time_limit=_FOR_EVER, name="person")


def drive_with_help(
    env: Any,
    assistant: TimedAssistant,
    stick: PersonsStick,
    episode: Episode,
    log: Log,
    each: Callable[[Any], bool],
) -> dict[str, Any]:
    """Run a person's drive with an assistant, until `each` returns true or the chair has stopped.

    Ctrl-C ends the drive, too.

    After a touch the shield holds the chair until the person has driven it free by hand, or has
    re-armed it.

    Args:
        env: an environment whose `person` is the stick.
        assistant: answers in time.
        stick: the person's.
        episode: a map without a goal.
        log: takes lines of text.
        each: called with the environment after each reset and step.

    Returns:
        Figures: `time` [s], `length` [m], how often it stood (`stops`), why the chair has `ended`
        the drive, the measures of `agents.evaluation.assisted`, and late control periods.
    """
    world, chair = env.unwrapped, unwrapped(env.unwrapped.chair)
    limits, period = world.task.limits, world.task.period
    trace, twists = StickTrace(limits, period), [np.zeros(2)]
    length, monitor, halts, ended = 0.0, stops.StopMonitor(), 0, ""
    observation, _ = env.reset(seed=0, options={"episode": episode})
    driver = GymPolicy(assistant, env)
    driver.reset()
    with suppress(KeyboardInterrupt):  # the end of a person's drive
        while not each(env):
            # The guard may stop the chair at any time: what ends the drive is what is reported.
            reading, stood, latched = world.task.reading, bool(monitor.messages), chair.latched
            if reading.halted:
                stick.must_centre()
            causes = [*stops.active_stops(latched or reading.halted, world.shield), stick.why()]
            for line in monitor.update(reading.stamp, causes):
                log(f"{reading.stamp:7.1f} s  {line}")
            halts += bool(monitor.messages) and not stood
            if latched:
                ended = monitor.why
                break
            action, now = driver.act(observation), world.task.stick
            observation, *_ = env.step(action)
            trace.add(now, limits.twist(action) - np.array(world.task.shield_intervention))
            twists.append(world.task.reading.twist)
            length += abs(float(twists[-1][0])) * period
    driven = (len(twists) - 1) * period
    figures = {"time": driven, "length": length, "stops": halts, "ended": ended}
    return figures | trace.figures(np.array(twists), length) | late_steps(env)
