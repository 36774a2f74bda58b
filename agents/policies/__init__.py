"""Policies: what every one answers, and how one is made from a name or from settings."""

from collections.abc import Mapping
from dataclasses import is_dataclass
from difflib import get_close_matches
from pathlib import Path
from typing import Any, Final, Protocol

import numpy as np
from numpy.typing import NDArray

from agents import read_data
from wheelchair_gym.base.arrays import Array
from wheelchair_gym.base.errors import shorten
from wheelchair_gym.base.registry import Registry, imported, is_place
from wheelchair_gym.base.settings import InputError, dump, load, suggest
from wheelchair_gym.types import Command, Mission, Reading, Shown

DRIVING: Final[dict[str, dict[str, Any]]] = read_data("driving.yaml")  # settings of planners

# Settings class of every family of policies; each has `make() -> Policy`.
POLICIES: Final = Registry(
    "policy",
    {
        "assisted": "agents.policies.delegated:Assisted",
        "explore": "agents.policies.explore:Explore",
        "isolated": "agents.policies.delegated:Isolated",
        "learned": "agents.policies.learned:Learned",
        "manual": "agents.policies.scripted:Manual",
        "planned": "agents.policies.planned:Planned",
        "random": "agents.policies.scripted:RandomPolicy",
        "ros": "agents.robot:RosClient",
        "sb3": "agents.policies.sb3:Sb3Model",
        "straight": "agents.policies.scripted:StraightPolicy",
    },
    group="wheelchair_gym.policies",
    needs=("make", "act"),
)


class Policy(Protocol):
    """Something that drives. It gets a mission and readings, never the truth or the environment.

    It changes neither of them; its commands are all that it returns.
    """

    def reset(self, mission: Mission) -> None:
        """Begin an episode: forget the last one, and plan where that takes time."""
        ...

    def act(self, reading: Reading) -> Command:
        """The command for the next control period; the first reading is the mission's."""
        ...


class GymPolicy:
    """A policy in a Gymnasium loop: its `act` takes an observation and gives an action.

    The policy gets the reading that the environment made the observation from. The environment
    shows what the command has to show.

    Args:
        policy: any.
        env: `NavigationEnv`, in any wrappers.

    Attributes:
        command: the policy's last; None before it has acted in this episode.
    """

    def __init__(self, policy: Policy, env: Any) -> None:
        self.policy, self._env = policy, env.unwrapped
        self.command: Command | None = None

    def reset(self) -> None:
        """Begin the episode that the environment was reset to."""
        self.command, mission = None, self._env.mission
        self._limits, self._steps = mission.limits, 0
        try:
            self.policy.reset(mission)
        except Exception as error:
            error.add_note(f"policy {type(self.policy).__name__}: its reset failed")
            raise

    def act(self, observation: Mapping[str, NDArray[np.float32]]) -> Array:
        """The next action (2,) in [-1, 1]."""
        reading = self._env.reading
        try:
            self.command = command = self.policy.act(reading)
        except Exception as error:
            when = f"in step {self._steps}, {reading.stamp:g} s after the start"
            error.add_note(f"policy {type(self.policy).__name__}: its act failed {when}")
            raise
        self._steps += 1
        self._env.show(checked(command, self.policy).shown)
        return command.as_action(self._limits)


def checked(command: Command, policy: Policy) -> Command:
    """A policy's answer, if it is a command.

    Raises:
        InputError: it is something else.
    """
    known = isinstance(command, Command) and isinstance(command.shown, Shown)
    if not known or np.shape(command.twist) != (2,):
        raise InputError(
            f"{type(policy).__name__}.act gave {shorten(command)}; expected a Command with a twist "
            "of two numbers [m/s, rad/s]"
        )
    return command


def make_policy(spec: str | Mapping[str, Any] | Any) -> Policy:
    """A fresh policy.

    Args:
        spec: a name (`straight`, `a_star`, `a_star+window`), a mapping `{"name": name, **settings}`
            or a settings object that has `make()`. `module:Class` names somebody's class: a
            policy, settings of one, or a planner or follower in `PLANNER+FOLLOWER`.

    Raises:
        InputError: the name is unknown (the message lists those known) or a setting is wrong.
    """
    policy: Policy = settings_of(spec).make()
    return policy


def settings_of(spec: str | Mapping[str, Any] | Any) -> Any:
    """The settings object that a spec of `make_policy` stands for.

    Raises:
        InputError: see `make_policy`.
    """
    if isinstance(spec, str):
        spec = {"name": spec}
    if isinstance(spec, Mapping):
        values = dict(spec)
        name = values.pop("name", None)
        if not isinstance(name, str):
            raise InputError("policy: expected a name, or an object with the key 'name'")
        spec = _named(name, values)
    if not hasattr(spec, "make"):
        raise InputError(f"policy is {spec!r}; expected a name, an object or policy settings")
    return spec


def spec_of(policy: str | Mapping[str, Any] | Any) -> str | Mapping[str, Any] | Any:
    """Return a policy's spec for comparison: a name or mapping as it is, our settings as mapping.

    Settings of other packages stay as they are; their class and their values identify them.

    Raises:
        InputError: `make_policy` does not take it, or its values cannot be read.
    """
    if isinstance(policy, str | Mapping):
        return policy
    if name := kind_of(policy):
        plain, config = dump(POLICIES[name]()), dump(policy)
        changed = {key: value for key, value in config.items() if value != plain[key]}
        if name == "planned":
            named = (config[part].get("name", "") for part in ("planner", "follower"))
            changed["label"] = "+".join(named)
        return {"name": name, **changed} if changed else name
    if not is_dataclass(policy):
        raise InputError(
            f"policy is {policy!r}; expected a dataclass: episodes are stored by its values"
        )
    return policy


def kind_of(policy: str | Mapping[str, Any] | Any) -> str:
    """The name of a policy's family: learned, planned, ...; empty if it is not one of ours."""
    config = settings_of(policy)
    return next((name for name in POLICIES.built_in if type(config) is POLICIES[name]), "")


def file_of(policy: str | Mapping[str, Any] | Any) -> Path | None:
    """The file of a learned policy: weights (.npz, .onnx) or a model (.zip); None of others.

    Raises:
        InputError: see `make_policy`.
    """
    config = settings_of(policy)
    return config.path() if kind_of(config) in ("learned", "sb3") else None


def _named(name: str, values: dict[str, Any]) -> Any:
    from agents.control import FOLLOWERS
    from agents.learning.weights import SHIPPED_ASSISTANTS, shipped
    from planners import PLANNERS

    if name in shipped() | shipped(SHIPPED_ASSISTANTS) or name.endswith((".npz", ".onnx")):
        _refuse_another(name, "weights", values.get("weights", name), name)
        return load(POLICIES["learned"], values | {"weights": name}, f"policy {name}")
    if name.endswith(".zip"):
        _refuse_another(name, "file", values.get("file", name), name)
        return load(POLICIES["sb3"], values | {"file": name}, f"policy {name}")
    if name in POLICIES.places or (is_place(name) and not hasattr(imported(name), "plan")):
        return POLICIES.make({"name": name, **values})
    planner, plus, follower = name.partition("+")
    if planner not in PLANNERS or (plus and follower not in FOLLOWERS):
        likely = get_close_matches(planner, PLANNERS, 1) or [planner]
        pairs = (f"{likely[0]}+{one}" for one in FOLLOWERS) if plus else ()
        near = suggest(name, (*POLICIES, *shipped(), *PLANNERS, *pairs))
        simple = {*POLICIES, *shipped()} - {"learned", "planned", "sb3"}
        raise InputError(
            f"policy {name!r} is unknown; known: {', '.join(sorted(simple))}, a file of weights "
            "(.npz, .onnx), a model of stable-baselines3 (.zip), module:Class, PLANNER or "
            f"PLANNER+FOLLOWER (`wheelchair settings` lists planners and followers){near}"
        )
    for key, chosen in (("planner", planner), ("follower", follower)):
        part = values.get(key, {})
        if not isinstance(part, Mapping):
            raise InputError(f"policy {name}.{key} is {part!r}; expected an object of settings")
        if chosen or part:
            used = chosen or part.get("name", "window")
            _refuse_another(name, f"{key}.name", part.get("name", used), used)
            values[key] = {**DRIVING.get(chosen, {}), **part, "name": used}
    return load(POLICIES["planned"], values, f"policy {name}")


def _refuse_another(policy: str, key: str, given: Any, name: str) -> None:
    """Refuse a setting that names something else than the policy's own name does."""
    if given != name:
        raise InputError(f"policy {policy}.{key} is {shorten(given)}; expected {name!r}, or none")
