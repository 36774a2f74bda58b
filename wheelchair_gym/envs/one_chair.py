"""One simulated chair's step in one compiled call, and the observation and info that it gives."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from operator import itemgetter
from struct import Struct
from typing import Any

import numpy as np
from numba import types
from numpy.typing import NDArray

from wheelchair_gym.arrays import Rows
from wheelchair_gym.compiled.address import Pointers
from wheelchair_gym.compiled.second_process import compile_beside
from wheelchair_gym.drivers.step import Drivers
from wheelchair_gym.envs.batch import STEP, STEP_TARGETS, step_one
from wheelchair_gym.envs.info import INFO_KEYS
from wheelchair_gym.envs.results import ResultPool
from wheelchair_gym.physics.chair import SimulatedChair
from wheelchair_gym.physics.state import SENSED
from wheelchair_gym.task.rewards import TERMS, VERDICT
from wheelchair_gym.task.task import Observation, Task

_CODES = {"f8": "d", "i8": "q", "b1": "?"}  # of `struct`, whose order and sizes are numpy's here
# Address, action, twist, whether to stop, and what the shield took.
_SIGNATURE = (types.int64, *4 * [types.float64], types.boolean, *2 * [types.float64])
Pair = tuple[float, float]


def _numbers(record: np.dtype[Any], path: str = "", start: int = 0) -> Iterator[tuple[Any, ...]]:
    """Name, code and offset of each number of a record, but for those of arrays."""
    for name, (kind, offset, *_) in (record.fields or {}).items():
        if kind.names:
            yield from _numbers(kind, f"{path}{name}.", start + offset)
        elif not kind.shape:
            yield path + name, _CODES[kind.str[1:]], start + offset


def _reader(record: np.dtype[Any]) -> Struct:
    """What reads these numbers from memory: a tenth of a microsecond, numpy takes a whole one."""
    form, end = "=", 0
    for _, code, offset in _numbers(record):
        form += f"{offset - end}x{code}"
        end = offset + Struct(f"={code}").size
    return Struct(form)


# A step's numbers: of VERDICT, the terms first, then of SENSED; then whether it was a success.
_read_verdict, _read_sensed = _reader(VERDICT).unpack_from, _reader(SENSED).unpack_from
_NAMES = [name for record in (VERDICT, SENSED) for name, *_ in _numbers(record)] + [""]
_ends_of = itemgetter(*map(_NAMES.index, ("reward", "terminated", "truncated")))
_INFO_NAMES = [key.name for key in INFO_KEYS if key.column in _NAMES]
_info_of = itemgetter(*(_NAMES.index(key.column) for key in INFO_KEYS if key.column in _NAMES))


def outcome_of(
    verdict: Any, sensed: Any, success: bool, arrays: dict[str, Any]
) -> tuple[float, bool, bool, dict[str, Any]]:
    """Return reward, terminated and truncated of a step, and its info without the shield's.

    Args:
        verdict: memory of a record of VERDICT.
        sensed: memory of one of SENSED.
        success: the chair is at the goal by truth, and has touched nothing.
        arrays: as of `info_arrays`.
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


def _compile_step() -> None:
    """Compile a step, without a chair; for a helper process."""
    compiled: Any = step_one
    compiled.compile(_SIGNATURE)


class _Result:
    """What a step gives, with every array of it that is ever handed out.

    Attributes:
        address: of its record of STEP.
        ranges: (beams,) m: the scan.
        sensed: (1,) of SENSED.
        memory: of `sensed`.
        observation: by key.
        info: of `info_arrays`.
    """

    def __init__(self, chair: SimulatedChair, task: Task, drivers: Drivers) -> None:
        self.sensed = np.zeros(1, SENSED)
        self.ranges = np.zeros(chair.sensors.beams, np.float32)
        self._out = np.zeros(task.observation_size, np.float32)
        self.memory = self.sensed.view(np.uint8).data
        self.observation = task.unpack(self._out)
        self.info = info_arrays(self.sensed)
        self._pointers = Pointers(np.zeros(1, STEP), STEP_TARGETS)
        self._pointers.record["beams"] = len(self.ranges)
        self._pointers.record["numbers"] = len(self._out)
        to: dict[str, Any] = {
            "task": task.rows, "chairs": chair.pointers, "drivers": drivers.pointers,
            "verdict": task.judged,
            "sensed": self.sensed, "ranges": self.ranges, "out": self._out,
        }  # fmt: skip
        for name, array in to.items():
            self._pointers.point(name, array)
        self.address = self._pointers.address

    def arrays(self) -> Iterator[NDArray[Any]]:
        """Each array that is handed out, and what others that show its memory refer to."""
        yield from (self.sensed, self.ranges, self._out, *self.observation.values())
        yield from (value for value in self.info.values() if value is not None)


class SimulatedSteps:
    """Steps of a simulated chair and its task; what was handed out is never written again."""

    def __init__(self, chair: SimulatedChair, task: Task, drivers: Drivers) -> None:
        self._chair, self._task, self._drivers = chair, task, drivers
        self._bind()
        compile_beside(step_one, _compile_step)

    def _bind(self) -> None:
        chair, task, drivers = self._chair, self._task, self._drivers
        size = SENSED.itemsize + 4 * (chair.sensors.beams + task.observation_size)
        self._pool = ResultPool(partial(_Result, chair, task, drivers), size)
        self._verdict = task.judged.view(np.uint8).data

    def __getstate__(self) -> dict[str, Any]:
        """Chair, task and drivers; all else follows from these."""
        return {"_chair": self._chair, "_task": self._task, "_drivers": self._drivers}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Restore the state of a copy."""
        self.__dict__.update(state)
        self._bind()

    def step(
        self, action: Pair, twist: Pair, stop: bool, less: Pair
    ) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Drive and assess one control period; chair and task take what comes of it.

        Args:
            action: as it was asked.
            twist: to be driven [m/s, rad/s].
            stop: protectively.
            less: what a shield took from the twist of the action.
        """
        chair = self._chair
        chair.expect_drive()
        result = self._pool.take()
        success = step_one(result.address, *action, *twist, stop, *less)
        observation = result.observation.copy()
        chair.take_step(result.ranges, result.sensed)
        self._task.take_step(chair.reading, observation, action, less)
        return observation, *outcome_of(self._verdict, result.memory, success, result.info)
