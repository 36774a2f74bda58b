"""Reads MCAP files and ROS 2 bags: what `replay` needs of ours, scans and odometry of any.

Files are read within the limits of recordings. Only standard messages are read, whose definitions
are the same in every distribution; those in the bag are not used.
"""

import io
import logging
import math
import re
import shutil
import sqlite3
import struct
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final, NamedTuple
from urllib.parse import quote

import numpy as np

from wheelchair_gym.base.arrays import Array
from wheelchair_gym.base.errors import InputError, shorten
from wheelchair_gym.base.files import LIMITS, opened, read_bytes, read_text
from wheelchair_gym.geometry.planar import compose
from wheelchair_gym.hardware.ros import messages as ros
from wheelchair_gym.hardware.ros.make_messages import deserialized
from wheelchair_gym.perception.logs import SensorLog, log_of_poses
from wheelchair_gym.recording.topics import EPISODE
from wheelchair_gym.recording.write_bags import PREFIX
from wheelchair_gym.sensors.settings import LaserSettings

MAGIC = b"\x89MCAP0\r\n"


@contextmanager
def complete(file: str | Path) -> Iterator[None]:
    """Report whatever a reader finds wrong with a file's content in one line.

    Raises:
        InputError: the extra 'record' is not installed, or the file is damaged.
    """
    try:
        yield
    except ImportError:
        raise InputError("replaying needs: pip install 'wheelchair_gym[record]'") from None
    except Exception as error:  # of readers and decompressors, for damaged bytes
        why = f"no {error}" if isinstance(error, KeyError) else str(error) or type(error).__name__
        why = " ".join(why.split())[:200]
        raise InputError(f"{file}: expected a complete recording ({why})") from None


class Recorded(NamedTuple):
    """A message of an MCAP file, or of a bag."""

    time: int  # ns
    topic: str
    type: str  # the name of its schema
    data: bytes

    @property
    def fields(self) -> dict[str, Any]:
        """The message of a bag as a dictionary of its fields."""
        return deserialized(self.type, self.data)


def mcap_messages(file: str | Path, wanted: Callable[[str, str], bool]) -> list[Recorded]:
    """Read the messages of a file whose topic and type are wanted, in the order of their times.

    A file that was cut off is read as far as it goes, with a warning.

    Raises:
        InputError: the extra 'record' is not installed, or the file is damaged or beyond a limit.
    """
    content = read_bytes(file, "recording")
    with complete(file):
        found = _messages(content, wanted)
        if not content.endswith(MAGIC):
            if not found:
                raise ValueError("it was cut off before its first whole chunk of messages")
            _LOG.warning("%s: the recording was cut off; what it holds is used", file)
    found.sort(key=lambda message: message.time)  # stable: equal times stay in the file's order
    return found


def _messages(content: bytes, wanted: Callable[[str, str], bool]) -> list[Recorded]:
    from mcap.records import Channel, Chunk, Message, Schema
    from mcap.stream_reader import breakup_chunk

    types = {0: ""}  # of channels without a schema
    channels: dict[int, tuple[str, str]] = {}
    found: list[Recorded] = []
    unpacked = 0
    for record in _records(content):
        records: list[Any] = [record]
        if isinstance(record, Chunk):
            record.data = _decompressed(record.compression, record.data)
            record.compression = ""
            unpacked += len(record.data)
            if unpacked > LIMITS["unpacked"].maximum:
                raise ValueError(f"more than {LIMITS['unpacked'].maximum:,} bytes unpacked")
            records = breakup_chunk(record, validate_crc=True)
        for inner in records:
            if isinstance(inner, Schema):
                short = inner.name.count("/") == 1  # some writers leave out the middle part
                types[inner.id] = inner.name.replace("/", "/msg/") if short else inner.name
            elif isinstance(inner, Channel):
                channels[inner.id] = inner.topic, types[inner.schema_id]
            elif isinstance(inner, Message) and wanted(*channels[inner.channel_id]):
                found.append(Recorded(inner.log_time, *channels[inner.channel_id], inner.data))
    return found


def _records(content: bytes) -> Iterator[Any]:
    """Read the records of a file, chunks as they are, up to where it was cut off."""
    from mcap.exceptions import EndOfFile
    from mcap.stream_reader import StreamReader

    try:
        yield from StreamReader(io.BytesIO(content), emit_chunks=True, validate_crcs=True).records
    except (EndOfFile, struct.error):
        if content.endswith(MAGIC):
            raise


def _decompressed(compression: str, data: bytes) -> bytes:
    """The content of a chunk, which must not exceed the limit."""
    maximum = LIMITS["chunk"].maximum
    if compression == "":
        content = data
    elif compression == "zstd":
        import zstandard

        with zstandard.ZstdDecompressor(max_window_size=maximum).stream_reader(data) as stream:
            content = stream.read(maximum + 1)
    elif compression == "lz4":
        import lz4.frame

        content = lz4.frame.LZ4FrameDecompressor().decompress(data, max_length=maximum + 1)
    else:
        raise ValueError(f"compression {shorten(compression)} is unknown")
    if len(content) > maximum:
        raise ValueError(f"a chunk of more than {maximum:,} bytes")
    return content


_LOG = logging.getLogger(__name__)
_SCAN, _ODOMETRY = "sensor_msgs/msg/LaserScan", "nav_msgs/msg/Odometry"
_TF, _TEXT = "tf2_msgs/msg/TFMessage", "std_msgs/msg/String"
_STANDS = 1e-4  # m and of a rotation's matrix: less is no motion
_PROFILE = slice(17, 25)  # of an MCAP file: the length and the text of its first record's profile
_QUERY = """
    SELECT m.timestamp, t.name, t.type, m.data FROM messages m JOIN topics t ON m.topic_id = t.id
    ORDER BY m.timestamp, m.id
"""

# How files of other kinds begin, what they are, and what to do with them.
_OTHERS: Final = {
    b"#ROSBAG V": "a ROS 1 bag; expected one of ROS 2: rosbags-convert --src FILE --dst FOLDER",
    b"\x28\xb5\x2f\xfd": "compressed as a whole; expected what `zstd -d FILE` gives",
    b"rosbag2_bagfile_information": "the description of a bag; expected its folder",
    b"# message_name": "a CARMEN log; expected a ROS 2 bag of its scans and odometry",
}


_PACKED: Final = (".zstd", ".zst", ".lz4")
_PART: Final = re.compile(r"^\s*- +['\"]?(\S+\.(?:mcap|db3)(?:\.\w+)?)['\"]?\s*$", re.MULTILINE)


def is_bag(path: str | Path) -> bool:
    """Whether a path is a folder, a .db3 file, or an MCAP file of ROS 2.

    Raises:
        InputError: it is a recording of another program, which is named.
    """
    path = Path(path)
    if path.is_dir() or path.suffix == ".db3":
        return True
    with opened(path) as file:
        head = file.read(max(_PROFILE.stop, *map(len, _OTHERS)))
    for begin, what in _OTHERS.items():
        if head.startswith(begin):
            raise InputError(f"{path}: is {what}")
    return head[_PROFILE] == b"\x04\0\0\0ros2"


def bag_messages(path: str | Path, wanted: Callable[[str, str], bool]) -> list[Recorded]:
    """The messages of a bag whose topic and type are wanted, as CDR, in the order of their times.

    Raises:
        InputError: a file is missing, damaged, compressed as a whole or beyond a limit.
    """
    path = Path(path)
    files = [path]
    if path.is_dir():
        files = [one for one in path.iterdir() if one.suffix in (".mcap", ".db3")]
        _check_parts(path, len(files))
    if not files:
        raise InputError(
            f"{path}: expected a ROS 2 bag; it holds neither .mcap nor .db3 (`ros2 bag convert` "
            "unpacks a compressed bag)"
        )
    found: list[Recorded] = []
    for file in sorted(files):
        found += (_rows if file.suffix == ".db3" else mcap_messages)(file, wanted)
    found.sort(key=lambda message: message.time)
    return found


def _check_parts(folder: Path, n: int) -> None:
    """Refuse a bag of whose files some are compressed, or missing: n can be read."""
    about = folder / "metadata.yaml"
    named = _PART.findall(read_text(about, errors="replace")) if about.is_file() else []
    packed = sorted(one.name for one in folder.iterdir() if one.suffix in _PACKED)
    if n and (packed or len(named) > n):
        why = f"{packed[0]} is compressed" if packed else f"metadata.yaml names {len(named)} files"
        raise InputError(f"{folder}: {why}, {n} can be read; expected all, as .mcap or .db3")


def _rows(file: Path, wanted: Callable[[str, str], bool]) -> list[Recorded]:
    """Return the wanted messages of an SQLite file, with those of its write-ahead log.

    A recorder that was killed leaves messages in a file that ends in -wal. SQLite folds it in where
    it may write, so both files are copied: a bag is never changed.
    """
    log = file.with_name(f"{file.name}-wal")
    parts = [file, log] if log.exists() and log.stat().st_size else [file]
    with ExitStack() as stack:
        for one in parts:
            stack.enter_context(opened(one, "recording"))  # its size is checked
        mode, source = "ro&immutable=1", file
        if log in parts:
            folder = Path(stack.enter_context(TemporaryDirectory()))
            for one in parts:
                shutil.copyfile(one, folder / one.name)
            mode, source = "rw", folder / file.name
        try:
            link = sqlite3.connect(f"file:{quote(str(source))}?mode={mode}", uri=True)
            stack.callback(link.close)
            link.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, LIMITS["chunk"].maximum)
            link.execute("PRAGMA trusted_schema = OFF")
            kinds = dict(link.execute("SELECT name, type FROM sqlite_schema"))
            if kinds.get("messages") != "table" or kinds.get("topics") != "table":
                raise sqlite3.DatabaseError("it has no tables messages and topics")
            rows = [Recorded(*row) for row in link.execute(_QUERY) if wanted(*row[1:3])]
        except (sqlite3.Error, OverflowError, TypeError, ValueError) as error:
            why = shorten(str(error))
            raise InputError(f"{file}: expected a ROS 2 bag in SQLite ({why})") from None
    if not all(isinstance(row.time, int) and isinstance(row.data, bytes) for row in rows):
        raise InputError(f"{file}: expected whole numbers as timestamps and bytes as data")
    return rows


def is_ours(path: str | Path) -> bool:
    """Whether this package has recorded a bag.

    Raises:
        InputError: see `bag_messages`.
    """
    return bool(bag_messages(path, lambda topic, _: topic == PREFIX + EPISODE))


def bag_texts(path: str | Path, topics: Sequence[str]) -> list[tuple[str, str]]:
    """Topics, without `PREFIX`, and texts of a bag that this package has recorded.

    Raises:
        InputError: see `bag_messages`; or this package has not recorded it.
    """
    names = {PREFIX + topic: topic for topic in topics}
    found = bag_messages(path, lambda topic, kind: topic in names and kind == _TEXT)
    if not found:
        raise InputError(
            f"{path}: only drives that this program has recorded can be judged again; "
            "`wheelchair map --recording` reads the scans of every bag"
        )
    with complete(path):
        return [(names[one.topic], one.fields["data"]) for one in found]


def bag_log(
    path: str | Path, scan: str = "", odometry: str = ""
) -> tuple[SensorLog, LaserSettings]:
    """Scans of a bag with the odometry at their stamps, and the laser as the bag describes it.

    Args:
        path: of the bag.
        scan: topic of the scans; empty: /scan, or the only one.
        odometry: topic of the odometry; empty: /odom, or the only one, or else the transforms from
            the frame odom on /tf.

    Raises:
        InputError: see `bag_messages`; or there are no such topics, or no good scan between two
            messages of the odometry.
    """
    found = bag_messages(path, lambda _, kind: kind in (_SCAN, _ODOMETRY, _TF))
    scans = _of_topic(path, found, _SCAN, scan, "/scan", "--scan-topic")
    static = [one for one in found if one.type == _TF and one.topic.endswith("tf_static")]
    moving = [one for one in found if one.type == _TF and not one.topic.endswith("tf_static")]
    edges = _fixed(moving)
    skipped: Counter[str] = Counter()
    with complete(path):
        for one in static:
            edges |= {c: (p, pose) for p, c, pose in ros.transforms(one.fields)}
    poses, base = _odometry(path, found, moving, odometry, skipped)
    messages: list[dict[str, Any]] = []
    for one in scans:
        with _skipping(skipped, "scan"):
            message = one.fields
            mount = _mount(edges, ros.frame(message), base)
            messages.append(ros.upright(message, mount is not None and ros.on_floor(mount)[1]))
    if not messages:
        raise _unusable(path, scans, skipped)
    usual, _ = Counter(map(_fan, messages)).most_common(1)[0]
    of_laser = next(one for one in messages if _fan(one) == usual)
    with complete(path):
        laser, middle = _laser(path, of_laser, edges, base)
    times: list[int] = []
    ranges = []
    for message in messages:
        with _skipping(skipped, "scan"):
            stamp = _stamp(message)
            frame, wanted = ros.frame(message), ros.frame(of_laser)
            if frame != wanted:
                raise ValueError(f"in another frame than {wanted}: {frame}")
            if not poses or not min(poses) <= stamp <= max(poses):
                raise ValueError("without odometry")
            if times and stamp <= times[-1]:
                raise ValueError("time goes back")
            centred = message | {"angle_min": float(message["angle_min"]) - middle}
            ranges.append(ros.scan(centred, laser, math.inf))
            times.append(stamp)
    if not times:
        raise _unusable(path, scans, skipped)
    known = sorted(poses)
    rows = np.array([poses[stamp] for stamp in known])
    rows[:, 2] = np.unwrap(rows[:, 2])
    zero = known[0]  # int64 nanoseconds since 1970 would lose digits as float64
    at, of = np.array([t - zero for t in times]), np.array([t - zero for t in known])
    there = np.stack([np.interp(at, of, column) for column in rows.T], axis=1)
    seconds = (at - at[0]) / 1e9
    return log_of_poses(seconds, there, np.stack(ranges), dict(skipped)), laser


def _fixed(changes: list[Recorded]) -> dict[str, tuple[str, Array]]:
    """Parents and transforms by child of what never changes on /tf: ROS 1 tells mounts there."""
    edges: dict[str, tuple[str, Array]] = {}
    moving: set[str] = set()
    for one in changes:
        with suppress(Exception):  # of readers, for damaged bytes
            for parent, child, pose in ros.transforms(one.fields):
                was, at = edges.setdefault(child, (parent, pose))
                if was != parent or np.abs(pose - at).max() > _STANDS:
                    moving.add(child)
    return {child: edge for child, edge in edges.items() if child not in moving}


def _odometry(
    path: str | Path, found: list[Recorded], changes: list[Recorded], topic: str,
    skipped: Counter[str],
) -> tuple[dict[int, Array], str]:  # fmt: skip
    """Poses (3,) by their stamps [ns], and the frame whose poses they are."""
    poses: dict[int, Array] = {}
    base = ""
    if topic or not changes or any(one.type == _ODOMETRY for one in found):
        for one in _of_topic(path, found, _ODOMETRY, topic, "/odom", "--odometry-topic"):
            with _skipping(skipped, "odometry"):
                message = one.fields
                poses[_stamp(message)] = ros.odometry(message)[0]
                base = str(message["child_frame_id"]).lstrip("/")
        return poses, base
    for one in changes:
        with _skipping(skipped, "transform"):
            for edge in one.fields["transforms"]:
                for parent, child, matrix in ros.transforms({"transforms": [edge]}):
                    if parent.split("/")[-1].startswith("odom"):
                        poses[_stamp(edge)], base = ros.on_floor(matrix)[0], child
    if poses:
        return poses, base
    raise InputError(
        f"{path}: expected odometry: a topic of {_ODOMETRY}, or transforms from odom on /tf"
    )


@contextmanager
def _skipping(skipped: Counter[str], what: str) -> Iterator[None]:
    """Count a malformed message, and go on."""
    try:
        yield
    except Exception as error:  # of readers, for damaged bytes
        skipped[f"{what}: {' '.join(str(error).split())[:80] or type(error).__name__}"] += 1


def _of_topic(
    path: str | Path, found: list[Recorded], kind: str, chosen: str, usual: str, option: str
) -> list[Recorded]:
    """The messages of a topic of a type."""
    topics = dict.fromkeys(one.topic for one in found if one.type == kind)
    name = chosen or (usual if usual in topics or len(topics) != 1 else next(iter(topics)))
    if name not in topics:
        known = shorten(", ".join(topics))[1:-1] if topics else "none"
        raise InputError(f"{path}: no {kind} on {name}; there are: {known} ({option})")
    return [one for one in found if one.topic == name and one.type == kind]


def _stamp(message: Mapping[str, Any]) -> int:
    """The time of a message [ns], exactly."""
    ros.stamp(message["header"])  # checks it
    stamp = message["header"]["stamp"]
    return int(stamp["sec"]) * 10**9 + int(stamp["nanosec"])


def _degrees(angle: float) -> float:
    """An angle [rad] of float32 as its maker meant it: a multiple of 1e-4 degrees."""
    return math.radians(round(math.degrees(angle), 4))


def _meant(value: float) -> float:
    """A number of float32 with the fewest digits that give it, as its maker wrote it."""
    return float(str(np.float32(value)))


def _unusable(path: str | Path, scans: list[Recorded], skipped: Mapping[str, int]) -> InputError:
    """Return the error that no scan can be used, with the reasons and their numbers."""
    why = ", ".join(f"{count} {reason}" for reason, count in skipped.items())
    return InputError(f"{path}: no scan of {scans[0].topic} can be used ({why})")


def _fan(message: Mapping[str, Any]) -> tuple[str, int, float, float]:
    """Return what makes two scans those of one laser: frame, beams, first angle and step [rad]."""
    first, step = float(message["angle_min"]), float(message["angle_increment"])
    return ros.frame(message), len(message["ranges"]), round(first, 4), round(step, 6)


def _laser(
    path: str | Path, message: dict[str, Any], edges: Mapping[str, tuple[str, Array]], base: str
) -> tuple[LaserSettings, float]:
    """Return the laser of a scan, mounted as the static transforms say, and its middle [rad]."""
    beams, step = len(message["ranges"]), float(message["angle_increment"])
    frame = ros.frame(message)
    matrix = _mount(edges, frame, base)
    mount = np.zeros(3) if matrix is None else ros.on_floor(matrix)[0]
    if matrix is None:
        _LOG.warning("%s: %s has no transform to %s; the laser counts as there", path, frame, base)
    fan = step * (beams - 1)
    middle = float(message["angle_min"]) + 0.5 * fan
    x, y, yaw = compose(mount, (0.0, 0.0, middle)).tolist()
    exact = float(message["angle_max"]) - float(message["angle_min"])
    fov = exact if abs(exact - fan) <= step else fan
    laser = LaserSettings(
        x=round(x, 9), y=round(y, 9), yaw=_degrees(yaw), beams=beams,
        fov=min(_degrees(fov), 2.0 * math.pi),
        reach=min(max(_meant(message["range_max"]), 0.5), 100.0),
        range_min=max(0.0, _meant(message["range_min"])),
    )  # fmt: skip
    return laser, middle


def _mount(edges: Mapping[str, tuple[str, Array]], frame: str, root: str) -> Array | None:
    """Return the matrix (4, 4) of a frame in another, by static transforms up from both."""
    above = [ros.way_up(edges, name) for name in (frame, root)]
    common = next((name for name in above[0] if name in above[1]), None)
    return None if common is None else np.linalg.inv(above[1][common]) @ above[0][common]
