"""The session of the page Drive: a thread that owns the environment and steps it in real time.

Whatever happens, the chair stops: a stick that is not confirmed for a moment counts as released,
and a page that is closed ends the drive once the chair stands.
"""

from __future__ import annotations

import dataclasses
import logging
import threading
import time
from pathlib import Path
from typing import Final

from agents.people import ASSISTANTS, is_shielded
from agents.studio import PageError
from agents.studio.catalogue import NO_HAND, NO_SIGHT, Place
from agents.studio.drive import Drive, Order, film
from agents.studio.messages import IDLE, Message, Outbox, PageSession, entry, fields_of
from wheelchair_gym.base.settings import InputError
from wheelchair_gym.people.drivers.live_person import IMPAIRMENTS, SIGHTS

_LOG = logging.getLogger(__name__)
DEAD_MAN: Final = 0.4  # s for which a deflection counts; the page confirms it every 0.05 s
_LATE: Final = 0.25  # s: a drive that is later gives up catching up with real time


class DriveSession(PageSession):
    """Serves the page Drive.

    Args:
        places: what may be driven, by key.
        folder: where recordings and films go.
        outbox: of the page.
        ready: set once a first drive is compiled.
    """

    fields = fields_of(
        "drive", assist=ASSISTANTS, hand=(NO_HAND, *IMPAIRMENTS), sight=(NO_SIGHT, *SIGHTS)
    )

    def __init__(
        self, places: dict[str, Place], folder: Path, outbox: Outbox, ready: threading.Event
    ) -> None:
        self._places, self._folder, self._ready = places, folder, ready
        # Deflections, what moves the stick, and when they came [s].
        self._stick = 0.0, 0.0, "", -1.0
        self._drive: Drive | None = None
        self._recorded: Path | None = None
        self._paused, self._scan_period = False, 0.0
        super().__init__(outbox)

    def receive(self, message: Message) -> None:
        """See `PageSession.receive`; only the latest deflection counts."""
        if message["type"] == "stick":
            self._stick = message["forward"], message["left"], message["by"], time.monotonic()
            return
        super().receive(message)

    def close(self) -> None:
        """Stop the chair, complete the recording and end the thread."""
        self._stick = (0.0, 0.0, "", -1.0)
        super().close()

    def _run(self) -> None:
        due = time.monotonic()
        try:
            while not self._closing.is_set():
                if not self._drives:
                    due = time.monotonic()
                self._handle(max(0.0, due - time.monotonic()) if self._drives else IDLE)
                now = time.monotonic()
                if self._drives and self._drive is not None and now >= due:
                    late = now - due > _LATE
                    due = (now if late else due) + 1.0 / self._drive.order.rate
                    self._step(self._drive)
        finally:
            self._end()

    @property
    def _drives(self) -> bool:
        return self._drive is not None and not self._paused

    def _step(self, drive: Drive) -> None:
        forward, left, by, at = self._stick
        if time.monotonic() - at > DEAD_MAN:
            forward, left, by = 0.0, 0.0, ""
        try:
            drive.step(forward, left, by)
        except Exception as error:  # an assistant of somebody's, a full disk: the chair stops
            _LOG.exception("studio: the drive failed")
            text = f"{type(error).__name__}: {error}"
            self._out.refuse(PageError("drive_failed", text=text))
            self._end()
            if not drive.steps:
                self._unbegun()
            return
        self._out.show(*drive.picture())
        if drive.over:
            self._end()

    def on_start(self, message: Message) -> None:
        """Begin a drive."""
        place = entry(self._places, message["place"], "start.place")
        self._end()
        order = Order(
            message["place"], place, message["seed"], message["assist"], message["hand"],
            message["rate"], sight=message["sight"],
        )  # fmt: skip
        self._begin_when_ready(order)

    def _begin_when_ready(self, order: Order) -> None:
        self._out.send("busy")
        while not self._ready.wait(IDLE):
            if self._closing.is_set():
                return
        self._begin(order)

    def _begin(self, order: Order) -> None:
        self._drive = drive = self._make(order)
        self._paused = False
        self._stick = (0.0, 0.0, "", -1.0)
        self._out.send("world", **drive.world())
        self._out.show(*drive.picture())

    def _make(self, order: Order) -> Drive:
        return Drive(order, self._folder, self._scan_period)

    def on_press(self, message: Message) -> None:
        """Press the single switch."""
        if self._drive is not None:
            self._drive.press()

    def on_device(self, message: Message) -> None:
        """Take another device."""
        self._scan_period = message["scan_period"] if message["name"] == "switch" else 0.0
        if self._drive is not None:
            self._drive.set_device(self._scan_period)

    def on_assist(self, message: Message) -> None:
        """Take another assistant."""
        name, drive = message["name"], self._drive
        if drive is None or drive.over:
            return
        if is_shielded(name) == is_shielded(drive.order.assist):
            drive.set_assistant(name)
            self._out.send("assist", name=name, anew=False)
        else:  # the shield comes or goes: a judged drive has it from start to end, or not at all
            order = drive.order
            self._end()
            self._begin(dataclasses.replace(order, assist=name))
            self._out.send("assist", name=name, anew=True)

    def on_hand(self, message: Message) -> None:
        """Take another hand."""
        if self._drive is not None:
            self._drive.set_hand(message["name"])

    def on_sight(self, message: Message) -> None:
        """Take another sight."""
        if self._drive is not None:
            self._drive.set_sight(message["name"])

    def on_pause(self, message: Message) -> None:
        """Pause or resume time."""
        self._paused = message["on"]
        self._out.send("paused", on=self._paused)

    def on_stop(self, message: Message) -> None:
        """End the drive."""
        drive = self._drive
        self._end()
        if drive is not None and not drive.steps:
            self._unbegun()

    def on_film(self, message: Message) -> None:
        """Make a film of the latest drive."""
        if self._drive is not None and not self._drive.over:
            raise InputError("film: end the drive first")
        if self._recorded is None:
            raise InputError("film: there is no recorded drive yet")
        self._out.send("filming")
        target = film(self._recorded, self._closing.is_set)
        self._out.send("film", file=target.name)

    def _end(self) -> None:
        """End the drive, if there is one: the chair stops, and its recording is complete."""
        drive, self._drive = self._drive, None
        if drive is None:
            return
        try:
            drive.close()
        except Exception as error:
            _LOG.exception("studio: the drive could not be ended")
            self._out.refuse(PageError("recording_cut", text=error))
        if drive.steps:
            self._recorded = drive.file
            self._out.send("ended", **drive.summary())
            self._after(drive)

    def _unbegun(self) -> None:
        """A drive has ended before its first step."""
        self._out.send("unbegun")

    def _after(self, drive: Drive) -> None:
        """A drive of at least one step has ended."""
