"""Reads messages of MCAP files within limits; damaged files are refused with their names."""

from __future__ import annotations

import io
import logging
import struct
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

from wheelchair_gym.errors import InputError, shorten
from wheelchair_gym.files import LIMITS, read_bytes

_LOG = logging.getLogger(__name__)
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


def mcap_messages(file: str | Path, wanted: Callable[[str, str], bool]) -> list[Recorded]:
    """Read the messages of a file whose topic and type are wanted, in the order of their times.

    A file that was cut off is read as far as it goes, with a warning.

    Args:
        file: to read.
        wanted: called with topic and type.

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
            if unpacked > LIMITS["unpacked"].most:
                raise ValueError(f"more than {LIMITS['unpacked'].most:,} bytes unpacked")
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
        raise ValueError(f"compression {shorten(compression)} is unknown")
    if len(content) > most:
        raise ValueError(f"a chunk of more than {most:,} bytes")
    return content
