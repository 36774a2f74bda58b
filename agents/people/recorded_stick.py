"""Recorded drives of a person: their stick, prompts for it, and the answers of another assistant.

The other assistant gets the recorded sticks and readings, and answers beside the recorded one;
nothing moves differently. People change their driving with what helps them
(`docs/concepts/drivers.md`): this open loop is a first look. `wheelchair compare --driver`
lets a simulated person drive the same episode with several assistants.
"""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agents.evaluation.assisted import ACTIVE, StickTrace, angles_between
from agents.policies import GymPolicy, make_policy
from wheelchair_gym.base.arrays import Array
from wheelchair_gym.base.settings import InputError
from wheelchair_gym.people.drivers.intention import NEAR_GOAL
from wheelchair_gym.recording.replay import RecordedEpisode, replay_env

HOLD, REST = 2.5, 2.0  # s for which a prompt asks for a deflection, and for the centre after it
# What is held, as kinds of interfaces of drivers.
_KINDS = {"board": "stick", "gamepad": "stick", "touch": "stick", "keyboard": "switches"}


class StickSession(NamedTuple):
    """The stick of one recorded session."""

    period: float  # s between two sticks
    sticks: Array  # (n, 2) forward, left
    latched: bool  # a stick of it was
    near_goal: NDArray[np.bool_]  # (n,) where a tremor may be larger
    prompts: Array  # (k, 3) s, forward, left; none in a drive
    interface: str  # which was held
    share: float  # of full speed at full deflection


def schedule(
    seed: int, sizes: Sequence[float] = (1.0, 0.5), directions: int = 8
) -> list[list[float]]:
    """Prompts in an order that cannot be foreseen: rows of time [s], forward, left.

    Args:
        seed: of the order.
        sizes: deflections that each direction is asked for; of switches, 1 each time.
        directions: 8, or 4 without those between.

    Returns:
        Rows; between two deflections the centre is asked for.
    """
    ways = [
        (x, y) for x in (-1, 0, 1) for y in (-1, 0, 1) if 0 < abs(x) + abs(y) < directions / 2.5
    ]
    asked = [(size * x / math.hypot(x, y), size * y / math.hypot(x, y))
             for x, y in ways for size in sizes]  # fmt: skip
    order = np.random.default_rng(seed).permutation(len(asked))
    rows, now = [[0.0, 0.0, 0.0]], REST
    for k in order:
        rows += [[now, *asked[k]], [now + HOLD, 0.0, 0.0]]
        now += HOLD + REST
    return rows


def prompt_text(forward: float, left: float) -> str:
    """Return the prompt that asks a person for a deflection."""
    if forward == left == 0.0:
        return "let go: centre"
    ways = [("forward", forward), ("backward", -forward), ("left", left), ("right", -left)]
    size = "fully" if math.hypot(forward, left) > 0.75 else "by half"
    return f"push {size} {' and '.join(name for name, value in ways if value > 0.1)}"


def session_of(recorded: RecordedEpisode) -> StickSession:
    """The stick of a recorded episode.

    Raises:
        InputError: no person drove, or with more than one interface.
    """
    if not recorded.has_person:
        raise InputError("expected recordings in which a person drives")
    if others := {"interface", "hand"}.intersection(recorded.changed):
        raise InputError(f"the {' and the '.join(sorted(others))} changed in mid-drive")
    found: Any = [state.reading.stick for state in recorded.states]
    labels, places = recorded.labels, np.array([state.truth.pose[:2] for state in recorded.states])
    near = np.hypot(*(places - recorded.episode.goal[:2]).T) < NEAR_GOAL
    if recorded.settings.driver is None:  # the goal is none of the person's
        near[:] = False
    interface = str(labels.get("interface", "stick"))
    try:
        prompts = np.array(labels.get("prompts", []), np.float64).reshape(-1, 3)
        share = float(labels.get("share", 1.0))
    except (TypeError, ValueError):
        raise InputError("the recording's prompts or share of full speed are malformed") from None
    return StickSession(
        1.0 / recorded.settings.rate,
        np.array([(stick.forward, stick.left) for stick in found]),
        any(stick.latched for stick in found),
        near,
        prompts,
        _KINDS.get(interface, interface),
        share,
    )


def before_dead_zone(sticks: Array, device: Any, share: float) -> Array:
    """Deflections (n, 2) before the dead zone; NaN where the stick is within it."""
    size = np.hypot(*sticks.T)
    with np.errstate(divide="ignore", invalid="ignore"):
        before = device.dead_zone + (1.0 - device.dead_zone) * size / (device.gain * share)
        raw: Array = sticks * (before / size)[:, None]
    raw[size == 0.0] = math.nan
    return raw


def open_loop(recorded: RecordedEpisode, assist: Any) -> dict[str, Any]:
    """Compare the answers of another assistant with the recorded ones.

    Both are taken before the shield, as shares of full speed.

    Args:
        recorded: an episode that a person drove.
        assist: spec of the other assistant.

    Returns:
        `same_answers`: every answer is equal, to the bit; `difference_share`, of the time in which
        they differ by more than 0.05; `difference_size`, their mean difference while either drives;
        `difference_angle`, the mean angle between them [rad]; `longest`, start and end [s] of the
        longest time in which they differ; the measures of `agents.evaluation.assisted` of either,
        `recorded` and `other`.

    Raises:
        InputError: no person drove, the assistant's spec is wrong, or the recorded actions are
            residuals of an assistant that the environment held.
    """
    if recorded.settings.assistant is not None:
        raise InputError(
            "replay --assist: the recorded actions are residuals of the environment's assistant; "
            "expected a drive of the policy assisted"
        )
    if not recorded.has_person:
        raise InputError(
            "--assist: expected a recording in which a person drives, by simulate --driver, "
            "compare --driver, drive or studio"
        )
    env = replay_env(recorded)
    observation, _ = env.reset(seed=0, options={"episode": recorded.episode})
    policy = GymPolicy(make_policy({"name": "assisted", "assist": assist}), env)
    policy.reset()
    task = env.task
    full = np.array([task.limits.forward, task.limits.turn])
    traces = StickTrace(task.limits, task.period), StickTrace(task.limits, task.period)
    answers: list[tuple[Array, Array]] = []
    twists, length, same = [task.reading.twist], 0.0, True
    for action in recorded.actions:
        other, stick = policy.act(observation), task.stick
        same &= bool(np.array_equal(other, action))
        assert stick is not None
        pair = task.limits.twist(action), task.limits.twist(other)
        for trace, twist in zip(traces, pair, strict=True):
            trace.add(stick, twist)
        answers.append((pair[0] / full, pair[1] / full))
        observation, *_ = env.step(action)
        twists.append(task.reading.twist)
        length += abs(float(task.reading.twist[0])) * task.period
    env.close()
    figures: dict[str, Any] = {"same_answers": same, **_differences(answers, task.period)}
    for name, trace in zip(("recorded", "other"), traces, strict=True):
        found = trace.figures(np.array(twists), length)
        figures[name] = {key: value for key, value in found.items() if math.isfinite(value)}
    return figures


def _differences(answers: list[tuple[Array, Array]], period: float) -> dict[str, Any]:
    """Figures of two assistants' answers (n, 2) to the same sticks, in full speeds."""
    ours, others = np.array(answers).reshape(-1, 2, 2).transpose(1, 0, 2)
    off = np.hypot(*(others - ours).T)
    moves = np.hypot(*ours.T) > ACTIVE, np.hypot(*others.T) > ACTIVE
    active, angles = moves[0] | moves[1], angles_between(ours, others)[moves[0] & moves[1]]
    edges = np.flatnonzero(np.diff(np.concatenate(([0], off > ACTIVE, [0]))))
    spans = edges.reshape(-1, 2)
    longest = spans[np.argmax(spans[:, 1] - spans[:, 0])] * period if len(spans) else None
    return {
        "difference_share": float((off > ACTIVE).mean()) if len(off) else 0.0,
        "difference_size": float(off[active].mean()) if active.any() else 0.0,
        "difference_angle": float(angles.mean()) if len(angles) else None,
        "longest": None if longest is None else longest.tolist(),
    }
