"""The session of the page Study: a participant's steps of an experiment, one after another."""

import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

from agents.evaluation.assisted import StickTrace
from agents.evaluation.evaluate import episode_env, label, without_labels
from agents.evaluation.metrics import Record, Trace, measure
from agents.people.folder import LARGEST
from agents.people.protocol import DEVICES, MIN_SCAN, Condition, Step, Task
from agents.people.session import ABORTED, CUT_OFF, GIVEN_UP, OVER, Session, State, progress_of
from agents.studio.catalogue import NO_HAND, NO_SIGHT, Place
from agents.studio.drive import Drive, Order
from agents.studio.experimenter import Desk
from agents.studio.messages import Message, Outbox, fields_of, one_of
from agents.studio.session import DriveSession
from wheelchair_gym.base.settings import InputError, dump
from wheelchair_gym.people.drivers.settings import Hand, Perception
from wheelchair_gym.safety.stops import active_stops
from wheelchair_gym.types import Stick

RATE: Final = 20  # Hz, of control and of pictures
# The time limits of `wheelchair compare --driver`: people who drive by switches are slow.
PATIENCE: Final = {"task": {"time_base": 60.0, "time_factor": 10.0}}


class MeasuredDrive(Drive):
    """A drive whose figures are those of `wheelchair compare`.

    Attributes:
        blind: whether the page is not told what shield and assistant do.
        begun: called before the first step.
    """

    blind = True
    begun: Callable[[], None]
    _ending: Trace

    def _new_ending(self) -> Trace:
        task, reference = self._world.task, self._world.episode.reference_length
        self._sticks, top = StickTrace(task.limits, task.period), task.limits.forward
        return Trace(task.period, top=top, reference=reference, sticks=self._sticks)

    def _advance(self, stick: Stick) -> None:
        if not self.steps:
            self.begun()
        super()._advance(stick)
        self._sticks.add(stick, self._given)

    def figures(self) -> Record:
        """The figures so far; a drive that was given up has not arrived."""
        self._ending.shortest = self.shortest()
        return measure(self._ending, self._info, self._truncated)

    def summary(self) -> dict[str, Any]:
        """The outcome alone."""
        return {"outcome": self.figures()["outcome"] if self.over else "stopped"}

    def world(self) -> dict[str, Any]:
        """See `Drive.world`."""
        return super().world() | ({"shielded": False, "order": {}} if self.blind else {})

    def picture(self) -> tuple[dict[str, Any], bytes]:
        """See `Drive.picture`."""
        head, ranges = super().picture()
        if self.blind:
            halted = active_stops(self._world.task.reading.halted, None)
            head |= {"given": (0.0, 0.0), "reason": "", "stands": halted}
        return head, ranges


class StudySession(DriveSession):
    """Leads one participant through the steps of a protocol.

    Args:
        desk: of the experiment; None: there is none, and the page says so.
        outbox: of the page.
        ready: set once a first drive is compiled.
    """

    fields = fields_of("study", device=DEVICES, min_scan=MIN_SCAN, largest=LARGEST)

    def __init__(self, desk: Desk | None, outbox: Outbox, ready: threading.Event) -> None:
        self._desk = desk
        self._session: Session | None = None
        self._device, self._why = "", CUT_OFF
        super().__init__({}, Path() if desk is None else desk.folder, outbox, ready)
        protocol = None if desk is None else desk.protocol
        outbox.send("study", **({"title": ""} if protocol is None else {
            "title": protocol.title, "consent": protocol.consent, "language": protocol.language,
            "devices": protocol.devices, "scan_period": protocol.scan_period,
            "blind": protocol.blind,
        }))  # fmt: skip

    def receive(self, message: Message) -> None:
        """See `PageSession.receive`; a stick counts if it is the device of the drive."""
        if message["type"] == "stick" and message["by"] != self._device:
            return
        super().receive(message)

    def _run(self) -> None:
        try:
            super()._run()
        finally:
            self._leave()

    def _leave(self) -> None:
        """End the drive, and let others open the participant's session."""
        self._end()
        if self._desk is not None and self._session is not None:
            with self._desk.lock:
                self._desk.open.pop(self._session.participant, None)
                self._session.close()
        self._session = None

    def _of(self) -> Session:
        """The participant's session; an `InputError` while nobody has begun one."""
        if self._session is None:
            raise InputError("participant: expected a number first")
        return self._session

    def _is_due(self, message: Message) -> Step | None:
        """The step that is due if a message is about it; else it is sent, since that is done."""
        progress = self._of().progress
        step = progress.next()
        if step is not None and progress.steps.index(step) + 1 == message["step"]:
            return step
        self._send_step()
        return None

    def _send_step(self, outcome: str = "") -> None:
        """Send the step that is due to the page, with the outcome of a drive before it."""
        progress = self._of().progress
        protocol, step = progress.protocol, progress.next()
        if step is None:
            over = "study_done" if progress.state == State.FINISHED else "study_ended"
            self._out.send("done", text=over, outcome=outcome)
            return
        of: dict[str, Any] = {
            "kind": step.kind, "task": step.task, "practice": step.practice, "outcome": outcome,
            "questionnaire": step.questionnaire, "number": progress.steps.index(step) + 1,
            "count": len(progress.steps),
        }  # fmt: skip
        if step.kind == "drive":
            task, condition = self._settings_of(step)
            of["text"] = [task.text] if protocol.blind else [task.text, condition.text]
        elif step.kind == "answers":
            of["items"] = [
                [item.text, item.low, item.high, list(item.values)]
                for item in protocol.items(step.questionnaire)
            ]
        self._out.send("step", **of)

    def _settings_of(self, step: Step) -> tuple[Task, Condition]:
        """The task and the condition of a drive."""
        protocol = self._of().protocol
        (task,) = (t for t in (*protocol.practice, *protocol.tasks) if t.name == step.task)
        (condition,) = (c for c in protocol.conditions if c.name == step.condition)
        return task, condition

    def on_participant(self, message: Message) -> None:
        """Begin a participant's session, or go on with it where the page has confirmed that."""
        desk = self._desk
        if desk is None:
            raise InputError("participant: expected a studio that was started with --study")
        self._leave()
        progress = progress_of(desk.folder, desk.protocol, message["number"])
        if progress.last and not message["resume"]:
            self._out.send("known", number=message["number"], **progress.row())
            return
        with desk.lock:
            self._session = Session(desk.folder, desk.protocol, message["number"])
            desk.open[message["number"]] = self
        if self._session.progress.state == State.PAUSED:
            self._session.mark("resumed")
        self._send_step()

    def remark(self, kind: str, text: str) -> None:
        """Record what the experimenter remarks about the participant; from any thread."""
        self._of().mark(kind, text=text)

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
        if self._is_due(message):
            self._of().consent()
            self._send_step()

    def on_answer(self, message: Message) -> None:
        """Take the answers of the questionnaire that is due."""
        if step := self._is_due(message):
            self._of().answer(step, message["values"])
            self._send_step()

    def on_begin(self, message: Message) -> None:
        """Begin the drive that is due."""
        session = self._of()
        if session.save():  # which the disk had no room for
            self._send_step()
            return
        step = session.due("drive")
        if not self._device:
            raise InputError("begin: expected a device first")
        self._end()
        task, condition = self._settings_of(step)
        env = episode_env(task.scene, {"pose_source": "modelled", "config": PATIENCE})
        place = Place("study", label(task.scene), without_labels(task.scene), env, timed=True)
        hand: Any = NO_HAND
        if condition.hand != Hand():
            hand = {"name": "expert", "hand": dump(condition.hand)}
        file, seed = session.recording(step), session.world(step)
        sight = NO_SIGHT if condition.perception == Perception() else condition.perception
        order = Order("", place, seed, condition.assist, hand, RATE, file, sight)
        self._why = CUT_OFF
        self._begin_when_ready(order)

    def _make(self, order: Order) -> Drive:
        session, drive = self._of(), MeasuredDrive(order, self._folder, self._scan_period)
        recording = "" if drive.file is None else drive.file.name
        period = self._scan_period or None
        drive.blind = session.protocol.blind
        drive.begun = lambda: session.start(recording, self._device, period)
        return drive

    def _end(self) -> None:
        if self._drive is not None and self._drive.over:
            self._why = ""
        super()._end()

    def _after(self, drive: Drive) -> None:
        assert isinstance(drive, MeasuredDrive)
        figures = drive.figures()
        # A chair that is let go may still roll to the goal, which is not the participant's doing.
        outcome = figures["outcome"] if figures["contact"] or not self._why else self._why
        try:
            self._of().end(outcome, figures)
        except InputError as error:
            self._out.refuse(error)
        self._send_step(outcome)

    def _unbegun(self) -> None:
        self._send_step()  # so that another device can be chosen

    def on_stop(self, message: Message) -> None:
        """End the drive as one that the participant gave up."""
        self._why = GIVEN_UP
        super().on_stop(message)

    def on_abort(self, message: Message) -> None:
        """End the drive for the experimenter."""
        self._why = ABORTED
        super().on_stop(message)

    def on_pause(self, message: Message) -> None:
        """Pause or resume the session, and with it the time of a drive."""
        state = self._of().progress.state
        if state not in OVER and message["on"] != (state == State.PAUSED):
            self._of().mark("paused" if message["on"] else "resumed")
        super().on_pause(message)
        if self._drive is None and not message["on"]:
            self._send_step()

    def on_withdraw(self, message: Message) -> None:
        """End the session for good, since the participant wants that."""
        try:
            if self._of().progress.state not in OVER:
                self._of().mark("withdrawn")  # before the end of the drive can end the session
        finally:
            self.on_stop(message)
        self._send_step()
