"""Policies that let another decide: an assistant, or a policy in a process of its own."""

from __future__ import annotations

import dataclasses
import itertools
import json
import multiprocessing
import pickle
import traceback
import weakref
from collections import defaultdict
from contextlib import suppress
from functools import lru_cache
from multiprocessing.connection import Connection
from typing import Any, Final

import numpy as np

from agents.people import make_assistant
from agents.people.assistant import AssistMission
from agents.policies import make_policy, settings_of
from wheelchair_gym.base.settings import InputError, setting, settings
from wheelchair_gym.types import Command, Mission, Reading


@settings
class Assisted:
    """Drives as an assistant makes of a person's stick; without a person the chair stands."""

    assist: Any = setting(default="slide")
    """The assistant: a name of `agents.people`, module:Class, or a mapping with a name."""

    def __post_init__(self) -> None:
        make_assistant(self.assist)  # which refuses what is wrong

    def make(self) -> AssistedDriver:
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


@settings
class Isolated:
    """Runs a policy in a process of its own: neither the environment nor the truth is there."""

    policy: Any = setting(default="straight")
    """The policy: a name, a file, module:Class, or a mapping with a name."""

    def __post_init__(self) -> None:
        settings_of(self.policy)  # which refuses what is wrong

    def make(self) -> IsolatedDriver:
        """A fresh policy, whose process starts with its first episode."""
        return IsolatedDriver(self.policy)


class IsolatedDriver:
    """Sends missions and readings to a policy's process, and returns its commands.

    The key of a mission is another number than the environment's. Policies of equal settings share
    a process, which makes a fresh one for each episode. A copy is made there, too.

    Raises:
        RuntimeError: the policy failed, its process ended, or it took longer than `LONGEST`.
    """

    def __init__(self, spec: Any) -> None:
        self._spec = json.dumps(spec, sort_keys=True)
        self._begin()

    def _begin(self) -> None:
        self._name = next(_NAMES)
        weakref.finalize(self, _GONE[self._spec].append, self._name)

    def __getstate__(self) -> tuple[str, bytes]:
        return self._spec, self._ask("copy", None)

    def __setstate__(self, state: tuple[str, bytes]) -> None:
        self._spec, policy = state
        self._begin()
        self._ask("paste", policy)

    def reset(self, mission: Mission) -> None:
        """See `Policy.reset`."""
        key = int(np.random.SeedSequence([mission.key, 1]).generate_state(1)[0])
        self._ask("reset", dataclasses.replace(mission, key=key))

    def act(self, reading: Reading) -> Command:
        """See `Policy.act`."""
        command: Command = self._ask("act", reading)
        return command

    def _ask(self, call: str, value: Any) -> Any:
        process, pipe = _process_of(self._spec)
        gone = _GONE[self._spec]
        try:
            pipe.send((call, self._name, value, [gone.pop() for _ in range(len(gone))]))
            if not pipe.poll(LONGEST):
                raise TimeoutError(f"took longer than {LONGEST:g} s")
            answer, failure = pipe.recv()
        except (EOFError, OSError) as error:
            process.kill()  # a late answer would be taken for the next one's
            _process_of.cache_clear()
            why = error if isinstance(error, TimeoutError) else "ended"
            raise RuntimeError(f"the policy's process {why} in {call}") from error
        if failure:
            raise RuntimeError(f"the policy failed in its process: {failure}")
        return answer


_NAMES: Final = itertools.count()  # of drivers
_GONE: Final[dict[str, list[int]]] = defaultdict(list)  # whose policies a process may forget


@lru_cache(4)
def _process_of(spec: str) -> tuple[Any, Connection]:
    """Start a policy's process, which ends with its pipe or with this process, and the pipe."""
    start = multiprocessing.get_context("spawn")
    ours, theirs = start.Pipe()
    process = start.Process(target=_serve, args=(json.loads(spec), theirs), daemon=True)
    process.start()
    theirs.close()
    return process, ours


def _serve(spec: Any, pipe: Connection) -> None:
    """Answer the calls of `IsolatedDriver` until nobody holds the other end."""
    policies: dict[int, Any] = {}  # of drivers
    with suppress(EOFError, OSError):
        while True:
            call, driver, value, gone = pipe.recv()
            answer, failure = None, ""
            for one in gone:
                policies.pop(one, None)
            try:
                if call == "paste":
                    policies[driver] = pickle.loads(value)
                elif call == "copy":
                    answer = pickle.dumps(policies.get(driver))
                else:
                    if call == "reset":
                        policies[driver] = make_policy(spec)
                    answer = getattr(policies[driver], call)(value)
            except Exception as error:
                failure = str(error) if isinstance(error, InputError) else traceback.format_exc()
            pipe.send((answer, failure))
