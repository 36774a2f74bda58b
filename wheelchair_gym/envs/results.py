"""What a step of many chairs gives: memory that kernels write, and the arrays that show it.

Arrays that were handed out are never written again while anybody holds one of them, or a part.
"""

from __future__ import annotations

import math
import mmap
from collections import deque
from collections.abc import Callable, Iterator
from sys import getrefcount
from typing import Any, Generic, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.arrays import Floats, Mask, Rows
from wheelchair_gym.compiled.address import data_of, flags_at, rows_of
from wheelchair_gym.compiled.kernel import inlined
from wheelchair_gym.envs.info import info_of_rows
from wheelchair_gym.physics.state import SENSED
from wheelchair_gym.safety.state import DECISION, REASONS
from wheelchair_gym.task.rewards import VERDICT
from wheelchair_gym.task.task import Observation, Task

Bytes = NDArray[np.uint8]

_REASONS = np.array(REASONS)
_TRIED = 3  # results that are looked at before new ones are made
_FEWEST, _MOST, _BYTES = 4, 256, 1 << 26  # results that are remembered, and their size
_LARGE = 1 << 20  # bytes that are worth large pages
_AFTER_SENSED = SENSED.itemsize
_AFTER_VERDICTS = _AFTER_SENSED + VERDICT.itemsize
_AFTER_DECISIONS = _AFTER_VERDICTS + DECISION.itemsize
ROW_SIZE = _AFTER_DECISIONS + 4  # bytes of a row: three records, three flags, and one to align


class Columns(NamedTuple):
    """The columns of results, one after another in memory."""

    sensed: Rows  # (n,) of SENSED
    verdicts: Rows  # (n,) of VERDICT
    decisions: Rows  # (n,) of DECISION; without shields they are arbitrary
    success: Mask  # (n,) at the goal by truth, and nothing was touched
    begun: Mask  # (n,) an episode began in this step
    mask: Mask  # (n,) the row has an info


_sensed_at, _verdicts_at, _decisions_at = map(rows_of, (SENSED, VERDICT, DECISION))


@inlined
def columns_of(block: Bytes, n: int) -> Columns:
    """The columns in a block (n * ROW_SIZE,) of `Results`."""
    start = data_of(block)
    return Columns(
        _sensed_at(start, n),
        _verdicts_at(start + n * _AFTER_SENSED, n),
        _decisions_at(start + n * _AFTER_VERDICTS, n),
        flags_at(start + n * _AFTER_DECISIONS, n),
        flags_at(start + n * (_AFTER_DECISIONS + 1), n),
        flags_at(start + n * (_AFTER_DECISIONS + 2), n),
    )


def _fresh_memory(size: int) -> Any:
    """Memory of so many bytes, in large pages where that is of use and the system has them."""
    if size < _LARGE or not hasattr(mmap, "MADV_HUGEPAGE"):
        return bytearray(size)
    memory = mmap.mmap(-1, size)
    memory.madvise(mmap.MADV_HUGEPAGE)
    return memory


class Results:
    """What a step gives, n rows each, with every array of it that is ever handed out.

    Attributes:
        block: (n * ROW_SIZE,) the columns one after another.
        out: (n, numbers) observations.
        columns: in the block.
    """

    def __init__(self, task: Task, n: int) -> None:
        shape = n, task.observation_size
        memory = _fresh_memory(n * ROW_SIZE + 4 * math.prod(shape))
        self.block: Bytes = np.ndarray(n * ROW_SIZE, np.uint8, memory)
        self.out: Floats = np.ndarray(shape, np.float32, memory, n * ROW_SIZE)
        self.columns = Columns(*self._views())
        self._observation = task.unpack(self.out)
        self._info = info_of_rows(self.columns, task.shield is not None)
        self._nested = {k: each for k, each in self._info.items() if isinstance(each, dict)}

    def _views(self) -> Iterator[NDArray[Any]]:
        before, n = 0, len(self.out)
        for kind in (SENSED, VERDICT, DECISION, *3 * [np.dtype(np.bool_)]):
            yield np.ndarray(n, kind, self.block, n * before)
            before += kind.itemsize

    def arrays(self) -> Iterator[NDArray[Any]]:
        """Each array that is handed out, and what others that show its memory refer to."""
        yield from (self.block, self.out, *self.columns)
        for shown in (self._observation, self._info, *self._nested.values()):
            yield from (value for value in shown.values() if isinstance(value, np.ndarray))

    def observation(self) -> Observation:
        """The observations by key."""
        return self._observation.copy()

    def info(self) -> dict[str, Any]:
        """The infos, as arrays with their masks."""
        info = self._info.copy()
        for name, each in self._nested.items():
            info[name] = each.copy()
        if "shield" in info:
            info["shield"]["reason"] = _REASONS[self.columns.decisions["reason"]]
        return info


R = TypeVar("R", bound=Any)  # its `arrays()` are all that is handed out, see `Results.arrays`


class ResultPool(Generic[R]):
    """Results to write to that no caller holds any more.

    Args:
        make: a new one.
        size: of one [bytes].
    """

    def __init__(self, make: Callable[[], R], size: int) -> None:
        self._make = make
        # Each with its arrays and how many references there are to these; the latest at the end.
        self._lent: deque[tuple[R, list[NDArray[Any]], int]] = deque(
            maxlen=max(_FEWEST, min(_MOST, _BYTES // size))
        )

    def take(self) -> R:
        """Results that only the caller knows; what they hold is arbitrary."""
        for _ in range(_TRIED if self._lent else 0):
            self._lent.rotate(-1)
            result, arrays, references = self._lent[-1]
            if sum(map(getrefcount, arrays)) == references:
                return result
        result = self._make()
        arrays = list({id(array): array for array in result.arrays()}.values())
        self._lent.append((result, arrays, sum(map(getrefcount, arrays))))
        return result
