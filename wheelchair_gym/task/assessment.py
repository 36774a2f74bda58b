"""Assessment: what a policy observes of a reading, and how the step to it is rewarded."""

from __future__ import annotations

import math
from typing import Any

from wheelchair_gym.arrays import Array, Floats
from wheelchair_gym.compiled.address import rows_of
from wheelchair_gym.compiled.kernel import borrowing_kernel, inlined
from wheelchair_gym.task.observations import extend_trail, observe, reset_trail
from wheelchair_gym.task.prepared_episode import PREPARED, distance_to_go, geodesic_to_go
from wheelchair_gym.task.records import PROGRESS, RULES
from wheelchair_gym.task.rewards import has_arrived, write_no_terms, write_terms
from wheelchair_gym.tracking.tracker import TRACKERS, reset_tracker, update_tracker

_rules_at, _prepared_at, _progress_at = map(rows_of, (RULES, PREPARED, PROGRESS))
_trackers_at = rows_of(TRACKERS)


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
def _observe(
    i: int, task: Any, pose: Array, twist: Array, laser: Floats, ultrasonic: Floats, stamp: float,
    out: Floats,
) -> int:  # fmt: skip
    """Write what row i's policy observes of a reading; returns how many beams are finite."""
    rule, prepared, progress = task_row(task, i)
    trackers = _trackers_at(task[0].trackers, 1)
    if rule.size.tracks > 0:
        update_tracker(i, trackers, pose, twist, laser[: rule.laser_beams], stamp)
    return observe(rule, prepared, progress, i, trackers, pose, twist, laser, ultrasonic, out)


@borrowing_kernel
def begin_task(
    i: int,
    task: Any,
    verdicts: Any,
    pose: Array,
    twist: Array,
    laser: Floats,
    ultrasonic: Floats,
    stamp: float,
    is_shielded: bool,
    out: Floats,
) -> None:
    """Begin row i's episode with its first reading; the other arguments are those of `assess`."""
    rule, prepared, progress = task_row(task, i)
    verdict = verdicts[i]
    way = geodesic_to_go(prepared, pose[0], pose[1])
    limit = rule.time_base + rule.time_factor * way / rule.forward
    if not math.isnan(prepared.time_limit):
        limit = prepared.time_limit
    progress.time_limit = limit
    progress.geodesic = geodesic_to_go(prepared, prepared.start[0], prepared.start[1])
    progress.steps_left, progress.steps = max(1, round(limit / rule.period)), 0
    progress.to_go = distance_to_go(prepared, rule.aim, pose[0], pose[1], pose[2])
    progress.is_shielded = is_shielded
    reset_trail(progress, pose)
    for k in range(2):
        progress.action[k] = progress.shield_intervention[k] = 0.0
    progress.sticks[:, :] = 0.0
    progress.latched = progress.person_arrived = False
    if rule.size.tracks > 0:
        reset_tracker(i, _trackers_at(task[0].trackers, 1))
    write_no_terms(verdict)
    verdict.terminated, verdict.truncated = False, False
    verdict.arrived = has_arrived(rule, prepared, pose, twist, rule.arrival_margin)
    verdict.geodesic = progress.geodesic
    verdict.valid_beams = _observe(i, task, pose, twist, laser, ultrasonic, stamp, out)


@borrowing_kernel
def assess(
    i: int,
    task: Any,
    verdicts: Any,
    action: tuple[float, float],
    pose: Array,
    twist: Array,
    laser: Floats,
    ultrasonic: Floats,
    stamp: float,
    bumped: bool,
    less_v: float,
    less_w: float,
    out: Floats,
) -> None:
    """Assess the step of row i's action, and write the observation that follows."""
    rule, prepared, progress = task_row(task, i)
    verdict = verdicts[i]
    progress.steps_left -= 1
    progress.steps += 1
    for k in range(2):
        progress.previous[k] = progress.action[k]
        progress.action[k] = min(1.0, max(-1.0, action[k]))
    if rule.size.trail > 0:
        extend_trail(progress, pose)
    progress.shield_intervention[0] = less_v / rule.forward
    progress.shield_intervention[1] = less_w / rule.turn
    rest = distance_to_go(prepared, rule.aim, pose[0], pose[1], pose[2])
    covered = 0.0
    if not math.isnan(rest):  # else what was covered counts when a way is known again
        if not math.isnan(progress.to_go):
            covered = progress.to_go - rest
        progress.to_go = rest
    # The chair does not know a person's goal: who drives ends the drive there.
    verdict.arrived = progress.person_arrived
    if not rule.has_driver:
        verdict.arrived = has_arrived(rule, prepared, pose, twist, rule.arrival_margin)
    verdict.terminated = verdict.arrived or (bumped and rule.bump_ends)
    verdict.truncated = progress.steps_left <= 0 and not verdict.terminated
    write_terms(rule, progress, verdict, covered, bumped, twist, laser)
    verdict.truncated = verdict.truncated or progress.steps >= rule.max_steps
    verdict.geodesic = progress.geodesic
    verdict.valid_beams = _observe(i, task, pose, twist, laser, ultrasonic, stamp, out)
