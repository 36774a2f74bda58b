"""The session of the page Study: a participant's steps of an experiment, one after another."""

from __future__ import annotations

import threading
from pathlib import Path
from typing import Any, Final

import numpy as np

from agents.evaluation.assisted import StickTrace
from agents.evaluation.evaluate import episode_env, label, without_labels
from agents.evaluation.metrics import Record, Trace, measure
from agents.people.protocol import DEVICES, MIN_SCAN, Protocol, Step
from agents.people.session import LARGEST, Session
from agents.studio.catalogue import NO_HAND, NO_SIGHT, Place
from agents.studio.drive import Drive, Order
from agents.studio.messages import Fields, Message, Outbox, number, one_of, whole_numbers
from agents.studio.session import FIELDS, DriveSession
from wheelchair_gym.base.settings import InputError, dump
from wheelchair_gym.people.drivers.settings import Hand, Perception
from wheelchair_gym.types import Stick

RATE: Final = 20  # Hz, of control and of pictures
# The time limits of `wheelchair compare --driver`: people who drive by switches are slow.
PATIENCE: Final = {"task": {"time_base": 60.0, "time_factor": 10.0}}
_ITEMS = 100  # of a questionnaire, at most

STUDY_FIELDS: Final[Fields] = {
    **{kind: FIELDS[kind] for kind in ("stick", "press", "stop")},
    "device": {"name": one_of(DEVICES), "scan_period": number(MIN_SCAN, 10.0)},
    "participant": {"number": number(1, LARGEST, whole=True)},
    "consent": {}, "begin": {}, "give_up": {}, "answer": {"values": whole_numbers(_ITEMS)},
}  # fmt: skip


class MeasuredDrive(Drive):
    """A drive whose figures are those of `wheelchair compare`."""

    def _begin(self) -> None:
        super()._begin()
        task = self._world.task
        reference = self._world.episode.reference_length
        self._trace = Trace(task.period, top=task.limits.forward, reference=reference)
        self._trace.sticks = StickTrace(task.limits, task.period)
        self._trace.add(self._info)

    def _advance(self, stick: Stick) -> None:
        super()._advance(stick)
        task, trace = self._world.task, self._trace
        given = task.limits.twist(np.array(task.action)) - np.array(task.shield_intervention)
        trace.add(self._info)
        if trace.sticks is not None:
            trace.sticks.add(stick, given)

    def figures(self) -> Record:
        """The figures so far; a drive that was given up has not arrived."""
        self._trace.shortest = self.shortest()
        return measure(self._trace, self._info, self._truncated)


class StudySession(DriveSession):
    """Leads one participant through the steps of a protocol.

    Args:
        protocol: the experiment; None: there is none, and the page says so.
        folder: of its data.
        outbox: of the page.
        ready: set once a first drive is compiled.
    """

    fields = STUDY_FIELDS

    def __init__(
        self, protocol: Protocol | None, folder: Path, outbox: Outbox, ready: threading.Event
    ) -> None:
        self._protocol = protocol
        self._session: Session | None = None
        self._given_up: tuple[Any, ...] | None = None  # a drive that may be driven again
        self._device = ""
        super().__init__({}, folder, outbox, ready)
        outbox.send("study", **({"title": ""} if protocol is None else {
            "title": protocol.title, "consent": protocol.consent,
            "devices": protocol.devices, "scan_period": protocol.scan_period,
        }))  # fmt: skip

    def receive(self, message: Message) -> None:
        """See `PageSession.receive`; a stick counts if it is the device of the drive."""
        if message["type"] == "stick" and message["by"] != self._device:
            return
        super().receive(message)

    def _of(self) -> Session:
        """The participant's session.

        Raises:
            InputError: nobody has begun one.
        """
        if self._session is None:
            raise InputError("participant: expected a number first")
        return self._session

    def _step_of(self, kind: str) -> Step:
        """The step that is due.

        Raises:
            InputError: it is of another kind.
        """
        step = self._of().next()
        if step is None or step.kind != kind:
            raise InputError(f"{kind}: {'the session is over' if step is None else step.key}")
        return step

    def _send_step(self) -> None:
        """Send the step that is due to the page."""
        session, self._given_up = self._of(), None
        protocol, step = session.protocol, session.next()
        steps = list(protocol.steps(session.participant))
        if step is None:
            self._out.send("done", participant=session.participant)
            return
        of: dict[str, Any] = {"count": len(steps), "number": steps.index(step) + 1}
        if step.kind == "drive":
            of["condition_text"] = self._condition(step).text
            of["task_text"] = self._task(step).text
        elif step.kind == "answers":
            of["items"] = [
                [item.text, item.low, item.high, list(item.values)]
                for item in protocol.items(step.questionnaire)
            ]
        self._out.send("step", **step._asdict(), **of)

    def _condition(self, step: Step) -> Any:
        (found,) = (c for c in self._of().protocol.conditions if c.name == step.condition)
        return found

    def _task(self, step: Step) -> Any:
        protocol = self._of().protocol
        (found,) = (t for t in (*protocol.practice, *protocol.tasks) if t.name == step.task)
        return found

    def on_participant(self, message: Message) -> None:
        """Begin or go on with a participant's session."""
        if self._protocol is None:
            raise InputError("participant: expected a studio that was started with --study")
        self._end()
        self._session = Session(self._folder, self._protocol, message["number"])
        self._send_step()

    def on_device(self, message: Message) -> None:
        """Take another device before a drive."""
        protocol, name = self._of().protocol, message["name"]
        if self._drive is not None:
            raise InputError(f"device: expected {self._device} until this drive has ended")
        one_of(protocol.devices).check(name, "device.name")
        period = protocol.scan_period or message["scan_period"]
        self._device, self._scan_period = name, period if name == "switch" else 0.0

    def on_consent(self, message: Message) -> None:
        """Note the participant's consent."""
        self._of().consent()
        self._send_step()

    def on_answer(self, message: Message) -> None:
        """Take the answers of the questionnaire that is due."""
        step = self._step_of("answers")
        self._of().answer(step, message["values"])
        self._send_step()

    def on_begin(self, message: Message) -> None:
        """Begin the drive that is due, or begin it again."""
        step = self._step_of("drive")
        if not self._device:
            raise InputError("begin: expected a device first")
        self._end()
        task, condition = self._task(step), self._condition(step)
        env = episode_env(task.scene, {"pose_source": "modelled", "config": PATIENCE})
        place = Place("study", label(task.scene), without_labels(task.scene), env, timed=True)
        hand: Any = NO_HAND
        if condition.hand != Hand():
            hand = {"name": "expert", "hand": dump(condition.hand)}
        file = self._of().recording(step)
        sight = NO_SIGHT if condition.perception == Perception() else condition.perception
        order = Order("", place, task.seed, condition.assist, hand, RATE, file, sight)
        self._begin_when_ready(order)

    def _make(self, order: Order) -> Drive:
        return MeasuredDrive(order, self._folder, self._scan_period)

    def _after(self, drive: Drive) -> None:
        if not isinstance(drive, MeasuredDrive) or self._closing.is_set():
            return
        step, figures = self._step_of("drive"), drive.figures()
        recording = "" if drive.file is None else drive.file.name
        done = step, figures, recording, self._device, self._scan_period or None
        if drive.over:
            self._of().drive(*done)
            self._send_step()
        else:
            self._given_up = done
            self._out.send("unfinished")

    def _unbegun(self) -> None:
        self._send_step()  # so that another device can be chosen

    def on_give_up(self, message: Message) -> None:
        """Count a drive that was ended before its goal as one that did not arrive."""
        if self._given_up is None:
            raise InputError("give_up: expected a drive that was ended before its goal")
        self._of().drive(*self._given_up)
        self._send_step()
