"""The simulated chair as a ROS 2 robot: publishes what it senses, and drives by /cmd_vel.

    NavigationEnv ──▶ Robot.act ──▶ /scan, /odom, /tf, ... ──▶ rosbridge ──▶ nav2, RViz, ...
          ▲               │                                                          │
          └── shield ◀────┘ the last twist, zero after a silence ◀── /cmd_vel ◀──────┘

`Robot` is a policy, so that `agents.evaluation.evaluate.drive_episode` runs and scores the program
that commands it like every other policy.
"""

import math
import sys
import threading
import time
from collections.abc import Callable, Mapping
from functools import cache, partial
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np

from wheelchair_gym.base.settings import setting, settings
from wheelchair_gym.hardware.ros import make_messages as ros
from wheelchair_gym.hardware.ros.messages import seconds
from wheelchair_gym.hardware.ros.rosbridge import RosbridgeServer
from wheelchair_gym.sensors.odometry import OdometryCovariance
from wheelchair_gym.types import Belief, Command, Mission, Reading

COMMAND: Final = "/cmd_vel"
COMMAND_TYPES: Final = ("geometry_msgs/Twist", "geometry_msgs/TwistStamped")
SERVICES: Final = ("/next_episode", "/restart_episode")  # of std_srvs/srv/Trigger
COMMAND_TIMEOUT: Final = 0.5  # s for which the last command is driven: twist_mux (ROS)
_BATTERY_PERIOD = 1.0  # s
_LATE = 1.0  # s: later periods are not made up for


class RobotSettings(NamedTuple):
    """Settings of the robot: topics that it publishes, and their rates.

    Attributes:
        scan_rate: of scans [Hz]; odometry, transforms and clock come in every control period.
        speed: simulated time, times real time, published on /clock; 0: stamps are of real time,
            and there is no /clock.
        localized: publish /map, /goal_pose and the transform map -> odom; false: amcl or
            slam_toolbox does.
        imu: publish the turn rate on /imu.
        namespace: prefix of topics, services and frames, see `Namespace`; empty: none.
    """

    scan_rate: float = 10.0  # as nav2_loopback_sim
    speed: float = 0.0
    localized: bool = True
    imu: bool = False
    namespace: str = ""


class Robot:
    """The policy that drives as /cmd_vel says; see `Policy`.

    Args:
        config: rates and limits.
        log: is called with lines for a person: the chair stops, a message is wrong.
        waits: an episode begins with its first command.

    Attributes:
        link: where messages go, a rosbridge server, a client of one, or DDS; to be set before the
            first reset.
        names: of topics, services and frames.
        service: the one called to end the episode; empty: none.
        late: control periods that ended more than `_LATE` after their time.
    """

    def __init__(
        self, config: RobotSettings, log: Callable[[str], object], waits: bool = False
    ) -> None:
        self.config, self._log, self._waits = config, log, waits
        self.names = ros.Namespace(config.namespace)
        self.link: Any
        self.service, self.late = "", 0
        self._lock = threading.Lock()
        self._twist, self._fresh = (0.0, 0.0), False
        self._commander: object = None
        self._silent, self._stopped = math.inf, True
        self._elapsed = 1.0  # s of simulated time: for tf2, a stamp of 0 means the newest
        self._wrong: set[str] = set()

    def server(
        self, host: str, port: int, token: str = "", certificate: str | Path | None = None
    ) -> RosbridgeServer:
        """Serve this robot by rosbridge; see `RosbridgeServer`."""
        link = RosbridgeServer(host, port, self.command, self.left, token, certificate)
        link.listens[self.names.of(COMMAND)] = COMMAND_TYPES
        link.serve("/rosapi/get_time", "rosapi_msgs/srv/GetTime", self.get_time)
        return link

    def connect(self, link: Any, mission: Mission, end: Callable[[], bool]) -> None:
        """Announce all topics of a chair with the mission's sensors.

        Args:
            link: where messages go.
            mission: any of this chair.
            end: whether the program is to end.
        """
        self.link, self._end = link, end
        config, sensors = self.config, mission.sensors
        topics = ["/tf", "/tf_static", "/odom", "/battery_state", "/footprint"]
        topics += ["/clock"] * (config.speed > 0.0) + ["/imu"] * config.imu
        topics += ["/map", "/goal_pose"] * config.localized
        topics += [ros.scanner_name(k, "/scan") for k in range(len(sensors.lasers))]
        topics += [f"/ultrasonic_{k}" for k in range(len(sensors.ultrasonic.mounted))]
        for topic in topics:
            kind = ros.TOPICS[ros.general(topic)]
            link.advertise(self.names.of(topic), kind.type, kind.latched)

    def reset(self, mission: Mission) -> None:
        """Publish the world and the goal of a new episode."""
        self.service, self._mission = "", mission
        self._published, self._awaits = 0, self._waits
        with self._lock:
            self._twist, self._silent, self._stopped, self._fresh = (0.0, 0.0), 0.0, True, False
        self._stamp, sensors = self._now(), mission.sensors
        self._covariance = OdometryCovariance(mission.chair.drive, sensors, mission.period)
        self._send("/tf_static", sensors.lasers, sensors.ultrasonic)
        self._send("/footprint", mission.footprint.corners)
        if self.config.localized and mission.map is not None:
            self._send("/map", mission.map)
            # A message has a heading, also where none counts.
            self._send("/goal_pose", [*mission.goal, 0.0][:3])
        self._due = time.monotonic()

    def follow(self, env: Any) -> bool:
        """Take the odometry of the environment's chair; whether the episode is to end."""
        inner = env.unwrapped
        self._odometry = (inner.chair.belief or Belief(inner.task.reading.pose)).odometry
        return bool(self.service) or self._end()

    def act(self, reading: Reading) -> Command:
        """Wait for a control period, and return the last command; zero after a silence."""
        self._publish(reading)
        if self._awaits:
            self._awaits = False
            self.stand(reading, lambda: self._fresh)
        self._pass_period()
        with self._lock:
            fresh, self._fresh = self._fresh, False
            self._silent = 0.0 if fresh else self._silent + self._mission.period
            if self._silent > COMMAND_TIMEOUT:
                self._stop(f"{self.names.of(COMMAND)} is silent for {COMMAND_TIMEOUT:g} s")
            elif any(self._twist):
                self._stopped = False
            return Command(np.array(self._twist))

    def stand(self, reading: Reading, done: Callable[[], bool]) -> None:
        """Stand still and go on publishing until `done`, or until the program is to end."""
        still = reading._replace(twist=np.zeros(2))
        while not (done() or self.service or self._end()):
            self._pass_period()
            self._publish(still)

    def command(self, topic: str, message: Any, sender: object = None) -> str:
        """Take a Twist or TwistStamped from a sender; returns what is wrong with it, or nothing."""
        try:
            twist = message.get("twist", message)
            v, w = twist["linear"]["x"], twist["angular"]["z"]
            if not all(type(one) in (int, float) and math.isfinite(one) for one in (v, w)):
                raise ValueError
            made = seconds(message["header"]["stamp"]) if twist is not message else 0.0
        except (AttributeError, KeyError, TypeError, ValueError, OverflowError):
            return self._refuse(
                f"{topic}: expected a Twist, or a TwistStamped with a header, of finite numbers"
            )
        if made and abs(self._now() / ros.NANO - made) > COMMAND_TIMEOUT:
            return self._refuse(
                f"{topic}: is stamped more than {COMMAND_TIMEOUT:g} s from now; expected fresh "
                "commands, clocks that agree, or a stamp of 0"
            )
        with self._lock:
            self._twist, self._commander, self._fresh = (float(v), float(w)), sender, True
        return ""

    def _refuse(self, why: str) -> str:
        """Log once what is wrong with messages, and return it."""
        if why not in self._wrong:
            self._wrong.add(why)
            self._log(f"{why}; such messages are not used")
        return why

    def left(self, client: object) -> None:
        """Stop the chair if the client that is gone has commanded it."""
        with self._lock:
            if client == self._commander:
                self._stop("the client that commanded is gone")

    def ask(self, service: str, arguments: Mapping[str, Any]) -> dict[str, Any]:
        """End the episode for a service, and return its answer, as of std_srvs/srv/Trigger."""
        self.service = service
        return {"success": True, "message": "an episode begins"}

    def get_time(self, arguments: Mapping[str, Any]) -> dict[str, Any]:
        """Return the time of messages, as the answer of rosapi/srv/GetTime."""
        now = ros.time(self._now())
        return {"time": now | {"secs": now["sec"], "nsecs": now["nanosec"]}}  # roslibpy: ROS 1's

    def _stop(self, why: str) -> None:
        """Stand still from now on; with the lock held."""
        self._twist = (0.0, 0.0)
        if not self._stopped:
            self._stopped = True
            self._log(f"{why}: the chair stops")

    def _now(self) -> int:
        """Return the time of messages [ns]."""
        if self.config.speed > 0.0:
            return round(self._elapsed * ros.NANO)
        return time.time_ns()

    def _pass_period(self) -> None:
        """Wait for the end of the control period in real time."""
        period = self._mission.period
        self._elapsed += period
        self._due += period / (self.config.speed or 1.0)
        wait = self._due - time.monotonic()
        if wait > 0.0:
            time.sleep(wait)
        elif wait < -_LATE:
            self.late, self._due = self.late + 1, time.monotonic()

    def _publish(self, reading: Reading) -> None:
        """Publish a reading, as of now."""
        if self.link.lost:
            raise ConnectionError(f"ROS: the link is lost: {self.link.lost}")
        self._stamp = self._now()
        config, odometry, twist = self.config, self._odometry, reading.twist
        if config.speed > 0.0:
            self._send("/clock")
        self._send("/tf", reading.pose if config.localized else None, odometry)
        spread = self._covariance.update(float(odometry[2]), twist)
        self._send("/odom", odometry, twist, spread)
        if config.imu:
            self._send("/imu", float(twist[1]), float(spread[1][1, 1]))
        sensors = self._mission.sensors
        if self._is_due(1.0 / config.scan_rate):
            for k, (laser, part) in enumerate(zip(sensors.lasers, sensors.slices, strict=True)):
                self._send(ros.scanner_name(k, "/scan"), laser, reading.laser[part], k)
            self._send("/ultrasonic", sensors.ultrasonic, reading.ultrasonic, reading.age)
        if self._is_due(_BATTERY_PERIOD):
            self._send("/battery_state", reading.battery)
        self._published += 1

    def _send(self, topic: str, *content: Any) -> None:
        """Publish the message that a topic has of content, in the namespace."""
        made = ros.TOPICS[ros.general(topic)].messages(topic, self._stamp, *content)
        for name, message in made.items():
            self.link.publish(self.names.of(name), self.names.within(message))

    def _is_due(self, interval: float) -> bool:
        """Return whether a message with an interval [s] is due in this control period."""
        periods = max(1.0, interval / self._mission.period)
        passed = [int(count / periods + 1e-9) for count in (self._published - 1, self._published)]
        return self._published == 0 or passed[0] < passed[1]


@settings
class RosClient:
    """A program that knows ROS drives by /cmd_vel, in real time; each drive waits for it."""

    port: int = setting(default=9090, low=0, high=65535)
    """Of a rosbridge server on this machine, to which the program connects; 0: a free one."""
    speed: float = setting(default=0.0, low=0.0, high=100.0)
    """Simulated time, times real time, published on /clock; 0: real time, and no /clock."""

    def make(self) -> "ClientDriver":
        """The policy, whose program stays connected from drive to drive of this process."""
        return _driver(self.port, self.speed)


class ClientDriver(Robot):
    """A robot that has its readings alone: its odometry is the pose that it reads.

    Raises:
        InputError: the extra 'ros' is not installed, or the port is taken.
    """

    def __init__(self, port: int, speed: float) -> None:
        super().__init__(RobotSettings(speed=speed), partial(print, file=sys.stderr), waits=True)
        self.link = self.server("127.0.0.1", port)
        self._log(f"rosbridge {self.link.url}: the chair waits for commands")

    def reset(self, mission: Mission) -> None:
        """See `Policy.reset`."""
        self.connect(self.link, mission, lambda: False)
        super().reset(mission)

    def act(self, reading: Reading) -> Command:
        """See `Policy.act`."""
        self._odometry = reading.pose
        return super().act(reading)


_driver = cache(ClientDriver)
