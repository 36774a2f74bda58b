"""Recorded drives of a person, under another assistant.

The other assistant gets the recorded sticks and readings, and answers beside the recorded one;
nothing moves differently. People change their driving with what helps them
(`docs/concepts/drivers.md`): this open loop is a first look. `wheelchair compare --driver`
lets a simulated person drive the same episode with several assistants.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from agents.evaluation.assisted import ACTIVE, StickTrace, angles_between
from agents.policies import GymPolicy, make_policy
from wheelchair_gym.base.arrays import Array
from wheelchair_gym.base.settings import InputError
from wheelchair_gym.recording.replay import RecordedEpisode, replay_env


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
