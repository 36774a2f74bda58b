"""Real chairs by name: what stands behind `Chair` in place of the simulated one."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Final
from urllib.parse import urlsplit

from wheelchair_gym.config import InputError, load
from wheelchair_gym.hardware.ros_settings import RosSettings

if TYPE_CHECKING:
    from wheelchair_gym.envs.settings import EnvSettings
    from wheelchair_gym.hardware.ros import RosChair

CHAIRS: Final[dict[str, type]] = {"ros": RosSettings}


def chair_settings(spec: str | Mapping[str, Any]) -> Any:
    """Settings of a chair from NAME, NAME://HOST:PORT or a mapping {"name": NAME, settings}.

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
        if not host or url.path not in ("", "/"):
            raise InputError(f"chair {name!r}: expected {name.partition(':')[0]}://HOST:PORT")
        name, place = url.scheme, {"host": host} | ({} if port is None else {"port": port})
    if name not in CHAIRS:
        raise InputError(f"chair {name!r} is unknown; known: {', '.join(sorted(CHAIRS))}")
    return load(CHAIRS[name], values | place, f"chair {name}")


def make_chair(spec: str | Mapping[str, Any], settings: EnvSettings) -> RosChair:
    """A chair, once it answers.

    Args:
        spec: see `chair_settings`.
        settings: of the environment that drives it: its sensors, its outline, the rate, and whether
            the pose is what the chair tells of itself on the map, or is worked out here.

    Raises:
        InputError: the spec is wrong, or nothing answers there.
    """
    from wheelchair_gym.hardware.ros import RosChair

    own = chair_settings(spec)
    sensors = settings.sensors
    worked_out = sensors.pose_source not in ("truth", "modelled")
    return RosChair(own, sensors, settings.chair, 1.0 / settings.rate, not worked_out)
