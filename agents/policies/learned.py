"""Learned policies and assistants: a trained network drives, or changes what an assistant gives.

What a network observes is made as in training, and it acts as often (`Trained`). A learned policy
drives wherever a chair has readings, a map and a goal. A learned assistant observes the stick, its
history and the chair's sensors. What it adds to the twist of a compiled assistant, its base, is a
residual (Johannink et al. 2019; for shared control Schaff and Walter 2020), kept within the base's
freedom: it cannot move a chair whose stick is centred.
"""

import dataclasses
import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from agents.control.local_map import MAP_MARGIN
from agents.learning.weights import SHIPPED_ASSISTANTS, Layout, Network, find_weights, load_weights
from agents.people.assistant import AssistMission, Freedom
from agents.policies import file_of
from wheelchair_gym.base.arrays import Array, Floats
from wheelchair_gym.base.files import file_digest
from wheelchair_gym.base.settings import InputError, dump, load, setting, settings
from wheelchair_gym.envs.guidance import make_guidance
from wheelchair_gym.envs.settings import EnvSettings
from wheelchair_gym.envs.world_banks import prepare_world
from wheelchair_gym.maps import OccupancyGrid
from wheelchair_gym.people.assistance import make_compiled
from wheelchair_gym.people.assistance.step import Assistants
from wheelchair_gym.sensors.settings import SensorSettings
from wheelchair_gym.task import task as tasks
from wheelchair_gym.task.prepared_episode import PreparedEpisode
from wheelchair_gym.types import Command, Episode, Mission, Reading, Shown, Stick

UPDATE_PERIOD = 1.0  # s between two updates from a map that grows
SLACK = 4.0  # s: until then the chair may have strayed so far from the path
STAYED, TURNED = 0.15, 0.4  # m, rad: a chair that has moved less has stayed where it was
BACK = 0.045  # m/s in reverse: a contact at this speed does no harm
BACKING = 5.0  # s for which it backs out: 0.2 m
_ELSE = "; give the settings of the chair that it was trained with (--config)"


@settings
class Learned:
    """A learned policy, by the name or the file of its weights (.npz, or .onnx as exported)."""

    weights: str = setting(default="")
    """Name of weights that come with the package, or a file of them."""
    digest: str | None = setting(default=None)
    """SHA-256 that the file of weights must have; None: any."""
    patience: float = setting(default=0.0, unit="s", low=0.0)
    """Time at one place after which the chair backs out slowly, and drives on; 0: it never does."""

    def __post_init__(self) -> None:
        if self.weights:
            self.path()

    def path(self) -> Path:
        """The file of weights.

        Raises:
            InputError: there is none of that name, or its digest is another one.
        """
        path = find_weights(self.weights)
        if self.digest is not None and file_digest(path) != self.digest:
            raise InputError(f"{path}: its SHA-256 differs from the digest that was asked for")
        return path

    def make(self) -> "LearnedDriver":
        """A fresh policy.

        Raises:
            InputError: there are no such weights, or they are incomplete.
        """
        path = self.path()
        made = LearnedDriver(*read_network(path), self.patience)
        if made.layout.is_assistant:
            raise InputError(
                f"{path}: weights of an assistant, which needs a person: --driver NAME --assist "
                f"{path.stem if path.parent == SHIPPED_ASSISTANTS else path}"
            )
        return made


def weights_digest(spec: Any) -> str | None:
    """Digest of the weights that a policy's name or mapping stands for; None of other policies."""
    if isinstance(spec, Mapping) and spec.get("name") == "isolated":
        return weights_digest(spec.get("policy"))
    try:
        if isinstance(spec, Mapping) and spec.get("name") == "assisted":
            assist = spec.get("assist")
            if isinstance(assist, Mapping):
                assist = assist.get("weights", assist.get("name"))
            return file_digest(find_weights(str(assist)))
        path = file_of(spec)
    except InputError:
        return None
    return None if path is None else file_digest(path)


def read_network(path: Path) -> tuple[Callable[[Floats], Floats], dict[str, Any]]:
    """The network in a file of weights (.npz, .onnx), and its card.

    Raises:
        InputError: the file cannot be read, or is not complete.
    """
    if path.suffix == ".onnx":
        from agents.learning.export import OnnxNetwork

        onnx = OnnxNetwork(path)
        return onnx, onnx.card
    weights = load_weights(path)
    return Network(weights), weights.card


class Trained:
    """A network with the task that makes its observations.

    Args:
        network: gives actions (n, 2) in [-1, 1] for flat observations (n, size).
        card: of its weights.

    Attributes:
        env: settings of the environment of its training.
        layout: of its observations.
        observation: the flat observation (n,) that its last action is for.
    """

    def __init__(self, network: Callable[[Floats], Floats], card: Mapping[str, Any]) -> None:
        self.network: Any = network
        self.env = load(EnvSettings, card["env"], "weights: env")
        self.layout = Layout.of_card(card)

    def begin_episode(self, sensors: SensorSettings, period: float) -> float:
        """Begin an episode on a chair with these sensors and a control period [s].

        Returns the period of actions [s].

        Raises:
            InputError: the network was trained with other sensors or at another rate.
        """
        acts_every = 1.0 / self.env.rate
        self._hold = max(1, round(acts_every / period))
        if not math.isclose(self._hold * period, acts_every, rel_tol=1e-6):
            raise InputError(
                f"the policy acts at {self.env.rate:g} Hz, the environment at {1.0 / period:g} Hz; "
                "expected the policy's rate or a multiple of it (rate, in --config)"
            )
        if len(sensors.ultrasonic.mounted) != dict(self.layout.sizes).get("ultrasonic", 0):
            raise InputError(
                f"the policy was trained with other ultrasonics than this chair has{_ELSE}"
            )
        if len(sensors.lasers) != len(self.env.sensors.lasers):
            raise InputError(f"the policy was trained with other lasers than this chair has{_ELSE}")
        self.observation: Floats | None = None
        self._intervention = np.zeros(2)
        self._steps = 0
        return self._hold * period

    def observe_by(self, task: tasks.Task) -> None:
        """Set the task that makes the observations.

        Raises:
            InputError: its observations have other sizes than those of training.
        """
        sizes = dict(self.layout.sizes)
        for key, box in task.spaces.items():
            if sizes.get(key, box.shape[0]) != box.shape[0]:
                raise InputError(
                    f"the policy was trained with {sizes[key]} numbers of {key}; this chair's "
                    f"sensors give {box.shape[0]}{_ELSE}"
                )
        self.task = task

    def is_due(self, reading: Reading) -> bool:
        """Count a control period; whether an action is due in it."""
        self._intervention += np.divide(reading.shield_intervention, self._hold)
        self._steps += 1
        return (self._steps - 1) % self._hold == 0

    def action(self, reading: Reading) -> Array:
        """The action (2,) in [-1, 1] for a reading."""
        # The twist driven may be less than commanded: `deploy` begins slowly.
        less = float(self._intervention[0]), float(self._intervention[1])
        self._intervention[:] = 0.0
        seen = self.task.assess(reading, reading.action, less)
        parts = [seen[key] for key, _ in self.layout.sizes if key in seen]
        self.observation = np.concatenate(parts)
        action: Array = self.network(self.observation[None])[0].astype(np.float64)
        return action


class LearnedDriver(Trained):
    """Observes as in training, by the same task and guidance, and acts as often.

    Args:
        network, card: see `Trained`.
        patience: time [s] at one place after which the chair backs out; 0: it never does.
        begin: called at the beginning of each episode.
    """

    def __init__(
        self, network: Any, card: Mapping[str, Any], patience: float = 0.0,
        begin: Callable[[], None] = lambda: None,
    ) -> None:  # fmt: skip
        super().__init__(network, card)
        self._begin = begin
        self._patience = patience

    def reset(self, mission: Mission) -> None:
        """See `Policy.reset`."""
        env = self.env
        self._begin()
        period = self.begin_episode(mission.sensors, mission.period)
        shown = "path" in dict(self.layout.sizes)
        task = dataclasses.replace(env.task, privileged=False, aim="goal")
        self._mission = mission
        # The chair is the mission's; it is observed as in training.
        spec = env.guidance
        if self.layout.path_has_heading:
            slack = SLACK if mission.map is None else None
            ways = dump(spec.get("ways", {})) if isinstance(spec, Mapping) else {}
            spec = {"call": "poses", "ways": ways, "max_detour": slack}
        guidance = make_guidance(spec) if shown else None
        self.observe_by(tasks.Task(task, mission.chair, mission.sensors, period, guidance))
        self._updated = 0.0
        self._grows = mission.map is None and guidance is not None
        first = mission.reading
        self._place, self._since = np.array(first.pose), first.stamp  # since then it is there
        self.task.begin(self._prepare(first), first, mission.key, mission.is_shielded)

    def _prepare(self, reading: Reading) -> PreparedEpisode:
        """The episode from where the chair is, on the map as it is now."""
        mission, pose = self._mission, reading.pose
        goal = np.zeros(3)
        goal[: len(mission.goal)] = mission.goal
        grid = mission.map_at(reading)
        if mission.map is None:  # the path may lead beyond what is drawn
            grid = grid.extended_to(np.stack([pose[:2], goal[:2]]), MAP_MARGIN)
            self.task.built_map = lambda: grid
        episode = Episode(grid, pose, goal, tolerance=mission.tolerance)
        if mission.map is None:  # where no way is known yet, none of another radius is searched
            return self.task.prepare(episode)
        return prepare_world(self.task, episode)

    def act(self, reading: Reading) -> Command:
        """See `Policy.act`."""
        if self.is_due(reading):
            if self._grows and reading.stamp - self._updated >= UPDATE_PERIOD:
                self._updated = reading.stamp
                self.task.replace_prepared(self._prepare(reading))
            action = self.action(reading)
            shown = Shown(self.task.path)
            self._command = Command.from_action(action, self._mission.limits, shown)
        return self._back_out(reading) if self._patience else self._command

    def _back_out(self, reading: Reading) -> Command:
        """The network's command, or one straight back where the chair has stayed for too long."""
        dx, dy, turned = np.asarray(reading.pose) - self._place
        near = math.hypot(dx, dy) <= STAYED and abs(math.remainder(turned, math.tau)) <= TURNED
        moved = not near  # also where a pose is no number
        stayed = reading.stamp - self._since
        if stayed > self._patience + BACKING or (moved and stayed <= self._patience):
            self._place, self._since = np.array(reading.pose), reading.stamp
        elif stayed > self._patience:
            return Command(np.array([-BACK, 0.0]), self._command.shown)
        return self._command


@settings
class Residual:
    """Adds to what `shared_dwa` makes of the stick."""

    weights: str = setting(default="residual")
    """Name of weights that come with the package, or a file of them."""

    def __post_init__(self) -> None:
        find_weights(self.weights)  # which refuses what is unknown

    def make(self) -> "LearnedAssistant":
        """A fresh assistant.

        Raises:
            InputError: there are no such weights, they are incomplete, or a policy's.
        """
        path = find_weights(self.weights)
        made = LearnedAssistant(*read_network(path))
        if not made.layout.is_assistant or made.env.assistant is None:
            raise InputError(f"{path}: expected an assistant's weights (train with env.assistant)")
        return made


@settings
class PpoAssist(Residual):
    """Adds to the stick itself."""

    weights: str = setting(default="ppo_assist")
    """Name of weights that come with the package, or a file of them."""


class LearnedAssistant(Trained):
    """A compiled assistant and, as often as in training, what a network adds to its twist."""

    @property
    def freedom(self) -> Freedom:
        """Its freedom: that of its base."""
        freedom: Freedom = make_compiled(self.env.assistant).freedom
        return freedom

    def reset(self, mission: AssistMission) -> None:
        """See `Assistant.reset`."""
        period = self.begin_episode(mission.sensors, mission.period)
        self._base = Assistants(
            make_compiled(self.env.assistant), mission.chair, mission.sensors, mission.period
        )
        self._base.begin()
        task = dataclasses.replace(self.env.task, privileged=False, aim="goal")
        self.observe_by(tasks.Task(task, mission.chair, mission.sensors, period, has_driver=True))
        self._began = False

    def assist(self, stick: Stick, reading: Reading, map: OccupancyGrid | None) -> Array:
        """See `Assistant.assist`; the map is not looked at."""
        if not self._began:
            self._begin(reading)
        self._base.update(stick, reading)
        if self.is_due(reading):
            self.task.take_stick(stick, reading.pose, reading.twist)
            a_v, a_w = self.action(reading).tolist()
            self._residual = a_v, a_w
        return self._base.twist(self._residual)

    def _begin(self, reading: Reading) -> None:
        """Begin with the first reading; no goal is known, and nothing of it is observed."""
        nowhere = Episode(OccupancyGrid(np.zeros((1, 1), np.int8), 1.0), np.zeros(3), np.zeros(3))
        self.task.begin(self.task.prepare(nowhere), reading, 0, True)
        self._began = True
