"""The loop over many chairs: drive, sense, assess, observe and reset, without Python."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.compiled.kernel import borrowing_kernel, kernel
from wheelchair_gym.kinematics import twist_of_action
from wheelchair_gym.physics.step import prefetch_chair, reset_chair, step_chair
from wheelchair_gym.physics.world import enter_episode
from wheelchair_gym.random import SHIELDS, uniform
from wheelchair_gym.safety.shield import filter_twist, reset_shield, update_shield
from wheelchair_gym.safety.state import copy_decision
from wheelchair_gym.task.assessment import assess, begin_task
from wheelchair_gym.task.rewards import reached

Array = NDArray[np.float64]
Floats = NDArray[np.float32]
Flags = NDArray[np.bool_]
Rows = NDArray[np.void]


class Batch(NamedTuple):
    """Chairs, their worlds and their tasks; a row each."""

    task: Rows  # (1,) of TASK
    shields: Rows  # (1,) of SHIELDS
    worlds: Rows  # (n,) of WORLD
    prepared: Rows  # (n,) of PREPARED
    next_prepared: Rows  # (n,) of PREPARED, of the next episode
    keys: NDArray[np.uint64]  # (n,) of the next episode's randomness
    progress: Rows  # (n,) of PROGRESS
    rules: Rows  # (1,) of RULES
    shield_states: Rows  # (n,) of SHIELD; (0,) without
    unshielded: Array  # (1,) share of episodes without
    is_over: Flags  # (n,) the episode has ended in an earlier step
    was_reset: Flags  # (n,) an episode began in this step


class Results(NamedTuple):
    """What a step gives; a row each."""

    sensed: Rows  # (n,) of SENSED
    verdicts: Rows  # (n,) of VERDICT
    success: Flags  # (n,) at the goal by truth, and nothing was touched
    out: Floats  # (n, numbers) observations
    decisions: Rows  # (n,) of DECISION


@borrowing_kernel
def is_success(rules: Any, prepared: Any, seen: Any) -> bool:
    """Whether a chair is at the goal by truth, and has touched nothing on its way."""
    return not seen.touched and reached(
        seen.true_pose, prepared.goal, prepared.tolerance, rules.heading, rules.heading_tolerance
    )


@kernel
def is_unshielded(key: np.uint64, share: float) -> bool:
    """Whether an episode is driven without the shield that there is."""
    return share > 0.0 and uniform(key, 0, SHIELDS, 0) < share


@borrowing_kernel
def update_row_shield(i: int, batch: Batch, seen: Any, ranges: Floats) -> None:
    """Update row i's shield with a reading."""
    update_shield(
        i,
        batch.shields,
        seen.pose[:],
        seen.twist[:],
        ranges,
        seen.ultrasonic[:],
        seen.age[:],
        seen.bumped,
        False,
        seen.stamp,
    )


@borrowing_kernel
def begin_chair(i: int, batch: Batch, chairs: Rows, results: Results, ranges: Floats) -> None:
    """Begin row i's next episode; arguments as of `step_chairs`."""
    batch.prepared[i] = batch.next_prepared[i]
    prepared = batch.prepared[i]
    enter_episode(batch.worlds[i], prepared)
    reset_chair(i, chairs, prepared.start, batch.keys[i], ranges, results.sensed)
    seen = results.sensed[i]
    shields = batch.shield_states.shape[0] > 0
    begin_task(
        i,
        batch.task,
        results.verdicts,
        seen.pose,
        seen.twist,
        ranges,
        seen.ultrasonic,
        shields and not is_unshielded(batch.keys[i], batch.unshielded[0]),
        results.out[i],
    )
    results.success[i] = is_success(batch.rules[0], prepared, seen)
    if shields:
        reset_shield(i, batch.shields)
        copy_decision(batch.shield_states[i].decision, results.decisions[i])
        update_row_shield(i, batch, seen, ranges)


@borrowing_kernel
def begin_chairs(
    low: int, high: int, chosen: Flags, batch: Batch, chairs: Rows, results: Results, ranges: Floats
) -> None:
    """Begin the next episode of the chosen ones of rows low to high; see `step_chairs`."""
    for i in range(low, high):
        if chosen[i]:
            begin_chair(i, batch, chairs, results, ranges)


@borrowing_kernel
def step_chairs(
    low: int,
    high: int,
    same_step: bool,
    actions: Array,
    batch: Batch,
    chairs: Rows,
    results: Results,
    finals: Results,
    ranges: Floats,
) -> None:
    """One control period of rows low to high."""
    rule, is_over = batch.rules[0], batch.is_over
    sensed, verdicts = results.sensed, results.verdicts
    for i in range(low, high):
        if i + 1 < high:
            prefetch_chair(i + 1, chairs)
        batch.was_reset[i] = is_over[i]
        if not is_over[i]:
            seen, action, stop = sensed[i], actions[i], False
            v, w = twist_of_action(action[0], action[1], rule.forward, rule.backward, rule.turn)
            asked_v, asked_w = v, w
            shielded = batch.progress[i].is_shielded
            if shielded:
                v, w, stop = filter_twist(i, batch.shields, v, w)
            step_chair(i, chairs, v, w, stop, ranges, sensed)
            assess(
                i,
                batch.task,
                verdicts,
                action,
                seen.pose,
                seen.twist,
                ranges,
                seen.ultrasonic,
                seen.bumped,
                asked_v - v,
                asked_w - w,
                results.out[i],
            )
            results.success[i] = is_success(rule, batch.prepared[i], seen)
            if shielded:
                copy_decision(batch.shield_states[i].decision, results.decisions[i])
                update_row_shield(i, batch, seen, ranges)
            is_over[i] = verdicts[i].terminated or verdicts[i].truncated
            if not (is_over[i] and same_step):
                continue
            finals.sensed[i], finals.verdicts[i] = sensed[i], verdicts[i]
            finals.success[i], finals.decisions[i] = results.success[i], results.decisions[i]
            for k in range(finals.out.shape[1]):
                finals.out[i, k] = results.out[i, k]
            batch.was_reset[i] = True
        is_over[i] = False
        begin_chair(i, batch, chairs, results, ranges)
