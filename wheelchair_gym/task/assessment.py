"""One assessment: what a reading looks like to a policy, and what the step to it was worth."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.compiled.address import (
    doubles_at,
    floats_at,
    moves_at,
    rows_of,
    states_at,
    table_at,
)
from wheelchair_gym.compiled.kernel import borrowing_kernel
from wheelchair_gym.task.observations import bearing_to, look_ahead, look_ahead_poses, pool, see
from wheelchair_gym.task.prepared_episode import COURSE, seconds_to_go, to_go, way_to_go
from wheelchair_gym.task.records import PROGRESS, RULES, VERDICT
from wheelchair_gym.task.rewards import TERMS, reached, weigh
from wheelchair_gym.task.side_clearance import gaps, haste
from wheelchair_gym.task.trail import begin_trail, lengthen_trail, look_back

LONG = 256.0  # s, m: a critic sees longer times and ways as this
HASTE = TERMS.index("haste")
WITHHELD = 2.0  # full speeds ahead or of turning: more is observed as this

Array = NDArray[np.float64]
Floats = NDArray[np.float32]

_rules_at, _courses_at, _progress_at, _verdicts_at = map(
    rows_of, (RULES, COURSE, PROGRESS, VERDICT)
)


@borrowing_kernel
def observe(
    rules: Any,
    course: Any,
    own: Any,
    pose: Array,
    twist: Array,
    laser: Floats,
    ultrasonic: Floats,
    out: Floats,
) -> int:
    """What a policy sees of a reading; returns how many beams are finite.

    Args:
        rules: record of RULES (`task.records`).
        course: record of COURSE.
        own: record of PROGRESS.
        pose: (3,) of the reading [m, m, rad].
        twist: (2,) [m/s, rad/s].
        laser: (beams of the laser,) [m].
        ultrasonic: (rangers,) [m].
        out: laser, ultrasonic, twist, goal, action, shield, path, gaps, trail,
            privileged, hidden_path and hidden_gaps, one after another.
    """
    place = rules.beams
    valid = pool(laser, rules.laser_reach, out[:place])
    reaches = doubles_at(rules.reaches, rules.rangers)
    for i in range(rules.rangers):
        out[place + i] = see(ultrasonic[i], reaches[i])
    place += rules.rangers
    for i in range(2):
        most = rules.twist_most[i]
        out[place + i] = min(most, max(-most, twist[i]))
    place += 2
    bearing_to(pose, course.goal, out[place : place + rules.goal_room])
    place += rules.goal_room
    if rules.last_action:
        out[place], out[place + 1] = own.action[0], own.action[1]
        place += 2
    if rules.shield_state:
        out[place] = 1.0 if own.guarded else 0.0
        for i in range(2):
            out[place + 1 + i] = min(WITHHELD, max(-WITHHELD, own.withheld[i]))
        place += 3
    here = place  # where poses ahead begin, if any do
    if rules.points > 0 and not rules.unguided:
        place += tell_way(rules, course, pose, out[place:])
    if rules.gaps > 0:
        poses = out[here:place]
        if rules.fanned:
            poses = floats_at(rules.fan, 2 * rules.gaps - 4)
        place += tell_gaps(rules, laser, poses, out[place:])
    if rules.trail > 0:
        end = place + 2 * rules.trail
        look_back(own, pose, doubles_at(rules.back, rules.trail), out[place:end])
        place = end
    if rules.privileged:
        seconds = seconds_to_go(course, pose[0], pose[1], pose[2])
        out[place] = min(seconds, LONG) if seconds >= 0.0 else LONG  # NaN: not known
        out[place + 1] = min(max(0.0, own.steps_left * rules.period), LONG)
        out[place + 2] = min(way_to_go(course, pose[0], pose[1]), LONG)
        place += 3
        if rules.unguided and rules.points > 0:
            end = place + tell_way(rules, course, pose, out[place:])
            if rules.gaps > 0:
                tell_gaps(rules, laser, out[place:end], out[end:])
    return valid


@borrowing_kernel
def tell_way(rules: Any, course: Any, pose: Array, out: Floats) -> int:
    """Tell of points or poses of the guidance ahead of a pose (3,); how many numbers that are."""
    ahead = doubles_at(rules.ahead, rules.points)
    if not rules.posed:
        path = table_at(course.path, course.points, 2)
        look_ahead(path, pose, ahead, out[: 2 * rules.points])
        return int(2 * rules.points)
    look_ahead_poses(
        states_at(course.words, course.word_rows, course.word_cols, course.headings),
        moves_at(course.moves, course.n_moves, course.headings, 3),
        course.word_cell,
        course.word_origin,
        pose,
        course.goal,
        ahead,
        out[: 4 * rules.points],
    )
    return int(4 * rules.points)


@borrowing_kernel
def tell_gaps(rules: Any, laser: Floats, poses: Floats, out: Floats) -> int:
    """Tell of gaps, where the chair is and at poses (4 k,) ahead; how many numbers that are."""
    count = int(2 + poses.shape[0] // 2)
    directions = table_at(rules.directions, rules.laser_beams, 2)
    gaps(laser, directions, rules.mount[:], rules.outline[:], poses, out[:count])
    return count


@borrowing_kernel
def believes_arrived(rules: Any, course: Any, pose: Array) -> bool:
    """Whether a chair that believes to be at a pose (3,) may say that it has arrived."""
    tolerance = max(course.tolerance - rules.doubt, 0.5 * course.tolerance)
    return reached(pose, course.goal, tolerance, rules.heading, rules.heading_tolerance)


@borrowing_kernel
def start_task(
    i: int,
    rules: Any,
    courses: Any,
    progress: Any,
    verdicts: Any,
    pose: Array,
    twist: Array,
    laser: Floats,
    ultrasonic: Floats,
    guarded: bool,
    out: Floats,
) -> None:
    """Row i takes up an episode with its first reading, behind a shield if it is guarded.

    The other arguments are those of `assess`.
    """
    rule, course, own, verdict = rules[0], courses[i], progress[i], verdicts[i]
    way = way_to_go(course, pose[0], pose[1])
    limit = rule.time_base + rule.time_factor * way / rule.forward
    if not math.isnan(course.time_limit):
        limit = course.time_limit
    own.time_limit = limit
    own.geodesic = way_to_go(course, course.start[0], course.start[1])
    own.steps_left = max(1, round(limit / rule.period))
    own.to_go = to_go(course, rule.aim, pose[0], pose[1], pose[2])
    own.guarded = guarded
    begin_trail(own, pose)
    for k in range(2):
        own.action[k] = own.withheld[k] = 0.0
    for k in range(verdict.terms.shape[0]):
        verdict.terms[k] = 0.0
    verdict.reward = 0.0
    verdict.terminated, verdict.truncated = False, False
    verdict.arrived = believes_arrived(rule, course, pose)
    verdict.geodesic = own.geodesic
    verdict.valid_beams = observe(rule, course, own, pose, twist, laser, ultrasonic, out)


@borrowing_kernel
def assess(
    i: int,
    rules: Any,
    courses: Any,
    progress: Any,
    verdicts: Any,
    action: Array,
    pose: Array,
    twist: Array,
    laser: Floats,
    ultrasonic: Floats,
    bumped: bool,
    less_v: float,
    less_w: float,
    out: Floats,
) -> None:
    """Judge the step that row i's action led to, and observe where it led.

    Args:
        i: row.
        rules: (1,) of RULES.
        courses: (n,) of COURSE.
        progress: (n,) of PROGRESS; the row moves on.
        verdicts: (n,) of VERDICT; the row is written.
        action: (2,) in [-1, 1]; beyond is clipped.
        pose: (3,) of the reading [m, m, rad].
        twist: (2,) [m/s, rad/s].
        laser: (beams of the laser,) [m].
        ultrasonic: (rangers,) [m].
        bumped: a bumper strip is pressed.
        less_v: what a shield took from the velocity that was asked for [m/s].
        less_w: likewise [rad/s].
        out: (room,) the observation, see `observe`.
    """
    rule, course, own, verdict = rules[0], courses[i], progress[i], verdicts[i]
    own.steps_left -= 1
    for k in range(2):
        own.previous[k] = own.action[k]
        own.action[k] = min(1.0, max(-1.0, action[k]))
    if rule.trail > 0:
        lengthen_trail(own, pose)
    own.withheld[0], own.withheld[1] = less_v / rule.forward, less_w / rule.turn
    rest = to_go(course, rule.aim, pose[0], pose[1], pose[2])
    covered = 0.0
    if not math.isnan(rest):  # else what was covered counts when a way is known again
        if not math.isnan(own.to_go):
            covered = own.to_go - rest
        own.to_go = rest
    verdict.arrived = believes_arrived(rule, course, pose)
    verdict.terminated = verdict.arrived or bumped
    verdict.truncated = own.steps_left <= 0 and not verdict.terminated
    near = 0.0
    if rule.weights[HASTE] != 0.0:
        directions = table_at(rule.directions, rule.laser_beams, 2)
        near = haste(laser, directions, rule.mount[:], rule.outline[:], twist)
    weigh(
        rule.weights,
        covered,
        rule.period,
        verdict.arrived,
        bumped,
        verdict.truncated,
        own.action,
        own.previous,
        math.hypot(own.withheld[0], own.withheld[1]),
        near,
        verdict.terms,
    )
    verdict.reward = 0.0
    for k in range(verdict.terms.shape[0]):
        verdict.reward += verdict.terms[k]
    verdict.geodesic = own.geodesic
    verdict.valid_beams = observe(rule, course, own, pose, twist, laser, ultrasonic, out)


@borrowing_kernel
def assess_alone(
    alone: Any,
    action: Array,
    pose: Array,
    twist: Array,
    laser: Floats,
    ultrasonic: Floats,
    bumped: bool,
    less_v: float,
    less_w: float,
    out: Floats,
) -> None:
    """`assess` of a task that is alone, its rows found by address: alone (1,) of ALONE."""
    own = alone[0]
    assess(
        0,
        _rules_at(own.rules, 1),
        _courses_at(own.course, 1),
        _progress_at(own.progress, 1),
        _verdicts_at(own.verdict, 1),
        action,
        pose,
        twist,
        laser,
        ultrasonic,
        bumped,
        less_v,
        less_w,
        out,
    )
