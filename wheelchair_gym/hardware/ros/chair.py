"""A chair that runs under ROS, driven over rosbridge: its topics in, its twist out.

    drive(twist) ──▶ guard ──▶ Twist or TwistStamped          LaserScan ─┐
                       ▲                                       Odometry ─┼─▶ Reading
                       └── stale sensor, late policy: zero   tf, Range ──┘

Ages are by this computer's clock: a message is as old as its arrival, plus its delay beyond that of
the quickest message of its topic, by the stamps. With `use_sim_time`, ages and control periods are
by ROS's simulated time instead. The guard sends zero when a sensor is silent or the policy is late,
and zero is sent whenever the program ends. No program here can stop a chair whose link is cut: the
chair's own computer must stop it when no command comes.
"""

import time
from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from wheelchair_gym.base.arrays import Array
from wheelchair_gym.base.settings import InputError
from wheelchair_gym.geometry.kinematics import approach_twist
from wheelchair_gym.geometry.outline import best_clearance_heading
from wheelchair_gym.hardware.control_loop import POLL_PERIOD, RealChair, WallClock
from wheelchair_gym.hardware.ros.make_messages import twist, twist_stamped
from wheelchair_gym.hardware.ros.rosbridge import Rosbridge
from wheelchair_gym.hardware.ros.senses import RosSensors, SimulatedClock
from wheelchair_gym.hardware.ros.settings import RosSettings
from wheelchair_gym.maps import FREE, OccupancyGrid
from wheelchair_gym.sensors.settings import SensorSettings
from wheelchair_gym.sim.settings import ChairSettings
from wheelchair_gym.types import Episode, Reading


class RosChair(RealChair):
    """A chair behind rosbridge; see `Chair`. It feels no contact.

    Args:
        settings: topics, frames, limits.
        sensors: where the laser and the ultrasonics are mounted, and the number of beams.
        chair: its outline, and the limits of the commands: a base may have none itself.
        period: the control period [s].
        on_map: the pose is that in the frame `map_frame`, by tf; false: by odometry.

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
        if len(sensors.lasers) != 1 + len(settings.more_scans):
            raise InputError(
                f"chair ros: there are {1 + len(settings.more_scans)} topics of scans; "
                f"sensors name {len(sensors.lasers)} laser scanners"
            )
        if len(settings.ultrasonic) not in (0, len(sensors.ultrasonic.mounted)):
            raise InputError(
                f"chair ros: there are {len(settings.ultrasonic)} topics of ultrasonics; "
                f"sensors.ultrasonic.mounted has {len(sensors.ultrasonic.mounted)}"
            )
        self.settings, self.sensors, s = settings, sensors, settings
        self._clock = SimulatedClock(s.clock, s.clock_timeout) if s.use_sim_time else None
        self.senses = RosSensors(settings, sensors, on_map, self._clock)
        self._setpoint = (0.0, 0.0, 0.0, 0.0)  # speed, its slope, turn rate, its slope
        self._link = Rosbridge(s.host, s.port, self.senses.receive, s.link)
        self.url = self._link.url
        super().__init__(
            self.url, self._clock or WallClock(), period, s.limits.command_timeout, chair,
            sensors.laser,
        )  # fmt: skip
        self._link.farewell = (s.velocity, lambda: self._command(0.0, 0.0))
        self._link.advertise(s.velocity, f"geometry_msgs/Twist{'Stamped' * s.stamped}")
        for topic, one in self.senses.topics.items():
            if topic != s.map:
                self._link.subscribe(topic, one.type, one.queue)
        self._start_guard(self._guard, self._stop, min(POLL_PERIOD, 0.25 * period))

    def reset(self, episode: Episode, key: int) -> Reading:
        """Stop, stay in place, and wait for fresh data.

        Args:
            episode: ignored; see `Chair.reset`.
            key: ignored; nothing is random.

        Raises:
            InputError: a topic stays silent, the chair does not come to rest, or the laser is not
                mounted where the settings say.
            ConnectionError: the link is lost.
        """
        self._end()
        with self._lock:
            self._stop()
        self.senses.clear()

        def missing() -> str:
            if wrong := self.senses.laser_mount_error():
                raise InputError(f"{self.url}: {wrong}")
            senses = self.senses
            return senses.stale(self.clock.now()) or senses.unheard() or senses.moving()

        self._await(missing)
        self._begin(self.senses.odometry[0])
        return self._reading("")

    def drive(self, twist: Array, protective: bool = False) -> Reading:
        """Move the commanded twist towards a twist (2,) [m/s, rad/s], wait a period, and sense.

        The command changes within the limits of speed, acceleration and jerk. In a protective stop,
        and where a sensor is silent, it is zero at once, and `Reading.halted` says why.

        Raises:
            ValueError: the twist is not two finite numbers, or the chair was never reset.
            ConnectionError: the link is lost; a new chair must be made.
        """
        with self._lock:
            v, w = self._accept(twist)
            why = self.latched or self.senses.stale(self.clock.now())
            if why or protective:
                self._stop()
            else:
                limits = self.chair.limits.record
                self._setpoint = approach_twist(*self._setpoint, v, w, limits, self.period)
                message = self._command(self._setpoint[0], self._setpoint[2])
                self._link.publish(self.settings.velocity, message)
        self._wait_period(self._link.closed)
        self._check()
        return self._reading(why)

    def close(self) -> None:
        """Stop, and close the link; may be called again."""
        self._end()
        self._stop_guard()
        self._link.close()

    def episode(self, goal: ArrayLike, start: ArrayLike | None = None) -> Episode:
        """An episode on the map that ROS publishes, from the chair's pose to a goal (2 or 3,).

        Args:
            goal: [m, m, rad]; without a heading it gets the one with the largest clearance.
            start: (3,) the chair's pose, instead of that by tf.

        Raises:
            InputError: there is no map, the chair's pose on it is unknown, or the goal is not on
                free ground.
            ConnectionError: the link is lost.
        """
        topic, senses = self.settings.map, self.senses
        senses.forget(topic)  # the map of an earlier call
        self._link.subscribe(topic, senses.topics[topic].type)
        self._await(lambda: "" if senses.map else senses.describe_silence(topic))
        self._link.unsubscribe(topic)  # a large map takes long to read
        grid: OccupancyGrid = senses.map
        if start is None:
            self._await(lambda: "" if senses.map_pose() else senses.describe_missing_pose())
        pose = senses.map_pose()
        begin = np.asarray(start, np.float64) if pose is None or start is not None else pose.value
        end = np.zeros(3)
        end[: np.size(goal)] = goal
        free = grid.inside(end[:2]) and grid.cells[tuple(grid.to_cell(end[:2]))] == FREE
        if not free or not grid.inside(begin[:2]):
            who, at = ("the chair", begin) if free else ("the goal", end)
            where = f"({at[0]:g}, {at[1]:g}) m"
            raise InputError(f"{self.url}: {who} is at {where}; expected free ground of {topic}")
        walls = grid.walls()
        if np.size(goal) == 2:
            end[2], clearance = best_clearance_heading(
                end, self.chair.footprint, walls, np.empty((0, 3))
            )
            if clearance <= 0.0:
                where = f"({end[0]:g}, {end[1]:g}) m"
                raise InputError(f"{self.url}: the chair does not fit at {where} at any heading")
        return Episode(grid, begin, end, walls, name=self.url)

    @property
    def report(self) -> dict[str, float | str]:
        """The state of a drive board, for recordings: empty under ROS."""
        return {}

    def _await(self, missing: Callable[[], str]) -> None:
        """Wait until nothing is missing.

        Raises:
            InputError: something is still missing after the timeout.
            ConnectionError: the link is lost.
        """
        timeout = self.settings.limits.ready_timeout

        def check() -> str:
            self._check()
            clock = self._clock
            if clock is not None and clock.stalled_for > max(timeout, clock.stall):
                raise InputError(f"{self.url}: {clock.stopped}")
            return missing()

        self._require(check, timeout, self._link.closed)

    def _check(self) -> None:
        if self._link.lost:
            raise ConnectionError(f"{self.url}: the link is lost: {self._link.lost}")

    def _stop(self) -> None:
        """Command zero at once."""
        self._setpoint = (0.0, 0.0, 0.0, 0.0)
        self._link.publish(self.settings.velocity, self._command(0.0, 0.0))

    def _command(self, v: float, w: float) -> dict[str, object]:
        """The message that commands a twist."""
        if not self.settings.stamped:
            return twist(v, w)
        now = time.time() if self._clock is None else self._clock.ros_time
        return twist_stamped(round(now * 1e9), v, w, self.settings.base_frame)

    def _guard(self) -> None:
        """Replace a command that is no longer valid by zero."""
        with self._lock:
            stale = self._expired or bool(self.senses.stale(self.clock.now()))
            if any(self._setpoint) and stale:
                self._stop()

    def _reading(self, halted: str) -> Reading:
        senses, now = self.senses, self.clock.now()
        odometry, twist = senses.odometry
        on_map = senses.map_pose() if senses.on_map else None
        ranges = senses.ranges(now)
        pose = odometry if on_map is None else on_map.value
        halted = senses.stale(now) or halted
        return self._reading_of(odometry, pose, twist, ranges, False, senses.battery, halted)
