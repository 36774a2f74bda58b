"""What recordings hold, unpacked within limits: messages of MCAP, values and arrays of JSON.

Everything here raises `ValueError` for what is damaged; `recording.replay` says of which file.
"""

from __future__ import annotations

import base64
import io
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from wheelchair_gym.errors import shown
from wheelchair_gym.files import LIMITS, is_coordinate

Array = NDArray[np.float64]


def mcap_messages(content: bytes, topics: Sequence[str]) -> list[tuple[str, bytes]]:
    """Topics and texts of messages on these topics, in the order of their time.

    Raises:
        ImportError: the extra 'record' is not installed.
        ValueError, McapError: the file is damaged, or beyond a limit.
    """
    from mcap.records import Channel, Chunk, Message
    from mcap.stream_reader import StreamReader, breakup_chunk

    names: dict[int, str] = {}
    found: list[tuple[int, str, bytes]] = []
    unpacked = 0
    for record in StreamReader(io.BytesIO(content), emit_chunks=True, validate_crcs=True).records:
        records: list[Any] = [record]
        if isinstance(record, Chunk):
            record.data = _decompressed(record.compression, record.data)
            record.compression = ""
            unpacked += len(record.data)
            if unpacked > LIMITS["unpacked"].most:
                raise ValueError(f"more than {LIMITS['unpacked'].most:,} bytes unpacked")
            records = breakup_chunk(record, validate_crc=True)
        for inner in records:
            if isinstance(inner, Channel):
                names[inner.id] = inner.topic
            elif isinstance(inner, Message) and names[inner.channel_id] in topics:
                found.append((inner.log_time, names[inner.channel_id], inner.data))
    found.sort(key=lambda message: message[0])  # stable: equal times stay in the file's order
    return [(topic, data) for _, topic, data in found]


def _decompressed(compression: str, data: bytes) -> bytes:
    """The content of a chunk, no longer than the limit whatever its header says."""
    most = LIMITS["chunk"].most
    if compression == "":
        content = data
    elif compression == "zstd":
        import zstandard

        with zstandard.ZstdDecompressor(max_window_size=most).stream_reader(data) as stream:
            content = stream.read(most + 1)
    elif compression == "lz4":
        import lz4.frame

        content = lz4.frame.LZ4FrameDecompressor().decompress(data, max_length=most + 1)
    else:
        raise ValueError(f"compression {shown(compression)} is unknown")
    if len(content) > most:
        raise ValueError(f"a chunk of more than {most:,} bytes")
    return content


def value_of(content: Mapping[str, Any], name: str, kind: type) -> Any:
    """The value of a key, of this type."""
    value = content[name]
    if type(value) is not kind:
        raise ValueError(f"{name} is {shown(value)}")
    return value


def number(content: Mapping[str, Any], name: str) -> float:
    """The value of a key, a number as large as a coordinate may be."""
    if not is_coordinate(content[name]):
        raise ValueError(f"{name} is {shown(content[name])}")
    return float(content[name])


def numbers(content: Mapping[str, Any], name: str, shape: tuple[int, ...]) -> Array:
    """The value of a key, such numbers as an array (*shape), where -1 is any length."""
    values = np.array(value_of(content, name, list), dtype=np.float64)
    if values.size == 0 and -1 in shape:
        values = np.empty([max(0, side) for side in shape])
    fits = values.ndim == len(shape) and all(
        wanted in (-1, side) for side, wanted in zip(values.shape, shape, strict=True)
    )
    if not fits or not (np.abs(values) <= LIMITS["coordinate"].most).all():
        raise ValueError(f"{name} is {shown(content[name])}")
    return values


def packed_array(
    content: Mapping[str, Any], name: str, kind: DTypeLike, size: int = -1
) -> NDArray[Any]:
    """The value of a key, an array (size,) as `recording.record.packed` wrote it; -1: any size."""
    # Of bytes that may be written to: for read-only arrays, kernels would be compiled once more.
    data = bytearray(base64.b64decode(value_of(content, name, str), validate=True))
    values = np.frombuffer(data, kind)
    if size not in (-1, len(values)):
        raise ValueError(f"{name} has {len(values)} values; expected {size}")
    return values
