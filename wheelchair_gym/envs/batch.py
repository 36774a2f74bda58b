"""The loop over many chairs: drive, sense, judge, observe and begin anew, without Python."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.compiled.kernel import borrowing_kernel, kernel
from wheelchair_gym.kinematics import asked_twist
from wheelchair_gym.physics.step import advance, begin
from wheelchair_gym.physics.world import take_ground
from wheelchair_gym.random import SHIELDS, uniform
from wheelchair_gym.safety.decision import decide
from wheelchair_gym.safety.perception import reset, update
from wheelchair_gym.safety.state import NOTHING
from wheelchair_gym.task.assessment import assess, start_task
from wheelchair_gym.task.rewards import reached

Array = NDArray[np.float64]
Floats = NDArray[np.float32]
Flags = NDArray[np.bool_]
Rows = NDArray[np.void]


class Batch(NamedTuple):
    """Chairs, where they are and what they are about; a row each."""

    rigs: Rows  # (1,) of RIG
    rules: Rows  # (1,) of RULES
    base: Rows  # (1,) of PARAMETER, before what is random is drawn
    blank: Rows  # (1,) of STATE, zero
    chairs: Rows  # (n,) of PARAMETER
    states: Rows  # (n,) of STATE
    worlds: Rows  # (n,) of WORLD
    courses: Rows  # (n,) of COURSE
    coming: Rows  # (n,) of COURSE, of the next episode
    keys: NDArray[np.uint64]  # (n,) of the next episode's randomness
    progress: Rows  # (n,) of PROGRESS
    guards: Rows  # (1,) of GUARD
    shields: Rows  # (n,) of SHIELD; (0,) without
    unshielded: Array  # (1,) share of episodes without
    over: Flags  # (n,) the episode has ended in an earlier step
    begun: Flags  # (n,) is set where an episode was begun in this step


class Results(NamedTuple):
    """What a step gives; a row each."""

    sensed: Rows  # (n,) of SENSED
    verdicts: Rows  # (n,) of VERDICT
    success: Flags  # (n,) at the goal by truth, and nothing was touched
    out: Floats  # (n, room) observations
    reason: NDArray[np.int64]  # (n,) why a shield changed a twist
    asked: Array  # (n, 2) m/s, rad/s
    given: Array  # (n, 2)
    protective: NDArray[np.bool_]  # (n,)


@borrowing_kernel
def succeeded(rules: Any, course: Any, seen: Any) -> bool:
    """Whether a chair is at the goal by truth, and has touched nothing on its way."""
    return not seen.touched and reached(
        seen.true_pose, course.goal, course.tolerance, rules.heading, rules.heading_tolerance
    )


@kernel
def goes_bare(key: np.uint64, share: float) -> bool:
    """Whether an episode is driven without the shield that there is."""
    return share > 0.0 and uniform(key, 0, SHIELDS, 0) < share


@borrowing_kernel
def take_in(i: int, batch: Batch, seen: Any, ranges: Floats) -> None:
    """Row i's shield takes in a reading."""
    update(
        batch.guards[0],
        batch.shields[i],
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
def begin_chair(i: int, batch: Batch, results: Results, scratch: Floats, ranges: Floats) -> None:
    """Begin row i's next episode; arguments as of `step_chairs`."""
    batch.courses[i] = batch.coming[i]
    course = batch.courses[i]
    take_ground(batch.worlds[i], course)
    begin(
        i,
        batch.rigs,
        batch.base,
        batch.blank,
        batch.chairs,
        batch.states,
        batch.worlds,
        course.start,
        batch.keys[i],
        scratch,
        ranges,
        results.sensed,
    )
    seen = results.sensed[i]
    shields = batch.shields.shape[0] > 0
    start_task(
        i,
        batch.rules,
        batch.courses,
        batch.progress,
        results.verdicts,
        seen.pose,
        seen.twist,
        ranges,
        seen.ultrasonic,
        shields and not goes_bare(batch.keys[i], batch.unshielded[0]),
        results.out[i],
    )
    results.success[i] = succeeded(batch.rules[0], course, seen)
    if shields:
        results.reason[i] = NOTHING
        for k in range(2):
            results.asked[i, k] = results.given[i, k] = 0.0
        results.protective[i] = False
        reset(batch.shields[i])
        take_in(i, batch, seen, ranges)


@borrowing_kernel
def begin_chairs(
    low: int,
    high: int,
    chosen: Flags,
    batch: Batch,
    results: Results,
    scratch: Floats,
    ranges: Floats,
) -> None:
    """Begin the next episode of the chosen ones of rows low to high; see `step_chairs`."""
    for i in range(low, high):
        if chosen[i]:
            begin_chair(i, batch, results, scratch, ranges)


@borrowing_kernel
def step_chairs(
    low: int,
    high: int,
    same_step: bool,
    actions: Array,
    batch: Batch,
    results: Results,
    finals: Results,
    scratch: Floats,
    ranges: Floats,
) -> None:
    """One control period of rows low to high.

    Args:
        low: first row; what it works on belongs to no other call.
        high: one beyond the last.
        same_step: begin the next episode in the step that ended one, and not in the step after.
        actions: (n, 2) in [-1, 1]; beyond is clipped.
        batch: the chairs.
        results: of the step, or of the reset where an episode was begun.
        finals: of the step where an episode ended and the next was begun at once.
        scratch: (SCRATCH, walls or more), overwritten.
        ranges: (beams,) room for a scan.
    """
    rule, over = batch.rules[0], batch.over
    rigs, chairs, states, worlds = batch.rigs, batch.chairs, batch.states, batch.worlds
    sensed, verdicts = results.sensed, results.verdicts
    for i in range(low, high):
        batch.begun[i] = over[i]
        if not over[i]:
            seen, action, stop = sensed[i], actions[i], False
            v, w = asked_twist(action[0], action[1], rule.forward, rule.backward, rule.turn)
            asked_v, asked_w = v, w
            shielded = batch.progress[i].guarded
            if shielded:
                v, w, stop = decide(batch.guards[0], batch.shields[i], v, w)
            advance(i, rigs, chairs, states, worlds, v, w, stop, scratch, ranges, sensed)
            assess(
                i,
                batch.rules,
                batch.courses,
                batch.progress,
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
            results.success[i] = succeeded(rule, batch.courses[i], seen)
            if shielded:
                shield = batch.shields[i]
                results.reason[i], results.protective[i] = shield.reason, shield.protective
                for k in range(2):
                    results.asked[i, k] = shield.asked[k]
                    results.given[i, k] = shield.given[k]
                take_in(i, batch, seen, ranges)
            over[i] = verdicts[i].terminated or verdicts[i].truncated
            if not (over[i] and same_step):
                continue
            finals.sensed[i], finals.verdicts[i] = sensed[i], verdicts[i]
            finals.success[i] = results.success[i]
            finals.reason[i], finals.protective[i] = results.reason[i], results.protective[i]
            for k in range(2):
                finals.asked[i, k] = results.asked[i, k]
                finals.given[i, k] = results.given[i, k]
            for k in range(finals.out.shape[1]):
                finals.out[i, k] = results.out[i, k]
            batch.begun[i] = True
        over[i] = False
        begin_chair(i, batch, results, scratch, ranges)
