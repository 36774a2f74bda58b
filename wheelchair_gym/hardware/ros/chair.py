"""A chair that runs under ROS, driven over rosbridge: its topics in, its twist out.

    drive(twist) ──▶ guard ──▶ geometry_msgs/Twist            LaserScan ─┐
                       ▲                                       Odometry ─┼─▶ Reading
                       └── silent sensor, late policy: zero  tf, Range ──┘

Ages are by this computer's clock: a message counts from when it came, later by as much as it took
longer than the quickest one of its topic, which the stamps tell whatever the other clock says.
Where `use_sim_time` says so, ages and control periods are by ROS's simulated time instead.
A command is taken back (zero) when a sensor falls silent, when the policy takes too long, and on
every way out. What no program here can do is stop a chair whose link is cut: the chair's own
computer must stop when commands stay away.
"""

from __future__ import annotations

import atexit
import threading
from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wheelchair_gym.config import InputError
from wheelchair_gym.geometry import roomiest
from wheelchair_gym.hardware.best_estimate import Known
from wheelchair_gym.hardware.pacing import NAP, Pace, WallClock
from wheelchair_gym.hardware.ros.clock import SimulatedClock
from wheelchair_gym.hardware.ros.rosbridge import Rosbridge
from wheelchair_gym.hardware.ros.senses import Senses
from wheelchair_gym.hardware.ros.settings import RosSettings
from wheelchair_gym.kinematics import approach
from wheelchair_gym.maps import FREE, OccupancyGrid
from wheelchair_gym.physics.settings import ChairSettings
from wheelchair_gym.sensors.settings import SensorSettings
from wheelchair_gym.types import Belief, Episode, Reading, Truth, Uncopied

Array = NDArray[np.float64]


class RosChair(Uncopied):
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
        self._limits, s = chair.limits, settings
        self._known = Known(chair.footprint, sensors.laser)
        clock = self._clock = SimulatedClock(s.clock, s.stall) if s.use_sim_time else None
        self._pace = Pace(clock or WallClock(), period, s.limits.hold)
        self._senses = Senses(settings, sensors, on_map, clock)
        self._lock = threading.Lock()  # of what is commanded
        self._set = np.zeros(4)  # speed, its slope, turn, its slope: what it was told last
        self._link = Rosbridge(s.host, s.port, self._senses.take, s.link)
        self.url = self._link.url
        self._link.last_words = (s.velocity, _twist(0.0, 0.0))
        self._link.advertise(s.velocity, "geometry_msgs/Twist")
        for topic, one in self._senses.topics.items():
            if topic != s.map:
                self._link.subscribe(topic, one.kind, one.queue)
        interval = min(NAP, 0.25 * period)
        self._end_guard = self._pace.clock.guard(self._guard, interval, self.url)
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
        self._pace.end()
        with self._lock:
            self._stop()
        self._senses.forget()
        self._await(lambda: self._senses.silent(self._pace.clock.now()) or self._senses.unrest())
        if wrong := self._senses.misplaced():
            raise InputError(f"{self.url}: {wrong}")
        self._pace.begin()
        self._known.begin(self._senses.odometry[0])
        return self._reading("")

    def drive(self, twist: Array, protective: bool = False) -> Reading:
        """Move what the chair is told towards a twist (2,) [m/s, rad/s], wait a period, and sense.

        Within the limits of speed, acceleration and jerk; but where a sensor is silent the chair is
        told to stand at once, and `Reading.halted` says so; as in a protective stop.

        Raises:
            ValueError: the twist is not two finite numbers, or the chair was never reset.
            ConnectionError: the link is lost; a new chair must be made.
        """
        with self._lock:
            v, w = self._pace.asked(twist)
            why = self._senses.silent(self._pace.clock.now())
            if why or protective:
                self._stop()
            else:
                self._approach(v, w)
        self._pace.rest(self._link.gone)
        self._check()
        return self._reading(why)

    def close(self) -> None:
        """Stop, and let go of the link; may be called again."""
        self._pace.end()
        self._end_guard()
        self._link.close()
        atexit.unregister(self.close)

    def episode(self, goal: ArrayLike, start: ArrayLike | None = None) -> Episode:
        """An episode on the map that ROS tells, from where the chair is to a goal (2 or 3,).

        Args:
            goal: [m, m, rad]; without a heading it gets the one at which the chair has most room.
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
        walls = chart.walls()
        if np.size(goal) == 2:
            end[2], room = roomiest(end, self._known.outline, walls, np.empty((0, 3)))
            if room <= 0.0:
                where = f"({end[0]:g}, {end[1]:g}) m"
                raise InputError(f"{self.url}: no room for the chair at {where}, however it faces")
        return Episode(chart, begin, end, walls, name=self.url)

    def found(self, pose: Array) -> None:
        """What finds it on the map believes it to be at a pose (3,)."""
        self._known.found(pose)

    @property
    def truth(self) -> Truth:
        """The best that is known: the pose believed, the nearest echo; no contact, no energy."""
        return self._known.truth

    @property
    def report(self) -> dict[str, float | str]:
        """What a recording holds of a drive board beside wall time: ROS tells of none."""
        return {}

    @property
    def belief(self) -> Belief:
        """The odometry's own pose."""
        return Belief(self._known.reckoned)

    def _await(self, missing: Callable[[], str]) -> None:
        """Wait until nothing is missing.

        Raises:
            InputError: it still is when patience ends.
            ConnectionError: the link is lost.
        """
        patience = self.settings.limits.patience

        def look() -> str:
            self._check()
            if self._clock is not None and self._clock.still > max(patience, self._clock.stall):
                raise InputError(f"{self.url}: {self._clock.stopped}")
            return missing()

        if why := self._pace.until(look, patience, self._link.gone):
            raise InputError(f"{self.url}: {why}; waited {patience:g} s")

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
        """Take a command back that may not stand any longer."""
        with self._lock:
            late = self._pace.late
            if self._set.any() and (late or self._senses.silent(self._pace.clock.now())):
                self._stop()

    def _reading(self, why: str) -> Reading:
        """What is known now; `why` the chair was not driven as it was told to."""
        senses, now = self._senses, self._pace.clock.now()
        told, twist = senses.odometry
        place = senses.place() if senses.on_map else None
        laser, sonar, ages = senses.ranges(now)
        pose = told if place is None else place.value
        self._known.update(told, pose, twist, laser, False)
        return Reading(
            pose, twist, laser, sonar, ages, False, senses.battery, self._pace.elapsed,
            senses.silent(now) or why,
        )  # fmt: skip


def _twist(v: float, w: float) -> dict[str, dict[str, float]]:
    """A geometry_msgs/Twist."""
    return {
        "linear": {"x": v, "y": 0.0, "z": 0.0},
        "angular": {"x": 0.0, "y": 0.0, "z": w},
    }
