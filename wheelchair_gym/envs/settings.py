"""Settings of an environment, and how they follow from arguments."""

import dataclasses
import warnings
from collections.abc import Mapping, Sequence
from numbers import Integral
from os import PathLike, fspath
from pathlib import Path
from typing import Any, cast, get_args

import numpy as np

from wheelchair_gym.base.errors import ArgumentError, shorten
from wheelchair_gym.base.files import read_json
from wheelchair_gym.base.settings import InputError, dump, load, setting, settings, suggest
from wheelchair_gym.compiled.random import SEEDS, Split
from wheelchair_gym.hardware.settings import HardwareSettings
from wheelchair_gym.people.assistance import COMPILED, make_compiled
from wheelchair_gym.people.assistance.step import Assistants
from wheelchair_gym.people.drivers import drivers_spec, make_drivers
from wheelchair_gym.perception.localized_chair import Localizer
from wheelchair_gym.perception.monte_carlo import LocalizationSettings, MonteCarloLocalizer
from wheelchair_gym.perception.slam import Slam, SlamSettings
from wheelchair_gym.safety.settings import ShieldSettings
from wheelchair_gym.sensors.settings import SensorSettings
from wheelchair_gym.sim.settings import ChairSettings, PhysicsSettings
from wheelchair_gym.task.settings import TaskSettings


@settings
class BankSettings:
    """A bank of worlds that episodes share; off by default."""

    size: int = setting(default=0, low=0, high=10_000_000)
    """Number of worlds that an episode draws from; 0: every episode has its own world."""
    turnover: float = setting(default=0.1, low=0.0, high=1000.0)
    """Worlds that are replaced per episode of an environment."""
    seed: int = setting(default=0, low=0, high=SEEDS - 1)
    """Seed of the worlds."""
    cache: str | None = setting(default=None)
    """Folder that keeps worlds with their guidance from run to run; none: nothing is kept."""


@settings
class EnvSettings:
    """Everything that makes an environment."""

    scene: Any = setting(default="floor_plan")
    """Scene that episodes are drawn from: a name, module:Class, a mapping with a name, the Path of
    a map file, or a list of such files."""
    rate: float = setting(default=10.0, unit="Hz", low=0.5, high=200.0)
    """Frequency of control."""
    guidance: Any = setting(default=None)
    """Source of guidance: none, 'geodesic', 'poses', 'module:function', or a mapping with
    'call'."""
    reward: Any = setting(default=None)
    """Source of the reward: none (the weighted terms of task.reward), or 'module:function' or a
    callable, see `wheelchair_gym.task.rewards`. Recordings and reports keep the terms."""
    bank: BankSettings = BankSettings()
    starts_within: float = setting(default=0.0, unit="s", low=0.0)
    """Largest plan time from the start to the goal; 0: episodes begin at the scene's start."""
    chair: ChairSettings = ChairSettings()
    sensors: SensorSettings = SensorSettings()
    localization: LocalizationSettings = LocalizationSettings()
    slam: SlamSettings = SlamSettings()
    physics: PhysicsSettings = PhysicsSettings()
    task: TaskSettings = TaskSettings()
    shield: ShieldSettings | None = setting(default=None)
    """Settings of the shield; none: the chair drives what a policy asks for. A real chair always
    has a shield."""
    driver: Any = setting(default=None)
    """Simulated person who drives: none, a name of `people.drivers`, module:function, a mapping
    with a name, or a list of those: each episode draws one. Actions are then those of an
    assistant, which sees the person's stick and neither its goal nor its way; the guidance 'poses'
    is the person's."""
    assistant: Any = setting(default=None)
    """Compiled assistant that drives with the person: none, a name of `people.assistance`, or a
    mapping with a name. Actions are then residuals: an action's twist is added to the assistant's,
    within the assistant's freedom, and zero lets the assistant drive alone."""
    unshielded: float = setting(default=0.0, low=0.0, high=1.0)
    """Share of simulated episodes that are driven without the shield; for training only."""
    hardware: HardwareSettings = HardwareSettings()
    render_width: int = setting(default=640, unit="pixels", low=64, high=4096)
    """Width of every frame, whatever the shape of the world."""
    render_height: int = setting(default=640, unit="pixels", low=64, high=4096)
    """Height of every frame, whatever the shape of the world."""

    def __post_init__(self) -> None:
        if isinstance(self.scene, Mapping):  # plain, so that settings can be written as JSON
            object.__setattr__(self, "scene", dump(self.scene))
        elif isinstance(self.scene, PathLike | list | tuple):
            paths = [self.scene] if isinstance(self.scene, PathLike) else self.scene
            for k, path in enumerate(paths):
                if not isinstance(path, str | PathLike):
                    raise InputError(f"scene[{k}] is {shorten(path)}; expected the path of a map")
            files = [fspath(path) for path in paths]
            path = files[0] if len(files) == 1 else files
            object.__setattr__(self, "scene", {"name": "map_file", "path": path})
        if self.driver is not None:
            make_drivers(self.driver)  # which refuses what is wrong
            object.__setattr__(self, "driver", drivers_spec(self.driver))
            if self.guidance is None:
                object.__setattr__(self, "guidance", "poses")
        if self.assistant is not None:
            made = make_compiled(self.assistant)  # which refuses what is wrong
            if not isinstance(self.assistant, str):
                object.__setattr__(self, "assistant", COMPILED.spec(made))
        for name in ("render_width", "render_height"):
            if getattr(self, name) % 2:
                raise InputError(
                    f"{name} is {getattr(self, name)}; expected an even number, as films have"
                )
        if self.sensors.pose_source == "slam" and self.guidance is not None:
            raise InputError(
                f"guidance is {shorten(self.guidance)}; expected none with the pose source slam: "
                "there is no map to plan on"
            )


def read_env_settings(content: Mapping[str, Any], where: str) -> EnvSettings:
    """Settings from the content of a file, in which `model` may name a chair of `configs/chairs`.

    Raises:
        InputError: the chair is unknown, a value is wrong, or one stands there that is the chair's.
    """
    if not isinstance(content, Mapping) or "model" not in content:
        return load(EnvSettings, content, where)
    others, name = dict(content), content["model"]
    del others["model"]
    chair, base = _chair(name, where), load(EnvSettings, others, where)
    for section, values in chair.items():
        _refuse_common(values, dump(others.get(section, {})), f"{where}.{section}", name)
    return load(EnvSettings, chair, where, base)


def _refuse_common(chair: dict[str, Any], others: dict[str, Any], where: str, name: str) -> None:
    """Refuse settings of a file that a chair's own file holds, too."""
    for key in sorted(chair.keys() & others.keys()):
        if not isinstance(chair[key], dict):
            raise InputError(f"{where}.{key}: expected none beside the model {name}")
        _refuse_common(chair[key], others[key], f"{where}.{key}", name)


def _chair(name: Any, where: str) -> dict[str, Any]:
    """Settings of a chair of `configs/chairs`, by section."""
    if name not in MODELS:
        known = f"{', '.join(MODELS[:-1])} or {MODELS[-1]}"
        raise InputError(f"{where}.model is {shorten(name)}; expected {known}")
    return dict(read_json(f"configs/chairs/{name}.json"))


MODELS = ("thesis", "rear", "rear_ultrasonics")  # the chairs of `configs/chairs`
_ON_EDGE = 1e-3  # m: a sensor so near the outline's edge is on it
_DEEP = 0.03  # m: an ultrasonic so far inside the outline is probably a forgotten one
_ARGUMENTS = (
    "scene", "rate", "guidance", "reward", "bank", "shield", "driver", "assistant", "render_width",
    "render_height",
)  # fmt: skip
_PLACES = {
    "beams": ("task", "beams"),
    "pose_source": ("sensors", "pose_source"),
    "noise": ("sensors", "noise"),
    "randomize": ("chair", "randomize"),
    "scaled": ("task", "scaled"),
    "max_episode_steps": ("task", "max_episode_steps"),
}


def env_settings(
    config: str | Path | Mapping[str, Any] | EnvSettings | None,
    *,
    model: str | None = None,
    also: Sequence[str] = (),
    **changes: Any,
) -> EnvSettings:
    """Settings from a file, its content or defaults, with the changes that are not None.

    Args:
        config: path of a JSON file, its content, ready settings, or None for the defaults.
        model: a chair of `configs/chairs` (thesis, rear or rear_ultrasonics), whose sensors replace
            those of `config`.
        also: further arguments of the caller, for the message about an unknown one.
        changes: scene, rate, guidance, reward, bank, shield, driver, assistant, render_width,
            render_height, beams, pose_source, noise, randomize, scaled, max_episode_steps.

    Raises:
        InputError: the file or a value is wrong.
        ArgumentError: a change is unknown.
    """
    if isinstance(config, EnvSettings):
        base = config
    elif config is None or isinstance(config, Mapping):
        base = read_env_settings(config or {}, "config")
    elif isinstance(config, str | PathLike):
        base = read_env_settings(read_json(config), Path(config).name)
    else:
        expected = "expected a file, its content or EnvSettings"
        raise InputError(f"config is {shorten(config)}; {expected}")
    if model is not None:
        base = load(EnvSettings, _chair(model, "env"), "env", base)
    unknown = [name for name in changes if name not in (*_ARGUMENTS, *_PLACES)]
    if unknown:
        known = _ARGUMENTS[0], "config", "model", *_ARGUMENTS[1:], *_PLACES, *also
        near = suggest(unknown[0], known)
        raise ArgumentError(
            f"the environment got an unexpected keyword argument {', '.join(map(repr, unknown))}; "
            f"it has {', '.join(known)}{near}"
        )
    given = {name: value for name, value in changes.items() if value is not None}
    if isinstance(given.get("bank"), Integral):
        given["bank"] = BankSettings(size=given["bank"])
    elif isinstance(given.get("bank"), Mapping):
        given["bank"] = load(BankSettings, given["bank"], "bank")
    if "shield" in given:
        given["shield"] = _shield(given["shield"], base.shield)
    for name, (section, key) in _PLACES.items():
        if name in given:
            part = dataclasses.replace(getattr(base, section), **{key: given.pop(name)})
            base = dataclasses.replace(base, **{section: part})
    made = dataclasses.replace(base, **given)
    _warn_of_mounts(made)
    return made


def _warn_of_mounts(config: EnvSettings) -> None:
    """Warn of sensors outside the chair's outline, and of ultrasonics deep inside it."""
    outline, sensors, outside, deep = config.chair.footprint, config.sensors, [], []
    mounts: list[tuple[str, Any]] = [
        (f"more_lasers[{k - 1}]" if k else "laser", laser) for k, laser in enumerate(sensors.lasers)
    ]
    mounts += [(f"ultrasonic {k}", mount) for k, mount in enumerate(sensors.ultrasonic.mounted)]
    for name, mount in mounts:
        x, y = mount.x, mount.y
        depth = min(outline.front - x, outline.rear + x, outline.half_width - abs(y))
        if depth < -_ON_EDGE:
            outside.append(f"{name} at ({x:g}, {y:g})")
        elif depth > _DEEP and name.startswith("ultrasonic"):
            deep.append(f"{name} at ({x:g}, {y:g})")
    for found, what, advice in (
        (deep, f"ultrasonics more than {_DEEP:g} m inside", "they stay where they are when the "
         "outline grows: set sensors.ultrasonic.mounted"),
        (outside, "sensors outside", "they may see from inside a wall: set sensors.laser, "
         "sensors.more_lasers and sensors.ultrasonic.mounted"),
    ):  # fmt: skip
        if found:
            text = f"{what} the chair's outline ({outline}): {', '.join(found)}; {advice}"
            warnings.warn(text, stacklevel=3)


def is_integer(value: Any, low: int = 0) -> bool:
    """Return True for an integer from `low` to 2**63 - 1; a truth value is none."""
    if not isinstance(value, Integral) or isinstance(value, bool):
        return False
    return low <= int(value) < SEEDS


def check_seed(seed: Any, name: str = "seed") -> int:
    """Return a seed as a plain integer.

    Raises:
        InputError: it is no integer, or out of bounds.
    """
    if not is_integer(seed):
        raise InputError(f"{name} is {shorten(seed)}; expected an integer from 0 to 2**63 - 1")
    return int(seed)


def check_split(split: Any) -> Split:
    """Return a split of worlds as it is.

    Raises:
        InputError: there is none of this name.
    """
    if split not in get_args(Split):
        raise InputError(f"split is {shorten(split)}; expected {' or '.join(get_args(Split))}")
    return cast("Split", split)


def check_options(options: Mapping[str, Any] | None, *known: str) -> list[Any]:
    """The options that a `reset` knows; None for each that is not given.

    Raises:
        InputError: another option is given, or no mapping.
    """
    if not isinstance(options, Mapping | None):
        raise InputError(f"options is {shorten(options)}; expected a mapping or None")
    for name in options or {}:
        if name not in known:
            names = ", ".join(known)
            raise InputError(
                f"options: {name!r} is no option of reset; known: {names}{suggest(name, known)}"
            )
    return [(options or {}).get(name) for name in known]


def make_assistants(config: EnvSettings, n: int, has_person: bool) -> Assistants:
    """The assistants of n chairs; of none, where the settings name none.

    Raises:
        InputError: an assistant is set, and nobody drives.
    """
    method = None
    if config.assistant is not None:
        method = make_compiled(config.assistant)
        if not has_person:
            raise InputError("assistant: expected a person who drives: set driver")
    return Assistants(method, config.chair, config.sensors, 1.0 / config.rate, n)


def _shield(spec: Any, configured: ShieldSettings | None) -> ShieldSettings | None:
    """Settings of a shield from true (as configured, if it is), false, a mapping or themselves."""
    if isinstance(spec, bool | np.bool_):
        return (configured or ShieldSettings()) if spec else None
    if isinstance(spec, Mapping):
        return load(ShieldSettings, spec, "shield")
    if isinstance(spec, ShieldSettings):
        return spec
    expected = "expected true, false or an object of its settings"
    raise InputError(f"shield is {shorten(spec)}; {expected}")


def make_localizer(config: EnvSettings) -> Localizer:
    """Return the localizer that estimates the pose from the scans."""
    if config.sensors.pose_source == "slam":
        return Slam(config.sensors.laser, config.slam)
    return MonteCarloLocalizer(config.localization, config.sensors.laser)
