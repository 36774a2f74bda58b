"""`wheelchair replay`: judge and draw a recorded run again, or compare another policy with it."""

from __future__ import annotations

import argparse
from typing import Any

import numpy as np

from agents.cli.arguments import report, spec, watch
from agents.people.replay import open_loop
from agents.policies import GymPolicy, make_policy
from agents.watch import Each, ignore
from wheelchair_gym.base.settings import InputError
from wheelchair_gym.recording.replay import RecordedEpisode, read_recording, replay_env
from wheelchair_gym.rendering.video import write_png, write_video


def run(given: argparse.Namespace) -> int:
    """Replay the episodes and report."""
    chapters = read_recording(given.file)
    chosen = range(len(chapters)) if given.episode is None else [given.episode]
    if given.episode is not None and given.episode >= len(chapters):
        raise InputError(f"--episode {given.episode}: {given.file} has {len(chapters)}, from 0")
    frames: list[Any] = []
    records, lines = [], []
    mode = "rgb_array" if given.video or given.picture or given.images else None
    viewers, env, each = watch(given), None, ignore
    try:
        for number in chosen:
            inner: Any = replay_env(chapters[number], mode)
            if env is None or not viewers:
                env, each = viewers.on(inner)
            else:
                env.env = inner  # one recording for all chapters
            record = {"episode": number} | _again(chapters[number], env, each, given, frames)
            if given.assist is not None:
                record |= open_loop(chapters[number], spec(given.assist))
            records.append(record)
            line = (
                f"episode {number}: {record['steps']} steps, reward {record['reward']:.4f}; "
                f"{'the same' if record['same'] else 'OTHER'} rewards"
            )
            if given.policy:
                line += f"; mean difference of {given.policy}'s action: {record['difference']:.3f}"
            if given.assist is not None:
                line += f"; {_said(given.assist, record)}"
            lines.append(line)
    finally:
        if env is not None:
            env.close()
    if given.video:
        write_video(given.video, frames, chapters[0].settings.rate)
    if given.picture:
        write_png(given.picture, frames[-1])
    report(given, records, "\n".join(lines))
    return 0 if all(record["same"] for record in records) else 1


def _said(name: str, record: dict[str, Any]) -> str:
    """Return the figures of `open_loop` in words."""
    before, other = record["recorded"], record["other"]
    angle, alike = record["difference_angle"], 100.0 * (1.0 - record["difference_share"])
    answers = "the same, to the bit" if record["same_answers"] else f"alike for {alike:.0f} % of it"
    beside = "" if angle is None else f", {np.degrees(angle):.1f} deg beside it on average"
    shares = (100.0 * figures["intervention_share"] for figures in (other, before))
    changes = "it changes the stick's twist for {:.0f} % of the time (recorded: {:.0f} %)"
    return f"{name} answers {answers}{beside}; {changes.format(*shares)}"


def _again(
    chapter: RecordedEpisode, env: Any, each: Each, given: argparse.Namespace,
    frames: list[Any],
) -> dict[str, Any]:  # fmt: skip
    """Judge an episode again; with a policy, compare its action at every step."""
    observation, _ = env.reset(seed=0, options={"episode": chapter.episode})
    policy = GymPolicy(make_policy(spec(given.policy)), env) if given.policy else None
    if policy is not None:
        policy.reset()
    rewards, same, differences = 0.0, True, []
    for action, verdict in zip(chapter.actions, chapter.verdicts, strict=True):
        if policy is not None:
            differences.append(np.abs(policy.act(observation) - np.clip(action, -1.0, 1.0)).mean())
        if given.video:
            frames.append(env.unwrapped.render())
        each(env)
        observation, reward, terminated, truncated, info = env.step(action)
        terms = info["reward_terms"].items()  # a term that an older recording lacks must be 0
        terms = {name: value for name, value in terms if name in verdict["terms"] or value != 0.0}
        judged = {"reward": reward, "terms": terms}
        judged |= {"terminated": terminated, "truncated": truncated}
        same &= judged == verdict
        rewards += reward
    if given.video or given.picture:
        frames.append(env.unwrapped.render())
    record = {"steps": len(chapter.actions), "reward": rewards, "same": same}
    return record | ({"difference": float(np.mean(differences))} if differences else {})
