"""The loop over many chairs: drive, sense, judge, observe and begin anew, without Python."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.kernel import borrowing_kernel
from wheelchair_gym.kinematics import asked_twist
from wheelchair_gym.simulation.advance import advance, begin
from wheelchair_gym.task.assess import assess, start_task
from wheelchair_gym.task.judge import reached

Array = NDArray[np.float64]
Floats = NDArray[np.float32]


@borrowing_kernel
def succeeded(rules: Any, course: Any, seen: Any) -> bool:
    """Whether a chair is at the goal by truth, and has touched nothing on its way."""
    return not seen.touched and reached(
        seen.true_pose, course.goal, course.tolerance, rules.heading, rules.heading_tolerance
    )


@borrowing_kernel
def begin_chair(
    i: int,
    rigs: Any,
    rules: Any,
    base: Any,
    blank: Any,
    chairs: Any,
    states: Any,
    worlds: Any,
    courses: Any,
    coming: Any,
    keys: NDArray[np.uint64],
    progress: Any,
    scratch: Floats,
    ranges: Floats,
    sensed: Any,
    verdicts: Any,
    success: NDArray[np.bool_],
    out: Floats,
) -> None:
    """Begin row i's next episode; arguments as of `step_chairs`."""
    courses[i] = coming[i]
    course, world = courses[i], worlds[i]
    world.walls, world.n_walls = course.walls, course.n_walls
    world.discs, world.n_discs = course.discs, course.n_discs
    begin(
        i,
        rigs,
        base,
        blank,
        chairs,
        states,
        worlds,
        course.start,
        keys[i],
        scratch,
        ranges,
        sensed,
    )
    seen = sensed[i]
    start_task(
        i,
        rules,
        courses,
        progress,
        verdicts,
        seen.pose,
        seen.twist,
        ranges,
        seen.ultrasonic,
        out[i],
    )
    success[i] = succeeded(rules[0], course, seen)


@borrowing_kernel
def begin_chairs(
    low: int,
    high: int,
    chosen: NDArray[np.bool_],
    rigs: Any,
    rules: Any,
    base: Any,
    blank: Any,
    chairs: Any,
    states: Any,
    worlds: Any,
    courses: Any,
    coming: Any,
    keys: NDArray[np.uint64],
    progress: Any,
    scratch: Floats,
    ranges: Floats,
    sensed: Any,
    verdicts: Any,
    success: NDArray[np.bool_],
    out: Floats,
) -> None:
    """Begin the next episode of the chosen ones of rows low to high; see `step_chairs`."""
    for i in range(low, high):
        if chosen[i]:
            begin_chair(
                i,
                rigs,
                rules,
                base,
                blank,
                chairs,
                states,
                worlds,
                courses,
                coming,
                keys,
                progress,
                scratch,
                ranges,
                sensed,
                verdicts,
                success,
                out,
            )


@borrowing_kernel
def step_chairs(
    low: int,
    high: int,
    same_step: bool,
    over: NDArray[np.bool_],
    begun: NDArray[np.bool_],
    actions: Array,
    rigs: Any,
    rules: Any,
    base: Any,
    blank: Any,
    chairs: Any,
    states: Any,
    worlds: Any,
    courses: Any,
    coming: Any,
    keys: NDArray[np.uint64],
    progress: Any,
    scratch: Floats,
    ranges: Floats,
    sensed: Any,
    verdicts: Any,
    success: NDArray[np.bool_],
    out: Floats,
    final_sensed: Any,
    final_verdicts: Any,
    final_success: NDArray[np.bool_],
    final_out: Floats,
) -> None:
    """One control period of rows low to high.

    Args:
        low: first row; what it works on belongs to no other call.
        high: one beyond the last.
        same_step: begin the next episode in the step that ended one, and not in the step after.
        over: (n,) the episode has ended in an earlier step.
        begun: (n,) is set where an episode was begun in this step.
        actions: (n, 2) in [-1, 1].
        rigs: (1,) of RIG.
        rules: (1,) of RULES.
        base: (1,) of PARAMETER, before what is random is drawn.
        blank: (1,) of STATE, zero.
        chairs: (n,) of PARAMETER.
        states: (n,) of STATE.
        worlds: (n,) of WORLD.
        courses: (n,) of COURSE.
        coming: (n,) of COURSE, of the next episode.
        keys: (n,) of the next episode's randomness.
        progress: (n,) of PROGRESS.
        scratch: (SCRATCH, walls or more), overwritten.
        ranges: (beams,) room for a scan.
        sensed: (n,) of SENSED.
        verdicts: (n,) of VERDICT.
        success: (n,) at the goal by truth, and nothing was touched.
        out: (n, room) observations.
        final_sensed: (n,) of SENSED, where an episode ended and the next began in one step.
        final_verdicts: (n,) of VERDICT, likewise.
        final_success: (n,) likewise.
        final_out: (n, room) observations, likewise.
    """
    rule = rules[0]
    for i in range(low, high):
        begun[i] = over[i]
        if not over[i]:
            course, seen = courses[i], sensed[i]
            action = actions[i]
            v, w = asked_twist(action[0], action[1], rule.forward, rule.backward, rule.turn)
            advance(i, rigs, chairs, states, worlds, v, w, scratch, ranges, sensed)
            assess(
                i,
                rules,
                courses,
                progress,
                verdicts,
                action,
                seen.pose,
                seen.twist,
                ranges,
                seen.ultrasonic,
                seen.bumped,
                out[i],
            )
            success[i] = succeeded(rule, course, seen)
            over[i] = verdicts[i].terminated or verdicts[i].truncated
            if not (over[i] and same_step):
                continue
            final_sensed[i], final_verdicts[i] = sensed[i], verdicts[i]
            final_success[i] = success[i]
            for k in range(out.shape[1]):
                final_out[i, k] = out[i, k]
            begun[i] = True
        over[i] = False
        begin_chair(
            i,
            rigs,
            rules,
            base,
            blank,
            chairs,
            states,
            worlds,
            courses,
            coming,
            keys,
            progress,
            scratch,
            ranges,
            sensed,
            verdicts,
            success,
            out,
        )
