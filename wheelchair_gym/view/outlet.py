"""Where messages go: an MCAP file, viewers that join over a WebSocket, or both."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from wheelchair_gym.config import InputError
from wheelchair_gym.files import refused

NANO = 1_000_000_000
_NAME = "wheelchair_gym"


class Outlet:
    """Topics, an instant, and whoever listens.

    Args:
        file: MCAP to write; what was there is lost. It is whole after `close`.
        port: of this machine, where Foxglove's viewers may join (WebSocket); 0: a free one.

    Attributes:
        now: the instant of what is sent [ns].
        port: where viewers may join, or None.

    Raises:
        InputError: the extra 'record' is not installed, the file cannot be written, or the port is
            taken.
    """

    def __init__(self, file: str | Path | None = None, port: int | None = None) -> None:
        try:
            import foxglove

            from wheelchair_gym.view import messages
        except ImportError:
            raise InputError("recording needs: pip install 'wheelchair_gym[record]'") from None
        self.now = 0
        self._context = context = foxglove.Context()  # channels end with it
        self._file = None if file is None else _opened(file, context)
        self._server = None
        if port is not None:
            try:
                self._server = foxglove.start_server(name=_NAME, port=port, context=context)
            except (OSError, OverflowError, RuntimeError) as error:
                raise InputError(f"port {port}: nobody can join there ({error})") from None
        self.port: int | None = self._server.port if self._server else None
        self._channels: dict[str, Any] = {
            topic: kind(topic, context=context) for topic, kind in messages.TYPED.items()
        }
        for topic, schema in messages.PLAIN.items():
            self._channels[topic] = foxglove.Channel(topic, schema=schema, context=context)

    def send(self, topic: str, message: Any) -> None:
        """Send a typed message, see `view.messages.TYPED`."""
        self._channels[topic].log(message, log_time=self.now)

    def tell(self, topic: str, content: dict[str, Any]) -> None:
        """Send what JSON can say, see `view.messages.PLAIN`."""
        text = json.dumps(content, allow_nan=False)
        self._channels[topic].log(text.encode(), log_time=self.now)

    def close(self) -> None:
        """Finish the file and let viewers go; may be called again."""
        if self._file:
            self._file.close()
        if self._server:
            self._server.stop()
        self._file = self._server = None


def _opened(file: str | Path, context: Any) -> Any:
    import foxglove

    try:
        Path(file).parent.mkdir(parents=True, exist_ok=True)
        with Path(file).open("wb"):
            pass
        return foxglove.open_mcap(file, allow_overwrite=True, context=context)
    except OSError as error:
        raise refused(Path(file), error) from None
