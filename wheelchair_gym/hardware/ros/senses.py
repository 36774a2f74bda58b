"""Data of a chair under ROS: the newest message of each topic, what is missing, simulated time."""

import logging
import math
import threading
import time
from collections.abc import Callable
from functools import partial
from itertools import takewhile
from typing import Any, NamedTuple

import numpy as np

from wheelchair_gym.base.arrays import Array, Floats
from wheelchair_gym.geometry.planar import relative_pose
from wheelchair_gym.hardware.connection import NEVER, ClockSync, Stamped
from wheelchair_gym.hardware.control_loop import WallClock
from wheelchair_gym.hardware.ros import messages as ros
from wheelchair_gym.hardware.ros.settings import RosSettings
from wheelchair_gym.hardware.settings import REST_SPEED
from wheelchair_gym.sensors.settings import SensorSettings

_POLL = 0.05  # s of wall time between two checks of what else may end a wait


class SimulatedClock(WallClock):
    """The newest time of /clock as a `control_loop.Clock`; it never runs backwards.

    Where a simulation restarts at a smaller time, this clock goes on from its last time. Callbacks
    run by wall time, which goes on while this clock stands.

    Args:
        topic: its name, for error messages.
        stall: s of wall time for which it may stand still.
    """

    def __init__(self, topic: str, stall: float) -> None:
        self.topic, self.stall = topic, stall
        self._now, self._last, self._offset = 0.0, -math.inf, 0.0
        self._moved = time.monotonic()
        self._changed = threading.Condition()

    def update(self, time_: float) -> None:
        """Take a time [s] of /clock."""
        with self._changed:
            if time_ == self._last:
                return
            if time_ < self._last or self._last == -math.inf:
                self._offset = self._now - time_
            self._last, self._now = time_, self._offset + time_
            self._moved = time.monotonic()
            self._changed.notify_all()

    def host_time(self, stamp: float) -> float:
        """When a message was made by this clock, at the latest now.

        Now for an unknown stamp, NaN, and while no time is known: a latched map comes only once.

        Raises:
            ValueError: the stamp is too far ahead to be by this clock.
        """
        now = self.now()
        known = self._last > -math.inf and not math.isnan(stamp)
        made = self._offset + stamp if known else now
        if made - now > 10.0:
            raise ValueError(
                f"is stamped {made - now:.3g} s ahead of {self.topic}; expected simulated time"
            )
        return min(made, now)

    @property
    def ros_time(self) -> float:
        """The newest time of /clock [s]; 0 before the first."""
        return max(0.0, self._last)

    @property
    def stopped(self) -> str:
        """Why time stands still, as a line of text; empty: it runs."""
        stalled = self.stalled_for
        if stalled <= self.stall:
            return ""
        if self._last == -math.inf:
            return (
                f"{self.topic} has reported no time for {stalled:.1f} s: start the simulation, or "
                "set use_sim_time to false in the chair's settings"
            )
        return f"{self.topic} has stood still for {stalled:.1f} s: the simulation is paused or over"

    @property
    def stalled_for(self) -> float:
        """Seconds of wall time since it last advanced."""
        return time.monotonic() - self._moved

    def now(self) -> float:
        """See `Clock.now`."""
        return self._now

    def wait(self, deadline: float, cancelled: threading.Event | None = None) -> None:
        """See `Clock.wait`; ends, too, when the clock has stood still for too long."""
        with self._changed:
            while self._now < deadline and self.stalled_for <= self.stall:
                if cancelled is not None and cancelled.is_set():
                    return
                self._changed.wait(_POLL)
        if self.stopped:
            time.sleep(_POLL)  # a caller that waits again at once does not keep a core busy


_LOG = logging.getLogger(__name__)
_LONGEST = 200  # characters of the description of a bad message
_MOUNT_TOLERANCE = 0.05  # m, rad: largest difference of a laser's pose in tf from the settings'
_BROADCASTERS = 100  # messages that wait: each node sends its transforms at the start


class Topic(NamedTuple):
    """A topic: its type, how it is read, how old the newest may be [s], how many may wait."""

    type: str
    read: Callable[[Any], Any]
    max_age: float = math.inf
    queue: int = 1


class RosSensors:
    """The newest message of each topic, and whether it is fresh enough to drive.

    Messages come in one thread and are read in others: a stored value is never changed, and
    a dictionary over which others iterate is replaced.

    Args:
        settings: topics, frames, limits.
        sensors: what a scan must look like.
        on_map: driving needs a pose on the map, by tf.
        clock: simulated time, for ages; None: real time.
    """

    def __init__(
        self,
        settings: RosSettings,
        sensors: SensorSettings,
        on_map: bool,
        clock: SimulatedClock | None = None,
    ) -> None:
        self.settings, self.sensors, self.on_map, s = settings, sensors, on_map, settings
        self.clock, self._simulated = clock, False
        self._frames: dict[str, str] = {}  # topic of a scan: its frame
        self._lasers = dict(zip((s.scan, *s.more_scans), sensors.lasers, strict=True))
        null = math.nan if s.null_range == "invalid" else math.inf
        self.topics: dict[str, Topic] = {}
        for topic, laser in self._lasers.items():
            read = partial(ros.scan, laser=laser, null=null)
            self.topics[topic] = Topic("sensor_msgs/LaserScan", read, s.limits.scan)
        self.topics |= {
            s.odometry: Topic("nav_msgs/Odometry", ros.odometry, s.limits.odometry),
            s.tf: Topic("tf2_msgs/TFMessage", ros.transforms, queue=_BROADCASTERS),
            s.tf_static: Topic("tf2_msgs/TFMessage", ros.transforms, queue=_BROADCASTERS),
            s.clock: Topic("rosgraph_msgs/Clock", lambda message: ros.seconds(message["clock"])),
            s.map: Topic("nav_msgs/OccupancyGrid", ros.grid),
        }
        for topic in s.ultrasonic:
            self.topics[topic] = Topic("sensor_msgs/Range", partial(ros.distance, null=null))
        if s.battery:
            self.topics[s.battery] = Topic("sensor_msgs/BatteryState", ros.voltage)
        self._rigid: dict[str, tuple[str, Array, float]] = {}
        self._clocks: dict[str, ClockSync] = {}
        self._wrong: dict[str, str] = {}  # topic: what was wrong with its last message
        self.clear()

    def clear(self) -> None:
        """Forget all messages but static transforms, which are sent once.

        What is known of the clocks stays, unless the last message of a topic was refused.
        """
        self._newest: dict[str, Stamped] = {}
        self._moved: dict[str, tuple[str, Array, float]] = {}  # child: parent, pose, when
        self._clocks = {k: clock for k, clock in self._clocks.items() if k not in self._wrong}
        self._wrong = {}
        self._warned: set[str] = set()

    def forget(self, topic: str) -> None:
        """Forget the newest message of a topic."""
        self._newest.pop(topic, None)

    def receive(self, topic: str, message: Any, came: float) -> None:
        """Store a message, or what is wrong with it; runs in the link's thread."""
        if topic not in self.topics:
            return
        s = self.settings
        try:
            if topic in self._lasers:
                message = self._upright(topic, message)
            value = self.topics[topic].read(message)
            if self.clock is not None:
                came = self.clock.now()
            if topic == s.clock:
                self._simulated = True
                if self.clock is not None:
                    self.clock.update(value)
            elif topic == s.tf:
                edges = {child: (parent, pose, came) for parent, child, pose in value}
                self._moved = {**self._moved, **edges}
            elif topic == s.tf_static:
                edges = {child: (parent, pose, math.inf) for parent, child, pose in value}
                self._rigid = {**self._rigid, **edges}
                for one in self._lasers:  # those that came before were read without it
                    self.forget(one)
            else:
                stamp = ros.stamp(message["header"])  # a latched map comes again with its stamp
                made = came if topic == s.map else self._made_at(topic, stamp, came)
                self._newest[topic] = Stamped(value, made)
            self._wrong.pop(topic, None)
        except KeyError as error:
            self._refuse(topic, f"lacks {error}")
        except ValueError as error:
            self._refuse(topic, str(error))
        except (AttributeError, IndexError, OverflowError, TypeError):
            self._refuse(topic, "is not made as its type says")

    def _made_at(self, topic: str, stamp: float, came: float) -> float:
        """When a message was made that came then, by the clock of all ages."""
        if self.clock is not None:
            return self.clock.host_time(stamp)
        s = self.settings
        if (clock := self._clocks.get(topic)) is None:
            clock = ClockSync(s.limits.clock_drift, s.clock_error or math.inf)
            self._clocks = {**self._clocks, topic: clock}
        return clock.host_time(stamp, came)

    def _refuse(self, topic: str, why: str) -> None:
        self._wrong[topic] = why = " ".join(why.split())[:_LONGEST]
        if topic not in self._warned:
            self._warned.add(topic)
            _LOG.warning("a message of %s %s; it is not used", topic, why)

    def stale(self, now: float) -> str:
        """Data that driving needs and that are too old or missing; empty: none."""
        if self.clock is not None and (why := self.clock.stopped):
            return why
        for topic, one in self.topics.items():
            if now - self._newest.get(topic, NEVER).measured_at > one.max_age:
                return self.describe_silence(topic)
        limit, clocks = self.settings.limits.latency, self._clocks  # `clear` makes others meanwhile
        for topic in (*self._lasers, self.settings.odometry):
            if topic in clocks and (latency := clocks[topic].latency) > limit:
                return (
                    f"{topic} is late: its messages may be {latency:.2f} s old when they come, at "
                    f"most {limit:g} s are allowed"
                )
        if self.on_map:
            pose = self.map_pose()
            if pose is None or now - pose.measured_at > self.settings.limits.pose:
                return self.describe_missing_pose()
        return ""

    def unheard(self) -> str:
        """That an ultrasonic has sent nothing yet; empty: all have."""
        silent = (topic for topic in self.settings.ultrasonic if topic not in self._newest)
        return next(map(self.describe_silence, silent), "")

    @property
    def odometry(self) -> tuple[Array, Array]:
        """Pose (3,) and twist (2,)."""
        odometry: tuple[Array, Array] = self._newest[self.settings.odometry].value
        return odometry

    @property
    def map(self) -> Any:
        """The map, or None."""
        return self._newest.get(self.settings.map, Stamped(None, 0.0)).value

    @property
    def battery(self) -> float:
        """[V], or NaN."""
        return float(self._newest.get(self.settings.battery, NEVER).value)

    def describe_silence(self, topic: str) -> str:
        """That a topic is silent, and what was wrong with its last message."""
        wrong = self._wrong.get(topic)
        text = f"{topic} is silent" + (f" (its last message {wrong})" if wrong else "")
        if not wrong and topic not in self._newest:
            text += ": does its node run, is this its name?"
        if self._simulated and self.clock is None:
            text += f"; {self.settings.clock} has simulated time: for a simulation set use_sim_time"
        return text

    def describe_missing_pose(self) -> str:
        """That tf does not lead from the map to the chair."""
        s = self.settings
        return f"{s.tf} does not report where {s.base_frame} is on {s.map_frame}"

    def moving(self) -> str:
        """That the chair moves; empty: it is at rest."""
        v, w = self.odometry[1]
        moves = max(abs(v), abs(w)) > REST_SPEED
        return f"it does not come to rest ({v:.2f} m/s, {w:.2f} rad/s)" if moves else ""

    def map_pose(self) -> Stamped | None:
        """The pose (3,) on the map by tf, as old as the oldest transform of its chain."""
        return self.pose_in(self.settings.base_frame, self.settings.map_frame)

    def laser_mount_error(self) -> str:
        """That a laser's pose in tf is not that of the settings; empty: it is, or is unknown."""
        wrong = (self._mount(topic, frame)[0] for topic, frame in self._frames.items())
        return next(filter(None, wrong), "")

    def _upright(self, topic: str, message: Any) -> Any:
        """Return a scan as an upright laser gives it.

        Raises:
            ValueError: the frame of the scan is not where the settings have the laser.
        """
        frame = ros.frame(message)
        self._frames = {**self._frames, topic: frame}
        wrong, upside_down = self._mount(topic, frame)
        if wrong:
            raise ValueError(f"is of frame {frame}: {wrong}")
        return ros.upright(message, True) if upside_down else message

    def _mount(self, topic: str, frame: str) -> tuple[str, bool]:
        """Return what is wrong with a laser's mount in tf, and whether it hangs upside down."""
        s, laser = self.settings, self._lasers[topic]
        if (chain := self._chain(frame, s.base_frame)) is None:
            return "", False
        try:
            (x, y, yaw), upside_down = ros.on_floor(chain[0])
        except ValueError as error:
            return f"by {s.tf} the laser {error}", False
        apart = relative_pose((laser.x, laser.y, laser.yaw), (x, y, yaw))
        if max(np.hypot(*apart[:2]), abs(apart[2])) <= _MOUNT_TOLERANCE:
            return "", upside_down
        number = list(self._lasers).index(topic)
        name = f"sensors.more_lasers[{number - 1}]" if number else "sensors.laser"
        return (
            f"{s.tf} has the laser at ({x:.2f}, {y:.2f}) m, {math.degrees(yaw):.0f} deg; "
            f"{name} says ({laser.x:.2f}, {laser.y:.2f}) m, {math.degrees(laser.yaw):.0f} deg"
        ), upside_down

    def _chain(self, frame: str, root: str) -> tuple[Array, float] | None:
        """Return the matrix (4, 4) of a frame in one above it, and its time; None: unknown."""
        edges = {**self._rigid, **self._moved}
        above = ros.way_up({child: edge[:2] for child, edge in edges.items()}, frame)
        if root not in above:
            return None
        frames = takewhile(lambda one: one != root, above)
        return above[root], min((edges[one][2] for one in frames), default=math.inf)

    def pose_in(self, frame: str, root: str) -> Stamped | None:
        """The pose (3,) of an upright frame in one above it."""
        if (chain := self._chain(frame, root)) is None:
            return None
        try:
            pose, upside_down = ros.on_floor(chain[0])
        except ValueError:
            return None
        return None if upside_down else Stamped(pose, chain[1])

    def ranges(self, now: float) -> tuple[Floats, Floats, Floats]:
        """Laser, ultrasonics and their ages; what is too old is invalid."""
        s = self.settings
        scans = []
        for topic, laser in self._lasers.items():
            scan = self._newest.get(topic, NEVER)
            fresh = now - scan.measured_at <= s.limits.scan
            scans.append(scan.value if fresh else np.full(laser.beams, np.nan, np.float32))
        newest = [self._newest.get(topic, NEVER) for topic in s.ultrasonic]
        newest += [NEVER] * (self.sensors.ultrasonic.columns - len(newest))
        ages = np.array([now - one.measured_at for one in newest], np.float32)
        values = np.array([one.value for one in newest], np.float32)
        values[ages > s.limits.ultrasonic] = np.nan
        return np.concatenate(scans), values, ages
