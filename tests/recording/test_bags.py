"""Laws of ROS 2 bags: others read ours, ours give the same map and verdicts, and we read others'.

The independent reader is mcap-ros2-support, which decodes by the definitions inside the file.
"""

import math
import shutil
from unittest.mock import Mock

import gymnasium as gym
import numpy as np
import pytest
import yaml
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.rosbag2 import Reader, StoragePlugin, Writer

from agents.cli import main
from agents.policies import GymPolicy, make_policy
from tests.conftest import at_start, output_of, refusal
from wheelchair_gym import InputError
from wheelchair_gym.actors.records import actor_shapes
from wheelchair_gym.geometry.planar import to_world
from wheelchair_gym.hardware.ros import make_messages as ros
from wheelchair_gym.hardware.ros.make_messages import serialized, typestore
from wheelchair_gym.perception.occupancy import read_scan
from wheelchair_gym.recording import write_bags
from wheelchair_gym.recording.read_bags import bag_log, bag_messages
from wheelchair_gym.recording.record import RecordEpisodes, RecordingSettings
from wheelchair_gym.recording.replay import read_recording, replay_env, sensor_log
from wheelchair_gym.sensors.settings import LaserSettings

STEPS = 40
CONFIG = {"sensors": {"laser": {"beams": 271}}, "task": {"beams": 64}}
TYPES = {
    "/clock": "rosgraph_msgs/msg/Clock",
    "/tf": "tf2_msgs/msg/TFMessage",
    "/tf_static": "tf2_msgs/msg/TFMessage",
    "/map": "nav_msgs/msg/OccupancyGrid",
    "/scan": "sensor_msgs/msg/LaserScan",
    "/odom": "nav_msgs/msg/Odometry",
    "/battery_state": "sensor_msgs/msg/BatteryState",
    "/cmd_vel": "geometry_msgs/msg/TwistStamped",
    "/goal_pose": "geometry_msgs/msg/PoseStamped",
    "/pose": "geometry_msgs/msg/PoseStamped",
    "/ground_truth": "geometry_msgs/msg/PoseStamped",
    "/particle_cloud": "geometry_msgs/msg/PoseArray",
    "/plan": "nav_msgs/msg/Path",
    "/rollout": "nav_msgs/msg/Path",
    "/trail": "nav_msgs/msg/Path",
    "/footprint": "geometry_msgs/msg/PolygonStamped",
    "/rosout": "rcl_interfaces/msg/Log",
    "/image/compressed": "sensor_msgs/msg/CompressedImage",
    **{f"/ultrasonic_{k}": "sensor_msgs/msg/Range" for k in range(8)},
    **{
        f"/wheelchair/{name}": "std_msgs/msg/String"
        for name in ("episode", "reading", "command", "shield", "verdict", "battery", "wheels")
    },
}


@pytest.fixture(scope="module")
def drive(tmp_path_factory):
    """The same drive as our own recording and as a bag, with its readings and odometry."""
    folder = tmp_path_factory.mktemp("drive")
    seen = []
    for name, format in (("own.mcap", "foxglove"), ("bag.mcap", "ros2")):
        settings = RecordingSettings(format=format, image_rate=1.0)
        env = gym.make(
            "wheelchair_gym/Navigation-v1", scene="clutter", config=CONFIG, pose_source="mcl",
            shield=True, render_mode="rgb_array", split="test"
        )  # fmt: skip
        env = RecordEpisodes(env, folder / name, recording=settings)
        policy = GymPolicy(make_policy("visibility+controls"), env)
        observation, _ = env.reset(seed=5)
        policy.reset()
        seen = [(env.unwrapped.task.reading, env.unwrapped.chair.belief.odometry)]
        for _ in range(STEPS):
            observation, *_ = env.step(policy.act(observation))
            rollout = env.unwrapped.shown.rollout
            seen.append((env.unwrapped.task.reading, env.unwrapped.chair.belief.odometry))
        env.close()
    return folder / "own.mcap", folder / "bag", seen, rollout


def decoded(bag, *topics):
    """Schema's name, topic, message of each message, by the independent reader."""
    with (bag / f"{bag.name}.mcap").open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()], validate_crcs=True)
        assert reader.get_header().profile == "ros2"
        for schema, channel, message, content in reader.iter_decoded_messages(topics or None):
            assert channel.message_encoding == "cdr"
            assert schema.encoding == "ros2msg"
            yield schema.name, channel.topic, message.log_time, content


def stamped(content):
    for name in ("header", "clock"):
        content = getattr(content, name, content)
    stamp = getattr(content, "stamp", content)
    return stamp.sec * 10**9 + stamp.nanosec


def test_an_independent_reader_reads_every_type_and_stamp(drive):
    _, bag, seen, rollout = drive
    kinds = {}
    for kind, topic, log_time, content in decoded(bag):
        kinds[topic] = kind
        if kind == "tf2_msgs/msg/TFMessage":
            assert {stamped(edge) for edge in content.transforms} == {log_time}
        elif kind == "sensor_msgs/msg/Range":
            assert log_time - 10**9 < stamped(content) <= log_time
        elif kind != "std_msgs/msg/String":
            assert stamped(content) == log_time
    assert kinds == TYPES
    scans = [content for *_, content in decoded(bag, "/scan")]
    moves = [content for *_, content in decoded(bag, "/odom")]
    volts = [content.voltage for *_, content in decoded(bag, "/battery_state")]
    *_, led = (content for *_, content in decoded(bag, "/rollout"))
    places = [(one.pose.position.x, one.pose.position.y) for one in led.poses]
    np.testing.assert_array_equal(places, rollout[:, :2])
    assert len(scans) == len(moves) == len(volts) == len(seen) == STEPS + 1
    for scan, move, voltage, (reading, odometry) in zip(scans, moves, volts, seen, strict=True):
        np.testing.assert_array_equal(np.array(scan.ranges, np.float32), reading.laser)
        assert scan.angle_max - scan.angle_min == pytest.approx(LaserSettings().fov, abs=1e-6)
        assert scan.angle_min + 270 * scan.angle_increment == pytest.approx(scan.angle_max)
        assert stamped(scan) == stamped(move) == 10**9 + round(reading.stamp * 1e9)
        at, turned = move.pose.pose.position, move.pose.pose.orientation
        yaw = 2.0 * math.atan2(turned.z, turned.w)
        np.testing.assert_allclose((at.x, at.y, yaw), odometry, atol=1e-12)
        assert (move.twist.twist.linear.x, move.twist.twist.angular.z) == tuple(reading.twist)
        assert voltage == np.float32(reading.battery)


def test_its_metadata_is_what_every_distribution_from_humble_on_reads(drive):
    _, bag, *_ = drive
    about = yaml.safe_load((bag / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
    assert about["version"] == 8
    assert about["storage_identifier"] == "mcap"
    assert about["relative_file_paths"] == [f"{bag.name}.mcap"]
    late = set()
    for one in about["topics_with_message_count"]:
        topic = one["topic_metadata"]
        assert TYPES[topic["name"]] == topic["type"]
        assert topic["type_description_hash"].startswith("RIHS01_")
        (offered,) = yaml.safe_load(topic["offered_qos_profiles"])
        assert offered["reliability"] == 1
        if offered["durability"] == 1:
            late.add(topic["name"])
    assert late == {"/map", "/tf_static", "/goal_pose", "/footprint"}
    with Reader(bag) as reader:
        assert reader.message_count == about["message_count"] == len(list(reader.messages()))


def as_sqlite(bag, folder):
    """The bag, stored as rosbag2 did until Iron."""
    with Reader(bag) as reader, Writer(
        folder, version=8, storage_plugin=StoragePlugin.SQLITE3
    ) as writer:  # fmt: skip
        topics = {
            one.id: writer.add_connection(one.topic, one.msgtype, typestore=typestore())
            for one in reader.connections
        }
        for connection, stamp, data in reader.messages():
            writer.write(topics[connection.id], stamp, data)
    return folder


def test_the_map_of_a_drive_is_that_of_its_bag(drive, tmp_path, capsys):
    own, bag, *_ = drive
    old = as_sqlite(bag, tmp_path / "old")
    sources = [own, bag, bag / "bag.mcap", old, old / "old.db3"]
    found = [sensor_log(path) for path in sources]
    for log, laser in found[1:]:
        assert laser == found[0][1]
        for one, other in zip(log[:3], found[0][0][:3], strict=True):
            np.testing.assert_array_equal(one, other)
    files = []
    for k, path in enumerate((own, bag, old)):
        drawn = ["map", "--recording", str(path), "--quiet", "--particles", "3"]
        assert main([*drawn, "--out", str(tmp_path / str(k))]) == 0
        files.append([(tmp_path / str(k) / name).read_bytes() for name in
                      ("map.pgm", "map.yaml", "odometry.pgm")])  # fmt: skip
    assert files[0] == files[1] == files[2]
    assert "41 scans in 4.0 s, 0 lines skipped" in capsys.readouterr().out


def test_a_bag_is_judged_again_the_same(drive, tmp_path, capsys):
    own, bag, *_ = drive
    for path in (bag, as_sqlite(bag, tmp_path / "old")):
        assert "the same rewards" in output_of(["replay", path], capsys)
    (one,), (other,) = read_recording(own), read_recording(bag)
    for was, is_ in zip(one.states, other.states, strict=True):
        np.testing.assert_equal(is_.reading, was.reading)
        np.testing.assert_equal(is_.truth, was.truth)
    at_start(replay_env(other), None, options={"episode": other.episode})


def other_robots_bag(folder, turn=1, frames=True, scans=20, stamps=lambda k: 100 * k + 30):
    """A robot with other names: a lidar at the back that turns clockwise, and slower odometry."""
    store = typestore()
    laser = LaserSettings(x=-0.2, y=0.1, yaw=math.radians(170.0), beams=73)
    walls = np.linspace(1.0, 2.0, laser.beams).astype(np.float32)
    with Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP) as bag:
        topics = {
            topic: bag.add_connection(topic, kind, typestore=store)
            for topic, kind in (
                ("/rear/scan", "sensor_msgs/msg/LaserScan"),
                ("/wheels/odom", "nav_msgs/msg/Odometry"),
                ("/tf_static", "tf2_msgs/msg/TFMessage"),
                ("/chatter", "std_msgs/msg/String"),
            )
        }

        def put(topic, stamp, message):
            data = serialized(topics[topic].msgtype, message)
            bag.write(topics[topic], stamp, data)

        zero = 1_700_000_000_000_000_000
        # base_footprint is the root; the laser is described as turned, and its fan is off-centre.
        edges = [
            ros.transform(zero, "base_footprint", "base_link", (0.0, 0.0, 0.0)),
            ros.transform(zero, "base_link", "rear_lidar", (laser.x, laser.y, math.pi / 2)),
        ]
        if frames:
            put("/tf_static", zero, {"transforms": edges})
        put("/chatter", zero, {"data": "hello"})
        for k in range(30):
            stamp = zero + 150_000_000 * k
            pose = np.array([0.15 * k * 0.5, 0.0, 0.0])
            move = ros.odometry(stamp, pose, np.array([0.5, 0.0]))
            put("/wheels/odom", stamp, move | {"child_frame_id": "base_footprint"})
        for k in range(scans):
            stamp = zero + round(1e6 * stamps(k))
            half, middle = 0.5 * laser.fov, math.radians(80.0)
            message = ros.scan(stamp, laser, walls[::turn])
            message["header"]["frame_id"] = "rear_lidar"
            message["angle_min"] = middle - turn * half
            message["angle_max"] = middle + turn * half
            message["angle_increment"] *= turn
            put("/rear/scan", stamp, message)
    return folder, laser, walls


@pytest.mark.parametrize("turn", [1, -1])
def test_the_bag_of_another_robot_is_read_by_types(turn, tmp_path):
    bag, laser, walls = other_robots_bag(tmp_path / "other", turn)
    log, found = bag_log(bag)
    assert len(log.stamps) == 20
    np.testing.assert_allclose(np.diff(log.stamps), 0.1, atol=1e-9)
    np.testing.assert_allclose(log.increments[1:], [[0.05, 0.0, 0.0]] * 19, atol=1e-8)
    ends = [to_world(read_scan(one, walls).echoes, np.zeros(3)) for one in (found, laser)]
    np.testing.assert_allclose(*ends, atol=2e-5)
    np.testing.assert_array_equal(log.ranges[0], walls)


def test_what_cannot_be_used_is_counted_or_named(tmp_path, caplog):
    bag, *_ = other_robots_bag(tmp_path / "back", stamps=lambda k: 100 * (k % 10) + 30)
    log, _ = bag_log(bag)
    assert log.skipped == {"scan: time goes back": 10}
    bag, *_ = other_robots_bag(tmp_path / "late", stamps=lambda k: 4000 + 100 * k)
    assert bag_log(bag)[0].skipped == {"scan: without odometry": 16}
    bag, *_ = other_robots_bag(tmp_path / "frames", frames=False)
    assert bag_log(bag)[1].x == 0.0
    assert "rear_lidar has no transform to base_footprint" in caplog.text


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ("map --recording {bag} --scan-topic /front", "/rear/scan (--scan-topic)"),
        ("map --recording {bag} --odometry-topic /o", "/wheels/odom (--odometry-topic)"),
        ("map --recording {own} --scan-topic /front", "is no ROS 2 bag"),
        ("replay {bag}", "only drives that this program has recorded"),
        ("map --recording {none}", "neither .mcap nor .db3"),
        ("map --recording {packed}", "part.db3.zstd is compressed, 1 can be read"),
        ("map --recording {half}", "metadata.yaml names 2 files, 1 can be read"),
        ("replay {text}", "expected a ROS 2 bag in SQLite"),
    ],
)
def test_what_is_wrong_is_one_line(drive, arguments, said, tmp_path, capsys):
    (tmp_path / "none").mkdir()
    (tmp_path / "text.db3").write_text("no data base" * 100)
    bag, *_ = other_robots_bag(tmp_path / "other")
    places = {"bag": bag, "own": drive[0], "none": tmp_path / "none"}
    places["text"] = tmp_path / "text.db3"
    for name, file in (("packed", "part.db3.zstd"), ("half", "metadata.yaml")):
        places[name] = shutil.copytree(bag, tmp_path / name)
        with (places[name] / file).open("a") as text:
            text.write("\n  - second.mcap\n")
    assert said in refusal(arguments.format(**places).split(), capsys)


def recorded(path, scene="empty"):
    """An environment that is recorded to a bag."""
    env = gym.make("wheelchair_gym/Navigation-v1", scene=scene, split="test")
    return RecordEpisodes(env, path, recording=RecordingSettings(format="ros2"))


def test_a_bag_never_replaces_another(tmp_path, caplog):
    (tmp_path / "run").mkdir()
    (tmp_path / "run-1").write_text("mine")
    env = at_start(recorded(tmp_path / "run.mcap"))
    env.close()
    env.close()
    assert env.file == tmp_path / "run-2" / "run-2.mcap"
    assert "run exists; the recording is" in caplog.text
    assert len(bag_messages(env.file, lambda topic, _: topic == "/scan")) == 1
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="its folder is a file"):
        write_bags.RosBag(tmp_path / "file" / "run")


def test_a_full_disk_ends_the_bag(tmp_path, caplog, monkeypatch):
    env = at_start(recorded(tmp_path / "run"))
    full = OSError(28, "No space left on device")
    monkeypatch.setattr(env._out._bag._bag.storage, "write", Mock(side_effect=full))
    for _ in range(3):
        env.step(np.zeros(2))
    env.close()
    assert caplog.text.count("No space left on device") == 1


def test_actors_are_markers_that_replace_those_of_before(tmp_path):
    env = at_start(recorded(tmp_path / "run", "crowd"), 1)
    env.step(np.zeros(2))
    chair, world = env.unwrapped.chair, env.unwrapped.episode
    discs, segments = actor_shapes(world.actors, chair.truth.actor_poses)
    env.close()
    *_, (kind, _, _, newest) = decoded(tmp_path / "run", "/actors")
    assert kind == "visualization_msgs/msg/MarkerArray"
    first, *others = newest.markers
    assert first.action == 3
    cylinders = [one for one in others if one.type == 3]
    found = [(m.pose.position.x, m.pose.position.y, 0.5 * m.scale.x) for m in cylinders]
    np.testing.assert_allclose(found, discs)
    assert sum(len(one.points) for one in others if one.type == 5) == 2 * len(segments)
    assert len({one.id for one in others}) == len(others)
