"""A chair that runs under ROS, driven over rosbridge: its topics in, its twist out.

    drive(twist) ──▶ guard ──▶ geometry_msgs/Twist            LaserScan ─┐
                       ▲                                       Odometry ─┼─▶ Reading
                       └── silent sensor, late policy: zero  tf, Range ──┘

Ages are by this computer's clock: a message counts from when it came, later by as much as it took
longer than the quickest one of its topic, which the stamps tell whatever the other clock says.
A command is taken back (zero) when a sensor falls silent, when the policy takes too long, and on
every way out. What no program here can do is stop a chair whose link is cut: the chair's own
computer must stop when commands stay away.
"""

from __future__ import annotations

import atexit
import math
import threading
import time
from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wheelchair_gym.config import InputError
from wheelchair_gym.geometry import between
from wheelchair_gym.hardware.ros_senses import Senses
from wheelchair_gym.hardware.ros_settings import RosSettings
from wheelchair_gym.hardware.rosbridge import Rosbridge
from wheelchair_gym.kinematics import approach
from wheelchair_gym.mapping.scan import read_scan
from wheelchair_gym.maps import FREE, OccupancyGrid
from wheelchair_gym.sensing.settings import SensorSettings
from wheelchair_gym.simulation.settings import ChairSettings
from wheelchair_gym.types import Belief, Episode, Reading, Truth

Array = NDArray[np.float64]

_CLEARANCE = 2.0  # m: beyond, `Truth.clearance` says no more


class RosChair:
    """A chair behind rosbridge; see `Chair`.

    Args:
        settings: topics, frames, limits.
        sensors: where the laser and the ultrasonics sit, and how many beams there are.
        chair: its outline, and the limits of what it is told: a base may have none of its own.
        period: of control [s].
        on_map: the pose is that of the frame `map_frame`, from tf; false: the odometry's.

    Raises:
        InputError: the extra 'ros' is not installed, or no rosbridge answers.
    """

    def __init__(
        self,
        settings: RosSettings,
        sensors: SensorSettings,
        chair: ChairSettings,
        period: float,
        on_map: bool = True,
    ) -> None:
        self.settings, self.sensors, self.period = settings, sensors, period
        self._outline, self._limits, s = chair.footprint, chair.limits, settings
        self._senses = Senses(settings, sensors, on_map)
        self._lock = threading.Lock()  # of what is commanded
        self._set = np.zeros(4)  # speed, its slope, turn, its slope: what it was told last
        self._until, self._due = -math.inf, 0.0
        self._begun, self._way, self._truth = math.nan, 0.0, _NOWHERE
        self._link = Rosbridge(s.host, s.port, self._senses.take, s.link)
        self.url = self._link.url
        self._link.last_words = (s.velocity, _twist(0.0, 0.0))
        self._link.advertise(s.velocity, "geometry_msgs/Twist")
        for topic, one in self._senses.topics.items():
            if topic != s.map:
                self._link.subscribe(topic, one.kind)
        threading.Thread(target=self._guard, name=f"{self.url} guard", daemon=True).start()
        atexit.register(self.close)

    def reset(self, episode: Episode, key: int) -> Reading:
        """Stop, stay where it is, and wait for fresh data.

        Args:
            episode: is not looked at; see `Chair.reset`.
            key: nothing is drawn.

        Raises:
            InputError: something stays silent, the chair does not come to rest, or the laser does
                not sit where the settings say.
            ConnectionError: the link is lost.
        """
        self._begun = math.nan
        with self._lock:
            self._stop()
        self._senses.forget()
        self._await(lambda: self._senses.silent(time.monotonic()) or self._senses.unrest())
        if wrong := self._senses.misplaced():
            raise InputError(f"{self.url}: {wrong}")
        self._due = self._begun = time.monotonic()
        self._way = 0.0
        self._before: Array = self._senses.odometry[0]
        return self._reading("")

    def drive(self, twist: Array) -> Reading:
        """Move what the chair is told towards a twist (2,) [m/s, rad/s], wait a period, and sense.

        Within the limits of speed, acceleration and jerk; but where a sensor is silent the chair is
        told to stand at once, and `Reading.halted` says so.

        Raises:
            ValueError: the twist is not two finite numbers, or the chair was never reset.
            ConnectionError: the link is lost; a new chair must be made.
        """
        v, w = twist.tolist()
        if not math.isfinite(v + w):
            raise ValueError(f"twist is ({v}, {w}); expected two finite numbers")
        if math.isnan(self._begun):
            raise ValueError("the chair was never reset, or it was closed")
        with self._lock:
            now = time.monotonic()
            why = self._senses.silent(now)
            self._until = now + self.period + self.settings.hold
            if why:
                self._stop()
            else:
                self._approach(v, w)
        missed = math.floor((now - self._due) / self.period)  # periods that a policy slept through
        self._due += self.period * (1 + max(0, missed))
        self._link.gone.wait(max(0.0, self._due - time.monotonic()))
        self._check()
        return self._reading(why)

    def close(self) -> None:
        """Stop, and let go of the link; may be called again."""
        self._begun = math.nan
        self._link.close()
        atexit.unregister(self.close)

    def episode(self, goal: ArrayLike, start: ArrayLike | None = None) -> Episode:
        """An episode on the map that ROS tells, from where the chair is to a goal (2 or 3,).

        Args:
            goal: [m, m, rad].
            start: (3,) where the chair is, where tf does not tell.

        Raises:
            InputError: there is no map, nobody knows where on it the chair is, or the goal is not
                on free ground.
            ConnectionError: the link is lost.
        """
        own, senses = self.settings, self._senses
        self._link.subscribe(own.map, senses.topics[own.map].kind)
        self._await(lambda: "" if senses.map else senses.quiet(own.map))
        self._link.unsubscribe(own.map)  # a large one takes long to read, again and again
        chart: OccupancyGrid = senses.map
        if start is None:
            self._await(lambda: "" if senses.place() else senses.nowhere())
        place = senses.place()
        begin = np.asarray(start, np.float64) if place is None or start is not None else place.value
        end = np.zeros(3)
        end[: np.size(goal)] = goal
        ground = chart.inside(end[:2]) and chart.cells[tuple(chart.to_cell(end[:2]))] == FREE
        if not ground or not chart.inside(begin[:2]):
            who, at = ("the chair", begin) if ground else ("the goal", end)
            where = f"({at[0]:g}, {at[1]:g}) m"
            raise InputError(f"{self.url}: {who} is at {where}; expected free ground of {own.map}")
        return Episode(chart, begin, end, chart.walls(), name=self.url)

    @property
    def truth(self) -> Truth:
        """The best that is known: the pose believed, the nearest echo; no contact, no energy."""
        return self._truth

    @property
    def belief(self) -> Belief:
        """The odometry's own pose."""
        return Belief(self._before)

    def _await(self, missing: Callable[[], str]) -> None:
        """Wait until nothing is missing.

        Raises:
            InputError: it still is when patience ends.
            ConnectionError: the link is lost.
        """
        end = time.monotonic() + self.settings.patience
        while why := missing():
            self._check()
            if time.monotonic() > end:
                raise InputError(f"{self.url}: {why}; waited {self.settings.patience:g} s")
            self._link.gone.wait(_NAP)

    def _check(self) -> None:
        if self._link.lost:
            raise ConnectionError(f"{self.url}: the link is lost: {self._link.lost}")

    def _stop(self) -> None:
        """Tell it to stand at once."""
        self._set = np.zeros(4)
        self._link.publish(self.settings.velocity, _twist(0.0, 0.0))

    def _approach(self, v: float, w: float) -> None:
        """Tell it to come as near to a twist as the limits let it within a period."""
        own, limits = self._set, self._limits
        v = min(limits.forward, max(-limits.backward, v))
        w = min(limits.turn, max(-limits.turn, w))
        up, down, jerk = limits.acceleration, limits.deceleration, limits.jerk
        turn, turn_jerk = limits.turn_acceleration, limits.turn_jerk
        self._set = np.array(
            [
                *approach(own[0], own[1], v, up, down, jerk, self.period),
                *approach(own[2], own[3], w, turn, turn, turn_jerk, self.period),
            ]
        )
        told = _twist(float(self._set[0]), float(self._set[2]))
        self._link.publish(self.settings.velocity, told)

    def _guard(self) -> None:
        """Take a command back that may not stand any longer; runs in a thread of its own.

        A planner at work does not hold it up: kernels let go of Python's lock.
        """
        while not self._link.gone.wait(min(_NAP, 0.25 * self.period)):
            with self._lock:
                now = time.monotonic()
                if self._set.any() and (now > self._until or self._senses.silent(now)):
                    self._stop()

    def _reading(self, why: str) -> Reading:
        """What is known now; `why` the chair was not driven as it was told to."""
        senses, now = self._senses, time.monotonic()
        told, twist = senses.odometry
        place = senses.place() if senses.on_map else None
        laser, sonar, ages = senses.ranges(now)
        self._way += float(np.hypot(*between(self._before, told)[:2]))
        self._before = told
        pose = told if place is None else place.value
        self._truth = Truth(pose, twist, self._gap(laser), False, False, self._way, 0.0)
        return Reading(
            pose, twist, laser, sonar, ages, False, senses.battery, now - self._begun,
            senses.silent(now) or why,
        )  # fmt: skip

    def _gap(self, laser: NDArray[np.float32]) -> float:
        """Distance [m] from the outline to the nearest echo."""
        ends = read_scan(self.sensors.laser, laser, 0.0).echoes
        front, rear, half = self._outline.array
        aside = np.maximum(np.abs(ends[:, 1]) - half, 0.0)
        ahead = np.maximum(np.maximum(ends[:, 0] - front, -rear - ends[:, 0]), 0.0)
        return float(np.hypot(ahead, aside).min(initial=_CLEARANCE))


_NAP = 0.01  # s between two looks at what arrives in other threads
_NOWHERE = Truth(np.zeros(3), np.zeros(2), _CLEARANCE, False, False, 0.0, 0.0)


def _twist(v: float, w: float) -> dict[str, dict[str, float]]:
    """A geometry_msgs/Twist."""
    return {
        "linear": {"x": v, "y": 0.0, "z": 0.0},
        "angular": {"x": 0.0, "y": 0.0, "z": w},
    }
