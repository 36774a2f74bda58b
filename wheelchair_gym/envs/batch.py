"""The loop over chairs, one or many: drive, sense, assess, observe and reset, without Python."""

import math
from typing import Any

import numpy as np

from wheelchair_gym.base.arrays import Floats, Mask
from wheelchair_gym.compiled.address import (
    field_at,
    flags_at,
    floats_at,
    keys_at,
    read_record,
    rows_of,
    table_at,
)
from wheelchair_gym.compiled.kernel import borrowing_kernel, inlined, kernel
from wheelchair_gym.compiled.random import SHIELDS as UNSHIELDED
from wheelchair_gym.compiled.random import uniform
from wheelchair_gym.envs.results import RESULTS, Columns, columns_of
from wheelchair_gym.geometry.kinematics import twist_of_action
from wheelchair_gym.people.assistance.step import (
    ASSISTANTS,
    assisted_action,
    begin_assistant,
    prefetch_assistant,
    update_assistant,
)
from wheelchair_gym.people.drivers.state import DRIVERS, prefetch_driver
from wheelchair_gym.people.drivers.step import begin_driver, step_driver
from wheelchair_gym.safety.shield import (
    SHIELDS,
    copy_decision,
    filter_twist,
    reset_shield,
    update_shield,
)
from wheelchair_gym.sim.step import CHAIRS, chair_row, prefetch_chair, reset_chair, step_chair
from wheelchair_gym.sim.world import enter_episode
from wheelchair_gym.task.assessment import TASK, assess, begin_task, task_row
from wheelchair_gym.task.observations import take_stick
from wheelchair_gym.task.prepared_episode import PREPARED
from wheelchair_gym.task.rewards import has_arrived

BATCH, BATCH_TARGETS = read_record("BATCH", globals())
_task_at, _chairs_at, _shields_at, _prepared_at = map(rows_of, (TASK, CHAIRS, SHIELDS, PREPARED))
_drivers_at, _assistants_at = rows_of(DRIVERS), rows_of(ASSISTANTS)
_batches_at, _results_at = rows_of(BATCH), rows_of(RESULTS)


@inlined
def _parts(batch: Any) -> Any:
    """Return the records (1,) of TASK, CHAIRS and SHIELDS of a batch."""
    return _task_at(batch.task, 1), _chairs_at(batch.chairs, 1), _shields_at(batch.shields, 1)


@borrowing_kernel
def is_success(rules: Any, prepared: Any, seen: Any) -> bool:
    """Return True if a chair is at the goal by truth, and has touched nothing on its way."""
    return not seen.touched and has_arrived(rules, prepared, seen.true_pose, seen.true_twist, 0.0)


@kernel
def is_unshielded(key: np.uint64, share: float) -> bool:
    """Return True if an episode is driven without the shield that there is."""
    return share > 0.0 and uniform(key, 0, UNSHIELDED, 0) < share


@borrowing_kernel
def update_row_assistant(i: int, assistants: Any, progress: Any, seen: Any, ranges: Floats) -> None:
    """Update row i's assistant with a reading, and with the stick that it shall answer."""
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
def begin_chairs(batch_at: int, chosen: Mask, results_at: int) -> None:
    """Begin the next episode of the chosen rows; see `step_chairs`."""
    batch, results = _batches_at(batch_at, 1)[0], _results_at(results_at, 1)[0]
    rows = columns_of(results.block, batch.n)
    out = field_at(results.out, batch.n, results.numbers)
    for i in range(batch.n):
        rows.mask[i] = chosen[i]
        if chosen[i]:
            flags_at(batch.is_over, batch.n)[i] = False
            begin_chair(i, batch, rows, out)


@borrowing_kernel
def step_chairs(
    low: int, high: int, batch_at: int, same_step: bool, results_at: int, finals_at: int
) -> int:
    """Advance the rows from low to before high of a BATCH by one control period; write RESULTS.

    With `same_step` an episode's end begins the next one, and what its last step gave is written to
    the results at `finals_at`. Return the number of rows that began an episode; -1, and nothing was
    done, if an action is not finite.
    """
    batch, results = _batches_at(batch_at, 1)[0], _results_at(results_at, 1)[0]
    final = _results_at(finals_at, 1)[0]
    n, numbers = batch.n, results.numbers
    actions = table_at(batch.actions, n, 2)
    for i in range(n):  # of all rows, so that none goes on alone
        if not (math.isfinite(actions[i, 0]) and math.isfinite(actions[i, 1])):
            return -1
    task, chairs, shields = _parts(batch)
    drivers, assistants = _drivers_at(batch.drivers, 1), _assistants_at(batch.assistants, 1)
    is_over, ranges = flags_at(batch.is_over, n), floats_at(batch.ranges, batch.beams)
    rows, finals = columns_of(results.block, n), columns_of(final.block, n)
    out, final_out = field_at(results.out, n, numbers), field_at(final.out, n, numbers)
    sensed, verdicts, begun = rows.sensed, rows.verdicts, 0
    for i in range(low, high):
        if i + 1 < high:
            prefetch_chair(i + 1, chairs)
            prefetch_driver(drivers, i + 1)
            prefetch_assistant(i + 1, assistants)
        rows.begun[i], rows.mask[i] = is_over[i], True
        if not is_over[i]:
            rule, prepared, progress = task_row(task, i)
            action, stop = (actions[i, 0], actions[i, 1]), False
            if assistants[0].n > 0:
                action = assisted_action(i, assistants, action[0], action[1])
            v, w = twist_of_action(action[0], action[1], rule.forward, rule.backward, rule.turn)
            asked, shielded = (v, w), progress.is_shielded
            if shielded:
                v, w, stop = filter_twist(i, shields, v, w)
            step_chair(i, chairs, v, w, stop, ranges, sensed)
            seen, less = sensed[i], (asked[0] - v, asked[1] - w)
            if drivers[0].n > 0:
                forward, left, latched = step_driver(
                    i, drivers, prepared, seen.true_pose, seen.true_twist, ranges
                )
                arrived = has_arrived(rule, prepared, seen.true_pose, seen.true_twist, 0.0)
                take_stick(progress, forward, left, latched, arrived)
            assess(i, task, verdicts, action, less, seen, ranges, out[i])
            rows.success[i] = is_success(rule, prepared, seen)
            if shields[0].n > 0:
                copy_decision(i, shields, rows.decisions[i])
            if shielded:
                update_shield(i, shields, seen, ranges)
            if assistants[0].n > 0:
                update_row_assistant(i, assistants, progress, seen, ranges)
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
