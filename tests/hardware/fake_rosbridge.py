"""A rosbridge server with a simulated chair behind it, which does as it is told and no better.

It speaks the protocol over a real WebSocket: subscribe, unsubscribe, advertise, publish, status.
The chair has no watchdog of its own: it keeps to the last command for ever. Its clock is not ours.
"""

import json
import math
import threading
import time
from contextlib import suppress

import numpy as np
from websockets.exceptions import ConnectionClosed
from websockets.sync.server import serve

from wheelchair_gym.geometry.planar import map_to_odom
from wheelchair_gym.scenes import make_scene
from wheelchair_gym.sensors.settings import LaserSettings, SensorSettings
from wheelchair_gym.sim.chair import SimulatedChair

CLOCK = 12_345.678  # s, ahead of ours
CONTROL_PERIOD = 0.1  # s
IDLE = 0.2  # s without a command, after which a world that waits for commands makes a step
SENSORS = SensorSettings(laser=LaserSettings(beams=181), pose_source="odometry")
RANGERS = tuple(f"/ultrasonic/{k}" for k in range(8))


def turned(yaw):
    return {"x": 0.0, "y": 0.0, "z": math.sin(yaw / 2), "w": math.cos(yaw / 2)}


def at(x, y):
    return {"x": float(x), "y": float(y), "z": 0.0}


def said(value):
    """A number as rosbridge writes it: null, where JSON has no word for it."""
    return float(value) if math.isfinite(value) else None


class FakeRosbridge:
    """Serves from when it is made until `close`.

    Attributes:
        port: where.
        commands: what the chair was told: (when, v, w).
        mangle: topic -> what becomes of its messages: another message, a text sent as it is, or
            None, where nothing is said.
        rate: of simulated time, told at /clock; infinite: each command lets a control period pass,
            however slow the machine is; None: time is real, and there is no /clock.
        paused: simulated time stands.
        statics: what the broadcasters of /tf_static say, each in a message of its own, at once; of
            messages that wait only as many are sent as the client said its queue may hold.
        chair: the simulated one.
    """

    def __init__(self, episode=None, sensors=SENSORS, period=0.05, rate=None):
        self.rate, self.paused, self.simulated = rate, False, 0.0
        self.episode = episode or make_scene("empty").sample(np.random.default_rng(0))
        self.sensors, self.period = sensors, period
        self.chair = SimulatedChair(sensors=sensors, period=period)
        self.chair.reset(self.episode, 1)
        self.chair.drive(np.zeros(2))  # compiled before anybody waits for it
        self.reading = self.chair.reset(self.episode, 1)
        self.commands, self.mangle = [], {}
        self.skew, self.advertised = 0.0, {}
        laser = sensors.laser
        self.mounted = laser.x, laser.y, laser.yaw  # of the laser, as tf tells
        self.statics = [lambda: self._edge("base_link", "laser_link", self.mounted)]
        self._latched = {
            "/map": lambda: [self._map()],
            "/tf_static": lambda: [{"transforms": [edge()]} for edge in self.statics],
        }
        self._told = {}  # connection -> topics
        self._command = np.zeros(2)
        self._due = threading.Semaphore(0)  # steps of the world that commands have let pass
        self._ended = threading.Event()
        self._server = serve(self._serve, "127.0.0.1", 0, compression=None)
        self.port = self._server.socket.getsockname()[1]
        self.url = f"ros://127.0.0.1:{self.port}"
        self._threads = [
            threading.Thread(target=work, daemon=True)
            for work in (self._server.serve_forever, self._live)
        ]
        for thread in self._threads:
            thread.start()

    def close(self):
        self._ended.set()
        self._server.shutdown()
        for thread in self._threads:
            thread.join()

    def cut(self):
        for connection in list(self._told):
            connection.socket.shutdown(2)

    def say(self, text):
        for connection in list(self._told):
            connection.send(text)

    @property
    def still(self):
        return not self.commands or self.commands[-1][1:] == (0.0, 0.0)

    def _serve(self, connection):
        topics = self._told[connection] = set()
        try:
            with suppress(ConnectionClosed):
                for text in connection:
                    self._obey(connection, topics, json.loads(text))
        finally:
            del self._told[connection]

    def _obey(self, connection, topics, content):
        operation, topic = content["op"], content.get("topic")
        if operation == "subscribe":
            topics.add(topic)
            if topic in self._latched:
                for message in self._latched[topic]()[-content.get("queue_length", 1 << 30) :]:
                    self._publish(connection, topic, message)
        elif operation == "unsubscribe":
            topics.discard(topic)
        elif operation == "advertise":
            self.advertised[topic] = content["type"]
        elif operation == "publish" and topic in self.advertised:
            msg = content["msg"]
            v, w = msg["linear"]["x"], msg["angular"]["z"]
            self.commands.append((time.monotonic(), v, w))
            self._command = np.array([v, w])
            self._due.release(round(CONTROL_PERIOD / self.period))
        else:
            why = {"op": "status", "level": "error", "msg": f"cannot {operation} {topic}"}
            connection.send(json.dumps(why))

    def _live(self):
        due = time.monotonic()
        while not self._ended.is_set():
            if self.paused:
                time.sleep(0.01)
                due = time.monotonic()
                continue
            if self.rate == math.inf:
                self._due.acquire(timeout=IDLE)
            self.simulated += self.period
            self.reading = self.chair.drive(self._command)
            for connection, topics in list(self._told.items()):
                for topic, make in self._messages().items():
                    if topic in topics:
                        self._publish(connection, topic, make())
            due = max(due + self.period / (self.rate or 1.0), time.monotonic())  # no hurry
            time.sleep(max(0.0, due - time.monotonic()))

    def _publish(self, connection, topic, message):
        if topic in self.mangle:
            message = self.mangle[topic](message)
        if message is None:
            return
        whole = {"op": "publish", "topic": topic, "msg": message}
        with suppress(ConnectionClosed, OSError):
            connection.send(message if isinstance(message, str) else json.dumps(whole))

    def _header(self, frame):
        return {"seq": 0, "frame_id": frame, "stamp": self._time()}

    def _time(self):
        now = time.monotonic() if self.rate is None else self.simulated
        stamp = now + CLOCK + self.skew
        second = int(stamp)
        return {"secs": second, "nsecs": int(1e9 * (stamp - second))}

    def _messages(self):
        reading, truth = self.reading, self.chair.truth
        made = {} if self.rate is None else {"/clock": lambda: {"clock": self._time()}}
        made |= {
            "/scan": self._scan,
            "/ARDUINO1/Odom": self._odometry,
            "/tf": lambda: {
                "transforms": [
                    self._edge("map", "/odometry", map_to_odom(truth.pose, reading.pose)),
                    self._edge("odometry", "base_link", reading.pose),
                ]
            },
            "/battery": lambda: {"header": self._header(""), "voltage": reading.battery},
        }
        for k, topic in enumerate(RANGERS):
            made[topic] = lambda k=k: {
                "header": self._header(f"u{k}"), "radiation_type": 0, "min_range": 0.02,
                "max_range": 4.0, "range": said(reading.ultrasonic[k]),
            }  # fmt: skip
        return made

    def _scan(self):
        laser = self.sensors.laser
        return {
            "header": self._header("laser_link"), "angle_min": -laser.fov / 2,
            "angle_max": laser.fov / 2, "angle_increment": laser.fov / (laser.beams - 1),
            "range_min": laser.range_min, "range_max": 30.0, "intensities": [],
            "ranges": [said(value) for value in self.reading.laser],
        }  # fmt: skip

    def _odometry(self):
        (x, y, yaw), (v, w) = self.reading.pose, self.reading.twist
        pose = {"position": at(x, y), "orientation": turned(yaw)}
        twist = {"linear": at(v, 0.0), "angular": {"x": 0.0, "y": 0.0, "z": float(w)}}
        return {
            "header": self._header("odometry"), "child_frame_id": "base_link",
            "pose": {"pose": pose, "covariance": [0.0] * 36},
            "twist": {"twist": twist, "covariance": [0.0] * 36},
        }  # fmt: skip

    def _edge(self, parent, child, pose):
        x, y, yaw = pose
        return {
            "header": self._header(parent), "child_frame_id": child,
            "transform": {"translation": at(x, y), "rotation": turned(yaw)},
        }  # fmt: skip

    def _map(self):
        grid = self.episode.map
        x, y, yaw = grid.origin
        return {
            "header": self._header("map"),
            "info": {
                "resolution": grid.resolution, "width": grid.shape[1], "height": grid.shape[0],
                "origin": {"position": at(x, y), "orientation": turned(yaw)},
            },
            "data": grid.cells.ravel().tolist(),
        }  # fmt: skip
