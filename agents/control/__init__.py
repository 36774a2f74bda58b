"""Followers: from a path and what is around the chair to the next twist."""

from collections.abc import Mapping
from typing import Any, Final

from wheelchair_gym.base.registry import Registry

_PLACE: Final = "agents.control.followers"
FOLLOWERS: Final = Registry(
    "follower",
    {
        "controls": f"{_PLACE}:GeneratedControls",
        "dwa": f"{_PLACE}:DynamicWindow",
        "mppi": f"{_PLACE}:PathIntegral",
        "pure_pursuit": f"{_PLACE}:PurePursuit",
        "thesis": f"{_PLACE}:ThesisControls",
        "whales": "agents.control.whales:RefinedWindow",
        "window": f"{_PLACE}:Window",
    },
    group="wheelchair_gym.followers",
    needs=("make", "twist"),
)


def make_follower(spec: Mapping[str, Any]) -> Any:
    """Return a follower's settings, whose `make` builds it, from `{"name": name, **settings}`.

    Raises:
        InputError: the name is unknown or a setting is wrong.
    """
    return FOLLOWERS.make({"name": "window", **spec})
