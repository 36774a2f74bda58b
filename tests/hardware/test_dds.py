"""Laws of the robot over DDS: ROS 2 finds its topics, drives it, and cannot hold it up.

The other side is cyclonedds with types of twists that are written here by hand, and,
where it is installed, ROS 2 itself (rclpy on Fast DDS).
"""

import json
import math
import os
import socket
import subprocess
from contextlib import closing, suppress
from dataclasses import dataclass
from unittest.mock import Mock

import numpy as np
import pytest
from cyclonedds.core import Policy, Qos
from cyclonedds.domain import Domain, DomainParticipant
from cyclonedds.idl import IdlStruct
from cyclonedds.idl.types import float64, int32, uint32
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic

from tests.conftest import ROOT, refusal, until
from tests.hardware.served import Served, frozen
from wheelchair_gym.hardware.ros import make_messages as ros
from wheelchair_gym.hardware.ros.dds import DdsLink, content_of, idl_type
from wheelchair_gym.hardware.ros.make_messages import deserialized, serialized, typestore
from wheelchair_gym.sensors.settings import LaserSettings


def free_domain():
    """Four domains in a row, by the first, that no other run on this machine uses; their lock."""
    for domain in range(20, 98, 4):  # of 101 at most
        with suppress(OSError):
            return domain, socket.create_server(("127.0.0.1", 12_000 + domain)).detach()


DOMAIN, LOCK = free_domain()
HERE = {"ROS_DOMAIN_ID": str(DOMAIN), "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
LOOPBACK = """<CycloneDDS><Domain id="any"><General><AllowMulticast>false</AllowMulticast>
<Interfaces><NetworkInterface address="127.0.0.1"/></Interfaces></General><Discovery>
<ParticipantIndex>auto</ParticipantIndex><Peers><Peer address="127.0.0.1"/></Peers></Discovery>
</Domain></CycloneDDS>"""
RELIABLE = Policy.Reliability.Reliable(max_blocking_time=0)
LATCHED = Policy.Durability.TransientLocal
STILL = 0.05  # rad/s, by wheels that count whole ticks


@dataclass
class Time(IdlStruct, typename="builtin_interfaces::msg::dds_::Time_"):
    sec: int32
    nanosec: uint32


@dataclass
class Header(IdlStruct, typename="std_msgs::msg::dds_::Header_"):
    stamp: Time
    frame_id: str


@dataclass
class Vector3(IdlStruct, typename="geometry_msgs::msg::dds_::Vector3_"):
    x: float64
    y: float64
    z: float64


@dataclass
class Twist(IdlStruct, typename="geometry_msgs::msg::dds_::Twist_"):
    linear: Vector3
    angular: Vector3


@dataclass
class TwistStamped(IdlStruct, typename="geometry_msgs::msg::dds_::TwistStamped_"):
    header: Header
    twist: Twist


LaserScan = idl_type("sensor_msgs/msg/LaserScan")
Odometry = idl_type("nav_msgs/msg/Odometry")


def turn_of(sample):
    """The turn rate of a sample of Odometry [rad/s]."""
    return deserialized("nav_msgs/msg/Odometry", sample.cdr)["twist"]["twist"]["angular"]["z"]


def policies(*more, depth=10):
    wire = Policy.DataRepresentation(use_cdrv0_representation=True, use_xcdrv2_representation=False)
    return Qos(wire, Policy.History.KeepLast(depth), *more)


class Peer:
    """Another program in the domain."""

    def __init__(self, domain=None):
        self.participant = DomainParticipant(DOMAIN if domain is None else domain)
        self.entities, self.turns = {}, 10 * [math.nan]

    def hears(self, topic, kind, *more):
        qos, name = policies(*more), f"rt{topic}" if topic.startswith("/") else topic
        self.entities[topic, kind] = DataReader(
            self.participant, Topic(self.participant, name, kind, qos), qos
        )
        return self.entities[topic, kind]

    def says(self, topic, kind, *more):
        qos = policies(*more or [RELIABLE])
        return DataWriter(self.participant, Topic(self.participant, f"rt{topic}", kind, qos), qos)

    def taken(self, topic, kind):
        samples = self.entities[topic, kind].take(1000)
        return [one for one in samples if one.sample_info.valid_data]

    @property
    def turn(self):
        """The turn rate that was heard last [rad/s]."""
        self.turns = [*self.turns, *map(turn_of, self.taken("/odom", Odometry))][-10:]
        return self.turns[-1]

    @property
    def rests(self):
        """Whether it stands: at the end of a turn, single readings are still, too."""
        return abs(self.turn) < STILL and max(map(abs, self.turns)) < STILL


@pytest.fixture(scope="module")
def domain():
    return Domain(DOMAIN, LOOPBACK)


@pytest.fixture(scope="module")
def robot(domain):
    words = "--dds", "--scene", "empty", "--imu", "--pose", "odometry", "--sim-time"
    with closing(Served(*words, **HERE)) as served:
        yield served


@pytest.fixture
def peer(robot):
    found = Peer()
    found.hears("/odom", Odometry, RELIABLE)
    return found


def twist(w, stamped=False):
    found = Twist(Vector3(0.0, 0.0, 0.0), Vector3(0.0, 0.0, w))
    return TwistStamped(Header(Time(0, 0), ""), found) if stamped else found


def turning(peer, writer, stamped=False):
    assert until(lambda: writer.write(twist(0.6, stamped)) or peer.turn > 0.1)


@pytest.mark.parametrize("kind", sorted({one.type for one in ros.TOPICS.values()}))
def test_types_are_those_that_the_messages_are_written_by(kind):
    """Cyclonedds writes the same bytes, by its type, as rosbags, and reads what it writes."""
    store = typestore()

    def filled(name):
        return store.deserialize_cdr(serialized(name, EXAMPLES.get(name, {})), name)

    def copied(message):
        if isinstance(message, list):
            return [copied(one) for one in message]
        if isinstance(message, np.ndarray):
            return message.tolist()
        if not hasattr(message, "__msgtype__"):
            return message
        names = [key for key, _ in store.fielddefs[message.__msgtype__][1]]
        return idl_type(message.__msgtype__)(**{k: copied(getattr(message, k)) for k in names})

    message = copied(filled(kind))
    cdr = bytes(serialized(kind, EXAMPLES.get(kind, {})))
    assert message.__idl__.serialize(message, use_version_2=False) == cdr
    assert deserialized(kind, cdr)


EXAMPLES = {
    "sensor_msgs/msg/LaserScan": ros.scan(
        7, LaserSettings(beams=3), np.array([1.5, np.inf, -np.inf], np.float32)
    ),
    "tf2_msgs/msg/TFMessage": ros.mounts(12, [LaserSettings()]),
    "nav_msgs/msg/Odometry": ros.odometry(5, np.array([1.0, 2.0, 0.5]), np.array([0.3, 0.1])),
    "geometry_msgs/msg/PolygonStamped": ros.footprint(9, np.ones((4, 2))),
    "sensor_msgs/msg/BatteryState": ros.battery(3, 24.5),
}


def test_scans_and_latched_maps_arrive_and_the_node_has_a_name(peer):
    kinds = {"/map": "nav_msgs/msg/OccupancyGrid", "/tf_static": "tf2_msgs/msg/TFMessage",
             "ros_discovery_info": "rmw_dds_common/msg/ParticipantEntitiesInfo"}  # fmt: skip
    scans = peer.hears("/scan", LaserScan, Policy.Reliability.BestEffort)
    clocks = peer.hears("/clock", idl_type("rosgraph_msgs/msg/Clock"))
    for topic, kind in kinds.items():  # were published long ago
        peer.hears(topic, idl_type(kind), RELIABLE, LATCHED)
    found = {}

    def complete():
        for topic, kind in kinds.items():
            for one in peer.taken(topic, idl_type(kind)):
                found[topic] = deserialized(kind, one.cdr)
        return len(found) == 3

    assert until(complete)
    info = found["/map"]["info"]
    assert len(found["/map"]["data"]) == info["width"] * info["height"] > 100
    assert len(found["/tf_static"]["transforms"]) == 9
    (node,) = found["ros_discovery_info"]["node_entities_info_seq"]
    assert (node["node_namespace"], node["node_name"]) == ("/", "wheelchair")
    assert until(lambda: scans.read(1) and clocks.read(1))
    scan = deserialized("sensor_msgs/msg/LaserScan", peer.taken("/scan", LaserScan)[-1].cdr)
    assert scan["header"]["frame_id"] == "laser"
    assert len(scan["ranges"]) == LaserSettings().beams
    assert np.isfinite(scan["ranges"]).mean() > 0.5
    last = [deserialized("rosgraph_msgs/msg/Clock", one.cdr) for one in clocks.take(100)]
    seconds = [one["clock"]["sec"] + 1e-9 * one["clock"]["nanosec"] for one in last]
    assert seconds == sorted(set(seconds))


@pytest.mark.parametrize("stamped", [False, True])
def test_it_drives_by_both_kinds_of_twist_and_stops_when_they_end(robot, peer, stamped):
    writer = peer.says("/cmd_vel", TwistStamped if stamped else Twist)
    turning(peer, writer, stamped)
    before = len(robot.errors)
    assert until(lambda: peer.rests)
    assert until(lambda: "is silent for 0.5 s: the chair stops" in "".join(robot.errors[before:]))


def test_it_stops_at_once_when_the_commanding_peer_leaves(robot, peer):
    def is_said():
        """Whether it is; a machine that is slow lets it be silent first."""
        before = len(robot.errors)
        writer = peer.says("/cmd_vel", Twist)
        turning(peer, writer)
        del writer
        assert until(lambda: peer.rests and len(robot.errors) > before)
        said = "".join(robot.errors[before:])
        return "the client that commanded is gone: the chair stops" in said

    assert until(is_said)


def test_damaged_and_infinite_twists_move_nothing_and_are_said_once(robot, peer):
    writer = peer.says("/cmd_vel", Twist)
    assert until(lambda: writer.get_matched_subscriptions() and peer.rests)
    writer.write(twist(math.nan))
    writer.write(twist(math.inf))
    bad = twist(0.0)
    bad.serialize = lambda **_: b"\0\1\0\0" + 48 * b"\xff"  # NaN, too
    writer.write(bad)
    assert until(lambda: "of finite numbers" in "".join(robot.errors))
    heard = 0
    while heard < 20:  # in which it would have begun to turn
        assert until(lambda: peer.entities["/odom", Odometry].read(1))
        heard += len(turns := [turn_of(one) for one in peer.taken("/odom", Odometry)])
        assert np.abs(turns).max() < STILL
    assert "".join(robot.errors).count("a TwistStamped with a header, of finite numbers") == 1
    turning(peer, writer)


@pytest.mark.parametrize("size", range(0, 52, 4))
def test_bytes_that_are_cut_off_are_no_message(size):
    whole = twist(1.0).serialize(use_version_2=False)
    kind = "geometry_msgs/msg/Twist"
    sample = idl_type(kind).deserialize(whole)
    assert content_of(kind, sample)["angular"]["z"] == 1.0
    assert content_of(kind, idl_type(kind).deserialize(whole[:size])) is None


def test_a_request_for_another_quality_is_one_line(robot, peer):
    peer.hears("/scan", LaserScan, RELIABLE, LATCHED)
    said = "/scan: a subscriber asks for another QoS (durability)"
    assert until(lambda: said in "".join(robot.errors))
    writer = peer.says("/cmd_vel", Twist, Policy.Reliability.BestEffort)
    said = "/cmd_vel: a publisher offers another QoS (reliability)"
    assert until(lambda: any(said in e and "expected reliable" in e for e in robot.errors))
    assert not writer.get_matched_subscriptions()


FROZEN = """
import sys, time
sys.path[:0] = [sys.argv[1]]
from tests.hardware.test_dds import *
DOMAIN = int(sys.argv[2])
domain = Domain(DOMAIN, LOOPBACK)
peer = Peer(DOMAIN)
for topic, kind in (("/scan", LaserScan), ("/odom", Odometry)):
    peer.hears(topic, kind, RELIABLE)
while not all(peer.taken(*key) for key in peer.entities):
    time.sleep(0.1)
print("heard", flush=True)
time.sleep(100)
"""


def test_a_frozen_subscriber_holds_nobody_up(robot, peer):
    with frozen(FROZEN, str(ROOT), str(DOMAIN)):
        writer = peer.says("/cmd_vel", Twist)
        turning(peer, writer)
        found = []

        def heard():
            found.extend(peer.taken("/odom", Odometry))
            writer.write(twist(0.6))
            return len(found) >= 60

        assert until(heard)


def test_topics_begin_episodes(robot, peer):
    empty, goal = idl_type("std_msgs/msg/Empty"), idl_type("geometry_msgs/msg/PoseStamped")
    reader = peer.hears("/goal_pose", goal, RELIABLE, LATCHED)
    assert until(lambda: reader.read(1))
    first = peer.taken("/goal_pose", goal)[-1].cdr
    writer = peer.says("/next_episode", empty)
    assert until(lambda: writer.get_matched_subscriptions())
    sample = empty(0)
    sample.cdr = b"\0\1\0\0\0"
    writer.write(sample)
    found = []
    assert until(lambda: found.extend(peer.taken("/goal_pose", goal)) or found)
    assert found[-1].cdr != first


@pytest.mark.parametrize("domain_id", ["233", "one"])
def test_a_domain_that_is_none_is_one_line(domain_id, capsys, monkeypatch):
    monkeypatch.setenv("ROS_DOMAIN_ID", domain_id)
    line = refusal(["robot", "--dds", "--scene", "empty"], capsys)
    assert f"ROS_DOMAIN_ID is '{domain_id}'; expected 0 to 232" in line


def test_a_link_can_be_closed_twice_and_made_again(domain):
    for _ in range(2):
        link = DdsLink("127.0.0.1", DOMAIN + 1, lambda *_: "")
        link.advertise("/scan", "sensor_msgs/msg/LaserScan")
        link.publish("/scan", {"ranges": [1.0, math.nan]})
        link.close()
        link.close()


def test_a_thread_that_fails_ends_the_link_and_says_why():
    """Robot stops, and its program ends, where a link is lost."""
    fail = Mock(side_effect=ValueError("no such\nthing"))
    with closing(DdsLink("127.0.0.1", DOMAIN + 2, fail)) as link:
        link.subscribe("/cmd_vel", "geometry_msgs/msg/Twist")
        peer = Peer(DOMAIN + 2)
        writer = peer.says("/cmd_vel", Twist)
        assert not link.lost
        assert until(lambda: writer.write(twist(0.1)) or link.lost)
        assert link.lost == "no such thing"


def test_each_publisher_that_leaves_is_reported():
    heard, gone = [], []
    hear = lambda topic, message, who: heard.append(who)  # noqa: E731
    with closing(DdsLink("127.0.0.1", DOMAIN + 3, hear, gone.append)) as link:
        link.subscribe("/cmd_vel", "geometry_msgs/msg/Twist")
        peer = Peer(DOMAIN + 3)
        writers = [peer.says("/cmd_vel", Twist) for _ in range(2)]
        assert until(lambda: [one.write(twist(0.1)) for one in writers] and len({*heard}) == 2)
        with link._lock:  # between two looks
            writers.clear()
            assert until(lambda: not link._readers[0].reader.get_matched_publications())
        assert until(lambda: {*gone} == {*heard})


RCLPY = os.environ.get("WHEELCHAIR_RCLPY") or str(ROOT / "build" / "rclpy" / "bin" / "python")
NODE = ROOT / "tests" / "hardware" / "rclpy_node.py"
SECONDS = float(os.environ.get("WHEELCHAIR_RCLPY_SECONDS", "20"))


def missing(stamps):
    """Count missing scans at 40 Hz; with control periods of 20 ms they are 20 or 40 ms apart."""
    spaces = np.diff(stamps)
    return int(np.sum(np.round(spaces[spaces > 45e6] / 25e6) - 1.0))


@pytest.mark.long
@pytest.mark.skipif(
    not os.path.exists(RCLPY), reason="ROS 2 is not installed: make rclpy, or WHEELCHAIR_RCLPY"
)
def test_ros_itself_hears_everything_and_drives():
    number = DOMAIN + 3  # the other tests' robot is in DOMAIN
    here = HERE | {"ROS_DOMAIN_ID": f"{number}"}
    _domain = Domain(number, LOOPBACK)  # kept as long as its participants
    words = "--dds", "--scene", "empty", "--pose", "odometry", "--sim-time", "--scan-rate", "40"
    with closing(Served(*words, **here)) as served:
        watcher = Peer(number)
        watcher.hears("/odom", Odometry)
        environ = {key: value for key, value in os.environ.items() if key != "PYTHONPATH"} | here
        out = subprocess.run(
            [RCLPY, str(NODE), str(SECONDS)], env=environ, capture_output=True, text=True,
            check=True, timeout=SECONDS + 60.0,
        )  # fmt: skip
        moving, text = out.stdout.splitlines()
        assert moving == "moving"
        found = json.loads(text)
        spaces = np.diff(found["stamps"])
        lost = missing(found["stamps"])
        print({
            **found["counts"], "lost": lost, "lost with depth 5": missing(found["short"]),
            "delay_ms": found["delay_ms"],
        }, os.getloadavg())  # fmt: skip
        assert len(spaces) > 0.8 * 40.0 * (SECONDS - 4.0)
        assert lost == 0
        assert found["counts"]["/map"] == 1
        assert found["cells"] > 100
        assert found["beams"] == LaserSettings().beams
        assert found["counts"]["/odom"] > len(spaces)
        assert found["counts"]["/battery_state"] > 1
        assert found["clock"] > 1e9 * (SECONDS - 4.0)
        assert found["ticks"] > 15 * (SECONDS - 4.0)  # 20 Hz of the simulated time
        assert "wheelchair" in found["nodes"]
        assert found["topics"]["/tf"] == ["tf2_msgs/msg/TFMessage"]

        before = len(served.errors)
        driver = subprocess.Popen(
            [RCLPY, str(NODE), "60"], env=environ, stdout=subprocess.PIPE, text=True
        )
        assert driver.stdout.readline() == "moving\n"
        assert until(lambda: watcher.turn > 0.1)
        driver.kill()
        driver.wait()
        assert until(lambda: watcher.rests)
        assert until(lambda: "the chair stops" in "".join(served.errors[before:]))
