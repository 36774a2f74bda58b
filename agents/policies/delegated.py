"""Policies that let another decide: an assistant, or a policy in a process of its own."""

import dataclasses
import itertools
import json
import multiprocessing
import os
import pickle
import signal
import socket
import struct
import threading
import time
import traceback
import weakref
from collections.abc import Mapping
from contextlib import suppress
from multiprocessing.connection import Connection
from typing import Any, Final

import numpy as np

from agents.people import make_assistant
from agents.people.assistant import AssistMission
from agents.policies import checked, kind_of, make_policy, settings_of
from wheelchair_gym.base.errors import shorten
from wheelchair_gym.base.settings import InputError, dump, setting, settings
from wheelchair_gym.types import Command, Mission, Reading, Shown


@settings
class Assisted:
    """Drives as an assistant makes of a person's stick; without a person the chair stands."""

    assist: Any = setting(default="slide")
    """The assistant: a name of `agents.people`, module:Class, or a mapping with a name."""

    def __post_init__(self) -> None:
        make_assistant(self.assist)  # which refuses what is wrong

    def make(self) -> "AssistedDriver":
        """A fresh policy."""
        return AssistedDriver(self)


class AssistedDriver:
    """Gives an assistant what it may know."""

    def __init__(self, config: Assisted) -> None:
        self.config = config
        self._assistant = make_assistant(config.assist)

    def reset(self, mission: Mission) -> None:
        """See `Policy.reset`."""
        self._assistant.reset(AssistMission(mission.chair, mission.sensors, mission.period))
        self._mission = mission

    def act(self, reading: Reading) -> Command:
        """See `Policy.act`."""
        stick = reading.stick
        if stick is None:
            return Command(np.zeros(2))
        known = self._mission.map if self._mission.map is not None else reading.map
        return Command(self._assistant.assist(stick, reading, known))


LONGEST: Final = 600.0  # s that a policy may take for one answer
_LOOK: Final = 0.1  # s between two looks at whether its process still runs


@settings
class Isolated:
    """Runs a policy in a process of its own: neither the environment nor the truth is there."""

    policy: Any = setting(default="straight")
    """The policy: a name, a file, module:Class, or a mapping with a name."""

    def __post_init__(self) -> None:
        settings_of(self.policy)  # which refuses what is wrong

    def make(self) -> "IsolatedDriver":
        """A fresh policy, whose process starts with its first episode.

        Raises:
            InputError: the policy is settings of another package, which its process cannot get.
        """
        spec = self.policy
        if not isinstance(spec, str | Mapping) and (name := kind_of(spec)):
            spec = {"name": name, **dump(spec)}
        try:
            return IsolatedDriver(json.dumps(spec, sort_keys=True))
        except TypeError:
            raise InputError(
                f"isolated.policy is {shorten(spec)}; expected a name, or a mapping of plain values"
            ) from None


class IsolatedDriver:
    """Sends missions and readings to a policy's process, and returns its commands.

    The process answers in numbers and texts, so that nothing of the policy runs in this one. The
    key of a mission is another number than the environment's. Policies of equal settings share a
    process, which makes a fresh one for each episode. A copy is made there, too.

    Raises:
        RuntimeError: the policy failed, its process ended, or it took longer than `LONGEST`.
    """

    def __init__(self, spec: str) -> None:
        self._spec = spec  # JSON
        self._begin()

    def _begin(self) -> None:
        """Take a place in the policy's process."""
        self._process, self._name = _process_of(self._spec), next(_NAMES)
        weakref.finalize(self, self._process.gone.append, self._name)

    def __getstate__(self) -> tuple[str, bytes]:
        return self._spec, self._ask("copy", None)

    def __setstate__(self, state: tuple[str, bytes]) -> None:
        self._spec, policy = state
        self._begin()
        self._ask("paste", policy)

    def reset(self, mission: Mission) -> None:
        """See `Policy.reset`."""
        if not self._process.worker.is_alive():
            self._begin()
        key = int(np.random.SeedSequence([mission.key, 1]).generate_state(1)[0])
        self._ask("reset", dataclasses.replace(mission, key=key))

    def act(self, reading: Reading) -> Command:
        """See `Policy.act`."""
        try:
            found = self._ask("act", reading)
            twist, action = found["twist"], found["action"]
            shown = Shown(status=str(found["status"]), plans=int(found["plans"]))
            action = None if action is None else np.array(action, np.float64)
            return Command(np.array(twist, np.float64), shown, action, bool(found["done"]))
        except (LookupError, TypeError, ValueError, OverflowError) as error:
            raise RuntimeError("the policy's process answered with no command") from error

    def _ask(self, call: str, value: Any) -> Any:
        worker, pipe, gone = self._process.worker, self._process.pipe, self._process.gone
        with self._process.lock:
            try:
                pipe.send((call, self._name, value, [gone.pop() for _ in range(len(gone))]))
                end = time.monotonic() + LONGEST
                while not pipe.poll(_LOOK):
                    # A process that the worker began may hold the pipe open: its end is not seen.
                    if not worker.is_alive() and not pipe.poll():
                        raise EOFError
                    if time.monotonic() > end:
                        raise BlockingIOError
                answer = json.loads(pipe.recv_bytes())
                policy = pipe.recv_bytes() if call == "copy" else b""
            except BaseException as error:  # an interrupt, too
                worker.kill()  # a late answer would be taken for the next one's
                worker.join()
                if not isinstance(error, EOFError | OSError):
                    raise
                late = isinstance(error, BlockingIOError)
                why = f"took longer than {LONGEST:g} s" if late else "ended"
                raise RuntimeError(f"the policy's process {why} in {call}") from error
        if answer["failure"]:
            raise RuntimeError(f"the policy failed in its process: {answer['failure']}")
        return policy if call == "copy" else answer


_NAMES: Final = itertools.count()  # of drivers


class _Process:
    """A policy's process, which ends with its pipe: when nobody uses it, or with this process."""

    def __init__(self, spec: str) -> None:
        start = multiprocessing.get_context("spawn")
        self.pipe, theirs = start.Pipe()
        self.worker = start.Process(target=_serve, args=(json.loads(spec), theirs), daemon=True)
        self.worker.start()
        theirs.close()
        self.gone: list[int] = []  # drivers whose policies it may forget
        self.lock = threading.Lock()  # of a call and its answer
        # A process may be frozen; Windows has no socket there.
        with suppress(OSError), socket.socket(fileno=os.dup(self.pipe.fileno())) as end:
            for way in (socket.SO_SNDTIMEO, socket.SO_RCVTIMEO):
                end.setsockopt(socket.SOL_SOCKET, way, struct.pack("ll", int(LONGEST), 0))


_USED: Final[weakref.WeakValueDictionary[str, _Process]] = weakref.WeakValueDictionary()
_LATEST: Final[list[_Process]] = []  # the next episode of the same policy finds it


def _process_of(spec: str) -> _Process:
    """The process of policies of these settings."""
    process = _USED.get(spec)
    if process is None or not process.worker.is_alive():
        process = _USED[spec] = _Process(spec)
    _LATEST[:] = [process]
    return process


def _serve(spec: Any, pipe: Connection) -> None:
    """Answer the calls of `IsolatedDriver` until nobody holds the other end."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the pipe ends with the program
    policies: dict[int, Any] = {}  # of drivers
    with suppress(EOFError, OSError):
        while True:
            call, driver, value, gone = pipe.recv()
            answer, policy = dict[str, Any](failure=""), b""
            for one in gone:
                policies.pop(one, None)
            try:
                if call == "reset":
                    policies[driver] = make_policy(spec)
                if call == "copy":
                    policy = pickle.dumps(policies.get(driver))
                elif call == "paste":
                    policies[driver] = pickle.loads(value)
                elif policies.get(driver) is None:
                    raise InputError("it was not reset in this process")
                elif call == "reset":
                    policies[driver].reset(value)
                else:
                    answer |= _plain(policies[driver], value)
            except Exception as error:
                refused = isinstance(error, InputError)
                answer = {"failure": str(error) if refused else traceback.format_exc()}
            pipe.send_bytes(json.dumps(answer).encode())
            if call == "copy":
                pipe.send_bytes(policy)


def _plain(policy: Any, reading: Reading) -> dict[str, Any]:
    """A policy's command in numbers and texts."""
    twist, shown, action, done = checked(policy.act(reading), policy)
    return {
        "twist": np.asarray(twist, np.float64).tolist(),
        "action": None if action is None else np.asarray(action, np.float64).tolist(),
        "status": str(shown.status), "plans": int(shown.plans), "done": bool(done),
    }  # fmt: skip
