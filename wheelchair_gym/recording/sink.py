"""Writes messages to an MCAP file or a ROS 2 bag, to viewers over a WebSocket, or to both.

A format is a name in `Format`, a writer in `Sink`, and a choice of --format in `commands.toml`.
"""

import contextlib
import itertools
import json
import logging
import os
import struct
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

from wheelchair_gym.base.errors import imports
from wheelchair_gym.base.files import write_error
from wheelchair_gym.base.settings import InputError
from wheelchair_gym.recording.read_bags import MAGIC
from wheelchair_gym.recording.topics import FIELDS, json_schema, write_fields
from wheelchair_gym.recording.write_bags import RosBag

_HEAD = struct.Struct("<BQ")  # of a record: opcode, length
_DATA_END = 0x0F
# Ends a file without a summary: DataEnd and Footer of zeros (https://mcap.dev/spec).
_TAIL = _HEAD.pack(_DATA_END, 4) + bytes(4) + _HEAD.pack(0x02, 20) + bytes(20) + MAGIC


class McapFile:
    """A file that an MCAP writer writes sequentially.

    After each record an end is written, which the next record replaces: a program that is killed
    leaves a complete file. When the disk is full, or gone, the file is completed after its last
    record, and later records are dropped: `write` never fails.

    Args:
        path: of the file; if it exists, a number is added to its name.

    Attributes:
        path: of the file that is written.
        error: why no more is written; empty: all is.

    Raises:
        InputError: the file cannot be created.
    """

    def __init__(self, path: str | Path) -> None:
        first, self.error = Path(path), ""
        try:
            first.parent.mkdir(parents=True, exist_ok=True)
            if first.exists() and not first.is_file():
                raise IsADirectoryError(0, "it is no regular file")
            for k in itertools.count():
                self.path = first.with_stem(f"{first.stem}-{k}") if k else first
                with contextlib.suppress(FileExistsError):
                    self._file = self.path.open("xb+", buffering=0)
                    break
        except OSError as error:
            raise write_error(first, error) from None
        if self.path != first:
            _LOG.warning("%s exists; the recording is %s", first, self.path)
        self._at = self._end = 0  # where the next byte goes, and where an end can be written
        self._left, self._head = len(MAGIC), b""  # of the present record: bytes to come, header
        self._ending = False

    def write(self, data: bytes | bytearray) -> int:
        """Write all of the data."""
        self._at += len(data)
        if self.error:
            return len(data)
        try:
            self._put(data)
            if self._completes_record(bytes(data)):
                self._put(_TAIL)
                self._end = self._file.seek(self._at)
        except OSError as error:
            self.error = error.strerror or str(error)
            with contextlib.suppress(OSError):  # an end was there before, so it has room
                self._file.seek(self._end)
                self._put(_TAIL if self._end else b"")
                self._file.truncate()
        return len(data)

    def _put(self, data: bytes | bytearray) -> None:
        left = memoryview(data)
        while left:
            left = left[self._file.write(left) :]

    def _completes_record(self, data: bytes) -> bool:
        """Return True if the data ends exactly at the end of a record, before the final part."""
        while data:
            skipped = min(self._left, len(data))
            self._left, data = self._left - skipped, data[skipped:]
            if not self._left and data:
                taken = _HEAD.size - len(self._head)
                self._head, data = self._head + data[:taken], data[taken:]
                if len(self._head) == _HEAD.size:
                    opcode, self._left = _HEAD.unpack(self._head)
                    self._head, self._ending = b"", self._ending or opcode == _DATA_END
        return not (self._left or self._head or self._ending)

    def seek(self, offset: int, whence: int = 0) -> int:
        """The present position, which is the only one that can be sought.

        Raises:
            OSError: it is another one.
        """
        if (offset, whence) not in ((0, os.SEEK_CUR), (self._at, os.SEEK_SET)):
            raise OSError("a recording is written sequentially")
        return self._at

    def flush(self) -> None:
        """Do nothing: the file has no buffer."""

    def close(self) -> None:
        """Close the file."""
        self._file.close()


Format = Literal["foxglove", "ros2"]  # of a recording: one MCAP file, or the folder of a bag
_NAME = "wheelchair_gym"
_CHUNK = 1 << 18  # bytes: a full disk loses no more than this
_LOG = logging.getLogger(__name__)


class Sink:
    """Sends messages of all topics to a file and to live viewers.

    Args:
        file: MCAP to write; if it exists, a number is added to its name. It is complete after
            `close`, and after a disk has run full. In the format ros2, the folder of a bag.
        port: of this machine, for Foxglove's viewers (WebSocket); 0: a free one.
        format: of the file.

    Attributes:
        path: of the file that is written, or None.
        now: time stamp of the messages [ns], from 0.
        port: for viewers, or None.

    Raises:
        InputError: the extra 'record' or 'ros' is not installed, the file cannot be written, or the
            port is taken.
    """

    def __init__(
        self, file: str | Path | None = None, port: int | None = None, format: Format = "foxglove"
    ) -> None:
        self.now, self._reported = 0, False
        self._bag: RosBag | None = None
        self._output: McapFile | RosBag | None = None
        self._context: Any = None
        self._mcap_writer: Any = None
        self._server: Any = None
        self._typed: dict[str, Any] = {}
        self._channels: dict[str, Any] = {}
        in_bag = file is not None and format == "ros2"
        try:
            if not in_bag or port is not None:
                self._open(None if in_bag else file, port)
            if file is not None and in_bag:
                self._output = self._bag = RosBag(file)
        except BaseException:
            self.close()
            raise
        self.path = None if self._output is None else self._output.path
        self.port: int | None = self._server.port if self._server else None

    def _open(self, file: str | Path | None, port: int | None) -> None:
        """Open the channels of Foxglove's messages, a server, and a file for them."""
        with imports("recording needs", "record"):
            import foxglove
            from foxglove.mcap import MCAPWriteOptions

            from wheelchair_gym.recording import messages
        self._context = context = foxglove.Context()  # kept: channels end with it
        if port is not None:
            try:
                self._server = foxglove.start_server(name=_NAME, port=port, context=context)
            except (OSError, OverflowError, RuntimeError) as error:
                raise InputError(f"port {port}: viewers cannot connect there ({error})") from None
        if file is not None:
            self._output = output = McapFile(file)
            options = MCAPWriteOptions(chunk_size=_CHUNK, disable_seeking=True)
            self._mcap_writer = foxglove.open_mcap(output, context=context, writer_options=options)
        self._typed = {
            topic: (channel(topic, context=context), make)
            for topic, (channel, make) in messages.TYPED.items()
        }
        self._channels = {
            topic: foxglove.Channel(topic, schema=json_schema(topic), context=context)
            for topic in FIELDS
        }

    def send(self, topic: str, *content: Any) -> None:
        """Send a typed message, for viewers (topics: `recording.messages.TYPED`)."""
        if self._bag is not None:
            self._bag.send(self.now, topic, *content)
        if self._typed:
            channel, make = self._typed[topic]
            channel.log(make(self.now, *content), log_time=self.now)

    def write(self, topic: str, values: Mapping[str, Any], **more: Any) -> None:
        """Send values and more content as JSON, for replay (topics: `recording.topics.FIELDS`)."""
        content = write_fields(FIELDS[topic], values) | more
        text = json.dumps(content, allow_nan=False)
        if self._bag is not None:
            self._bag.write(self.now, topic, values, text)
        if self._channels:
            self._channels[topic].log(text.encode(), log_time=self.now)

    def check_disk(self, when_full: str = "close") -> None:
        """Report once that an error has ended the file early: raise for 'end', otherwise warn.

        With 'go-on', the warning adds that the run goes on; 'close' is for the end of a run.

        Raises:
            InputError: an error has ended the file, and `when_full` is 'end'.
        """
        if self._reported or self._output is None or not self._output.error:
            return
        self._reported = True
        why = f"{self.path}: {self._output.error}; the recording ends here"
        if when_full == "end":
            raise InputError(f"{why}, and the run, too")
        _LOG.warning("%s; the run goes on" if when_full == "go-on" else "%s", why)

    def close(self) -> None:
        """Complete the file and disconnect viewers; may be called again."""
        if self._mcap_writer:
            self._mcap_writer.close()
        if self._output:
            self._output.close()
        self.check_disk()
        if self._server:
            self._server.stop()
        self._mcap_writer = self._server = None
