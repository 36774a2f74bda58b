"""`wheelchair export` and `wheelchair inspect`: what can be done with learned weights."""

from __future__ import annotations

import argparse
from pathlib import Path

from agents.cli.arguments import env_of, report, spec
from agents.evaluation.evaluate import drive_episode, make_env
from agents.policies import make_policy
from wheelchair_gym.config import InputError
from wheelchair_gym.files import atomic_write


def export(given: argparse.Namespace) -> int:
    """Write weights as ONNX, or with a model card."""
    if given.npz is not None:
        from agents.learning.publish import publish

        file = Path(given.npz)
        weights = publish(Path(given.policy), [Path(name) for name in given.results], file)
        report(given, weights.card, f"{file} and {file.with_suffix('.md')}")
        return 0
    from agents.learning.export import export_onnx
    from agents.learning.weights import find_weights, load_weights

    sidecar = export_onnx(load_weights(find_weights(given.policy)), given.onnx)
    report(given, sidecar, f"{given.onnx} and {given.onnx}.json")
    return 0


def inspect(given: argparse.Namespace) -> int:
    """Drive an episode, hide parts of the observation, and draw how the action changes."""
    import matplotlib as mpl

    from agents.evaluation.figures import LOOK
    from agents.learning.occlusion import OcclusionRecorder

    file = Path(given.out)
    if file.suffix not in (".png", ".svg", ".pdf"):
        raise InputError(f"--out {file}: expected a name that ends with .png, .svg or .pdf")
    policy = make_policy(spec(given.policy))
    recorder = OcclusionRecorder(policy)
    env = make_env(spec(given.scene), env_of(given))
    try:
        outcome = drive_episode(env, policy, given.seed, recorder)["outcome"]
        with mpl.rc_context(LOOK):
            figure, values = recorder.draw(env, given.moment)
            with atomic_write(file) as part:
                figure.savefig(part, format=file.suffix[1:], dpi=150)
    finally:
        env.close()
    values |= {"policy": given.policy, "seed": given.seed, "outcome": outcome}
    keys = sorted(values["parts"].items(), key=lambda pair: -pair[1])
    lines = [f"{name}: {change:.3f}" for name, change in keys]
    report(given, values, "\n".join([f"{outcome}; the action changes by", *lines, str(file)]))
    return 0
