"""Rewards: named terms with their weights, and whether a step ended the episode.

A term is one field of `RewardWeights` and one line of `write_terms`.

A function of one's own may take the place of the weighted sum. `reward(terms, sensed, action) ->
float` is called after each step with

- `terms`: the weighted terms by name, as in `info["reward_terms"]`: `terms.progress`;
- `sensed`: a record of `wheelchair_gym.sim.state.SENSED`: what the chair senses, and the truth
  (`sensed.true_pose`, `sensed.clearance`, `sensed.contact`, `sensed.energy`, ...);
- `action`: (2,) in [-1, 1], as the policy gave it.

The vector environment compiles it with numba, so there it may use numbers, arrays and `math` only.
"""

import dataclasses
import math
from collections.abc import Callable
from functools import lru_cache
from typing import Any, Final

import numba
import numpy as np
from numba import literal_unroll

from wheelchair_gym.base.arrays import Array, Floats, Rows
from wheelchair_gym.base.errors import InputError, shorten
from wheelchair_gym.base.registry import Registry, is_place
from wheelchair_gym.base.settings import setting, setting_docs, settings
from wheelchair_gym.compiled.address import read_record, table_at
from wheelchair_gym.compiled.kernel import borrowing_kernel, check_written, kernel
from wheelchair_gym.geometry.kinematics import twist_of_action
from wheelchair_gym.geometry.planar import wrap
from wheelchair_gym.sim.state import SENSED
from wheelchair_gym.task.side_clearance import proximity_speed

_TUNED = "tuned on training seeds"


@settings
class RewardWeights:
    """Weights of the named reward terms; the reward is their weighted sum."""

    progress: float = setting(default=0.125, unit="1/m", source=_TUNED)
    """Way to go that was covered [m]; seconds to go where the aim is time."""
    time: float = setting(default=-0.05, unit="1/s", source=_TUNED)
    """Time that passed [s]."""
    arrived: float = setting(default=1.0)
    """1 at the goal, by the chair's own estimate."""
    bumped: float = setting(default=-2.0, source=_TUNED)
    """1 if a bumper strip is pressed."""
    timeout: float = setting(default=-0.5, source=_TUNED)
    """1 at the time limit."""
    action_rate: float = setting(default=-0.003, source=_TUNED)
    """Squared change of the action, before the shield; the first is compared with 0."""
    shield_intervention: float = setting(default=0.0)
    """Size of the twist that the shield took off the one asked for, in full speeds."""
    proximity_speed: float = setting(default=0.0, unit="s/m2")
    """Squared speed of the outline's fastest corner [m2/s2], times the period [s]; weighted from 0
    at 0.2 m to 1 at contact with what the first scanner shows."""
    disagreement: float = setting(default=-0.02, unit="1/s")
    """Distance of the twist that was asked for from that of the stick, in full speeds, times the
    period [s]; 0 where nobody drives."""


TERMS = tuple(field.name for field in dataclasses.fields(RewardWeights))
TERM_VALUES = np.dtype([(name, "f8") for name in TERMS])

VERDICT = read_record("VERDICT", globals())[0]


def reward_table() -> str:
    """All reward terms as a table in Markdown."""
    docs = setting_docs(RewardWeights)
    rows = [
        f"| {f.name} | {docs[f.name]} | {f.default:g} |" for f in dataclasses.fields(RewardWeights)
    ]
    return "\n    ".join(["| term | what is weighted | weight |", "| --- | --- | --- |", *rows])


@kernel
def reached_pose(pose: Array, speed: float, goal: Array, arrival: Array, margin: float) -> bool:
    """Whether a chair at a pose (3,) with a speed [m/s] has arrived at a goal (3,) that is a pose.

    `arrival` holds the numbers (4,) of an `Arrival`; the margin [m] is how much stricter it is, at
    most half of the tolerance.
    """
    c, s = math.cos(goal[2]), math.sin(goal[2])
    dx, dy = pose[0] - goal[0], pose[1] - goal[1]
    for off, maximum in ((c * dx + s * dy, arrival[0]), (c * dy - s * dx, arrival[1])):
        if not abs(off) <= max(maximum - margin, 0.5 * maximum):  # nor if it is NaN
            return False
    return bool(abs(wrap(goal[2] - pose[2])) <= arrival[2] and abs(speed) <= arrival[3])


@borrowing_kernel
def has_arrived(rule: Any, prepared: Any, pose: Array, twist: Array, margin: float) -> bool:
    """Return True if a pose (3,) and a twist (2,) count as being at a prepared episode's goal.

    `margin`: how much stricter than the tolerance [m], at most half of it.
    """
    goal = prepared.goal
    if prepared.arrival[0] > 0.0:
        return bool(reached_pose(pose, twist[0], goal, prepared.arrival, margin))
    tolerance = max(prepared.tolerance - margin, 0.5 * prepared.tolerance)
    if not math.hypot(goal[0] - pose[0], goal[1] - pose[1]) <= tolerance:  # nor if it is NaN
        return False
    return bool(not rule.heading or abs(wrap(goal[2] - pose[2])) <= rule.heading_tolerance)


@borrowing_kernel
def write_no_terms(verdict: Any) -> None:
    """Set all reward terms of a record of VERDICT to zero."""
    terms = verdict.terms
    for name in literal_unroll(TERMS):
        terms[name] = 0.0
    verdict.reward = 0.0


@borrowing_kernel
def disagreement(rule: Any, progress: Any) -> float:
    """Distance of the action's twist from that of the stick it answers, in full speeds."""
    now, stick = progress.action, progress.sticks[1]  # [0] is a period newer than the action
    v, w = twist_of_action(now[0], now[1], rule.forward, rule.backward, rule.turn)
    to_v, to_w = twist_of_action(stick[0], stick[1], rule.forward, rule.backward, rule.turn)
    return math.hypot((v - to_v) / rule.forward, (w - to_w) / rule.turn)


@borrowing_kernel
def write_terms(
    rule: Any, progress: Any, verdict: Any, covered: float, bumped: bool, twist: Array,
    laser: Floats,
) -> None:  # fmt: skip
    """Write the weighted reward terms of one step and their sum into a record of VERDICT."""
    w, t = rule.weights, verdict.terms
    now, before = progress.action, progress.previous
    shield_v, shield_w = progress.shield_share[0], progress.shield_share[1]
    near = 0.0
    if w.proximity_speed != 0.0:
        directions = table_at(rule.directions, rule.laser_beams, 2)
        scan = laser[: rule.laser_beams]
        near = proximity_speed(scan, directions, rule.mount[:], rule.outline[:], twist)
    t.progress = w.progress * covered
    t.time = w.time * rule.period
    t.arrived = w.arrived * verdict.arrived
    t.bumped = w.bumped * bumped
    t.timeout = w.timeout * verdict.truncated
    t.action_rate = w.action_rate * ((now[0] - before[0]) ** 2 + (now[1] - before[1]) ** 2)
    t.shield_intervention = w.shield_intervention * math.hypot(shield_v, shield_w)
    t.proximity_speed = w.proximity_speed * near * rule.period
    t.disagreement = 0.0
    if rule.has_driver:
        t.disagreement = w.disagreement * disagreement(rule, progress) * rule.period
    reward = 0.0
    for name in literal_unroll(TERMS):
        reward += t[name]
    verdict.reward = reward


check_written("reward term", TERMS, write_terms)


RewardFunction = Callable[[Any, Any, Array], float]

# Names that other packages add, each with its `module:function`; this project adds none.
REWARDS: Final = Registry("reward", {}, group="wheelchair_gym.rewards")


def make_reward(spec: Any) -> RewardFunction | None:
    """The function of a setting: a callable, a name or `module:function`; None of None.

    Raises:
        InputError: it is none of these, or it gives no number for a blank step.
    """
    if spec is None:
        return None
    name = spec if isinstance(spec, str) else getattr(spec, "__name__", shorten(spec))
    if isinstance(spec, str):
        if spec not in REWARDS.places and not is_place(spec):
            known = ", ".join([*REWARDS, "module:function"])
            raise InputError(f"reward {spec!r} is unknown; expected {known}")
        spec = REWARDS[spec]
    if not callable(spec):
        raise InputError(f"reward is {shorten(spec)}; expected a function or module:function")
    function: RewardFunction = spec
    try:
        terms, sensed = as_record(np.zeros(1, TERM_VALUES)), as_record(np.zeros(1, SENSED))
        value = function(terms, sensed, np.zeros(2))
    except Exception as error:  # whatever somebody's function raises
        why = f"{type(error).__name__}: {str(error).splitlines()[0] if str(error) else ''}"
        known = ", ".join([*(TERM_VALUES.names or ()), *(SENSED.names or ())])
        raise InputError(
            f"reward {name}: with a step of zeros it raises {why}; terms and sensed have {known}"
        ) from error
    checked(value, name)
    return function


def as_record(rows: Rows) -> Any:
    """The first of some rows, with its fields as attributes."""
    return rows.view(np.recarray)[0]


def checked(value: Any, name: str = "function") -> float:
    """A reward as a float.

    Raises:
        InputError: it is no finite number.
    """
    try:
        number = float(value)
    except (TypeError, ValueError):
        number = math.nan
    if not math.isfinite(number):
        raise InputError(f"reward {name} gave {shorten(value)}; expected a finite number")
    return number


@lru_cache(maxsize=8)  # a function may hold an environment
def compiled_rewards(function: RewardFunction) -> Callable[[Rows, Rows, Array, Array], None]:
    """A compiled loop that writes the rewards (n,) of verdicts, sensed records and actions.

    Raises:
        InputError: numba cannot compile the function.
    """
    one: Any = function if hasattr(function, "py_func") else numba.njit(function)

    @numba.njit(error_model="numpy")
    def rewards_of_rows(verdicts: Any, sensed: Any, actions: Array, rewards: Array) -> None:
        for i in range(rewards.shape[0]):
            rewards[i] = one(verdicts[i].terms, sensed[i], actions[i])

    try:
        rewards_of_rows(np.zeros(1, VERDICT), np.zeros(1, SENSED), np.zeros((1, 2)), np.zeros(1))
    except Exception as error:  # numba has errors of several kinds
        name = getattr(function, "__name__", "function")
        lines = [line.strip() for line in str(error).splitlines() if line.strip()]
        telling = [line for line in lines if not line.startswith(("Failed in", "During", "File"))]
        why = next(iter(telling or lines), type(error).__name__)
        raise InputError(
            f"reward {name}: numba cannot compile it, as the vector environment needs ({why})"
        ) from error
    return rewards_of_rows
