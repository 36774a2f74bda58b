"""Laws of the robot: others can read what it publishes, and silence of /cmd_vel stops it.

Clients are plain WebSockets and the example's controller, which import nothing of the project.
"""

import json
import math
import shutil
import socket
import ssl
import struct
import subprocess
import sys
import threading
import time
from collections import Counter
from contextlib import ExitStack, closing, suppress
from types import SimpleNamespace
from unittest.mock import Mock

import numpy as np
import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect

from agents.cli import main
from agents.robot import Robot, RobotSettings
from tests.conftest import PATIENCE, ROOT, long_but, refusal, until
from tests.hardware.served import Served, frozen
from wheelchair_gym import InputError
from wheelchair_gym.geometry.kinematics import DriveGeometry
from wheelchair_gym.hardware.ros import make_messages, rosbridge
from wheelchair_gym.hardware.ros import messages as ros
from wheelchair_gym.hardware.ros.rosbridge import Rosbridge, RosbridgeServer, strict
from wheelchair_gym.hardware.ros.settings import RosbridgeSettings
from wheelchair_gym.hardware.ros.sockets import TurnsSocket
from wheelchair_gym.recording.replay import read_recording
from wheelchair_gym.scenes import make_scene
from wheelchair_gym.sensors.odometry import OdometryCovariance
from wheelchair_gym.sensors.settings import LaserSettings, SensorSettings
from wheelchair_gym.sim.chair import SimulatedChair

CONTROLLER = ROOT / "examples" / "ros_pure_pursuit.py"


@pytest.fixture(scope="module")
def robot():
    with closing(Served("--scene", "empty", "--imu", "--pose", "odometry")) as served:
        yield served


class Client:
    """A client that knows the protocol alone."""

    def __init__(self, url, *topics, **more):
        self._stack = ExitStack()
        self.link = self._stack.enter_context(connect(url, max_size=None, compression=None, **more))
        self.newest, self.counts, self.answers = {}, Counter(), []
        for topic in topics:
            self.send(op="subscribe", topic=topic)
        self._thread = threading.Thread(target=self._listen, daemon=True)
        self._thread.start()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self._stack.close()
        self._thread.join()

    def _listen(self):
        with suppress(ConnectionClosed):
            for text in self.link:
                message = json.loads(text, parse_constant=pytest.fail)  # JavaScript reads no NaN
                if message["op"] == "publish":
                    self.newest[message["topic"]] = message["msg"]
                    self.counts[message["topic"]] += 1
                else:
                    self.answers.append(message)

    def send(self, **content):
        self.link.send(json.dumps(content))

    def drive(self, v, w=0.0, stamped=False, age=0.0):
        message = {"linear": {"x": v, "y": 0.0, "z": 0.0}, "angular": {"x": 0.0, "y": 0.0, "z": w}}
        if stamped:
            second, part = divmod(time.time_ns() - round(1e9 * age), 10**9)
            stamp = {"sec": second, "nanosec": part}
            message = {"header": {"frame_id": "", "stamp": stamp}, "twist": message}
        self.send(op="publish", topic="/cmd_vel", msg=message)

    @property
    def speed(self):
        twist = self.newest["/odom"]["twist"]["twist"]
        return max(abs(twist["linear"]["x"]), abs(twist["angular"]["z"]))

    @property
    def moving(self):
        return self.speed > 0.1

    @property
    def still(self):
        return self.speed < 0.02


def driven(client, stamped=False):
    """The client, while the chair turns on the spot by its commands."""
    assert until(lambda: "/odom" in client.newest)
    assert until(lambda: client.drive(0.0, 0.6, stamped) or client.moving)
    return client


TOPICS = (
    "/scan", "/odom", "/tf", "/tf_static", "/map", "/goal_pose", "/battery_state", "/imu",
    "/footprint", *(f"/ultrasonic_{k}" for k in range(8)),
)  # fmt: skip


def test_everything_is_published_and_can_be_read(robot):
    """The readers are those of a chair under ROS."""
    with Client(robot.url, *TOPICS) as client:
        assert until(lambda: set(TOPICS) <= client.newest.keys())
        newest, sensors = client.newest, SensorSettings()
        ranges = ros.scan(newest["/scan"], sensors.laser, math.inf)
        assert np.isfinite(ranges).mean() > 0.5
        ros.odometry(newest["/odom"])
        grid = ros.grid(newest["/map"])
        edges = {child: (parent, pose) for parent, child, pose in ros.transforms(newest["/tf"])}
        assert {child: parent for child, (parent, _) in edges.items()} == {
            "odom": "map", "base_link": "odom"
        }  # fmt: skip
        mounts = {c: ros.on_floor(at)[0] for _, c, at in ros.transforms(newest["/tf_static"])}
        assert mounts["laser"][0] == sensors.laser.x
        assert len(mounts) == 9
        assert grid.inside(edges["odom"][1][:2, 3])
        assert all(ros.distance(newest[f"/ultrasonic_{k}"], math.inf) > 0.0 for k in range(8))
        assert ros.voltage(newest["/battery_state"]) > 20.0
        stamps = [ros.stamp(newest[topic]["header"]) for topic in ("/scan", "/odom", "/imu")]
        assert max(abs(stamp - time.time()) for stamp in stamps) < PATIENCE
        assert not client.answers


def test_it_drives_as_both_kinds_of_twist_say(robot):
    for stamped in (False, True):
        with driven(Client(robot.url, "/odom"), stamped) as client:
            client.drive(0.0, 0.0, stamped)
            assert until(lambda: client.still)


@pytest.mark.parametrize("way", ["muted", "left", "cut"])
def test_silence_stops_it_and_is_said(robot, way):
    watcher, before = Client(robot.url, "/odom"), len(robot.errors)
    said = "is silent for 0.5 s" if way == "muted" else "the client that commanded is gone"

    def is_said():
        """Whether it is; a client that is slow to leave is silent first."""
        with driven(Client(robot.url, "/odom")) as client:
            assert until(lambda: client.drive(0.0, 0.6) or watcher.moving)
            if way == "left":
                client.link.close()
            elif way == "cut":
                client.link.socket.shutdown(2)
            assert until(lambda: watcher.still)
        assert until(lambda: len(robot.errors) > before)
        return any(f"{said}: the chair stops" in line for line in robot.errors[before:])

    with watcher:
        assert until(lambda: "/odom" in watcher.newest)
        assert until(is_said)


def test_a_flood_is_cut_off(monkeypatch, caplog):
    """However slow a machine is: by a clock that stands still."""
    standing = SimpleNamespace(monotonic=lambda: 0.0)
    monkeypatch.setattr("wheelchair_gym.hardware.ros.rosbridge.time", standing)
    taken, left = [], []
    server = RosbridgeServer("127.0.0.1", 0, lambda *m: taken.append(m) or "", left.append)
    with closing(server):
        server.listens["/cmd_vel"] = ("geometry_msgs/Twist",)
        with Client(server.url) as client, suppress(ConnectionClosed):
            for _ in range(2000):
                client.drive(0.0, 0.6)
            assert until(lambda: left)  # while its end of the line is still open
        assert until(lambda: left)
        assert len(taken) == 1000
        assert "over 1000 messages/s: cut off" in caplog.text


BAD = [
    ({"op": "publish", "topic": "/cmd_vel", "msg": {"linear": {"x": "fast"}}}, "finite numbers"),
    ({"op": "publish", "topic": "/cmd_vel", "msg": None}, "finite numbers"),
    ({"op": "publish", "topic": "/cmd_vel"}, "finite numbers"),
    ({"op": "publish", "topic": "/cmd_vel",
      "msg": {"linear": {"x": "0.2"}, "angular": {"z": 0.0}}}, "finite numbers"),
    ({"op": "publish", "topic": "/cmd_vel",
      "msg": {"linear": {"x": 0.0}, "angular": {"z": True}}}, "finite numbers"),
    ({"op": "publish", "topic": "/cmd_vel",
      "msg": {"header": {}, "twist": {"linear": {"x": 1.0}, "angular": {"z": 0.0}}}}, "header"),
    ({"op": "publish", "topic": "cmd_vel", "msg": {}}, "begins with /"),
    ({"op": "subscribe", "topic": "odom"}, "begins with /"),
    ({"op": "subscribe", "topic": "/nothing"}, "/nothing is not published;"),
    ({"op": "publish", "topic": "/cmd", "msg": {}}, "nothing listens to /cmd; expected /cmd_vel"),
    ({"op": "advertise", "topic": "/cmd_vel", "type": "std_msgs/String"}, "expected geometry_msgs"),
    ({"op": "subscribe", "topic": "/odom", "compression": "cbor"}, "expected none"),
    ({"op": "subscribe", "topic": "/odom", "queue_length": []}, ""),
    ({"op": "subscribe", "topic": "/odom", "throttle_rate": "x"}, "expected numbers"),
    ({"op": "fly"}, "'fly' is not supported"),
    ([1], "expected a JSON object"),
    ("text", "expected a JSON object"),
]  # fmt: skip


def test_what_is_wrong_is_answered_and_moves_nothing(robot):
    with Client(robot.url, "/odom") as client:
        for content, said in BAD:
            client.answers.clear()
            client.link.send(json.dumps(content))
            if said:
                assert until(lambda: client.answers), content
                assert said in client.answers[0]["msg"]
        client.link.send(b"\xff\xfe")
        client.link.send("[" * 100_000)
        client.send(op="publish", topic="/cmd_vel", msg=json.loads(
            '{"linear": {"x": 1e999}, "angular": {"z": NaN}}'))  # fmt: skip
        for age in (10.0, -10.0):
            client.answers.clear()
            client.drive(0.6, stamped=True, age=age)
            assert until(lambda: [one for one in client.answers if "is stamped" in one["msg"]])
        assert until(lambda: client.counts.get("/odom", 0) > 10)
        assert client.still


def test_throttled_and_late_subscribers_get_what_they_ask_for(robot):
    with Client(robot.url) as client:
        begun = time.monotonic()
        client.send(op="subscribe", topic="/odom", throttle_rate=500)
        client.send(op="subscribe", topic="/tf")
        assert until(lambda: client.counts.get("/tf", 0) > 50)
        assert client.counts["/odom"] <= 1.0 + (time.monotonic() - begun) / 0.5
        client.send(op="subscribe", topic="/map")  # was published long ago
        assert until(lambda: "/map" in client.newest)


def test_a_client_that_subscribes_while_a_message_is_written_gets_it(monkeypatch):
    """A large map takes long: the client has got the map before it by then."""
    with closing(RosbridgeServer("127.0.0.1", 0, lambda *_: "")) as server:
        server.advertise("/map", "nav_msgs/OccupancyGrid", latch=True)
        server.publish("/map", {"number": 1})
        with Client(server.url) as client:

            def write(message):
                client.send(op="subscribe", topic="/map")
                assert until(lambda: client.newest.get("/map") == {"number": 1})
                return message

            monkeypatch.setattr(rosbridge, "strict", write)
            server.publish("/map", {"number": 2})
            assert until(lambda: client.newest["/map"] == {"number": 2})


def test_services_begin_episodes(robot):
    with Client(robot.url, "/odom", "/goal_pose") as client:
        assert until(lambda: "/goal_pose" in client.newest)
        first = client.newest["/goal_pose"]["pose"]
        client.send(op="call_service", service="/next_episode", id="a", args={})
        assert until(lambda: client.newest["/goal_pose"]["pose"] != first)
        second, count = client.newest["/goal_pose"]["pose"], client.counts["/goal_pose"]
        client.send(op="call_service", service="/restart_episode", id="b")
        assert until(lambda: client.counts["/goal_pose"] > count)
        assert client.newest["/goal_pose"]["pose"] == second
        client.send(op="call_service", service="/fly", id="c")
        assert until(lambda: len(client.answers) == 3)
        assert [(one["id"], one["result"]) for one in client.answers] == [
            ("a", True), ("b", True), ("c", False)
        ]  # fmt: skip
        assert client.answers[0]["values"]["success"] is True


def test_a_client_may_ask_for_topics_and_time(robot):
    with Client(robot.url) as client:
        client.send(op="call_service", service="/rosapi/topics", id="a")
        client.send(op="call_service", service="/rosapi/get_time", id="b")
        assert until(lambda: len(client.answers) == 2)
        topics, now = (one["values"] for one in client.answers)
        types = dict(zip(topics["topics"], topics["types"], strict=True))
        assert types.keys() >= {*TOPICS, "/cmd_vel"}
        assert types["/scan"] == "sensor_msgs/msg/LaserScan"
        assert abs(now["time"]["sec"] - time.time()) < PATIENCE


def test_it_stands_after_a_contact_until_a_service_is_called(tmp_path):
    served = Served("--scene", "empty", "--shield", "off", "--sim-time", "5")
    try:
        with Client(served.url, "/odom", "/clock") as client:
            assert until(lambda: "/odom" in client.newest)
            said = lambda: any("touched something" in line for line in served.errors)  # noqa: E731
            assert until(lambda: client.drive(0.8) or said())
            count = client.counts["/clock"]
            assert until(lambda: client.counts["/clock"] > count + 10)
            assert client.still
            client.send(op="call_service", service="/restart_episode")
            assert until(lambda: client.drive(-0.3) or client.moving)
    finally:
        assert served.close() == 130


@pytest.mark.parametrize(
    ("scene", "seed", "episodes"),
    long_but([("floor_plan", 6, 1), ("empty", 0, 2), ("empty", 0, 1)], [("empty", 0, 1)]),
)
def test_a_stranger_drives_and_is_scored(scene, seed, episodes, tmp_path):
    result, bag, config = tmp_path / "result.json", tmp_path / "bag", tmp_path / "config.json"
    config.write_text('{"task": {"time_base": 1000.0}}')  # a slow machine has as much time
    with closing(Served(
        "--scene", scene, "--seed", f"{seed}", "--episodes", f"{episodes}", "--config", str(config),
        "--sim-time", "1", "--rate", "20", "--json", str(result), "--record", str(bag),
        "--format", "ros2",
    )) as served:  # fmt: skip
        assert "wheelchair_gym" not in CONTROLLER.read_text().partition('"""\n')[2]
        arguments = [sys.executable, str(CONTROLLER), served.url]
        subprocess.run(arguments, check=True, timeout=PATIENCE, cwd=tmp_path)
        assert served.process.wait(PATIENCE) == 0
    content = json.loads(result.read_text())
    assert [one["seed"] for one in content["episodes"]] == list(range(seed, seed + episodes))
    assert {one["outcome"] for one in content["episodes"]} == {"success"}
    assert min(one["spl"] for one in content["episodes"]) > 0.8
    assert content["summary"][0]["policy"] == "ros"
    assert not any(key.startswith(("act_ms", "plan_ms")) for key in content["episodes"][0])
    assert len(read_recording(bag)) == episodes


def test_a_token_is_needed_where_one_is_set():
    taken = []
    server = RosbridgeServer("127.0.0.1", 0, lambda *m: taken.append(m) or "", token="abc")
    with closing(server):
        server.listens["/cmd_vel"] = ("geometry_msgs/Twist",)
        for headers in ({}, {"Authorization": "Bearer wrong"}):
            with pytest.raises(InvalidStatus, match="401"):
                Client(server.url, additional_headers=headers)
        with Client(server.url, additional_headers={"Authorization": "Bearer abc"}) as client:
            client.drive(0.1)
            assert until(lambda: taken)


@pytest.mark.parametrize("origin", ["https://example.org", "http://localhost:9090", "null"])
def test_web_pages_need_a_token(origin):
    server = RosbridgeServer("127.0.0.1", 0, lambda *_: "")
    with closing(server), pytest.raises(InvalidStatus, match="403"):
        Client(server.url, origin=origin)


def test_a_frozen_client_holds_nobody_up():
    """Neither the messages to others nor the end of the program."""
    hears = (
        "import sys, time; from websockets.sync.client import connect\n"
        "with connect(sys.argv[1]) as link:\n"
        '    link.send(\'{"op": "subscribe", "topic": "/t"}\'); print(\'heard\', flush=True)\n'
        "    time.sleep(100)"
    )
    server, text = RosbridgeServer("127.0.0.1", 0, lambda *_: ""), {"data": "x" * 100_000}
    server.advertise("/t", "std_msgs/String")
    with frozen(hears, server.url), closing(server), Client(server.url, "/t") as client:
        counts = client.counts
        for _ in range(200):
            n = counts["/t"]
            assert until(lambda n=n: server.publish("/t", text) or counts["/t"] > n)


@pytest.fixture(params=["plain", "tls"])
def ends(request, tmp_path):
    """The arguments of a server, and the settings of its clients, which wait on a busy machine."""
    if request.param == "plain":
        return {}, {"connect_timeout": PATIENCE}
    if shutil.which("openssl") is None:
        pytest.skip("openssl makes the certificate")
    pem, token = tmp_path / "chair.pem", tmp_path / "token"
    subprocess.run(
        ["openssl", "req", "-x509", "-newkey", "rsa:2048", "-nodes", "-days", "2", "-subj",
         "/CN=localhost", "-addext", "subjectAltName=DNS:localhost,IP:127.0.0.1",
         "-keyout", tmp_path / "key", "-out", tmp_path / "certificate"],
        check=True, capture_output=True,
    )  # fmt: skip
    pem.write_bytes((tmp_path / "key").read_bytes() + (tmp_path / "certificate").read_bytes())
    token.write_text("abc\n")
    given = {"tls": True, "ca_file": str(tmp_path / "certificate"), "token_file": str(token)}
    return {"token": "abc", "certificate": pem}, given | {"connect_timeout": PATIENCE}


def test_our_two_ends_hear_each_other(ends):
    """Also where tickets for later TLS sessions arrive while the client sends its request."""
    heard = []

    def begun(**more):
        return Rosbridge("127.0.0.1", s.port, print, RosbridgeSettings(**{**ends[1], **more}))

    with closing(RosbridgeServer("127.0.0.1", 0, lambda *m: heard.append(m) or "", **ends[0])) as s:
        s.listens["/t"] = ("std_msgs/String",)
        if ends[0]:
            s._server.socket.context.num_tickets = 10
            for wrong in ({"ca_file": ""}, {"token_file": ""}):
                with pytest.raises(InputError, match="no rosbridge answers there"):
                    begun(**wrong)
        for k in range(40):
            with closing(begun()) as link:
                link.publish("/t", {"data": k})
                assert until(lambda k=k: len(heard) > k)
    assert [message["data"] for _, message, _ in heard] == [*range(40)]


# Python's own `accept` leaves the reset socket to the collector.
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
def test_a_client_that_resets_its_connection_ends_no_server(monkeypatch):
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.sslsocket_class, plain = TurnsSocket, socket.create_server(("127.0.0.1", 0))
    with context.wrap_socket(plain, server_side=True, do_handshake_on_connect=False) as listener:
        with socket.create_connection(listener.getsockname()) as broken:
            broken.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        with socket.create_connection(listener.getsockname()) as client:
            accepted, address = listener.accept()
            assert address == client.getsockname()
    turns = []  # what is sent between the end of TLS and that of the socket would be readable
    for name in ("shutdown", "close"):
        end = lambda self, *how: turns.append(self._turn.locked())  # noqa: E731
        monkeypatch.setattr(ssl.SSLSocket, name, end, raising=False)
    accepted.shutdown(socket.SHUT_RDWR)
    accepted.close()
    assert turns == [True, True]
    monkeypatch.undo()
    accepted.close()


def test_a_server_that_can_accept_nobody_is_lost(monkeypatch):
    with closing(RosbridgeServer("127.0.0.1", 0, lambda *_: "")) as server:
        monkeypatch.setattr(socket.socket, "accept", Mock(side_effect=OSError(24, "many files")))
        with socket.create_connection(("127.0.0.1", server.port)):
            assert until(lambda: server.lost)
    server = RosbridgeServer("127.0.0.1", 0, lambda *_: "")
    server.close()
    assert not server.lost


def test_a_server_that_takes_no_data_holds_nobody_up(ends):
    held = threading.Event()
    server = RosbridgeServer("127.0.0.1", 0, lambda *_: str(held.wait(PATIENCE)), **ends[0])
    with closing(server), ExitStack() as stack:
        stack.callback(held.set)
        server.listens["/t"] = ("std_msgs/String",)
        link = Rosbridge("127.0.0.1", server.port, print, RosbridgeSettings(**ends[1]))
        while not link.lost:
            link.publish("/t", {"data": "x" * 900_000})
        link.close()
        assert not held.is_set()


def test_it_is_a_client_of_another_rosbridge_until_that_is_lost(capsys):
    """Numbers that are not finite go out as rosbridge_server takes them."""
    heard, left, subscribed = [], [], set()

    def hear(topic, message, client):
        heard.append((topic, message))
        subscribed.update(*(one.topics for one in server._clients))
        if [topic for topic, _ in heard].count("/clock") == 10:
            threading.Thread(target=server.close).start()
        return ""

    server = RosbridgeServer("127.0.0.1", 0, hear, left.append)
    kinds = {
        "/scan": "sensor_msgs/LaserScan", "/clock": "rosgraph_msgs/Clock",
        "/tf": "tf2_msgs/TFMessage", "/r_1/odom": "nav_msgs/Odometry",
    }  # fmt: skip
    server.listens |= {topic: (kind,) for topic, kind in kinds.items()}
    link = Rosbridge("127.0.0.1", server.port, lambda *_: None, RosbridgeSettings())
    try:
        link.advertise("/scan", "sensor_msgs/msg/LaserScan")
        ranges = np.array([1.23456, np.inf, -np.inf, np.nan], np.float32)
        link.publish("/scan", {"ranges": ranges})
        assert until(lambda: heard)
        np.testing.assert_equal(heard[0][1]["ranges"], [1.2346, math.inf, -math.inf, math.nan])
        laser = LaserSettings(beams=4)
        told = strict(make_messages.scan(0, laser, ranges))
        assert told["ranges"] == [1.2346, None, -1.0, None]
        read = ros.scan(told, laser, math.inf)  # NaN is lost, a range too near is not
        np.testing.assert_equal(read, np.array([1.2346, math.inf, -math.inf, math.inf], np.float32))
        out = main(["robot", "--scene", "empty", "--rosbridge", f"ros://127.0.0.1:{server.port}",
                    "--sim-time", "--rate", "20", "--namespace", "r_1"])  # fmt: skip
        assert out == 1
        assert "the link is lost" in capsys.readouterr().err.splitlines()[-1]
        clocks = [
            m["clock"]["sec"] + 1e-9 * m["clock"]["nanosec"] for t, m in heard if t == "/clock"
        ]
        assert len(clocks) >= 10
        assert clocks == sorted(set(clocks))
        assert until(lambda: left)
        assert subscribed == {"/r_1/cmd_vel"}
        newest = dict(heard)
        messages = [*newest["/tf"]["transforms"], newest["/r_1/odom"]]
        frames = [(one["header"]["frame_id"], one["child_frame_id"]) for one in messages]
        assert frames == [("map", "r_1/odom"), *[("r_1/odom", "r_1/base_link")] * 2]
    finally:
        link.close()
        server.close()


def test_being_open_to_a_network_is_said(caplog):
    RosbridgeServer("0.0.0.0", 0, lambda *_: "").close()
    assert "0.0.0.0: no token and no TLS: whoever reaches it can read and command" in caplog.text


def test_tls_and_token_of_the_link(tmp_path, caplog):
    (tmp_path / "token").write_text("secret\n")
    (tmp_path / "bad").write_text("two words\n")
    given = {"connect_timeout": 0.1, "token_file": str(tmp_path / "token")}
    bad = str(tmp_path / "bad")
    for settings, says in (
        (given, "a token needs tls"),
        ({"token_file": bad}, "one line of printable ASCII"),
        ({"tls": True, "ca_file": bad}, "expected certificates"),
        ({"connect_timeout": 0.1}, "no rosbridge answers"),
    ):
        with pytest.raises(InputError, match=says):
            Rosbridge("192.0.2.1", 1, lambda *_: None, RosbridgeSettings(**settings))
    assert "no TLS and no token: whoever is on the network can read and command" in caplog.text


def test_settings_of_the_robot_have_bounds(capsys):
    for name in ("1robot", "robot 1", "/robot", "robot/", "a__b", "robot-1", "ä"):
        said = refusal(["robot", "--namespace", name], capsys)
        assert f"namespace '{name}': expected a name such as robot1" in said
    assert "--scan-rate: 0: expected 0.1 to 200" in refusal(["robot", "--scan-rate", "0"], capsys)
    assert Robot(RobotSettings(), print).command("/cmd_vel", {"linear": {}}, None)


@pytest.mark.parametrize("twist", [(0.5, 0.0), (0.4, 0.6), (0.0, 0.8)])
def test_covariances_are_those_of_the_errors_that_are_drawn(twist):
    """Squared errors in units of their covariance are 3 of a pose, 2 of a twist, on average."""
    sensors, found = SensorSettings(pose_source="odometry"), []
    episode = make_scene("empty").sample(np.random.default_rng(0))
    for key in range(100):
        chair, spread = SimulatedChair(sensors=sensors, period=0.1), None
        model = OdometryCovariance(DriveGeometry(), sensors, 0.1)
        chair.reset(episode, key)
        for _ in range(30):
            reading = chair.drive(np.array(twist))
            spread = model.update(float(reading.pose[2]), reading.twist)
        ends = (reading.pose, chair.truth.pose), (reading.twist, chair.truth.twist)
        errors = [one - other for one, other in ends]
        found.append([e @ np.linalg.solve(c, e) for e, c in zip(errors, spread, strict=True)])
    np.testing.assert_allclose(np.mean(found, axis=0), (3.0, 2.0), rtol=0.6)
    message = make_messages.odometry(0, reading.pose, reading.twist, spread)
    pose, speed = (np.reshape(message[key]["covariance"], (6, 6)) for key in ("pose", "twist"))
    np.testing.assert_array_equal(pose[np.ix_((0, 1, 5), (0, 1, 5))], spread[0])
    np.testing.assert_array_equal(speed[np.ix_((0, 5), (0, 5))], spread[1])
    assert np.diag(pose)[2:5].min() == np.diag(speed)[1:5].min() == 1e6
    assert make_messages.imu(0, 0.1, 0.2)["angular_velocity_covariance"][8] == 0.2
    assert (np.diag(model.update(0.0, (0.0, 0.0))[1]) > 0.0).all()  # standing, too
