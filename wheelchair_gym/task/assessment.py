"""Assessment: observation of a reading, reward of the step to it, and the records of both."""

import math
from typing import Any

from wheelchair_gym.base.arrays import Floats
from wheelchair_gym.compiled.address import read_record, rows_of
from wheelchair_gym.compiled.kernel import borrowing_kernel, inlined
from wheelchair_gym.perception.tracker import TRACKERS, reset_tracker, update_tracker
from wheelchair_gym.task.observations import (  # noqa: F401
    POOL,
    SIZES,
    STICKS,
    TRAIL_POINTS,
    extend_trail,
    observe,
    reset_trail,
)
from wheelchair_gym.task.prepared_episode import PREPARED, geodesic_to_go, remaining_to_goal
from wheelchair_gym.task.rewards import TERM_VALUES, has_arrived, write_no_terms, write_terms  # noqa: F401

RULES, RULES_TARGETS = read_record("RULES", globals())
PROGRESS = read_record("PROGRESS", globals())[0]
TASK, TASK_TARGETS = read_record("TASK", globals())

_rules_at, _prepared_at, _progress_at = map(rows_of, (RULES, PREPARED, PROGRESS))
_trackers_at = rows_of(TRACKERS)
Pair = tuple[float, float]


@inlined
def task_row(task: Any, i: int) -> Any:
    """The records of row i: rules, prepared episode and progress."""
    rows = task[0]
    return (
        _rules_at(rows.rules, 1)[0],
        _prepared_at(rows.prepared, rows.n)[i],
        _progress_at(rows.progress, rows.n)[i],
    )


@borrowing_kernel
def _observe(i: int, task: Any, seen: Any, laser: Floats, out: Floats) -> int:
    """Write what row i's policy observes of a reading; return the number of finite beams."""
    rule, prepared, progress = task_row(task, i)
    trackers = _trackers_at(task[0].trackers, 1)
    if rule.size.tracks > 0:
        scan = laser[: rule.laser_beams]
        update_tracker(i, trackers, seen.pose[:], seen.twist[:], scan, seen.stamp)
    return observe(rule, prepared, progress, i, trackers, seen, laser, out)


@borrowing_kernel
def begin_task(
    i: int, task: Any, verdicts: Any, seen: Any, laser: Floats, is_shielded: bool, out: Floats
) -> None:
    """Begin row i's episode with its first reading; the other arguments are those of `assess`."""
    rule, prepared, progress = task_row(task, i)
    verdict, pose = verdicts[i], seen.pose[:]
    way = geodesic_to_go(prepared, pose[0], pose[1])
    limit = rule.time_base + rule.time_factor * way / rule.forward
    if not math.isnan(prepared.time_limit):
        limit = prepared.time_limit
    progress.time_limit = limit
    progress.geodesic = geodesic_to_go(prepared, prepared.start[0], prepared.start[1])
    progress.steps_left, progress.steps = max(1, round(limit / rule.period)), 0
    progress.to_go = remaining_to_goal(prepared, rule.aim, pose[0], pose[1], pose[2])
    progress.is_shielded = is_shielded
    reset_trail(progress, pose)
    for k in range(2):
        progress.action[k] = progress.shield_share[k] = 0.0
    progress.sticks[:, :] = 0.0
    progress.latched = progress.person_arrived = False
    if rule.size.tracks > 0:
        reset_tracker(i, _trackers_at(task[0].trackers, 1))
    write_no_terms(verdict)
    verdict.terminated, verdict.truncated = False, False
    verdict.arrived = has_arrived(rule, prepared, pose, seen.twist[:], rule.arrival_margin)
    verdict.geodesic = progress.geodesic
    verdict.valid_beams = _observe(i, task, seen, laser, out)


@borrowing_kernel
def assess(
    i: int, task: Any, verdicts: Any, action: Pair, less: Pair, seen: Any, laser: Floats,
    out: Floats,
) -> None:  # fmt: skip
    """Assess the step of row i's action in [-1, 1]: write its verdict and the observation, `out`.

    `less` is what a shield took from the action's twist [m/s, rad/s]; `seen` is the reading, a
    record of SENSED, and `laser` its scans [m].
    """
    rule, prepared, progress = task_row(task, i)
    verdict, pose, twist = verdicts[i], seen.pose[:], seen.twist[:]
    progress.steps_left -= 1
    progress.steps += 1
    for k in range(2):
        progress.previous[k] = progress.action[k]
        progress.action[k] = min(1.0, max(-1.0, action[k]))
    if rule.size.trail > 0:
        extend_trail(progress, pose)
    progress.shield_share[0] = less[0] / rule.forward
    progress.shield_share[1] = less[1] / rule.turn
    rest = remaining_to_goal(prepared, rule.aim, pose[0], pose[1], pose[2])
    covered = 0.0
    if not math.isnan(rest):  # else what was covered counts when a way is known again
        if not math.isnan(progress.to_go):
            covered = progress.to_go - rest
        progress.to_go = rest
    # The chair does not know a person's goal: who drives ends the drive there.
    verdict.arrived = progress.person_arrived
    if not rule.has_driver:
        verdict.arrived = has_arrived(rule, prepared, pose, twist, rule.arrival_margin)
    verdict.terminated = verdict.arrived or (seen.bumped and rule.bump_ends)
    verdict.truncated = progress.steps_left <= 0 and not verdict.terminated
    write_terms(rule, progress, verdict, covered, seen.bumped, twist, laser)
    verdict.truncated = verdict.truncated or progress.steps >= rule.max_steps
    verdict.geodesic = progress.geodesic
    verdict.valid_beams = _observe(i, task, seen, laser, out)
