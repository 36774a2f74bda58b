"""The loop over one simulated chair: that over many, of one row, and the info that it gives."""

from collections.abc import Callable, Iterator
from functools import partial
from operator import itemgetter
from struct import Struct
from typing import Any, NamedTuple

import numpy as np
from numba import types
from numpy.typing import NDArray

from wheelchair_gym.base.arrays import Rows
from wheelchair_gym.compiled.address import Pointers
from wheelchair_gym.compiled.second_process import compile_beside
from wheelchair_gym.envs.batch import BATCH, BATCH_TARGETS, begin_chairs, is_unshielded, step_chairs
from wheelchair_gym.envs.results import INFO_KEYS, ROW_SIZE, Memory, ResultPool, info_of_shield
from wheelchair_gym.people.assistance.step import Assistants
from wheelchair_gym.people.drivers.step import Drivers
from wheelchair_gym.perception.localized_chair import unwrapped
from wheelchair_gym.safety.shield import SHIELDS, Decision, Shield
from wheelchair_gym.safety.state import REASONS
from wheelchair_gym.sim.chair import SimulatedChair
from wheelchair_gym.sim.state import SENSED, sensed_of
from wheelchair_gym.task.prepared_episode import PREPARED, PreparedEpisode
from wheelchair_gym.task.rewards import TERMS, VERDICT
from wheelchair_gym.task.task import Observation, Task
from wheelchair_gym.types import Reading, Stick, check_reading

_CODES = {"f8": "d", "i8": "q", "b1": "?"}  # of `struct`, whose order and sizes are numpy's here
_SIGNATURE = (*3 * [types.int64], types.boolean, *2 * [types.int64])  # of `step_chairs`
_ALL = np.ones(1, np.bool_)  # rows
Pair = tuple[float, float]
Info = dict[str, Any]
Outcome = tuple[Observation, float, bool, bool, Info]


def _numbers(record: np.dtype[Any], path: str = "", start: int = 0) -> Iterator[tuple[Any, ...]]:
    """Yield name, code and offset of each number of a record, except those of arrays."""
    for name, (kind, offset, *_) in (record.fields or {}).items():
        if kind.names:
            yield from _numbers(kind, f"{path}{name}.", start + offset)
        elif not kind.shape:
            yield path + name, _CODES[kind.str[1:]], start + offset


def _reader(record: np.dtype[Any]) -> Struct:
    """Return a reader of these numbers from memory: it takes 0.1 us, numpy 1 us."""
    form, end = "=", 0
    for _, code, offset in _numbers(record):
        form += f"{offset - end}x{code}"
        end = offset + Struct(f"={code}").size
    return Struct(form)


# A step's numbers: of VERDICT, the terms first, then of SENSED; then whether it was a success.
_read_verdict, _read_sensed = _reader(VERDICT).unpack_from, _reader(SENSED).unpack_from
_read_decision = Struct("=q4d?").unpack_from  # reason, asked, given, protective
_NAMES = [name for record in (VERDICT, SENSED) for name, *_ in _numbers(record)] + [""]
_ends_of = itemgetter(*map(_NAMES.index, ("reward", "terminated", "truncated")))
_INFO_NAMES = [key.name for key in INFO_KEYS if key.column in _NAMES]
_info_of = itemgetter(*(_NAMES.index(key.column) for key in INFO_KEYS if key.column in _NAMES))


def outcome_of(
    verdict: Any, sensed: Any, success: bool, arrays: dict[str, Any]
) -> tuple[float, bool, bool, dict[str, Any]]:
    """Return reward, terminated and truncated of a step, and its info without the shield's.

    They are read from memory of a record of VERDICT and of one of SENSED, and `info_arrays`.
    """
    numbers, info = (*_read_verdict(verdict), *_read_sensed(sensed), success), arrays.copy()
    # Without the keyword `strict`, which takes two tenths of a microsecond.
    info.update(zip(_INFO_NAMES, _info_of(numbers)))  # noqa: B905
    info["reward_terms"] = dict(zip(TERMS, numbers))  # noqa: B905
    return *_ends_of(numbers), info


def info_arrays(sensed: Rows) -> dict[str, Any]:
    """Return all keys of the info; values are the arrays of a record (1,) of SENSED, or None."""
    columns = {key.name: key.column for key in INFO_KEYS}
    return {name: None if of in _NAMES else sensed[of][0] for name, of in columns.items()}


def _compile_steps() -> None:
    """Compile a step, without a chair; for a helper process."""
    compiled: Any = step_chairs
    compiled.compile(_SIGNATURE)


def _bytes(rows: Rows) -> memoryview:
    return rows.view(np.uint8).data


class _Result(Memory):
    """Memory of a step of one chair, with all arrays that are handed out.

    Attributes:
        batch: address of the record of BATCH that writes it.
        ranges: (beams,) m: the scan.
        observation: by key.
        info: of `info_arrays`.
        sensed: memory of the record of SENSED.
        verdict: of that of VERDICT.
        decision: of that of DECISION.
    """

    def __init__(self, task: Task, batch: Pointers) -> None:
        super().__init__(task, 1)
        self.ranges = np.zeros(task.sensors.beams, np.float32)
        self._pointers = batch.again()
        self._pointers.point("ranges", self.ranges)
        self.batch = self._pointers.address
        self.observation, self.info = task.unpack(self.out[0]), info_arrays(self.columns.sensed)
        self.sensed, self.verdict = _bytes(self.columns.sensed), _bytes(self.columns.verdicts)
        self.decision = _bytes(self.columns.decisions)

    def arrays(self) -> Iterator[NDArray[Any]]:
        """Each array that is handed out, and what others that show its memory refer to."""
        yield from (self.block, self.out, self.ranges, *self.columns)
        yield from self.observation.values()
        yield from (value for value in self.info.values() if value is not None)


class Parts(NamedTuple):
    """The parts that a loop steps."""

    chair: Any  # `Chair`
    task: Task
    drivers: Drivers
    assistants: Assistants
    shield: Shield | None
    unshielded: float  # share of episodes without the shield


class SimulatedLoop:
    """The loop over a simulated chair; what was handed out is never written again."""

    def __init__(self, parts: Parts) -> None:
        self.parts = parts
        self._bind()
        compile_beside(step_chairs, _compile_steps)

    def _bind(self) -> None:
        chair, task, drivers, assistants, shield, unshielded = self.parts
        self._actions, self._keys = np.zeros((1, 2)), np.zeros(1, np.uint64)
        self._next = np.zeros(1, PREPARED)
        batch = Pointers(np.zeros(1, BATCH), BATCH_TARGETS).fill(
            n=1, unshielded=unshielded, beams=chair.sensors.beams, task=task.rows,
            chairs=chair.pointers, drivers=drivers.pointers, assistants=assistants.pointers,
            shields=np.zeros(1, SHIELDS) if shield is None else shield.pointers,
            actions=self._actions, keys=self._keys, next_prepared=self._next,
            is_over=np.zeros(1, np.bool_),
        )  # fmt: skip
        size = ROW_SIZE + 4 * (chair.sensors.beams + task.observation_size)
        self._pool = ResultPool(partial(_Result, task, batch), size)

    def __getstate__(self) -> dict[str, Any]:
        """The parts; all else follows from these."""
        return {"parts": self.parts}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Restore the state of a copy."""
        self.__dict__.update(state)
        self._bind()

    def begin(self, prepared: PreparedEpisode, key: int) -> tuple[Observation, Info]:
        """Begin an episode, and return its first observation and info."""
        chair, task = self.parts.chair, self.parts.task
        chair.enter(prepared.episode)
        task.enter(prepared, key)
        self._next[0], self._keys[0] = prepared.record[0], key
        result = self._pool.take()
        begin_chairs(result.batch, _ALL, result.address)
        task.take_limits()
        observation, *_, info = self._take(result, (0.0, 0.0))
        return observation, info

    def step(self, action: Pair) -> Outcome:
        """Drive an action in [-1, 1] for one control period; an assistant's is added to it."""
        self._actions[0] = action
        if len(self.parts.assistants.states):
            action = self.parts.assistants.action(action)
        self.parts.chair.expect_drive()
        result = self._pool.take()
        step_chairs(0, 1, result.batch, False, result.address, result.address)
        return self._take(result, action)

    def _take(self, result: _Result, action: Pair) -> Outcome:
        """Store the result of an action in chair, task and shield, and return it."""
        chair, task, shield = self.parts.chair, self.parts.task, self.parts.shield
        columns, observation, less = result.columns, result.observation.copy(), (0.0, 0.0)
        outcome = outcome_of(result.verdict, result.sensed, bool(columns.success[0]), result.info)
        if shield is not None:
            reason, asked_v, asked_w, given_v, given_w, stops = _read_decision(result.decision)
            asked, given = np.array((asked_v, asked_w)), np.array((given_v, given_w))
            shield.decision = Decision(REASONS[reason], asked, given, stops)
            outcome[-1]["shield"] = info_of_shield(shield.decision)
            if task.is_shielded:
                v, w = task.limits.twist_of(*action)
                less = v - given_v, w - given_w
        chair.take_step(result.ranges, columns.sensed)
        task.judged = columns.verdicts
        task.take_step(chair.reading, observation, action, less)
        return observation, *outcome


class LoopInParts:
    """The same loop with any chair, or a real person: shield, chair and task one by one."""

    def __init__(self, parts: Parts, person: Callable[[], Stick] | None) -> None:
        self.parts, self._person = parts, person
        self._prepared: PreparedEpisode | None = None
        chair: Any = unwrapped(parts.chair)
        self._simulated = isinstance(chair, SimulatedChair)
        if self._simulated:
            chair.compile_beside()
        if parts.shield is not None:
            parts.shield.compile()

    def begin(self, prepared: PreparedEpisode, key: int) -> tuple[Observation, Info]:
        """See `SimulatedLoop.begin`."""
        parts, task = self.parts, self.parts.task
        self._prepared = prepared
        reading = parts.chair.reset(prepared.episode, key)
        parts.drivers.begin(key)
        self._check(reading)
        unshielded = is_unshielded(np.uint64(key), parts.unshielded)
        is_shielded = parts.shield is not None and not unshielded
        observation = task.begin(prepared, reading, key, is_shielded)
        parts.assistants.begin()
        self._assist()
        *_, info = self._outcome()
        return observation, info

    def step(self, action: Pair) -> Outcome:
        """See `SimulatedLoop.step`."""
        parts, task = self.parts, self.parts.task
        if len(parts.assistants.states):
            action = parts.assistants.action(action)
        asked_v, asked_w = task.limits.twist_of(*action)
        twist, stop = np.array((asked_v, asked_w)), False
        if parts.shield is not None and task.is_shielded:
            twist = parts.shield.filter(twist, task.reading)
            stop = parts.shield.decision.protective
        v, w = twist.tolist()
        reading = parts.chair.drive(twist, stop)
        self._check(reading)
        if task.has_driver:
            truth = parts.chair.truth
            assert self._prepared is not None
            if self._person is not None:
                stick = self._person()
            else:
                stick = parts.drivers.step(self._prepared, truth.pose, truth.twist, reading.laser)
            task.take_stick(stick, truth.pose, truth.twist)
        observation = task.assess(reading, action, (asked_v - v, asked_w - w))
        self._assist()
        return observation, *self._outcome()

    def _check(self, reading: Reading) -> None:
        if not self._simulated:
            check_reading(reading, self.parts.task.sensors)

    def _assist(self) -> None:
        """Show an assistant the latest reading, and the stick to which it responds."""
        task, assistants = self.parts.task, self.parts.assistants
        stick = task.stick
        if len(assistants.states) and stick is not None:
            assistants.update(stick, task.reading)

    def _outcome(self) -> tuple[float, bool, bool, Info]:
        """Return `outcome_of` the latest reading, with the shield's decision."""
        truth, task = self.parts.chair.truth, self.parts.task
        success = not truth.touched and task.at_goal(truth.pose, truth.twist)
        sensed = sensed_of(task.reading, truth)
        outcome = outcome_of(task.judged, sensed, success, info_arrays(sensed))
        if self.parts.shield is not None:
            outcome[-1]["shield"] = info_of_shield(self.parts.shield.decision)
        return outcome
