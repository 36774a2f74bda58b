"""People at the stick: their assistants, drives, recordings and experiments.

`make_assistant` makes an assistant: from a person's stick and the chair's sensors to the twist that
is asked for. None knows the person's goal. What they ask for passes the shield afterwards, where
there is one: two safe twists may blend into an unsafe one. `drive` reads the stick of a living
person and lets them drive a chair, `recorded_stick` asks another assistant about a recorded drive,
and `fit_driver` makes a simulated person like them. `protocol` is the plan of an experiment with
participants, `session` runs it, `folder` keeps it, and `report` compares its conditions.
"""

from collections.abc import Mapping
from typing import Any, Final

from wheelchair_gym.base.registry import Registry
from wheelchair_gym.people.assistance import COMPILED
from wheelchair_gym.people.assistance.step import CompiledAssistant

# Settings class of every assistant; each that is not compiled has `make() -> Assistant`.
ASSISTANTS: Final = Registry(
    "assistant",
    {
        **COMPILED.built_in,
        "blend": "agents.people.goals:Blend",
        "hindsight": "agents.people.goals:Hindsight",
        "hypotheses": "agents.people.goals:Hypotheses",
        "manoeuvre": "agents.people.goals:Manoeuvre",
        "ppo_assist": "agents.policies.learned:PpoAssist",
        "residual": "agents.policies.learned:Residual",
    },
    group="wheelchair_gym.assistants",
    needs=("make", "assist"),
)


def make_assistant(spec: str | Mapping[str, Any] | Any) -> Any:
    """A fresh assistant, with `reset` and `assist` (`agents.people.assistant.Assistant`).

    Args:
        spec: a name, `{"name": name, **settings}`, or settings that have `make()`; `module:Class`
            names somebody's class, and FILE.npz or FILE.onnx the weights of a learned assistant.

    Raises:
        InputError: the name is unknown (the message lists those known) or a setting is wrong.
    """
    found = _settings(spec)
    if COMPILED.name_of(found) is not None:
        return CompiledAssistant(found)
    return found.make() if hasattr(found, "make") else found


def is_shielded(spec: str | Mapping[str, Any] | Any) -> bool:
    """Whether an assistant is driven behind the shield: all are, except the bare stick."""
    return bool(getattr(_settings(spec), "shielded", True))


def _settings(spec: str | Mapping[str, Any] | Any) -> Any:
    if isinstance(spec, str) and spec.endswith((".npz", ".onnx")):
        spec = {"name": "residual", "weights": spec}  # which adds to the base that the file names
    return spec if hasattr(spec, "make") else ASSISTANTS.make(spec)
