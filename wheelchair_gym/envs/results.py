"""Results of a step: memory that kernels write, the arrays that show it, and the keys of `info`.

Arrays that were handed out are never written again while anybody holds one of them, or a part.
"""

from __future__ import annotations

import math
import mmap
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import suppress
from sys import getrefcount
from typing import TYPE_CHECKING, Any, Generic, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.base.arrays import Floats, Mask, Rows
from wheelchair_gym.compiled.address import Pointers, flags_at, read_record, rows_of
from wheelchair_gym.compiled.kernel import inlined
from wheelchair_gym.safety.state import DECISION, REASONS
from wheelchair_gym.signals import READING, TRUTH
from wheelchair_gym.sim.state import SENSED
from wheelchair_gym.task.rewards import TERMS, VERDICT
from wheelchair_gym.task.task import Observation, Task

if TYPE_CHECKING:
    from wheelchair_gym.safety.shield import Decision

RESULTS, RESULTS_TARGETS = read_record("RESULTS", globals())
_REASONS = np.array(REASONS)
_TRIED = 3  # results that are looked at before new ones are made
_FEWEST, _MAXIMUM, _BYTES = 4, 256, 1 << 26  # results that are remembered, and their size
_LARGE = 1 << 20  # bytes that are worth large pages
_KINDS = (SENSED, VERDICT, DECISION, *3 * [np.dtype(np.bool_)])  # of `Columns`
_BEGIN = (0, *np.cumsum([kind.itemsize for kind in _KINDS]).tolist())  # bytes of a row before each
ROW_SIZE = _BEGIN[-1] + 1  # bytes of a row: three records, three flags, and one to align


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
def columns_of(start: Any, n: int) -> Columns:
    """The columns in a block (n * ROW_SIZE,) of `Memory` that begins at an address."""
    start = np.int64(start)  # an unsigned one times a signed one is no integer
    return Columns(
        _sensed_at(start, n),
        _verdicts_at(start + n * _BEGIN[1], n),
        _decisions_at(start + n * _BEGIN[2], n),
        flags_at(start + n * _BEGIN[3], n),
        flags_at(start + n * _BEGIN[4], n),
        flags_at(start + n * _BEGIN[5], n),
    )


def _fresh_memory(size: int) -> Any:
    """Return memory of `size` bytes, in large pages where these are of use and available."""
    if size < _LARGE:
        return bytearray(size)
    memory = mmap.mmap(-1, size)
    with suppress(AttributeError, OSError):  # another system, or a kernel without large pages
        memory.madvise(mmap.MADV_HUGEPAGE)
    return memory


class Memory:
    """Memory that a step of n rows writes.

    Attributes:
        block: (n * ROW_SIZE,) the columns one after another.
        out: (n, numbers) observations.
        columns: in the block.
        pointers: to both, a record (1,) of RESULTS.
    """

    def __init__(self, task: Task, n: int) -> None:
        shape = n, task.observation_size
        memory = _fresh_memory(n * ROW_SIZE + 4 * math.prod(shape))
        self.block: NDArray[np.uint8] = np.ndarray(n * ROW_SIZE, np.uint8, memory)
        self.out: Floats = np.ndarray(shape, np.float32, memory, n * ROW_SIZE)
        places = zip(_KINDS, _BEGIN, strict=False)
        views = (np.ndarray(n, kind, self.block, n * begin) for kind, begin in places)
        self.columns = Columns(*views)
        self.pointers = Pointers(np.zeros(1, RESULTS), RESULTS_TARGETS)
        self.pointers.fill(numbers=task.observation_size, block=self.block, out=self.out)
        self.address = self.pointers.address


class Results(Memory):
    """Results of a step of many chairs, with every array of it that is ever handed out."""

    def __init__(self, task: Task, n: int) -> None:
        super().__init__(task, n)
        self._observation = task.unpack(self.out)
        self._info = info_of_rows(self.columns, task.shield is not None)
        self._nested = {k: each for k, each in self._info.items() if isinstance(each, dict)}

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
    """Results to write to, of a size [bytes] each, that no caller holds any more."""

    def __init__(self, make: Callable[[], R], size: int) -> None:
        self._make = make
        # Each with its arrays and how many references there are to these; the latest at the end.
        self._lent: deque[tuple[R, list[NDArray[Any]], int]] = deque(
            maxlen=max(_FEWEST, min(_MAXIMUM, _BYTES // size))
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


class InfoKey(NamedTuple):
    """One key of `info`."""

    name: str
    column: str  # a field of SENSED or VERDICT; empty: success
    meaning: str


INFO_KEYS = (
    *(
        InfoKey(s.info, s.column, f"{s.meaning} [{s.unit}]" if s.unit else s.meaning)
        for s in (*TRUTH, *READING)
        if s.info
    ),
    InfoKey("is_success", "", "at the goal by truth, and nothing was touched"),
    InfoKey("arrived", "arrived", "at the goal by the chair's own estimate"),
    InfoKey("valid_beams", "valid_beams", "finite ranges of the scan"),
    InfoKey("geodesic", "geodesic", "shortest way from start to goal [m]"),
)
# Keys that tell which episode is driven.
EPISODE_KEYS = {
    "seed": "of the sequence of episodes: `reset(seed=...)` begins it again",
    "episode_number": "among those of its seed, from 0",
    "split": "stream of worlds that it is drawn from: train or test",
    "level": "number of its world in the bank; -1 without a bank, or if the world was given",
}


def info_of_shield(decision: Decision) -> dict[str, Any]:
    """Return what `info` tells of a shield's decision, with arrays of its own."""
    return decision._asdict() | {"asked": decision.asked.copy(), "given": decision.given.copy()}


def info_of_rows(columns: Columns, shielded: bool) -> dict[str, Any]:
    """The info of many environments, as arrays with their masks; of a reason, its number."""
    sensed, verdicts, decisions, success, _, mask = columns
    every = {name: rows[name] for rows in (sensed, verdicts) for name in rows.dtype.names or ()}
    every[""] = success
    values: dict[str, Any] = {key.name: every[key.column] for key in INFO_KEYS}
    terms = verdicts["terms"]
    values["reward_terms"] = _masked({name: terms[name] for name in TERMS}, mask)
    if shielded:
        names = decisions.dtype.names or ()
        values["shield"] = _masked({name: decisions[name] for name in names}, mask)
    return _masked(values, mask)


def _masked(values: dict[str, Any], mask: Mask) -> dict[str, Any]:
    return values | {f"_{name}": mask for name in values}


def info_table() -> str:
    """All keys as a table in Markdown."""
    meanings = {key.name: key.meaning for key in INFO_KEYS} | EPISODE_KEYS
    rows = (f"| {name} | {meaning} |" for name, meaning in meanings.items())
    return "\n    ".join(["| key | meaning |", "| --- | --- |", *rows])
