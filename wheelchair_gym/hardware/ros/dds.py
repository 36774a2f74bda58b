"""A robot's topics over DDS: ROS 2 sees them without a bridge.

    publish ──▶ CDR (rosbags) ──▶ writer rt/scan, sensor_msgs::msg::dds_::LaserScan_ ──▶ ROS 2
    on_message ◀── CDR ◀── reader rt/cmd_vel, one for each type ◀────────────────────── ROS 2

Names of topics and types, and the node's entry in ros_discovery_info, are as every rmw writes them
(design.ros2.org, "Topic and service name mapping to DDS"). Services are not served: each vendor
carries the number of a request in another place.
"""

import logging
import re
import socket
import threading
from collections.abc import Callable, Mapping
from functools import cache
from typing import Any, Final, NamedTuple

from wheelchair_gym.base.errors import imports
from wheelchair_gym.base.settings import InputError
from wheelchair_gym.hardware.ros.make_messages import deserialized, serialized, typestore
from wheelchair_gym.hardware.ros.rosbridge import Service, is_local

_LOG = logging.getLogger(__name__)
_NODE = "wheelchair"
_EMPTY = "std_msgs/msg/Empty"
_NODES: Final = ("ros_discovery_info", "rmw_dds_common/msg/ParticipantEntitiesInfo")
_DEPTH = 10  # as nav2_ros_common's StandardTopicQoS
_DEEP = {"/tf": 100}  # as tf2's DynamicBroadcasterQoS
_LARGEST_DOMAIN = 232  # its ports are below 65536
_HANDLES = 1 << 64  # of publishers: some calls give them with a sign
_PATIENCE = 0.1  # s between two looks at who has come and gone
_MAX_COMMANDS = 100  # that are taken at once
# DDS policies by the numbers of DDSI (and of dds_qos_policy_id_t), as ROS names them.
_TYPE = 24
_POLICIES: Final = {
    2: "durability", 4: "deadline", 8: "liveliness", 11: "reliability", _TYPE: "type"
}  # fmt: skip


def domain_number(text: str) -> int:
    """The number of a DDS domain, as ROS_DOMAIN_ID gives it; an empty text is 0.

    Raises:
        InputError: it is none.
    """
    number = int(text[-3:] or 0) if re.fullmatch("0*[0-9]{0,3}", text) else -1
    if not 0 <= number <= _LARGEST_DOMAIN:
        raise InputError(f"ROS_DOMAIN_ID is {text!r:.40}; expected 0 to {_LARGEST_DOMAIN}")
    return number


@cache
def idl_type(kind: str) -> Any:
    """A type of ROS as cyclonedds needs it; its samples hold `cdr`, the bytes of a message."""
    import cyclonedds.idl
    from rosbags.interfaces import Nodetype

    types: Any = cyclonedds.idl.types

    def of(node: Any, definition: Any) -> Any:
        if node == Nodetype.NAME:
            return idl_type(definition)
        if node == Nodetype.BASE:
            name, bound = definition
            if name == "string":
                return types.bounded_str[bound] if bound else str
            name = {"byte": "uint8", "char": "uint8"}.get(name, name)
            return {"bool": bool}.get(name) or getattr(types, name)
        (inner, detail), length = definition
        each = of(inner, detail)
        if node == Nodetype.ARRAY:
            return types.array[each, length]
        return types.sequence[each, length] if length else types.sequence[each]

    package, part, name = kind.split("/")
    fields = {key: of(*field) for key, field in typestore().fielddefs[kind][1]}
    name = f"{name}_"
    found: Any = cyclonedds.idl.make_idl_struct(name, f"{package}::{part}::dds_::{name}", fields)
    # A sample goes as the bytes that rosbags writes, and comes as they are.
    found.serialize = lambda sample, **_: bytes(sample.cdr)
    found.deserialize = classmethod(lambda cls, data, **_: _sample(cls, data))
    return found


def _sample(kind: Any, cdr: Any) -> Any:
    sample = kind.__new__(kind)
    sample.cdr = cdr
    return sample


class _Reader(NamedTuple):
    topic: str
    type: str
    reader: Any
    take: Callable[[Mapping[str, Any], int], object]  # of a message and its publisher
    publishers: set[int]  # that were there at the last look, or have sent since


class DdsLink:
    """Publishes and subscribes from when it is made until `close`.

    Args:
        host: IPv4 address of the network interface; 0.0.0.0: Cyclone DDS chooses one. That of this
            machine alone is used without multicast.
        domain: number of the DDS domain.
        on_message: is called in a thread with topic, message and the publisher's number.
        on_leave: is called in a thread with the number of a publisher that is gone.
        namespace: of the node; empty: none.

    Attributes:
        url: dds://HOST/DOMAIN.
        lost: why nothing is received any more, in a line; empty while all is well.

    Raises:
        InputError: the extra 'dds' is not installed, or this machine has no such address.
    """

    def __init__(
        self,
        host: str,
        domain: int,
        on_message: Callable[[str, Any, object], object],
        on_leave: Callable[[object], object] = lambda publisher: None,
        namespace: str = "",
    ) -> None:
        with imports("topics over DDS need", "dds"):
            import rosbags  # noqa: F401
            from cyclonedds.core import DDSException, WaitSet
            from cyclonedds.domain import Domain, DomainParticipant

        self.url, self.lost = f"dds://{host}/{domain}", ""
        try:
            with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
                probe.bind((host, 0))
                address = probe.getsockname()[0]
        except (OSError, OverflowError) as error:
            why = getattr(error, "strerror", None) or error
            raise InputError(
                f"{host}: expected an IPv4 address of a network interface of this machine ({why})"
            ) from None
        self._on_message, self._on_leave = on_message, on_leave
        self._namespace = f"/{namespace}"
        try:
            self._domain: Any = Domain(domain, _configuration(address))
            self._participant: Any = DomainParticipant(domain)
        except DDSException as error:
            raise InputError(f"{self.url}: cannot be served ({error.msg})") from None
        if not is_local(host):
            _LOG.warning("%s: nothing is encrypted: whoever reaches it commands the chair", host)
        self._writers: dict[str, tuple[str, Any]] = {}
        self._readers: list[_Reader] = []
        self._wakes: Any = WaitSet(self._participant)
        self._lock = threading.Lock()
        self._closed = threading.Event()
        self._nodes: Any = self._writer(*_NODES, latch=True, depth=1)
        self._announce()
        self._thread = threading.Thread(target=self._listen, daemon=True)
        self._thread.start()

    def advertise(self, topic: str, kind: str, latch: bool = False) -> None:
        """Announce a topic; the last message of a latched one goes to late subscribers, too."""
        depth = 1 if latch else _DEEP.get(topic, _DEPTH)
        with self._lock:
            self._writers[topic] = kind, self._writer(f"rt{topic}", kind, latch, depth)
            self._announce()

    def subscribe(self, topic: str, kind: str) -> None:
        """Subscribe to a topic of a type; one topic may be subscribed to with several types."""
        self._subscribe(topic, kind, lambda message, who: self._on_message(topic, message, who))

    def serve(self, name: str, kind: str, service: Service) -> None:
        """Offer a service as a topic of its name: a std_msgs/Empty calls it."""
        self._subscribe(name, _EMPTY, lambda message, who: service({}))

    def publish(self, topic: str, message: Any) -> None:
        """Send a message to all subscribers; it is dropped where they take none."""
        kind, writer = self._writers[topic]
        self._write(writer, serialized(kind, message))

    def close(self) -> None:
        """Leave the domain; may be called again."""
        self._closed.set()
        self._thread.join()
        with self._lock:
            self._writers, self._readers = {}, []
            self._wakes = self._nodes = self._participant = self._domain = None

    def _subscribe(
        self, topic: str, kind: str, take: Callable[[Mapping[str, Any], int], object]
    ) -> None:
        from cyclonedds.core import InstanceState, ReadCondition, SampleState, ViewState
        from cyclonedds.sub import DataReader
        from cyclonedds.topic import Topic

        qos = _qos(latched=False, depth=_DEPTH)
        reader = DataReader(
            self._participant, Topic(self._participant, f"rt{topic}", idl_type(kind), qos), qos
        )
        some = ReadCondition(reader, SampleState.Any | ViewState.Any | InstanceState.Any)
        with self._lock:
            self._wakes.attach(some)
            self._readers = [*self._readers, _Reader(topic, kind, reader, take, set())]
            self._announce()

    def _writer(self, name: str, kind: str, latch: bool, depth: int) -> Any:
        from cyclonedds.pub import DataWriter
        from cyclonedds.topic import Topic

        qos = _qos(latch, depth)
        topic = Topic(self._participant, name, idl_type(kind), qos)
        return DataWriter(self._participant, topic, qos)

    @staticmethod
    def _write(writer: Any, cdr: Any) -> None:
        from cyclonedds.core import DDSException

        try:
            writer.write(_sample(writer.data_type, cdr))
        except DDSException as error:
            if error.code != DDSException.DDS_RETCODE_TIMEOUT:  # a subscriber takes nothing
                raise

    def _announce(self) -> None:
        """Publish the node's name and its endpoints, so that `ros2 node list` knows it."""
        node = {
            "node_namespace": self._namespace,
            "node_name": _NODE,
            "reader_gid_seq": [_gid(one.reader) for one in self._readers],
            "writer_gid_seq": [_gid(writer) for _, writer in self._writers.values()],
        }
        message = {"gid": _gid(self._participant), "node_entities_info_seq": [node]}
        self._write(self._nodes, serialized(_NODES[1], message))

    def _listen(self) -> None:
        try:
            while not self._closed.is_set():
                self._wakes.wait(round(_PATIENCE * 1e9))
                self._receive()
        except Exception as error:  # commands would not be received any more
            self.lost = " ".join(str(error).split())

    def _receive(self) -> None:
        """Take what has come, and look at who has come and gone."""
        with self._lock:
            readers, writers = self._readers, dict(self._writers)
        for one in readers:
            for sample in one.reader.take(_MAX_COMMANDS):
                if sample.sample_info.valid_data:
                    publisher = sample.sample_info.publication_handle % _HANDLES
                    one.publishers.add(publisher)
                    one.take(content_of(one.type, sample), publisher)
            self._look(one)
        for topic, (_, writer) in writers.items():
            status = writer.get_offered_incompatible_qos_status()
            if status.total_count_change > 0:
                _report(topic, "subscriber asks for", status.last_policy_id)

    def _look(self, one: _Reader) -> None:
        """Report publishers of a topic that are gone, or that do not fit."""
        there = {handle % _HANDLES for handle in one.reader.get_matched_publications()}
        for publisher in one.publishers - there:  # the status would name only one of them
            self._on_leave(publisher)
        one.publishers.clear()
        one.publishers.update(there)
        status = one.reader.get_requested_incompatible_qos_status()
        types = {other.type for other in self._readers if other.topic == one.topic}
        expected = status.last_policy_id == _TYPE and len(types) > 1  # the other reader's
        if status.total_count_change > 0 and not expected:
            _report(one.topic, "publisher offers", status.last_policy_id)


def content_of(kind: str, sample: Any) -> Any:
    """The message of a sample; None where its bytes are damaged."""
    try:
        return deserialized(kind, sample.cdr)
    except Exception:  # rosbags raises whatever the bytes lead to
        return None


def _report(topic: str, who: str, policy: int) -> None:
    name = _POLICIES.get(policy, f"policy {policy}")
    _LOG.warning(
        "%s: a %s another QoS (%s) than the robot's and is not connected; expected %s",
        topic, who, name, _EXPECTED.get(name, "the defaults of ROS"),
    )  # fmt: skip


_EXPECTED: Final = {
    "durability": "volatile, or transient local where the robot latches",
    "reliability": "reliable",
}


def _gid(entity: Any) -> dict[str, list[int]]:
    return {"data": list(entity.guid.bytes)}


def _qos(latched: bool, depth: int) -> Any:
    """The policies of a writer or a reader as ROS has them: reliable, and XCDR1 on the wire."""
    from cyclonedds.core import Policy, Qos

    return Qos(
        Policy.Reliability.Reliable(max_blocking_time=0),  # no subscriber holds the robot up
        Policy.Durability.TransientLocal if latched else Policy.Durability.Volatile,
        Policy.History.KeepLast(depth),
        Policy.DataRepresentation(use_cdrv0_representation=True, use_xcdrv2_representation=False),
    )


def _configuration(address: str) -> str:
    """Cyclone DDS's settings for an interface.

    Fast DDS's readers take nothing from a writer whose type they compare with theirs
    (cyclonedds#2333): types are not compared with those of eProsima, vendor 1.15.
    """
    alone = is_local(address)
    peers = f'<Peers><Peer address="{address}"/></Peers>' if alone else ""
    where = 'autodetermine="true"' if address == "0.0.0.0" else f'address="{address}"'
    return (
        '<CycloneDDS><Domain id="any"><General>'
        f"<Interfaces><NetworkInterface {where}/></Interfaces>"
        f"<AllowMulticast>{'false' if alone else 'default'}</AllowMulticast></General>"
        f"<Discovery><ParticipantIndex>auto</ParticipantIndex>{peers}</Discovery>"
        "<Compatibility><IgnoreTypeInformation>1.15</IgnoreTypeInformation></Compatibility>"
        "</Domain></CycloneDDS>"
    )
