"""The loop over many chairs: drive, sense, assess, observe and reset, without Python."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from wheelchair_gym.arrays import Array, Floats, Mask, Rows
from wheelchair_gym.assistance.step import (
    ASSISTANTS,
    assisted_action,
    begin_assistant,
    prefetch_assistant,
    update_assistant,
)
from wheelchair_gym.compiled.address import (
    Target,
    flags_at,
    floats_at,
    keys_at,
    pointer_record,
    rows_of,
)
from wheelchair_gym.compiled.kernel import borrowing_kernel, inlined, kernel
from wheelchair_gym.drivers.state import DRIVERS, prefetch_driver
from wheelchair_gym.drivers.step import begin_driver, step_driver
from wheelchair_gym.envs.results import Bytes, Columns, columns_of
from wheelchair_gym.kinematics import twist_of_action
from wheelchair_gym.physics.state import SENSED
from wheelchair_gym.physics.step import CHAIRS, chair_row, prefetch_chair, reset_chair, step_chair
from wheelchair_gym.physics.world import enter_episode
from wheelchair_gym.random import SHIELDS as UNSHIELDED
from wheelchair_gym.random import uniform
from wheelchair_gym.safety.shield import (
    SHIELDS,
    copy_decision,
    filter_twist,
    reset_shield,
    update_shield,
)
from wheelchair_gym.task.assessment import assess, begin_task, task_row
from wheelchair_gym.task.observations import take_stick
from wheelchair_gym.task.prepared_episode import PREPARED
from wheelchair_gym.task.records import TASK
from wheelchair_gym.task.rewards import VERDICT, has_arrived

# What one thread steps rows of a batch with: chairs, their worlds and their tasks.
BATCH, BATCH_TARGETS = pointer_record(
    ("n", "i8"),  # rows of the batch
    ("task", Target(TASK, 1)),
    ("chairs", Target(CHAIRS, 1)),  # with the workspace of the thread
    ("shields", Target(SHIELDS, 1)),  # of no rows where there are none
    ("drivers", Target(DRIVERS, 1)),  # of no rows where nobody drives
    ("assistants", Target(ASSISTANTS, 1)),  # of no rows where there are none
    ("unshielded", "f8"),  # share of episodes without
    ("next_prepared", Target(PREPARED, None)),  # of each row's next episode
    ("keys", Target("u8", None)),  # of the next episodes' randomness
    ("is_over", Target("b1", None)),  # the episode has ended in an earlier step
    ("ranges", Target("f4", None)),  # of one scan, overwritten by the next
    ("beams", "i8"),
)
_task_at, _chairs_at, _shields_at, _prepared_at = map(rows_of, (TASK, CHAIRS, SHIELDS, PREPARED))
_drivers_at, _assistants_at = rows_of(DRIVERS), rows_of(ASSISTANTS)


@inlined
def _parts(batch: Any) -> Any:
    """The records (1,) of TASK, CHAIRS and SHIELDS of a batch."""
    return _task_at(batch.task, 1), _chairs_at(batch.chairs, 1), _shields_at(batch.shields, 1)


@borrowing_kernel
def is_success(rules: Any, prepared: Any, seen: Any) -> bool:
    """Whether a chair is at the goal by truth, and has touched nothing on its way."""
    return not seen.touched and has_arrived(rules, prepared, seen.true_pose, seen.true_twist, 0.0)


@kernel
def is_unshielded(key: np.uint64, share: float) -> bool:
    """Whether an episode is driven without the shield that there is."""
    return share > 0.0 and uniform(key, 0, UNSHIELDED, 0) < share


@borrowing_kernel
def update_row_assistant(i: int, assistants: Any, progress: Any, seen: Any, ranges: Floats) -> None:
    """Let row i's assistant see a reading, and the stick that it shall answer."""
    forward, left = progress.sticks[0, 0], progress.sticks[0, 1]
    update_assistant(i, assistants, forward, left, ranges, seen.twist[:], seen.stamp)


@borrowing_kernel
def begin_chair(i: int, batch: Any, rows: Columns, out: Floats) -> None:
    """Begin row i's next episode; batch: a record of BATCH."""
    task, chairs, shields = _parts(batch)
    ranges, key = floats_at(batch.ranges, batch.beams), keys_at(batch.keys, batch.n)[i]
    _prepared_at(task[0].prepared, batch.n)[i] = _prepared_at(batch.next_prepared, batch.n)[i]
    rule, prepared, progress = task_row(task, i)
    enter_episode(chair_row(chairs, i)[3], prepared)
    reset_chair(i, chairs, prepared.start, key, ranges, rows.sensed)
    drivers = _drivers_at(batch.drivers, 1)
    if drivers[0].n > 0:
        begin_driver(i, drivers, key)
    seen, shielded = rows.sensed[i], shields[0].n > 0
    is_shielded = shielded and not is_unshielded(key, batch.unshielded)
    begin_task(i, task, rows.verdicts, seen, ranges, is_shielded, out[i])
    rows.success[i] = is_success(rule, prepared, seen)
    assistants = _assistants_at(batch.assistants, 1)
    if assistants[0].n > 0:
        begin_assistant(i, assistants)
        update_row_assistant(i, assistants, progress, seen, ranges)
    if shielded:
        reset_shield(i, shields)
        copy_decision(i, shields, rows.decisions[i])
        update_shield(i, shields, seen, ranges)


@borrowing_kernel
def begin_chairs(batches: Rows, chosen: Mask, block: Bytes, out: Floats) -> None:
    """Begin the next episode of the chosen rows; see `step_chairs`."""
    batch = batches[0]
    rows = columns_of(block, batch.n)
    for i in range(batch.n):
        rows.mask[i] = chosen[i]
        if chosen[i]:
            flags_at(batch.is_over, batch.n)[i] = False
            begin_chair(i, batch, rows, out)


class Driven(NamedTuple):
    """How a chair is driven for one control period."""

    action: tuple[float, float]  # as it was asked
    twist: tuple[float, float]  # m/s, rad/s: that is driven
    stop: bool  # protectively
    less: tuple[float, float]  # m/s, rad/s: what a shield took from the twist of the action


@borrowing_kernel
def step_row(
    i: int, parts: Any, sensed: Rows, verdicts: Rows, ranges: Floats, driven: Driven, out: Floats
) -> bool:
    """Drive row i's chair, and assess its step; parts: a record of BATCH or of STEP.

    Returns:
        Whether it is at the goal by truth, and has touched nothing.
    """
    chairs, task = _chairs_at(parts.chairs, 1), _task_at(parts.task, 1)
    drivers, (v, w) = _drivers_at(parts.drivers, 1), driven.twist
    step_chair(i, chairs, v, w, driven.stop, ranges, sensed)
    seen = sensed[i]
    rule, prepared, progress = task_row(task, i)
    if drivers[0].n > 0:
        forward, left, latched = step_driver(
            i, drivers, prepared, seen.true_pose, seen.true_twist, ranges
        )
        arrived = has_arrived(rule, prepared, seen.true_pose, seen.true_twist, 0.0)
        take_stick(progress, forward, left, latched, arrived)
    assess(i, task, verdicts, driven.action, driven.less, seen, ranges, out)
    return is_success(rule, prepared, seen)


# What one chair's step is given, and what it writes, by address.
STEP, STEP_TARGETS = pointer_record(
    ("task", Target(TASK, 1)),
    ("chairs", Target(CHAIRS, 1)),
    ("drivers", Target(DRIVERS, 1)),
    ("verdict", Target(VERDICT, 1)),
    ("sensed", Target(SENSED, 1)),
    ("ranges", Target("f4", None)),
    ("beams", "i8"),
    ("out", Target("f4", None)),
    ("numbers", "i8"),  # of an observation
)
_steps_at, _sensed_at, _verdicts_at = map(rows_of, (STEP, SENSED, VERDICT))


@borrowing_kernel
def step_one(
    place: int,
    a_v: float,
    a_w: float,
    v: float,
    w: float,
    stop: bool,
    less_v: float,
    less_w: float,
) -> bool:
    """`step_row` of the record of STEP at an address: numbers reach it faster than arrays."""
    step = _steps_at(place, 1)[0]
    ranges, out = floats_at(step.ranges, step.beams), floats_at(step.out, step.numbers)
    sensed, verdicts = _sensed_at(step.sensed, 1), _verdicts_at(step.verdict, 1)
    driven = Driven((a_v, a_w), (v, w), stop, (less_v, less_w))
    return step_row(0, step, sensed, verdicts, ranges, driven, out)


@borrowing_kernel
def step_chairs(
    low: int,
    high: int,
    batches: Rows,
    same_step: bool,
    actions: Array,
    block: Bytes,
    out: Floats,
    final_block: Bytes,
    final_out: Floats,
) -> int:
    """One control period of rows low to high.

    Args:
        low: the first row.
        high: one past the last.
        batches: (1,) of BATCH.
        same_step: an episode's end begins the next one, and what its last step gave is written to
            other results.
        actions: (n, 2) of the batch; with assistants, residuals.
        block: of `Results` of the batch.
        out: their observations.
        final_block: of `Results` for last steps.
        final_out: their observations.

    Returns:
        How many rows began an episode; -1, and nothing was done, if an action is not finite.
    """
    batch = batches[0]
    n = batch.n
    for i in range(n):  # of all rows, so that none goes on alone
        if not (math.isfinite(actions[i, 0]) and math.isfinite(actions[i, 1])):
            return -1
    task, chairs, shields = _parts(batch)
    drivers, assistants = _drivers_at(batch.drivers, 1), _assistants_at(batch.assistants, 1)
    is_over, ranges = flags_at(batch.is_over, n), floats_at(batch.ranges, batch.beams)
    rows, finals = columns_of(block, n), columns_of(final_block, n)
    sensed, verdicts, begun = rows.sensed, rows.verdicts, 0
    for i in range(low, high):
        if i + 1 < high:
            prefetch_chair(i + 1, chairs)
            prefetch_driver(drivers, i + 1)
            prefetch_assistant(i + 1, assistants)
        rows.begun[i], rows.mask[i] = is_over[i], True
        if not is_over[i]:
            rule, _, progress = task_row(task, i)
            action, stop = (actions[i, 0], actions[i, 1]), False
            if assistants[0].n > 0:
                action = assisted_action(i, assistants, action[0], action[1])
            v, w = twist_of_action(action[0], action[1], rule.forward, rule.backward, rule.turn)
            asked, shielded = (v, w), progress.is_shielded
            if shielded:
                v, w, stop = filter_twist(i, shields, v, w)
            driven = Driven(action, (v, w), stop, (asked[0] - v, asked[1] - w))
            rows.success[i] = step_row(i, batch, sensed, verdicts, ranges, driven, out[i])
            if shields[0].n > 0:
                copy_decision(i, shields, rows.decisions[i])
            if shielded:
                update_shield(i, shields, sensed[i], ranges)
            if assistants[0].n > 0:
                update_row_assistant(i, assistants, progress, sensed[i], ranges)
            is_over[i] = verdicts[i].terminated or verdicts[i].truncated
            if not (is_over[i] and same_step):
                continue
            finals.sensed[i], finals.verdicts[i] = sensed[i], verdicts[i]
            finals.success[i], finals.decisions[i] = rows.success[i], rows.decisions[i]
            for k in range(out.shape[1]):
                final_out[i, k] = out[i, k]
            rows.begun[i] = finals.mask[i] = True
        is_over[i] = False
        begin_chair(i, batch, rows, out)
        begun += 1
    return begun
