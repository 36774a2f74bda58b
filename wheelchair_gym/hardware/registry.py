"""Real chairs by name, which implement `Chair` as the simulated one does."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Final
from urllib.parse import urlsplit

from wheelchair_gym.base.errors import load_extra
from wheelchair_gym.base.registry import Registry
from wheelchair_gym.base.settings import InputError, load
from wheelchair_gym.hardware.settings import HardwareSettings, TwinSettings

if TYPE_CHECKING:
    from wheelchair_gym.envs.settings import EnvSettings
    from wheelchair_gym.types import Chair

CHAIRS: Final = Registry(
    "chair",
    {
        "hardware": "wheelchair_gym.hardware.settings:HardwareSettings",
        "ros": "wheelchair_gym.hardware.ros.settings:RosSettings",
        "twin": "wheelchair_gym.hardware.settings:TwinSettings",
    },
)

# Names for settings of one of these chairs, which other settings override.
PRESETS: Final[dict[str, dict[str, Any]]] = {
    "ros2": {"name": "ros", "odometry": "/odom", "velocity": "/cmd_vel"}  # as nav2 names them
}


def chair_settings(spec: str | Mapping[str, Any], base: HardwareSettings | None = None) -> Any:
    """Settings of a chair from NAME, NAME://HOST:PORT or a mapping {"name": NAME, settings}.

    A NAME is one of `CHAIRS` or `PRESETS`.

    Args:
        spec: name, URL or mapping.
        base: settings of the chair where the spec has none.

    Raises:
        InputError: the name is unknown, or a setting is wrong.
    """
    values = {"name": spec} if isinstance(spec, str) else dict(spec)
    name, place = str(values.pop("name", "")), {}
    if "://" in name:
        try:
            url = urlsplit(name)
            host, port = url.hostname, url.port
        except ValueError:
            host, port = None, None
        if not host or url.path not in ("", "/") or url.query or url.fragment or "@" in name:
            raise InputError(f"chair {name!r}: expected {name.partition(':')[0]}://HOST:PORT")
        name, place = url.scheme, {"host": host} | ({} if port is None else {"port": port})
    if name in PRESETS:
        values = PRESETS[name] | values
        name = values.pop("name")
    CHAIRS.spec(name)
    kept = base if isinstance(base, CHAIRS[name]) else None
    return load(CHAIRS[name], values | place, f"chair {name}", kept)


def make_chair(spec: str | Mapping[str, Any], settings: EnvSettings) -> Chair:
    """A chair that answers.

    Args:
        spec: see `chair_settings`.
        settings: of the environment that drives it: sensors, outline, rate, and whether the pose
            on the map comes from the chair or from a localizer here.

    Raises:
        InputError: the spec is wrong, or nothing answers there.
    """
    config = chair_settings(spec, settings.hardware)
    sensors, period = settings.sensors, 1.0 / settings.rate
    source = sensors.pose_source
    on_map = source in ("truth", "modelled")
    if on_map and isinstance(config, HardwareSettings | TwinSettings):
        name = "twin" if isinstance(config, TwinSettings) else "hardware"
        raise InputError(
            f"chair {name}: it has no pose source {source!r}; expected mcl, slam or odometry"
        )
    if isinstance(config, TwinSettings):
        from wheelchair_gym.hardware.twin.inprocess import EpisodeTwin

        return localized(EpisodeTwin(settings, config.plant), settings)
    if isinstance(config, HardwareSettings):
        from wheelchair_gym.hardware.chair import HardwareChair
        from wheelchair_gym.hardware.joystick import Joystick

        if config.joystick.device:
            load_extra("evdev")
        real = HardwareChair(config, sensors, settings.chair, period)
        if config.joystick.device:
            real.joystick = Joystick(config.joystick, real.rearm)
        return localized(real, settings)
    from wheelchair_gym.hardware.ros.chair import RosChair

    return RosChair(config, sensors, settings.chair, period, on_map)


def check_extras(spec: str | Mapping[str, Any]) -> None:
    """Refuse a chair whose packages are missing, before anything else is prepared.

    Raises:
        InputError: the spec is wrong, or an extra is not installed.
    """
    has_boards = isinstance(chair_settings(spec), HardwareSettings | TwinSettings)
    load_extra("serial" if has_boards else "websockets.sync")


def localized(chair: Chair, settings: EnvSettings) -> Chair:
    """The chair, with its pose from odometry where no localizer estimates one."""
    if settings.sensors.localizes:
        return chair
    from wheelchair_gym.hardware.boards.senses import OdometryLocalizer
    from wheelchair_gym.perception.localized_chair import LocalizedChair

    return LocalizedChair(chair, OdometryLocalizer())
