"""Laws of bags that other programs wrote: they give the map of the room that was driven through.

The drive is plain trigonometry, the writers are mcap-ros2-support's and rosbags', and nothing of
this project takes part in them.
"""

import json
import math
import shutil
import signal
import sqlite3
import sys
from contextlib import closing
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from mcap.writer import CompressionType
from mcap_ros2.writer import Writer as McapWriter
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as BagWriter
from rosbags.typesys import Stores, get_typestore

from agents.cli import main
from tests.conftest import python, refusal
from wheelchair_gym import InputError
from wheelchair_gym.maps import OCCUPIED, read_map
from wheelchair_gym.recording.read_bags import bag_log

WIDTH, DEPTH = 8.0, 5.0  # m: the room; odometry begins at its centre
BEAMS, FOV, PERIOD = 181, math.radians(270.0), 0.1
ZERO = 1_750_000_000_000_000_000  # ns
TYPES = {
    "/scan": "sensor_msgs/msg/LaserScan",
    "/odom": "nav_msgs/msg/Odometry",
    "/tf_static": "tf2_msgs/msg/TFMessage",
    "/tf": "tf2_msgs/msg/TFMessage",
    "/chatter": "std_msgs/msg/String",
}


def poses(count):
    """Along an ellipse, heading along it."""
    for k in range(count):
        angle = 2.0 * math.pi * k / 150
        yield (
            2.0 * math.sin(angle), 0.8 - 0.8 * math.cos(angle),
            math.atan2(0.8 * math.sin(angle), 2.0 * math.cos(angle)),
        )  # fmt: skip


def ranges(x, y, yaw):
    """Distances to the walls of the room from a laser 0.3 m ahead of the pose."""
    x, y = x + 0.3 * math.cos(yaw), y + 0.3 * math.sin(yaw)
    angles = yaw + np.linspace(-0.5 * FOV, 0.5 * FOV, BEAMS)
    with np.errstate(divide="ignore"):
        across = np.where(np.cos(angles) > 0.0, 0.5 * WIDTH - x, -0.5 * WIDTH - x) / np.cos(angles)
        along = np.where(np.sin(angles) > 0.0, 0.5 * DEPTH - y, -0.5 * DEPTH - y) / np.sin(angles)
    return np.minimum(across, along)


def stamped(k, frame):
    second, part = divmod(ZERO + round(1e9 * PERIOD * k), 10**9)
    return {"stamp": {"sec": second, "nanosec": part}, "frame_id": frame}


def at(x, y, yaw=0.0):
    turn = {"x": 0.0, "y": 0.0, "z": math.sin(0.5 * yaw), "w": math.cos(0.5 * yaw)}
    return {"x": x, "y": y, "z": 0.0}, turn


def edge(k, parent, child, x, y, yaw=0.0):
    """A message of one transform."""
    place, turn = at(x, y, yaw)
    moved = {"translation": place, "rotation": turn}
    return {"transforms": [
        {"header": stamped(k, parent), "child_frame_id": child, "transform": moved}
    ]}  # fmt: skip


def drive(count, odometry="/odom"):
    """Yield time [ns], topic and content of each message of a drive of `count` scans."""
    yield ZERO, "/tf_static", edge(0, "base_link", "lidar", 0.3, 0.0)
    zero = {"x": 0.0, "y": 0.0, "z": 0.0}
    for k, pose in enumerate(poses(count)):
        now = ZERO + round(1e9 * PERIOD * k)
        place, turn = at(*pose)
        yield now, odometry, {
            "header": stamped(k, "odom"), "child_frame_id": "base_link",
            "pose": {"pose": {"position": place, "orientation": turn}, "covariance": [0.0] * 36},
            "twist": {"twist": {"linear": zero, "angular": zero}, "covariance": [0.0] * 36},
        } if odometry == "/odom" else edge(k, "odom", "base_link", *pose)  # fmt: skip
        yield now, "/scan", {
            "header": stamped(k, "lidar"), "angle_min": -0.5 * FOV, "angle_max": 0.5 * FOV,
            "angle_increment": FOV / (BEAMS - 1), "time_increment": 0.0, "scan_time": PERIOD,
            "range_min": 0.05, "range_max": 20.0, "ranges": ranges(*pose).tolist(),
            "intensities": [],
        }  # fmt: skip
        yield now, "/chatter", {"data": f"{k}"}


def write_mcap(file, count, finish=True, short=False, odometry="/odom", **more):
    """A file by mcap-ros2-support: no metadata.yaml, no QoS; its examples have short names."""
    store = get_typestore(Stores.ROS2_HUMBLE)
    writer = McapWriter(str(file), **more)
    schemas = {
        topic: writer.register_msgdef(
            kind.replace("/msg", "") if short else kind, store.generate_msgdef(kind, 2)[0]
        )
        for topic, kind in TYPES.items()
    }
    for now, topic, content in drive(count, odometry):
        writer.write_message(topic, schemas[topic], content, log_time=now)
    if finish:
        writer.finish()
    return file


def write_sqlite(folder, count, store=Stores.ROS2_FOXY, end=None):
    """A bag by rosbags, of its typed messages, each serialized by rosbags."""
    types = get_typestore(store)

    def made(kind, content):
        fields = {}
        for name, (node, detail) in types.fielddefs[kind][1]:
            value = content[name]
            if isinstance(value, dict):
                value = made(detail, value)
            elif isinstance(value, list) and node.name in ("ARRAY", "SEQUENCE"):
                inner = detail[0]
                value = (
                    [made(inner[1], one) for one in value]
                    if inner[0].name == "NAME"
                    else np.array(value, inner[1][0])
                )
            fields[name] = value
        return types.types[kind](**fields)

    with BagWriter(folder, version=8, storage_plugin=end or StoragePlugin.SQLITE3) as bag:
        topics = {t: bag.add_connection(t, kind, typestore=types) for t, kind in TYPES.items()}
        for now, topic, content in drive(count):
            kind = TYPES[topic]
            data = types.serialize_cdr(made(kind, content), kind)
            bag.write(topics[topic], now, data)
    return folder


def mapped(path, out):
    """Runs `wheelchair map`; how far off the walls of the map are at most [m]."""
    drawn = ["map", "--recording", str(path), "--quiet", "--particles", "5", "--out", str(out)]
    assert main(drawn) == 0
    grid = read_map(out / "map.yaml")
    rows, columns = np.nonzero(grid.cells == OCCUPIED)
    spots = grid.origin[:2] + grid.resolution * (np.stack([columns, rows], axis=1) + 0.5)
    off = np.abs(np.abs(spots) - 0.5 * np.array([WIDTH, DEPTH])).min(axis=1)
    return SimpleNamespace(off=np.quantile(off, 0.95), size=np.ptp(spots, axis=0))


WRITERS = {
    "mcap, zstd": lambda at: write_mcap(at / "run.mcap", 150),
    "mcap, short names": lambda at: write_mcap(at / "run.mcap", 150, short=True),
    "mcap, odometry by tf": lambda at: write_mcap(at / "run.mcap", 150, odometry="/tf"),
    "mcap, lz4, small chunks": lambda at: write_mcap(
        at / "run.mcap", 150, compression=CompressionType.LZ4, chunk_size=20_000
    ),
    "sqlite of Foxy": lambda at: write_sqlite(at / "run", 150),
    "mcap of Humble": lambda at: write_sqlite(
        at / "run", 150, Stores.ROS2_HUMBLE, StoragePlugin.MCAP
    ),
}


@pytest.mark.parametrize("writer", WRITERS)
def test_others_bags_give_the_room(writer, tmp_path, capsys):
    found = mapped(WRITERS[writer](tmp_path), tmp_path / "out")
    assert "150 scans in 14.9 s, 0 lines skipped" in capsys.readouterr().out
    assert found.off < 0.1
    np.testing.assert_allclose(found.size, [WIDTH, DEPTH], atol=0.2)


def test_the_chair_is_fitted_to_the_bag_of_another_robot(tmp_path, monkeypatch, capsys):
    """It turns both ways; its wheels are right, and its laser is where nobody said."""

    def eight(count):
        for angle in np.linspace(0.0, 4.0 * math.pi, count):
            x, y = 2.0 * math.sin(angle), 0.9 * math.sin(2.0 * angle)
            yield x, y, math.atan2(1.8 * math.cos(2.0 * angle), 2.0 * math.cos(angle))

    monkeypatch.setattr(sys.modules[__name__], "poses", eight)
    bag = write_sqlite(tmp_path / "run", 300)
    assert main(["fit", str(bag), "--json", str(tmp_path / "fit.json")]) == 0
    told = json.loads((tmp_path / "fit.json").read_text())
    values = {one["name"]: one["value"] for one in told["findings"]}
    assert (values["x"], values["y"]) == pytest.approx((0.3, 0.0), abs=0.01)
    assert values["scale"] == pytest.approx(1.0, abs=0.01)
    assert values["torque_constant"] is None
    assert "motors not seen" in capsys.readouterr().out
    assert "expected the commands" in refusal(["replay", str(bag), "--simulate"], capsys)


@pytest.fixture
def log_of(monkeypatch, tmp_path):
    """A function: the log and the laser of the drive's bag, each message changed by a function."""

    def read(change, count=30, mount="/tf_static"):
        whole = drive

        def changed(*given):
            for now, topic, content in whole(*given):
                other = mount if topic == "/tf_static" else topic
                yield now, other, change(topic, content, round((now - ZERO) / (1e9 * PERIOD)))

        with monkeypatch.context() as patch:
            patch.setitem(globals(), "drive", changed)
            return bag_log(write_mcap(tmp_path / "run.mcap", count))

    return read


def mounted(content, **turn):
    (transform,) = content["transforms"]
    rotation = {"x": 0.0, "y": 0.0, "z": 0.0, "w": 0.0} | turn
    moved = transform["transform"] | {"rotation": rotation}
    return {"transforms": [transform | {"transform": moved}]}


@pytest.mark.parametrize("mount", ["/tf_static", "/tf"])  # ROS 1 has no /tf_static
def test_a_laser_upside_down_gives_the_same_log(mount, log_of):
    def hangs(topic, content, _):
        if topic == "/tf_static":
            return mounted(content, x=1.0)
        return content | {"ranges": content["ranges"][::-1]} if topic == "/scan" else content

    log, laser = log_of(lambda _, content, __: content)
    turned, same = log_of(hangs, mount=mount)
    assert same == laser
    np.testing.assert_array_equal(turned.ranges, log.ranges)


@pytest.mark.parametrize(
    ("turn", "why"),
    [
        ({"x": math.sin(0.2), "w": math.cos(0.2)}, "tilted by 23 deg; expected upright or upside"),
        ({}, "quaternion's norm is not 1"),
        ({"w": math.nan}, "not finite"),
    ],
)
def test_a_transform_that_cannot_be_used_is_not_taken_for_none(turn, why, log_of):
    def tilted(topic, content, _):
        return mounted(content, **turn) if topic == "/tf_static" else content

    with pytest.raises(InputError, match=why):
        log_of(tilted)


def test_every_scan_has_its_own_angles(log_of):
    step = FOV / (BEAMS - 1)

    def wider(topic, content, k):
        if topic != "/scan" or k % 3 != 1:
            return content
        more = 1 + k % 7  # beams that look farther to the right
        return content | {
            "angle_min": content["angle_min"] - more * step,
            "ranges": [1.0] * more + content["ranges"],
        }

    (log, laser), (other, same) = log_of(lambda _, content, __: content), log_of(wider)
    assert same == laser
    np.testing.assert_array_equal(other.ranges, log.ranges)


def test_scans_of_other_kinds_are_refused_and_counted(log_of):
    def mixed(topic, content, k):
        if topic != "/scan":
            return content
        if k < 5:
            return content | {"ranges": content["ranges"][: (0, 0, 100, 100, 50)[k]]}
        return content | {"header": stamped(k, "rear")} if k % 5 == 0 else content

    log, laser = log_of(mixed)
    assert laser.beams == BEAMS
    assert len(log.stamps) == 20
    found = dict(log.skipped)
    assert found["scan: in another frame than lidar: rear"] == 5
    assert sum(found.values()) == 10


def test_messages_in_a_write_ahead_log_are_read_and_the_bag_is_not_changed(tmp_path):
    (file,) = write_sqlite(tmp_path / "run", 30).glob("*.db3")
    whole = bag_log(tmp_path / "run")[0]
    left = tmp_path / "left"
    left.mkdir()
    with closing(sqlite3.connect(file)) as link:
        link.execute("PRAGMA journal_mode = WAL")
        rows = link.execute("SELECT * FROM messages WHERE id > 40").fetchall()
        link.execute("DELETE FROM messages WHERE id > 40")
        link.commit()
        link.execute("PRAGMA wal_checkpoint(TRUNCATE)")
        link.executemany(f"INSERT INTO messages VALUES ({','.join('?' * len(rows[0]))})", rows)
        link.commit()
        for one in file.parent.glob("*.db3*"):
            shutil.copyfile(one, left / one.name)
    before = {one.name: one.read_bytes() for one in left.iterdir()}
    assert any(name.endswith("-wal") for name in before)
    found = bag_log(left)[0]
    np.testing.assert_array_equal(found.ranges, whole.ranges)
    assert {one.name: one.read_bytes() for one in left.iterdir()} == before


@pytest.mark.parametrize("frame", ["odom", "/odom", "robot1/odom", "odom_combined"])
def test_frames_of_odometry_may_have_a_prefix(frame, tmp_path, monkeypatch):
    named = lambda k, parent, *rest, old=edge: old(  # noqa: E731
        k, frame if parent == "odom" else parent, *rest
    )
    monkeypatch.setitem(globals(), "edge", named)
    log, _ = bag_log(write_mcap(tmp_path / "run.mcap", 20, odometry="/tf"))
    assert len(log.stamps) == 20


KILLED = """
import os, sys
from tests.recording.test_foreign_bags import write_mcap
write_mcap(sys.argv[1], 150, finish=False, chunk_size=int(sys.argv[2]))
os.kill(os.getpid(), 9)
"""


def killed(file, chunk_size):
    """A file without an index, of a program that was killed."""
    done = python(KILLED, file, chunk_size)
    assert done.returncode == -signal.SIGKILL, done.stderr
    return file


def test_a_killed_programs_file_gives_a_map_of_what_is_there(tmp_path, capsys, caplog):
    file = killed(tmp_path / "run.mcap", 20_000)
    found = mapped(file, tmp_path / "out")
    assert f"{file}: the recording was cut off; what it holds is used" in caplog.text
    assert found.off < 0.1
    whole = file.read_bytes()
    for part in (0.95, 0.6, 0.3):
        (tmp_path / "cut.mcap").write_bytes(whole[: int(part * len(whole))])
        assert mapped(tmp_path / "cut.mcap", tmp_path / "out").off < 0.1


def test_where_nothing_is_whole_it_is_one_line(tmp_path, capsys):
    file = killed(tmp_path / "run.mcap", 1 << 24)  # all in the chunk that was being filled
    for content in (file.read_bytes(), write_mcap(tmp_path / "whole", 30).read_bytes()[:2000]):
        file.write_bytes(content)
        line = refusal(["map", "--recording", file, "--out", tmp_path / "out"], capsys)
        assert line.startswith(f"wheelchair: {file}: expected a")
    assert not Path(tmp_path / "out").exists()


def test_a_bag_without_odometry_is_one_line(tmp_path, capsys, monkeypatch):
    on_map = lambda k, parent, *rest, old=edge: old(k, "map", *rest)  # noqa: E731
    monkeypatch.setitem(globals(), "edge", on_map)
    file = write_mcap(tmp_path / "run.mcap", 5, odometry="/tf")
    line = refusal(["map", "--recording", file, "--out", tmp_path / "out"], capsys)
    assert "expected odometry: a topic of nav_msgs/msg/Odometry, or transforms from odom" in line
