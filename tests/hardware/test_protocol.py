"""Both ends speak the same language, and neither believes a damaged word."""

import ctypes
import enum
import math
import struct
import zlib

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from tests.conftest import long_but
from tests.hardware.native import NativeReceiver
from wheelchair_gym.hardware.boards import parameters, protocol
from wheelchair_gym.sensors.settings import Ultrasonic, UltrasonicSettings
from wheelchair_gym.sim.settings import ChairSettings

CODES = {
    "uint8_t": "B",
    "int16_t": "h",
    "uint16_t": "H",
    "uint32_t": "I",
    "int32_t": "i",
    "float": "f",
    "range_t": protocol.RANGERS * "HHB",
}


def random_message(layout, rng):
    """A message of a kind whose fields hold any value that fits."""
    data = rng.bytes(struct.calcsize(layout.codes))
    message = protocol.message_of(layout.kind, data)
    floats = [v for v in message if isinstance(v, float)]
    return message if all(map(math.isfinite, floats)) else random_message(layout, rng)


def test_tables_are_those_of_the_header(firmware):
    tables = firmware.tables()
    assert firmware.library.version() == protocol.VERSION
    assert firmware.library.baud() == protocol.BAUD
    for layout in protocol.LAYOUTS:
        kind, rows = tables[layout.message.__name__.upper()]
        assert kind == layout.kind
        assert tuple(row[1] for row in rows) == layout.message._fields
        assert "".join(CODES[row[0]] for row in rows) == layout.codes[1:]
        assert tuple(float(row[2].rstrip(",")) for row in rows)[: len(layout.steps)] == (
            layout.steps if layout.message is not protocol.Ranges else (1e-3, 1.0, 1e-3)
        )
    named = [value for value in vars(protocol).values() if isinstance(value, enum.EnumMeta)]
    assert {c.__name__ for c in named} | {"drive", "range"} == {
        name for name, (kind, _) in tables.items() if kind == 0
    }
    for names in named:
        rows = tables[names.__name__][1]
        assert {row[0]: int(row[1], 0) for row in rows} == {m.name: m.value for m in names}


def test_parameters_are_those_of_the_header_and_of_the_chair(firmware):
    """One chair: what the simulation drives with is what the boards hold by default."""
    tables = firmware.tables()
    for board, names, asked in (
        ("drive", parameters.DRIVE_PARAMETERS, parameters.drive_parameters(ChairSettings())),
        ("range", parameters.RANGE_PARAMETERS, parameters.range_parameters(UltrasonicSettings())),
    ):
        rows = tables[board][1]
        assert tuple(row[0] for row in rows) == names
        for name, *numbers, _unit in rows:
            initial, low, high = (float(number.rstrip("F")) for number in numbers[:3])
            assert low <= initial <= high
            if name in asked:
                assert asked.pop(name) == pytest.approx(initial, rel=1e-6)
        assert not asked
    order = (ctypes.c_uint8 * protocol.RANGERS).in_dll(firmware.library, "firing_order")
    ten = UltrasonicSettings(mounted=(Ultrasonic(),) * protocol.RANGERS)
    assert tuple(order) == ten.firing_order


@pytest.mark.parametrize("layout", protocol.LAYOUTS, ids=lambda layout: layout.message.__name__)
def test_both_ends_encode_alike_and_read_each_other(layout, firmware):
    rng = np.random.default_rng(layout.kind)
    for sequence in range(50):
        message = random_message(layout, rng)
        kind, payload = protocol.payload_of(message)
        frame = protocol.encode(message, sequence)
        assert frame == firmware.frame(kind, sequence, payload)
        assert frame.count(0) == 1
        assert len(frame) <= protocol.ENCODED_MAX + 1
        assert protocol.Receiver().feed(frame) == [(sequence, message)]
        assert NativeReceiver(firmware).feed(frame) == [body_of(sequence, message)]


def body_of(sequence, message):
    kind, payload = protocol.payload_of(message)
    return bytes((protocol.VERSION, kind, sequence)) + payload


def agree(firmware, data, cuts):
    """Both receivers give the same frames and count the same failures, wherever bytes are cut."""
    host, board = protocol.Receiver(), NativeReceiver(firmware)
    heard, read = [], []
    for start, end in zip((0, *cuts), (*cuts, len(data)), strict=True):
        heard += [body_of(*frame) for frame in host.feed(data[start:end])]
        # By way of messages, since a signalling NaN does not survive as a Python float.
        bodies = board.feed(data[start:end])
        read += [body_of(body[2], protocol.message_of(body[1], body[3:])) for body in bodies]
    assert (heard, host.bad) == (read, board.bad)
    return heard, host.bad


@given(data=st.binary(max_size=300), cuts=st.lists(st.integers(0, 300), max_size=5))
@example(data=b"\x01\x00", cuts=[])
@example(data=bytes(range(1, 80)) + b"\0", cuts=[])
@example(
    data=bytes(protocol.ENCODED_MAX + 1) + b"\x05" * protocol.ENCODED_MAX + b"\0\xff\0", cuts=[3]
)
@settings(max_examples=300, deadline=None)
def test_both_ends_agree_on_any_bytes(firmware, data, cuts):
    agree(firmware, data, sorted(min(cut, len(data)) for cut in cuts))


@given(body=st.binary(max_size=200))
@settings(max_examples=200, deadline=None)
def test_cobs_is_undone(body):
    encoded = protocol.cobs_encode(body)
    assert encoded[-1] == 0
    assert encoded.count(0) == 1
    assert protocol.cobs_decode(encoded[:-1]) == body


def damaged(rng, frames):
    """A stream of random good frames, bytes of which were lost, changed, doubled or added."""
    kinds = [int(k) for k in rng.integers(0, 256, frames)]
    stream = bytearray()
    for sequence, kind in enumerate(kinds):
        payload = rng.bytes(int(rng.integers(0, protocol.PAYLOAD_MAX + 1)))
        stream += protocol.encode(protocol.Unknown(kind, payload), sequence)
    for _ in range(int(rng.integers(0, frames))):
        at = int(rng.integers(len(stream)))
        what = rng.integers(4)
        if what == 0:
            del stream[at : at + int(rng.integers(1, 9))]
        elif what == 1:
            stream[at] ^= 1 << int(rng.integers(8))
        elif what == 2:
            stream[at:at] = rng.bytes(int(rng.integers(1, 9)))
        else:
            stream[at] = 0
        stream += b"\0"
    return bytes(stream)


@pytest.mark.parametrize("inputs", long_but([1000, 1_000_000], [1000]))
def test_both_ends_agree_on_damaged_streams(firmware, inputs):
    rng = np.random.default_rng(inputs)
    good = bad = 0
    for _ in range(inputs):
        heard, refused = agree(firmware, damaged(rng, 4), [])
        good, bad = good + len(heard), bad + refused
    assert good > inputs
    assert bad > 0.5 * inputs


def test_every_flip_of_one_or_two_bits_is_seen():
    """CRC-32 finds all of them in so short a frame; flips that make a zero split it."""
    frame = protocol.encode(protocol.Command(0.5, -0.25), 7)
    bits = 8 * (len(frame) - 1)
    for first in range(bits):
        for second in range(first, bits):
            broken = bytearray(frame)
            broken[first // 8] ^= 1 << first % 8
            if second != first:
                broken[second // 8] ^= 1 << second % 8
            receiver = protocol.Receiver()
            assert receiver.feed(bytes(broken)) == []
            assert receiver.bad >= 1


def test_a_frame_of_another_version_is_refused(firmware):
    body = bytes((protocol.VERSION + 1, 1, 0, 0, 0, 0, 0, 0))
    frame = protocol.cobs_encode(body + zlib.crc32(body).to_bytes(4, "little"))
    assert agree(firmware, frame, []) == ([], 1)


@pytest.mark.parametrize(
    ("message", "says"),
    [
        (protocol.Command(math.nan, 0.0), "Command.v is nan; expected a finite number"),
        (protocol.Command(0.0, math.inf), "Command.w is inf; expected a finite number"),
        (protocol.Set(0, 1e39), r"Set.value is 1e\+39; it must be at most 3.4e\+38"),
        (protocol.Command(5.0, 0.0), "Command.v is 5.0; it must be -3.2768 to 3.2767"),
        (
            protocol.Ranges(0.0, 0, 10 * (protocol.Range(-1.0, 0.0, 0),)),
            r"Ranges.range is -1.0; it must be 0",
        ),
    ],
)
def test_values_that_do_not_fit_are_named(message, says):
    with pytest.raises(ValueError, match=says):
        protocol.encode(message, 0)
