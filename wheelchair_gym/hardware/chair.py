"""The real chair behind `Chair`: drive board, range board, laser.

    drive(twist) ──▶ guard ──▶ Command, 50 Hz ──▶ drive board      Odometry ─┐
                       ▲                                           Ranges   ─┼─▶ Reading
                       └── silent sensor, late policy, a person    Scan     ─┘

The guard does all that is said and heard, whoever else is at work. The drive board stops by itself
when commands stay away; nothing here re-arms it, but a person.
"""

from __future__ import annotations

import atexit
import contextlib
import logging
import math
import threading
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.config import InputError
from wheelchair_gym.hardware.best_estimate import Known
from wheelchair_gym.hardware.boards.messages import (
    Command,
    CommandFlag,
    Fault,
    Mode,
    Rearm,
    Status,
    Switch,
)
from wheelchair_gym.hardware.boards.parameters import wanted_parameters
from wheelchair_gym.hardware.boards.senses import BoardSenses
from wheelchair_gym.hardware.pacing import Clock, Pace, WallClock
from wheelchair_gym.hardware.settings import HardwareSettings
from wheelchair_gym.kinematics import Limits
from wheelchair_gym.physics.settings import ChairSettings
from wheelchair_gym.safety.stops import BROUGHT_TO_REST, BY_HAND, DRY_RUN
from wheelchair_gym.sensors.settings import SensorSettings
from wheelchair_gym.types import Belief, Episode, Reading, Truth, Uncopied

Array = NDArray[np.float64]
Hand = Callable[[float, Limits], Array | None]

_LOG = logging.getLogger(__name__)
STAND = Command(0.0, 0.0, CommandFlag.PROTECTIVE)
_FREE = Command(0.0, 0.0)  # stands, too, as a chair that may be driven does
_MUTE = "the drive board is silent"
_REARM = 2  # kind of the message, as an answer names it
_REFUSED: dict[int, str] = {
    Status.CAUSE_STANDS: "what stopped the drive board is still there",
    Status.NOT_AT_ZERO: "the sticks are not at rest",
    Status.OTHER_FAULTS: "the drive board has stopped for something else meanwhile",
    Status.MOVING: "the chair moves",
}
_LOST = 4  # last words, against noise
_FINE = 0.001  # s between two looks, when the next odometry is waited for


def _warn(line: str) -> None:
    _LOG.warning("%s", line)


class HardwareChair(Uncopied):
    """A chair behind its boards; see `Chair`. Readings hold dead-reckoned poses.

    Args:
        settings: where boards and laser are, limits.
        sensors: where laser and ultrasonics sit, and how many beams there are.
        chair: outline, wheels, limits; the boards' parameters must agree with it.
        period: of control [s].
        clock: whose time it is.
        senses: the lines; made from the settings where they are not given.

    Attributes:
        hand: what a person's hand at the host asks for: called with the time and the limits; a
            twist (2,), or None while nobody takes the chair over. It goes before every policy.
        waiting: what reset waits for a person to do; empty while it does not.
        on_wait: is called with a line when reset has to wait, for a person or for more than 1 s.
        on_rearm: each is called when a person re-arms the chair: by `rearm`, or at the drive
            board; or drove it by a joystick and hands it back.
        latched: what the drive board has stopped for, until the next reset; empty: nothing.
        asked: the twist (2,) last asked of it, within the limits, whether or not it was sent.
    """

    def __init__(
        self,
        settings: HardwareSettings,
        sensors: SensorSettings,
        chair: ChairSettings,
        period: float,
        clock: Clock | None = None,
        senses: BoardSenses | None = None,
    ) -> None:
        self.settings, self.sensors, self.chair, self.period = settings, sensors, chair, period
        clock = clock or WallClock()
        self.senses = senses or BoardSenses(settings, sensors, chair.drive, clock.now)
        self.hand: Hand = lambda now, limits: None
        self.waiting = ""
        self.on_wait: Callable[[str], object] = _warn
        self.on_rearm: list[Callable[[], object]] = []
        self._in_hand = False  # a person has the chair, or it needs one
        self._pace = Pace(clock, period, settings.limits.hold)
        self._known = Known(chair.footprint, sensors.laser)
        self._lock = threading.RLock()
        self._target, self._sent = STAND, -math.inf
        self.latched, self.asked = "", np.zeros(2)
        self._ways, self._at = np.zeros(2), 0.0  # of the last reading
        self._closed = False
        self._end_guard = clock.guard(self._guard, settings.look, settings.drive)
        atexit.register(self.close)

    def reset(self, episode: Episode, key: int) -> Reading:
        """Stop, stay where it is, and wait for fresh data and for a person to re-arm it.

        Args:
            episode: is not looked at; see `Chair.reset`.
            key: nothing is drawn.

        Raises:
            InputError: something stays silent or does not fit the settings, the chair does not come
                to rest, or nobody re-arms it.
        """
        with self._lock:
            if self._closed:
                raise ValueError("the chair was closed")
            self._pace.end()
            self._say(_FREE if self._standing else STAND)
            self.senses.forget()
        self._await(self._unready, self.settings.limits.patience)
        for board, wanted in self.wanted.items():
            self._await(lambda b=board, w=wanted: self.senses.disagrees(b, w), 2.0)  # type: ignore[misc]
        with self._lock:
            self._say(_FREE)
            self.waiting = "" if self.settings.dry else self.senses.stopped()
        if self.waiting:
            self.on_wait(f"{self.waiting}; waits {self.settings.rearm:g} s for that")
        try:
            if not self.settings.dry:
                self._await(self._unarmed, self.settings.rearm, silent=True)
        finally:
            self.waiting = ""
        with self._lock:
            self.senses.forget()  # the clocks may have parted while it waited
        self._await(self._unready, self.settings.limits.patience)
        self._meet()
        with self._lock:
            self.latched = ""
            self._pace.begin()
            self._at = self._pace.clock.now()
            reckoned, self._ways = self.senses.odometer.at(self._at)
            self._known.begin(reckoned)
            self.senses.pressed = False
            return self._reading(self._halts(), np.zeros(2))

    def drive(self, twist: Array, protective: bool = False) -> Reading:
        """Ask for a twist (2,) [m/s, rad/s] or a protective stop, wait a period, and sense.

        Where something forbids it the chair is told to stand at once, and `Reading.halted` says so.

        Raises:
            ValueError: the twist is not two finite numbers, or the chair was never reset.
        """
        why = self.ask(twist, protective)
        self._pace.rest()
        with self._lock:
            self.senses.poll()
            now = self._pace.clock.now()
            _, ways = self.senses.odometer.at(now)
            moved = self.senses.odometer.twist(ways - self._ways, max(now - self._at, 1e-3))
            self._ways, self._at = ways, now
            return self._reading(self._halts() or why, moved)

    def ask(self, twist: Array, protective: bool = False) -> str:
        """Ask for a twist (2,) [m/s, rad/s] and do not wait; why it is told to stand instead.

        Args:
            twist: what for.
            protective: or for a protective stop.

        Raises:
            ValueError: the twist is not two finite numbers, or the chair was never reset.
        """
        with self._lock:
            v, w = self._pace.asked(twist)
            self.senses.poll()
            why = self._halts()
            limits = self.chair.limits
            v = min(limits.forward, max(-limits.backward, v))
            w = min(limits.turn, max(-limits.turn, w))
            self.asked = np.array([v, w])
            self._say(STAND if why or protective else Command(v, w))
            return why

    @property
    def clock(self) -> Clock:
        """Whose time it is."""
        return self._pace.clock

    def rearm(self) -> None:
        """A person has seen to what it stopped for: only ever a person's own act."""
        with self._lock:
            if self._standing and not self.settings.dry:
                self._say(_FREE)  # a fresh command of zero is asked for
                self.senses.drive.send(Rearm(self.senses.odometry.faults))
        self._rearmed()

    def _unarmed(self) -> str:
        """Why the board needs a person; a re-arm that it refuses is told."""
        answer = self.senses.answers.pop("drive", None)
        if answer is not None and answer.kind == _REARM and answer.status in _REFUSED:
            self.on_wait(f"not re-armed: {_REFUSED[answer.status]}")
        return self.senses.stopped()

    def _rearmed(self) -> None:
        for told in self.on_rearm:
            told()

    def _heed_person(self) -> None:
        """Notice who re-arms at the drive board, or hands the chair back: the host drives again."""
        if not math.isfinite(self.senses.stamp_of("odometry")):
            return
        mode = self.senses.odometry.mode
        if mode in (Mode.STOPPED, Mode.MANUAL) or self._by_hand() is not None:
            self._in_hand = True
        elif self._in_hand and mode == Mode.HOST:
            self._in_hand = False
            self._rearmed()

    def close(self) -> None:
        """Stop, and let go of the lines; may be called again."""
        with self._lock:
            if self._closed:
                return
            self._closed = True
            self._pace.end()
            with contextlib.suppress(Exception):  # the lines may be the very thing that is broken
                for _ in range(_LOST):
                    self._say(STAND)
        self._end_guard()
        self.senses.close()
        atexit.unregister(self.close)

    def found(self, pose: Array) -> None:
        """What finds it on the map believes it to be at a pose (3,)."""
        self._known.found(pose)

    @property
    def truth(self) -> Truth:
        """The best that is known: the pose believed, the nearest echo, what strips felt."""
        return self._known.truth

    @property
    def belief(self) -> Belief:
        """The odometry's own pose."""
        return Belief(self._known.reckoned)

    @property
    def report(self) -> dict[str, float | str]:
        """What the drive board said last: mode, faults, switches, counts, duties and set point."""
        with self._lock:
            if not math.isfinite(self.senses.stamp_of("odometry")):
                return {}
            told = self.senses.odometry
        names = ("left", "right", "duty_left", "duty_right", "v", "w")
        flags = {"faults": Fault(told.faults), "switches": Switch(told.switches)}
        return {
            "mode": Mode(told.mode).name,
            **{name: flag.name or "" for name, flag in flags.items()},
            **{name: getattr(told, name) for name in names},
        }

    @property
    def wanted(self) -> dict[str, dict[str, float]]:
        """What the boards must hold for this chair, by the name of the board."""
        return wanted_parameters(self.chair, self.sensors, self.settings)

    @property
    def _standing(self) -> bool:
        """Whether the drive board is known to stand until a person re-arms it."""
        heard = math.isfinite(self.senses.ages(0.0)["odometry"])
        return heard and self.senses.odometry.mode == Mode.STOPPED

    def _unready(self) -> str:
        with self._lock:
            now = self._pace.clock.now()
            senses = self.senses
            return senses.silent(now) or senses.unheard(now) or senses.misfit() or senses.unrest()

    def _meet(self) -> None:
        """Wait for the next odometry.

        Periods that begin with one end with one, and what is said then is heard by the board's next
        run: what is sensed is fresh, and commands are heeded within milliseconds.
        """
        before = self.senses.stamp_of("odometry")

        def missing() -> str:
            with self._lock:
                self.senses.poll()
                return _MUTE if self.senses.stamp_of("odometry") == before else ""

        self._pace.until(missing, self.settings.limits.odometry, nap=_FINE)
        self._pace.clock.wait(
            self._pace.clock.now() + _FINE
        )  # some come a little later than others

    def _await(self, missing: Callable[[], str], patience: float, silent: bool = False) -> None:
        """Wait until nothing is missing; say what is, unless it is silent.

        Raises:
            InputError: it still is when patience ends.
        """

        def tell(why: str) -> None:
            self.on_wait(f"{why}; waits {patience:g} s for it")

        if why := self._pace.until(missing, patience, tell=None if silent else tell):
            raise InputError(f"{self.settings.drive}: {why}; waited {patience:g} s")

    def _halts(self) -> str:
        """Why the chair may not be driven by a policy now; empty: it may."""
        if why := self.senses.silent(self._pace.clock.now()):
            return why
        if self.settings.dry:
            return DRY_RUN
        told = self.senses.odometry
        self.latched = self.latched or self.senses.stopped()
        if self.latched:
            return self.latched
        if told.mode == Mode.MANUAL or self._by_hand() is not None:
            return BY_HAND
        return BROUGHT_TO_REST if told.mode == Mode.STOPPING else ""

    def _by_hand(self) -> Command | None:
        """What a person's hand at the host asks for."""
        twist = self.hand(self._pace.clock.now(), self.chair.limits)
        return None if twist is None else Command(*twist.tolist()) if twist.any() else STAND

    def _say(self, target: Command) -> None:
        """Ask the drive board for a target from now on."""
        self._target = target
        self._sent = self._pace.clock.now()
        if not self.settings.dry:
            self.senses.drive.send(self._by_hand() or target)

    def _guard(self) -> None:
        """Hear what came, take a command back that may not stand any longer, repeat the others."""
        with self._lock:
            if self._closed:
                return
            self.senses.poll()
            self._heed_person()
            now = self._pace.clock.now()
            moves = self._target.v != 0.0 or self._target.w != 0.0
            if moves and (self._pace.late or self._halts()):
                self._say(STAND)
            elif now - self._sent >= self.settings.repeat - 1e-9:
                self._say(self._target)

    def _reading(self, why: str, twist: Array) -> Reading:
        """What is known now; `why` the chair was not driven as it was told to."""
        now = self._pace.clock.now()
        laser, sonar, ages = self.senses.ranges(now)
        pose, _ = self.senses.odometer.at(now)
        bumped, self.senses.pressed = self.senses.pressed, False
        self._known.update(pose, pose, twist, laser, bumped)
        battery = self.senses.odometry.battery
        return Reading(pose, twist, laser, sonar, ages, bumped, battery, self._pace.elapsed, why)
