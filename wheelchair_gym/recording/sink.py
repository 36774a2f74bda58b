"""Where messages go: an MCAP file, viewers that join over a WebSocket, or both."""

from __future__ import annotations

import json
import logging
from pathlib import Path
from typing import Any

from wheelchair_gym.config import InputError
from wheelchair_gym.recording.mcap_file import McapFile

NANO = 1_000_000_000
_NAME = "wheelchair_gym"
_CHUNK = 1 << 18  # bytes: a full disk costs no more of the recording
_LOG = logging.getLogger(__name__)


class Sink:
    """Topics, an instant, and whoever listens.

    Args:
        file: MCAP to write; a number is added to its name where it exists. It is whole after
            `close`, and after a disk has run full.
        port: of this machine, where Foxglove's viewers may join (WebSocket); 0: a free one.

    Attributes:
        file: that is written, or None.
        now: the instant of what is sent [ns].
        port: where viewers may join, or None.

    Raises:
        InputError: the extra 'record' is not installed, the file cannot be written, or the port is
            taken.
    """

    def __init__(self, file: str | Path | None = None, port: int | None = None) -> None:
        try:
            import foxglove

            from wheelchair_gym.recording import messages
        except ImportError:
            raise InputError("recording needs: pip install 'wheelchair_gym[record]'") from None
        self.now = 0
        self._context = context = foxglove.Context()  # channels end with it
        self._told = False
        self._disk = None if file is None else McapFile(file)
        self._file = None if self._disk is None else _opened(self._disk, context)
        self.file = None if self._disk is None else self._disk.path
        if self.file is not None and self.file != Path(str(file)):
            _LOG.warning("%s exists; the recording is %s", file, self.file)
        self._server = None
        if port is not None:
            try:
                self._server = foxglove.start_server(name=_NAME, port=port, context=context)
            except (OSError, OverflowError, RuntimeError) as error:
                raise InputError(f"port {port}: nobody can join there ({error})") from None
        self.port: int | None = self._server.port if self._server else None
        self._channels: dict[str, Any] = {
            topic: kind(topic, context=context) for topic, kind in messages.TYPED_CHANNELS.items()
        }
        for topic, schema in messages.JSON_SCHEMAS.items():
            self._channels[topic] = foxglove.Channel(topic, schema=schema, context=context)

    def send(self, topic: str, message: Any) -> None:
        """Send a typed message, see `recording.messages.TYPED`."""
        self._channels[topic].log(message, log_time=self.now)

    def write(self, topic: str, content: dict[str, Any]) -> None:
        """Send what JSON can say, see `recording.messages.PLAIN`."""
        text = json.dumps(content, allow_nan=False)
        self._channels[topic].log(text.encode(), log_time=self.now)

    def new_error(self) -> str:
        """That the file has just ended before the run did; told once, then empty."""
        if self._told or self._disk is None or not self._disk.error:
            return ""
        self._told = True
        return f"{self.file}: {self._disk.error}; the recording ends here"

    def close(self) -> None:
        """Finish the file and let viewers go; may be called again."""
        if self._file:
            self._file.close()
        if self._disk:
            self._disk.close()
        if why := self.new_error():
            _LOG.warning("%s", why)
        if self._server:
            self._server.stop()
        self._file = self._server = None


def _opened(disk: McapFile, context: Any) -> Any:
    import foxglove
    from foxglove.mcap import MCAPWriteOptions

    own = MCAPWriteOptions(chunk_size=_CHUNK, disable_seeking=True)
    return foxglove.open_mcap(disk, context=context, writer_options=own)
